"""Effective inertia by tree: factors H = L L', smooth accelerations, response to impulses.

``H = M + T D`` with what the model's integrator takes implicitly (``D`` of joint dampers, with
``implicitfast`` also of actuators, tendons and fluids), as in
``cpp/include/dashpot/rows/trees.hpp``. That is of first order in T. What drifts, is kicked and
drifts takes a share of it,

    H_ij = M_ij + T D_ij sqrt(theta_i theta_j),   theta_i = 1 / (1 - exp(-z_i)) - 1 / z_i ,

with ``z_i = T D_ii w_i``, where w_i is the larger of ``1 / M_ii`` and of the inverse mass that the
dof has at the model's reference positions, where others give way. A damper alone then has its
exponential decay at any step, dampers that a step resolves are of second order (theta near 1/2),
and none overshoots (theta <= 1).
"""

import warp as wp

from dashpot.warp.state import Rows, Work

wp.set_module_options({"enable_backward": False})


@wp.kernel
def add_dampers(
    timestep: wp.array(dtype=wp.float32),
    M_rownnz: wp.array(dtype=wp.int32),
    M_rowadr: wp.array(dtype=wp.int32),
    dof_damping: wp.array2d(dtype=wp.float32),
    dof_dampingpoly: wp.array2d(dtype=wp.vec2),
    implicit: int,
    M: wp.array2d(dtype=wp.float32),
    qvel: wp.array2d(dtype=wp.float32),
    H: wp.array2d(dtype=wp.float32),
):
    """H = M + T D of Euler's integrator; thread per dof."""
    world, dof = wp.tid()
    first = M_rowadr[dof]
    last = first + M_rownnz[dof] - 1
    for i in range(first, last + 1):
        H[world, i] = M[world, i]
    if implicit == 1:
        poly = dof_dampingpoly[world % dof_dampingpoly.shape[0], dof]
        v = wp.abs(qvel[world, dof])
        damping = dof_damping[world % dof_damping.shape[0], dof]
        damping += 2.0 * poly[0] * v + 3.0 * poly[1] * v * v
        H[world, last] = H[world, last] + timestep[world % timestep.shape[0]] * damping


@wp.kernel
def free_forces(
    gravity: wp.array(dtype=wp.vec3),
    has_gravity: int,
    freeadr: wp.array(dtype=wp.int32),
    body_dofadr: wp.array(dtype=wp.int32),
    body_mass: wp.array2d(dtype=wp.float32),
    xpos: wp.array2d(dtype=wp.vec3),
    xmat: wp.array2d(dtype=wp.mat33),
    xipos: wp.array2d(dtype=wp.vec3),
    bias: wp.array2d(dtype=wp.float32),
    force: wp.array2d(dtype=wp.float32),
):
    """Of free bodies, whose drift turns them, gravity alone is left of the bias force."""
    world, index = wp.tid()
    body = freeadr[index]
    dof = body_dofadr[body]
    weight = wp.vec3(0.0, 0.0, 0.0)
    if has_gravity == 1:
        mass = body_mass[world % body_mass.shape[0], body]
        weight = mass * gravity[world % gravity.shape[0]]
    arm = xipos[world, body] - xpos[world, body]
    torque = wp.transpose(xmat[world, body]) @ wp.cross(arm, weight)
    for i in range(3):
        force[world, dof + i] = force[world, dof + i] + bias[world, dof + i] + weight[i]
        force[world, dof + 3 + i] = force[world, dof + 3 + i] + bias[world, dof + 3 + i] + torque[i]


@wp.kernel
def exchange_bias(
    before: wp.array2d(dtype=wp.float32),
    after: wp.array2d(dtype=wp.float32),
    force: wp.array2d(dtype=wp.float32),
):
    """Take the bias force of one velocity for that of another."""
    world, dof = wp.tid()
    force[world, dof] = force[world, dof] + before[world, dof] - after[world, dof]


@wp.kernel
def advance_velocity(
    timestep: wp.array(dtype=wp.float32),
    part: float,
    qvel: wp.array2d(dtype=wp.float32),
    qacc: wp.array2d(dtype=wp.float32),
    out: wp.array2d(dtype=wp.float32),
):
    """Velocities after `part` of a step."""
    world, dof = wp.tid()
    time = part * timestep[world % timestep.shape[0]]
    out[world, dof] = qvel[world, dof] + time * qacc[world, dof]


@wp.func
def damped_share(damping: float, mass: float, inverse: float) -> float:
    """Theta of a dof with T D, M and its inverse mass where others give way, 1/2 to 1."""
    z = damping * wp.max(inverse, 1.0 / wp.max(mass, 1.0e-12))
    if z < 0.1:
        return 0.5 + wp.max(z, 0.0) / 12.0
    return 1.0 / (1.0 - wp.exp(-z)) - 1.0 / z


