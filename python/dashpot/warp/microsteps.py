"""All micro-steps of a step in one kernel: a block per world, a lane per group.

A micro-step of length h, with rows u = J v, as in
``cpp/include/dashpot/solve/microstep.hpp``::

    F    = force of every row now
    b    = c + A F - w F                      load on a row, its own share left out
    p, r = flow of the row over h             closed form, friction returned to its limit
    u'   = u + h c + A p
    x   += h u + h^2/2 b + w r + s h (u' - u - h b - w p),   s = 1/3

Worlds are solved in row space; lanes exchange F and p, with two barriers, and keep all else in
registers. c includes the turn of the rows. A slipping spring relaxes, ``k s + d s' = -p/h``.
"""

from functools import cache
from typing import Any

import warp as wp

from dashpot.warp.law import (
    flow_normal,
    flow_spring,
    propagate_later,
    return_to_limit,
)
from dashpot.warp.state import UNILATERAL, Rows

COUPLED_SHARE = 1.0 / 3.0
LEAST_RECOVERY = 0.01  # s
RECOVERY_STEPS = 2.0
REGISTERS = 168  # of a lane: three blocks of 128 lanes on a multiprocessor

vec4 = wp.types.vector(4, wp.float32)


@wp.func_native("WP_TILE_SYNC();")
def barrier():
    """Wait for all lanes of the block, and see what they wrote."""
    ...


@wp.func
def offset_rate(
    offset: float,
    noise: float,
    x: float,
    bearable: float,
    time: float,
    speed: float,
    both_ways: bool,
) -> float:
    """How fast an offset beyond noise recovers (m/s)."""
    beyond = wp.abs(offset) - noise
    if beyond <= 0.0 or x * x > bearable * bearable:
        return 0.0
    rate = wp.min(beyond / time, speed)
    if offset > 0.0:
        return rate
    return wp.where(both_ways, -rate, 0.0)


