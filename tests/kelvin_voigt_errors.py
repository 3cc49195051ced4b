"""Errors of the closed-form flow of one contact against 60-digit references.

Errors are relative to the natural magnitude of each quantity over the interval: the speed that
start, load and stored compression can reach, and the compression, force and impulse that follow
from it. An impulse that comes late or is a small remainder of large terms is only defined to
rounding of those magnitudes, because the inputs are. A contact that holds throughout is measured
by its own amplitude, however long it lasts.
"""

from __future__ import annotations

import math

from mpmath import mpf

import kelvin_voigt_reference
from dashpot import law

TOLERANCE = 1e-11  # what the engine's targets need; measured errors are given in the tests


def scales(k, d, w, g, u, b, time, *, held=False):
    """Return natural magnitudes (impulse, moment, gap, rate, force) over the interval."""
    frequency = math.sqrt(w * k)
    within = time if frequency * time < 1.0 else 1.0 / frequency
    stored = frequency * max(0.0, -g)
    unsupported = abs(u) + abs(b) * time + stored
    speed = abs(u) + abs(b) * within + stored if held else unsupported
    depth = max(0.0, -g) + speed * within
    force = k * depth + d * speed
    impulse = min(force * time, unsupported / w)
    return impulse, impulse * time, depth if held else abs(g) + speed * time, speed, force


def flow(k, d, w, g, u, b, time):
    return law.flow_contact(g, u, b, time, stiffness=k, damping=d, inverse_mass=w)


def natural_errors(case):
    """Return the errors of (impulse, moment, gap, rate, force) in units of `scales`."""
    result, exact = flow(*case), kelvin_voigt_reference.flow(*case)
    natural = scales(*case, held=exact.events == 0 and exact.force > 0)
    return [
        float(abs(mpf(float(value)) - reference)) / scale if scale > 0.0 else 0.0
        for value, reference, scale in zip(result[:5], exact[:5], natural, strict=True)
    ]
