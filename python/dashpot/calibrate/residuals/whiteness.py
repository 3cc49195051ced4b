"""Whether residuals hang together from frame to frame, as a misfit does and noise does not.

Where noise is stated larger than it is, the size of residuals tells nothing: a misfit below the
stated noise passes for it. Its residuals are alike in neighbouring frames, though. Of white noise
the sum of the products of neighbours has the mean 0 and the variance sum r_k^2 r_{k+1}^2, whatever
its sizes are; over the sum of squares it is the correlation on which the tests of von Neumann and
of Durbin and Watson (Biometrika 37, 1950) rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.residuals.objective import Objective

Array = NDArray[np.float64]

# Root mean square below which residuals are those of data without noise, as of a simulation.
_EXACT = 1e-3


@dataclass(frozen=True)
class Whiteness:
    """How residuals go along with those of the frame before.

    Attributes
    ----------
    correlation
        Over all channels, weighted by their variances; 0 of white noise.
    deviations
        That in standard deviations which white noise of the same sizes would give it.
    exact
        Whether residuals are so small that data had no noise; nothing is told then.
    """

    correlation: float
    deviations: float
    exact: bool

    def holds(self, deviations: float) -> bool:
        """Whether residuals are white to so many standard deviations."""
        return self.exact or self.deviations < deviations


def whiteness(objective: Objective, residuals: Array, counted: NDArray[np.bool_]) -> Whiteness:
    """Return how residuals (m,) go along with the reading before, of those `counted` (m,).

    Neighbours are successive readings of one channel, at whatever rate it has.
    """
    together = spread = squares = 0.0
    for t, layout in enumerate(objective.layouts):
        rows = slice(objective.offsets[t], objective.offsets[t + 1])
        for block, seen in zip(
            layout.split(residuals[rows]), layout.split(counted[rows]), strict=True
        ):
            for column, kept in zip(block.T, seen.T, strict=True):
                read = column[kept]
                products = read[1:] * read[:-1]
                together += float(products.sum())
                spread += float((products**2).sum())
                squares += float((read**2).sum())
    if spread == 0.0:
        return Whiteness(0.0, 0.0, True)
    exact = bool(squares < _EXACT**2 * np.count_nonzero(counted))
    return Whiteness(together / squares, together / float(np.sqrt(spread)), exact)
