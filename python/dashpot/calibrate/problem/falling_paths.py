"""Paths of a trajectory along which things can fall: of bodies, and of sensors that tell places."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.falls import Path
from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.first_guess import free_joint, gravity_of
from dashpot.calibrate.problem.pixels import place_of
from dashpot.object_ids import id_of_name

Array = NDArray[np.float64]

_BODIES = (mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_XBODY)


def falling_paths(trajectory: Trajectory, model: mujoco.MjModel, sigma: Array) -> list[Path]:
    """Return the paths of what falls freely where nothing holds it.

    Parameters
    ----------
    trajectory
        What was observed.
    model
        The model.
    sigma
        (3,) standard deviations of coordinates of bodies, m; infinite: not measured.
    """
    paths = []
    for i, name in enumerate(trajectory.bodies):
        body = model.body(name).id
        if _falls(model, body):
            measured = np.where(np.isfinite(sigma), trajectory.position[:, i], np.nan)
            paths.append(_path(trajectory, measured, _gravity(model, body), sigma))
    for name, readings in trajectory.sensors.items():
        sensor = id_of_name(model, mujoco.mjtObj.mjOBJ_SENSOR, name)
        gravity = None if sensor < 0 else _felt(model, sensor)
        if gravity is not None:
            unknown = np.full(gravity.size, np.inf)
            paths.append(_path(trajectory, readings, gravity, unknown))
    for name, view in trajectory.views.items():
        body = place_of(view, model)[0]
        if view.plane is not None and name not in trajectory.sensor_times and _falls(model, body):
            flat = view.plane.unturned(trajectory.sensors[name])
            axes = np.array([view.plane.right, view.plane.down])
            paths.append(_path(trajectory, flat, axes @ _gravity(model, body), np.full(2, np.inf)))
    return [path for path in paths if path.time.size > 1]


def _path(trajectory: Trajectory, value: Array, gravity: Array, sigma: Array) -> Path:
    """Return heights along the axes that were ever measured, where all of them were."""
    axes = ~np.isnan(value).all(axis=0) & (gravity != 0.0)
    felt = float(np.linalg.norm(gravity[axes]))
    up = -gravity[axes] / felt if felt > 0.0 else gravity[axes]
    seen = ~np.isnan(value[:, axes]).any(axis=1)
    time = trajectory.spacing * trajectory.frame_number[seen].astype(np.float64)
    noise = float(np.linalg.norm(sigma[axes] * up))
    return Path(time, value[seen][:, axes] @ up, felt, noise)


def _falls(model: mujoco.MjModel, body: int) -> bool:
    """Whether a body is on a free joint, or slides in the world with no spring."""
    if free_joint(model, body) is not None:
        return True
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    joints = slice(first, first + count)
    sliding = (model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_SLIDE).all()
    loose = (model.jnt_stiffness[joints] == 0.0).all()
    return bool(model.body_parentid[body] == 0 and count > 0 and sliding and loose)


def _gravity(model: mujoco.MjModel, body: int) -> Array:
    """Return the gravity (3,) that moves a body: along its slides, where it has some."""
    gravity = gravity_of(model) * (1.0 - float(model.body_gravcomp[body]))
    if free_joint(model, body) is not None:
        return gravity
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    axes = np.array([_axis(model, joint) for joint in range(first, first + count)])
    return np.asarray(np.linalg.pinv(axes) @ (axes @ gravity))


def _axis(model: mujoco.MjModel, joint: int) -> Array:
    """Return the axis of a joint of a body in the world, in the world."""
    axis = np.zeros(3)
    mujoco.mju_rotVecQuat(axis, model.jnt_axis[joint], model.body_quat[model.jnt_bodyid[joint]])
    return axis


def _felt(model: mujoco.MjModel, sensor: int) -> Array | None:
    """Return the gravity (k,) along the numbers of a sensor of a place, None of another one."""
    kind, target = int(model.sensor_type[sensor]), int(model.sensor_objid[sensor])
    if kind == mujoco.mjtSensor.mjSENS_JOINTPOS:
        body = int(model.jnt_bodyid[target])
        sliding = model.jnt_type[target] == mujoco.mjtJoint.mjJNT_SLIDE
        if sliding and _falls(model, body):
            return np.array([_axis(model, target) @ _gravity(model, body)])
        return None
    if kind != mujoco.mjtSensor.mjSENS_FRAMEPOS or model.sensor_refid[sensor] >= 0:
        return None
    of = int(model.sensor_objtype[sensor])
    if of == mujoco.mjtObj.mjOBJ_SITE:
        target = int(model.site_bodyid[target])
    elif of == mujoco.mjtObj.mjOBJ_GEOM:
        target = int(model.geom_bodyid[target])
    elif of not in _BODIES:
        return None
    return _gravity(model, target) if _falls(model, target) else None
