"""Searches by derivatives: trust-region least squares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.residuals.candidates import SimulationError
from dashpot.calibrate.search.search import BUDGET_SPENT, LEVEL, Search
from dashpot.calibrate.search.trust_region import minimise

Array = NDArray[np.float64]
# Relative changes at which least squares stops: of the cost, far below the half unit by which one
# standard error changes it, and of the point.
_COST_TOLERANCE = 1e-7
_STEP_TOLERANCE = 1e-8
# Weight of the distance from the start, in standard deviations per unit of the search coordinate:
# with it linear problems keep full rank where residuals do not depend on an unknown, or only on a
# combination. It adds 5e-9 per squared unit to the cost.
_HOLD = 1e-4
# A parameter moves by at most this in a step: a factor of 2.7 (log), or the range (linear). Without
# it one that the data hardly determine yet goes to its bound at once, where nothing may depend on
# it.
_LONGEST_STEP = 1.0


def least_squares(
    search: Search, start: Array, most_iterations: int, *, level: float = LEVEL
) -> tuple[Array, Array]:
    """Trust-region least squares with bounds: return its end and residuals.

    It ends where the cost of residuals of unit variance changes by less than `level`.

    A step to a point whose simulation fails is taken back, as one that raises the cost is.
    """
    objective = search.objective
    # Evaluations of the residuals are counted; each but the last usually comes with a Jacobian.
    iterations = min(1 + max(0, search.budget.left - 1) // search.iteration, most_iterations)
    lower, upper = objective.bounds()
    start = np.clip(start, lower, upper)
    before = search.best_cost
    began = False

    def residuals(point: Array) -> Array:
        nonlocal began
        found = search.evaluate(point[None, :])[0] if began else search.evaluate_start(point)
        began = True
        return np.asarray(found)

    if objective.size == 0:
        found = residuals(start)
        search.converged, search.message = True, "nothing is to be fitted: all is frozen"
        return start, found
    try:
        end = minimise(
            residuals,
            search.jacobian,
            start,
            (lower[: objective.parameters], upper[: objective.parameters]),
            loss=search.loss,
            hold=_HOLD,
            longest=_LONGEST_STEP,
            most_evaluations=iterations,
            cost_tolerance=_COST_TOLERANCE,
            level_tolerance=level,
            step_tolerance=_STEP_TOLERANCE,
        )
    except SimulationError as error:
        if search.best_cost < before:
            search.converged, search.message = False, str(error)
        raise
    if search.best_cost < before or np.array_equal(end.point, search.best_point):
        search.converged = end.converged
        if search.converged:
            search.message = end.message
        elif iterations < most_iterations:
            search.message = BUDGET_SPENT
        else:
            search.message = f"one local search takes {most_iterations} iterations at most"
    return end.point, end.residuals
