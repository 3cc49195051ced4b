"""Rows of a step: which groups there are, their Jacobians, rates, and coupling.

``u = J v``, ``H = L L'``, ``Y = J inv(L')``, ``A = Y Y'``, ``w = diag(A)``, as in
``cpp/include/dashpot/rows/rows.hpp``. Groups are sorted by the geoms that touch, so that results
do not depend on the order in which collision found them.
"""

import warp as wp

from dashpot.warp.state import BILATERAL, CONTACT, SLIDER, UNILATERAL, Rows, Work

wp.set_module_options({"enable_backward": False})

vec5 = wp.types.vector(5, wp.float32)


@wp.kernel
def collect_contacts(
    nacon: wp.array(dtype=wp.int32),
    worldid: wp.array(dtype=wp.int32),
    address: wp.array2d(dtype=wp.int32),
    rows: Rows,
    work: Work,
):
    """Contacts that have rows, by world; thread per contact."""
    contact = wp.tid()
    if contact >= wp.min(nacon[0], worldid.shape[0]):
        return
    if address[contact, 0] < 0:
        return
    world = worldid[contact]
    slot = wp.atomic_add(rows.count, world, 1)
    if slot < rows.raw.shape[1]:
        rows.raw[world, slot] = contact
    else:
        work.overflow[world] = 1


@wp.kernel
def collect_constraints(
    ne: wp.array(dtype=wp.int32),
    nf: wp.array(dtype=wp.int32),
    nl: wp.array(dtype=wp.int32),
    rows: Rows,
    work: Work,
):
    """Limits, equalities and dry friction, which come before contacts; thread per row."""
    world, row = wp.tid()
    if row >= ne[world] + nf[world] + nl[world]:
        return
    slot = wp.atomic_add(rows.count, world, 1)
    if slot < rows.raw.shape[1]:
        rows.raw[world, slot] = -1 - row
    else:
        work.overflow[world] = 1


@wp.func
def key_of(
    world: int,
    source: int,
    geom: wp.array(dtype=wp.vec2i),
    collision: wp.array(dtype=wp.int32),
    efc_type: wp.array2d(dtype=wp.int32),
    efc_id: wp.array2d(dtype=wp.int32),
) -> wp.vec3i:
    """Return what tells a group from the others of its world, and orders them."""
    if source >= 0:
        pair = geom[source]
        return wp.vec3i(pair[0], pair[1], collision[source])
    row = -1 - source
    return wp.vec3i(efc_type[world, row] - 100, efc_id[world, row], row)


@wp.func
def is_before(a: wp.vec3i, b: wp.vec3i) -> bool:
    """Lexicographic order."""
    if a[0] != b[0]:
        return a[0] < b[0]
    if a[1] != b[1]:
        return a[1] < b[1]
    return a[2] < b[2]


@wp.kernel
def sort_groups(
    geom: wp.array(dtype=wp.vec2i),
    collision: wp.array(dtype=wp.int32),
    efc_type: wp.array2d(dtype=wp.int32),
    efc_id: wp.array2d(dtype=wp.int32),
    rows: Rows,
):
    """Each group finds its rank; thread per group."""
    world, slot = wp.tid()
    count = wp.min(rows.count[world], rows.raw.shape[1])
    if slot >= count:
        return
    source = rows.raw[world, slot]
    mine = key_of(world, source, geom, collision, efc_type, efc_id)
    rank = int(0)
    alike = int(0)
    for other in range(count):
        key = key_of(world, rows.raw[world, other], geom, collision, efc_type, efc_id)
        if is_before(key, mine) or (key == mine and other < slot):
            rank += 1
            if key[0] == mine[0] and key[1] == mine[1]:
                alike += 1
    rows.source[world, rank] = source
    rows.key[world, rank] = wp.vec3i(mine[0], mine[1], alike)


@wp.kernel
def clip_counts(rows: Rows):
    """Leave out groups beyond the capacity; thread per world."""
    world = wp.tid()
    rows.count[world] = wp.min(rows.count[world], rows.raw.shape[1])


@wp.func
def efc_row(source: int, i: int, contact_address: wp.array2d(dtype=wp.int32)) -> int:
    """MuJoCo's row of row i of a group."""
    if source >= 0:
        return contact_address[source, i]
    return -1 - source


@wp.func
def place(value: float, world: int, i: int, g: int, dof: int, tree: int, first: int, rows: Rows):
    """Put an entry of J to the side of its tree, which is claimed if it is new."""
    for side in range(rows.sides):
        if rows.tree[world, side, g] < 0:
            rows.tree[world, side, g] = tree
        if rows.tree[world, side, g] == tree:
            rows.J[world, (i * rows.sides + side) * rows.width + dof - first, g] = value
            return


