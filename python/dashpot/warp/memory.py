"""Which remembered group each group of a step goes on from, and what is remembered of it.

The nearest one of the same geoms has it, seen from either; of those that are nearest to the same
one the nearest, as in ``cpp/include/dashpot/islands/contact_matching.hpp``. Limits and constraints
go on from themselves. Springs are kept as forces, along the surface in the frame of the first geom:
nothing cancels, and stiffness may change from step to step.
"""

import warp as wp

from dashpot.warp.rows import rate_of
from dashpot.warp.state import CONTACT, Memory, Rows, Work

wp.set_module_options({"enable_backward": False})

vec6d = wp.types.vector(6, wp.float64)

NONE = -1
CONTESTED = -2


@wp.kernel
def find_edits(
    jnt_type: wp.array(dtype=wp.int32),
    jnt_qposadr: wp.array(dtype=wp.int32),
    jnt_dofadr: wp.array(dtype=wp.int32),
    dof_tree: wp.array(dtype=wp.int32),
    qpos: wp.array2d(dtype=wp.float32),
    qvel: wp.array2d(dtype=wp.float32),
    memory: Memory,
    work: Work,
):
    """Trees that were moved by hand since the last step; thread per joint."""
    world, joint = wp.tid()
    kind = jnt_type[joint]
    qa = jnt_qposadr[joint]
    va = jnt_dofadr[joint]
    nq_of = int(1)
    nv_of = int(1)
    if kind == 0:
        nq_of = 7
        nv_of = 6
    if kind == 1:
        nq_of = 4
        nv_of = 3
    edit = int(0)
    for i in range(nv_of):
        if qvel[world, va + i] != memory.qvel[world, va + i]:
            edit = 1
    for i in range(nq_of):
        if qpos[world, qa + i] != memory.qpos[world, qa + i]:
            edit = 2
    if edit > 0:
        wp.atomic_max(work.edited, world, dof_tree[va], edit)
    if edit > 1:
        for i in range(nq_of):
            memory.rest[world, qa + i] = 0.0


@wp.func
def edit_of(world: int, key: wp.vec3i, geom_tree: wp.array(dtype=wp.int32), work: Work) -> int:
    """Return what was changed by hand of the trees of two geoms: 1 velocities, 2 positions."""
    edit = int(0)
    for side in range(2):
        tree = geom_tree[key[side]]
        if tree >= 0:
            edit = wp.max(edit, work.edited[world, tree])
    return edit


@wp.func
def to_geom(
    world: int,
    geom: int,
    point: wp.vec3,
    geom_xpos: wp.array2d(dtype=wp.vec3),
    geom_xmat: wp.array2d(dtype=wp.mat33),
) -> wp.vec3:
    """Return a point in the frame of a geom (m)."""
    return wp.transpose(geom_xmat[world, geom]) @ (point - geom_xpos[world, geom])


@wp.func
def axis_of(frame: wp.mat33, i: int) -> wp.vec3:
    """Return a row of a contact's frame: the normal, or a tangent."""
    return wp.vec3(frame[i, 0], frame[i, 1], frame[i, 2])


@wp.func
def square_distance(world: int, g: int, old: int, rows: Rows, memory: Memory) -> float:
    """From a contact to a remembered one of its geoms, by the frame in which it is less (m^2)."""
    first = rows.local1[world, g] - memory.local1[world, old]
    second = rows.local2[world, g] - memory.local2[world, old]
    return wp.min(wp.dot(first, first), wp.dot(second, second))


@wp.func
def first_of(world: int, key: wp.vec3i, memory: Memory) -> int:
    """Return where what two geoms remember begins, in the order of keys."""
    low = int(0)
    high = int(memory.count[world])
    while low < high:
        middle = (low + high) / 2
        known = memory.key[world, middle]
        if known[0] < key[0] or (known[0] == key[0] and known[1] < key[1]):
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def is_same(a: wp.vec3i, b: wp.vec3i) -> bool:
    """Whether two keys have the same geoms."""
    return a[0] == b[0] and a[1] == b[1]


