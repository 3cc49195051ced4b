"""Motion to the middle of a step and from there to its end, in double precision.

A step of length T is drift, kick, drift. The first half-drift goes on with the velocities of the
start, which gives the geometry of the middle; there all forces act; the second half-drift makes up
the displacement that they led to. A free body turns without a torque as Euler's equations say,
``w' = inv(I) (I w x w)`` in its principal frame, its angular momentum constant in space, so the
kick holds no gyroscopic force of it. Positions are kept as a sum of two numbers, ``qpos`` and the
rest that single precision cannot hold: motion slower than an ulp a step is not lost.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

FREE = 0
BALL = 1
SUBSTEPS = 2


@wp.func
def quat_of(w: wp.float64, x: wp.float64, y: wp.float64, z: wp.float64) -> wp.quatd:
    """MuJoCo's order, w first."""
    return wp.quatd(x, y, z, w)


@wp.func
def turned(q: wp.quatd, angle: wp.vec3d) -> wp.quatd:
    """Return q turned by a rotation vector of its own frame."""
    size = wp.length(angle)
    half = wp.float64(0.5) * size
    scale = wp.float64(0.5)
    if size > wp.float64(1.0e-9):
        scale = wp.sin(half) / size
    axis = angle * scale
    return wp.normalize(q * wp.quatd(axis[0], axis[1], axis[2], wp.cos(half)))


@wp.func
def euler_rate(w: wp.vec3d, inertia: wp.vec3d) -> wp.vec3d:
    """Angular acceleration without a torque, principal frame."""
    torque = wp.cross(wp.cw_mul(inertia, w), w)
    return wp.cw_div(torque, inertia)


@wp.func
def free_turn(q: wp.quatd, w_in: wp.vec3d, inertia: wp.vec3d, time: wp.float64):
    """Orientation (principal frame to world) and angular velocity (principal) after `time` (s)."""
    w = w_in
    h = time / wp.float64(wp.static(SUBSTEPS))
    half = wp.float64(0.5) * h
    for _ in range(wp.static(SUBSTEPS)):
        k1 = euler_rate(w, inertia)
        w2 = w + half * k1
        k2 = euler_rate(w2, inertia)
        w3 = w + half * k2
        k3 = euler_rate(w3, inertia)
        w4 = w + h * k3
        k4 = euler_rate(w4, inertia)
        after = w + (h / wp.float64(6.0)) * (k1 + wp.float64(2.0) * (k2 + k3) + k4)
        # Magnus expansion of fourth order: Simpson's mean and the commutator of the ends.
        mean = (w + wp.float64(2.0) * (w2 + w3) + after) / wp.float64(6.0)
        q = turned(q, h * mean + (h * h / wp.float64(12.0)) * wp.cross(w, after))
        w = after
    return q, w


@wp.func
def stored(
    value: wp.float64,
    index: int,
    qpos: wp.array(dtype=wp.float32),
    rest: wp.array(dtype=wp.float32),
):
    """Keep a position as qpos and the rest that it cannot hold."""
    high = wp.float32(value)
    qpos[index] = high
    rest[index] = wp.float32(value - wp.float64(high))


@wp.func
def whole(
    index: int, qpos: wp.array(dtype=wp.float32), rest: wp.array(dtype=wp.float32)
) -> wp.float64:
    """Return the position with its rest."""
    return wp.float64(qpos[index]) + wp.float64(rest[index])


@wp.func
def vec_of(index: int, values: wp.array(dtype=wp.float32)) -> wp.vec3d:
    """Return three numbers in double precision."""
    return wp.vec3d(
        wp.float64(values[index]), wp.float64(values[index + 1]), wp.float64(values[index + 2])
    )


@wp.func
def quat_whole(
    index: int, qpos: wp.array(dtype=wp.float32), rest: wp.array(dtype=wp.float32)
) -> wp.quatd:
    """Return a unit quaternion with its rest."""
    return wp.normalize(
        quat_of(
            whole(index, qpos, rest),
            whole(index + 1, qpos, rest),
            whole(index + 2, qpos, rest),
            whole(index + 3, qpos, rest),
        )
    )


