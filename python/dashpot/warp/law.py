"""The law of one row in single precision.

Equations, as in ``cpp/include/dashpot/law/kelvin_voigt.hpp`` (with ``propagator.hpp``) and
``cpp/include/dashpot/law/friction.hpp``, which this file mirrors. A contact with gap g (negative in
penetration), gap rate u, apparent inverse mass w and the acceleration b of the gap from everything
but its own force obeys::

    g'' = b + w f,    f = max(0, -k g - d g')  while g < 0,  else 0 .

With f0 = -k g0 - d u0 its impulse, the moment of that, and its state after a time t are::

    p = f0 E1 - (k u0 + d b) E2 - k b E3        u = u0 + b t + w p
    r = f0 E2 - (k u0 + d b) E3 - k b E4        g = g0 + u0 t + b t^2/2 + w r

    y'' + w d y' + w k y = t^(n-2)/(n-2)!,    y = E_n,   E_1 = E_2',   E_0 = E_1'
    E_n = t^n sum_j h_j / (n + j)!,   h_j = -(w d t) h_(j-1) - (w k t^2) h_(j-2),   h_0 = 1

The series alone is used: rows have ``w k t^2 <= 4`` and ``w d t <= 4``, where fourteen terms leave
less than single precision resolves. Friction impulses outside of the elliptic limit surface::

    sum_i (p_i / mu_i)^2 <= p_n^2

return to it along its normal, ``p_i = t_i / (1 + gamma c_i / mu_i^2)``, which dissipates most.

Within that range f' has one zero at most, so a release is bracketed without trigonometry: it lies
between the maximum of f, or the start, and the first place at which f is known to be negative.
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

TERMS = 14
ROUNDS = 24  # of a bracketed root: each halves the bracket or converges quadratically
EVENTS = 6  # onsets and releases within one micro-step
RETURNS = 12  # Newton rounds of the return to the limit surface
ON_SURFACE = 1.0e-6  # relative, at which the surface is met

vec2 = wp.types.vector(2, wp.float32)
vec4 = wp.types.vector(4, wp.float32)
vec5 = wp.types.vector(5, wp.float32)


@wp.func
def propagate(damping_rate: float, square_frequency: float, t: float) -> vec5:
    """E_0 to E_4 of a row with w d (1/s) and w k (1/s^2) after the time t (s)."""
    a = -damping_rate * t
    b = -square_frequency * t * t
    before = float(0.0)
    term = float(1.0)
    factorial3 = float(1.0 / 6.0)
    sum3 = float(0.0)
    sum4 = float(0.0)
    for j in range(wp.static(TERMS)):
        factorial4 = factorial3 / float(j + 4)
        sum3 += term * factorial3
        sum4 += term * factorial4
        following = a * term + b * before
        before = term
        term = following
        factorial3 = factorial4
    t2 = t * t
    e4 = t2 * t2 * sum4
    e3 = t2 * t * sum3
    e2 = 0.5 * t2 - damping_rate * e3 - square_frequency * e4
    e1 = t - damping_rate * e2 - square_frequency * e3
    e0 = 1.0 - damping_rate * e1 - square_frequency * e2
    return vec5(e0, e1, e2, e3, e4)


@wp.func
def propagate_later(damping_rate: float, square_frequency: float, t: float) -> vec4:
    """E_1 to E_4; E_0 = 1 - w d E_1 - w k E_2."""
    e = propagate(damping_rate, square_frequency, t)
    return vec4(e[1], e[2], e[3], e[4])


@wp.func
def release_time(
    f0: float,
    drive: float,
    kb: float,
    f1: float,
    q: float,
    wd: float,
    wk: float,
    end: float,
    force_at_end: float,
) -> float:
    """When the force f0 E0 - drive E1 - kb E2 falls through 0 within `end` (s), else -1."""
    low = float(0.0)
    high = float(end)
    if force_at_end >= 0.0:
        # Only a minimum inside can be negative: where f' = f1 E0 + q E1 rises through 0.
        e = propagate(wd, wk, end)
        if f1 >= 0.0 or f1 * e[0] + q * e[1] <= 0.0:
            return -1.0
        t = 0.5 * end
        for _ in range(wp.static(ROUNDS)):
            e = propagate(wd, wk, t)
            if f1 * e[0] + q * e[1] < 0.0:
                low = t
            else:
                high = t
            t = 0.5 * (low + high)
        e = propagate(wd, wk, t)
        if f0 * e[0] - drive * e[1] - kb * e[2] >= 0.0:
            return -1.0
        low = 0.0
        high = t
    t = 0.5 * (low + high)
    if f1 < 0.0:
        f2 = q - wd * f1
        root = wp.sqrt(wp.max(0.0, f1 * f1 - 2.0 * f0 * f2))
        guess = 2.0 * f0 / (root - f1)
        if guess > low and guess < high:
            t = guess
    last = high - low
    for _ in range(wp.static(ROUNDS)):
        e = propagate(wd, wk, t)
        f = f0 * e[0] - drive * e[1] - kb * e[2]
        slope = f1 * e[0] + q * e[1]
        if f >= 0.0:
            low = t
        else:
            high = t
        following = 0.5 * (low + high)
        if slope != 0.0:
            newton = t - f / slope
            if newton >= low and newton <= high and wp.abs(newton - t) <= 0.5 * last:
                following = newton
        last = wp.abs(following - t)
        t = following
        if last <= 1.2e-7 * t:
            break
    return t


@wp.func
def next_contact(k: float, d: float, g: float, u: float, b: float, would_be: float) -> vec2:
    """When contact begins next (s, -1 for never), and at which speed from g >= 0 (else -1)."""
    never = vec2(-1.0, -1.0)
    disc = u * u - 2.0 * b * g
    if g >= 0.0 or (u > 0.0 and disc >= 0.0):
        if u >= 0.0:
            if b >= 0.0:
                return never
        elif disc <= 0.0:
            return never
        speed = wp.sqrt(wp.max(0.0, disc))
        if u >= 0.0:
            return vec2((u + speed) / -b, speed)
        return vec2(2.0 * g / (speed - u), speed)
    # Released but overlapping: would_be + f1 t + f2 t^2/2 rises through 0.
    f1 = -(k * u + d * b)
    f2 = -k * b
    if f2 < 0.0 or (f2 == 0.0 and f1 <= 0.0):
        return never
    root = wp.sqrt(wp.max(0.0, f1 * f1 - 2.0 * would_be * f2))
    if f1 > 0.0:
        return vec2(-2.0 * would_be / (f1 + root), -1.0)
    return vec2((root - f1) / f2, -1.0)


@wp.func
def flow_events(
    k: float, d: float, w: float, gap: float, rate: float, b: float, time: float
) -> vec2:
    """Impulse and moment over `time` (s), with the events inside it solved one by one."""
    wd = w * d
    wk = w * k
    g = float(gap)
    u = float(rate)
    remaining = float(time)
    impulse = float(0.0)
    moment = float(0.0)
    force = float(0.0)
    touching = bool(False)
    if g < 0.0:
        force = -k * g - d * u
        f1 = -(k * u + d * b)
        touching = force > 0.0 or (force == 0.0 and (f1 > 0.0 or (f1 == 0.0 and k * b < 0.0)))
    elif g == 0.0 and (u < 0.0 or (u == 0.0 and b < 0.0)):
        force = -d * u
        touching = True
    for event in range(wp.static(EVENTS)):
        if touching:
            drive = k * u + d * b
            f1 = -drive - wd * force
            q = -k * (b + w * force)
            e = propagate(wd, wk, remaining)
            end = force * e[0] - drive * e[1] - k * b * e[2]
            duration = remaining
            released = bool(False)
            if event < wp.static(EVENTS) - 1:
                t = release_time(force, drive, k * b, f1, q, wd, wk, remaining, end)
                if t >= 0.0:
                    released = True
                    duration = t
                    e = propagate(wd, wk, t)
            p = wp.max(0.0, force * e[1] - drive * e[2] - k * b * e[3])
            r = wp.max(0.0, force * e[2] - drive * e[3] - k * b * e[4])
            moment += impulse * duration + r
            impulse += p
            g_end = g * (e[0] + wd * e[1]) + u * e[1] + b * e[2]
            u = u * e[0] + (b - wk * g) * e[1]
            g = g_end
            remaining -= duration
            if not released:
                remaining = 0.0
                break
            touching = False
            force = 0.0
        else:
            start = next_contact(k, d, g, u, b, force)
            if start[0] < 0.0 or start[0] >= remaining:
                break
            t = start[0]
            moment += impulse * t
            if start[1] >= 0.0:
                g = 0.0
                u = -start[1]
                force = d * start[1]
            else:
                g += t * (u + 0.5 * b * t)
                u += b * t
                force = 0.0
            remaining -= t
            touching = True
    moment += impulse * remaining
    return vec2(impulse, moment)


@wp.func
def flow_normal(
    k: float, d: float, w: float, e: vec4, x: float, u: float, b: float, h: float
) -> vec2:
    """Impulse and moment of a contact over a micro-step h (s), whose E_1 to E_4 are e."""
    wk = w * k
    e0 = 1.0 - w * d * e[0] - wk * e[1]
    f0 = -k * x - d * u
    drive = k * u + d * b
    f1 = -drive - w * d * f0
    q = -k * (b + w * f0)
    f2 = q - w * d * f1
    end = f0 * e0 - drive * e[0] - k * b * e[1]
    both = f0 + end
    far = both * both * wk >= h * h * (f1 * f1 * wk + f2 * f2)
    lasts = far or f1 >= 0.0 or f1 * e0 + q * e[0] <= 0.0
    if x < 0.0 and f0 > 0.0 and end >= 0.0 and lasts:
        p = f0 * e[0] - drive * e[1] - k * b * e[2]
        r = f0 * e[1] - drive * e[2] - k * b * e[3]
        return vec2(wp.max(p, 0.0), wp.max(r, 0.0))
    if x + h * wp.min(0.0, wp.min(u, u + h * b)) > 0.0:
        return vec2(0.0, 0.0)
    return flow_events(k, d, w, x, u, b, h)


@wp.func
def flow_spring(k: float, d: float, e: vec4, x: float, u: float, b: float) -> vec2:
    """Impulse and moment of a spring and damper of either sign, whose E_1 to E_4 are e."""
    f0 = -k * x - d * u
    drive = k * u + d * b
    return vec2(f0 * e[0] - drive * e[1] - k * b * e[2], f0 * e[1] - drive * e[2] - k * b * e[3])


@wp.func
def return_to_limit(trial: Any, inverse_mu: Any, slip: Any, pressure: float):
    """Friction on or inside the limit surface of a normal impulse `pressure` > 0.

    `slip` holds c / mu^2, of which only the proportions matter, the largest being 1.
    """
    gamma = float(0.0)
    length = float(0.0)
    returned = trial
    for _ in range(wp.static(RETURNS)):
        square = float(0.0)
        slope = float(0.0)
        for i in range(wp.static(5)):
            if i < len(trial):
                shrink = 1.0 / (1.0 + gamma * slip[i])
                returned[i] = trial[i] * shrink
                z = returned[i] * inverse_mu[i] / pressure
                square += z * z
                slope += z * z * slip[i] * shrink
        length = wp.sqrt(square)
        if length - 1.0 <= wp.static(ON_SURFACE) or slope <= 0.0:
            break
        gamma += (length - 1.0) * square / slope
    if length > 1.0:
        returned = returned / length
    return returned
