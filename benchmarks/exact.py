"""Closed-form references that scenes and tests compare with.

The bouncing Kelvin-Voigt ball: height of the lowest point ``g`` (m), mass ``m``, gravity ``G``::

    g'' = -G + f / m,    f = max(0, -k g - d g')  while g < 0,  else 0

Flight is a parabola, contact a damped oscillation about the sag ``-m G / k``. Both are closed
forms; the instants between them (onset, release at zero force) are roots, found here with mpmath.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from functools import cache

import mpmath as mp

DIGITS = 30


def restitution_of(damping_ratio: float) -> float:
    """Restitution of an unloaded Kelvin-Voigt impact that ends at zero force (ratio in [0, 1)).

    Schwager and Poeschel, Granular Matter 9 (2007) 465: with ``w0 = 1``, ``x = exp(-z t) sin(w t)
    / w`` the force ``x + 2 z x'`` vanishes first at ``tan(w t) = -2 z w / (1 - 2 z^2)``.
    """
    with mp.workdps(DIGITS):
        z = mp.mpf(damping_ratio)
        if z == 0:
            return 1.0
        w = mp.sqrt(1 - z * z)
        # atan2 picks the branch in (0, pi): sin > 0 there since the overlap is positive.
        phase = mp.atan2(2 * z * w, -(1 - 2 * z * z))
        t = phase / w
        rate = mp.exp(-z * t) * (mp.cos(phase) - z * mp.sin(phase) / w)
        return float(-rate)


@cache
def damping_ratio_of(restitution: float) -> mp.mpf:
    """Inverse of `restitution_of` to 25 digits by bisection, restitution in (0.14, 1]."""
    with mp.workdps(DIGITS):
        if restitution == 1:
            return mp.mpf(0)
        e = mp.mpf(restitution)

        def excess(z: mp.mpf) -> mp.mpf:
            w = mp.sqrt(1 - z * z)
            phase = mp.atan2(2 * z * w, -(1 - 2 * z * z))
            t = phase / w
            return -mp.exp(-z * t) * (mp.cos(phase) - z * mp.sin(phase) / w) - e

        return mp.findroot(excess, (mp.mpf("1e-12"), mp.mpf("0.999")), solver="anderson", tol=1e-50)


@dataclass(frozen=True)
class Phase:
    """One flight or contact: state at its start, in force until the next phase starts."""

    start: mp.mpf
    gap: mp.mpf
    rate: mp.mpf
    contact: bool


@dataclass(frozen=True)
class BouncingBall:
    """Exact motion of a ball dropped from `height` (m) at rest on a Kelvin-Voigt floor.

    Phases are found until `until` (s).
    """

    height: float
    stiffness: float
    damping: mp.mpf
    mass: float = 1.0
    gravity: float = 9.81
    until: float = 10.0
    phases: list[Phase] = field(default_factory=list)

    def __post_init__(self) -> None:
        with mp.workdps(DIGITS):
            phase = Phase(mp.mpf(0), mp.mpf(self.height), mp.mpf(0), False)
            while True:
                self.phases.append(phase)
                end = self._contact_end(phase) if phase.contact else self._flight_end(phase)
                if end is None or phase.start + end > self.until:
                    break
                gap, rate = self._flow(phase, end)
                phase = Phase(phase.start + end, gap, rate, not phase.contact)

    def _phase_at(self, time: float) -> Phase:
        return self.phases[bisect_right(self.phases, time, key=lambda phase: phase.start) - 1]

    def state(self, time: float) -> tuple[float, float]:
        """Gap (m) and gap rate (m/s) at `time` (s)."""
        with mp.workdps(DIGITS):
            t = mp.mpf(time)
            phase = self._phase_at(t)
            gap, rate = self._flow(phase, t - phase.start)
            return float(gap), float(rate)

    def energy(self, time: float) -> float:
        """Kinetic, gravitational and elastic energy (J) at `time` (s)."""
        gap, rate = self.state(time)
        phase = self._phase_at(time)
        elastic = 0.5 * self.stiffness * gap**2 if phase.contact else 0.0
        return 0.5 * self.mass * rate**2 + self.mass * self.gravity * gap + elastic

    def apices(self, count: int) -> list[tuple[float, float]]:
        """Time (s) and height (m) of the first `count` highest points after the drop.

        An apex may lie in a flight or, for the last small ones, inside a contact.
        """
        found: list[tuple[float, float]] = []
        with mp.workdps(DIGITS):
            ends = [p.start for p in self.phases[1:]] + [mp.mpf(self.until)]
            for phase, end in zip(self.phases[1:], ends[1:], strict=True):
                length = end - phase.start
                for t in self._rate_zeros(phase, length):
                    gap, _ = self._flow(phase, t)
                    found.append((float(phase.start + t), float(gap)))
                    if len(found) == count:
                        return found
        return found

    def _sag(self) -> mp.mpf:
        return mp.mpf(self.mass) * mp.mpf(self.gravity) / mp.mpf(self.stiffness)

    def _flow(self, phase: Phase, t: mp.mpf) -> tuple[mp.mpf, mp.mpf]:
        g = mp.mpf(self.gravity)
        if not phase.contact:
            return phase.gap + phase.rate * t - g * t * t / 2, phase.rate - g * t
        c = mp.mpf(self.damping) / (2 * mp.mpf(self.mass))
        w = mp.sqrt(mp.mpf(self.stiffness) / mp.mpf(self.mass) - c * c)
        x0, v0 = phase.gap + self._sag(), phase.rate
        a, b = x0, (v0 + c * x0) / w
        decay, cos, sin = mp.exp(-c * t), mp.cos(w * t), mp.sin(w * t)
        x = decay * (a * cos + b * sin)
        rate = decay * ((b * w - c * a) * cos - (a * w + c * b) * sin)
        return x - self._sag(), rate

    def _force(self, gap: mp.mpf, rate: mp.mpf) -> mp.mpf:
        return -mp.mpf(self.stiffness) * gap - mp.mpf(self.damping) * rate

    def _contact_end(self, phase: Phase) -> mp.mpf | None:
        """First zero of the force: scan in 1/200 periods of the damped cosine, then refine."""
        period = 2 * mp.pi * mp.sqrt(mp.mpf(self.mass) / mp.mpf(self.stiffness))
        step = period / 200
        t = step / 1000  # past the onset, where an undamped force starts at zero
        for _ in range(400):
            if self._force(*self._flow(phase, t + step)) < 0:
                return mp.findroot(
                    lambda s: self._force(*self._flow(phase, s)), (t, t + step), solver="anderson"
                )
            t += step
        return None

    def _flight_end(self, phase: Phase) -> mp.mpf | None:
        """Return to zero gap from above, or to positive force where the release was below it."""
        g = mp.mpf(self.gravity)
        u = phase.rate
        if phase.gap < 0:
            # In flight the force grows again as a quadratic that starts at zero.
            k, d = mp.mpf(self.stiffness), mp.mpf(self.damping)
            back = 2 * (k * u - d * g) / (k * g)
            if self._flow(phase, back)[0] < 0:
                return back
        return (u + mp.sqrt(u * u + 2 * g * phase.gap)) / g

    def _rate_zeros(self, phase: Phase, length: mp.mpf) -> list[mp.mpf]:
        """Instants within a phase where the rate falls through zero."""
        if not phase.contact:
            t = phase.rate / mp.mpf(self.gravity)
            return [t] if 0 < t < length else []
        zeros = []
        period = 2 * mp.pi * mp.sqrt(mp.mpf(self.mass) / mp.mpf(self.stiffness))
        t, step = mp.mpf(0), period / 50
        while t + step < length and len(zeros) < 20:
            before, after = self._flow(phase, t)[1], self._flow(phase, t + step)[1]
            if before > 0 >= after:
                zeros.append(
                    mp.findroot(lambda s: self._flow(phase, s)[1], (t, t + step), solver="anderson")
                )
            t += step
        return zeros
