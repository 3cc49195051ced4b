"""How far geoms may come in a step, by which collision looks for contacts ahead."""

import warp as wp

from dashpot.warp.state import Work

wp.set_module_options({"enable_backward": False})

FASTER = 1.5  # than at the start, by what happens within the step
LEAST = 1.0e-5  # m


@wp.kernel
def find_twists(
    body_rootid: wp.array(dtype=wp.int32),
    xpos: wp.array2d(dtype=wp.vec3),
    subtree_com: wp.array2d(dtype=wp.vec3),
    cvel: wp.array2d(dtype=wp.spatial_vector),
    work: Work,
):
    """Angular velocity of bodies and velocity of their frames, world."""
    world, body = wp.tid()
    spin = wp.spatial_top(cvel[world, body])
    arm = xpos[world, body] - subtree_com[world, body_rootid[body]]
    linear = wp.spatial_bottom(cvel[world, body]) + wp.cross(spin, arm)
    work.twist[world, body] = wp.spatial_vector(spin, linear)


@wp.func
def reach_of(
    world: int,
    geom: int,
    T: float,
    gravity: wp.vec3,
    geom_bodyid: wp.array(dtype=wp.int32),
    geom_rbound: wp.array2d(dtype=wp.float32),
    geom_xpos: wp.array2d(dtype=wp.vec3),
    xpos: wp.array2d(dtype=wp.vec3),
    work: Work,
) -> float:
    """How far a geom may come in half a step."""
    body = geom_bodyid[geom]
    if body == 0:
        return 0.0
    motion = work.twist[world, body]
    spin = wp.spatial_top(motion)
    arm = geom_xpos[world, geom] - xpos[world, body]
    linear = wp.spatial_bottom(motion) + wp.cross(spin, arm)
    radius = geom_rbound[world % geom_rbound.shape[0], geom]
    speed = wp.length(linear) + wp.length(spin) * radius
    return 0.5 * FASTER * T * (speed + T * wp.length(gravity)) + LEAST


@wp.kernel
def widen_geoms(
    timestep: wp.array(dtype=wp.float32),
    gravity: wp.array(dtype=wp.vec3),
    geom_bodyid: wp.array(dtype=wp.int32),
    geom_rbound: wp.array2d(dtype=wp.float32),
    geom_xpos: wp.array2d(dtype=wp.vec3),
    xpos: wp.array2d(dtype=wp.vec3),
    own: wp.array2d(dtype=wp.float32),
    work: Work,
    out: wp.array2d(dtype=wp.float32),
):
    """Margins of geoms in this step."""
    world, geom = wp.tid()
    T = timestep[world % timestep.shape[0]]
    out[world, geom] = own[world % own.shape[0], geom] + reach_of(
        world,
        geom,
        T,
        gravity[world % gravity.shape[0]],
        geom_bodyid,
        geom_rbound,
        geom_xpos,
        xpos,
        work,
    )


@wp.kernel
def widen_pairs(
    pairs: wp.array(dtype=wp.vec2i),
    own: wp.array2d(dtype=wp.float32),
    geom_own: wp.array2d(dtype=wp.float32),
    geom_margin: wp.array2d(dtype=wp.float32),
    out: wp.array2d(dtype=wp.float32),
):
    """Margins of explicit pairs in this step."""
    world, pair = wp.tid()
    a = pairs[pair][0]
    b = pairs[pair][1]
    at = world % geom_own.shape[0]
    ahead = geom_margin[world, a] - geom_own[at, a] + geom_margin[world, b] - geom_own[at, b]
    out[world, pair] = own[world % own.shape[0], pair] + ahead


@wp.kernel
def own_margins(
    nacon: wp.array(dtype=wp.int32),
    pairs: wp.array(dtype=wp.vec2i),
    pair_own: wp.array2d(dtype=wp.float32),
    geom_own: wp.array2d(dtype=wp.float32),
    worldid: wp.array(dtype=wp.int32),
    geom: wp.array(dtype=wp.vec2i),
    out: wp.array(dtype=wp.float32),
):
    """Margins that the model gives contacts; thread per contact."""
    contact = wp.tid()
    if contact >= nacon[0]:
        return
    world = worldid[contact]
    a = geom[contact][0]
    b = geom[contact][1]
    at = world % geom_own.shape[0]
    margin = geom_own[at, a] + geom_own[at, b]
    for i in range(pairs.shape[0]):
        pair = pairs[i]
        if (pair[0] == a and pair[1] == b) or (pair[0] == b and pair[1] == a):
            margin = pair_own[world % pair_own.shape[0], i]
    out[contact] = margin
