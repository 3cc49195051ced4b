"""The searches: least squares by derivatives, CMA-ES without, and spread starts."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from dashpot.calibrate.arrow import ArrowMatrix
from dashpot.calibrate.budget import Budget
from dashpot.calibrate.candidates import SimulationError
from dashpot.calibrate.losses import Loss
from dashpot.calibrate.objective import Objective
from dashpot.calibrate.trust_region import Minimum, minimise
from dashpot.calibrate.whiteness import whiteness

Array = NDArray[np.float64]
# Relative changes at which least squares stops: of the cost, far below the half unit by which one
# standard error changes it, and of the point.
_COST_TOLERANCE = 1e-7
_STEP_TOLERANCE = 1e-8
# Change of the cost, of residuals of unit variance, that counts as none where it is rough: a
# twenty-fifth of the half unit above, and more in windows whose ends are starts of the next.
LEVEL = 0.02
EARLY_LEVEL = 0.2
# Weight of the distance from the start, in standard deviations per unit of the search coordinate:
# with it the Jacobian keeps full rank, which scipy's steps need, where residuals do not depend on
# an unknown, or only on a combination. It adds 5e-9 per squared unit to the cost.
_HOLD = 1e-4
# The smallest tolerance of a gradient that scipy takes: where residuals depend on nothing, it is 0.
_GRADIENT_TOLERANCE = float(np.finfo(np.float64).eps)
_BUDGET_SPENT = "the budget of evaluations is spent"

# Residuals from so many standard deviations on are outliers to a robust loss (of normal noise one
# in 16,000), and the largest share of them beside which noise can explain the others, that which
# `identifiability.noise_explains` allows.
_OUTLYING = 4.0
_MOST_OUTLIERS = 0.1

# First standard deviation of CMA-ES as a share of the ranges: from a start that says little, and
# from the estimate of a shorter window.
FIRST_SIGMA = 0.2
LATER_SIGMA = 0.07
# A valley counts as found when costs of a generation differ by less than a tenth of a squared
# standard deviation, or its points by less than this share of the ranges.
_VALLEY_COST = 0.1
_VALLEY_WIDTH = 3e-3


class Search:
    """A search over one objective: the best point so far and its cost."""

    def __init__(self, objective: Objective, loss: Loss, budget: Budget) -> None:
        self.objective = objective
        self.loss = loss
        self.budget = budget
        self.best_point: Array = objective.start()
        self.best_residuals: Array = np.empty(0)
        self.best_cost = np.inf
        self.converged = False
        self.message = ""
        self._failure: SimulationError | None = None
        self._last: tuple[Array, Array] = np.empty(0), np.empty(0)

    def explained(self, residuals: Array, deviations: float) -> bool:
        """Whether normal noise of the stated size explains the cost of residuals.

        Twice the cost is then about the number of degrees of freedom times the mean loss of unit
        normal noise, to within so many of its standard deviations, or less. That tells little where
        noise is stated too large, so residuals have to be white, too. Robust losses are for data
        with outliers: up to a tenth of the residuals may be far off, and the others are judged
        alone.
        A bad valley that leaves noise and no more in nine tenths of the residuals is not told from
        these, nor is it by the loss.
        """
        counted = self.objective.live(residuals)
        noisy = residuals[counted]
        if not np.isfinite(noisy).all():
            return False
        if self.loss.robust:
            counted &= np.abs(residuals) < _OUTLYING
            if np.count_nonzero(counted) < (1.0 - _MOST_OUTLIERS) * len(noisy):
                return False
            noisy = residuals[counted]
        degrees = max(1, len(noisy) - self.objective.unknowns)
        mean, variance = self.loss.normal_moments()
        limit = degrees * mean + deviations * np.sqrt(degrees * variance)
        if self.loss.values(noisy).sum() >= limit:
            return False
        return whiteness(self.objective, residuals, counted).holds(deviations)

    def best_explained(self, deviations: float) -> bool:
        """Whether noise explains the best point so far, as `explained` says."""
        return self.best_residuals.size > 0 and self.explained(self.best_residuals, deviations)

    def end_where_level(self, before: float) -> None:
        """Count as converged where a whole search from a point of cost `before` changes nothing."""
        tolerance = LEVEL * max(1.0, 2.0 * self.best_cost / self.best_residuals.size)
        if not self.converged and self.budget.left > 0 and before - self.best_cost < tolerance:
            self.converged, self.message = True, "the cost changes no more"

    def costs(self, residuals: Array) -> Array:
        """Return the cost of each row of `residuals`, infinite where the simulation failed."""
        costs = 0.5 * np.sum(self.loss.values(residuals), axis=-1)
        # Some losses are finite at infinity.
        return np.asarray(np.where(np.isfinite(residuals).all(axis=-1), costs, np.inf))

    def take_over(self, other: Search) -> None:
        """Go on with the end of another search over the same objective as the best point."""
        self.best_point, self.best_residuals = other.best_point, other.best_residuals
        self.best_cost = other.best_cost
        self.converged, self.message = other.converged, other.message

    def evaluate(self, points: Array) -> Array:
        """Return the residuals of `points`, infinite where one fails, keeping the best point."""
        before = self.objective.evaluations
        residuals, failures = self.objective.attempt(points)
        if failures:
            self._failure = failures[0]
        costs = self.costs(residuals)
        best = int(np.argmin(costs))
        if costs[best] < self.best_cost:
            self.best_cost, self.best_point = float(costs[best]), points[best].copy()
            self.best_residuals = residuals[best].copy()
        self._last = points[-1].copy(), residuals[-1]
        self.budget.note(self.objective.evaluations - before, self.best_cost)
        return residuals

    def evaluate_start(self, point: Array) -> Array:
        """Return the residuals of a point from which a search starts; raise where it fails."""
        residuals = self.evaluate(point[None, :])[0]
        if self._failure is not None and not np.isfinite(residuals).all():
            raise self._failure
        return np.asarray(residuals)

    def raise_if_all_failed(self) -> None:
        """Raise the last failure where no point evaluated so far has residuals."""
        if self._failure is not None and self.best_residuals.size == 0:
            raise self._failure

    def evaluate_valid(self, points: Array) -> tuple[Array, Array]:
        """Return those of `points` that do not fail, and their residuals.

        The first is the start that was given: where that fails, it is an error.
        """
        residuals = self.evaluate(points)
        valid = np.asarray(np.isfinite(residuals).all(axis=1))
        if self._failure is not None and not valid[0]:
            raise self._failure
        return points[valid], residuals[valid]

    def jacobian(self, point: Array) -> ArrowMatrix:
        """Return the Jacobian at `point`, reusing its residuals if they were the last evaluated."""
        before = self.objective.evaluations
        base = self._last[1] if np.array_equal(self._last[0], point) else None
        jacobian = self.objective.jacobian(point, base=base)
        self.budget.note(self.objective.evaluations - before, self.best_cost)
        return jacobian


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
            search.message = _BUDGET_SPENT
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
    search.message = ", ".join(stops) if stops else _BUDGET_SPENT
