"""How much noise readings have, from how far they are from smooth paths.

Of four readings in a row one linear combination is zero on any parabola: noise is left of it. Those
at corners of paths, as at impacts, are far from the others, and left out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory

Array = NDArray[np.float64]

_WEIGHTS = np.array([1.0, -3.0, 3.0, -1.0]) / np.sqrt(20.0)
_MEDIAN = 0.6745  # of the size of normal noise of 1
# What is further off than this does not count, of normal noise a hundredth, which leaves so much.
_FURTHEST, _LEFT = 2.5, 0.9546
_MEDIAN_OF_THREE = 1.5382  # of the length of three such
# Noise is this share of the range of readings at least: no sensor is better.
_LEAST = 1e-5


def position_noise(trajectories: Sequence[Trajectory]) -> float:
    """Return the standard deviation of coordinates, m; infinite where none was measured."""
    columns = [p for t in trajectories for p in t.position.reshape(t.frames, -1).T]
    return noise_of(columns)


def rotation_noise(trajectories: Sequence[Trajectory]) -> float:
    """Return the standard deviation of rotations, rad; infinite where none was measured."""
    lengths: list[Array] = [np.empty(0)]
    for trajectory in trajectories:
        for quaternion in trajectory.quaternion.transpose(1, 0, 2):
            seen = quaternion[~np.isnan(quaternion[:, 0])]
            if len(seen) > 3:
                turn = np.sign(np.sum(seen[1:] * seen[:-1], axis=1))
                signs = np.concatenate([[1.0], np.cumprod(np.where(turn == 0.0, 1.0, turn))])
                left = _left((seen * signs[:, None]).T)
                lengths.append(np.linalg.norm(left, axis=0))
    every = np.concatenate(lengths)
    # A quaternion changes by half of the angle.
    return max(2.0 * float(np.median(every)) / _MEDIAN_OF_THREE, _LEAST) if every.size else np.inf


def sensor_noise(trajectories: Sequence[Trajectory]) -> dict[str, float]:
    """Return the standard deviation of each sensor, in its unit."""
    columns: dict[str, list[Array]] = {}
    for trajectory in trajectories:
        for name, readings in trajectory.sensors.items():
            columns.setdefault(name, []).extend(readings.T)
    return {name: noise_of(several) for name, several in columns.items()}


def noise_of(columns: Sequence[Array]) -> float:
    """Return the standard deviation of readings (n,) of one kind; infinite where there are none."""
    seen = [column[~np.isnan(column)] for column in columns]
    left = np.concatenate([np.empty(0), *(_left(column) for column in seen if column.size > 3)])
    if not left.size:
        return np.inf
    least = _LEAST * max(float(np.ptp(column)) for column in seen if column.size)
    size = float(np.median(np.abs(left))) / _MEDIAN
    for _ in range(10):
        kept = left[np.abs(left) <= _FURTHEST * size]
        size = float(np.sqrt(np.mean(kept**2))) / _LEFT if kept.size else 0.0
    return max(size, least) or np.inf


def _left(values: Array) -> Array:
    """Return what is left of four values in a row (..., n) off a parabola."""
    return np.asarray(np.lib.stride_tricks.sliding_window_view(values, 4, axis=-1) @ _WEIGHTS)
