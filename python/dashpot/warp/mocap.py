"""Bodies that users move: they go from where they were to where they are told, within the step.

What they touch meets a surface that moves at ``(pose told - pose before) / T``, frozen half way,
not one that jumps. Poses farther away than a body may come in a step are jumps, without velocity.

A body that a connect or weld holds something to follows where it is told to be, critically damped,
as in ``cpp/include/dashpot/model/mocap_motion.hpp``: with x its offset from there,

    c = x' + x / tau ,  x(T) = (x + c T) exp(-T/tau) ,  x'(T) = (x' - c T / tau) exp(-T/tau) .
"""

import warp as wp

from dashpot.warp.memory import axis_of
from dashpot.warp.state import BILATERAL, CONTACT, OF_SITES, Memory, Rows, Work

wp.set_module_options({"enable_backward": False})

FARTHEST = 0.5  # m in a step; what goes farther jumps
MOST_TURN = 1.0  # rad in a step
ARRIVED = 1.0e-9  # m or rad, m/s or rad/s
WELD = 1  # mjEQ_WELD; a connect is 0

vec12 = wp.types.vector(12, wp.float32)


@wp.func
def position_of(world: int, body: int, poses: wp.array2d(dtype=wp.float32)) -> wp.vec3:
    """Return where a kept pose is."""
    at = 7 * body
    return wp.vec3(poses[world, at], poses[world, at + 1], poses[world, at + 2])


@wp.func
def quaternion_of(world: int, body: int, poses: wp.array2d(dtype=wp.float32)) -> wp.quat:
    """Return how a kept pose is turned, in MuJoCo's order, w first."""
    at = 7 * body + 3
    return wp.quat(
        poses[world, at], poses[world, at + 1], poses[world, at + 2], poses[world, at + 3]
    )


@wp.func
def w_last(q: wp.quat) -> wp.quat:
    """From MuJoCo's order to Warp's."""
    return wp.quat(q[1], q[2], q[3], q[0])


@wp.func
def w_first(q: wp.quat) -> wp.quat:
    """From Warp's order to MuJoCo's."""
    return wp.quat(q[3], q[0], q[1], q[2])


@wp.func
def rotation_vector(turn_in: wp.quat) -> wp.vec3:
    """Return the shorter rotation of a quaternion, rad."""
    turn = turn_in
    if turn[3] < 0.0:
        turn = -turn
    axis = wp.vec3(turn[0], turn[1], turn[2])
    sine = wp.length(axis)
    if sine == 0.0:
        return wp.vec3(0.0, 0.0, 0.0)
    return axis * (2.0 * wp.atan2(sine, turn[3]) / sine)


@wp.func
def turned_by(angle: wp.vec3) -> wp.quat:
    """Return the rotation by a vector, rad."""
    size = wp.length(angle)
    if size == 0.0:
        return wp.quat(0.0, 0.0, 0.0, 1.0)
    return wp.quat_from_axis_angle(angle / size, size)


@wp.func
def is_held(
    world: int,
    body: int,
    eq_mocap: wp.array(dtype=wp.vec2i),
    eq_active: wp.array2d(dtype=wp.bool),
) -> bool:
    """Whether an active connect or weld holds something to a mocap body."""
    for i in range(eq_mocap.shape[0]):
        if eq_active[world, i] and (eq_mocap[i][0] == body or eq_mocap[i][1] == body):
            return True
    return False


@wp.func
def follow(x: wp.vec3, rate: wp.vec3, tau: float, T: float):
    """Offset and its rate after a step."""
    if tau == 0.0:
        return wp.vec3(0.0, 0.0, 0.0), wp.vec3(0.0, 0.0, 0.0)
    c = rate + x / tau
    decay = wp.exp(-T / tau)
    x_end = (x + c * T) * decay
    rate_end = (rate - c * (T / tau)) * decay
    if wp.length(x_end) + wp.length(rate_end) < ARRIVED:
        return wp.vec3(0.0, 0.0, 0.0), wp.vec3(0.0, 0.0, 0.0)
    return x_end, rate_end


@wp.func
def vector_at(world: int, at: int, values: wp.array2d(dtype=wp.float32)) -> wp.vec3:
    """Return three numbers that are kept."""
    return wp.vec3(values[world, at], values[world, at + 1], values[world, at + 2])


