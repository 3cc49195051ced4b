"""Which parameter of a recorder would explain a misfit: a delay, gain, offset, scale, or sampling.

Where residuals of a channel hang together in time, each of these that is no unknown is tried on the
readings of the simulation at the estimate. With r the residuals as a function of its value and M
the projection onto what the unknowns of the fit cannot make up for,

    S(value) = |M r(value)|^2

is the sum of squares that a fit with it would leave, to first order in the others. Those that come
far enough are then unknowns of a fit of a few iterations, which has the last word.

The share that one explains is the fall of S over its excess above white noise, which is as large as
differences of neighbouring readings say (von Neumann, Annals of Mathematical Statistics 12, 1941),
but no larger than stated. One is named where all of this holds:

* Its estimate is off the neutral value by more than chance makes in one of a hundred fits, over all
  that is tried (Bonferroni), in the score test with the covariance of the residuals that are left.
  Fits of a right model are tried in one of some hundred, as they have no misfit (`Fit.misfits`).
* It explains half of the misfit, and with it residuals are white; or four fifths, and some is left,
  as beside a second cause. Physics that a model lacks explains itself by no recorder so well.

Two that do the same to all that was measured are both named: a load cell that is late and a camera
that is early, or a gain of force and a mass that is held at another value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from dashpot.calibrate.inference.leftovers import Leftovers
from dashpot.calibrate.inference.misfit_report import hangs_together
from dashpot.calibrate.inference.recorder_trials import Quantity, Trial, recorder_trials
from dashpot.calibrate.inference.settlement import End
from dashpot.calibrate.residuals.candidates import SimulationError
from dashpot.calibrate.residuals.misfit import residual_covariance
from dashpot.calibrate.residuals.whiteness import whiteness
from dashpot.calibrate.search.budget import Budget
from dashpot.calibrate.search.least_squares import least_squares
from dashpot.calibrate.search.search import Search

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

LEAST_SHARE, LEAST_SHARE_BESIDE_ANOTHER = 0.5, 0.8
FALSE_ALARMS = 0.01
MOST = 3
# To first order shares may be too small.
_WORTH_A_REFIT = 0.05
_MOST_REFITS, _MOST_ITERATIONS = 4, 12


@dataclass(frozen=True)
class Explanation:
    """A parameter of a recorder that would explain a misfit.

    Attributes
    ----------
    channel
        That reads so: ``"poses"``, or the name of a sensor, event or scalar.
    quantity
        As the methods of `Parameter`; ``"sampling"``: as ``Trajectory(sampling=...)``.
    value
        The estimate, in the unit of the parameter. Of sampling 1: the other than now.
    standard_error
        In the same unit.
    share
        Of the misfit that it explains, up to 1.
    white
        Whether nothing of the misfit is seen any more with it.
    unit
        Of the value; empty where there is none.
    remedy
        How the problem would say it.
    """

    channel: str
    quantity: Quantity
    value: float
    standard_error: float
    share: float
    white: bool
    unit: str = ""
    remedy: str = ""

    def __str__(self) -> str:
        """Return what it looks like, how it is said, and how much it explains."""
        rest = "" if self.white else ", and leaves some"
        share = f"{100.0 * self.share:.0f} %"
        return f"{self._looks} ({self.remedy}): explains {share} of the misfit{rest}"

    @property
    def _looks(self) -> str:
        value, error = self.value, self.standard_error
        if self.quantity == "delay":
            which = "late" if value > 0.0 else "early"
            return f"{self.channel} looks {_told(1e3 * abs(value), 1e3 * error)} ms {which}"
        if self.quantity == "gain":
            return f"{self.channel} looks {_told(value, error)} times as large as it is"
        if self.quantity == "scale":
            which = "large" if value > 1.0 else "small"
            told = _told(100.0 * abs(value - 1.0), 100.0 * error)
            return f"positions look {told} % too {which}"
        if self.quantity == "offset":
            which = "large" if value > 0.0 else "small"
            return f"{self.channel} looks {_told(abs(value), error)} {self.unit} too {which}"
        mean = "mean" in self.remedy
        return (
            f"{self.channel} looks like {'means, not instants' if mean else 'instants, no means'}"
        )


@dataclass(frozen=True, eq=False)
class _Score:
    """What a trial comes to: how much it is worth, how likely by chance, and what it says."""

    trial: Trial
    worth: float
    chance: float
    said: Explanation


def explanations(search: Search, end: End) -> tuple[Explanation, ...]:
    """Return what would explain the misfit at the end of a search, best first; none without one.

    Refits take of what is left of the budget of the search; of a robust loss residuals count as it
    weighs them at the estimate.
    """
    if not any(channel.misfit for channel in end.channels):
        return ()
    left = Leftovers(search.objective, end.point, end.residuals, end.jacobian, search.loss)
    trials = list(recorder_trials(search.objective, end.point))
    scores = [screened(trial, left) for trial in trials]
    search.budget.spend(sum(trial.simulations for trial in trials))
    level = FALSE_ALARMS / max(len(trials), 1)
    scores = _best([s for s in scores if s.chance < level and s.said.share >= _WORTH_A_REFIT])
    refitted = [_refitted(score, left, search, end) for score in scores[:_MOST_REFITS]]
    kept = [s for s in refitted if s.chance < level and s.said.share >= _least_share(s.said)]
    return tuple(score.said for score in _best(kept))[:MOST]


def _least_share(said: Explanation) -> float:
    return LEAST_SHARE if said.white else LEAST_SHARE_BESIDE_ANOTHER


def _best(scores: Sequence[_Score]) -> list[_Score]:
    """Return scores from the best on, one of each channel and quantity."""
    best: dict[tuple[str, Quantity], _Score] = {}
    for score in sorted(scores, key=lambda score: -score.worth):
        best.setdefault((score.trial.channel, score.trial.quantity), score)
    return list(best.values())


def screened(trial: Trial, left: Leftovers) -> _Score:
    """Return what a trial comes to, to first order in the other unknowns."""
    values = trial.values
    tried, counted, taken = left.of(trial.residuals(values), trial.rows)
    neutral = tried[0]
    if values.size == 2:
        slope = (tried[1] - tried[0]) / (values[1] - values[0])
        whole = trial.quantity == "sampling"
        at, residuals = float(values[0]), tried[1 if whole else 0]
    else:
        # The least of a coarse row of values, then of a fine one about it.
        place = values[int(np.argmin(np.sum(tried**2, axis=1)))]
        spacing = float(np.min(np.diff(np.sort(values))))
        values = place + 0.05 * spacing * np.arange(-20, 21)
        values = values[(values >= trial.values.min()) & (values <= trial.values.max())]
        tried, _, _ = left.of(trial.residuals(values), trial.rows)
        k = int(np.clip(np.argmin(np.sum(tried**2, axis=1)), 1, values.size - 2))
        slope = (tried[k + 1] - tried[k - 1]) / (values[k + 1] - values[k - 1])
        at, residuals = float(values[k]), tried[k]
    return _score(trial, left, at, neutral, residuals, slope, counted, taken)


def _refitted(score: _Score, left: Leftovers, search: Search, end: End) -> _Score:
    """Return what a trial comes to with all unknowns refitted, as far as the budget allows."""
    trial, objective = score.trial, search.objective
    tried = objective.of(trial.around(score.said.value))
    point, count = end.point.copy(), objective.parameters
    # What the misfit has driven to a bound hardly comes back from there.
    bound = np.flatnonzero(~left.free(point))
    point[bound] = objective.start()[bound]
    if trial.parameter is not None:
        last = tried.problem.parameters[-1]
        point = np.insert(point, count, last.coordinate.to_search(last.start))
    each = 2 * tried.parameters + tried.initial_size
    total = min(search.budget.left, _MOST_ITERATIONS * (each + 1) + each)
    if total < 2 * each + 2:
        return score
    own = Search(tried, search.loss, Budget(total - each, lambda *_: None))
    try:
        least_squares(own, point, _MOST_ITERATIONS)
        jacobian = tried.jacobian(own.best_point, base=own.best_residuals)
    except SimulationError:
        return score
    finally:
        search.budget.spend(tried.evaluations)
    slope = np.zeros(len(jacobian.shared))
    value = float(trial.values[0])
    rows = np.concatenate(tried.problem.measured())
    if trial.parameter is not None:
        coordinate, z = last.coordinate, float(own.best_point[count])
        value = coordinate.to_value(z)
        per_z = (coordinate.to_value(z + 1e-4) - coordinate.to_value(z - 1e-4)) / 2e-4
        slope = jacobian.shared[:, count] / per_z
        jacobian = replace(jacobian, shared=jacobian.shared[:, :count])
    at_end = left.moved(
        np.delete(own.best_point, count) if trial.parameter else own.best_point, jacobian
    )
    (residuals, slope), counted, taken = at_end.of(np.stack([own.best_residuals, slope]), rows)
    (neutral,), _, _ = left.of(end.residuals[None], rows)
    found = _score(trial, left, value, neutral, residuals, slope, counted, taken)
    if trial.parameter is None:
        said = replace(found.said, value=score.said.value, standard_error=score.said.standard_error)
        return replace(found, chance=score.chance, said=said)
    return found


def _score(
    trial: Trial,
    left: Leftovers,
    at: float,
    neutral: Array,
    residuals: Array,
    slope: Array,
    counted: Bools,
    taken: int,
) -> _Score:
    """Return what a trial comes to.

    Parameters
    ----------
    trial, left
        What is tried, and where.
    at
        Value of the parameter of `residuals`; of sampling the neutral one.
    neutral, residuals, slope
        (m,) what the other unknowns leave of the residuals of the fit, of those with it, and of
        their derivative.
    counted, taken
        (m,) which residuals count, and how many unknowns took of them.
    """
    size = float(slope @ slope)
    whole = trial.parameter is None
    start = neutral if whole else residuals
    step = -float(slope @ start) / size if size > 0.0 else 0.0
    end = residuals if whole else residuals + step * slope
    white = whiteness(left.objective, end, counted)
    coloured = [w.channel for w in white if hangs_together(w)]
    covariance = residual_covariance(left.objective, end, counted, coloured)
    number = int(np.count_nonzero(counted))
    degrees = max(number - taken - 1, 1)
    value, error = at + step, np.inf
    if size > 0.0:
        error = float(np.sqrt(slope @ covariance.apply(slope[None])[0] * number / degrees)) / size
    off = abs(value - float(trial.values[0])) / max(error, 1e-300)
    before, after = float(neutral @ neutral), float(end @ end)
    share = (before - after) / max(before - left.noise(counted), 1e-12)
    # A value that is estimated takes a little by chance (Schwarz, Annals of Statistics 6, 1978).
    free = 0.0 if whole else float(np.log(number)) / degrees
    return _Score(
        trial,
        worth=(before - after * (1.0 + free)) / max(before, 1e-300),
        chance=2.0 * float(special.stdtr(degrees, -off)),
        said=Explanation(
            channel=trial.channel,
            quantity=trial.quantity,
            value=value,
            standard_error=error,
            share=min(max(share, 0.0), 1.0),
            white=not coloured,
            unit=trial.unit,
            remedy=trial.remedy,
        ),
    )


def _told(value: float, error: float) -> str:
    """Return a value with the digits that its error leaves, and the error."""
    digits = int(np.clip(np.ceil(-np.log10(error)), 0, 9)) if error > 0.0 else 6
    return f"{value:.{digits}f} ± {error:.{digits}f}"
