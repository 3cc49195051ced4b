"""Event-driven reference of one Kelvin-Voigt contact at 60 digits, in physical coordinates.

Shares no formula with the core: a contact phase is solved as ``g - b/(w k) = A exp(l1 t) + B
exp(l2 t)`` (the core uses entire functions of the force), releases are isolated by scanning the
signs of f and f' over a grid finer than every time constant, and impulse and moment follow from
the change of momentum and position.
"""

from __future__ import annotations

from typing import NamedTuple

from mpmath import mp, mpc, mpf

DIGITS = 60


class Reference(NamedTuple):
    """End of the interval, as mpmath numbers."""

    impulse: mpf
    moment: mpf
    gap: mpf
    rate: mpf
    force: mpf
    events: int


class _Phase:
    """Linear motion g'' = b - w (k g + d g') from (g0, u0); k > 0."""

    def __init__(self, k, d, w, b, g0, u0):
        self.k, self.d = k, d
        self.rest = b / (w * k)
        self.b, self.w = b, w
        alpha = w * d / 2
        delta = alpha**2 - w * k
        self.alpha = alpha
        self.omega = mp.sqrt(-delta) if delta < 0 else mpf(0)
        y0 = g0 - self.rest
        self.equal = delta == 0
        if self.equal:
            self.l1 = -alpha
            self.a1, self.a2 = y0, u0 + alpha * y0
        else:
            root = mp.sqrt(mpc(delta)) if delta < 0 else mp.sqrt(delta)
            self.l1 = -w * k / (alpha + root)
            self.l2 = -(alpha + root)
            if delta < 0:
                self.l1 = -alpha + root
                self.l2 = -alpha - root
            self.a1 = (u0 - self.l2 * y0) / (self.l1 - self.l2)
            self.a2 = (self.l1 * y0 - u0) / (self.l1 - self.l2)

    def state(self, t):
        """Return (gap, rate) at t."""
        if self.equal:
            e = mp.exp(self.l1 * t)
            y = (self.a1 + self.a2 * t) * e
            u = self.a2 * e + self.l1 * y
        else:
            first = self.a1 * mp.exp(self.l1 * t)
            second = self.a2 * mp.exp(self.l2 * t)
            y, u = first + second, self.l1 * first + self.l2 * second
        return self.rest + mp.re(y), mp.re(u)

    def force(self, t):
        g, u = self.state(t)
        return -self.k * g - self.d * u

    def force_and_rate(self, t):
        g, u = self.state(t)
        f = -self.k * g - self.d * u
        return f, -self.k * u - self.d * (self.b + self.w * f)

    def grid(self, end):
        """Return times up to `end` between which f has at most one extremum."""
        frequency = mp.sqrt(self.w * self.k)
        fast = self.alpha + mp.sqrt(max(mpf(0), self.alpha**2 - frequency**2)) + frequency
        times = []
        t = mpf("1e-3") / fast
        while t < end and t * fast < mpf(10) ** 7:
            times.append(t)
            t *= mpf("1.5")
        if self.omega > 0:
            # Later periods repeat the first two closer to rest.
            step = mp.pi / self.omega / 8
            times += [j * step for j in range(1, 33) if j * step < end]
        return [*sorted(times), end]

    def release(self, end):
        """Return the first time in (0, end] at which f falls through zero, or None."""
        before, (f_before, rate_before) = mpf(0), self.force_and_rate(mpf(0))
        for t in self.grid(end):
            f, rate = self.force_and_rate(t)
            low, high = before, t
            if f >= 0 and rate_before < 0 < rate:
                high = self._bisect(lambda s: self.force_and_rate(s)[1], before, t, rising=True)
                f_low = self.force(high)
            else:
                f_low = f
            if f_low < 0 and not (f_before == 0 and before == 0 and rate_before <= 0):
                if rate_before > 0:
                    low = self._bisect(
                        lambda s: self.force_and_rate(s)[1], before, high, rising=False
                    )
                return self._bisect(self.force, low, high, rising=False)
            before, f_before, rate_before = t, f, rate
        return None

    @staticmethod
    def _bisect(function, low, high, *, rising):
        """Root of a function with one sign change: bisection, then secant to full precision."""
        for _ in range(40):
            middle = (low + high) / 2
            if (function(middle) > 0) == rising:
                high = middle
            else:
                low = middle
        root, last = high, low
        f_root, f_last = function(root), function(last)
        for _ in range(10):
            if f_root == f_last:
                break
            following = root - f_root * (root - last) / (f_root - f_last)
            last, f_last = root, f_root
            root, f_root = following, function(following)
            if abs(root - last) < mpf(10) ** (-mp.dps + 5) * abs(root):
                break
        return root


def _next_contact(k, d, g, u, b):
    """Return (time, gap, rate) at which contact begins after free flight or release, or None."""
    if b >= 0 and u >= 0:
        return None
    disc = u * u - 2 * b * g
    if g >= 0 or (u > 0 and disc >= 0):
        if disc < 0 or (b > 0 and disc == 0):
            return None
        speed = mp.sqrt(disc)
        t = (u + speed) / -b if b < 0 else (2 * g / (speed - u))
        return t, mpf(0), -speed
    # -k g - d u over a free parabola, rising through zero.
    c2, c1, c0 = -k * b / 2, -k * u - d * b, -k * g - d * u
    t = (-c1 + mp.sqrt(c1 * c1 - 4 * c2 * c0)) / (2 * c2)
    return t, g + u * t + b * t * t / 2, u + b * t


def flow(stiffness, damping, inverse_mass, gap, rate, load, time) -> Reference:
    """Return the exact flow; arguments are floats, taken as exact."""
    with mp.workdps(DIGITS):
        k, d, w, g, u, b, remaining = (
            mpf(x) for x in (stiffness, damping, inverse_mass, gap, rate, load, time)
        )
        f0 = -k * g - d * u if g <= 0 else mpf(0)
        if g < 0:
            slope = -k * u - d * b - w * d * f0
            contact = f0 > 0 or (f0 == 0 and (slope > 0 or (slope == 0 and b < 0)))
        else:
            contact = g == 0 and (u < 0 or (u == 0 and b < 0))
        p = r = force = mpf(0)
        events = 0
        while True:
            if contact:
                phase = _Phase(k, d, w, b, g, u)
                release = phase.release(remaining)
                duration = remaining if release is None else release
                end_g, end_u = phase.state(duration)
                phase_p = (end_u - u - b * duration) / w
                r += p * duration + (end_g - g - u * duration - b * duration**2 / 2) / w
                p += phase_p
                g, u = end_g, end_u
                remaining -= duration
                if release is None:
                    force = -k * g - d * u
                    break
            else:
                start = _next_contact(k, d, g, u, b)
                if start is None or start[0] >= remaining:
                    g += u * remaining + b * remaining**2 / 2
                    u += b * remaining
                    r += p * remaining
                    break
                r += p * start[0]
                remaining -= start[0]
                _, g, u = start
            contact = not contact
            events += 1
        return Reference(p, r, g, u, force, events)