@wp.kernel
def move_to_middle(
    timestep: wp.array(dtype=wp.float32),
    part: float,
    time_constant: wp.array(dtype=wp.float32),
    eq_mocap: wp.array(dtype=wp.vec2i),
    eq_active: wp.array2d(dtype=wp.bool),
    position: wp.array2d(dtype=wp.vec3),
    quaternion: wp.array2d(dtype=wp.quat),
    memory: Memory,
    told: wp.array2d(dtype=wp.float32),
    behind: wp.array2d(dtype=wp.float32),
    motion: wp.array2d(dtype=wp.spatial_vector),
):
    """Pose of the middle, and velocities; thread per mocap body."""
    world, body = wp.tid()
    T = timestep[world % timestep.shape[0]]
    p = position[world, body]
    q = quaternion[world, body]
    at = 7 * body
    for i in range(3):
        told[world, at + i] = p[i]
    for i in range(4):
        told[world, at + 3 + i] = q[i]
    at = 12 * body
    x_before = vector_at(world, at, memory.behind)
    angle_before = vector_at(world, at + 3, memory.behind)
    turn0 = turned_by(angle_before) * w_last(quaternion_of(world, body, memory.poses))
    before = position_of(world, body, memory.poses) + x_before
    turn1 = wp.normalize(w_last(q))
    way = p - before
    change = turn1 * wp.quat_inverse(turn0)
    if change[3] < 0.0:
        change = -change
    spin = rotation_vector(change)
    for i in range(12):
        behind[world, at + i] = 0.0
    if memory.steps[world] == 0:
        motion[world, body] = wp.spatial_vector()
        return
    if is_held(world, body, eq_mocap, eq_active):
        tau = time_constant[world % time_constant.shape[0]]
        rate = vector_at(world, at + 6, memory.behind)
        x, rate = follow(x_before + (position_of(world, body, memory.poses) - p), rate, tau, T)
        spin_rate = vector_at(world, at + 9, memory.behind)
        angle, spin_rate = follow(-spin, spin_rate, tau, T)
        for i in range(3):
            behind[world, at + i] = x[i]
            behind[world, at + 3 + i] = angle[i]
            behind[world, at + 6 + i] = rate[i]
            behind[world, at + 9 + i] = spin_rate[i]
        way = way + x
        change = turned_by(angle) * change
        spin = rotation_vector(change)
    elif wp.length(way) > FARTHEST or wp.length(spin) > MOST_TURN:
        motion[world, body] = wp.spatial_vector()
        return
    motion[world, body] = wp.spatial_vector(spin / T, way / T)
    position[world, body] = before + part * way
    middle = wp.normalize(wp.quat_slerp(turn0, change * turn0, part))
    quaternion[world, body] = w_first(middle)


@wp.func
def carried(
    world: int,
    body: int,
    point: wp.vec3,
    body_mocap: wp.array(dtype=wp.int32),
    mocap_body: wp.array(dtype=wp.int32),
    xpos: wp.array2d(dtype=wp.vec3),
    motion: wp.array2d(dtype=wp.spatial_vector),
) -> wp.spatial_vector:
    """Velocities at which a mocap body takes a point of a body along."""
    mocap = body_mocap[body]
    if mocap < 0:
        return wp.spatial_vector()
    spin = wp.spatial_top(motion[world, mocap])
    arm = point - xpos[world, mocap_body[mocap]]
    return wp.spatial_vector(spin, wp.spatial_bottom(motion[world, mocap]) + wp.cross(spin, arm))


@wp.kernel
def give_twists(
    body_mocap: wp.array(dtype=wp.int32),
    mocap_body: wp.array(dtype=wp.int32),
    xpos: wp.array2d(dtype=wp.vec3),
    motion: wp.array2d(dtype=wp.spatial_vector),
    work: Work,
):
    """Velocities of what mocap bodies take along; thread per body."""
    world, body = wp.tid()
    more = carried(world, body, xpos[world, body], body_mocap, mocap_body, xpos, motion)
    work.twist[world, body] = work.twist[world, body] + more


@wp.kernel
def drive_contacts(
    ahead: float,
    timestep: wp.array(dtype=wp.float32),
    geom_bodyid: wp.array(dtype=wp.int32),
    body_mocap: wp.array(dtype=wp.int32),
    mocap_body: wp.array(dtype=wp.int32),
    xpos: wp.array2d(dtype=wp.vec3),
    motion: wp.array2d(dtype=wp.spatial_vector),
    contact_pos: wp.array(dtype=wp.vec3),
    contact_frame: wp.array(dtype=wp.mat33),
    rows: Rows,
):
    """Add what surfaces of mocap bodies move at to the rates of contacts; thread per group."""
    world, g = wp.tid()
    if g >= rows.count[world]:
        return
    for i in range(rows.dim[world, g]):
        rows.drive[world, i, g] = 0.0
    if rows.kind[world, g] != int(CONTACT):
        return
    source = rows.source[world, g]
    point = contact_pos[source]
    rates = wp.spatial_vector()
    sign = float(-1.0)
    for side in range(2):
        body = geom_bodyid[rows.key[world, g][side]]
        rates += sign * carried(world, body, point, body_mocap, mocap_body, xpos, motion)
        sign = 1.0
    frame = contact_frame[source]
    for i in range(rows.dim[world, g]):
        along = i
        rate = wp.spatial_bottom(rates)
        if i > 2:
            along = i - 3
            rate = wp.spatial_top(rates)
        add_drive(ahead, timestep, world, i, g, wp.dot(axis_of(frame, along), rate), rows)