@wp.kernel
def find_nearest(
    geom_tree: wp.array(dtype=wp.int32),
    geom_xpos: wp.array2d(dtype=wp.vec3),
    geom_xmat: wp.array2d(dtype=wp.mat33),
    contact_pos: wp.array(dtype=wp.vec3),
    rows: Rows,
    memory: Memory,
    work: Work,
):
    """First choice of every group; thread per group."""
    world, g = wp.tid()
    if g >= rows.count[world]:
        return
    key = rows.key[world, g]
    rows.wanted[world, g] = int(NONE)
    rows.match[world, g] = int(NONE)
    if rows.kind[world, g] != int(CONTACT):
        for old in range(memory.count[world]):
            if memory.key[world, old] == key:
                rows.match[world, g] = old
        return
    point = contact_pos[rows.source[world, g]]
    rows.local1[world, g] = to_geom(world, key[0], point, geom_xpos, geom_xmat)
    rows.local2[world, g] = to_geom(world, key[1], point, geom_xpos, geom_xmat)
    if edit_of(world, key, geom_tree, work) == 2:
        return
    best = float(wp.inf)
    old = first_of(world, key, memory)
    while old < memory.count[world] and is_same(memory.key[world, old], key):
        distance = square_distance(world, g, old, rows, memory)
        if distance < best:
            best = distance
            rows.wanted[world, g] = old
        old += 1
    rows.distance[world, g] = best


@wp.kernel
def settle_contests(rows: Rows):
    """Of those that want the same the nearest has it; thread per group."""
    world, g = wp.tid()
    if g >= rows.count[world]:
        return
    wanted = rows.wanted[world, g]
    if wanted < 0:
        return
    mine = rows.distance[world, g]
    key = rows.key[world, g]
    # Only those of the same geoms do, which lie beside each other.
    other = int(g)
    while other > 0 and is_same(rows.key[world, other - 1], key):
        other -= 1
    while other < rows.count[world] and is_same(rows.key[world, other], key):
        if other != g and rows.wanted[world, other] == wanted:
            theirs = rows.distance[world, other]
            if theirs < mine or (theirs == mine and other < g):
                rows.match[world, g] = int(CONTESTED)
                return
        other += 1
    rows.match[world, g] = wanted


@wp.kernel
def choose_again(rows: Rows, memory: Memory):
    """Those that lost have the nearest that is left; thread per group of one world in turn."""
    world = wp.tid()
    count = rows.count[world]
    for g in range(count):
        if rows.match[world, g] == int(CONTESTED):
            key = rows.key[world, g]
            best = float(wp.inf)
            choice = int(NONE)
            old = first_of(world, key, memory)
            while old < memory.count[world] and is_same(memory.key[world, old], key):
                distance = square_distance(world, g, old, rows, memory)
                free = bool(distance < best)
                other = int(0)
                while free and other < count:
                    free = rows.match[world, other] != old
                    other += 1
                if free:
                    best = distance
                    choice = old
                old += 1
            rows.match[world, g] = choice


