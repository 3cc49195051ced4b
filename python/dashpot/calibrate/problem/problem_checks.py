"""Checks of a problem: its options, and its trajectories beside the model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.first_guess import free_bodies
from dashpot.calibrate.problem.gaps import check_kinds
from dashpot.calibrate.problem.observables import Sensor, body_id, find_sensor
from dashpot.calibrate.problem.pixels import is_seen_point, seen_sensor
from dashpot.calibrate.problem.problem_channels import ProblemChannels
from dashpot.calibrate.problem.problem_entries import check_sensors, check_shapes
from dashpot.calibrate.problem.problem_fields import ProblemFields
from dashpot.calibrate.problem.sensing import SensingSetter, check_channel, check_numbers
from dashpot.checks import number, positive_count

if TYPE_CHECKING:
    from dashpot.calibrate.problem.problem import Problem


def check_options(problem: ProblemFields) -> None:
    """Raise ValueError or TypeError naming the option that is none."""
    if problem.window is not None and not number("window", problem.window) > 0:
        raise ValueError(f"window must be > 0 s, got {problem.window!r}")
    if problem.substeps is not None:
        positive_count("substeps", problem.substeps)
    if problem.initial_state not in ("given", "velocity", "pose_and_velocity"):
        raise ValueError(
            "initial_state must be 'given', 'velocity' or 'pose_and_velocity', "
            f"got {problem.initial_state!r}"
        )
    if problem.noise not in ("stated", "estimate"):
        raise ValueError(f"noise must be 'stated' or 'estimate', got {problem.noise!r}")
    if problem.start_states is not None:
        if not callable(problem.start_states):
            raise TypeError(f"start_states must be a function, got {problem.start_states!r}")
        if problem.initial_state != "given":
            raise ValueError("start_states needs initial_state='given'")


def observed_sensors(problem: ProblemFields, model: mujoco.MjModel) -> dict[str, Sensor]:
    """Return the sensors of which readings or peaks are observed, by name.

    Raises
    ------
    ValueError
        Where the model has no such, or of another count of numbers.
    """
    found: dict[str, Sensor] = {}
    views = {name: view for t in problem.trajectories for name, view in t.views.items()}
    for name, deviations in problem.sensor_sigma.items():
        if name not in views and is_seen_point(model, name):
            continue  # of other trajectories
        sensor = found[name] = (
            seen_sensor(model, views[name], "pixels")
            if name in views
            else find_sensor(model, name, "sensor_sigma")
        )
        if np.size(deviations) not in (1, sensor.size):
            raise ValueError(
                f"sensor_sigma[{name!r}] must be one number or {sensor.size}, "
                f"got {np.size(deviations)}"
            )
    for trajectory in problem.trajectories:
        for name in trajectory.scalars:
            if name.startswith("peak:") and name[5:] not in found:
                label = f"trajectory '{trajectory.name}': scalar {name!r}"
                sensor = found[name[5:]] = find_sensor(model, name[5:], label)
                if sensor.size != 1:
                    raise ValueError(f"{label}: the sensor has {sensor.size} numbers, not one")
    return found


def check_sensing(problem: ProblemChannels) -> None:
    """Raise ValueError where parameters of recorders do not go with their channels."""
    for parameter in problem.parameters:
        if isinstance(parameter.apply, SensingSetter):
            channels = [
                channel
                for trajectory in problem.trajectories
                if parameter.acts_in(trajectory.name)
                for channel in problem.channels(trajectory)
            ]
            kinds: dict[str, str] = {channel.name: channel.kind for channel in channels}
            cameras = {v.camera for t in problem.trajectories for v in t.views.values()}
            kinds |= dict.fromkeys(cameras, "camera")
            check_channel(parameter.name, parameter.apply, kinds)
            counts = {channel.name: channel.block.columns for channel in channels}
            check_numbers(parameter.name, parameter.apply, counts)


def check_against_model(problem: Problem, trajectory: Trajectory, model: mujoco.MjModel) -> None:
    """Raise ValueError where a trajectory is not one of a model, or nothing of it counts."""
    label = f"trajectory '{trajectory.name}'"
    for body in trajectory.bodies:
        body_id(model, body, label)
    carried = problem.initial_state == "given" and problem.start_states is None
    if trajectory.initial_qvel is None and carried:
        raise ValueError(
            f"{label} has no initial_qvel; give it, or estimate it with initial_state='velocity'"
        )
    check_sensors(trajectory, model, problem.sensor_sigma)
    check_kinds(trajectory, model)
    seen = any(channel.measured.any() for channel in problem.channels(trajectory))
    if not (seen or problem.own):
        raise ValueError(f"{label}: nothing that was measured is left of it")
    if trajectory.initial_qpos is None and problem.starts_at_first_poses():
        for i, _ in free_bodies(trajectory, model):
            if not trajectory.measured[0, i, np.isfinite(problem.sigma)].all():
                raise ValueError(
                    f"{label}: body '{trajectory.bodies[i]}' was not measured in the first "
                    "frame; give initial_qpos, or estimate the start with "
                    "initial_state='pose_and_velocity'"
                )
    check_shapes(trajectory, model)
