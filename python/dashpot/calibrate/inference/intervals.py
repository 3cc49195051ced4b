"""Standard errors and confidence intervals from residuals and their Jacobian.

With the scores ``psi`` of the loss (`dashpot.calibrate.residuals.losses`), m residuals that carry
noise and n unknowns that they determine, the covariance of the estimate is

* independent residuals, linear loss:  ``s^2 (J^T J)^-1``, ``s^2 = r^T r / (m - n)``: the textbook
  covariance of nonlinear least squares, exact for linear models with normal noise;
* independent residuals, robust loss:  ``K^2 [sum psi^2 / (m - n)] / mean(psi')^2 (J^T J)^-1`` with
  ``K = 1 + (n / m) var(psi') / mean(psi')^2`` (Huber, Robust Statistics, 1981, section 7.6);
* residuals that hang together in time, or channels of other sizes than stated: as
  `dashpot.calibrate.residuals.misfit` says, and no narrower than of independent ones;
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

from dashpot.calibrate.residuals.arrow import ArrowInverse, ArrowMatrix
from dashpot.calibrate.residuals.losses import Loss
from dashpot.calibrate.residuals.misfit import ResidualCovariance

Array = NDArray[np.float64]

# A direction of the Jacobian whose scaled singular value is below this fraction of the largest is
# not determined at all: its variance is infinite. Rounding leaves up to 1e-9 of derivatives by
# differences, as along spins that a sticking ball forgets, which would be a variance of 1e18.
_RANK_TOLERANCE = 1e-8
# Of robust losses the size of the noise is read off this quantile of the residuals' magnitudes:
# outliers are beyond it, and move it little where they are few.
_NOISE_QUANTILE = 0.7


@dataclass(frozen=True, eq=False)
class Covariance:
    """Covariance of an estimate in search coordinates.

    Attributes
    ----------
    blocks
        (trajectories, p + s, p + s) covariance of the p parameters and the s unknowns of the
        initial state of each trajectory; of undetermined unknowns infinite on the diagonal, 0
        elsewhere.
    parameters
        p.
    degrees_of_freedom
        Of Student's t.
    residual_variance
        Near 1 when the noise was stated rightly and the model is right; see `residual_variance`.
    dispersion
        (p,) twice the rise of the cost, all else refitted, at one standard error: 1 where the noise
        was stated rightly, of the linear loss the residual variance.
    widening
        (p,) how many times wider standard errors are for a misfit; 1 without.
    """

    blocks: Array
    parameters: int
    degrees_of_freedom: int
    residual_variance: float
    dispersion: Array
    widening: Array

    @property
    def matrix(self) -> Array:
        """(p, p) covariance of the parameters."""
        return np.array(self.blocks[0, : self.parameters, : self.parameters])

    @property
    def standard_error(self) -> Array:
        """(n,) square roots of the variances, of the parameters first, then of initial states."""
        variances = np.diagonal(self.blocks, axis1=1, axis2=2)
        own = variances[:, self.parameters :].reshape(-1)
        return np.asarray(np.sqrt(np.concatenate([variances[0, : self.parameters], own])))

    @property
    def correlation(self) -> Array:
        """(p, p) of the parameters; 0 beside undetermined ones."""
        error = self.standard_error[: self.parameters]
        with np.errstate(invalid="ignore"):
            correlation = self.matrix / np.outer(error, error)
        correlation[~np.isfinite(correlation)] = 0.0
        np.fill_diagonal(correlation, 1.0)
        return np.clip(correlation, -1.0, 1.0)

    def quantile(self, confidence: float) -> float:
        """Half-width of a two-sided Student t interval in standard errors."""
        return float(special.stdtrit(self.degrees_of_freedom, 0.5 + 0.5 * confidence))

    def half_width(self, confidence: float) -> Array:
        """(n,) half-widths of the two-sided Student t intervals."""
        return np.asarray(self.quantile(confidence) * self.standard_error)


def check_count(residuals: int, unknowns: int) -> None:
    """Raise ValueError where there are no more residuals than unknowns."""
    if residuals <= unknowns:
        raise ValueError(
            f"{residuals} residuals cannot determine {unknowns} unknowns and their errors"
        )


def residual_variance(residuals: Array, unknowns: float, loss: Loss) -> float:
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
    jacobian: Array | ArrowMatrix,
    residuals: Array,
    *,
    loss: Loss | None = None,
    live: NDArray[np.bool_] | None = None,
    offsets: NDArray[np.intp] | None = None,
    hold: Array | None = None,
    misfit: ResidualCovariance | None = None,
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
    hold
        (s,) standard deviations to which each initial state counts as known beforehand, so that
        what data hardly determine stays near; None: to none.
    misfit
        The covariance of the scores of the residuals, where these are not independent or channels
        differ; None: they are of one variance. Clustered errors have no use for it.

    Raises
    ------
    ValueError
        Where there are no more live residuals than unknowns that they determine, or fewer than two
        clusters.
    """
    loss = Loss() if loss is None else loss
    matrix = jacobian if isinstance(jacobian, ArrowMatrix) else ArrowMatrix.of_dense(jacobian)
    noisy = residuals if live is None else residuals[live]
    inverse = pseudo_inverse(matrix)
    unknowns = inverse.rank
    if live is not None and not live.all():
        unknowns = pseudo_inverse(matrix.select(live)).rank
    m = noisy.size
    check_count(m, unknowns)
    variance = residual_variance(noisy, unknowns, loss)
    degrees = m - unknowns if offsets is None else len(offsets) - 2
    count = matrix.shared.shape[1]
    slopes = loss.slopes(noisy)
    rise = float(slopes.mean())
    if not rise > 0:
        each = np.diag(np.full(count + matrix.own.shape[1], np.inf))
        blocks = np.stack([each] * matrix.trajectories)
        return Covariance(blocks, count, degrees, variance, np.full(count, np.inf), np.ones(count))
    all_scores = loss.scores(residuals)
    ranges, places = offsets, np.arange(len(residuals))
    if hold is not None and matrix.own.shape[1]:
        matrix, places = matrix.held(1.0 / hold)
        inverse = pseudo_inverse(matrix)
        all_scores = np.zeros(len(matrix.shared))
        all_scores[places] = loss.scores(residuals)
        ranges = matrix.offsets
    if offsets is not None and ranges is not None:
        clusters = len(offsets) - 1
        if clusters < 2:
            raise ValueError("clustered errors need at least two trajectories")
        blocks = inverse.clustered(all_scores, ranges)
        factor = clusters / (clusters - 1) / rise**2
    elif loss.robust:
        blocks, scores = inverse.independent(), loss.scores(noisy)
        factor = (1.0 + unknowns / m * float(slopes.var()) / rise**2) ** 2
        factor *= float(scores @ scores) / (m - unknowns) / rise**2
    else:
        blocks, factor = inverse.independent(), variance
    with np.errstate(invalid="ignore"):
        # Data without any noise leave a variance of 0, and what they do not determine stays so.
        blocks = np.where(np.isinf(blocks), np.inf, factor * blocks)
    dispersion = np.full(count, factor * rise)
    widening = np.ones(count)
    if misfit is not None and offsets is None:
        of_scores = m / (m - unknowns) / rise**2
        blocks, widening = _widened(blocks, inverse, misfit, places, of_scores, count)
    if offsets is not None or misfit is not None:
        unit = np.diagonal(inverse.independent()[0])[:count]
        with np.errstate(divide="ignore", invalid="ignore"):
            dispersion = np.diagonal(blocks[0])[:count] / unit * rise
    return Covariance(blocks, count, degrees, variance, dispersion, widening)