@wp.kernel
def factor(
    fitted: bool,
    tree_dofadr: wp.array(dtype=wp.int32),
    tree_dofnum: wp.array(dtype=wp.int32),
    tree_factor: wp.array(dtype=wp.int32),
    M_rownnz: wp.array(dtype=wp.int32),
    M_rowadr: wp.array(dtype=wp.int32),
    M_colind: wp.array(dtype=wp.int32),
    M: wp.array2d(dtype=wp.float32),
    dof_invweight0: wp.array2d(dtype=wp.float32),
    work: Work,
):
    """L of a tree, with shares of dampers where `fitted`; thread per tree."""
    world, tree = wp.tid()
    first = tree_dofadr[tree]
    n = tree_dofnum[tree]
    at = tree_factor[tree]
    L = work.L[world]
    share = work.a[world]
    for i in range(n):
        last = M_rowadr[first + i] + M_rownnz[first + i] - 1
        share[first + i] = 1.0
        if fitted:
            mass = M[world, last]
            inverse = dof_invweight0[world % dof_invweight0.shape[0], first + i]
            share[first + i] = wp.sqrt(damped_share(work.H[world, last] - mass, mass, inverse))
    for i in range(n):
        for j in range(i + 1):
            L[at + i * n + j] = 0.0
        row = M_rowadr[first + i]
        for item in range(M_rownnz[first + i]):
            j = M_colind[row + item] - first
            mass = M[world, row + item]
            damping = work.H[world, row + item] - mass
            L[at + i * n + j] = mass + damping * share[first + i] * share[first + j]
    for i in range(n):
        for j in range(i + 1):
            s = L[at + i * n + j]
            for other in range(j):
                s -= L[at + i * n + other] * L[at + j * n + other]
            if i == j:
                L[at + i * n + i] = wp.sqrt(wp.max(s, 1.0e-12))
            else:
                L[at + i * n + j] = s / L[at + j * n + j]


@wp.func
def solve_in_place(
    at: int, first: int, n: int, L: wp.array(dtype=wp.float32), x: wp.array(dtype=wp.float32)
):
    """Solve H x = what x holds, of one tree."""
    for i in range(n):
        s = x[first + i]
        for other in range(i):
            s -= L[at + i * n + other] * x[first + other]
        x[first + i] = s / L[at + i * n + i]
    for r in range(n):
        i = n - 1 - r
        s = x[first + i]
        for other in range(i + 1, n):
            s -= L[at + other * n + i] * x[first + other]
        x[first + i] = s / L[at + i * n + i]


@wp.kernel
def solve_smooth(
    tree_dofadr: wp.array(dtype=wp.int32),
    tree_dofnum: wp.array(dtype=wp.int32),
    tree_factor: wp.array(dtype=wp.int32),
    work: Work,
):
    """Smooth acceleration of a tree; thread per tree."""
    world, tree = wp.tid()
    first = tree_dofadr[tree]
    n = tree_dofnum[tree]
    at = tree_factor[tree]
    for i in range(n):
        work.a[world, first + i] = work.force[world, first + i]
    solve_in_place(at, first, n, work.L[world], work.a[world])


@wp.kernel
def respond(
    timestep: wp.array(dtype=wp.float32),
    tree_dofadr: wp.array(dtype=wp.int32),
    tree_dofnum: wp.array(dtype=wp.int32),
    tree_factor: wp.array(dtype=wp.int32),
    rows: Rows,
    work: Work,
    qacc: wp.array2d(dtype=wp.float32),
    qfrc_constraint: wp.array2d(dtype=wp.float32),
):
    """Velocities and displacement that the step's impulses lead to; thread per tree.

    Sums over rows and back substitution are in double precision: loads cancel at rest.
    """
    world, tree = wp.tid()
    first = tree_dofadr[tree]
    n = tree_dofnum[tree]
    at = tree_factor[tree]
    T = wp.float64(timestep[world % timestep.shape[0]])
    # From the last dof on: those below are not needed any more when they are overwritten.
    for r in range(n):
        i = n - 1 - r
        dof = first + i
        p = wp.float64(0.0)
        m = wp.float64(0.0)
        push = float(0.0)
        for member in range(work.first[world, tree], work.first[world, tree + 1]):
            g = rows.members[world, member] / rows.sides
            side = rows.members[world, member] % rows.sides
            for j in range(rows.dim[world, g]):
                slot = (j * rows.sides + side) * rows.width + i
                y = wp.float64(rows.Y[world, slot, g])
                p += y * wp.float64(rows.total[world, j, g])
                m += y * wp.float64(rows.moment[world, j, g])
                push += rows.J[world, slot, g] * rows.total[world, j, g]
        for other in range(i + 1, n):
            factor = wp.float64(work.L[world, at + other * n + i])
            p -= factor * wp.float64(work.end[world, first + other])
            m -= factor * wp.float64(work.displacement[world, first + other])
        diagonal = wp.float64(work.L[world, at + i * n + i])
        work.end[world, dof] = wp.float32(p / diagonal)
        work.displacement[world, dof] = wp.float32(m / diagonal)
        qfrc_constraint[world, dof] = push / wp.float32(T)
    for i in range(n):
        dof = first + i
        v = wp.float64(work.start[world, dof])
        a = wp.float64(work.a[world, dof])
        change = T * a + wp.float64(work.end[world, dof])
        way = T * v + wp.float64(0.5) * T * T * a + wp.float64(work.displacement[world, dof])
        work.end[world, dof] = wp.float32(v + change)
        work.displacement[world, dof] = wp.float32(way)
        qacc[world, dof] = wp.float32(change / T)
