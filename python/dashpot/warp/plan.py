"""Stiffness and damping of a step's rows, and what their springs start from.

Rows whose own entry of A is 1 are as stiff as micro-steps of length h resolve, as in
``cpp/include/dashpot/islands/row_stiffness.hpp``::

    kappa h^2 = min(1.5, 1 / (c - 1)),    delta_n h <= 1 / (c_n - 1),    delta_t h <= 1 / (c_t - 1)

with the bounds c of all rows, of normals and of friction (`dashpot.warp.coupling`). Stiffness in SI
units is lowered only beyond that, and counted.
"""

import warp as wp

from dashpot.warp.coupling import same_bodies
from dashpot.warp.material import Pair, pair_material, solref_rates, typical_inverse_mass
from dashpot.warp.reach import BLOW, SLOW
from dashpot.warp.state import CONTACT, SLIDER, UNILATERAL, Rows, Work

wp.set_module_options({"enable_backward": False})

STIFFEST_ALONE = 1.5
SERIES = 4.0  # w k h^2 and w d h that the law's series takes
RIGID_INELASTIC = 3.0  # damping ratio of a rigid contact with restitution 0
INELASTIC = 50.0  # the same with a stiffness
BEARABLE = 981.0  # m/s^2, a hundred weights
PUSHED = 20.0  # m/s^2, by which what is still is pressed on within a step
REACHED = 3.0  # times the way of the fastest in a step, within which others may be pressed


@wp.kernel
def find_touching(
    timestep: wp.array(dtype=wp.float32),
    geom_bodyid: wp.array(dtype=wp.int32),
    rows: Rows,
    work: Work,
):
    """Which groups may act in the step, and the mean w of the normals of two bodies."""
    world, g = wp.tid()
    if g >= rows.count[world]:
        return
    T = timestep[world % timestep.shape[0]]
    kind = rows.kind[world, g]
    u = rows.u[world, 0, g]
    touch = int(1)
    if kind <= int(UNILATERAL):
        closing = wp.min(0.0, wp.min(u, u + T * rows.c[world, 0, g]))
        if rows.gap[world, g] + 2.0 * T * closing > T * (SLOW + T * PUSHED):
            touch = 0
    rows.touch[world, g] = touch
    mean = rows.w[world, 0, g]
    tree = rows.tree[world, 0, g]
    if kind == int(CONTACT) and tree >= 0:
        total = float(0.0)
        number = float(0.0)
        # Contacts of two bodies join the same trees.
        for m in range(work.first[world, tree], work.first[world, tree + 1]):
            other = rows.members[world, m] / rows.sides
            if same_bodies(world, g, other, geom_bodyid, rows):
                total += rows.w[world, 0, other]
                number += 1.0
        mean = total / wp.max(number, 1.0)
    rows.pair_w[world, g] = mean


@wp.kernel
def admit_reached(timestep: wp.array(dtype=wp.float32), rows: Rows):
    """Let what a blow may press take part in the bound, open or not; thread per world."""
    world = wp.tid()
    T = timestep[world % timestep.shape[0]]
    fastest = float(0.0)
    for g in range(rows.count[world]):
        if rows.touch[world, g] == 1 and rows.kind[world, g] <= int(UNILATERAL):
            fastest = wp.max(fastest, wp.abs(rows.u[world, 0, g]))
    if fastest <= T * BLOW + SLOW:
        return
    for g in range(rows.count[world]):
        if rows.gap[world, g] < REACHED * T * fastest:
            rows.touch[world, g] = 1


@wp.func
def inverse_of_coupling(bound: float) -> float:
    """1 / (c - 1), infinite without coupling."""
    if bound <= 1.0 + 1.0e-5:
        return wp.inf
    return 1.0 / (bound - 1.0)


