"""The search for a plan: least squares, with time weighed as evenness allows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from dashpot.grinding.problem import Problem, Trial
from dashpot.grinding.profile import Profiles

__all__ = ["search"]

Array = NDArray[np.float64]

_ROUNDS = 4
_EVALUATIONS = 8
_FASTER = 0.995


def search(problem: Problem, start: tuple[Profiles, Array] | None = None) -> tuple[Trial, bool]:
    """Return the fastest candidate that is as even as was asked for, and whether one is.

    Parameters
    ----------
    problem
        The problem.
    start
        Profiles and unknowns of a plan to begin with, or None.
    """
    best = problem.start()
    if start is not None and len(start[1]) == problem.size:
        lower, upper = problem.bounds
        own, (old, told) = problem.profiles, start
        # The same forces and feeds: the bound of the feed may be another one now.
        share = np.minimum(old.feed(told) / own.largest_feed, 1.0)
        unknowns = own.fitted(share, old.force(told))
        warm = problem.evaluate([np.clip(unknowns, lower, upper)])[0]
        best = min(best, warm, key=lambda each: float(np.abs(each.deviation).max()))
    for _ in range(2):
        trial = problem.evaluate([problem.corrected(best)])[0]
        if np.std(trial.deviation) < np.std(best.deviation):
            best = trial
    fastest: Trial | None = None
    for _ in range(_ROUNDS):
        trial = _searched(problem, best)
        if _good(problem, trial):
            faster = fastest is None or (
                trial.command.law.duration < _FASTER * fastest.command.law.duration
            )
            if not faster:
                break
            fastest = best = trial
            problem.time_weight *= 3.0
        else:
            if fastest is not None:
                break
            best = trial
            problem.time_weight /= 4.0
    return (best, False) if fastest is None else (fastest, True)


def _searched(problem: Problem, start: Trial) -> Trial:
    """Return the end of one search, whose derivative is that at its start."""
    trials = {start.unknowns.tobytes(): start}

    def trial(unknowns: Array) -> Trial:
        key = unknowns.tobytes()
        if key not in trials:
            trials[key] = problem.evaluate([unknowns])[0]
        return trials[key]

    derivative = problem.derivative(start)
    lower, upper = problem.bounds
    inside = np.clip(start.unknowns, lower + 1e-9, upper - 1e-9)
    trials.setdefault(inside.tobytes(), start)
    found = least_squares(
        lambda unknowns: problem.residuals(trial(unknowns)),
        inside,
        jac=lambda unknowns: derivative,
        bounds=(lower, upper),
        x_scale="jac",
        max_nfev=_EVALUATIONS,
    )
    return trial(found.x)


def _good(problem: Problem, trial: Trial) -> bool:
    target, deviation = problem.target, trial.deviation
    return bool(
        deviation.std() <= target.uniformity
        and np.abs(deviation).max() <= target.largest
        and trial.found.total.max() <= target.max_force
    )
