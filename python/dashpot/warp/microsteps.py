"""All micro-steps of a step in one kernel: a block per world, a lane per group.

Worlds are solved in row space, coupled by blocks of A (`dashpot.warp.group` has the micro-step).
Lanes exchange F and p, with two barriers, and keep all else in registers. Contacts have up to three
rows; `dashpot.warp.sweeps` takes others, and more groups than a block has lanes.
"""

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
from dashpot.warp.state import UNILATERAL, Rows

DIMS = 3
REGISTERS = 168  # of a lane: three blocks of 128 lanes on a multiprocessor

wp.set_module_options({"enable_backward": False})

vec2 = wp.types.vector(2, wp.float32)
vec4 = wp.types.vector(4, wp.float32)
mat24 = wp.types.matrix((2, 4), wp.float32)


@wp.kernel(cuda_max_registers=REGISTERS)
def run_microsteps(
    microsteps: int,
    timestep: wp.array(dtype=wp.float32),
    recovery_speed: wp.array(dtype=wp.float32),
    rows: Rows,
):
    """Take all micro-steps of a world."""
    world, g = wp.tid()
    count = rows.count[world]
    active = g < count
    T = timestep[world % timestep.shape[0]]
    h = T / float(microsteps)
    speed = recovery_speed[world % recovery_speed.shape[0]]
    recovery = recovery_time(T)
    kind = int(0)
    k0 = float(0.0)
    d0 = float(0.0)
    fade0 = float(0.0)
    limit = float(0.0)
    unstressed = float(0.0)
    noise = float(0.0)
    bearable = float(0.0)
    surface = float(0.0)
    sticks = bool(False)
    u = wp.vec3(0.0)
    base = wp.vec3(0.0)
    c = wp.vec3(0.0)
    w = wp.vec3(0.0)
    p = wp.vec3(0.0)
    r = wp.vec3(0.0)
    total = wp.vec3(0.0)
    moment = wp.vec3(0.0)
    moved = wp.vec3(0.0)
    inverse_mu = vec2(0.0)
    kt = vec2(0.0)
    dt = vec2(0.0)
    slip = vec2(0.0)
    fade = vec2(0.0)
    es = mat24()
    e = vec4(0.0)
    if active:
        kind = rows.kind[world, g]
        limit = rows.limit[world, g]
        unstressed = rows.unstressed[world, g]
        noise = rows.noise[world, g]
        bearable = rows.bearable[world, g]
        surface = rows.surface[world, g]
        k0 = rows.k[world, 0, g]
        d0 = rows.d[world, 0, g]
        fade0 = rows.fade[world, 0, g]
        for i in range(3):
            u[i] = rows.u[world, i, g]
            c[i] = rows.c[world, i, g]
            base[i] = rows.x[world, i, g]
            moved[i] = rows.moved[world, i, g]
            w[i] = rows.w[world, i, g]
        for n in range(4):
            e[n] = rows.e[world, n, g]
        for i in range(2):
            mu = rows.mu[world, i + 1, g]
            if mu > 0.0:
                kt[i] = rows.k[world, i + 1, g]
                dt[i] = rows.d[world, i + 1, g]
                inverse_mu[i] = 1.0 / mu
                slip[i] = rows.slip[world, i + 1, g]
                fade[i] = rows.fade[world, i + 1, g]
                for n in range(4):
                    es[i, n] = rows.e[world, 4 * (i + 1) + n, g]
    for _step in range(microsteps):
        loads = wp.vec3(0.0)
        if active:
            x = base + moved
            force = force_now(kind, limit, k0, d0, surface, x, u, w, kt, dt, inverse_mu, slip, es)
            for i in range(3):
                rows.force[world, i, g] = force[i]
                loads[i] = c[i] - w[i] * force[i]
        barrier()
        if active:
            for other in range(count):
                for j in range(3):
                    f = rows.force[world, j, other]
                    if f != 0.0:
                        for i in range(3):
                            loads[i] += rows.A[world, other * 3 + j, i, g] * f
            x = base + moved
            p, r, sticks = flow_group(
                kind, limit, k0, d0, surface, e, x, u, w, loads, kt, dt, inverse_mu, slip, es, h
            )
            for i in range(3):
                rows.impulse[world, i, g] = p[i]
        barrier()
        if active:
            change = h * c
            for other in range(count):
                for j in range(3):
                    q = rows.impulse[world, j, other]
                    if q != 0.0:
                        for i in range(3):
                            change[i] += rows.A[world, other * 3 + j, i, g] * q
            for i in range(3):
                own = h * loads[i] + w[i] * p[i]
                way = h * u[i] + 0.5 * h * h * loads[i] + w[i] * r[i]
                way += wp.static(COUPLED_SHARE) * h * (change[i] - own)
                u[i] += change[i]
                moved[i] += way
                moment[i] += h * total[i] + r[i]
                total[i] += p[i]
                # Deformations are base + moved: what is less than an ulp of them adds up too.
                if i == 0:
                    if sticks or kind <= int(UNILATERAL):
                        base[0] -= h * surface
                    else:
                        base[0] = slipped(base[0], moved[0], way, p[0], k0, fade0, h)
                elif not sticks:
                    base[i] = slipped(base[i], moved[i], way, p[i], kt[i - 1], fade[i - 1], h)
            unstressed -= h * surface
            at = base[0] + moved[0]
            surface = unstressed_rate(unstressed, noise, at, bearable, recovery, speed, kind > 1)
    if active:
        for i in range(3):
            rows.total[world, i, g] = total[i]
            rows.moment[world, i, g] = moment[i]
            rows.moved[world, i, g] = moved[i]
            rows.x[world, i, g] = base[i]
        rows.unstressed[world, g] = unstressed
        rows.sticks[world, g] = wp.where(sticks, 1, 0)
