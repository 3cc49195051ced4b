"""What springs start from in a step, and how its geometry turns.

Springs go on from remembered forces (``cpp/include/dashpot/rows/recall.hpp``). Single precision
knows an overlap to some ulp of the coordinates, more than what rigid contacts are compressed by. A
compression that differs from the overlap by less than that goes on; of more the smaller one counts,
and the rest recovers.

Rows have the geometry of the middle of the step (``cpp/include/dashpot/detect/turning.hpp``).
The velocities of its start have the rates J v there, and had J' v in the middle of the last step,
which contacts and equalities remember. What turns between the two,

    (J v - J' v) / T ,

is a load of its own, and the rates at the start are the mean of both.
"""

import warp as wp

from dashpot.warp.memory import axis_of, edit_of
from dashpot.warp.state import BILATERAL, CONTACT, UNILATERAL, Memory, Rows, Work

wp.set_module_options({"enable_backward": False})

NOISE = 4.8e-7  # of the coordinates: 4 ulp
LEAST_SIZE = 0.25  # m, of the coordinates that noise goes by
TURNS_ON = 2.0  # times its way in a step that a contact point may have moved


@wp.func
def kept_force(
    deformation: float, old: float, k: float, w: float, speed: float, energy_tank: float
) -> wp.vec2:
    """Share of a remembered force that goes on under another stiffness; the energy tank.

    A rising stiffness takes energy, which a falling one may give back; that may add no more to it
    than what the apparent mass has at the recovery speed.
    """
    if deformation == 0.0 or old == 0.0 or k == 0.0:
        return wp.vec2(0.0, energy_tank)
    same = old / k
    stored = 0.5 * old * deformation * deformation
    scale = same
    if same > 1.0:
        allowed = same
        if w > 0.0:
            allowed = speed / (wp.sqrt(k * w) * wp.abs(deformation))
        covered = wp.sqrt(same * (1.0 + energy_tank / stored))
        scale = wp.min(same, wp.max(allowed, covered))
    left = wp.max(0.0, energy_tank - stored * (scale * scale / same - 1.0))
    return wp.vec2(scale / same, left)


@wp.func
def keep(x: wp.float64, world: int, i: int, g: int, rows: Rows):
    """Keep a deformation, and what single precision cannot hold of it."""
    high = wp.float32(x)
    rows.x[world, i, g] = high
    rows.rest[world, i, g] = wp.float32(x - wp.float64(high))


@wp.func
def noise_at(point: wp.vec3) -> float:
    """Return what collision does not know of a gap (m)."""
    size = wp.max(wp.max(wp.abs(point[0]), wp.abs(point[1])), wp.abs(point[2]))
    return NOISE * wp.max(LEAST_SIZE, size)


@wp.func
def recall_friction(
    world: int,
    g: int,
    old: int,
    speed: float,
    energy_tank_in: float,
    geom_xmat: wp.array2d(dtype=wp.mat33),
    contact_frame: wp.array(dtype=wp.mat33),
    rows: Rows,
    memory: Memory,
) -> float:
    """Deformations of friction's springs; the energy tank that is left."""
    energy_tank = energy_tank_in
    to_world = wp.mat33d(geom_xmat[world, rows.key[world, g][0]])
    frame = contact_frame[rows.source[world, g]]
    stiffnesses = memory.friction_stiffness[world, old]
    for part in range(2):
        force = memory.slide[world, old]
        ks = stiffnesses[0]
        first = int(1)
        if part == 1:
            force = memory.roll[world, old]
            ks = stiffnesses[2]
            first = 4
        if ks > 0.0 and rows.dim[world, g] > first:
            force = to_world @ force
            ki = wp.max(rows.k[world, first, g], rows.k[world, first + 1, g])
            wi = wp.max(rows.w[world, first, g], rows.w[world, first + 1, g])
            kept = kept_force(wp.float32(wp.length(force)) / ks, ks, ki, wi, speed, energy_tank)
            energy_tank = kept[1]
            # Of the force as it is, for the tangents differ a little in stiffness.
            for i in range(2):
                tangent = wp.vec3d(axis_of(frame, 1 + i))
                row = first + i
                if rows.k[world, row, g] > 0.0:
                    along = wp.dot(force, tangent) * wp.float64(kept[0])
                    keep(along / wp.float64(rows.k[world, row, g]), world, row, g, rows)
    if rows.dim[world, g] > 3 and stiffnesses[1] > 0.0 and rows.k[world, 3, g] > 0.0:
        spin = memory.spin[world, old]
        k = rows.k[world, 3, g]
        kept = kept_force(
            wp.float32(spin) / stiffnesses[1],
            stiffnesses[1],
            k,
            rows.w[world, 3, g],
            speed,
            energy_tank,
        )
        keep(spin * wp.float64(kept[0]) / wp.float64(k), world, 3, g, rows)
        energy_tank = kept[1]
    return energy_tank


