"""A search: the best point so far, its cost, and whether noise explains it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.residuals.arrow import ArrowMatrix
from dashpot.calibrate.residuals.candidates import SimulationError
from dashpot.calibrate.residuals.losses import Loss
from dashpot.calibrate.residuals.objective import Objective
from dashpot.calibrate.residuals.whiteness import least_white, whiteness
from dashpot.calibrate.search.budget import Budget

Array = NDArray[np.float64]
# Change of the cost, of residuals of unit variance, that counts as none where it is rough: a
# twenty-fifth of the half unit by which one standard error changes it, and more in windows whose
# ends are starts of the next.
LEVEL = 0.02
EARLY_LEVEL = 0.2
BUDGET_SPENT = "the budget of evaluations is spent"

# Residuals from so many standard deviations on are outliers to a robust loss (of normal noise one
# in 16,000), and the largest share of them beside which noise can explain the others, that which
# `stated_noise.noise_explains` allows.
_OUTLYING = 4.0
_MOST_OUTLIERS = 0.1


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
        #: Lowest cost after each batch of points.
        self.history: list[float] = []
        self._failure: SimulationError | None = None
        self._last: tuple[Array, Array] = np.empty(0), np.empty(0)

    @property
    def iteration(self) -> int:
        """Evaluations of one iteration of least squares: of a point and of derivatives there."""
        return 2 * self.objective.parameters + self.objective.free_states.size + 1

    def explained(self, residuals: Array, deviations: float) -> bool:
        """Whether normal noise of the stated size explains the cost of residuals.

        Twice the cost is then about the number of degrees of freedom times the mean loss of unit
        normal noise, to within so many of its standard deviations, or less. That tells little where
        noise is stated too large, and nothing where it is to be estimated, so residuals have to be
        white, too. Robust losses are for data
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
        known = self.objective.problem.noise == "stated"
        if known and self.loss.values(noisy).sum() >= limit:
            return False
        return least_white(whiteness(self.objective, residuals, counted)).holds(deviations)

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
        self.history.append(self.best_cost)
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
