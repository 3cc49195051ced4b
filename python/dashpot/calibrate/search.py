"""The searches: least squares by derivatives, CMA-ES without, and spread starts."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from scipy.stats import qmc

from dashpot.calibrate.objective import Objective

Array = NDArray[np.float64]
LossName = Literal["linear", "soft_l1", "huber", "cauchy", "arctan"]


def loss_values(loss: LossName, squares: Array) -> Array:
    """Return rho(squares), as scipy.optimize.least_squares defines its losses with scale 1."""
    if loss == "linear":
        return squares
    if loss == "soft_l1":
        return 2.0 * (np.sqrt(1.0 + squares) - 1.0)
    if loss == "huber":
        return np.where(squares <= 1.0, squares, 2.0 * np.sqrt(squares) - 1.0)
    if loss == "cauchy":
        return np.log1p(squares)
    return np.arctan(squares)


def loss_weights(loss: LossName, squares: Array) -> Array | None:
    """Return rho'(squares), None for the linear loss."""
    if loss == "linear":
        return None
    if loss == "soft_l1":
        return 1.0 / np.sqrt(1.0 + squares)
    if loss == "huber":
        return np.where(squares <= 1.0, 1.0, 1.0 / np.sqrt(np.maximum(squares, 1.0)))
    if loss == "cauchy":
        return 1.0 / (1.0 + squares)
    return 1.0 / (1.0 + squares**2)


@dataclass
class Search:
    """A search in progress: the best point so far, its cost and the budget.

    `max_evaluations` bounds the simulated sets of trajectories, those for derivatives included,
    to within one Jacobian.
    """

    objective: Objective
    loss: LossName
    loss_scale: float
    max_evaluations: int
    report: Callable[[int, float], None]
    best_point: Array = field(default_factory=lambda: np.empty(0))
    best_cost: float = np.inf
    history: list[float] = field(default_factory=list)
    converged: bool = False
    message: str = ""

    @property
    def left(self) -> int:
        """Evaluations left in the budget."""
        return max(0, self.max_evaluations - self.objective.evaluations)

    def costs(self, residuals: Array) -> Array:
        """Return the cost of each row of `residuals`."""
        squares = (residuals / self.loss_scale) ** 2
        return np.asarray(
            0.5 * self.loss_scale**2 * np.sum(loss_values(self.loss, squares), axis=-1)
        )

    def evaluate(self, points: Array) -> Array:
        """Return the residuals of `points`, keeping the best point."""
        residuals = self.objective.residuals(points)
        costs = self.costs(residuals)
        for point, cost in zip(points, costs, strict=True):
            if cost < self.best_cost:
                self.best_cost, self.best_point = float(cost), point.copy()
            self.history.append(self.best_cost)
        self.report(self.objective.evaluations, self.best_cost)
        return residuals


def spread_starts(search: Search, start: Array, count: int, seed: int, keep: int) -> list[Array]:
    """Return the `keep` best of `start` and `count` Sobol points of the parameters' ranges."""
    if count == 0:
        return [start]
    sampler = qmc.Sobol(search.objective.parameters, rng=np.random.default_rng(seed))
    with warnings.catch_warnings():
        # Balance needs a power of two; starts need no balance.
        warnings.filterwarnings("ignore", message="The balance properties of Sobol")
        unit = sampler.random(count)
    points = np.repeat(start[None, :], count + 1, axis=0)
    for i, coordinate in enumerate(search.objective.coordinates):
        low, high = coordinate.sampling_bounds
        points[1:, i] = low + unit[:, i] * (high - low)
    costs = search.costs(search.evaluate(points))
    return [points[i] for i in np.argsort(costs, kind="stable")[:keep]]


def least_squares(search: Search, start: Array) -> None:
    """Trust-region least squares (scipy, reflective, with bounds) from `start`."""
    objective = search.objective
    per_iteration = 2 * (objective.parameters + objective.initial_size) + 1
    # The search stops by evaluations of the residuals; each usually comes with a Jacobian.
    iterations = max(1, search.left // per_iteration)
    lower, upper = objective.bounds()
    # The reflective method needs a start inside; a thousandth of the range is inside.
    margin = np.where(np.isfinite(upper - lower), 1e-3 * (upper - lower), 0.0)
    result = optimize.least_squares(
        lambda point: search.evaluate(point[None, :])[0],
        np.clip(start, lower + margin, upper - margin),
        jac=objective.jacobian,
        bounds=(lower, upper),
        method="trf",
        x_scale="jac",
        loss=search.loss,
        f_scale=search.loss_scale,
        max_nfev=iterations,
        ftol=1e-8,
        xtol=1e-7,
        gtol=1e-10,
    )
    search.converged = bool(result.status > 0)
    search.message = str(result.message)


def cma_es(search: Search, start: Array, seed: int, sigma: float = 0.2) -> None:
    """Covariance-matrix-adaptation evolution strategy over the parameters' ranges.

    Initial states stay as in `start`. Each generation is one parallel batch. `sigma` is the first
    standard deviation as a share of the ranges.
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
        "tolfun": 1e-9,
        "tolx": 1e-6,
    }
    if count == 1:
        # The strategy is undefined in one dimension; an idle second coordinate stands in.
        ranges = np.vstack([ranges, [0.0, 1.0]])
        low, width = ranges[:, 0], ranges[:, 1] - ranges[:, 0]
    first = np.full(len(low), 0.5)
    first[:count] = np.clip((start[:count] - low[:count]) / width[:count], 0.02, 0.98)
    strategy = cma.CMAEvolutionStrategy(first, sigma, options)
    while search.left >= strategy.popsize and not strategy.stop():
        candidates = strategy.ask()
        points = np.repeat(start[None, :], len(candidates), axis=0)
        for i, candidate in enumerate(candidates):
            points[i, :count] = low[:count] + np.asarray(candidate)[:count] * width[:count]
        costs = search.costs(search.evaluate(points))
        strategy.tell(candidates, costs.tolist())
    stops = strategy.stop()
    search.converged = bool(stops)
    search.message = ", ".join(stops) if stops else "the budget of evaluations is spent"
