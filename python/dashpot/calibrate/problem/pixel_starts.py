"""First guesses of initial states of bodies that were seen in pixels alone."""

from __future__ import annotations

import copy
from typing import get_args

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.data.views import View
from dashpot.calibrate.problem.first_guess import free_bodies, free_joint, initial_state
from dashpot.calibrate.problem.pixels import pixels, place_of
from dashpot.calibrate.problem.sensing import ImageQuantity, Sensing

Array = NDArray[np.float64]

# Directions are one where their cosine is above this.
_ONE_AXIS = 1.0 - 1e-6
_QUANTITIES = get_args(ImageQuantity)


def start_as_seen(
    trajectory: Trajectory,
    model: mujoco.MjModel,
    sensing: Sensing,
    qpos: Array,
    qvel: Array,
    *,
    placed: bool,
) -> None:
    """Put into an initial state (nq,), (nv,) what pictures say of bodies that fly freely.

    They are as far from the camera as the state has them. What the trajectory carries stays.

    Parameters
    ----------
    sensing
        How the cameras see where the search starts.
    placed
        Whether positions count, too. Those of pictures whose scale, tilt or origin is unknown never
        do.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    seen: dict[str, tuple[Array, bool]] = {}
    for name, view in trajectory.views.items():
        body = place_of(view, model)[0]
        label = model.body(body).name
        if free_joint(model, body) is None or label in (*trajectory.bodies, *seen):
            continue
        known = not any((quantity, view.camera) in sensing.values for quantity in _QUANTITIES)
        own_clock = name in trajectory.sensor_times
        if not own_clock:
            path = _positions(view, model, data, trajectory.sensors[name], sensing)
            seen[label] = path, placed and known
    if not seen:
        return
    found = copy.copy(trajectory)
    paths = np.stack([path for path, _ in seen.values()], axis=1)
    lost = np.full((*paths.shape[:2], 4), np.nan)
    for field, value in (("bodies", tuple(seen)), ("position", paths), ("quaternion", lost)):
        object.__setattr__(found, field, value)
    position, velocity = initial_state(found, model, np.ones(6, dtype=bool))
    for i, joint in free_bodies(found, model):
        q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        if seen[found.bodies[i]][1]:
            qpos[q : q + 3] = position[q : q + 3]
        qvel[v : v + 6] = velocity[v : v + 6]


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
    poses = {
        i: np.concatenate([data.xpos[i], data.xquat[i]])[None, None] for i in range(model.nbody)
    }
    one = Sensing(sensing.values, sensing.centre, [model])
    now = pixels(view, poses, one)[0, 0]
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
        columns.append(pixels(view, moved, one)[0, 0] - now)
    found = np.linalg.solve(np.array(columns).T, (uv - now).T).T
    return np.asarray(data.xpos[body] + found @ axes)
