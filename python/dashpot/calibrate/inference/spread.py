"""What a fit leaves open, as motions: draws of all unknowns, and the cost along a parameter.

Initial states go with the parameters as the Jacobian at the estimate says: of the normal
distribution with the precision J^T J they have, at given parameters, the mean

    s(z) = s - (J_s^T J_s)^-1 J_s^T J_z (z - z_0)

and the covariance (J_s^T J_s)^-1, times the variance of the residuals.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.residuals.objective import Objective

Array = NDArray[np.float64]

# Directions of initial states that residuals tell less well than this, of the best, stay.
_WEAK = 1e-7


class Neighbourhood:
    """Points around an estimate, with the initial states that belong to their parameters.

    Parameters
    ----------
    objective
        Of the problem.
    point
        (n,) the estimate.
    """

    def __init__(self, objective: Objective, point: Array) -> None:
        self._point = point
        self._count = objective.parameters
        jacobian = objective.jacobian(point)
        self._follow, self._root = [], []
        for t in range(jacobian.trajectories):
            rows = jacobian.rows(t)
            u, size, axes = np.linalg.svd(jacobian.own[rows], full_matrices=False)
            told = size > _WEAK * max(float(size.max(initial=0.0)), 1e-300)
            inverse = axes[told].T / size[told]
            self._follow.append(-inverse @ (u[:, told].T @ jacobian.shared[rows]))
            self._root.append(inverse)

    def points(self, parameters: Array, scores: np.random.Generator | None, size: float) -> Array:
        """Return points (k, n) of parameters (k, p) in search coordinates.

        Initial states follow the parameters; with `scores` they are drawn about that, with `size`
        times the standard deviations of unit noise.
        """
        rows = []
        for z in parameters:
            parts = [z]
            states = self._point[self._count :].reshape(len(self._follow), -1)
            for state, follow, root in zip(states, self._follow, self._root, strict=True):
                moved = state + follow @ (z - self._point[: self._count])
                if scores is not None:
                    moved = moved + size * root @ scores.standard_normal(root.shape[1])
                parts.append(moved)
            rows.append(np.concatenate(parts))
        return np.array(rows)
