"""Starts for parameters on which residuals do not depend where a search ended.

Friction above what slips, or stiffness of a contact that is not reached, moves nothing: derivatives
are 0, and no local search leaves. Where noise does not explain such an end, the parameter is tried
over its range, others held, and searched on from where it begins to act.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.search.search import Search

Array = NDArray[np.float64]

# Values tried over the range, in the search coordinate.
_VALUES = 16
# A parameter is asleep where steps of this share of its range to both sides change all residuals
# together by less than these standard deviations.
_STEP = 0.01
_STILL = 1e-3


def waking_starts(search: Search) -> list[Array]:
    """Return points where single parameters act that do not at the best point, nearest first."""
    objective, best, reference = search.objective, search.best_point, search.best_residuals
    ranges = np.array([c.sampling_bounds for c in objective.coordinates])
    count = len(ranges)
    if search.budget.left < (2 + _VALUES) * count:
        return []
    steps = _STEP * np.diag(ranges[:, 1] - ranges[:, 0])
    near = np.repeat(best[None], 2 * count, axis=0)
    near[:, :count] += np.concatenate([steps, -steps])
    near[:, :count] = np.clip(near[:, :count], ranges[:, 0], ranges[:, 1])
    above, below = _changes(search, near, reference).reshape(2, count)
    starts: list[tuple[float, Array]] = []
    for i in np.flatnonzero(~(above | below)):
        low, high = ranges[i]
        tried = np.repeat(best[None], _VALUES, axis=0)
        tried[:, i] = np.linspace(low, high, _VALUES)
        ways = (tried[:, i] - best[i]) / (high - low)
        acting = _changes(search, tried, reference)
        for side in (-1.0, 1.0):
            found = [k for k in np.flatnonzero(acting) if side * ways[k] > 0.0]
            if found:
                nearest = min(found, key=lambda k: side * ways[k])
                starts.append((abs(float(ways[nearest])), tried[nearest]))
    return [point for _, point in sorted(starts, key=lambda entry: entry[0])]


def _changes(search: Search, points: Array, reference: Array) -> NDArray[np.bool_]:
    """Whether residuals at points are others than `reference`; not where one fails."""
    residuals = search.evaluate(points)
    works = np.isfinite(residuals).all(axis=1, keepdims=True)
    off = np.where(works, residuals, reference) - reference
    return np.asarray(np.linalg.norm(off, axis=1) > _STILL)
