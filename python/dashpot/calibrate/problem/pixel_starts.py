"""First guesses of initial states of bodies that were seen in pixels alone."""

from __future__ import annotations

import copy
from collections.abc import Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.data.views import View
from dashpot.calibrate.problem.first_guess import free_bodies, free_joint, initial_state
from dashpot.calibrate.problem.pixels import bodies_of, place_of
from dashpot.calibrate.problem.pixels import pixels as pixels_of
from dashpot.calibrate.problem.sensing import Sensing

Array = NDArray[np.float64]

# Directions are one where their cosine is above this.
_ONE_AXIS = 1.0 - 1e-6
_FREE = mujoco.mjtJoint.mjJNT_FREE
_START_FRAMES = 5
# Of Newton's method; of joints, m or rad; directions that are seen less are left.
_ITERATIONS, _DIFFERENCE, _LEAST = 10, 1e-6, 1e-4


def start_as_seen(
    trajectory: Trajectory,
    model: mujoco.MjModel,
    sensing: Sensing,
    qpos: Array,
    qvel: Array,
    *,
    placed: bool,
) -> None:
    """Put into an initial state (nq,), (nv,) what pictures say of bodies that they show alone.

    They are as far from the camera as the state has them. What the trajectory carries stays.

    Parameters
    ----------
    sensing
        How the cameras see where the search starts.
    placed
        Whether positions count, too.
    """
    views = {n: v for n, v in trajectory.views.items() if n not in trajectory.sensor_times}
    if trajectory.initial_qpos is None or trajectory.initial_qvel is None:
        _turn_joints(views, trajectory, model, sensing, qpos, qvel, placed=placed)
    data = _data_at(model, qpos)
    seen: dict[str, Array] = {}
    for name, view in views.items():
        body = place_of(view, model)[0]
        label = model.body(body).name
        if free_joint(model, body) is not None and label not in (*trajectory.bodies, *seen):
            seen[label] = _positions(view, model, data, trajectory.sensors[name], sensing)
    if not seen:
        return
    found = copy.copy(trajectory)
    paths = np.stack([*seen.values()], axis=1)
    lost = np.full((*paths.shape[:2], 4), np.nan)
    for field, value in (("bodies", tuple(seen)), ("position", paths), ("quaternion", lost)):
        object.__setattr__(found, field, value)
    position, velocity = initial_state(found, model, np.ones(6, dtype=bool))
    for _, joint in free_bodies(found, model):
        q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        if placed:
            qpos[q : q + 3] = position[q : q + 3]
        qvel[v : v + 6] = velocity[v : v + 6]


def _turn_joints(
    views: Mapping[str, View],
    trajectory: Trajectory,
    model: mujoco.MjModel,
    sensing: Sensing,
    qpos: Array,
    qvel: Array,
    *,
    placed: bool,
) -> None:
    """Move joints, but for free ones, to where points were first seen, as fast as these moved.

    Of all ways that is the shortest, by Newton's method with derivatives of what is seen.
    """
    lines = {name: _first_line(trajectory, name) for name in views}
    chosen = [(views[name], line) for name, line in lines.items() if line is not None]
    moved = np.array([model.jnt_type[j] != _FREE for j in model.dof_jntid], dtype=bool)
    if not chosen or not moved.any():
        return
    dofs = np.flatnonzero(moved)
    target = np.concatenate([line[0] for _, line in chosen])
    rate = np.concatenate([line[1] for _, line in chosen])

    def seen_at(place: Array) -> Array:
        data = _data_at(model, place)
        return np.concatenate([_seen(view, model, data, sensing) for view, _ in chosen])

    def slopes(place: Array, now: Array) -> Array:
        columns = []
        for dof in dofs:
            step, there = np.zeros(model.nv), place.copy()
            step[dof] = _DIFFERENCE
            mujoco.mj_integratePos(model, there, step, 1.0)
            columns.append((seen_at(there) - now) / _DIFFERENCE)
        return np.array(columns).T

    place, now = qpos.copy(), seen_at(qpos)
    for _ in range(_ITERATIONS if placed and trajectory.initial_qpos is None else 0):
        if not np.isfinite(slopes(place, now)).all():
            break  # behind a camera
        inverse = np.linalg.pinv(slopes(place, now), rcond=_LEAST)
        step, there = np.zeros(model.nv), place.copy()
        step[dofs] = np.clip(inverse @ (target - now), -0.5, 0.5)
        mujoco.mj_integratePos(model, there, step, 1.0)
        after = seen_at(there)
        if not np.linalg.norm(after - target) < np.linalg.norm(now - target):
            break
        place, now = there, after
    qpos[:] = place
    if trajectory.initial_qvel is None and np.isfinite(slopes(place, now)).all():
        slope = slopes(place, now)
        qvel[dofs] += np.linalg.pinv(slope, rcond=_LEAST) @ (rate - slope @ qvel[dofs])


