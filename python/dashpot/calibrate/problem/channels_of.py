"""The channels of a trajectory, of what it carries and how well that was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.angles import turn_of, unwrapped
from dashpot.calibrate.problem.channels import POSES, Channel
from dashpot.calibrate.problem.observables import Sensor

Array = NDArray[np.float64]

# Stands for a quaternion that was not measured.
_ANY = np.array([1.0, 0.0, 0.0, 0.0])
_NEVER = (0.0, 0.0)


def channels_of(
    trajectory: Trajectory,
    pose_sigma: Array,
    sensors: Sequence[tuple[Sensor, float | Sequence[float]]],
    event_sigma: Mapping[str, float],
    scalar_sigma: Mapping[str, float],
    delays: Mapping[str, tuple[float, float]],
) -> list[Channel]:
    """Return the channels of a trajectory: poses, sensors, events, scalars.

    Parameters
    ----------
    trajectory
        Within the window.
    pose_sigma
        (6,) of x, y, z (m) and rotations (rad).
    sensors
        Those that it observes, in order, with their standard deviations.
    event_sigma, scalar_sigma
        Standard deviations by kind.
    delays
        Bounds by channel, s. What a reading before the upper one shows may be of the time before
        the start, so it does not count.

    Raises
    ------
    ValueError
        Naming the kind of an event or scalar whose noise is not stated.
    """
    start = trajectory.time[0]
    time = trajectory.time - start
    result = []
    if trajectory.bodies:
        result.append(_poses(trajectory, time, pose_sigma, delays.get(POSES, _NEVER)))
    for sensor, deviations in sensors:
        result.append(_sensor(trajectory, sensor, deviations, delays.get(sensor.name, _NEVER)))
    for name, times in trajectory.events.items():
        sigma = _stated(trajectory, "event", name, event_sigma)
        result.append(_moments(name, "event", times - start, sigma, time[-1]))
    for name, values in trajectory.scalars.items():
        sigma = _stated(trajectory, "scalar", name, scalar_sigma)
        result.append(_moments(name, "scalar", values, sigma, time[-1]))
    return result


def _poses(
    trajectory: Trajectory, time: Array, sigma: Array, delay: tuple[float, float]
) -> Channel:
    n, count = trajectory.frames, len(trajectory.bodies)
    position = np.nan_to_num(trajectory.position)
    quaternion = np.where(np.isnan(trajectory.quaternion), _ANY, trajectory.quaternion)
    measured = trajectory.measured & np.isfinite(sigma)
    measured[time < delay[1]] = False
    return Channel(
        name=POSES,
        kind="poses",
        time=time,
        observed=np.concatenate([position, quaternion], axis=-1).reshape(n, 7 * count),
        sigma=np.tile(sigma, count),
        measured=measured.reshape(n, 6 * count),
    )


def _sensor(
    trajectory: Trajectory,
    sensor: Sensor,
    sigma: float | Sequence[float],
    delay: tuple[float, float],
) -> Channel:
    readings = trajectory.sensors[sensor.name]
    # Of planes each trajectory may have its own.
    sensor = replace(sensor, view=trajectory.views.get(sensor.name))
    own = sensor.name in trajectory.sensor_times
    time = trajectory.sensor_time(sensor.name) - trajectory.time[0]
    spacing = float(np.median(np.diff(time))) if own and time.size > 1 else trajectory.spacing
    mean = trajectory.sampling.get(sensor.name, "mean" if sensor.mean else "instant") == "mean"
    deviations = np.broadcast_to(np.asarray(sigma, dtype=np.float64), sensor.size)
    seen = ~np.isnan(readings) & np.isfinite(deviations)
    # What comes before the start is not simulated.
    window = spacing if mean else 0.0
    seen[time - delay[1] < 0.5 * window] = False
    return Channel(
        name=sensor.name,
        kind="sensor",
        time=time,
        observed=np.nan_to_num(unwrapped(readings) if sensor.turns else readings),
        sigma=np.array(deviations),
        measured=seen,
        sensor=sensor,
        window=window,
        own_clock=own,
        turn=turn_of(readings) if sensor.turns else 0.0,
    )


def _stated(trajectory: Trajectory, kind: str, name: str, sigma: Mapping[str, float]) -> float:
    if name not in sigma:
        raise ValueError(f"trajectory '{trajectory.name}': {kind} {name!r} has no {kind}_sigma")
    return sigma[name]


def _moments(
    name: str, kind: Literal["event", "scalar"], values: Array, sigma: float, end: float
) -> Channel:
    observed = ~np.isnan(values)
    return Channel(
        name=name,
        kind=kind,
        time=np.where(observed, values, end) if kind == "event" else np.full(values.size, end),
        observed=np.nan_to_num(values)[:, None],
        sigma=np.array([sigma]),
        measured=(observed & np.isfinite(sigma))[:, None],
    )
