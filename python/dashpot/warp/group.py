"""What a group does in a micro-step, as in ``cpp/include/dashpot/solve/microstep.hpp``.

A micro-step of length h, with rows u = J v::

    F    = force of every row now
    b    = c + A F - w F                      load on a row, its own share left out
    p, r = flow of the row over h             closed form, friction returned to its limit
    u'   = u + h c + A p
    x   += h u + h^2/2 b + w r + s h (u' - u - h b - w p),   s = 1/3

c includes the turn of the rows. A slipping spring relaxes, ``k s + d s' = -p/h``. Vectors have the
rows of a group, normal first; what belongs to friction alone has one entry less.
"""

from typing import Any

import warp as wp

from dashpot.warp.law import flow_normal, flow_spring, propagate_later, return_to_limit
from dashpot.warp.state import UNILATERAL, Rows

wp.set_module_options({"enable_backward": False})

COUPLED_SHARE = 1.0 / 3.0
LEAST_RECOVERY = 0.01  # s
RECOVERY_STEPS = 2.0

vec4 = wp.types.vector(4, wp.float32)


@wp.func_native("WP_TILE_SYNC();")
def barrier():
    """Wait for all lanes of the block, and see what they wrote."""
    ...


@wp.func
def recovery_time(T: float) -> float:
    """Within which unstressed penetration recovers (s)."""
    return wp.max(LEAST_RECOVERY, RECOVERY_STEPS * T)


@wp.func
def unstressed_rate(
    unstressed: float,
    noise: float,
    x: float,
    bearable: float,
    time: float,
    speed: float,
    both_ways: bool,
) -> float:
    """How fast unstressed penetration beyond noise recovers (m/s)."""
    beyond = wp.abs(unstressed) - noise
    if beyond <= 0.0 or x * x > bearable * bearable:
        return 0.0
    rate = wp.min(beyond / time, speed)
    if unstressed > 0.0:
        return rate
    return wp.where(both_ways, -rate, 0.0)


@wp.func
def row_of(es: Any, i: int) -> vec4:
    """E_1 to E_4 of a row of friction."""
    return vec4(es[i, 0], es[i, 1], es[i, 2], es[i, 3])


@wp.func
def force_now(
    kind: int,
    limit: float,
    k: float,
    d: float,
    surface: float,
    x: Any,
    u: Any,
    w: Any,
    kt: Any,
    dt: Any,
    inverse_mu: Any,
    slip: Any,
    es: Any,
) -> Any:
    """Find the forces of all rows."""
    force = 0.0 * x
    force[0] = -k * x[0] - d * (u[0] - surface)
    if kind > int(UNILATERAL):
        force[0] = wp.clamp(force[0], -limit, limit)
    elif x[0] >= 0.0:
        force[0] = 0.0
    else:
        force[0] = wp.max(0.0, force[0])
    if kind == 0 and force[0] > 0.0:
        trial = 0.0 * kt
        square = float(0.0)
        for i in range(wp.static(5)):
            if i < len(kt):
                trial[i] = -kt[i] * x[i + 1] - dt[i] * u[i + 1]
                z = trial[i] * inverse_mu[i]
                square += z * z
        if square > force[0] * force[0]:
            # As the slip of the micro-step to come has it under the present load.
            scale = force[0] / wp.sqrt(square)
            coming = 0.0 * kt
            square_coming = float(0.0)
            for i in range(wp.static(5)):
                if i < len(kt):
                    load = -w[i + 1] * trial[i] * scale
                    flow = flow_spring(kt[i], dt[i], row_of(es, i), x[i + 1], u[i + 1], load)
                    coming[i] = flow[0]
                    z = coming[i] * inverse_mu[i]
                    square_coming += z * z
            if square_coming > 0.0:
                trial = coming * wp.sqrt(square / square_coming)
            trial = return_to_limit(trial, inverse_mu, slip, force[0])
        for i in range(wp.static(5)):
            if i < len(kt):
                force[i + 1] = trial[i]
    return force


