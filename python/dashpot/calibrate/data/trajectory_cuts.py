"""Windows of a trajectory: from its start, or round an event."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory_checks import check_measured
from dashpot.checks import number

if TYPE_CHECKING:
    from dashpot.calibrate.data.trajectory import Trajectory

Array = NDArray[np.float64]


def head(trajectory: Trajectory, duration: float) -> Trajectory:
    """Return the frames up to `duration` s after the first, at least two of them."""
    if not number(f"{trajectory._label}: a window", duration) > 0:
        raise ValueError(f"{trajectory._label}: a window must be > 0 s, got {duration!r}")
    # Half a spacing of slack, so that a window of k spacings holds k + 1 frames.
    n = int(
        np.count_nonzero(
            trajectory.time - trajectory.time[0] <= duration + 0.5 * trajectory.spacing
        )
    )
    return _cut(trajectory, 0, max(n, 2))


def between(trajectory: Trajectory, start: float, end: float) -> Trajectory:
    """Return the frames from time `start` to time `end`."""
    first = number(f"{trajectory._label}: start", start)
    last = number(f"{trajectory._label}: end", end)
    slack = 1e-6 * trajectory.spacing
    begin, stop = np.searchsorted(trajectory.time, [first - slack, last + slack])
    if stop - begin < 2:
        raise ValueError(
            f"{trajectory._label}: {stop - begin} frames are between {first:.6g} and {last:.6g} s, "
            f"of those from {trajectory.time[0]:.6g} to {trajectory.time[-1]:.6g} s; two are needed"
        )
    return _cut(trajectory, int(begin), int(stop))


def _cut(trajectory: Trajectory, begin: int, stop: int) -> Trajectory:
    """Return frames `begin` to `stop`, which keep their places on the grid of the whole."""
    if begin == 0 and stop == trajectory.frames:
        return trajectory
    frames = slice(begin, stop)
    check_measured(trajectory, trajectory.position[frames], trajectory.quaternion[frames])
    cut = copy.copy(trajectory)
    for name in ("time", "position", "quaternion"):
        object.__setattr__(cut, name, getattr(trajectory, name)[frames])
    place = trajectory.frame_number[frames] - trajectory.frame_number[begin]
    place.flags.writeable = False
    object.__setattr__(cut, "_frame_number", place)
    if trajectory.control is not None:
        object.__setattr__(cut, "control", trajectory.control[begin : stop - 1])
    first, last = (
        float(trajectory.time[begin]),
        float(trajectory.time[stop - 1] + 1e-9 * trajectory.spacing),
    )
    own = {name: (t >= first) & (t <= last) for name, t in trajectory.sensor_times.items()}
    sensors = {
        name: readings[own.get(name, frames)] for name, readings in trajectory.sensors.items()
    }
    object.__setattr__(cut, "sensors", sensors)
    times = {name: time[own[name]] for name, time in trajectory.sensor_times.items()}
    object.__setattr__(cut, "sensor_times", times)
    events = {name: t[~((t < first) | (t > last))] for name, t in trajectory.events.items()}
    object.__setattr__(cut, "events", {k: v for k, v in events.items() if v.size})
    # They are of the whole.
    object.__setattr__(cut, "scalars", {})
    if begin > 0:
        for name in ("initial_qpos", "initial_qvel"):
            object.__setattr__(cut, name, None)
            object.__setattr__(cut, f"{name}_sigma", None)
    return cut
