"""Searches by derivatives: trust-region least squares."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from dashpot.calibrate.residuals.candidates import SimulationError
from dashpot.calibrate.search.search import BUDGET_SPENT, LEVEL, Search
from dashpot.calibrate.search.trust_region import Minimum, minimise

Array = NDArray[np.float64]
# Relative changes at which least squares stops: of the cost, far below the half unit by which one
# standard error changes it, and of the point.
_COST_TOLERANCE = 1e-7
_STEP_TOLERANCE = 1e-8
# Weight of the distance from the start, in standard deviations per unit of the search coordinate:
# with it the Jacobian keeps full rank, which scipy's steps need, where residuals do not depend on
# an unknown, or only on a combination. It adds 5e-9 per squared unit to the cost.
_HOLD = 1e-4
# The smallest tolerance of a gradient that scipy takes: where residuals depend on nothing, it is 0.
_GRADIENT_TOLERANCE = float(np.finfo(np.float64).eps)


def least_squares(
    search: Search, start: Array, most_iterations: int, *, level: float = LEVEL
) -> tuple[Array, Array]:
    """Trust-region least squares with bounds: return its end and residuals.

    It ends where the cost of residuals of unit variance changes by less than `level`.

    Where initial states are given it is scipy's reflective method; where they are unknown, one that
    makes use of their Jacobian's zeros. A step to a point whose simulation fails is taken back, as
    one that raises the cost is.
    """
    objective = search.objective
    per_iteration = 2 * objective.parameters + objective.initial_size + 1
    # Evaluations of the residuals are counted; each usually comes with a Jacobian.
    iterations = min(max(1, search.budget.left // per_iteration), most_iterations)
    lower, upper = objective.bounds()
    # The reflective method needs a start inside; a thousandth of the range is inside.
    margin = np.where(np.isfinite(upper - lower), 1e-3 * (upper - lower), 0.0)
    start = np.clip(start, lower + margin, upper - margin)
    before = search.best_cost
    began = False

    def residuals(point: Array) -> Array:
        nonlocal began
        found = search.evaluate(point[None, :])[0] if began else search.evaluate_start(point)
        began = True
        return np.asarray(found)

    find = _arrow_least_squares if objective.initial_size else _dense_least_squares
    try:
        end = find(search, residuals, start, (lower, upper), iterations, level)
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


def _arrow_least_squares(
    search: Search,
    residuals: Callable[[Array], Array],
    start: Array,
    bounds: tuple[Array, Array],
    iterations: int,
    level: float,
) -> Minimum:
    lower, upper = (bound[: search.objective.parameters] for bound in bounds)
    return minimise(
        residuals,
        search.jacobian,
        start,
        (lower, upper),
        loss=search.loss,
        hold=_HOLD,
        most_evaluations=iterations,
        cost_tolerance=_COST_TOLERANCE,
        level_tolerance=level,
        step_tolerance=_STEP_TOLERANCE,
    )


def _dense_least_squares(
    search: Search,
    residuals: Callable[[Array], Array],
    start: Array,
    bounds: tuple[Array, Array],
    iterations: int,
    level: float,
) -> Minimum:
    hold = _HOLD * np.eye(start.size)
    result = optimize.least_squares(
        lambda point: np.append(residuals(point), _HOLD * (point - start)),
        start,
        jac=lambda point: np.vstack([search.jacobian(point).dense(), hold]),
        bounds=bounds,
        method="trf",
        x_scale="jac",
        loss=search.loss.name,
        f_scale=search.loss.scale,
        max_nfev=iterations,
        ftol=_COST_TOLERANCE,
        xtol=_STEP_TOLERANCE,
        gtol=_GRADIENT_TOLERANCE,
    )
    found = np.asarray(result.fun[: -start.size])
    return Minimum(np.asarray(result.x), found, bool(result.status > 0), str(result.message))