@wp.func
def flow_group(
    kind: int,
    limit: float,
    k: float,
    d: float,
    surface: float,
    e: vec4,
    x: Any,
    u: Any,
    w: Any,
    loads: Any,
    kt: Any,
    dt: Any,
    inverse_mu: Any,
    slip: Any,
    es: Any,
    h: float,
):
    """Impulses and moments of all rows over a micro-step, and whether friction holds."""
    p = 0.0 * x
    r = 0.0 * x
    sticks = bool(False)
    if kind > int(UNILATERAL):
        flow = flow_spring(k, d, e, x[0], u[0] - surface, loads[0])
        most = limit * h
        p[0] = wp.clamp(flow[0], -most, most)
        sticks = p[0] == flow[0]
        r[0] = wp.where(sticks, flow[1], 0.5 * h * p[0])
        return p, r, sticks
    flow = flow_normal(k, d, w[0], e, x[0], u[0] - surface, loads[0], h)
    p[0] = flow[0]
    r[0] = flow[1]
    if kind == 0 and p[0] > 0.0:
        trial = 0.0 * kt
        square = float(0.0)
        for i in range(wp.static(5)):
            if i < len(kt):
                flow = flow_spring(kt[i], dt[i], row_of(es, i), x[i + 1], u[i + 1], loads[i + 1])
                trial[i] = flow[0]
                r[i + 1] = flow[1]
                z = flow[0] * inverse_mu[i]
                square += z * z
        sticks = square <= p[0] * p[0]
        if not sticks:
            trial = return_to_limit(trial, inverse_mu, slip, p[0])
        for i in range(wp.static(5)):
            if i < len(kt):
                p[i + 1] = trial[i]
                if not sticks:
                    r[i + 1] = trial[i] * r[0] / p[0]
    return p, r, sticks


@wp.func
def slipped(base: float, moved: float, way: float, p: float, k: float, fade: float, h: float):
    """Deformation, less `moved`, of a spring that slipped in a micro-step."""
    rest = float(0.0)
    if k > 0.0:
        rest = -p / (k * h)
    before = base + (moved - way)
    return rest + fade * (before - rest) - moved


@wp.kernel
def begin(
    microsteps: int,
    timestep: wp.array(dtype=wp.float32),
    recovery_speed: wp.array(dtype=wp.float32),
    rows: Rows,
):
    """Find what does not change from micro-step to micro-step; thread per group."""
    world, g = wp.tid()
    if g >= rows.count[world]:
        return
    T = timestep[world % timestep.shape[0]]
    h = T / float(microsteps)
    rows.surface[world, g] = unstressed_rate(
        rows.unstressed[world, g],
        rows.noise[world, g],
        rows.x[world, 0, g],
        rows.bearable[world, g],
        recovery_time(T),
        recovery_speed[world % recovery_speed.shape[0]],
        rows.kind[world, g] > 1,
    )
    largest = float(0.0)
    for i in range(rows.dim[world, g], rows.dims):
        rows.u[world, i, g] = 0.0
        rows.c[world, i, g] = 0.0
        rows.w[world, i, g] = 0.0
    for i in range(rows.dims):
        turning = rows.turning[world, i, g]
        rows.u[world, i, g] = rows.u[world, i, g] - 0.5 * T * turning
        rows.c[world, i, g] = rows.c[world, i, g] + turning
        rows.moved[world, i, g] = rows.rest[world, i, g]
        rows.total[world, i, g] = 0.0
        rows.moment[world, i, g] = 0.0
        k = rows.k[world, i, g]
        d = rows.d[world, i, g]
        w = rows.w[world, i, g]
        e = vec4(0.0)
        slip = float(0.0)
        fade = float(0.0)
        if i == 0 or rows.mu[world, i, g] > 0.0:
            e = propagate_later(w * d, w * k, h)
            if d > 0.0:
                fade = wp.exp(-k * h / d)
        if i > 0 and rows.mu[world, i, g] > 0.0:
            mu = rows.mu[world, i, g]
            slip = (d * e[0] + k * e[1]) / (mu * mu)
            largest = wp.max(largest, slip)
        for n in range(wp.static(4)):
            rows.e[world, 4 * i + n, g] = e[n]
        rows.slip[world, i, g] = slip
        rows.fade[world, i, g] = fade
    if largest > 0.0:
        for i in range(1, rows.dims):
            rows.slip[world, i, g] = rows.slip[world, i, g] / largest
