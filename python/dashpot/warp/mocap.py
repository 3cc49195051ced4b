"""Bodies that users move: they go from where they were to where they are told, within the step.

What they touch meets a surface that moves at ``(pose told - pose before) / T``, frozen half way,
not one that jumps. Poses farther away than a body may come in a step are jumps, without velocity.
"""

import warp as wp

from dashpot.warp.memory import axis_of
from dashpot.warp.state import CONTACT, Memory, Rows, Work

wp.set_module_options({"enable_backward": False})

FARTHEST = 0.5  # m in a step; what goes farther jumps
MOST_TURN = 1.0  # rad in a step


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


@wp.kernel
def move_to_middle(
    timestep: wp.array(dtype=wp.float32),
    part: float,
    position: wp.array2d(dtype=wp.vec3),
    quaternion: wp.array2d(dtype=wp.quat),
    memory: Memory,
    told: wp.array2d(dtype=wp.float32),
    motion: wp.array2d(dtype=wp.spatial_vector),
):
    """Pose of the middle, and velocities; thread per mocap body."""
    world, body = wp.tid()
    T = timestep[world % timestep.shape[0]]
    p = position[world, body]
    q = quaternion[world, body]
    at = 7 * body
    before = position_of(world, body, memory.poses)
    turn0 = w_last(quaternion_of(world, body, memory.poses))
    turn1 = wp.normalize(w_last(q))
    for i in range(3):
        told[world, at + i] = p[i]
    for i in range(4):
        told[world, at + 3 + i] = q[i]
    change = turn1 * wp.quat_inverse(turn0)
    if change[3] < 0.0:
        change = -change
    axis = wp.vec3(change[0], change[1], change[2])
    sine = wp.length(axis)
    angle = 2.0 * wp.atan2(sine, change[3])
    way = p - before
    jumps = wp.length(way) > FARTHEST or angle > MOST_TURN
    if memory.steps[world] == 0 or jumps:
        motion[world, body] = wp.spatial_vector()
        return
    spin = wp.vec3(0.0, 0.0, 0.0)
    if sine > 0.0:
        spin = axis * (angle / sine / T)
    motion[world, body] = wp.spatial_vector(spin, way / T)
    position[world, body] = before + part * way
    middle = wp.normalize(wp.quat_slerp(turn0, change * turn0, part))
    quaternion[world, body] = w_first(middle)


@wp.kernel
def give_twists(
    body_mocap: wp.array(dtype=wp.int32),
    mocap_body: wp.array(dtype=wp.int32),
    xpos: wp.array2d(dtype=wp.vec3),
    motion: wp.array2d(dtype=wp.spatial_vector),
    work: Work,
):
    """Velocities of what is fixed to mocap bodies; thread per body."""
    world, body = wp.tid()
    mocap = body_mocap[body]
    if mocap < 0:
        return
    spin = wp.spatial_top(motion[world, mocap])
    arm = xpos[world, body] - xpos[world, mocap_body[mocap]]
    linear = wp.spatial_bottom(motion[world, mocap]) + wp.cross(spin, arm)
    work.twist[world, body] = wp.spatial_vector(spin, linear)


@wp.kernel
def drive_rows(
    ahead: float,
    timestep: wp.array(dtype=wp.float32),
    geom_bodyid: wp.array(dtype=wp.int32),
    body_mocap: wp.array(dtype=wp.int32),
    xpos: wp.array2d(dtype=wp.vec3),
    contact_pos: wp.array(dtype=wp.vec3),
    contact_frame: wp.array(dtype=wp.mat33),
    rows: Rows,
    work: Work,
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
    spin = wp.vec3(0.0, 0.0, 0.0)
    linear = wp.vec3(0.0, 0.0, 0.0)
    sign = float(-1.0)
    for side in range(2):
        body = geom_bodyid[rows.key[world, g][side]]
        if body_mocap[body] >= 0:
            w = wp.spatial_top(work.twist[world, body])
            arm = contact_pos[source] - xpos[world, body]
            spin += sign * w
            linear += sign * (wp.spatial_bottom(work.twist[world, body]) + wp.cross(w, arm))
        sign = 1.0
    frame = contact_frame[source]
    for i in range(rows.dim[world, g]):
        along = i
        rate = linear
        if i > 2:
            along = i - 3
            rate = spin
        drive = wp.dot(axis_of(frame, along), rate)
        rows.drive[world, i, g] = drive
        rows.u[world, i, g] = rows.u[world, i, g] + drive
        if i == 0:
            rows.gap[world, g] = (
                rows.gap[world, g] - ahead * timestep[world % timestep.shape[0]] * drive
            )


@wp.kernel
def put_where_told(
    told: wp.array2d(dtype=wp.float32),
    position: wp.array2d(dtype=wp.vec3),
    quaternion: wp.array2d(dtype=wp.quat),
    memory: Memory,
):
    """Leave bodies where users put them, and remember that; thread per mocap body."""
    world, body = wp.tid()
    at = 7 * body
    for i in range(7):
        memory.poses[world, at + i] = told[world, at + i]
    position[world, body] = position_of(world, body, told)
    quaternion[world, body] = quaternion_of(world, body, told)
