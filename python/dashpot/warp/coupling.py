"""How groups act on each other: ``A = Y Y'``, by blocks of contact space or by trees.

Up to some number of groups their blocks of A are found once a step, as many as the square of their
number. Beyond, micro-steps sum up forces tree by tree, ``A F = Y (Y' F)``, with as many numbers as
groups have in Y. Of free bodies these are wrenches, in units that give every body unit inertia.
Every tree has a list of the groups that join it, in their order, so that sums have one order.

Bounds of the coupling are by Perron and Frobenius: with z > 0 no eigenvalue of ``K |A|`` is larger
than the largest of ``k_i (|A| z)_i / z_i``. So every row has a bound of its own, ``c_i = (|A| z)_i
/ z_i``, and what is pressed elsewhere in the world makes it no softer. What stays open in the step
softens no other, but has the bound of a row that closes.
"""

import warp as wp

from dashpot.warp.state import CONTACT, SLIDER, Rows, Work

wp.set_module_options({"enable_backward": False})


@wp.func
def same_bodies(
    world: int, g: int, other: int, geom_bodyid: wp.array(dtype=wp.int32), rows: Rows
) -> bool:
    """Whether two groups are contacts of the same two bodies."""
    if rows.kind[world, other] != int(CONTACT):
        return False
    mine = rows.key[world, g]
    theirs = rows.key[world, other]
    a = geom_bodyid[mine[0]]
    b = geom_bodyid[mine[1]]
    c = geom_bodyid[theirs[0]]
    d = geom_bodyid[theirs[1]]
    return (a == c and b == d) or (a == d and b == c)


@wp.kernel
def count_members(rows: Rows, work: Work):
    """How many groups join a tree; thread per tree."""
    world, tree = wp.tid()
    number = int(0)
    for g in range(rows.count[world]):
        for side in range(rows.sides):
            if rows.tree[world, side, g] == tree:
                number += 1
    work.first[world, tree + 1] = number


@wp.kernel
def add_counts(ntree: int, work: Work):
    """Where the list of each tree begins; thread per world."""
    world = wp.tid()
    total = int(0)
    for tree in range(ntree + 1):
        total += work.first[world, tree]
        work.first[world, tree] = total


@wp.kernel
def list_members(rows: Rows, work: Work):
    """Which groups join a tree; thread per tree."""
    world, tree = wp.tid()
    at = work.first[world, tree]
    for g in range(rows.count[world]):
        for side in range(rows.sides):
            if rows.tree[world, side, g] == tree:
                rows.members[world, at] = g * rows.sides + side
                at += 1


@wp.func
def product_of(world: int, i: int, g: int, side: int, j: int, other: int, their: int, rows: Rows):
    """Product of two rows of Y in the tree that both join."""
    mine = (i * rows.sides + side) * rows.width
    theirs = (j * rows.sides + their) * rows.width
    total = float(0.0)
    for item in range(rows.width):
        total += rows.Y[world, mine + item, g] * rows.Y[world, theirs + item, other]
    return total


@wp.kernel
def couple(rows: Rows):
    """Find A by blocks of two groups, 0 of rows that they have not; thread per (other, group)."""
    world, other, g = wp.tid()
    count = rows.count[world]
    if g >= count or other >= count:
        return
    for i in range(rows.dims):
        for j in range(rows.dims):
            total = float(0.0)
            for side in range(rows.sides):
                tree = rows.tree[world, side, g]
                for their in range(rows.sides):
                    if tree >= 0 and rows.tree[world, their, other] == tree:
                        total += product_of(world, i, g, side, j, other, their, rows)
            rows.A[world, other * rows.dims + j, i, g] = total


@wp.func
def unit_weight(world: int, i: int, g: int, rows: Rows) -> float:
    """1 / sqrt(w) by which a row of A is weighted, 0 of what is no row."""
    if i >= rows.dim[world, g]:
        return 0.0
    if i > 0 and rows.mu[world, i, g] <= 0.0:
        return 0.0
    w = wp.where(i == 0, rows.pair_w[world, g], rows.w[world, i, g])
    if w <= 0.0:
        return 0.0
    return 1.0 / wp.sqrt(w)


