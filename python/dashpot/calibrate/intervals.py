"""Standard errors and confidence intervals from residuals and their Jacobian.

With the scores ``psi`` of the loss (`dashpot.calibrate.losses`), m residuals that carry noise and n
unknowns that they determine, the covariance of the estimate is

* independent residuals, linear loss:  ``s^2 (J^T J)^-1``, ``s^2 = r^T r / (m - n)``: the textbook
  covariance of nonlinear least squares, exact for linear models with normal noise;
* independent residuals, robust loss:  ``K^2 [sum psi^2 / (m - n)] / mean(psi')^2 (J^T J)^-1`` with
  ``K = 1 + (n / m) var(psi') / mean(psi')^2`` (Huber, Robust Statistics, 1981, section 7.6);
* clustered:  ``H^-1 B H^-1`` with ``H = mean(psi') J^T J`` and
  ``B = G/(G - 1) * sum_t g_t g_t^T``, ``g_t = J_t^T psi_t`` summed over trajectory t of G (Liang
  and Zeger 1986): right when residuals within a trajectory hang together, as they do when the
  model, not the measurement noise, is what limits the fit.

Where ``mean(psi')`` is not above 0, the cost does not rise around the estimate, and nothing is
determined.

Intervals are Student t intervals with ``m - n`` or ``G - 1`` degrees of freedom in the search
coordinate, mapped back to the parameter, so that they respect its bounds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from dashpot.calibrate.losses import Loss

Array = NDArray[np.float64]

# A direction of the Jacobian whose scaled singular value is below this fraction of the largest is
# not determined at all: its variance is infinite.
_RANK_TOLERANCE = 1e-10
# Of robust losses the size of the noise is read off this quantile of the residuals' magnitudes:
# outliers are beyond it, and move it little where they are few.
_NOISE_QUANTILE = 0.7


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
        Near 1 when the noise was stated rightly and the model is right; see `residual_variance`.
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


def residual_variance(residuals: Array, unknowns: int, loss: Loss) -> float:
    """Return the variance of weighted residuals from which `unknowns` were estimated.

    For the linear loss ``r^T r / (m - n)``. For robust losses the square of the 0.7-quantile of
    ``|r|`` over that of a unit normal, Phi^-1(0.85), and as much above it for the unknowns: up to
    10 % of outliers make less than 1.4 of 1, and a misfit of more than 30 % of the residuals shows
    in full.
    """
    m = residuals.size
    if not loss.robust:
        return float(residuals @ residuals) / (m - unknowns)
    size = np.quantile(np.abs(residuals), _NOISE_QUANTILE)
    normal = special.ndtri(0.5 + 0.5 * _NOISE_QUANTILE)
    return float(size / normal) ** 2 * m / (m - unknowns)


def covariance(
    jacobian: Array,
    residuals: Array,
    *,
    loss: Loss | None = None,
    live: NDArray[np.bool_] | None = None,
    offsets: NDArray[np.intp] | None = None,
) -> Covariance:
    """Return the covariance of an estimate.

    Parameters
    ----------
    jacobian
        (m, n) derivative of the residuals at the estimate.
    residuals
        (m,).
    loss
        Whose minimum the estimate is; None: linear.
    live
        (m,) whether a residual carries noise; others count as no degree of freedom. None: all do.
    offsets
        (G + 1,) row ranges of the clusters, G >= 2; None: residuals are independent.

    Raises
    ------
    ValueError
        Where there are no more live residuals than unknowns that they determine, or fewer than two
        clusters.
    """
    loss = Loss() if loss is None else loss
    size = jacobian.shape[1]
    noisy = residuals if live is None else residuals[live]
    determined, scale, singular, v = _decomposed(jacobian)
    unknowns = len(singular) if noisy.size == len(jacobian) else _rank(jacobian[live])
    m = noisy.size
    check_count(m, unknowns)
    variance = residual_variance(noisy, unknowns, loss)
    degrees = m - unknowns if offsets is None else len(offsets) - 2
    slopes = loss.slopes(noisy)
    rise = float(slopes.mean())
    if not rise > 0:
        return Covariance(np.diag(np.full(size, np.inf)), degrees, variance)

    matrix = np.zeros((size, size))
    if determined.any():
        kept = v[: len(singular)]
        inverse = (kept.T / singular**2) @ kept
        lost = np.abs(v[len(singular) :]).max(axis=0, initial=0.0) > np.sqrt(_RANK_TOLERANCE)
        if offsets is not None:
            clusters = len(offsets) - 1
            if clusters < 2:
                raise ValueError("clustered errors need at least two trajectories")
            scaled = jacobian[:, determined] / scale[determined]
            products = scaled * loss.scores(residuals)[:, None]
            sums = np.add.reduceat(products, offsets[:-1], axis=0)
            middle = clusters / (clusters - 1) * (sums.T @ sums)
            block = inverse @ middle @ inverse / rise**2
        elif loss.robust:
            scores = loss.scores(noisy)
            factor = 1.0 + unknowns / m * float(slopes.var()) / rise**2
            block = factor**2 * float(scores @ scores) / (m - unknowns) / rise**2 * inverse
        else:
            block = variance * inverse
        block = block / np.outer(scale[determined], scale[determined])
        block[lost, :] = 0.0
        block[:, lost] = 0.0
        block[lost, lost] = np.inf
        matrix[np.ix_(determined, determined)] = block
    matrix[~determined, ~determined] = np.inf
    return Covariance(matrix, degrees, variance)


def _decomposed(jacobian: Array) -> tuple[NDArray[np.bool_], Array, Array, Array]:
    """Return the singular values that are not lost to rounding, and all right singular vectors.

    They are those of the columns that are not 0, scaled to unit norm, so that rank is judged free
    of units; which columns these are, and their norms, come first.
    """
    scale = np.linalg.norm(jacobian, axis=0)
    determined = scale > 0
    if not determined.any():
        return determined, scale, np.empty(0), np.empty((0, 0))
    scaled = jacobian[:, determined] / scale[determined]
    _, singular, v = np.linalg.svd(scaled, full_matrices=False)
    return determined, scale, singular[singular > _RANK_TOLERANCE * singular[0]], v


def _rank(jacobian: Array) -> int:
    """Return how many unknowns the rows determine."""
    return len(_decomposed(jacobian)[2])