@wp.kernel
def remember(
    timestep: wp.array(dtype=wp.float32),
    tree_dofadr: wp.array(dtype=wp.int32),
    tree_dofnum: wp.array(dtype=wp.int32),
    geom_xmat: wp.array2d(dtype=wp.mat33),
    contact_pos: wp.array(dtype=wp.vec3),
    contact_frame: wp.array(dtype=wp.mat33),
    rows: Rows,
    memory: Memory,
    work: Work,
):
    """Springs follow what the bodies did in the end, and are kept; thread per group."""
    world, g = wp.tid()
    if g == 0:
        memory.count[world] = rows.count[world]
        memory.steps[world] = 1
    if g >= rows.count[world]:
        return
    kind = rows.kind[world, g]
    dim = rows.dim[world, g]
    sticks = rows.sticks[world, g]
    rate = wp.vec3(0.0, 0.0, 0.0)
    forces = vec6d()  # k x
    for i in range(dim):
        way = rate_of(world, i, g, tree_dofadr, tree_dofnum, work.displacement, rows)
        u = rate_of(world, i, g, tree_dofadr, tree_dofnum, work.end, rows)
        drive = wp.float64(rows.drive[world, i, g])
        way += drive * wp.float64(timestep[world % timestep.shape[0]])
        u += drive
        if i < 3:
            rate[i] = wp.float32(u)
        x = wp.float64(rows.x[world, i, g])
        if sticks == 1 or (i == 0 and kind <= 1):
            x += wp.float64(rows.rest[world, i, g]) + way
        else:
            x += wp.float64(rows.moved[world, i, g])
        forces[i] = wp.float64(rows.k[world, i, g]) * x
    memory.key[world, g] = rows.key[world, g]
    memory.local1[world, g] = rows.local1[world, g]
    memory.local2[world, g] = rows.local2[world, g]
    memory.stiffness[world, g] = rows.k[world, 0, g]
    memory.energy_tank[world, g] = rows.energy_tank[world, g]
    pressed = bool(kind > 1 or forces[0] < wp.float64(0.0))
    memory.force[world, g] = wp.where(pressed, -forces[0], wp.float64(0.0))
    memory.preload[world, g] = wp.where(pressed, wp.max(0.0, -rows.unstressed[world, g]), 0.0)
    if kind != int(CONTACT):
        memory.rate[world, g] = wp.vec3(rate[0] - rows.drive[world, 0, g], 0.0, 0.0)
        return
    frame = contact_frame[rows.source[world, g]]
    memory.normal[world, g] = axis_of(frame, 0)
    memory.point[world, g] = contact_pos[rows.source[world, g]]
    memory.rate[world, g] = wp.transpose(frame) @ rate
    # The inverse proper: what does not turn must not lose by rounding of the frame.
    to_local = wp.inverse(wp.mat33d(geom_xmat[world, rows.key[world, g][0]]))
    along1 = wp.vec3d(axis_of(frame, 1))
    along2 = wp.vec3d(axis_of(frame, 2))
    slide = wp.vec3d()
    roll = wp.vec3d()
    spin = wp.float64(0.0)
    stiffness = wp.vec3(0.0, 0.0, 0.0)
    if dim > 2:
        slide = to_local @ (forces[1] * along1 + forces[2] * along2)
        stiffness[0] = wp.max(rows.k[world, 1, g], rows.k[world, 2, g])
    if dim > 3:
        spin = forces[3]
        stiffness[1] = rows.k[world, 3, g]
    if dim > 5:
        roll = to_local @ (forces[4] * along1 + forces[5] * along2)
        stiffness[2] = wp.max(rows.k[world, 4, g], rows.k[world, 5, g])
    memory.slide[world, g] = slide
    memory.spin[world, g] = spin
    memory.roll[world, g] = roll
    memory.friction_stiffness[world, g] = stiffness


@wp.kernel
def remember_state(
    nq: int,
    nv: int,
    qpos: wp.array2d(dtype=wp.float32),
    qvel: wp.array2d(dtype=wp.float32),
    overflow: wp.array(dtype=wp.int32),
    memory: Memory,
    work: Work,
):
    """Positions and velocities at the end of the step; thread per number."""
    world, i = wp.tid()
    if i == 0 and overflow[world] != 0:
        work.overflow[world] = 1
    if i < nq:
        memory.qpos[world, i] = qpos[world, i]
        if not wp.isfinite(qpos[world, i]):
            work.diverged[world] = 1
    if i < nv:
        memory.qvel[world, i] = qvel[world, i]
        if not wp.isfinite(qvel[world, i]):
            work.diverged[world] = 1


@wp.kernel
def forget(reset: wp.array(dtype=wp.bool), use_mask: bool, nq: int, memory: Memory, work: Work):
    """Clear the memory and the flags of worlds; thread per world."""
    world = wp.tid()
    if use_mask and not reset[world]:
        return
    memory.count[world] = 0
    memory.steps[world] = 0
    work.diverged[world] = 0
    work.overflow[world] = 0
    work.clipped[world] = 0
    for i in range(nq):
        memory.rest[world, i] = 0.0
