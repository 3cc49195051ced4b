"""Losses of weighted residuals, with the derivatives that estimates and their errors need.

A residual r costs ``c^2 rho((r / c)^2) / 2`` with the scale c, from which on it counts as outlying;
rho is that of `scipy.optimize.least_squares`. The derivative of that cost is the score
``psi = rho' r``, and the score's is the slope ``psi' = rho' + 2 rho'' (r / c)^2``:

    loss      rho(z)                  rho'(z)           psi'
    linear    z                       1                 1
    soft_l1   2 (sqrt(1 + z) - 1)     (1 + z)^(-1/2)    (1 + z)^(-3/2)
    huber     z to 1, 2 sqrt(z) - 1   1, z^(-1/2)       1, 0
    cauchy    log(1 + z)              1 / (1 + z)       (1 - z) / (1 + z)^2
    arctan    arctan(z)               1 / (1 + z^2)     (1 - 3 z^2) / (1 + z^2)^2
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LossName = Literal["linear", "soft_l1", "huber", "cauchy", "arctan"]

# Nodes of the quadrature over a unit normal; kinks of the losses leave errors of a thousandth.
_NODES = 100


@dataclass(frozen=True)
class Loss:
    """A loss and its scale.

    Attributes
    ----------
    name
        As in the table above.
    scale
        c, in standard deviations, > 0; of no effect on the linear loss.
    """

    name: LossName = "linear"
    scale: float = 1.0

    @property
    def robust(self) -> bool:
        """Whether outlying residuals count less than by their squares."""
        return self.name != "linear"

    def values(self, residuals: Array) -> Array:
        """Return ``c^2 rho((r / c)^2)``, twice the cost of each residual."""
        if self.name == "linear":
            return residuals**2
        z = self._squares(residuals)
        if self.name == "soft_l1":
            rho = 2.0 * (np.sqrt(1.0 + z) - 1.0)
        elif self.name == "huber":
            rho = np.where(z <= 1.0, z, 2.0 * np.sqrt(z) - 1.0)
        elif self.name == "cauchy":
            rho = np.log1p(z)
        else:
            rho = np.arctan(z)
        return np.asarray(self.scale**2 * rho)

    def scores(self, residuals: Array) -> Array:
        """Return psi of each residual."""
        if self.name == "linear":
            return residuals
        z = self._squares(residuals)
        if self.name == "soft_l1":
            weights = 1.0 / np.sqrt(1.0 + z)
        elif self.name == "huber":
            weights = 1.0 / np.sqrt(np.maximum(z, 1.0))
        elif self.name == "cauchy":
            weights = 1.0 / (1.0 + z)
        else:
            weights = 1.0 / (1.0 + z**2)
        return np.asarray(weights * residuals)

    def slopes(self, residuals: Array) -> Array:
        """Return psi' of each residual; of the last two losses it is below 0 for outliers."""
        if self.name == "linear":
            return np.ones_like(residuals)
        z = self._squares(residuals)
        if self.name == "soft_l1":
            return np.asarray((1.0 + z) ** -1.5)
        if self.name == "huber":
            return np.where(z <= 1.0, 1.0, 0.0)
        if self.name == "cauchy":
            return np.asarray((1.0 - z) / (1.0 + z) ** 2)
        return np.asarray((1.0 - 3.0 * z**2) / (1.0 + z**2) ** 2)

    def normal_moments(self) -> tuple[float, float]:
        """Return mean and variance of `values` of residuals that are unit normal.

        By Gauss-Hermite quadrature; (1, 2) for the linear loss.
        """
        nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
        weights = weights / weights.sum()
        values = self.values(nodes)
        mean = float(weights @ values)
        return mean, float(weights @ (values - mean) ** 2)

    def _squares(self, residuals: Array) -> Array:
        return (residuals / self.scale) ** 2