@wp.kernel
def prepare_rows(
    nv: int,
    ahead: float,
    is_sparse: bool,
    timestep: wp.array(dtype=wp.float32),
    dof_tree: wp.array(dtype=wp.int32),
    tree_dofadr: wp.array(dtype=wp.int32),
    tree_dofnum: wp.array(dtype=wp.int32),
    tree_factor: wp.array(dtype=wp.int32),
    contact_dist: wp.array(dtype=wp.float32),
    contact_margin: wp.array(dtype=wp.float32),
    contact_dim: wp.array(dtype=wp.int32),
    contact_friction: wp.array(dtype=vec5),
    contact_address: wp.array2d(dtype=wp.int32),
    efc_type: wp.array2d(dtype=wp.int32),
    efc_pos: wp.array2d(dtype=wp.float32),
    efc_margin: wp.array2d(dtype=wp.float32),
    efc_frictionloss: wp.array2d(dtype=wp.float32),
    efc_J: wp.array3d(dtype=wp.float32),
    efc_rownnz: wp.array2d(dtype=wp.int32),
    efc_rowadr: wp.array2d(dtype=wp.int32),
    efc_colind: wp.array3d(dtype=wp.int32),
    rows: Rows,
    work: Work,
):
    """J, Y, w, u and c of a group, and its gap at the start; thread per group."""
    world, g = wp.tid()
    if g >= rows.count[world]:
        return
    source = rows.source[world, g]
    dim = int(1)
    gap = float(0.0)
    limit = float(0.0)
    kind = int(CONTACT)
    if source >= 0:
        dim = contact_dim[source]
        gap = contact_dist[source] - contact_margin[source]
        for i in range(1, dim):
            rows.mu[world, i, g] = contact_friction[source][i - 1]
    else:
        row = -1 - source
        # MuJoCo's order of types: equality, friction of dofs and tendons, limits of both.
        kind = int(UNILATERAL)
        if efc_type[world, row] == 0:
            kind = int(BILATERAL)
            limit = wp.inf
        elif efc_type[world, row] <= 2:
            kind = int(SLIDER)
            limit = efc_frictionloss[world, row]
        if kind != int(SLIDER):
            gap = efc_pos[world, row] - efc_margin[world, row]
    rows.kind[world, g] = kind
    rows.dim[world, g] = dim
    rows.limit[world, g] = limit
    for side in range(rows.sides):
        rows.tree[world, side, g] = -1
    for i in range(dim):
        row = efc_row(source, i, contact_address)
        for slot in range(rows.sides * rows.width):
            rows.J[world, i * rows.sides * rows.width + slot, g] = 0.0
        if is_sparse:
            begin = efc_rowadr[world, row]
            for item in range(efc_rownnz[world, row]):
                dof = efc_colind[world, 0, begin + item]
                tree = dof_tree[dof]
                value = efc_J[world, 0, begin + item]
                if value != 0.0:
                    place(value, world, i, g, dof, tree, tree_dofadr[tree], rows)
        else:
            for dof in range(nv):
                value = efc_J[world, row, dof]
                if value != 0.0:
                    tree = dof_tree[dof]
                    place(value, world, i, g, dof, tree, tree_dofadr[tree], rows)
    for slot in range(dim * rows.sides * rows.width, rows.dims * rows.sides * rows.width):
        rows.Y[world, slot, g] = 0.0
    for i in range(dim):
        u = wp.float64(0.0)
        c = wp.float64(0.0)
        w = wp.float64(0.0)
        for side in range(rows.sides):
            at = (i * rows.sides + side) * rows.width
            tree = rows.tree[world, side, g]
            n = int(0)
            if tree >= 0:
                n = tree_dofnum[tree]
            for item in range(n):
                dof = tree_dofadr[tree] + item
                value = rows.J[world, at + item, g]
                u += wp.float64(value) * wp.float64(work.start[world, dof])
                c += wp.float64(value) * wp.float64(work.a[world, dof])
                factor = tree_factor[tree] + item * n
                y = value
                for m in range(item):
                    y -= work.L[world, factor + m] * rows.Y[world, at + m, g]
                y /= work.L[world, factor + item]
                w += wp.float64(y) * wp.float64(y)
                rows.Y[world, at + item, g] = y
            for item in range(n, rows.width):
                rows.Y[world, at + item, g] = 0.0
        rows.u[world, i, g] = wp.float32(u)
        rows.c[world, i, g] = wp.float32(c)
        rows.w[world, i, g] = wp.float32(w)
    time = ahead * timestep[world % timestep.shape[0]]
    rows.gap[world, g] = gap - time * rows.u[world, 0, g]


@wp.func
def rate_of(
    world: int,
    i: int,
    g: int,
    tree_dofadr: wp.array(dtype=wp.int32),
    tree_dofnum: wp.array(dtype=wp.int32),
    values: wp.array2d(dtype=wp.float32),
    rows: Rows,
) -> wp.float64:
    """J times what dofs have, of one row."""
    total = wp.float64(0.0)
    for side in range(rows.sides):
        tree = rows.tree[world, side, g]
        if tree >= 0:
            at = (i * rows.sides + side) * rows.width
            for item in range(tree_dofnum[tree]):
                value = wp.float64(values[world, tree_dofadr[tree] + item])
                total += wp.float64(rows.J[world, at + item, g]) * value
    return total
