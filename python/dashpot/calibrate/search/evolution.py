"""Searches without derivatives: CMA-ES."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.search.search import BUDGET_SPENT, Search

Array = NDArray[np.float64]
# First standard deviation of CMA-ES as a share of the ranges: from a start that says little, and
# from the estimate of a shorter window.
FIRST_SIGMA = 0.2
LATER_SIGMA = 0.07
# A valley counts as found when costs of a generation differ by less than a tenth of a squared
# standard deviation, or its points by less than this share of the ranges.
_VALLEY_COST = 0.1
_VALLEY_WIDTH = 3e-3


def cma_es(
    search: Search,
    start: Array,
    seed: int,
    sigma: float = FIRST_SIGMA,
    *,
    to_convergence: bool = True,
) -> None:
    """Covariance-matrix-adaptation evolution strategy over the parameters' ranges.

    Initial states stay as in `start`. Each generation is one parallel batch. `sigma` is the first
    standard deviation as a share of the ranges. Without `to_convergence` it stops once the valley
    is found. Candidates whose simulation fails rank behind all others, the far ones last; where all
    do, it is an error.
    """
    import cma

    objective = search.objective
    count = objective.parameters
    ranges = np.array([c.sampling_bounds for c in objective.coordinates])
    low, width = ranges[:, 0], ranges[:, 1] - ranges[:, 0]
    options = {
        "bounds": [0.0, 1.0],
        "seed": seed + 1,  # 0 would mean the clock
        "verbose": -9,
        "tolfun": 1e-9 if to_convergence else _VALLEY_COST,
        "tolx": 1e-6 if to_convergence else _VALLEY_WIDTH,
    }
    if count == 1:
        # The strategy is undefined in one dimension; an idle second coordinate stands in.
        ranges = np.vstack([ranges, [0.0, 1.0]])
        low, width = ranges[:, 0], ranges[:, 1] - ranges[:, 0]
    first = np.full(len(low), 0.5)
    first[:count] = np.clip((start[:count] - low[:count]) / width[:count], 0.02, 0.98)
    strategy = cma.CMAEvolutionStrategy(first, sigma, options)
    worst = 0.0
    while search.budget.left >= strategy.popsize and not strategy.stop():
        candidates = strategy.ask()
        points = np.repeat(start[None, :], len(candidates), axis=0)
        for i, candidate in enumerate(candidates):
            points[i, :count] = low[:count] + np.asarray(candidate)[:count] * width[:count]
        costs = search.costs(search.evaluate(points))
        fails = ~np.isfinite(costs)
        worst = max(worst, costs[~fails].max(initial=worst))
        distance = np.linalg.norm(np.asarray(candidates) - first, axis=1)
        costs[fails] = (1.0 + worst) * (2.0 + distance[fails])
        strategy.tell(candidates, costs.tolist())
    search.raise_if_all_failed()
    stops = strategy.stop()
    search.converged = bool(stops)
    search.message = ", ".join(stops) if stops else BUDGET_SPENT
