"""Starts and windows that a fit chooses where the search from the given start ends badly.

Trajectories that were started alike stay together until the parameters matter, mostly until the
first impact. Shortly after it the cost has few valleys; every further impact adds some. So further
starts are simulated once over the whole problem, the time at which they part is read off, and the
searches from them go through windows that grow from there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.residuals.objective import Objective

Array = NDArray[np.float64]

# Shares of the time after the onset that the first windows cover; the whole problem follows.
_WINDOW_SHARES = (0.125, 0.25, 0.5)
# Trajectories count as parted when the middle half of the starts spans this many standard
# deviations of the noise.
_PARTED = 3.0
# Share of the trajectories that must have parted at the onset.
_PARTED_SHARE = 75.0
# A window is searched when it holds this many residuals for each unknown.
_RESIDUALS_PER_UNKNOWN = 2


def growing_windows(objective: Objective, residuals: Array) -> list[float]:
    """Return ascending windows (s) to search before the whole problem; empty where nothing parts.

    Parameters
    ----------
    objective
        Of the whole problem.
    residuals
        (starts, residual_count) of points that differ in the parameters only.
    """
    problem = objective.problem
    onsets, ends = [], []
    for t in range(len(problem.trajectories)):
        rows = residuals[:, objective.offsets[t] : objective.offsets[t + 1]]
        first, end = np.inf, 0.0
        blocks = objective.layouts[t].split(rows)
        for channel, block in zip(objective.recorders[t].channels, blocks, strict=True):
            low, high = np.percentile(block, [25.0, 75.0], axis=0)
            parted = channel.time[(high - low > _PARTED).any(axis=1)]
            first = min(first, float(parted.min(initial=np.inf)))
            end = max(end, float(channel.time.max(initial=0.0)))
        ends.append(end)
        if np.isfinite(first):
            onsets.append(first)
    if not onsets:
        return []
    onset, end = float(np.percentile(onsets, _PARTED_SHARE)), max(ends)
    windows = (onset + share * (end - onset) for share in _WINDOW_SHARES)
    return [window for window in windows if _determines(problem, window, objective.size)]


def _determines(problem: Problem, window: float, unknowns: int) -> bool:
    try:
        within = problem.with_window(window)
    except ValueError:
        return False  # of some trajectory it leaves nothing that was measured
    count = sum(int(np.count_nonzero(m)) for m in within.measured())
    return count >= _RESIDUALS_PER_UNKNOWN * unknowns
