"""The parameters and trajectories of a problem: of one kind, none twice, and of its model."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from typing import TypeVar

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot.calibrate.data.trajectory import UNIT_TOLERANCE, Trajectory
from dashpot.calibrate.problem.inertia_setter import InertiaSetter
from dashpot.calibrate.problem.observables import find_sensor
from dashpot.calibrate.problem.parameters import Parameter
from dashpot.calibrate.problem.pixels import check_in_picture, seen_sensor
from dashpot.calibrate.problem.sensing import SensingSetter
from dashpot.calibrate.problem.setters import MaterialSetter, ModelSetter, PairSetter
from dashpot.calibrate.problem.vectors import Joint
from dashpot.checks import number_array
from dashpot.engine import Engine

Entry = TypeVar("Entry")


def all_of(field: str, entries: Iterable[Entry], kind: type[Entry]) -> tuple[Entry, ...]:
    """Return a tuple; raise TypeError naming the field, and the entry that is of another type."""
    if not isinstance(entries, Iterable):
        raise TypeError(
            f"{field} must be a sequence of {kind.__name__}, got {type(entries).__name__}"
        )
    result = tuple(entries)
    for i, entry in enumerate(result):
        if not isinstance(entry, kind):
            raise TypeError(f"{field}[{i}] is {type(entry).__name__}; it must be a {kind.__name__}")
    return result


def check_unique(kind: str, names: list[str]) -> None:
    """Raise ValueError where two entries have one name."""
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"two {kind} entries are named {name!r}")


def check_reach(parameters: Sequence[Parameter], system: object, starts: bool) -> None:
    """Raise ValueError where a parameter reaches neither the system nor, with `starts`, its state.

    Without an ``apply`` only functions of all values get it.
    """
    if starts or not isinstance(system, Engine | mujoco.MjModel):
        return
    for parameter in parameters:
        if parameter.apply is None:
            raise ValueError(
                f"parameter '{parameter.name}' sets nothing: make it with Parameter.material, pair "
                "or model, give it an apply, or give Problem a function of the values that builds "
                "the system"
            )


def check_targets(parameters: Sequence[Parameter], model: mujoco.MjModel) -> None:
    """Raise ValueError where two parameters set the same quantity."""
    setters_of: dict[str, list[Parameter]] = {}
    for parameter in parameters:
        setter: object = parameter.apply
        if isinstance(setter, Joint):
            setter = setter.function if parameter.component == 0 else None
        if isinstance(setter, MaterialSetter | PairSetter | ModelSetter | InertiaSetter):
            targets = setter.targets(model)
        elif isinstance(setter, SensingSetter):
            targets = setter.targets
        else:
            continue
        for target in targets:
            for other in setters_of.setdefault(target, []):
                if parameter.vector is not None and parameter.vector == other.vector:
                    continue  # each of its numbers has a place of its own
                if _act_together(parameter, other):
                    raise ValueError(
                        f"parameters '{other.name}' and '{parameter.name}' both set the {target}"
                    )
            setters_of[target].append(parameter)


def _act_together(first: Parameter, second: Parameter) -> bool:
    """Whether two parameters act in one trajectory."""
    if first.trajectories is None or second.trajectories is None:
        return True
    return bool({*first.trajectories} & {*second.trajectories})


def check_sensors(trajectory: Trajectory, model: mujoco.MjModel, known: Container[str]) -> None:
    """Raise ValueError where readings are of no sensor, or of one whose noise is not `known`."""
    label = f"trajectory '{trajectory.name}'"
    for name, readings in trajectory.sensors.items():
        view = trajectory.views.get(name)
        if view is None:
            size = find_sensor(model, name, label).size
        else:
            size = seen_sensor(model, view, label).size
            check_in_picture(view, readings, model, label)
        if readings.shape[1] != size:
            raise ValueError(
                f"{label}: sensor '{name}' has {size} numbers, got readings {readings.shape}"
            )
        if name not in known:
            of_pixels = "; 'pixels' is that of all points in pixels" if view else ""
            raise ValueError(f"{label}: sensor '{name}' has no sensor_sigma{of_pixels}")


def check_shapes(trajectory: Trajectory, model: mujoco.MjModel) -> None:
    """Raise ValueError where states and controls are not of the model's size, or not unit."""
    label = f"trajectory '{trajectory.name}'"
    for name, size in (("initial_qpos", model.nq), ("initial_qvel", model.nv)):
        value = getattr(trajectory, name)
        if value is not None and value.shape != (size,):
            raise ValueError(f"{label}: {name} must be ({size},), got {value.shape}")
    for name in ("initial_qpos_sigma", "initial_qvel_sigma"):
        value = getattr(trajectory, name)
        if value is not None and value.shape not in ((), (model.nv,)):
            raise ValueError(
                f"{label}: {name} must be ({model.nv},) or one number, got {value.shape}"
            )
    if trajectory.initial_qpos is not None:
        _check_quaternions(label, trajectory.initial_qpos, model)
    if trajectory.control is not None and trajectory.control.shape[1] != model.nu:
        raise ValueError(
            f"{label}: control must have {model.nu} columns, got {trajectory.control.shape[1]}"
        )


def checked_states(
    states: tuple[ArrayLike, ArrayLike], count: int, model: mujoco.MjModel
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return qpos (count, nq) and qvel (count, nv) of ``start_states``; raise where they are not.

    Raises
    ------
    ValueError, TypeError
        Naming which of them it is.
    """
    qpos, qvel = (
        number_array(f"{name} of start_states", array)
        for name, array in zip(("qpos", "qvel"), states, strict=True)
    )
    for name, array, size in (("qpos", qpos, model.nq), ("qvel", qvel, model.nv)):
        if array.shape != (count, size) or not np.isfinite(array).all():
            raise ValueError(
                f"start_states must return finite {name} of shape ({count}, {size}), "
                f"got {array.shape}"
            )
    return qpos, qvel


def _check_quaternions(label: str, qpos: NDArray[np.float64], model: mujoco.MjModel) -> None:
    """Raise ValueError where a quaternion of a free or ball joint is not unit."""
    for joint in range(model.njnt):
        kind = mujoco.mjtJoint(model.jnt_type[joint])
        if kind not in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL):
            continue
        first = int(model.jnt_qposadr[joint]) + (3 if kind == mujoco.mjtJoint.mjJNT_FREE else 0)
        norm = float(np.linalg.norm(qpos[first : first + 4]))
        if abs(norm - 1.0) > UNIT_TOLERANCE:
            body = int(model.jnt_bodyid[joint])
            raise ValueError(
                f"{label}: initial_qpos[{first}:{first + 4}], the quaternion of body "
                f"'{model.body(body).name or body}', has norm {norm:.6g}; unit quaternions are "
                "needed"
            )
