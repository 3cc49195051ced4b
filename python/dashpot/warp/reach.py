"""How far geoms, joints and tendons may come in a step, by which rows are looked for ahead."""

import warp as wp

from dashpot.warp.state import Work

wp.set_module_options({"enable_backward": False})

FASTER = 1.5  # than at the start, by what happens within the step
LEAST = 1.0e-5  # m or rad
BLOW = 40.0  # m/s^2: what changes rates by more within a step is a blow,
SLOW = 0.02  # m/s, but nothing as slow as this
LIMIT_OF_JOINT = 3  # MuJoCo's type of row


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


@wp.kernel
def find_speeds(
    geom_bodyid: wp.array(dtype=wp.int32),
    geom_rbound: wp.array2d(dtype=wp.float32),
    geom_xpos: wp.array2d(dtype=wp.vec3),
    xpos: wp.array2d(dtype=wp.vec3),
    work: Work,
    speed: wp.array2d(dtype=wp.float32),
):
    """How fast some point of a geom may be (m/s); thread per geom."""
    world, geom = wp.tid()
    body = geom_bodyid[geom]
    motion = work.twist[world, body]
    spin = wp.spatial_top(motion)
    arm = geom_xpos[world, geom] - xpos[world, body]
    linear = wp.spatial_bottom(motion) + wp.cross(spin, arm)
    radius = geom_rbound[world % geom_rbound.shape[0], geom]
    speed[world, geom] = wp.where(body == 0, 0.0, wp.length(linear) + wp.length(spin) * radius)
    if geom == 0:
        for i in range(work.blow.shape[1]):
            work.blow[world, i] = 0.0


@wp.kernel
def find_blows(
    timestep: wp.array(dtype=wp.float32),
    geom_bodyid: wp.array(dtype=wp.int32),
    geom_rbound: wp.array2d(dtype=wp.float32),
    geom_xpos: wp.array2d(dtype=wp.vec3),
    speed: wp.array2d(dtype=wp.float32),
    work: Work,
):
    """How fast what may hit a body in the step is; thread per geom."""
    world, geom = wp.tid()
    body = geom_bodyid[geom]
    if body == 0:
        return
    T = timestep[world % timestep.shape[0]]
    mine = speed[world, geom]
    fastest = wp.max(mine, T * BLOW + SLOW)
    radius = geom_rbound[world % geom_rbound.shape[0], geom]
    centre = geom_xpos[world, geom]
    found = float(0.0)
    for other in range(speed.shape[1]):
        theirs = speed[world, other]
        if theirs > fastest and theirs > found and geom_bodyid[other] != body:
            room = radius + geom_rbound[world % geom_rbound.shape[0], other]
            room += FASTER * T * (theirs + mine)
            if wp.length_sq(geom_xpos[world, other] - centre) < room * room:
                found = theirs
    if found > 0.0:
        wp.atomic_max(work.blow, world, body, found)


@wp.kernel
def widen_geoms(
    timestep: wp.array(dtype=wp.float32),
    gravity: wp.array(dtype=wp.vec3),
    geom_bodyid: wp.array(dtype=wp.int32),
    own: wp.array2d(dtype=wp.float32),
    speed: wp.array2d(dtype=wp.float32),
    work: Work,
    out: wp.array2d(dtype=wp.float32),
):
    """Margins of geoms in this step."""
    world, geom = wp.tid()
    T = timestep[world % timestep.shape[0]]
    margin = own[world % own.shape[0], geom]
    body = geom_bodyid[geom]
    if body > 0:
        fall = T * wp.length(gravity[world % gravity.shape[0]])
        way = 0.5 * FASTER * T * (speed[world, geom] + fall)
        # What is hit early has nearly the whole step to go.
        margin += wp.max(way, T * work.blow[world, body]) + LEAST
    out[world, geom] = margin


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


@wp.kernel
def widen_joints(
    timestep: wp.array(dtype=wp.float32),
    jnt_type: wp.array(dtype=wp.int32),
    jnt_dofadr: wp.array(dtype=wp.int32),
    own: wp.array2d(dtype=wp.float32),
    qvel: wp.array2d(dtype=wp.float32),
    work: Work,
    out: wp.array2d(dtype=wp.float32),
):
    """Margins of the limits of joints in this step."""
    world, joint = wp.tid()
    T = timestep[world % timestep.shape[0]]
    dofs = wp.where(jnt_type[joint] == 1, 3, 1)
    speed = float(0.0)
    for i in range(dofs):
        dof = jnt_dofadr[joint] + i
        speed += wp.abs(qvel[world, dof]) + T * wp.abs(work.a[world, dof])
    out[world, joint] = own[world % own.shape[0], joint] + 0.5 * FASTER * T * speed + LEAST


@wp.kernel
def widen_tendons(
    timestep: wp.array(dtype=wp.float32),
    ten_J_rownnz: wp.array(dtype=wp.int32),
    ten_J_rowadr: wp.array(dtype=wp.int32),
    ten_J_colind: wp.array(dtype=wp.int32),
    ten_J: wp.array2d(dtype=wp.float32),
    own: wp.array2d(dtype=wp.float32),
    qvel: wp.array2d(dtype=wp.float32),
    work: Work,
    out: wp.array2d(dtype=wp.float32),
):
    """Margins of the limits of tendons in this step."""
    world, tendon = wp.tid()
    T = timestep[world % timestep.shape[0]]
    speed = float(0.0)
    for i in range(ten_J_rownnz[tendon]):
        at = ten_J_rowadr[tendon] + i
        dof = ten_J_colind[at]
        rate = wp.abs(qvel[world, dof]) + T * wp.abs(work.a[world, dof])
        speed += wp.abs(ten_J[world, at]) * rate
    out[world, tendon] = own[world % own.shape[0], tendon] + 0.5 * FASTER * T * speed + LEAST


@wp.kernel
def own_limit_margins(
    ne: wp.array(dtype=wp.int32),
    nf: wp.array(dtype=wp.int32),
    nl: wp.array(dtype=wp.int32),
    efc_type: wp.array2d(dtype=wp.int32),
    efc_id: wp.array2d(dtype=wp.int32),
    joints: wp.array2d(dtype=wp.float32),
    tendons: wp.array2d(dtype=wp.float32),
    efc_margin: wp.array2d(dtype=wp.float32),
):
    """Margins that the model gives limits; thread per row."""
    world, i = wp.tid()
    if i >= nl[world]:
        return
    row = ne[world] + nf[world] + i
    if row >= efc_margin.shape[1]:
        return
    limited = efc_id[world, row]
    if efc_type[world, row] == LIMIT_OF_JOINT:
        efc_margin[world, row] = joints[world % joints.shape[0], limited]
    else:
        efc_margin[world, row] = tendons[world % tendons.shape[0], limited]
