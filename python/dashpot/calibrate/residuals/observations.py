"""What the core is told was observed of a trajectory, and what it returns of that."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot import _core
from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.layout import Layout
from dashpot.calibrate.problem.observables import body_id
from dashpot.calibrate.problem.problem import Problem

Array = NDArray[np.float64]

# Stands for a quaternion that was not measured.
_ANY = np.array([1.0, 0.0, 0.0, 0.0])


def observed(
    problem: Problem, trajectory: Trajectory, model: mujoco.MjModel
) -> _core.ObservedTrajectory:
    """Return a trajectory within the window, in steps; any numbers for what was not measured."""
    weight = 1.0 / problem.sigma
    substeps = problem.steps_per_frame(trajectory, model)
    timestep = trajectory.spacing / substeps
    if problem.window is not None:
        trajectory = trajectory.head(problem.window)
    frame = trajectory.frame_number
    control: Array = np.empty((0, 0))
    if trajectory.control is not None:
        control = np.repeat(trajectory.control, substeps * np.diff(frame), axis=0)
    channels, readings = [], [np.empty((trajectory.frames, 0))]
    for sensor in problem.sensors(trajectory):
        readings.append(trajectory.sensors[sensor.name])
        for i, sigma in enumerate(problem.channel_sigma(sensor)):
            channels.append((sensor.address + i, sensor.mean, 1.0 / float(sigma)))
    return _core.ObservedTrajectory(
        name=trajectory.name,
        timestep=timestep,
        frame_step=(substeps * frame).tolist(),
        body=[body_id(model, body, trajectory.name) for body in trajectory.bodies],
        position=np.nan_to_num(trajectory.position),
        quaternion=np.where(np.isnan(trajectory.quaternion), _ANY, trajectory.quaternion),
        control=control,
        position_weight=list(weight[:3]),
        rotation_weight=float(weight[3]),
        channel=channels,
        reading=np.nan_to_num(np.concatenate(readings, axis=1)),
        interval=substeps,
    )


def simulated(
    problem: Problem, layouts: Sequence[Layout], flat: Array
) -> list[tuple[Array, Array, dict[str, Array]]]:
    """Return positions, quaternions and sensors by trajectory, of all numbers (n,) in a row."""
    result, first = [], 0
    for layout, trajectory in zip(layouts, problem.trajectories, strict=True):
        middle = first + 7 * layout.frames * layout.bodies
        last = middle + layout.frames * layout.channels
        poses = flat[first:middle].reshape(layout.frames, layout.bodies, 7)
        sensors = trajectory.by_sensor(
            flat[middle:last].reshape(layout.frames, layout.channels).copy()
        )
        for sensor in problem.sensors(trajectory):
            if sensor.mean:
                sensors[sensor.name][0] = np.nan
        result.append((poses[..., :3].copy(), poses[..., 3:].copy(), sensors))
        first = last
    return result
