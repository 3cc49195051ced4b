"""Standard errors and confidence intervals from residuals and their Jacobian.

With weights ``w = rho'(r**2)`` of the loss and ``H = J^T diag(w) J`` (the Gauss-Newton Hessian),
the covariance of the estimate is the sandwich ``H^-1 B H^-1`` with

* independent residuals, linear loss:  ``B = s^2 H``, ``s^2 = r^T r / (m - n)``: the textbook
  covariance of nonlinear least squares, exact for linear models with normal noise;
* independent residuals, robust loss:  ``B = m/(m - n) J^T diag((w r)^2) J`` (Huber 1967);
* clustered:  ``B = G/(G - 1) * sum_t g_t g_t^T``, ``g_t = J_t^T (w r)_t`` summed over trajectory t
  of G (Liang and Zeger 1986): right when residuals within a trajectory hang together, as they do
  when the model, not the measurement noise, is what limits the fit.

Intervals are Student t intervals with ``m - n`` or ``G - 1`` degrees of freedom in the search
coordinate, mapped back to the parameter, so that they respect its bounds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

Array = NDArray[np.float64]

# A direction of the Jacobian whose scaled singular value is below this fraction of the largest is
# not determined at all: its variance is infinite.
_RANK_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class Covariance:
    """Covariance of an estimate in search coordinates.

    Attributes
    ----------
    matrix
        (n, n); rows and columns of undetermined unknowns are infinite on the diagonal, 0 elsewhere.
    degrees_of_freedom
        Of Student's t.
    residual_variance
        ``r^T W r / (m - n)``: near 1 when the noise was stated rightly and the model is right.
    """

    matrix: Array
    degrees_of_freedom: int
    residual_variance: float

    @property
    def standard_error(self) -> Array:
        """(n,) square roots of the diagonal."""
        return np.sqrt(np.diag(self.matrix))

    @property
    def correlation(self) -> Array:
        """(n, n); 0 beside undetermined unknowns."""
        error = self.standard_error
        with np.errstate(invalid="ignore"):
            correlation = self.matrix / np.outer(error, error)
        correlation[~np.isfinite(correlation)] = 0.0
        np.fill_diagonal(correlation, 1.0)
        return np.clip(correlation, -1.0, 1.0)

    def half_width(self, confidence: float) -> Array:
        """(n,) half-widths of the two-sided Student t intervals."""
        factor = special.stdtrit(self.degrees_of_freedom, 0.5 + 0.5 * confidence)
        return np.asarray(factor * self.standard_error)


def check_count(residuals: int, unknowns: int) -> None:
    """Raise ValueError where there are no more residuals than unknowns."""
    if residuals <= unknowns:
        raise ValueError(
            f"{residuals} residuals cannot determine {unknowns} unknowns and their errors"
        )


def covariance(
    jacobian: Array,
    residuals: Array,
    *,
    weights: Array | None = None,
    offsets: NDArray[np.intp] | None = None,
) -> Covariance:
    """Return the covariance of a least-squares estimate.

    Parameters
    ----------
    jacobian
        (m, n) derivative of the residuals at the estimate.
    residuals
        (m,).
    weights
        (m,) weights rho'(r^2) of a robust loss; None: linear loss.
    offsets
        (G + 1,) row ranges of the clusters, G >= 2; None: residuals are independent.

    Raises
    ------
    ValueError
        Where there are no more residuals than unknowns, or fewer than two clusters.
    """
    m, n = jacobian.shape
    check_count(m, n)
    robust = weights is not None
    weight = np.ones(m) if weights is None else weights
    weighted = weight * residuals
    variance = float(residuals @ weighted) / (m - n)

    # Columns scaled to unit norm, so that rank is judged free of units.
    root = np.sqrt(weight)[:, None] * jacobian
    scale = np.linalg.norm(root, axis=0)
    determined = scale > 0
    matrix = np.zeros((n, n))
    if determined.any():
        scaled = root[:, determined] / scale[determined]
        _, singular, v = np.linalg.svd(scaled, full_matrices=False)
        kept = singular > _RANK_TOLERANCE * singular[0]
        inverse = (v[kept].T / singular[kept] ** 2) @ v[kept]
        lost = np.abs(v[~kept]).max(axis=0, initial=0.0) > np.sqrt(_RANK_TOLERANCE)
        if offsets is not None:
            clusters = len(offsets) - 1
            if clusters < 2:
                raise ValueError("clustered errors need at least two trajectories")
            products = (jacobian[:, determined] / scale[determined]) * weighted[:, None]
            sums = np.add.reduceat(products, offsets[:-1], axis=0)
            middle = clusters / (clusters - 1) * (sums.T @ sums)
            block = inverse @ middle @ inverse
        elif robust:
            products = (jacobian[:, determined] / scale[determined]) * weighted[:, None]
            block = m / (m - n) * inverse @ (products.T @ products) @ inverse
        else:
            block = variance * inverse
        block = block / np.outer(scale[determined], scale[determined])
        block[lost, :] = 0.0
        block[:, lost] = 0.0
        block[lost, lost] = np.inf
        matrix[np.ix_(determined, determined)] = block
    matrix[~determined, ~determined] = np.inf
    degrees = m - n if offsets is None else len(offsets) - 2
    return Covariance(matrix, degrees, variance)
