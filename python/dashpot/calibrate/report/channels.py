"""The numbers that are compared of a trajectory, one by one, with names and units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.channels import POSES, Channel
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.units import sensor_unit
from dashpot.calibrate.report.record import Curve, Residual, Shown

if TYPE_CHECKING:
    import mujoco

    from dashpot.calibrate.prediction import Prediction

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

_AXES = ("x", "y", "z")
_QUATERNION = ("qw", "qx", "qy", "qz")
_PEAK = "peak:"


@dataclass(frozen=True, eq=False)
class _Number:
    """One column of a channel: (rows,) measured, NaN where not, and of each simulation."""

    name: str
    unit: str
    sigma: float
    measured: Array
    simulated: list[Array]


def shown(
    problem: Problem,
    model: mujoco.MjModel,
    trajectory: Trajectory,
    readings: Sequence[Mapping[str, Array]],
    residuals: Mapping[str, Array],
) -> Shown:
    """Return a trajectory of a problem as a report shows it.

    Parameters
    ----------
    problem, model
        What was compared.
    trajectory
        One of the problem.
    readings
        By channel (rows, columns), of all of the trajectory: what is simulated with the estimates,
        then with draws of them.
    residuals
        By channel (rows, columns), weighted, within the problem's window.
    """
    curves: list[Curve] = []
    for channel in problem.with_window(None).channels(trajectory):
        place: Array = channel.time
        axis = "time [s]"
        if channel.kind in ("event", "scalar", "residual"):
            place = np.arange(1.0, len(channel.time) + 1.0)
            axis = "number"
        for number in _numbers(trajectory, channel, model, [r[channel.name] for r in readings]):
            simulated, *draws = number.simulated
            spread = np.full(simulated.shape, np.nan)
            if draws:
                spread[:] = np.sqrt(np.mean((np.array(draws) - simulated) ** 2, axis=0))
            curves.append(
                Curve(
                    number.name,
                    number.unit,
                    axis,
                    place,
                    number.measured,
                    simulated,
                    number.sigma,
                    spread,
                )
            )
    left: list[Residual] = []
    for channel in problem.channels(trajectory):
        step = np.arange(len(channel.time))
        if channel.kind in ("poses", "sensor") and not channel.own_clock:
            step = trajectory.frame_number[: len(step)]
        weighted = np.where(channel.measured, residuals[channel.name], np.nan)
        for column, (name, unit) in enumerate(_residual_names(trajectory, channel, model)):
            if channel.measured[:, column].any():
                left.append(
                    Residual(
                        name,
                        unit,
                        float(channel.sigma[column]),
                        channel.time,
                        step.astype(np.float64),
                        weighted[:, column],
                    )
                )
    return Shown(
        trajectory.name,
        trajectory.frames,
        float(trajectory.time[-1] - trajectory.time[0]),
        problem.window,
        tuple(curves),
        tuple(left),
    )


def readings_of(prediction: Prediction) -> dict[str, Array]:
    """Return by channel (rows, columns) what a prediction reads."""
    trajectory = prediction.trajectory
    poses = np.concatenate([prediction.position, prediction.quaternion], axis=-1)
    start = dict.fromkeys(trajectory.events, float(trajectory.time[0]))
    return {
        POSES: poses.reshape(trajectory.frames, -1),
        **prediction.sensors,
        **{name: m[:, None] - start.get(name, 0.0) for name, m in prediction.moments.items()},
        **{name: residuals[:, None] for name, residuals in prediction.residuals.items()},
    }


def weighted_errors(
    problem: Problem, trajectory: Trajectory, prediction: Prediction
) -> dict[str, Array]:
    """Return by channel (rows, columns) the errors of a prediction over the noise."""
    turned = np.concatenate([prediction.position_error, prediction.rotation_error], axis=-1)
    simulated = readings_of(prediction)
    found = {}
    for channel in problem.channels(trajectory):
        error = channel.off(simulated[channel.name]) if channel.kind != "poses" else turned
        found[channel.name] = error.reshape(len(channel.time), -1) / channel.sigma
    return found


def _residual_names(
    trajectory: Trajectory, channel: Channel, model: mujoco.MjModel
) -> list[tuple[str, str]]:
    """Return names and units of the columns of the residuals of a channel."""
    if channel.kind == "poses":
        return [
            (f"{body} {part}{axis}", unit)
            for body in trajectory.bodies
            for part, unit in (("", "m"), ("turn ", "rad"))
            for axis in _AXES
        ]
    count = channel.measured.shape[1]
    unit = _unit(channel, model)
    columns = "uv" if channel.sensor is not None and channel.sensor.view else range(count)
    names = [channel.name] if count == 1 else [f"{channel.name} {i}" for i in columns]
    return [(name, unit) for name in names]


def _unit(channel: Channel, model: mujoco.MjModel) -> str:
    if channel.kind in ("event", "residual"):
        return "s" if channel.kind == "event" else ""
    if channel.kind == "scalar":
        sensor = channel.name.removeprefix(_PEAK)
        return sensor_unit(model, sensor) if channel.name.startswith(_PEAK) else "m"
    return sensor_unit(model, channel.name)


def _numbers(
    trajectory: Trajectory, channel: Channel, model: mujoco.MjModel, simulated: list[Array]
) -> Iterator[_Number]:
    """Yield the numbers of a channel that count, measured and simulated."""
    if channel.kind != "poses":
        for column, (name, unit) in enumerate(_residual_names(trajectory, channel, model)):
            seen = channel.measured[:, column]
            if seen.any():
                measured = np.where(seen, channel.observed[:, column], np.nan)
                sigma = float(channel.sigma[column])
                yield _Number(name, unit, sigma, measured, [s[:, column] for s in simulated])
        return
    for b, body in enumerate(trajectory.bodies):
        known = channel.measured[:, 6 * b : 6 * b + 6]
        deviations = channel.sigma[6 * b : 6 * b + 6]
        poses = [rows[:, 7 * b : 7 * b + 7] for rows in (channel.observed, *simulated)]
        for i, axis in enumerate(_AXES):
            if known[:, i].any():
                measured = np.where(known[:, i], poses[0][:, i], np.nan)
                columns = [rows[:, i] for rows in poses[1:]]
                yield _Number(f"{body} {axis}", "m", float(deviations[i]), measured, columns)
        turned = np.asarray(known[:, 3:].any(axis=1))
        if turned.any():
            near = _without_jumps(np.where(turned[:, None], poses[0][:, 3:], np.nan))
            others = [_signed(rows[:, 3:], near) for rows in poses[1:]]
            for i, part in enumerate(_QUATERNION):
                # A turn by a small angle moves a quaternion by half of it.
                half = 0.5 * float(deviations[3])
                columns = [rows[:, i] for rows in others]
                yield _Number(f"{body} {part}", "", half, near[:, i], columns)


def _without_jumps(quaternion: Array) -> Array:
    """Return (n, 4) with signs by which neighbours that were measured are near each other."""
    result, before = quaternion.copy(), None
    for row in result:
        if np.isnan(row).any():
            continue
        if before is not None and row @ before < 0.0:
            row *= -1.0
        before = row
    return result


def _signed(quaternion: Array, near: Array) -> Array:
    """Return (n, 4) with the signs of those `near`, or of the one before where there is none."""
    result, before = quaternion.copy(), None
    for row, other in zip(result, near, strict=True):
        guide = before if np.isnan(other).any() else other
        if guide is not None and row @ guide < 0.0:
            row *= -1.0
        if not np.isnan(row).any():
            before = row
    return result
