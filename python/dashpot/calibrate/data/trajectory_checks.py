"""What a trajectory is checked for as it is made: fields that fit each other."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.noise import initial_deviations
from dashpot.calibrate.data.recorder_fields import numbers_field, sampling_field, sensor_fields
from dashpot.calibrate.data.stamps import Frames, frame_times
from dashpot.calibrate.data.trajectory_fields import finite_field, frozen, poses_field
from dashpot.checks import number

if TYPE_CHECKING:
    from dashpot.calibrate.data.trajectory import Trajectory

Array = NDArray[np.float64]
QuaternionOrder = Literal["wxyz", "xyzw"]

# A quaternion counts as unit when its norm is this close to 1; data written with five digits pass.
UNIT_TOLERANCE = 1e-4


def check_fields(
    trajectory: Trajectory,
    frames: Frames,
    rate: float | None,
    rate_sigma: float | None,
    quaternion_order: QuaternionOrder,
) -> None:
    """Raise where fields do not fit, and put arrays of numbers in the place of what is."""
    label = trajectory._label
    if not isinstance(trajectory.name, str):
        raise TypeError(f"a trajectory's name must be a string, got {trajectory.name!r}")
    if not isinstance(trajectory.bodies, Iterable):
        raise TypeError(
            f"{label}: bodies must be a name or a sequence of names, got {trajectory.bodies!r}"
        )
    for argument, word, known in (
        ("frames", frames, get_args(Frames)),
        ("quaternion_order", quaternion_order, get_args(QuaternionOrder)),
    ):
        if word not in known:
            raise ValueError(
                f"{label}: {argument} must be {' or '.join(map(repr, known))}, got {word!r}"
            )
    if rate is not None and not number(f"{label}: rate", rate) > 0:
        raise ValueError(f"{label}: rate must be > 0 frames a second, got {rate!r}")
    if rate_sigma is not None and not number(f"{label}: rate_sigma", rate_sigma) >= 0:
        raise ValueError(f"{label}: rate_sigma must be >= 0, got {rate_sigma!r}")
    bodies = (
        (trajectory.bodies,) if isinstance(trajectory.bodies, str) else tuple(trajectory.bodies)
    )
    if not all(isinstance(body, str) for body in bodies):
        raise TypeError(f"{label}: bodies must be names, got {bodies}")
    if not (bodies or trajectory._others) or len(set(bodies)) != len(bodies):
        raise ValueError(f"{label}: bodies must be one or more different names: {bodies}")
    time = finite_field(f"{label}: time", trajectory.time)
    if time.ndim != 1 or time.size < 2:
        raise ValueError(f"{label}: time must be (n,) with n >= 2, got {time.shape}")
    n, b = time.size, len(bodies)
    position = poses_field(f"{label}: position", trajectory.position, (n, b, 3))
    turned = np.full((n, b, 4), np.nan) if trajectory.quaternion is None else trajectory.quaternion
    quaternion = poses_field(f"{label}: quaternion", turned, (n, b, 4))
    if quaternion_order == "xyzw":
        quaternion = np.roll(quaternion, 1, axis=-1)
    missing = np.isnan(quaternion)
    partly = np.argwhere(missing.any(axis=-1) & ~missing.all(axis=-1))
    if partly.size:
        frame, body = partly[0]
        raise ValueError(
            f"{label}: quaternion of frame {frame}, body '{bodies[body]}' is nan in part"
        )
    check_measured(trajectory, position, quaternion)
    sensors, times = sensor_fields(label, trajectory.sensors, trajectory.sensor_times, n)
    object.__setattr__(trajectory, "sensors", sensors)
    object.__setattr__(trajectory, "sensor_times", times)
    object.__setattr__(trajectory, "sampling", sampling_field(label, trajectory.sampling, sensors))
    for name in ("events", "scalars"):
        object.__setattr__(trajectory, name, numbers_field(label, name, getattr(trajectory, name)))
    norm = np.linalg.norm(quaternion, axis=-1)
    off = np.argwhere(np.abs(norm - 1.0) > UNIT_TOLERANCE)
    if off.size:
        frame, body = off[0]
        raise ValueError(
            f"{label}: quaternion of frame {frame}, body '{bodies[body]}' has norm "
            f"{norm[frame, body]:.6g}; unit quaternions are needed"
        )
    read = [readings for name, readings in sensors.items() if name not in times]
    channels = np.concatenate([position.reshape(n, -1), *read], axis=1)
    try:
        grid = frame_times(time, channels, frames, rate)
    except ValueError as error:
        raise ValueError(f"{label}: {error}") from None
    grid.number.flags.writeable = False
    object.__setattr__(trajectory, "_frame_number", grid.number)
    object.__setattr__(trajectory, "_spacing", grid.spacing)
    stated = grid.rate_sigma if rate_sigma is None else float(rate_sigma)
    object.__setattr__(trajectory, "rate_sigma", stated)
    object.__setattr__(trajectory, "bodies", bodies)
    object.__setattr__(trajectory, "time", frozen(grid.time))
    object.__setattr__(trajectory, "position", frozen(position))
    object.__setattr__(trajectory, "quaternion", frozen(quaternion / norm[..., None]))
    for name, ndim in (("initial_qpos", 1), ("initial_qvel", 1), ("control", 2)):
        value = getattr(trajectory, name)
        if value is None:
            continue
        array = finite_field(f"{label}: {name}", value)
        if array.ndim != ndim:
            raise ValueError(f"{label}: {name} must be {ndim}-D, got {array.shape}")
        if name == "control" and array.shape[0] != n - 1:
            raise ValueError(
                f"{label}: control must have a row for each of the {n - 1} frame "
                f"intervals, got {array.shape[0]}"
            )
        object.__setattr__(trajectory, name, frozen(array))
    for name in ("initial_qpos", "initial_qvel"):
        value = getattr(trajectory, f"{name}_sigma")
        if value is None:
            continue
        sigma = initial_deviations(f"{label}: {name}_sigma", value)
        if np.isfinite(sigma).any() and getattr(trajectory, name) is None:
            raise ValueError(
                f"{label}: {name}_sigma says how well {name} is known, which is not given"
            )
        object.__setattr__(trajectory, f"{name}_sigma", frozen(sigma))


def check_measured(trajectory: Trajectory, position: Array, quaternion: Array) -> None:
    """Raise ValueError where poses are all that is observed, and none was measured."""
    nothing = np.isnan(position).all() and np.isnan(quaternion).all()
    if trajectory.bodies and nothing and not trajectory._others:
        raise ValueError(f"{trajectory._label}: all positions and quaternions are nan")
