"""Derivatives by finite differences, also next to points that cannot be simulated."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.residuals.candidates import SimulationError

Array = NDArray[np.float64]
# Residuals (k, m) of points (k, n), infinite where one fails, and why those fail.
Attempt: TypeAlias = Callable[[Array], tuple[Array, list[SimulationError]]]

# Where simulations fail on both sides of a point, differences are narrowed by this factor, so often
# at most.
_NARROWER = 4.0
_MOST_FAILURES = 3


def derivatives_along(
    attempt: Attempt, point: Array, up: Array, down: Array, base: Array | None
) -> Array:
    """Return the derivatives (directions, m) of residuals along ``up - down``.

    Parameters
    ----------
    attempt
        Residuals of points.
    point
        (n,) where the derivatives are those of.
    up, down
        (directions, n) and (that or fewer, n): points on both sides. Differences are central, and
        one-sided where `down` has no more, where one side is `point`, or fails; where both fail
        they are narrower.
    base
        (m,) residuals at `point`, where known, as they must be where `down` has fewer.

    Raises
    ------
    SimulationError
        Where narrower differences fail too.
    """
    residuals, failures = attempt(np.concatenate([up, down]))
    plus, minus = residuals[: len(up)], residuals[len(up) :]
    above, below = (np.abs(end - point).max(axis=1, initial=0.0) for end in (up, down))
    missing = len(up) - len(down)
    if missing and base is not None:
        minus = np.concatenate([minus, np.repeat(base[None], missing, axis=0)])
        below = np.append(below, np.zeros(missing))
        down = np.concatenate([down, np.repeat(point[None], missing, axis=0)])
    if not failures:
        return np.asarray((plus - minus) / (above + below)[:, None])
    if base is None:
        base = required(attempt, point)
    derivatives = np.empty_like(plus)
    for k in range(len(up)):
        above_works, below_works = np.isfinite(plus[k]).all(), np.isfinite(minus[k]).all()
        if above_works and below_works:
            derivatives[k] = (plus[k] - minus[k]) / (above[k] + below[k])
        elif above_works and above[k] > 0.0:
            derivatives[k] = (plus[k] - base) / above[k]
        elif below_works and below[k] > 0.0:
            derivatives[k] = (base - minus[k]) / below[k]
        else:
            derivatives[k] = _narrow(attempt, point, up[k], down[k], base)
    return derivatives


def _narrow(attempt: Attempt, point: Array, up: Array, down: Array, base: Array) -> Array:
    """Return the derivative along ``up - down``, both of which fail, from points nearer by."""
    for _ in range(_MOST_FAILURES):
        up, down = (point + (end - point) / _NARROWER for end in (up, down))
        ends, failures = attempt(np.stack([up, down]))
        for end, sign, residuals in ((up, 1.0, ends[0]), (down, -1.0, ends[1])):
            distance = np.abs(end - point).max()
            if distance > 0.0 and np.isfinite(residuals).all():
                return np.asarray(sign * (residuals - base) / distance)
    raise failures[0]


def required(attempt: Attempt, point: Array) -> Array:
    """Return the residuals (m,) of a point; raise the failure of one that fails."""
    residuals, failures = attempt(point[None, :])
    if failures:
        raise failures[0]
    return np.asarray(residuals[0])