@wp.func
def add_drive(
    ahead: float,
    timestep: wp.array(dtype=wp.float32),
    world: int,
    i: int,
    g: int,
    drive: float,
    rows: Rows,
):
    """Let a row see a velocity, from the start of the step on."""
    rows.drive[world, i, g] = drive
    rows.u[world, i, g] = rows.u[world, i, g] + drive
    if i == 0:
        time = ahead * timestep[world % timestep.shape[0]]
        rows.gap[world, g] = rows.gap[world, g] - time * drive


@wp.kernel
def drive_equalities(
    ahead: float,
    timestep: wp.array(dtype=wp.float32),
    body_mocap: wp.array(dtype=wp.int32),
    mocap_body: wp.array(dtype=wp.int32),
    xpos: wp.array2d(dtype=wp.vec3),
    xquat: wp.array2d(dtype=wp.quat),
    motion: wp.array2d(dtype=wp.spatial_vector),
    site_bodyid: wp.array(dtype=wp.int32),
    site_xpos: wp.array2d(dtype=wp.vec3),
    site_quat: wp.array2d(dtype=wp.quat),
    eq_type: wp.array(dtype=wp.int32),
    eq_objtype: wp.array(dtype=wp.int32),
    eq_obj1id: wp.array(dtype=wp.int32),
    eq_obj2id: wp.array(dtype=wp.int32),
    eq_data: wp.array2d(dtype=vec12),
    rows: Rows,
):
    """Add what mocap bodies move at to the rates of connects and welds; thread per group."""
    world, g = wp.tid()
    if g >= rows.count[world] or rows.kind[world, g] != int(BILATERAL):
        return
    index = rows.key[world, g][1]
    if eq_type[index] > int(WELD):
        return
    data = eq_data[world % eq_data.shape[0], index]
    is_weld = eq_type[index] == int(WELD)
    rates = wp.spatial_vector()
    quats = wp.matrix(0.0, shape=(2, 4))
    sign = float(1.0)
    for side in range(2):
        which = eq_obj1id[index]
        if side == 1:
            which = eq_obj2id[index]
        body = which
        point = wp.vec3(0.0, 0.0, 0.0)
        turn = wp.quat(0.0, 0.0, 0.0, 1.0)
        if eq_objtype[index] == int(OF_SITES):
            body = site_bodyid[which]
            point = site_xpos[world, which]
            turn = w_last(site_quat[world % site_quat.shape[0], which])
            turn = w_last(xquat[world, body]) * turn
        else:
            # A weld keeps the anchor of its second body first.
            at = 3 * side
            if is_weld:
                at = 3 - at
            turn = w_last(xquat[world, body])
            anchor = wp.vec3(data[at], data[at + 1], data[at + 2])
            point = xpos[world, body] + wp.quat_rotate(turn, anchor)
            if is_weld and side == 0:
                turn = turn * wp.quat(data[7], data[8], data[9], data[6])
        for n in range(4):
            quats[side, n] = turn[n]
        rates += sign * carried(world, body, point, body_mocap, mocap_body, xpos, motion)
        sign = -1.0
    i = rows.key[world, g][2]
    if i < 3:
        add_drive(ahead, timestep, world, 0, g, wp.spatial_bottom(rates)[i], rows)
        return
    # The error is torquescale times the vector part of conj(q2) q1.
    spin = wp.spatial_top(rates)
    first = wp.quat(quats[0, 0], quats[0, 1], quats[0, 2], quats[0, 3])
    second = wp.quat(quats[1, 0], quats[1, 1], quats[1, 2], quats[1, 3])
    change = wp.quat_inverse(second) * wp.quat(spin[0], spin[1], spin[2], 0.0) * first
    add_drive(ahead, timestep, world, 0, g, 0.5 * data[10] * change[i - 3], rows)


@wp.kernel
def put_where_told(
    told: wp.array2d(dtype=wp.float32),
    behind: wp.array2d(dtype=wp.float32),
    position: wp.array2d(dtype=wp.vec3),
    quaternion: wp.array2d(dtype=wp.quat),
    memory: Memory,
):
    """Leave bodies where users put them, and remember that; thread per mocap body."""
    world, body = wp.tid()
    at = 7 * body
    for i in range(7):
        memory.poses[world, at + i] = told[world, at + i]
    for i in range(12):
        memory.behind[world, 12 * body + i] = behind[world, 12 * body + i]
    position[world, body] = position_of(world, body, told)
    quaternion[world, body] = quaternion_of(world, body, told)
