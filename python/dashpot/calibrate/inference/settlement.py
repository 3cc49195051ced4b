"""What the end of a search is worth: its intervals, and whether the cost is lower elsewhere.

Noise of some hundred residuals hides valleys: it explains a cost of three standard deviations of
its own above the least one, which is more than ten standard errors of a parameter. So where an end
counts as explained, the cost is followed along each parameter to its bounds, all else refitted
(`dashpot.calibrate.inference.profiles`), and the search goes on from where that is lower, or
falls again beyond a hill, where refits without derivatives of their own may lag. Where that is no
lower, but as low as confidence asks for, intervals reach over both valleys. Intervals go on to
where the cost has risen by what their confidence asks for: with t the quantile of Student's
distribution, ``t^2 / 2`` times the dispersion (Meeker and Escobar, The American Statistician 49,
1995). Curvature does not tell that where one side is flat, as of friction that soon holds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.inference.fit_errors import covariance_around
from dashpot.calibrate.inference.intervals import Covariance
from dashpot.calibrate.inference.misfit_report import (
    ChannelReport,
    misfit_covariance,
    report_channels,
)
from dashpot.calibrate.inference.profiles import Place, Profiles, beyond_a_hill, reach
from dashpot.calibrate.inference.stated_noise import MAX_VARIANCE, noise_explains
from dashpot.calibrate.inference.statistical_linearization import near, region_evaluations
from dashpot.calibrate.residuals.arrow import ArrowMatrix
from dashpot.calibrate.residuals.candidates import SimulationError
from dashpot.calibrate.residuals.objective import Objective
from dashpot.calibrate.search.least_squares import least_squares
from dashpot.calibrate.search.search import Search
from dashpot.calibrate.search.strategy import MOST_ITERATIONS, finish

Array = NDArray[np.float64]

# The search goes on where the cost is lower by more than one standard error raises it, so often at
# most.
_LOWER = 0.5
_MOST_ROUNDS = 3
# Another search is worth it where so many of its iterations are left, of which it takes a share.
_SEARCH_AND_ERRORS, _SEARCH_SHARE = 10, 0.75
# What `settle` usually takes beside two Jacobians: regions, and evaluations of each parameter's
# profile.
_USUAL_REGIONS, _USUAL_WALK = 2, 24


@dataclass(frozen=True, eq=False)
class End:
    """The end of a search.

    Attributes
    ----------
    point, residuals, jacobian
        (n,), (m,) and (m, n).
    covariance, departure
        Of the estimate, and in standard errors how far that is from a linear one, (n,).
    intervals
        (p, 2) ends of the parameters' intervals in search coordinates.
    failure
        Why simulations next to it fail; None where they do not.
    channels
        What residuals say of each channel.
    elsewhere
        Values of the parameters where the cost is lower, but no search went on from.
    complete
        Whether the budget sufficed to follow the cost along all parameters.
    """

    point: Array
    residuals: Array
    jacobian: ArrowMatrix
    covariance: Covariance
    departure: Array
    intervals: Array
    failure: str | None
    channels: tuple[ChannelReport, ...]
    elsewhere: str | None = None
    complete: bool = True


def reserve_for(objective: Objective, total: int, *, converges: bool) -> int:
    """Return how much of a budget to leave to `settle`: what it usually takes, half at most.

    Of a search that hardly converges, as CMA-ES, that is derivatives alone.
    """
    derivatives = 2 * (objective.parameters + objective.free_states.size)
    usual = 2 * derivatives
    if converges:
        usual += _USUAL_REGIONS * region_evaluations(objective)
        usual += _USUAL_WALK * objective.parameters
    return min(total // 2, usual)


def settle(search: Search, errors: str, confidence: float, seed: int) -> End:
    """Return the end of a search, with what it is worth.

    It takes what is left of the search's budget, its reserve included, and one Jacobian at least.
    Searches that profiles of the cost bring about are part of `search`.
    """
    budget = search.budget
    budget.release()
    for _ in range(_MOST_ROUNDS):
        with budget.beside(search.objective):
            end, place = _examine(search, errors, confidence, seed)
        if place is None or budget.left < _SEARCH_AND_ERRORS * search.iteration:
            break
        trial = Search(search.objective, search.loss, budget)
        with budget.share(_SEARCH_SHARE):
            try:
                least_squares(trial, place.point, MOST_ITERATIONS)
            except SimulationError:
                break
            if trial.best_cost >= search.best_cost - _LOWER * _dispersion(end.covariance):
                end = _with_valley(end, trial, search.best_cost, errors, confidence, seed)
                break
            search.take_over(trial)
            finish(search)
    return end


def _with_valley(
    end: End, trial: Search, lowest: float, errors: str, confidence: float, seed: int
) -> End:
    """Return an end whose intervals reach over another valley, where the cost is as low."""
    rise = 0.5 * end.covariance.quantile(confidence) ** 2 * _dispersion(end.covariance)
    if trial.best_cost > lowest + rise:
        return end
    with trial.budget.beside(trial.objective):
        other, _ = _examine(trial, errors, confidence, seed)
    lower = np.fmin(end.intervals[:, 0], other.intervals[:, 0])
    upper = np.fmax(end.intervals[:, 1], other.intervals[:, 1])
    return replace(end, intervals=np.stack([lower, upper], axis=1))


def _dispersion(covariance: Covariance) -> float:
    """Return the least of the parameters that are determined."""
    known = covariance.standard_error[: covariance.parameters]
    return float(np.min(covariance.dispersion[np.isfinite(known)]))


def _examine(search: Search, errors: str, confidence: float, seed: int) -> tuple[End, Place | None]:
    """Return the best point of a search as its end, and from where the cost may be lower, if so.

    That is where it is, or else the lowest place beyond a hill.
    """
    objective, loss, point = search.objective, search.loss, search.best_point
    residuals, budget = search.best_residuals, search.budget
    channels = report_channels(objective, residuals)
    misfit = misfit_covariance(objective, residuals, channels, loss)
    covariance, departure, jacobian, failure = covariance_around(
        objective,
        point,
        residuals,
        loss,
        errors,
        confidence,
        seed if search.converged else None,
        misfit,
        lambda: budget.left,
    )
    half_widths = covariance.half_width(confidence)[: objective.parameters]
    known = np.isfinite(half_widths) & (half_widths > 0.0)
    middle = point[: objective.parameters]
    intervals = np.stack([middle - half_widths, middle + half_widths], axis=1)
    end = End(
        point, residuals, jacobian, covariance, departure, intervals, failure, tuple(channels)
    )
    variance = covariance.residual_variance
    live = int(np.count_nonzero(objective.live(residuals)))
    doubtful = variance > MAX_VARIANCE and not noise_explains(variance, live, robust=loss.robust)
    doubtful = doubtful and any(channel.misfit for channel in channels)
    if failure is not None or not search.converged or doubtful or not known.any():
        return end, None
    ranges = [c.search_bounds[1] - c.search_bounds[0] for c in objective.coordinates]
    units = np.concatenate([ranges, np.tile(near(objective), len(objective.layouts))])
    lower, upper = (bound[: objective.parameters] for bound in objective.bounds())
    dispersion = _dispersion(covariance)
    profiles = Profiles(loss, (lower, upper), units, 0.5 * dispersion)
    begin = Place(point, residuals, profiles.cost(residuals))
    sides, complete = profiles.around(
        lambda points: objective.attempt(points)[0],
        begin,
        jacobian,
        half_widths,
        lambda: budget.left,
    )
    end = replace(end, complete=complete)
    places = [place for both in sides for side in both for place in side]
    lowest = min([begin, *places], key=lambda place: place.cost)
    quantile = covariance.quantile(confidence)
    rises = 0.5 * quantile**2 * covariance.dispersion
    for i in map(int, np.flatnonzero(known)):
        below, above = (reach(side, i, begin, lowest.cost, rises[i]) for side in sides[i])
        intervals[i] = (
            min(intervals[i, 0], middle[i] - below),
            max(intervals[i, 1], middle[i] + above),
        )
    if lowest.cost >= begin.cost - _LOWER * dispersion:
        beyond = [
            beyond_a_hill(side, begin, 0.5 * quantile**2 * dispersion)
            for both in sides
            for side in both
        ]
        found = [place for place in beyond if place is not None]
        return end, min(found, key=lambda place: place.cost, default=None)
    values = objective.values(lowest.point).items()
    end = replace(end, elsewhere=", ".join(f"{name} = {value:.4g}" for name, value in values))
    return end, lowest
