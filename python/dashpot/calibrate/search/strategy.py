"""In which order a fit searches: starts, windows, methods."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.residuals.candidates import SimulationError
from dashpot.calibrate.residuals.losses import Loss
from dashpot.calibrate.residuals.objective import Objective
from dashpot.calibrate.search.automatic import growing_windows
from dashpot.calibrate.search.budget import Budget
from dashpot.calibrate.search.evolution import FIRST_SIGMA, LATER_SIGMA, cma_es
from dashpot.calibrate.search.least_squares import least_squares
from dashpot.calibrate.search.search import BUDGET_SPENT, EARLY_LEVEL, LEVEL, Search
from dashpot.calibrate.search.starts import best_starts, sobol_points, spread_starts
from dashpot.calibrate.search.waking import waking_starts

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
# Shares of what is left of the budget: of the search from the given start, of those from where
# parameters wake, and of those from further starts. What they leave is for the best end.
_GIVEN_SHARE, _WAKING_SHARE, _FURTHER_SHARE = 0.5, 0.25, 0.75
# Further starts are simulated where what is left makes so many iterations from them, as a search
# takes.
_ITERATIONS_WORTH = 20
# Of one local search; those that need more are lost in a bad valley.
MOST_ITERATIONS = 40


def run_searches(
    objectives: list[Objective],
    budget: Budget,
    loss: Loss,
    method: Method,
    starts: int,
    local_searches: int,
    seed: int,
) -> Search:
    """Run the searches that the options ask for; return that of the last window."""
    searches = [Search(objective, loss, budget) for objective in objectives]
    begin = objectives[0].start(robust=loss.robust)
    keep = local_searches if method == "least_squares" else 1
    points = spread_starts(searches[0], begin, starts, seed, keep)
    if method == "least_squares":
        _descend(searches, points)
        finish(searches[-1])
    else:
        _evolve(searches, points[0], method, seed)
    return searches[-1]


def run_automatic(
    objective: Objective,
    budget: Budget,
    loss: Loss,
    method: Method,
    local_searches: int,
    seed: int,
) -> Search:
    """Choose starts and windows: 31 starts spread over the parameters' ranges beside the given one.

    They are searched through windows that grow from the onset of contact. Least squares searches
    from the given start first, and from others only where noise does not explain its end: first
    from where parameters act that do not there. Each takes a share of what is left, and the best
    end goes on with the rest if it has not converged. A budget that does not suffice for a search
    from further starts is the given one's alone.
    """
    final = Search(objective, loss, budget)
    begin = objective.start(robust=loss.robust)
    if objective.parameters == 0:  # they are all frozen
        least_squares(final, begin, MOST_ITERATIONS)
        finish(final)
        return final
    worth = _AUTOMATIC_STARTS + _ITERATIONS_WORTH * final.iteration
    if method == "least_squares":
        share = _GIVEN_SHARE if (1.0 - _GIVEN_SHARE) * budget.left >= worth else 1.0
        with budget.share(share), _going_on(final):
            least_squares(final, begin, MOST_ITERATIONS)
        if not final.best_explained(_EXPLAINED):
            with budget.share(_WAKING_SHARE):
                _wake(final)
        if final.best_explained(_EXPLAINED) or budget.left < worth:
            finish(final)
            return final
    elif budget.left < 2 * _AUTOMATIC_STARTS:
        _evolve([final], begin, method, seed)
        return final
    scan = Search(objective, loss, budget)
    points = sobol_points(objective, begin, _AUTOMATIC_STARTS - 1, seed)
    points, residuals = scan.evaluate_valid(points)
    windows = growing_windows(objective, residuals)
    problem = objective.problem
    searches = [
        Search(
            objective.of(problem.with_window(window)),
            loss,
            budget,
        )
        for window in windows
    ] + [final]
    keep = local_searches if method == "least_squares" else 1
    starts = best_starts(searches[0] if windows else scan, points, keep)
    if method != "least_squares":
        _evolve(searches, starts[0], method, seed)
        return final
    with budget.share(_FURTHER_SHARE):
        _descend(searches, starts)
    finish(final)
    return final


def finish(search: Search) -> None:
    """Go on from the best end until it has converged, as on a rough cost, or nothing is left."""
    while not search.converged and search.budget.left > search.iteration:
        before = search.best_cost
        try:
            least_squares(search, search.best_point, MOST_ITERATIONS)
        except SimulationError:
            return
        if search.message != BUDGET_SPENT:
            search.end_where_level(before)


def _wake(search: Search) -> None:
    """Search on from where parameters act that do not at the best end, until noise explains one."""
    if search.best_residuals.size == 0 or search.budget.left == 0:
        return
    for start in waking_starts(search):
        with _going_on(search):
            least_squares(search, start, MOST_ITERATIONS)
        if search.best_explained(_EXPLAINED) or search.budget.left == 0:
            break


@contextmanager
def _going_on(search: Search) -> Iterator[None]:
    """Go on with the best point where a simulation fails; raise where there is none."""
    try:
        yield
    except SimulationError:
        if search.best_residuals.size == 0:
            raise


def _evolve(searches: list[Search], point: Array, method: Method, seed: int) -> None:
    """Search by CMA-ES: all windows in equal shares, or the first, and least squares from there."""
    searches[0].evaluate_start(point)
    if method == "cma+least_squares":
        with searches[0].budget.share(0.5):
            cma_es(searches[0], point, seed, to_convergence=len(searches) == 1)
        _descend(searches, [searches[0].best_point])
        return
    for stage, search in enumerate(searches):
        with search.budget.share(1.0 / (len(searches) - stage)):
            sigma = FIRST_SIGMA if stage == 0 else LATER_SIGMA
            cma_es(search, point, seed, sigma, to_convergence=search is searches[-1])
        point = search.best_point


def _descend(searches: list[Search], points: list[Array]) -> None:
    """Search all windows from one point after the other until noise explains what is left.

    An end in an earlier window that noise does not explain is a bad valley, or the model is not
    quite right: the next start is tried, and if none does better, such ends go on, those in later
    windows first and the best first. An end that an earlier start reached too does not go on
    again. Searches that a failing simulation ends are left out; where all are, it is an error.
    """
    last = searches[-1]
    failure: SimulationError | None = None
    ends = _Ends()
    for start in points:
        try:
            _go_on(searches, 0, start, ends)
        except SimulationError as error:
            failure = failure or error
        if last.best_explained(_EXPLAINED) or last.budget.left == 0:
            break
    while ends.bad and not last.best_explained(_EXPLAINED):
        # Without a budget one still tells what the best end is worth.
        window, _, point = ends.next()
        try:
            _go_on(searches, window + 1, point, None)
        except SimulationError as error:
            failure = failure or error
        if last.budget.left == 0 and last.best_residuals.size:
            break
    if failure is not None and last.best_residuals.size == 0:
        raise failure


class _Ends:
    """Ends of searches in earlier windows: all costs by window, and the bad ends to go on from."""

    def __init__(self) -> None:
        self.bad: list[tuple[int, float, Array]] = []
        self._costs: dict[int, list[float]] = {}

    def new(self, window: int, cost: float) -> bool:
        """Note the cost of an end in a window; return whether there was none of the same before."""
        costs = self._costs.setdefault(window, [])
        same = any(abs(cost - other) <= _SAME_END for other in costs)
        costs.append(cost)
        return not same

    def next(self) -> tuple[int, float, Array]:
        """Take the best of the bad ends in the latest window; return window, cost and point."""
        latest = max(window for window, _, _ in self.bad)
        best = min(
            (i for i, end in enumerate(self.bad) if end[0] == latest),
            key=lambda i: self.bad[i][1],
        )
        return self.bad.pop(best)


def _go_on(searches: list[Search], first: int, point: Array, ends: _Ends | None) -> None:
    """Search one window after the other from `first` on, each from the end of the last.

    With `ends`, only from ends that are new and that noise explains; bad ones are noted there.
    """
    for window in range(first, len(searches)):
        search = searches[window]
        early = window < len(searches) - 1
        level = EARLY_LEVEL if early else LEVEL
        point, residuals = least_squares(search, point, MOST_ITERATIONS, level=level)
        if ends is None or not early:
            continue
        cost = float(search.costs(residuals))
        if not ends.new(window, cost):
            return
        if not search.explained(residuals, _EXPLAINED):
            ends.bad.append((window, cost, point))
            return
