"""Micro-steps whose lanes go over groups in sweeps, with what they keep in memory.

A block per world as in `dashpot.warp.microsteps`, but lane l has the groups l, l + lanes, and so
on: a world may have any number of them, with torsion and rolling too. They act on each other by
trees (`dashpot.warp.coupling`): lanes sum up ``Y' F`` dof by dof, over the groups that join a tree,
and groups read ``Y`` times that.
"""

from functools import cache
from typing import Any

import warp as wp

from dashpot.warp.group import (
    COUPLED_SHARE,
    barrier,
    flow_group,
    force_now,
    recovery_time,
    slipped,
    unstressed_rate,
)
from dashpot.warp.state import UNILATERAL, Rows, Work

REGISTERS = 168

vec4 = wp.types.vector(4, wp.float32)


@wp.func
def sum_by_trees(
    world: int,
    begin: int,
    lanes: int,
    ntree: int,
    given: wp.array3d(dtype=wp.float32),
    out: wp.array2d(dtype=wp.float32),
    rows: Rows,
    work: Work,
):
    """Find Y' times what rows have, for every dof of every tree."""
    for at in range(begin, ntree * rows.width, lanes):
        tree = at / rows.width
        dof = at % rows.width
        total = float(0.0)
        for m in range(work.first[world, tree], work.first[world, tree + 1]):
            g = rows.members[world, m] / rows.sides
            side = rows.members[world, m] % rows.sides
            for i in range(rows.dim[world, g]):
                slot = (i * rows.sides + side) * rows.width + dof
                total += rows.Y[world, slot, g] * given[world, i, g]
        out[world, at] = total


@wp.func
def of_trees(world: int, i: int, g: int, sums: wp.array2d(dtype=wp.float32), rows: Rows) -> float:
    """Y times the sums, of one row."""
    total = float(0.0)
    for side in range(rows.sides):
        tree = rows.tree[world, side, g]
        if tree >= 0:
            at = (i * rows.sides + side) * rows.width
            for item in range(rows.width):
                total += rows.Y[world, at + item, g] * sums[world, tree * rows.width + item]
    return total


@cache
def sweep_kernel(dims: int) -> Any:
    """Return the kernel for groups of up to `dims` rows."""
    vec = wp.types.vector(dims, wp.float32)
    tangents = dims - 1
    friction = wp.types.vector(tangents, wp.float32)
    propagators = wp.types.matrix((tangents, 4), wp.float32)

    def sweep_microsteps(
        microsteps: int,
        ntree: int,
        timestep: wp.array(dtype=wp.float32),
        recovery_speed: wp.array(dtype=wp.float32),
        rows: Rows,
        work: Work,
    ):
        world, lane = wp.tid()
        lanes = wp.block_dim()
        count = rows.count[world]
        T = timestep[world % timestep.shape[0]]
        h = T / float(microsteps)
        speed = recovery_speed[world % recovery_speed.shape[0]]
        recovery = recovery_time(T)
        for step in range(2 * microsteps):
            # Of a micro-step, first the forces of now and then what flows under them.
            flows = step % 2 == 1
            for g in range(lane, count, lanes):
                kind = rows.kind[world, g]
                x = vec(0.0)
                u = vec(0.0)
                w = vec(0.0)
                loads = vec(0.0)
                for i in range(wp.static(dims)):
                    x[i] = rows.x[world, i, g] + rows.moved[world, i, g]
                    u[i] = rows.u[world, i, g]
                    w[i] = rows.w[world, i, g]
                inverse_mu = friction(0.0)
                kt = friction(0.0)
                dt = friction(0.0)
                slip = friction(0.0)
                es = propagators()
                for i in range(wp.static(tangents)):
                    mu = rows.mu[world, i + 1, g]
                    if mu > 0.0:
                        inverse_mu[i] = 1.0 / mu
                        kt[i] = rows.k[world, i + 1, g]
                        dt[i] = rows.d[world, i + 1, g]
                        slip[i] = rows.slip[world, i + 1, g]
                        for n in range(wp.static(4)):
                            es[i, n] = rows.e[world, 4 * (i + 1) + n, g]
                limit = rows.limit[world, g]
                k = rows.k[world, 0, g]
                d = rows.d[world, 0, g]
                surface = rows.surface[world, g]
                if not flows:
                    force = force_now(
                        kind, limit, k, d, surface, x, u, w, kt, dt, inverse_mu, slip, es
                    )
                    for i in range(wp.static(dims)):
                        rows.force[world, i, g] = force[i]
                else:
                    for i in range(wp.static(dims)):
                        loads[i] = rows.c[world, i, g] - w[i] * rows.force[world, i, g]
                        loads[i] += of_trees(world, i, g, work.tree_force, rows)
                    e = vec4(0.0)
                    for n in range(wp.static(4)):
                        e[n] = rows.e[world, n, g]
                    p, r, sticks = flow_group(
                        kind, limit, k, d, surface, e, x, u, w, loads,
                        kt, dt, inverse_mu, slip, es, h,
                    )  # fmt: skip
                    rows.sticks[world, g] = wp.where(sticks, 1, 0)
                    for i in range(wp.static(dims)):
                        own = h * loads[i] + w[i] * p[i]
                        way = h * u[i] + 0.5 * h * h * loads[i] + w[i] * r[i]
                        rows.way[world, i, g] = way - wp.static(COUPLED_SHARE) * h * own
                        rows.impulse[world, i, g] = p[i]
                        total = rows.total[world, i, g]
                        rows.moment[world, i, g] = rows.moment[world, i, g] + (h * total + r[i])
                        rows.total[world, i, g] = total + p[i]
            barrier()
            if flows:
                sum_by_trees(world, lane, lanes, ntree, rows.impulse, work.tree_impulse, rows, work)
            else:
                sum_by_trees(world, lane, lanes, ntree, rows.force, work.tree_force, rows, work)
            barrier()
            if flows:
                for g in range(lane, count, lanes):
                    kind = rows.kind[world, g]
                    sticks = rows.sticks[world, g] == 1
                    surface = rows.surface[world, g]
                    for i in range(wp.static(dims)):
                        change = h * rows.c[world, i, g]
                        change += of_trees(world, i, g, work.tree_impulse, rows)
                        way = rows.way[world, i, g] + wp.static(COUPLED_SHARE) * h * change
                        rows.u[world, i, g] = rows.u[world, i, g] + change
                        moved = rows.moved[world, i, g] + way
                        rows.moved[world, i, g] = moved
                        base = rows.x[world, i, g]
                        if i == 0 and (sticks or kind <= int(UNILATERAL)):
                            rows.x[world, 0, g] = base - h * surface
                        elif not sticks:
                            rows.x[world, i, g] = slipped(
                                base, moved, way, rows.impulse[world, i, g],
                                rows.k[world, i, g], rows.fade[world, i, g], h,
                            )  # fmt: skip
                    unstressed = rows.unstressed[world, g] - h * surface
                    rows.unstressed[world, g] = unstressed
                    at = rows.x[world, 0, g] + rows.moved[world, 0, g]
                    rows.surface[world, g] = unstressed_rate(
                        unstressed, rows.noise[world, g], at, rows.bearable[world, g],
                        recovery, speed, kind > 1,
                    )  # fmt: skip

    sweep_microsteps.__qualname__ = f"sweep_microsteps_{dims}"
    module = wp.get_module(f"dashpot.warp.sweeps{dims}")
    module.options["enable_backward"] = False
    return wp.kernel(
        sweep_microsteps, module=module, enable_backward=False, cuda_max_registers=REGISTERS
    )
