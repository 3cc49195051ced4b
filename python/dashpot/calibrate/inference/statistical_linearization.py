"""Linear models of the residuals over the region that an interval covers.

On the small scale the cost of a motion with impacts is rough: its local derivatives differ from its
trend, its curvature at a minimum is larger than that of the valley, and the minimum found is one of
several. So residuals are simulated at points drawn from the region itself, a normal distribution
with the covariance ``C`` of the estimate, in pairs ``z + d`` and ``z - d``; unknowns that
compensate each other move together as ``C`` says. With ``r+`` and ``r-`` the residuals of a pair,

* regression of ``(r+ - r-)/2`` on ``d`` gives the Jacobian over the region, exact where residuals
  are linear or quadratic (statistical linearization: Gelb, Applied Optimal Estimation, 1974);
* the mean of ``(r+ + r-)/2`` projected on it is how far the middle of the valley lies from ``z``;
* what both leave over, projected, is the scatter of that middle.

The two last are zero where residuals are linear. They are added to the covariance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.inference.intervals import Covariance, pseudo_inverse
from dashpot.calibrate.residuals.arrow import ArrowMatrix, blocks_of
from dashpot.calibrate.residuals.objective import Objective

Array = NDArray[np.float64]

# The first region is wider than the local covariance says by this factor, since that is too narrow
# where it is wrong; regions shrink to the covariance that they imply, or grow.
_FIRST_REGION = 3.0
# A region is the one that it implies when no parameter's standard error differs by more.
_SAME_WIDTH = 1.3
_MOST_REGIONS = 6
# Standard deviation of a parameter's search coordinate in a region is at most this: half-widths of
# 0.2, about what a factor of 1.2 or a fifth of the range are.
_WIDEST = 0.1
# A region where a simulation fails is narrowed by this factor, so often at most.
_NARROWER = 4.0
# The centre of a region is at least so many of its standard deviations off all bounds.
_INSIDE = 2.0
# Correlated parameters whose eigenvalues are below this fraction count as dependent in a draw.
_DEPENDENT = 1e-12
# Unknowns of a larger variance (of parameters: a million e-folds or ranges) are as good as of an
# infinite one.
_UNKNOWN = 1e12
_MOST_FAILURES = 3
# Initial states are drawn within the first multiple of the widths of their differences, whatever
# the data say (0.1 m and rad, 1 m/s and rad/s), and count as known to the second beforehand (10 m
# and rad, 100 m/s and rad/s). What data hardly determine would be drawn kilometres away, where
# nothing is as it is here, or make up there for a parameter by what a regression leaves of it.
_NEAR, _POSSIBLE = 1e5, 1e7


@dataclass(frozen=True, eq=False)
class StatisticalLinearization:
    """Residuals over a region, as a linear model and what it leaves over.

    Attributes
    ----------
    jacobian
        Derivative over the region, (residual_count, size).
    center
        (residual_count,) what the linear model says of the region's centre.
    scatter
        (points, residual_count) departures of single points from the linear model.
    """

    jacobian: ArrowMatrix
    center: Array
    scatter: Array


def region_evaluations(objective: Objective) -> int:
    """Return how many evaluations a linear model over a region takes."""
    return 2 * _pairs(objective)


def _pairs(objective: Objective) -> int:
    return 2 * (objective.parameters + objective.free_states.size) + 8


def linearize(
    objective: Objective, point: Array, region: Array, rng: np.random.Generator
) -> StatisticalLinearization:
    """Return the linear model of the residuals around `point`.

    Parameters
    ----------
    objective
        The residuals.
    point
        (size,) centre of the region, within the bounds.
    region
        (trajectories, p + s, p + s) covariance of the region, as `Covariance.blocks`; unknowns with
        zero rows stay as they are, and their columns of the Jacobian are 0. Where bounds are near,
        its centre moves inwards, all unknowns together as it says.
    rng
        Draws the points.
    """
    count, block = objective.parameters, objective.initial_size
    pairs = _pairs(objective)
    draws = _draw(region, count, pairs, rng)
    lower, upper = objective.bounds()
    centre = _within_bounds(point, region, count, lower, upper)
    # As a whole, so that unknowns that move together still do.
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.minimum(centre - lower, upper - centre) / np.abs(draws)
    draws *= np.minimum(room.min(axis=1, where=draws != 0.0, initial=1.0), 1.0)[:, None]
    up, down = (np.clip(centre + sign * draws, lower, upper) for sign in (1.0, -1.0))
    residuals = objective.residuals(np.concatenate([up, down]))
    half = 0.5 * (residuals[:pairs] - residuals[pairs:])
    middle = 0.5 * (residuals[:pairs] + residuals[pairs:])
    step, off = 0.5 * (up - down), 0.5 * (up + down) - point

    shared = np.zeros((objective.residual_count, count))
    own = np.zeros((objective.residual_count, block))
    jacobian = ArrowMatrix(shared, own, objective.offsets)
    steps = blocks_of(jacobian, step)
    for t in range(jacobian.trajectories):
        scale = np.sqrt(np.diag(region[t]))
        moved = scale > 0
        rows = jacobian.rows(t)
        columns = steps[:, t, moved] / scale[moved]
        solution = np.zeros((count + block, rows.stop - rows.start))
        solution[moved] = np.linalg.lstsq(columns, half[:, rows], rcond=None)[0]
        solution[moved] /= scale[moved, None]
        shared[rows], own[rows] = solution[:count].T, solution[count:].T
    middle -= jacobian.apply(off)
    center = middle.mean(axis=0)
    # Regression leaves less than the scatter by its degrees of freedom.
    degrees = pairs - count - objective.free_states.size
    odd = (half - jacobian.apply(step)) * np.sqrt(pairs / degrees)
    return StatisticalLinearization(jacobian, center, np.concatenate([odd, middle - center]))


def _draw(region: Array, count: int, number: int, rng: np.random.Generator) -> Array:
    """Return normal draws (number, n) of the parameters, and of initial states given them."""
    values, vectors = np.linalg.eigh(region[0, :count, :count])
    shared = rng.normal(size=(number, count)) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    trajectories, size = len(region), region.shape[1] - count
    if size == 0:
        return np.asarray(shared)
    follow = _following(region, np.arange(count), np.arange(count, count + size))
    rest = region[:, count:, count:] - follow @ region[:, :count, count:]
    values, vectors = np.linalg.eigh(rest)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    noise = rng.normal(size=(number, trajectories, size))
    own = np.einsum("tij,ntj->nti", root, noise) + np.einsum("tij,nj->nti", follow, shared)
    return np.concatenate([shared, own.reshape(number, -1)], axis=1)


def _following(region: Array, leading: NDArray[np.intp], following: NDArray[np.intp]) -> Array:
    """Return (trajectories, f, l) how some unknowns of a region follow others on average.

    Those may be as good as dependent.
    """
    covariance = region[np.ix_(np.arange(len(region)), leading, leading)]
    scale = np.sqrt(np.maximum(_diagonal(covariance), 0.0))  # rounding may leave less
    scale[scale == 0.0] = 1.0
    units = scale[:, :, None] * scale[:, None, :]
    inverse = np.linalg.pinv(covariance / units, rcond=_DEPENDENT, hermitian=True) / units
    return np.asarray(region[np.ix_(np.arange(len(region)), following, leading)] @ inverse)


def _within_bounds(point: Array, region: Array, count: int, lower: Array, upper: Array) -> Array:
    """Return the point next to `point` along a region from which that hardly meets a bound.

    An unknown that its bound stops moves inwards, and others as they do along with it.
    """
    low, high, start = lower[:count], upper[:count], point[:count]
    wanted = _INSIDE * np.sqrt(np.maximum(np.diag(region[0])[:count], 0.0))
    wanted = np.minimum(wanted, 0.5 * (high - low))
    shift = np.clip(start, low + wanted, high - wanted) - start
    near = np.flatnonzero(shift)
    if near.size == 0:
        return point
    follow = _following(region[:1], near, np.arange(count))[0]
    parameters = np.clip(start + follow @ shift[near], low + wanted, high - wanted)
    trajectories, size = len(region), region.shape[1] - count
    states = _following(region, np.arange(count), np.arange(count, count + size))
    moved = point.copy()
    moved[:count] = parameters
    moved[count:] += (states @ (parameters - start)).reshape(trajectories * size)
    return moved


def over_its_region(
    objective: Objective,
    point: Array,
    local: ArrowMatrix,
    covariance: Callable[[ArrowMatrix, Array], Covariance],
    slopes: Array | None,
    seed: int,
    left: Callable[[], float] = lambda: np.inf,
) -> tuple[Covariance, Array]:
    """Return the covariance of a linear model over the very region that it implies.

    Parameters
    ----------
    objective, point
        The residuals and their minimum.
    local
        Jacobian at the minimum, to start from.
    covariance
        Covariance of the estimate from a Jacobian, and to which standard deviations (s,) initial
        states count as known beforehand.
    slopes
        (residual_count,) slopes psi' of a robust loss's scores, over the mean of those that carry
        noise; None: linear loss.
    seed
        Of the points drawn.
    left
        How many evaluations may follow: where too few, the last region is taken.

    Returns
    -------
    The covariance, its departure from linearity included, and of each unknown (size,) that
    departure in standard errors of the linear model, 0 where the data say nothing.
    """
    rng = np.random.default_rng(seed)
    count = objective.parameters
    floor = objective.differences()
    close, hold = near(objective), possible(objective)
    region = _region(covariance(local, close), _FIRST_REGION, floor, count)
    failures, regions = 0, 0
    while True:
        try:
            model = linearize(objective, point, region, rng)
        except ValueError:
            failures += 1
            if failures > _MOST_FAILURES:
                raise
            region /= _NARROWER**2
            continue
        regions += 1
        implied = _region(covariance(model.jacobian, close), 1.0, floor, count)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.sqrt(np.diag(implied[0]) / np.diag(region[0]))[:count]
        ratio = ratio[np.isfinite(ratio) & (ratio > 0)]
        same = ((ratio < _SAME_WIDTH) & (ratio > 1.0 / _SAME_WIDTH)).all()
        too_few = left() < region_evaluations(objective)
        if same or regions == _MOST_REGIONS or failures or too_few:
            linear = covariance(model.jacobian, hold)
            return _with_departure(linear, model, slopes, hold)
        region = implied


def _region(estimated: Covariance, wider: float, floor: Array, count: int) -> Array:
    """Return the covariance of a region: wider than `estimated`, and neither too narrow nor wide.

    Unknowns of infinite variance, or one as good as that, stay as they are. Others have at least
    the standard deviation `floor`, initial states beyond their following of the parameters. Those
    of the first `count` are at most `_WIDEST`, others then moving along as they would.
    """
    known = _diagonal(estimated.blocks) < _UNKNOWN
    both = known[:, :, None] & known[:, None, :]
    region = np.where(both, wider**2 * estimated.blocks, 0.0)
    for i in range(count):
        variance = region[0, i, i]
        if variance > _WIDEST**2:
            along = region[:, i] / np.sqrt(variance)
            share = 1.0 - _WIDEST**2 / variance
            region -= share * along[:, :, None] * along[:, None, :]
    # Clustered errors hardly let initial states move for themselves, as a regression needs.
    own = np.arange(count, region.shape[1])
    region[:, own, own] += (
        np.where(known[:, count:], floor[count:].reshape(len(region), -1), 0.0) ** 2
    )
    deviation = np.sqrt(np.maximum(_diagonal(region), 0.0))  # rounding may leave less
    grown = np.ones_like(deviation)
    with np.errstate(divide="ignore"):
        grown[:, :count] = np.maximum(1.0, floor[:count] / deviation[:, :count])
    grown[~(known & (deviation > 0))] = 1.0
    return np.asarray(region * grown[:, :, None] * grown[:, None, :])


def _diagonal(blocks: Array) -> Array:
    return np.diagonal(blocks, axis1=1, axis2=2)


def near(objective: Objective) -> Array:
    """Return the standard deviations (s,) of initial states within which they are drawn."""
    return _NEAR / _POSSIBLE * possible(objective)


def possible(objective: Objective) -> Array:
    """Return the standard deviations (s,) to which initial states count as known beforehand."""
    return _POSSIBLE * objective.differences()[objective.parameters :][: objective.initial_size]


def _with_departure(
    linear: Covariance, model: StatisticalLinearization, slopes: Array | None, hold: Array
) -> tuple[Covariance, Array]:
    """Add the shift of the valley's middle and its scatter to the covariance.

    Departures e move the estimate by ``-(J^T J)^-1 J^T (slopes e)``: outliers, whose scores do not
    change with them, do not move it.
    """
    errors = linear.standard_error
    known = np.isfinite(errors)
    if not known.any():
        return linear, np.zeros(len(errors))
    departures = np.concatenate([model.center[None], model.scatter])
    if slopes is not None:
        departures = departures * slopes
    held, places = model.jacobian.held(1.0 / hold)
    padded = np.zeros((len(departures), len(held.shared)))
    padded[:, places] = departures
    moves = np.where(known, pseudo_inverse(held).solve(padded), 0.0)
    moves[1:] /= np.sqrt(len(model.scatter) // 2)
    each = blocks_of(model.jacobian, moves)
    added = np.einsum("nti,ntj->tij", each, each)
    share = np.zeros(len(errors))
    share[known] = np.linalg.norm(moves, axis=0)[known] / errors[known]
    return replace(linear, blocks=linear.blocks + added), share
