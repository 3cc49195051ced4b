"""Noise that is not known: standard deviations of channels, estimated along with the parameters.

With the residuals r of group c of channels, weighted by the present standard deviation, and the
leverages h of its n_c residuals (the diagonal of the hat matrix), the next one is

    sigma_c^2 <- sigma_c^2 * sum_c r^2 / (n_c - sum_c h)

and the parameters are fitted anew, until nothing changes. The fixed point solves the equations of
restricted maximum likelihood for variance components (Patterson and Thompson, Biometrika 58, 1971;
Harville, JASA 72, 1977): what the parameters take of the residuals of a channel is not taken for a
smaller noise. Of robust losses the sum is replaced by the quantile of
`dashpot.calibrate.inference.intervals.residual_variance`.
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.inference.intervals import pseudo_inverse, residual_variance
from dashpot.calibrate.residuals.candidates import SimulationError
from dashpot.calibrate.residuals.objective import Objective
from dashpot.calibrate.search.least_squares import least_squares
from dashpot.calibrate.search.search import Search
from dashpot.calibrate.search.strategy import MOST_ITERATIONS, finish

Array = NDArray[np.float64]

# Standard deviations that change by less are the same, and are sought so often at most.
_SAME = 0.02
_MOST_ROUNDS = 8
# One round changes a standard deviation by no more: residuals of a start that is far off are large.
_LARGEST_CHANGE = 100.0
# Fewer residuals than this beyond what the parameters take of them tell no noise.
_LEAST_DEGREES = 3.0


def with_estimated_noise(search: Search) -> Search:
    """Return a search that goes on from the end of another with the noise that residuals have.

    Its objective's problem has the standard deviations. Where they do not come to rest, a warning
    says why.
    """
    ended = f"they still change after {_MOST_ROUNDS} rounds"
    for _ in range(_MOST_ROUNDS):
        # A round is derivatives, and an iteration at least.
        if search.budget.left < 2 * search.iteration:
            ended = "the budget of evaluations is spent"
            break
        factors = noise_factors(search)
        if all(abs(np.log(factor)) < _SAME for factor in factors.values()):
            return search
        problem = search.objective.problem.with_noise(factors)
        objective = search.objective.of(problem)
        following = Search(objective, search.loss, search.budget)
        try:
            least_squares(following, search.best_point, MOST_ITERATIONS)
        except SimulationError as error:
            ended = str(error)
            break
        finish(following)
        search = following
    warnings.warn(f"standard deviations are not those of the residuals yet: {ended}", stacklevel=3)
    return search


def noise_factors(search: Search) -> dict[str, float]:
    """Return by group how many times as large as stated the noise is at the end of a search."""
    objective, residuals = search.objective, search.best_residuals
    counted = objective.live(residuals)
    jacobian = search.jacobian(search.best_point)
    leverage = pseudo_inverse(jacobian.select(counted)).leverages()
    factors = {}
    for group, rows in _groups(objective).items():
        own = rows[counted[rows]]
        taken = float(leverage[own].sum())
        if own.size - taken < _LEAST_DEGREES:
            continue
        variance = residual_variance(residuals[own], taken, search.loss)
        if variance > 0.0:
            factor = float(np.sqrt(variance))
            factors[group] = min(max(factor, 1.0 / _LARGEST_CHANGE), _LARGEST_CHANGE)
    return factors


def _groups(objective: Objective) -> dict[str, NDArray[np.intp]]:
    """Return the rows of each group: positions, rotations, and each other channel."""
    found: dict[str, list[NDArray[np.intp]]] = {}
    for first, layout in zip(objective.offsets, objective.layouts, strict=False):
        for name, places in layout.groups():
            found.setdefault(name, []).append((first + places).reshape(-1))
    return {name: np.concatenate(rows) for name, rows in found.items()}