@wp.func
def store_quat(
    q: wp.quatd, index: int, qpos: wp.array(dtype=wp.float32), rest: wp.array(dtype=wp.float32)
):
    """Keep a quaternion and its rest."""
    stored(q[3], index, qpos, rest)
    stored(q[0], index + 1, qpos, rest)
    stored(q[1], index + 2, qpos, rest)
    stored(q[2], index + 3, qpos, rest)


@wp.func
def position_whole(
    index: int, qpos: wp.array(dtype=wp.float32), rest: wp.array(dtype=wp.float32)
) -> wp.vec3d:
    """Return three positions with their rests."""
    return wp.vec3d(
        whole(index, qpos, rest), whole(index + 1, qpos, rest), whole(index + 2, qpos, rest)
    )


@wp.func
def principal_frame(
    world: int,
    body: int,
    body_ipos: wp.array2d(dtype=wp.vec3),
    body_iquat: wp.array2d(dtype=wp.quat),
    body_inertia: wp.array2d(dtype=wp.vec3),
):
    """Centre of mass and principal axes in the frame of a body, and moments of inertia."""
    frame = body_iquat[world % body_iquat.shape[0], body]
    axes = quat_of(
        wp.float64(frame[0]), wp.float64(frame[1]), wp.float64(frame[2]), wp.float64(frame[3])
    )
    centre = wp.vec3d(body_ipos[world % body_ipos.shape[0], body])
    return centre, axes, wp.vec3d(body_inertia[world % body_inertia.shape[0], body])


@wp.func
def store_free(
    p: wp.vec3d,
    q: wp.quatd,
    v: wp.vec3d,
    w: wp.vec3d,
    qa: int,
    va: int,
    qpos: wp.array(dtype=wp.float32),
    qvel: wp.array(dtype=wp.float32),
    rest: wp.array(dtype=wp.float32),
):
    """Keep the state of a free joint."""
    for i in range(3):
        stored(p[i], qa + i, qpos, rest)
        qvel[va + i] = wp.float32(v[i])
        qvel[va + 3 + i] = wp.float32(w[i])
    store_quat(q, qa + 3, qpos, rest)


@wp.kernel
def drift_to_middle(
    timestep: wp.array(dtype=wp.float32),
    jnt_type: wp.array(dtype=wp.int32),
    jnt_qposadr: wp.array(dtype=wp.int32),
    jnt_dofadr: wp.array(dtype=wp.int32),
    jnt_bodyid: wp.array(dtype=wp.int32),
    body_is_free: wp.array(dtype=wp.int32),
    body_ipos: wp.array2d(dtype=wp.vec3),
    body_iquat: wp.array2d(dtype=wp.quat),
    body_inertia: wp.array2d(dtype=wp.vec3),
    part: float,
    qpos_in: wp.array2d(dtype=wp.float32),
    qvel_in: wp.array2d(dtype=wp.float32),
    rest_in: wp.array2d(dtype=wp.float32),
):
    """Move all joints on by `part` of a step with their velocities."""
    world, joint = wp.tid()
    time = wp.float64(part) * wp.float64(timestep[world % timestep.shape[0]])
    qpos = qpos_in[world]
    qvel = qvel_in[world]
    rest = rest_in[world]
    kind = jnt_type[joint]
    qa = jnt_qposadr[joint]
    va = jnt_dofadr[joint]
    body = jnt_bodyid[joint]
    if kind > 1:
        stored(whole(qa, qpos, rest) + time * wp.float64(qvel[va]), qa, qpos, rest)
        return
    if kind == 1:
        q = turned(quat_whole(qa, qpos, rest), time * vec_of(va, qvel))
        store_quat(q, qa, qpos, rest)
        return
    v = vec_of(va, qvel)
    w = vec_of(va + 3, qvel)
    q = quat_whole(qa + 3, qpos, rest)
    p = position_whole(qa, qpos, rest)
    if body_is_free[body] == 0:
        p = p + time * v
        q = turned(q, time * w)
    else:
        centre, principal, inertia = principal_frame(
            world, body, body_ipos, body_iquat, body_inertia
        )
        p = p + wp.quat_rotate(q, centre)
        v = v + wp.quat_rotate(q, wp.cross(w, centre))
        q_after, w_after = free_turn(q * principal, wp.quat_rotate_inv(principal, w), inertia, time)
        q = q_after * wp.quat_inverse(principal)
        w = wp.quat_rotate(principal, w_after)
        p = p + time * v - wp.quat_rotate(q, centre)
        v = v - wp.quat_rotate(q, wp.cross(w, centre))
    store_free(p, q, v, w, qa, va, qpos, qvel, rest)