def _widened(
    blocks: Array,
    inverse: ArrowInverse,
    misfit: ResidualCovariance,
    places: NDArray[np.intp],
    factor: float,
    count: int,
) -> tuple[Array, Array]:
    """Return covariance blocks for residuals that hang together, and how much wider (count,).

    No unknown is known better for it.
    """
    rows = inverse.shape[0]

    def apply(vectors: Array) -> Array:
        result = np.zeros((len(vectors), rows))
        result[:, places] = misfit.apply(vectors[:, places])
        return result

    together = factor * inverse.correlated(apply)
    old, new = (np.sqrt(np.diagonal(b, axis1=1, axis2=2)) for b in (blocks, together))
    known = np.isfinite(old) & (new > 0.0)
    stretch = np.ones_like(old)
    stretch[known] = np.maximum(old[known] / new[known], 1.0)
    wider = np.where(np.isinf(blocks), np.inf, together)
    finite = np.isfinite(wider)
    scaled = np.where(finite, wider, 0.0) * stretch[:, :, None] * stretch[:, None, :]
    ratio = np.ones_like(old)
    positive = known & (old > 0.0)
    ratio[positive] = (new * stretch)[positive] / old[positive]
    return np.where(finite, scaled, np.inf), ratio[0, :count]


def pseudo_inverse(jacobian: ArrowMatrix) -> ArrowInverse:
    """Return the pseudo-inverse of a Jacobian, with the tolerance by which intervals judge rank."""
    return ArrowInverse(jacobian, _RANK_TOLERANCE)
