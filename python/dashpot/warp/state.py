"""What a step keeps per world: rows of contacts and constraints, their memory, flags.

Arrays are world-major. A *group* is what obeys one law together: a contact with up to ``dim`` rows
(normal, two sliding, torsion, two rolling), or a single limit, equality or dry-friction row.
"""

import warp as wp

# Kinds of groups, as RowKind in cpp/include/dashpot/rows/rows.hpp.
CONTACT = 0
UNILATERAL = 1
BILATERAL = 2
SLIDER = 3

OF_SITES = 6  # mjOBJ_SITE: an equality that joins sites, not bodies


@wp.struct
class Rows:
    """Groups of the step that is being taken, by (world, group) or (world, row, group).

    Jacobians are kept by the trees that a group joins: row i, side s and dof j of the tree at
    ``(i sides + s) width + j``.
    """

    dims: int  # rows of a group, at most
    sides: int  # trees of a group, at most
    width: int  # dofs of a tree, at most
    count: wp.array(dtype=wp.int32)  # groups of a world
    raw: wp.array2d(dtype=wp.int32)  # contact, or -1 - efc row, in the order they were found
    source: wp.array2d(dtype=wp.int32)  # the same, sorted
    kind: wp.array2d(dtype=wp.int32)
    dim: wp.array2d(dtype=wp.int32)
    key: wp.array2d(dtype=wp.vec3i)  # geoms, or constraint and id; and which of them
    match: wp.array2d(dtype=wp.int32)  # remembered group that it goes on from, or -1
    wanted: wp.array2d(dtype=wp.int32)
    touch: wp.array2d(dtype=wp.int32)  # 1 where it may act within the step
    distance: wp.array2d(dtype=wp.float32)  # to the remembered point, m^2
    local1: wp.array2d(dtype=wp.vec3)  # point in the frames of both geoms, m
    local2: wp.array2d(dtype=wp.vec3)
    gap: wp.array2d(dtype=wp.float32)  # at the start of the step, m or rad
    limit: wp.array2d(dtype=wp.float32)  # of a slider, N or N m; infinite for equalities
    unstressed: wp.array2d(dtype=wp.float32)  # deformation minus gap, m; below 0 it is preload
    bearable: wp.array2d(dtype=wp.float32)  # compression under which that recovers, m
    noise: wp.array2d(dtype=wp.float32)  # what collision does not know of a gap, m
    energy_tank: wp.array2d(dtype=wp.float32)  # what rising stiffness took from these springs, J
    pair_w: wp.array2d(dtype=wp.float32)  # mean inverse mass of the normals of two bodies, 1/kg
    own_bound: wp.array3d(dtype=wp.float32)  # (world, 3, group): of stiffness, normals, friction
    bound: wp.array3d(dtype=wp.float32)  # the largest of contacts of the same two bodies
    turning: wp.array3d(dtype=wp.float32)  # dJ/dt v, m/s^2
    drive: wp.array3d(dtype=wp.float32)  # part of u by surfaces of mocap bodies
    u: wp.array3d(dtype=wp.float32)  # rates, of the geometry of the middle
    c: wp.array3d(dtype=wp.float32)  # J a
    w: wp.array3d(dtype=wp.float32)  # apparent inverse mass
    k: wp.array3d(dtype=wp.float32)
    d: wp.array3d(dtype=wp.float32)
    mu: wp.array3d(dtype=wp.float32)  # friction coefficients, rows 1 and on
    x: wp.array3d(dtype=wp.float32)  # deformation
    rest: wp.array3d(dtype=wp.float32)  # what x cannot hold of it
    force: wp.array3d(dtype=wp.float32)  # exchanged in a micro-step
    impulse: wp.array3d(dtype=wp.float32)  # exchanged in a micro-step, N s
    total: wp.array3d(dtype=wp.float32)  # impulse of the step, N s
    moment: wp.array3d(dtype=wp.float32)  # of the impulses about the end of the step, N s^2
    moved: wp.array3d(dtype=wp.float32)  # displacement that springs have followed
    sticks: wp.array2d(dtype=wp.int32)
    tree: wp.array3d(dtype=wp.int32)  # (world, side, group), -1 for none
    members: wp.array2d(dtype=wp.int32)  # group * sides + side, of one tree after another
    J: wp.array3d(dtype=wp.float32)  # (world, (row, side, dof), group)
    Y: wp.array3d(dtype=wp.float32)  # J inv(L'), likewise
    A: wp.array4d(dtype=wp.float32)  # (world, group * dims + row of the other, row, group)
    # What micro-steps keep between barriers where registers do not hold it:
    surface: wp.array2d(dtype=wp.float32)  # rate of unstressed penetration that recovers, m/s
    e: wp.array3d(dtype=wp.float32)  # (world, 4 row + n - 1, group): E_n of a micro-step
    slip: wp.array3d(dtype=wp.float32)
    fade: wp.array3d(dtype=wp.float32)  # of slipping springs in a micro-step
    way: wp.array3d(dtype=wp.float32)  # in a micro-step, but for what others change of it


