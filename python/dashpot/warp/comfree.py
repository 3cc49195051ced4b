"""The complementarity-free update, from its published equations (arXiv 2603.12185).

As in ``cpp/include/dashpot/solve/comfree.hpp``, which has what follows from them: every facet
of a contact in overlap pushes on its own, against the rate v_p predicted for the end of the step of
length dt::

    f   = max(0, m (-d v_p - k (g + dt v_p))),    k = k_user / dt,   d = d_user / dt
    v_p = u_n +- mu_i u_i,    u = J (v + dt a_smooth),    m = imp / ((1 - imp) w_0)

Limits are facets, equalities push both ways, dry friction stops its row within the step up to its
limit. Nothing is remembered. m is MuJoCo's ``efc_D`` of the normal row; of an equality of several
rows, where MuJoCo takes imp at the norm of their errors, that of each row's own error.
"""

import warp as wp

from dashpot.warp.inertia import solve_in_place
from dashpot.warp.material import impedance
from dashpot.warp.rows import efc_row
from dashpot.warp.state import BILATERAL, SLIDER, UNILATERAL, Rows, Work

wp.set_module_options({"enable_backward": False})

MINIMUM = 1.0e-15  # MuJoCo's mjMINVAL
OF_COUPLING = 0.55

vec5 = wp.types.vector(5, wp.float32)


@wp.kernel
def add_magnitudes(
    tree_dofadr: wp.array(dtype=wp.int32),
    tree_dofnum: wp.array(dtype=wp.int32),
    tree_factor: wp.array(dtype=wp.int32),
    rows: Rows,
    work: Work,
):
    """|inv(H)| times the sum of |J| over all rows that push both ways; thread per tree."""
    world, tree = wp.tid()
    first = tree_dofadr[tree]
    n = tree_dofnum[tree]
    at = tree_factor[tree]
    for i in range(n):
        total = float(0.0)
        for m in range(work.first[world, tree], work.first[world, tree + 1]):
            g = rows.members[world, m] / rows.sides
            side = rows.members[world, m] % rows.sides
            if rows.kind[world, g] > int(UNILATERAL):
                total += wp.abs(rows.J[world, side * rows.width + i, g])
        work.end[world, first + i] = total
        work.displacement[world, first + i] = 0.0
    for column in range(n):
        # A column of inv(H), in place of H's row of the factor's structure.
        for i in range(n):
            work.force[world, first + i] = wp.where(i == column, 1.0, 0.0)
        solve_in_place(at, first, n, work.L[world], work.force[world])
        for i in range(n):
            work.displacement[world, first + i] = (
                work.displacement[world, first + i]
                + wp.abs(work.force[world, first + i]) * work.end[world, first + column]
            )


@wp.func
def spring_damper(k: float, d: float, mass: float, gap: float, rate: float, step: float) -> float:
    """Force of a facet, or of the row of an equality, before any bound."""
    return mass * (-d * rate - k * (gap + step * rate)) / step


@wp.func
def ratio_of(impedance: float) -> float:
    """Mass over that of the constraint."""
    return impedance / (1.0 - impedance)


@wp.func
def own_mass(
    world: int,
    row: int,
    mass: float,
    gap: float,
    ne: int,
    efc_id: wp.array2d(dtype=wp.int32),
    efc_pos: wp.array2d(dtype=wp.float32),
    eq_solimp: wp.array2d(dtype=vec5),
) -> float:
    """Mass at the impedance of a row's own error."""
    equality = efc_id[world, row]
    square = float(0.0)
    for other in range(ne):
        if efc_id[world, other] == equality:
            square += efc_pos[world, other] * efc_pos[world, other]
    solimp = eq_solimp[world % eq_solimp.shape[0], equality]
    of_all = ratio_of(impedance(solimp, wp.sqrt(square)))
    return mass * ratio_of(impedance(solimp, gap)) / of_all


@wp.kernel
def push_apart(
    timestep: wp.array(dtype=wp.float32),
    tree_dofadr: wp.array(dtype=wp.int32),
    tree_dofnum: wp.array(dtype=wp.int32),
    stiffness: wp.array(dtype=wp.float32),
    damping: wp.array(dtype=wp.float32),
    contact_address: wp.array2d(dtype=wp.int32),
    efc_D: wp.array2d(dtype=wp.float32),
    ne: wp.array(dtype=wp.int32),
    efc_id: wp.array2d(dtype=wp.int32),
    efc_pos: wp.array2d(dtype=wp.float32),
    eq_solimp: wp.array2d(dtype=vec5),
    rows: Rows,
    work: Work,
):
    """Impulses of every group; thread per group."""
    world, g = wp.tid()
    if g >= rows.count[world]:
        return
    T = timestep[world % timestep.shape[0]]
    k = stiffness[world % stiffness.shape[0]]
    d = damping[world % damping.shape[0]]
    kind = rows.kind[world, g]
    dim = rows.dim[world, g]
    gap = rows.gap[world, g]
    source = rows.source[world, g]
    row = efc_row(source, 0, contact_address)
    mass = efc_D[world, row]
    for i in range(dim):
        rows.total[world, i, g] = 0.0
        rows.moment[world, i, g] = 0.0
    normal = rows.u[world, 0, g] + T * rows.c[world, 0, g]
    if kind > int(UNILATERAL):
        coupling = float(0.0)
        for side in range(rows.sides):
            tree = rows.tree[world, side, g]
            if tree >= 0:
                for item in range(tree_dofnum[tree]):
                    value = wp.abs(rows.J[world, side * rows.width + item, g])
                    coupling += value * work.displacement[world, tree_dofadr[tree] + item]
        force = float(0.0)
        if kind == int(SLIDER):
            inverse = wp.max(wp.max(MINIMUM, rows.w[world, 0, g]), OF_COUPLING * coupling)
            limit = rows.limit[world, g]
            force = wp.clamp(-normal / (T * inverse), -limit, limit)
        if kind == int(BILATERAL):
            mass = own_mass(world, row, mass, gap, ne[world], efc_id, efc_pos, eq_solimp)
            stable = wp.min(mass, 1.0 / ((d + k * T) * coupling))
            force = spring_damper(k, d, stable, gap, normal, T)
        rows.total[world, 0, g] = T * force
        return
    if gap >= 0.0:
        return
    if dim == 1:
        rows.total[world, 0, g] = T * wp.max(0.0, spring_damper(k, d, mass, gap, normal, T))
        return
    total = float(0.0)
    for i in range(1, dim):
        mu = rows.mu[world, i, g]
        across = mu * (rows.u[world, i, g] + T * rows.c[world, i, g])
        plus = wp.max(0.0, spring_damper(k, d, mass, gap, normal + across, T))
        minus = wp.max(0.0, spring_damper(k, d, mass, gap, normal - across, T))
        total += plus + minus
        rows.total[world, i, g] = T * mu * (plus - minus)
    rows.total[world, 0, g] = T * total


@wp.kernel
def way_of_step(timestep: wp.array(dtype=wp.float32), work: Work):
    """Displacement by the new velocity alone; the drift takes half of the old one from it."""
    world, dof = wp.tid()
    T = timestep[world % timestep.shape[0]]
    work.displacement[world, dof] = T * work.end[world, dof]
    work.start[world, dof] = 0.0
