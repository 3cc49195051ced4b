"""Which parameter of a recorder would explain a misfit: a delay, gain, offset, scale, or sampling.

Where residuals of a channel hang together in time, or are larger than stated noise, each of these
that is no unknown is tried on the readings of the simulation at the estimate. With r the residuals
as a function of its value and M the projection onto what the unknowns of the fit cannot make up
for,

    S(value) = |M r(value)|^2

is the sum of squares that a fit with it would leave, to first order in the others. Those that come
far enough are then unknowns of a fit of a few iterations, which has the last word.

The share that one explains is the fall of S over its excess above white noise, which is as large as
differences of neighbouring readings say (von Neumann, Annals of Mathematical Statistics 12, 1941),
but no larger than stated. One is named where all of this holds:

* Its estimate is off the neutral value by more than chance makes in one of a hundred fits, over all
  that is tried (Bonferroni), in the score test with the covariance of the residuals that are left.
  Few fits of a right model are tried at all.
* It explains half of the misfit, and with it residuals are white; or four fifths, and some is left,
  as beside a second cause. Physics that a model lacks explains itself by no recorder so well.

Two that do the same to all that was measured are both named, as the gain of a load cell and that of
a scale of places, and neither is told from a mass that is held at a wrong value. Of two channels
whose starts are estimated, only the delay of one beside the other is known: the later is named.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from dashpot.calibrate.inference.explanation import Explanation
from dashpot.calibrate.inference.leftovers import Leftovers
from dashpot.calibrate.inference.misfit_report import hangs_together
from dashpot.calibrate.inference.recorder_trials import Quantity, Trial, recorder_trials
from dashpot.calibrate.inference.settlement import End
from dashpot.calibrate.inference.stated_noise import noise_explains
from dashpot.calibrate.problem.problem import Problem
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
# Residuals that are held at once.
_MOST_RESIDUALS = 2_000_000


@dataclass(frozen=True, eq=False)
class _Score:
    """What a trial comes to: how much it is worth, how likely by chance, and what it says."""

    trial: Trial
    worth: float
    chance: float
    said: Explanation


def explanations(search: Search, end: End) -> tuple[Explanation, ...]:
    """Return what would explain the misfit at the end of a search, best first; none without one.

    That takes of what is left of the budget of the search: without any nothing is said.
    """
    if not _is_bad(search, end):
        return ()
    left = Leftovers(search.objective, end.point, end.residuals, end.jacobian, search.loss)
    trials = list(recorder_trials(search.objective, end.point))
    scores = []
    for trial in trials:
        if search.budget.left == 0:
            break
        # What reads so may be beyond functions of the user's own.
        with suppress(SimulationError):
            scores.append(screened(trial, left))
        search.budget.spend(trial.simulated())
    level = FALSE_ALARMS / max(len(trials), 1)
    scores = _best([s for s in scores if s.chance < level and s.said.share >= _WORTH_A_REFIT])
    refitted = [_refitted(score, left, search, end) for score in scores[:_MOST_REFITS]]
    refitted = [_late(score, trials, search.objective.problem) for score in refitted]
    kept = [s for s in refitted if s.chance < level and s.said.share >= _least_share(s.said)]
    found = [score.said for score in _best(kept)]
    # What leaves some of the misfit is no match for what leaves none.
    return tuple(said for said in found if said.white or not found[0].white)[:MOST]


def _is_bad(search: Search, end: End) -> bool:
    """Whether residuals of a channel hang together, or are larger than noise that is stated."""
    misfit = any(channel.misfit for channel in end.channels)
    if misfit or search.objective.problem.noise == "estimate":
        return misfit
    live = int(np.count_nonzero(search.objective.live(end.residuals)))
    variance = end.covariance.residual_variance
    return not noise_explains(variance, live, robust=search.loss.robust)


def _least_share(said: Explanation) -> float:
    return LEAST_SHARE if said.white else LEAST_SHARE_BESIDE_ANOTHER


def _late(score: _Score, trials: Sequence[Trial], problem: Problem) -> _Score:
    """Return a delay beside the only other channel that may have one, of the later of the two."""
    delays = {trial.channel: trial for trial in trials if trial.quantity == "delay"}
    said, known = score.said, problem.initial_state == "given"
    moving = any(trajectory.control is not None for trajectory in problem.trajectories)
    if said.quantity != "delay" or len(delays) != 2 or known or moving:
        return score
    (other,) = (trial for name, trial in delays.items() if name != said.channel)
    if said.value > 0.0:
        return replace(score, said=replace(said, beside=other.channel))
    said = replace(
        said,
        channel=other.channel,
        value=-said.value,
        remedy=other.remedy,
        beside=said.channel,
    )
    return replace(score, trial=other, said=said)


def _best(scores: Sequence[_Score]) -> list[_Score]:
    """Return scores from the best on, one of each channel and quantity."""
    best: dict[tuple[str, Quantity], _Score] = {}
    for score in sorted(scores, key=lambda score: -score.worth):
        best.setdefault((score.trial.channel, score.trial.quantity), score)
    return list(best.values())


def screened(trial: Trial, left: Leftovers) -> _Score:
    """Return what a trial comes to, to first order in the other unknowns."""
    values = trial.values
    tried, counted, taken = left.of(trial.residuals(values[:2]), trial.rows)
    neutral = tried[0]
    if values.size == 2:
        slope = (tried[1] - tried[0]) / (values[1] - values[0])
        whole = trial.quantity == "sampling"
        at, residuals = float(values[0]), tried[1 if whole else 0]
    else:
        # The least of a coarse row of values, then of a fine one about it.
        spacing = float(np.min(np.diff(np.sort(values))))
        place = _least(trial, left, values)
        fine = place + 0.05 * spacing * np.arange(-19, 20)
        ends = values.min() + 0.05 * spacing, values.max() - 0.05 * spacing
        at = _least(trial, left, np.clip(fine, *ends))
        three = at + 0.05 * spacing * np.array([-1.0, 0.0, 1.0])
        tried, _, _ = left.of(trial.residuals(three), trial.rows)
        slope = (tried[2] - tried[0]) / (three[2] - three[0])
        residuals = tried[1]
    return _score(trial, left, at, neutral, residuals, slope, counted, taken)


def _least(trial: Trial, left: Leftovers, values: Array) -> float:
    """Return the value with the least sum of squares, of many."""
    together = max(1, _MOST_RESIDUALS // trial.rows.size)
    squares = [
        np.sum(left.of(trial.residuals(some), trial.rows)[0] ** 2, axis=1)
        for some in np.split(values, range(together, values.size, together))
    ]
    return float(values[int(np.argmin(np.concatenate(squares)))])


def _refitted(score: _Score, left: Leftovers, search: Search, end: End) -> _Score:
    """Return what a trial comes to with all unknowns refitted, as far as the budget allows."""
    trial, objective = score.trial, search.objective
    try:
        tried = objective.of(trial.around(score.said.value))
    except ValueError:
        return score  # delayed by so much, nothing would be left of some trajectory
    point, count = tried.as_from(objective, end.point), objective.parameters
    # What the misfit has driven to a bound hardly comes back from there.
    bound = np.flatnonzero(~left.free(point))
    point[bound] = objective.start()[bound]
    if trial.parameter is not None:
        last = tried.problem.parameters[-1]
        point = np.insert(point, count, last.coordinate.to_search(last.start))
    each = 2 * tried.parameters + tried.free_states.size
    total = min(search.budget.left, (_MOST_ITERATIONS + 2) * (each + 1))
    # The last iteration may go beyond, and derivatives at the end are one more.
    if total < 3 * (each + 1):
        return score
    own = Search(tried, search.loss, Budget(total - 2 * each - 1, lambda *_: None))
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