@wp.struct
class Memory:
    """What groups remember from step to step, by (world, group): forces, not deformations.

    In double precision: what creeps by less than an ulp of them in a step must not be lost.
    """

    steps: wp.array(dtype=wp.int32)  # 1 after the first one
    count: wp.array(dtype=wp.int32)
    key: wp.array2d(dtype=wp.vec3i)
    local1: wp.array2d(dtype=wp.vec3)
    local2: wp.array2d(dtype=wp.vec3)
    force: wp.array2d(dtype=wp.float64)  # of the spring, N; k x
    stiffness: wp.array2d(dtype=wp.float32)
    preload: wp.array2d(dtype=wp.float32)  # part of the compression beyond the overlap, m
    energy_tank: wp.array2d(dtype=wp.float32)
    slide: wp.array2d(dtype=wp.vec3d)  # N, frame of geom 1
    spin: wp.array2d(dtype=wp.float64)  # N m
    roll: wp.array2d(dtype=wp.vec3d)  # N m, frame of geom 1
    friction_stiffness: wp.array2d(dtype=wp.vec3)  # sliding, torsion, rolling
    rate: wp.array2d(dtype=wp.vec3)  # m/s at the end of the step, world
    normal: wp.array2d(dtype=wp.vec3)
    point: wp.array2d(dtype=wp.vec3)
    qpos: wp.array2d(dtype=wp.float32)  # at the end of the step
    qvel: wp.array2d(dtype=wp.float32)
    rest: wp.array2d(dtype=wp.float32)  # what positions lose to rounding
    poses: wp.array2d(dtype=wp.float32)  # told to mocap bodies, position and quaternion
    behind: wp.array2d(dtype=wp.float32)  # how far they are from there, m, rad, and its rates


@wp.struct
class Work:
    """Scratch of a step, by world; and the flags that users read."""

    start: wp.array2d(dtype=wp.float32)  # velocities at the middle without this step's forces
    force: wp.array2d(dtype=wp.float32)  # smooth forces, N or N m
    a: wp.array2d(dtype=wp.float32)  # smooth acceleration
    L: wp.array2d(dtype=wp.float32)  # Cholesky factors of H by tree
    H: wp.array2d(dtype=wp.float32)  # effective inertia in the structure of M
    displacement: wp.array2d(dtype=wp.float32)
    end: wp.array2d(dtype=wp.float32)  # velocities after the forces, at the middle
    edited: wp.array2d(dtype=wp.int32)  # by tree: 1 velocities, 2 positions changed by hand
    twist: wp.array2d(dtype=wp.spatial_vector)  # of bodies at their frames: angular, linear
    blow: wp.array2d(dtype=wp.float32)  # of bodies: speed of what may hit them, m/s
    z: wp.array4d(dtype=wp.float32)  # (world, vector, row, group) of the coupling bound
    first: wp.array2d(dtype=wp.int32)  # (world, tree) of rows.members, and how many after the last
    tree_force: wp.array2d(dtype=wp.float32)  # (world, tree * width + dof): Y' F
    tree_impulse: wp.array2d(dtype=wp.float32)
    bound: wp.array2d(dtype=wp.float32)  # (world, 3): the largest of a world
    clipped: wp.array(dtype=wp.int32)  # rows whose given stiffness was lowered, in all steps
    overflow: wp.array(dtype=wp.int32)  # 1 where a world had more groups than fit
    diverged: wp.array(dtype=wp.int32)  # 1 where a world lost its numbers