@wp.kernel
def drift_to_end(
    timestep: wp.array(dtype=wp.float32),
    jnt_type: wp.array(dtype=wp.int32),
    jnt_qposadr: wp.array(dtype=wp.int32),
    jnt_dofadr: wp.array(dtype=wp.int32),
    jnt_bodyid: wp.array(dtype=wp.int32),
    body_is_free: wp.array(dtype=wp.int32),
    body_ipos: wp.array2d(dtype=wp.vec3),
    body_iquat: wp.array2d(dtype=wp.quat),
    body_inertia: wp.array2d(dtype=wp.vec3),
    start_in: wp.array2d(dtype=wp.float32),
    displacement_in: wp.array2d(dtype=wp.float32),
    end_in: wp.array2d(dtype=wp.float32),
    middle_in: wp.array2d(dtype=wp.float32),
    # In and out:
    rest_in: wp.array2d(dtype=wp.float32),
    qpos_out: wp.array2d(dtype=wp.float32),
    qvel_out: wp.array2d(dtype=wp.float32),
):
    """Move all joints from the middle by what the displacement of the step leaves of it."""
    world, joint = wp.tid()
    half = wp.float64(0.5) * wp.float64(timestep[world % timestep.shape[0]])
    rest = rest_in[world]
    middle = middle_in[world]
    qpos = qpos_out[world]
    qvel = qvel_out[world]
    start = start_in[world]
    displacement = displacement_in[world]
    end = end_in[world]
    kind = jnt_type[joint]
    qa = jnt_qposadr[joint]
    va = jnt_dofadr[joint]
    body = jnt_bodyid[joint]
    if kind > 1:
        to_come = wp.float64(displacement[va]) - half * wp.float64(start[va])
        value = whole(qa, middle, rest) + to_come
        stored(value, qa, qpos, rest)
        qvel[va] = end[va]
        return
    if kind == 1:
        q = quat_whole(qa, middle, rest)
        q = turned(q, vec_of(va, displacement) - half * vec_of(va, start))
        store_quat(q, qa, qpos, rest)
        for i in range(3):
            qvel[va + i] = end[va + i]
        return
    q = quat_whole(qa + 3, middle, rest)
    p = position_whole(qa, middle, rest)
    way = vec_of(va, displacement) - half * vec_of(va, start)
    turn = vec_of(va + 3, displacement) - half * vec_of(va + 3, start)
    v = vec_of(va, end)
    w = vec_of(va + 3, end)
    if body_is_free[body] == 0:
        p = p + way
        q = turned(q, turn)
    else:
        centre, principal, inertia = principal_frame(
            world, body, body_ipos, body_iquat, body_inertia
        )
        p = p + wp.quat_rotate(q, centre) + way + wp.quat_rotate(q, wp.cross(turn, centre))
        v = v + wp.quat_rotate(q, wp.cross(w, centre))
        at = q * principal
        momentum = wp.quat_rotate(at, wp.cw_mul(inertia, wp.quat_rotate_inv(principal, w)))
        q_after, _unused = free_turn(at, wp.quat_rotate_inv(principal, turn / half), inertia, half)
        q = q_after * wp.quat_inverse(principal)
        w_end = wp.cw_div(wp.quat_rotate_inv(q_after, momentum), inertia)
        w = wp.quat_rotate(principal, w_end)
        p = p - wp.quat_rotate(q, centre)
        v = v - wp.quat_rotate(q, wp.cross(w, centre))
    store_free(p, q, v, w, qa, va, qpos, qvel, rest)