@cache
def microstep_kernel(dims: int) -> Any:
    """Return the kernel for groups of up to `dims` rows."""
    vec = wp.types.vector(dims, wp.float32)
    tangents = dims - 1
    friction = wp.types.vector(tangents, wp.float32)
    propagators = wp.types.matrix((tangents, 4), wp.float32)

    def run_microsteps(
        microsteps: int,
        timestep: wp.array(dtype=wp.float32),
        recovery_speed: wp.array(dtype=wp.float32),
        rows: Rows,
    ):
        world, g = wp.tid()
        count = rows.count[world]
        active = g < count
        T = timestep[world % timestep.shape[0]]
        h = T / float(microsteps)
        speed = recovery_speed[world % recovery_speed.shape[0]]
        recovery = wp.max(LEAST_RECOVERY, RECOVERY_STEPS * T)
        kind = int(0)
        k0 = float(0.0)
        d0 = float(0.0)
        limit = float(0.0)
        offset = float(0.0)
        noise = float(0.0)
        bearable = float(0.0)
        surface = float(0.0)
        sticks = bool(False)
        u = vec(0.0)
        base = vec(0.0)
        c = vec(0.0)
        w = vec(0.0)
        force = vec(0.0)
        p = vec(0.0)
        r = vec(0.0)
        total = vec(0.0)
        moment = vec(0.0)
        moved = vec(0.0)
        inverse_mu = friction(0.0)
        kt = friction(0.0)
        dt = friction(0.0)
        slip = friction(0.0)
        relaxes = friction(0.0)
        es = propagators()
        e = vec4(0.0)
        if active:
            kind = rows.kind[world, g]
            limit = rows.limit[world, g]
            offset = rows.offset[world, g]
            noise = rows.slack[world, g]
            bearable = rows.bearable[world, g]
            k0 = rows.k[world, 0, g]
            d0 = rows.d[world, 0, g]
            for i in range(wp.static(dims)):
                turning = rows.turning[world, i, g]
                u[i] = rows.u[world, i, g] - 0.5 * T * turning
                c[i] = rows.c[world, i, g] + turning
                base[i] = rows.x[world, i, g]
                moved[i] = rows.rest[world, i, g]
                w[i] = rows.w[world, i, g]
            e = propagate_later(w[0] * d0, w[0] * k0, h)
            largest = float(0.0)
            for i in range(wp.static(tangents)):
                mu = rows.mu[world, i + 1, g]
                if mu > 0.0:
                    kt[i] = rows.k[world, i + 1, g]
                    dt[i] = rows.d[world, i + 1, g]
                    inverse_mu[i] = 1.0 / mu
                    of_row = propagate_later(w[i + 1] * dt[i], w[i + 1] * kt[i], h)
                    for j in range(wp.static(4)):
                        es[i, j] = of_row[j]
                    response = dt[i] * of_row[0] + kt[i] * of_row[1]
                    slip[i] = response * inverse_mu[i] * inverse_mu[i]
                    largest = wp.max(largest, slip[i])
                    if dt[i] > 0.0:
                        relaxes[i] = wp.exp(-kt[i] * h / dt[i])
            if largest > 0.0:
                slip = slip / largest
            surface = offset_rate(offset, noise, base[0], bearable, recovery, speed, kind > 1)
        for _step in range(microsteps):
            if active:
                # The force every row has now.
                x = base + moved
                force[0] = -k0 * x[0] - d0 * (u[0] - surface)
                if kind > int(UNILATERAL):
                    force[0] = wp.clamp(force[0], -limit, limit)
                elif x[0] >= 0.0:
                    force[0] = 0.0
                else:
                    force[0] = wp.max(0.0, force[0])
                trial = friction(0.0)
                square = float(0.0)
                if kind == 0 and force[0] > 0.0:
                    for i in range(wp.static(tangents)):
                        trial[i] = -kt[i] * x[i + 1] - dt[i] * u[i + 1]
                        z = trial[i] * inverse_mu[i]
                        square += z * z
                    if square > force[0] * force[0]:
                        # As the slip of the micro-step to come has it under the present load.
                        scale = force[0] / wp.sqrt(square)
                        coming = friction(0.0)
                        square_coming = float(0.0)
                        for i in range(wp.static(tangents)):
                            load = -w[i + 1] * trial[i] * scale
                            flow = flow_spring(kt[i], dt[i], es[i], x[i + 1], u[i + 1], load)
                            coming[i] = flow[0]
                            z = coming[i] * inverse_mu[i]
                            square_coming += z * z
                        if square_coming > 0.0:
                            trial = coming * wp.sqrt(square / square_coming)
                        trial = return_to_limit(trial, inverse_mu, slip, force[0])
                for i in range(wp.static(tangents)):
                    force[i + 1] = trial[i]
                for i in range(wp.static(dims)):
                    rows.force[world, i, g] = force[i]
            barrier()
            loads = vec(0.0)
            if active:
                x = base + moved
                for i in range(wp.static(dims)):
                    loads[i] = c[i] - w[i] * force[i]
                for other in range(count):
                    for j in range(wp.static(dims)):
                        f = rows.force[world, j, other]
                        if f != 0.0:
                            for i in range(wp.static(dims)):
                                loads[i] += rows.A[world, other * wp.static(dims) + j, i, g] * f
                if kind > int(UNILATERAL):
                    flow = flow_spring(k0, d0, e, x[0], u[0] - surface, loads[0])
                    most = limit * h
                    p[0] = wp.clamp(flow[0], -most, most)
                    sticks = p[0] == flow[0]
                    r[0] = wp.where(sticks, flow[1], 0.5 * h * p[0])
                else:
                    flow = flow_normal(k0, d0, w[0], e, x[0], u[0] - surface, loads[0], h)
                    p[0] = flow[0]
                    r[0] = flow[1]
                    trial = friction(0.0)
                    square = float(0.0)
                    if kind == 0 and p[0] > 0.0:
                        for i in range(wp.static(tangents)):
                            flow = flow_spring(
                                kt[i], dt[i], es[i], x[i + 1], u[i + 1], loads[i + 1]
                            )
                            trial[i] = flow[0]
                            r[i + 1] = flow[1]
                            z = flow[0] * inverse_mu[i]
                            square += z * z
                    sticks = p[0] > 0.0 and square <= p[0] * p[0]
                    if p[0] > 0.0 and not sticks:
                        trial = return_to_limit(trial, inverse_mu, slip, p[0])
                    for i in range(wp.static(tangents)):
                        p[i + 1] = trial[i]
                        if not sticks:
                            r[i + 1] = wp.where(p[0] > 0.0, trial[i] * r[0] / p[0], 0.0)
                for i in range(wp.static(dims)):
                    rows.impulse[world, i, g] = p[i]
            barrier()
            if active:
                change = h * c
                for other in range(count):
                    for j in range(wp.static(dims)):
                        q = rows.impulse[world, j, other]
                        if q != 0.0:
                            for i in range(wp.static(dims)):
                                change[i] += rows.A[world, other * wp.static(dims) + j, i, g] * q
                for i in range(wp.static(dims)):
                    own = h * loads[i] + w[i] * p[i]
                    way = h * u[i] + 0.5 * h * h * loads[i] + w[i] * r[i]
                    way += wp.static(COUPLED_SHARE) * h * (change[i] - own)
                    u[i] += change[i]
                    moved[i] += way
                    moment[i] += h * total[i] + r[i]
                    total[i] += p[i]
                    # Deformations are base + moved: what is less than an ulp of them adds up too.
                    if i == 0 and (sticks or kind <= int(UNILATERAL)):
                        base[0] -= h * surface
                    elif not sticks:
                        stiffness = k0
                        fade = float(0.0)
                        if i == 0:
                            if d0 > 0.0:
                                fade = wp.exp(-k0 * h / d0)
                        else:
                            stiffness = kt[i - 1]
                            fade = relaxes[i - 1]
                        rest = float(0.0)
                        if stiffness > 0.0:
                            rest = -p[i] / (stiffness * h)
                        slipped = base[i] + (moved[i] - way)
                        base[i] = rest + fade * (slipped - rest) - moved[i]
                offset -= h * surface
                at = base[0] + moved[0]
                surface = offset_rate(offset, noise, at, bearable, recovery, speed, kind > 1)
        if active:
            for i in range(wp.static(dims)):
                rows.total[world, i, g] = total[i]
                rows.moment[world, i, g] = moment[i]
                rows.moved[world, i, g] = moved[i]
                rows.x[world, i, g] = base[i]
            rows.offset[world, g] = offset
            rows.sticks[world, g] = wp.where(sticks, 1, 0)

    run_microsteps.__qualname__ = f"run_microsteps_{dims}"
    module = wp.get_module(f"dashpot.warp.microsteps{dims}")
    module.options["enable_backward"] = False
    limits = {"cuda_max_registers": REGISTERS} if dims == 3 else {}
    return wp.kernel(run_microsteps, module=module, enable_backward=False, **limits)
