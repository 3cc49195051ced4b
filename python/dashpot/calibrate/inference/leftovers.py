"""What the unknowns of a fit leave of residuals, to first order, and how much of it is noise."""

from __future__ import annotations

import copy

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.inference.intervals import pseudo_inverse
from dashpot.calibrate.residuals.arrow import ArrowInverse, ArrowMatrix
from dashpot.calibrate.residuals.losses import Loss
from dashpot.calibrate.residuals.objective import Objective

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Fewer steps between readings than this tell no noise.
_LEAST_STEPS = 6
# An unknown this near a bound, in shares of its range, does not make up for anything.
_AT_BOUND = 1e-4


class Leftovers:
    """The projection onto what the unknowns of a fit cannot make up for.

    Residuals count as the loss weighs them at the estimate.
    """

    def __init__(
        self,
        objective: Objective,
        point: Array,
        residuals: Array,
        jacobian: ArrowMatrix,
        loss: Loss,
    ) -> None:
        self.objective = objective
        self._counted = objective.live(residuals)
        scores = loss.scores(residuals)
        safe = np.where(residuals == 0.0, 1.0, residuals)
        self._weights = np.sqrt(np.where(residuals == 0.0, 1.0, scores / safe))
        self._jacobian = self._held(point, jacobian)
        self._last: tuple[Bools, ArrowMatrix, ArrowInverse] | None = None
        self._noise = self._noise_of(residuals * self._weights)

    def free(self, point: Array) -> Bools:
        """Return (p,) which parameters are at no bound."""
        count = self.objective.parameters
        lower, upper = (bound[:count] for bound in self.objective.bounds())
        near = _AT_BOUND * (upper - lower)
        return np.asarray((point[:count] - lower > near) & (upper - point[:count] > near))

    def _held(self, point: Array, jacobian: ArrowMatrix) -> ArrowMatrix:
        """Return a weighted Jacobian, without unknowns at bounds, which make up for nothing."""
        weights, free = self._weights[:, None], self.free(point)
        return ArrowMatrix(
            jacobian.shared * free * weights, jacobian.own * weights, jacobian.offsets
        )

    def moved(self, point: Array, jacobian: ArrowMatrix) -> Leftovers:
        """Return the same with derivatives at another point."""
        other = copy.copy(self)
        other._jacobian, other._last = self._held(point, jacobian), None
        return other

    def of(self, residuals: Array, rows: Bools) -> tuple[Array, Bools, int]:
        """Return what is left of residuals (k, m), which count, and how many unknowns took."""
        counted = rows & self._counted
        if self._last is None or not np.array_equal(self._last[0], counted):
            selected = self._jacobian.select(counted)
            self._last = counted, selected, pseudo_inverse(selected)
        _, matrix, inverse = self._last
        weighted = residuals * (self._weights * counted)
        return weighted - matrix.apply(inverse.solve(weighted)), counted, inverse.rank

    def noise(self, counted: Bools) -> float:
        """Return the sum of squares of white noise in the rows that count."""
        return float(self._noise[counted].sum())

    def _noise_of(self, residuals: Array) -> Array:
        """Return (m,) the variance of the noise of residuals, as their differences tell it."""
        objective = self.objective
        found: dict[str, list[Array]] = {}
        for first, layout in zip(objective.offsets, objective.layouts, strict=False):
            for name, places in layout.groups():
                columns = (first + places).T
                found.setdefault(name, []).extend(c[self._counted[c]] for c in columns)
        noise = np.ones(residuals.size)
        stated = objective.problem.noise == "stated"
        for columns in found.values():
            steps = np.concatenate([np.diff(residuals[c]) for c in columns])
            told = 0.5 * float(np.mean(steps**2)) if steps.size >= _LEAST_STEPS else None
            variance = (1.0 if stated else 0.0) if told is None else min(told, 1.0)
            for column in columns:
                noise[column] = variance
        return noise
