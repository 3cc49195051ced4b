"""In which order a fit searches: starts, windows, methods."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext, suppress
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.automatic import growing_windows
from dashpot.calibrate.objective import Objective
from dashpot.calibrate.search import (
    FIRST_SIGMA,
    LATER_SIGMA,
    Budget,
    LossName,
    Search,
    best_starts,
    cma_es,
    least_squares,
    sobol_points,
    spread_starts,
)

Array = NDArray[np.float64]
Method = Literal["least_squares", "cma", "cma+least_squares"]

# A minimum counts as explained by the stated noise, and no further start is searched from, when its
# residual variance is below 1 plus this many standard deviations of the variance of normal noise.
_EXPLAINED = 3.0
# Ends in the first window whose costs differ by less are the same valley: a hundredth of the half
# unit by which one standard error changes the cost.
_SAME_END = 0.005
# Further starts where the search from the given one ends in a bad valley, the given one included.
_AUTOMATIC_STARTS = 32
# One part of as many of the budget goes to the search from the given start.
_FIRST_SHARE = 4
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


def run_automatic(
    objective: Objective,
    budget: Budget,
    loss: LossName,
    loss_scale: float,
    local_searches: int,
    seed: int,
) -> Search:
    """Search from the given start; where noise does not explain its end, from further ones.

    These are spread over the parameters' ranges and searched through windows that grow from the
    onset of contact, with what the first search, of a quarter of the budget, has left; what they
    leave goes to the best end if it has not converged. Starts whose simulation fails are left out.
    """
    final = Search(objective, loss, loss_scale, budget)
    begin = objective.start()
    with budget.share(_FIRST_SHARE):
        least_squares(final, begin, _MOST_ITERATIONS)
    if final.explained(final.best_cost, _EXPLAINED) or budget.left < 2 * _AUTOMATIC_STARTS:
        return final
    scan = Search(objective, loss, loss_scale, budget)
    points = sobol_points(objective, begin, _AUTOMATIC_STARTS - 1, seed)
    points, residuals = scan.evaluate_valid(points)
    windows = growing_windows(objective, residuals)
    problem = objective.problem
    searches = [
        Search(
            Objective(problem.with_window(window), nthread=objective.nthread),
            loss,
            loss_scale,
            budget,
        )
        for window in windows
    ] + [final]
    starts = best_starts(searches[0] if windows else scan, points, local_searches)
    _descend(searches, starts, leave_failing_out=True)
    if not final.converged and budget.left > 0:
        least_squares(final, final.best_point, _MOST_ITERATIONS)
    return final


def _descend(
    searches: list[Search], points: list[Array], *, leave_failing_out: bool = False
) -> None:
    """Search all windows from one point after the other until noise explains what is left.

    An end in the first window that noise does not explain is a bad valley, or the model is not
    quite right: the next start is tried, and if none does better, the best such end goes on. An
    end that an earlier start reached too does not go on again.
    """
    last = searches[-1]

    def failing() -> AbstractContextManager[None]:
        return suppress(ValueError) if leave_failing_out else nullcontext()

    unfinished: list[tuple[float, Array]] = []
    finished: list[float] = []
    for start in points:
        with failing():
            point, cost = least_squares(searches[0], start, _MOST_ITERATIONS)
            if len(searches) > 1 and not searches[0].explained(cost, _EXPLAINED):
                unfinished.append((cost, point))
            elif all(abs(cost - end) > _SAME_END for end in finished):
                finished.append(cost)
                _go_on(searches[1:], point)
        if last.explained(last.best_cost, _EXPLAINED) or last.budget.left == 0:
            break
    if unfinished and not last.explained(last.best_cost, _EXPLAINED):
        with failing():
            _go_on(searches[1:], min(unfinished, key=lambda end: end[0])[1])


def _go_on(searches: list[Search], point: Array) -> None:
    """Search one window after the other, each from the estimate of the last."""
    for search in searches:
        point, _ = least_squares(search, point, _MOST_ITERATIONS)
