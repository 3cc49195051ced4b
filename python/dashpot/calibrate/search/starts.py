"""Points from which searches start, spread over the ranges of the parameters."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.residuals.objective import Objective
from dashpot.calibrate.search.search import Search

Array = NDArray[np.float64]


def sobol_points(objective: Objective, start: Array, count: int, seed: int) -> Array:
    """Return `start` and `count` points (count + 1, size) spread over the parameters' ranges."""
    from scipy.stats import qmc  # takes a third of a second to import

    sampler = qmc.Sobol(objective.parameters, rng=np.random.default_rng(seed))
    with warnings.catch_warnings():
        # Balance needs a power of two; starts need no balance.
        warnings.filterwarnings("ignore", message="The balance properties of Sobol")
        unit = sampler.random(count)
    points = np.repeat(start[None, :], count + 1, axis=0)
    for i, coordinate in enumerate(objective.coordinates):
        low, high = coordinate.sampling_bounds
        points[1:, i] = low + unit[:, i] * (high - low)
    return points


def spread_starts(search: Search, start: Array, count: int, seed: int, keep: int) -> list[Array]:
    """Return the `keep` best of `start` and `count` Sobol points of the parameters' ranges.

    Those whose simulation fails are left out; where that of `start` does, it is an error.
    """
    if count == 0:
        return [start]
    return best_starts(search, sobol_points(search.objective, start, count, seed), keep)


def best_starts(search: Search, points: Array, keep: int) -> list[Array]:
    """Return the `keep` points of lowest cost, ascending, of those that do not fail."""
    points, residuals = search.evaluate_valid(points)
    costs = search.costs(residuals)
    return [points[i] for i in np.argsort(costs, kind="stable")[:keep]]
