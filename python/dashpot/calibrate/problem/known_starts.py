"""How well the initial states of trajectories are known beforehand.

Where a problem estimates them, a degree of freedom is free, held as it is given, or given with a
standard deviation: what is given is then a reading like those of the motion, with the residual
``(x - given) / sigma``. Bodies that nothing observes, at rest in a place that is known, would else
be moved and turned at will to make up for parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class KnownStarts:
    """What is known of the s unknowns of each initial state: velocities, displacements, a clock.

    Attributes
    ----------
    sigma
        (trajectories, s) 0: held; inf: free.
    given
        (trajectories, s).
    """

    sigma: Array
    given: Array

    @property
    def held(self) -> NDArray[np.bool_]:
        """(trajectories, s) whether it is held as given, and so not estimated."""
        return np.equal(self.sigma, 0.0)

    def with_held(self, states: Array) -> Array:
        """Return states (..., trajectories, s) with those that are held as they are given."""
        return np.where(self.held, self.given, states)

    def residuals(self, states: Array) -> Array:
        """Return the residuals (..., k) of what is given, by trajectory, of states (..., t, s)."""
        read = is_reading(self.sigma)
        return np.asarray((states - self.given)[..., read] / self.sigma[read])


def is_reading(sigma: Array) -> NDArray[np.bool_]:
    """Whether what is given is a reading, neither exact nor unknown."""
    return (sigma > 0.0) & np.isfinite(sigma)


def start_sigma(
    trajectories: Sequence[Trajectory], initial_state: str, unseen: Sequence[NDArray[np.bool_]]
) -> Array:
    """Return the standard deviations (trajectories, s) of the unknowns of initial states.

    The last one is how much slower than its spacing says a trajectory runs, a share of that, where
    the rate of frames of any is not known exactly.

    Parameters
    ----------
    trajectories
        Say them, or not.
    initial_state
        What the problem estimates.
    unseen
        By trajectory, (nv,) degrees of freedom that are held where it says nothing.
    """
    parts = {"given": 0, "velocity": 1, "pose_and_velocity": 2}[initial_state]
    clock = any(trajectory.rate_sigma > 0.0 for trajectory in trajectories)
    nv = unseen[0].size
    found = np.empty((len(trajectories), parts * nv + clock))
    for row, trajectory, hidden in zip(found, trajectories, unseen, strict=True):
        known = (trajectory.initial_qvel_sigma, trajectory.initial_qpos_sigma)[:parts]
        free = np.where(hidden, 0.0, np.inf)
        for part, sigma in enumerate(known):
            row[part * nv : (part + 1) * nv] = free if sigma is None else sigma
        if clock:
            row[-1] = trajectory.rate_sigma
    return found