def _first_line(trajectory: Trajectory, name: str) -> tuple[Array, Array] | None:
    """Return pixels at time 0 and their rates, of the first frames in which a point was seen."""
    pixels = trajectory.sensors[name]
    frames = np.flatnonzero(~np.isnan(pixels).any(axis=1))[:_START_FRAMES]
    if frames.size < 2:
        return None
    time = trajectory.time[frames] - trajectory.time[0]
    value, rate = np.polynomial.polynomial.polyfit(time, pixels[frames], 1)
    return value, rate


def _data_at(model: mujoco.MjModel, qpos: Array) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    return data


def _seen(view: View, model: mujoco.MjModel, data: mujoco.MjData, sensing: Sensing) -> Array:
    """Return the pixel (2,) at which a point is seen."""
    one = Sensing(sensing.values, sensing.centre, [model])
    return np.asarray(pixels_of(view, _poses(view, model, data), one)[0, 0])


def _poses(view: View, model: mujoco.MjModel, data: mujoco.MjData) -> dict[int, Array]:
    return {
        body: np.concatenate([data.xpos[body], data.xquat[body]])[None, None]
        for body in bodies_of(view, model)
    }


def out_of_sight(trajectory: Trajectory, model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return (nv,) which velocities no picture shows of bodies that were seen in one plane alone.

    These move in the plane: not along the line of sight, nor do they turn about an axis across it.
    It is so where the line of sight is an axis of the world, and of the body.
    """
    unseen = np.zeros(model.nv, dtype=bool)
    if len(trajectory.views) < len(trajectory.sensors):
        return unseen
    qpos = model.qpos0 if trajectory.initial_qpos is None else trajectory.initial_qpos
    sights: dict[int, list[Array | None]] = {}
    for view in trajectory.views.values():
        body = place_of(view, model)[0]
        joint = free_joint(model, body)
        if joint is not None and model.body(body).name not in trajectory.bodies:
            plane = view.plane
            sight = None if plane is None else np.cross(plane.right, plane.down)
            sights.setdefault(joint, []).append(sight)
    for joint, seen in sights.items():
        first = seen[0]
        if first is None or any(s is None or abs(s @ first) < _ONE_AXIS for s in seen):
            continue
        q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        in_body = np.zeros(3)
        inverse = qpos[q + 3 : q + 7] * [1.0, -1.0, -1.0, -1.0]
        mujoco.mju_rotVecQuat(in_body, first, inverse)
        along = np.abs(first) > _ONE_AXIS
        about = np.abs(in_body) > _ONE_AXIS
        unseen[v : v + 3] = along
        unseen[v + 3 : v + 6] = ~about & about.any()
    return unseen


def _positions(
    view: View, model: mujoco.MjModel, data: mujoco.MjData, uv: Array, sensing: Sensing
) -> Array:
    """Return (n, 3) where the body of a point is, at the distance from the camera of `data`."""
    body, _ = place_of(view, model)
    poses = _poses(view, model, data)
    one = Sensing(sensing.values, sensing.centre, [model])
    now = pixels_of(view, poses, one)[0, 0]
    # A lens is linear in what is at one distance: three points at it say all.
    if view.plane is None:
        camera = model.camera(view.camera).id
        axes = data.cam_xmat[camera].reshape(3, 3)[:, :2].T
    else:
        axes = np.array([view.plane.right, view.plane.down])
    columns = []
    for axis in axes:
        moved = {i: pose.copy() for i, pose in poses.items()}
        moved[body][..., :3] += axis
        columns.append(pixels_of(view, moved, one)[0, 0] - now)
    found = np.linalg.solve(np.array(columns).T, (uv - now).T).T
    return np.asarray(data.xpos[body] + found @ axes)