@wp.kernel
def fill_rows(
    microsteps: int,
    timestep: wp.array(dtype=wp.float32),
    geom_rbound: wp.array2d(dtype=wp.float32),
    pair: Pair,
    rows: Rows,
    work: Work,
):
    """Stiffness and damping; thread per group."""
    world, g = wp.tid()
    if g >= rows.count[world]:
        return
    h = timestep[world % timestep.shape[0]] / float(microsteps)
    most_n = inverse_of_coupling(rows.bound[world, 1, g]) / h
    most_t = inverse_of_coupling(rows.bound[world, 2, g]) / h
    resolved = wp.min(STIFFEST_ALONE, inverse_of_coupling(rows.bound[world, 0, g])) / (h * h)
    kind = rows.kind[world, g]
    dim = rows.dim[world, g]
    w = rows.pair_w[world, g]
    own = rows.w[world, 0, g]
    clipped = int(0)
    k_given = float(0.0)  # N/m, 0 for rigid
    zeta = float(1.0)
    d_given = float(-1.0)  # N s/m, below 0 where the ratio counts
    added = float(0.0)
    gives_way = bool(False)
    sliding_ratio = float(1.0)
    sliding_zeta = float(1.0)
    load = wp.abs(rows.c[world, 0, g])
    if kind == int(CONTACT):
        material = pair_material(pair, world, rows.key[world, g])
        k_given = material[0]
        zeta = material[1]
        d_given = material[2]
        added = material[3]
        gives_way = material[4] == 1.0 and k_given == 0.0
        sliding_ratio = material[5]
        sliding_zeta = material[6]
        if gives_way:
            zeta = wp.min(zeta, RIGID_INELASTIC)
        elif zeta > INELASTIC:
            zeta = wp.where(k_given == 0.0, RIGID_INELASTIC, INELASTIC)
            if k_given > 0.0:
                sliding_zeta *= INELASTIC
    else:
        load = wp.inf
    kappa = resolved
    delta = 2.0 * zeta * wp.sqrt(kappa)
    rates = solref_rates(pair, world, rows.key[world, g], rows.source[world, g], kind, load)
    from_solref = rates[0] > 0.0 and k_given == 0.0 and d_given < 0.0
    if from_solref:
        # Springs of the model's own are those of MuJoCo, whatever the row moves.
        ratio = w / typical_inverse_mass(pair, world, rows.key[world, g], kind)
        kappa = wp.min(resolved, ratio * rates[0])
        delta = wp.sqrt(ratio) * rates[1]
    elif k_given > 0.0:
        asked = k_given * w
        kappa = wp.min(resolved, asked)
        if d_given >= 0.0:
            delta = (d_given + added) * w * wp.sqrt(kappa / asked)
        else:
            delta = 2.0 * zeta * wp.sqrt(kappa) + added * w
        if kappa < asked:
            clipped += 1
    elif gives_way:
        size = wp.inf
        for side in range(2):
            radius = geom_rbound[world % geom_rbound.shape[0], rows.key[world, g][side]]
            if radius > 0.0:
                size = wp.min(size, radius)
        least = 1.0e4 * 9.81 / size
        damped = most_n / (2.0 * zeta)
        kappa = wp.min(kappa, wp.max(damped * damped, least))
        delta = 2.0 * zeta * wp.sqrt(kappa)
    most = wp.where(kind == int(SLIDER), most_t, most_n)
    if delta > most:
        delta = most
        if k_given > 0.0:
            clipped += 1
    rows.bearable[world, g] = wp.inf
    if k_given > 0.0 and w > 0.0:
        rows.bearable[world, g] = BEARABLE / kappa
    if w > 0.0:
        rows.k[world, 0, g] = wp.min(kappa / w, SERIES / (own * h * h))
        rows.d[world, 0, g] = wp.min(delta / w, SERIES / (own * h))
    else:
        rows.k[world, 0, g] = 1.0
        rows.d[world, 0, g] = 0.0
    for i in range(1, dim):
        wi = rows.w[world, i, g]
        k = float(0.0)
        d = float(0.0)
        if wi > 0.0 and rows.mu[world, i, g] > 0.0:
            mean = wi
            if i != 3:
                first = wp.where(i < 3, 1, 4)
                mean = 0.5 * (rows.w[world, first, g] + rows.w[world, first + 1, g])
            kt = resolved * wi / (wi * wi)
            if k_given > 0.0:
                k = sliding_ratio * rows.k[world, 0, g]
                if i > 2:
                    k *= wp.max(w, 0.5 * (rows.w[world, 1, g] + rows.w[world, 2, g])) / mean
                if k > kt:
                    k = kt
                    clipped += 1
                d = 2.0 * sliding_zeta * wp.sqrt(k / mean)
            else:
                k = kt
                d = 2.0 * sliding_zeta * wp.sqrt(k / wi)
            d = wp.min(d, most_t / wi)
            k = wp.min(k, SERIES / (wi * h * h))
            d = wp.min(d, SERIES / (wi * h))
        rows.k[world, i, g] = k
        rows.d[world, i, g] = d
    for i in range(dim, rows.dims):
        rows.k[world, i, g] = 0.0
        rows.d[world, i, g] = 0.0
        rows.mu[world, i, g] = 0.0
    if clipped > 0:
        wp.atomic_add(work.clipped, world, clipped)
