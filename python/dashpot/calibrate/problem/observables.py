"""Bodies and sensors of the model that trajectories can be compared with."""

from __future__ import annotations

import difflib
from dataclasses import dataclass

import mujoco

from dashpot.calibrate.data.views import View
from dashpot.object_ids import id_of_name

_LIMITS = (
    mujoco.mjtSensor.mjSENS_JOINTLIMITPOS,
    mujoco.mjtSensor.mjSENS_JOINTLIMITVEL,
    mujoco.mjtSensor.mjSENS_TENDONLIMITPOS,
    mujoco.mjtSensor.mjSENS_TENDONLIMITVEL,
)


@dataclass(frozen=True)
class Sensor:
    """A sensor of the model.

    Attributes
    ----------
    name
        In the model.
    address, size
        Of its numbers in ``sensordata``.
    mean
        Whether it needs accelerations or forces, and is compared as a mean.
    view
        Of a point in pixels, which no sensor of the model reads, what is seen.
    turns
        Whether it is the angle of a hinge, which encoders and cameras may tell within a turn only.
    """

    name: str
    address: int
    size: int
    mean: bool
    view: View | None = None
    turns: bool = False


def body_id(model: mujoco.MjModel, name: str, label: str) -> int:
    """Return the id of a body or raise ValueError beginning with `label`."""
    row = id_of_name(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if row < 0:
        known = [model.body(i).name for i in range(model.nbody)]
        raise ValueError(f"{label}: the model has no body {name!r}; it has {', '.join(known)}")
    return row


def find_sensor(model: mujoco.MjModel, name: str, label: str) -> Sensor:
    """Return a sensor that can be compared; raise ValueError beginning with `label`."""
    row = id_of_name(model, mujoco.mjtObj.mjOBJ_SENSOR, name)
    if row < 0:
        known = [model.sensor(i).name for i in range(model.nsensor)]
        near = difflib.get_close_matches(name, known, n=1)
        there = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(known) or 'none'}"
        raise ValueError(f"{label}: the model has no sensor {name!r}; {there}")
    reason = _refusal(model, row)
    if reason is not None:
        raise ValueError(f"{label}: sensor {name!r} {reason}")
    return Sensor(
        name,
        int(model.sensor_adr[row]),
        int(model.sensor_dim[row]),
        bool(model.sensor_needstage[row] == mujoco.mjtStage.mjSTAGE_ACC),
        turns=bool(
            model.sensor_type[row] == mujoco.mjtSensor.mjSENS_JOINTPOS
            and model.jnt_type[model.sensor_objid[row]] == mujoco.mjtJoint.mjJNT_HINGE
        ),
    )


def observable_sensors(model: mujoco.MjModel) -> list[Sensor]:
    """Return all sensors of a model that have a name and can be compared."""
    names = [model.sensor(row).name for row in range(model.nsensor) if _refusal(model, row) is None]
    return [find_sensor(model, name, "model") for name in names if name]


def _refusal(model: mujoco.MjModel, row: int) -> str | None:
    kind = mujoco.mjtSensor(int(model.sensor_type[row]))
    if model.sensor_datatype[row] == mujoco.mjtDataType.mjDATATYPE_QUATERNION:
        return "is a quaternion; observe the pose of its body instead"
    if kind in _LIMITS:
        return "is of a limit, which is there in the middle of a step only; observe its joint"
    if kind == mujoco.mjtSensor.mjSENS_USER:
        return "is computed by a callback"
    if model.sensor_history[row].any() or model.sensor_interval[row].any():
        return "has a delay or an interval; shift the times of the recording instead"
    return None