@wp.kernel
def recall(
    ahead: float,
    timestep: wp.array(dtype=wp.float32),
    recovery_speed: wp.array(dtype=wp.float32),
    geom_tree: wp.array(dtype=wp.int32),
    geom_rbound: wp.array2d(dtype=wp.float32),
    geom_bodyid: wp.array(dtype=wp.int32),
    geom_xpos: wp.array2d(dtype=wp.vec3),
    geom_xmat: wp.array2d(dtype=wp.mat33),
    twist: wp.array2d(dtype=wp.spatial_vector),
    xpos: wp.array2d(dtype=wp.vec3),
    contact_pos: wp.array(dtype=wp.vec3),
    contact_frame: wp.array(dtype=wp.mat33),
    rows: Rows,
    memory: Memory,
    work: Work,
):
    """Deformations, unstressed penetrations and turning of every group; thread per group."""
    world, g = wp.tid()
    if g >= rows.count[world]:
        return
    T = timestep[world % timestep.shape[0]]
    speed = recovery_speed[world % recovery_speed.shape[0]]
    kind = rows.kind[world, g]
    old = rows.match[world, g]
    k = rows.k[world, 0, g]
    w = rows.w[world, 0, g]
    for i in range(rows.dims):
        rows.x[world, i, g] = 0.0
        rows.rest[world, i, g] = 0.0
        rows.turning[world, i, g] = 0.0
    energy_tank = float(0.0)
    noise = 2.0e-7 * (1.0 + wp.abs(rows.gap[world, g]))
    if kind == int(CONTACT):
        source = rows.source[world, g]
        noise = noise_at(contact_pos[source])
        key = rows.key[world, g]
        frame = contact_frame[source]
        if old >= 0 and ahead > 0.0:
            # The rates that the same velocities have in the geometry of the last middle.
            edited = edit_of(world, key, geom_tree, work)
            way = float(0.0)
            for side in range(2):
                geom = key[side]
                body = geom_bodyid[geom]
                motion = twist[world, body]
                spin = wp.spatial_top(motion)
                linear = wp.spatial_bottom(motion) + wp.cross(
                    spin, geom_xpos[world, geom] - xpos[world, body]
                )
                radius = geom_rbound[world % geom_rbound.shape[0], geom]
                way = wp.max(way, wp.length(linear) + wp.length(spin) * radius)
            moved = wp.length(contact_pos[source] - memory.point[world, old])
            if edited == 0 and moved <= TURNS_ON * T * way:
                rate = memory.rate[world, old]
                normal = memory.normal[world, old]
                along = wp.dot(rate, normal)
                across = rate - along * normal
                for i in range(wp.min(3, rows.dim[world, g])):
                    before = along
                    if i > 0:
                        before = wp.dot(across, axis_of(frame, i))
                    rows.turning[world, i, g] = (rows.u[world, i, g] - before) / T
    elif kind == int(BILATERAL) and old >= 0 and ahead > 0.0:
        edited = int(0)
        for side in range(rows.sides):
            tree = rows.tree[world, side, g]
            if tree >= 0:
                edited = wp.max(edited, work.edited[world, tree])
        if edited == 0:
            # Mocap bodies change their velocities in jumps.
            now = rows.u[world, 0, g] - rows.drive[world, 0, g]
            rows.turning[world, 0, g] = (now - memory.rate[world, old][0]) / T
    half = ahead * T
    turning = rows.turning[world, 0, g]
    rows.gap[world, g] = rows.gap[world, g] + 0.5 * half * half * turning
    gap = rows.gap[world, g]
    x = wp.float64(0.0)
    stiff = wp.float64(k)
    if kind > int(UNILATERAL):
        if old >= 0:
            force = memory.force[world, old]
            stiffness = memory.stiffness[world, old]
            kept = kept_force(
                wp.float32(force) / stiffness,
                stiffness,
                k,
                w,
                speed,
                memory.energy_tank[world, old],
            )
            x = -force * wp.float64(kept[0]) / stiff
            energy_tank = kept[1]
        rows.unstressed[world, g] = wp.where(kind == int(BILATERAL), wp.float32(x) - gap, 0.0)
    else:
        x = wp.float64(gap)
        is_new = old < 0
        if is_new and gap < 0.0:
            x = wp.float64(0.0)
            if memory.steps[world] == 0 and rows.bearable[world, g] < wp.inf:
                x = wp.float64(wp.max(gap, -rows.bearable[world, g]))
        if old >= 0 and gap < noise + memory.preload[world, old]:
            stiffness = memory.stiffness[world, old]
            force = memory.force[world, old]
            compression = wp.float32(force) / stiffness
            reach = memory.preload[world, old] + noise - gap
            if compression > reach:
                compression = wp.max(reach, 0.0)
                force = wp.float64(compression) * wp.float64(stiffness)
            kept = kept_force(compression, stiffness, k, w, speed, memory.energy_tank[world, old])
            x = -force * wp.float64(kept[0]) / stiff
            energy_tank = kept[1]
            if compression <= 0.0:
                x = wp.float64(wp.max(gap, 0.0))
            elif kind == int(CONTACT):
                energy_tank = recall_friction(
                    world, g, old, speed, energy_tank, geom_xmat, contact_frame, rows, memory
                )
        rows.unstressed[world, g] = wp.float32(x) - gap
    keep(x, world, 0, g, rows)
    rows.energy_tank[world, g] = energy_tank
    # Within noise nothing recovers.
    rows.noise[world, g] = noise