@wp.func
def is_of(vector: int, i: int, kind: int) -> bool:
    """Whether a row belongs to the bound of all rows (0), of normals (1), of friction (2)."""
    slides = i > 0 or kind == int(SLIDER)
    return vector == 0 or (vector == 1 and not slides) or (vector == 2 and slides)


@wp.func
def add_of_other(
    total: wp.vec3,
    entry: float,
    world: int,
    j: int,
    other: int,
    before: int,
    rows: Rows,
    work: Work,
) -> wp.vec3:
    """Add what a row of another group has in the three products."""
    weight = wp.abs(entry) * unit_weight(world, j, other, rows)
    for vector in range(3):
        if is_of(vector, j, rows.kind[world, other]):
            z = float(1.0)
            if before >= 0:
                z = work.z[world, 3 * before + vector, j, other]
            total[vector] = total[vector] + weight * z
    return total


@wp.kernel
def bound_round(by_trees: bool, before: int, rows: Rows, work: Work):
    """One product of |A| with three positive vectors; thread per (row, group)."""
    world, i, g = wp.tid()
    if g >= rows.count[world]:
        return
    mine = unit_weight(world, i, g, rows)
    total = wp.vec3(0.0, 0.0, 0.0)
    if mine > 0.0 and by_trees:
        for side in range(rows.sides):
            tree = rows.tree[world, side, g]
            if tree >= 0:
                for m in range(work.first[world, tree], work.first[world, tree + 1]):
                    other = rows.members[world, m] / rows.sides
                    their = rows.members[world, m] % rows.sides
                    if rows.touch[world, other] == 1 or other == g:
                        for j in range(rows.dim[world, other]):
                            entry = product_of(world, i, g, side, j, other, their, rows)
                            total = add_of_other(total, entry, world, j, other, before, rows, work)
    elif mine > 0.0:
        for other in range(rows.count[world]):
            if rows.touch[world, other] == 1 or other == g:
                for j in range(rows.dim[world, other]):
                    entry = rows.A[world, other * rows.dims + j, i, g]
                    total = add_of_other(total, entry, world, j, other, before, rows, work)
    after = 0
    if before == 0:
        after = 1
    for vector in range(3):
        if not is_of(vector, i, rows.kind[world, g]):
            total[vector] = 0.0
        work.z[world, 3 * after + vector, i, g] = mine * total[vector]


@wp.kernel
def bound_groups(before: int, rows: Rows, work: Work):
    """Find the largest quotients of a group's rows; thread per (vector, group)."""
    world, vector, g = wp.tid()
    if g == 0:
        work.bound[world, vector] = 0.0
    if g >= rows.count[world]:
        return
    c = float(0.0)
    for i in range(rows.dim[world, g]):
        below = work.z[world, 3 * before + vector, i, g]
        if below > 0.0:
            c = wp.max(c, work.z[world, 3 * (1 - before) + vector, i, g] / below)
    rows.own_bound[world, vector, g] = c


@wp.kernel
def share_bounds(geom_bodyid: wp.array(dtype=wp.int32), rows: Rows, work: Work):
    """Give contacts of the same two bodies one bound, the largest; thread per (vector, group)."""
    world, vector, g = wp.tid()
    if g >= rows.count[world]:
        return
    c = rows.own_bound[world, vector, g]
    tree = rows.tree[world, 0, g]
    if rows.kind[world, g] == int(CONTACT) and tree >= 0:
        # Contacts of two bodies join the same trees.
        for m in range(work.first[world, tree], work.first[world, tree + 1]):
            other = rows.members[world, m] / rows.sides
            if same_bodies(world, g, other, geom_bodyid, rows):
                c = wp.max(c, rows.own_bound[world, vector, other])
    rows.bound[world, vector, g] = c
    wp.atomic_max(work.bound, world, vector, c)
