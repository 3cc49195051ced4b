"""In which order a fit searches: starts, windows, methods."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.objective import Objective
from dashpot.calibrate.search import (
    FIRST_SIGMA,
    LATER_SIGMA,
    Budget,
    LossName,
    Search,
    cma_es,
    least_squares,
    spread_starts,
)

Array = NDArray[np.float64]
Method = Literal["least_squares", "cma", "cma+least_squares"]

# A minimum counts as explained by the stated noise, and no further start is searched from, when its
# residual variance is below 1 plus this many standard deviations of the variance of normal noise.
_EXPLAINED = 3.0
# Of one local search; those that need more are lost in a bad valley.
_MOST_ITERATIONS = 40


def run_searches(
    objectives: list[Objective],
    budget: Budget,
    loss: LossName,
    loss_scale: float,
    method: Method,
    starts: int,
    local_searches: int,
    seed: int,
) -> Search:
    """Run the searches that the options ask for; return that of the last window."""
    searches = [Search(objective, loss, loss_scale, budget) for objective in objectives]
    first, final = searches[0], searches[-1]
    begin = objectives[0].start()
    if method == "cma":
        point = spread_starts(first, begin, starts, seed, 1)[0]
        for stage, search in enumerate(searches):
            with budget.share(len(searches) - stage):
                cma_es(search, point, seed, FIRST_SIGMA if stage == 0 else LATER_SIGMA)
            point = search.best_point
        return final
    if method == "least_squares":
        points = spread_starts(first, begin, starts, seed, local_searches)
    else:
        with budget.share(2):
            cma_es(first, spread_starts(first, begin, starts, seed, 1)[0], seed)
        points = [first.best_point]
    _descend(searches, points)
    return final


def _descend(searches: list[Search], points: list[Array]) -> None:
    """Search all windows from one point after the other until noise explains what is left.

    An end in the first window that noise does not explain is a bad valley, or the model is not
    quite right: the next start is tried, and if none does better, the best such end goes on.
    """
    last = searches[-1]
    unfinished: list[tuple[float, Array]] = []
    for start in points:
        point, cost = least_squares(searches[0], start, _MOST_ITERATIONS)
        if len(searches) > 1 and not searches[0].explained(cost, _EXPLAINED):
            unfinished.append((cost, point))
        else:
            for search in searches[1:]:
                point, _ = least_squares(search, point, _MOST_ITERATIONS)
        if last.explained(last.best_cost, _EXPLAINED) or last.budget.left == 0:
            break
    if unfinished and not last.explained(last.best_cost, _EXPLAINED):
        point = min(unfinished, key=lambda end: end[0])[1]
        for search in searches[1:]:
            point, _ = least_squares(search, point, _MOST_ITERATIONS)
