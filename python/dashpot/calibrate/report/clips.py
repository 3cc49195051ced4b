"""Outlines of what moves in a trajectory, seen from the side."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from dashpot.calibrate.problem.setters import System
from dashpot.calibrate.report.record import Clip
from dashpot.engine import Engine

if TYPE_CHECKING:
    from dashpot.calibrate.prediction import Prediction

Array = NDArray[np.float64]

# Pictures of a clip, and frames that are too few for it; outlines in it; geoms of a body with
# outlines of their own, else they share one; vertices of an outline.
_MOST_PICTURES = 40
_FEW_FRAMES = 10
_MOST_SOLIDS = 80
_MOST_APART = 3
_ROUND = 32

_T = mujoco.mjtGeom


def clip(system: System, prediction: Prediction, substeps: int) -> Clip:
    """Return the outlines of a trajectory that `system`, which is changed, steps anew.

    Parameters
    ----------
    system
        With the fitted values.
    prediction
        Of the trajectory.
    substeps
        Steps a frame.
    """
    trajectory = prediction.trajectory
    model = system if isinstance(system, mujoco.MjModel) else system.model
    model.opt.timestep = trajectory.spacing / substeps
    data = mujoco.MjData(model)
    before = 0
    data.qpos[:], data.qvel[:] = prediction.initial_qpos, prediction.initial_qvel
    frame_step = substeps * trajectory.frame_number
    chosen = _pictures(frame_step)
    places = []
    for step in np.union1d(frame_step, chosen):
        if step:
            interval = int(np.searchsorted(frame_step, step)) - 1
            if trajectory.control is not None:
                data.ctrl[:] = trajectory.control[interval]
            if isinstance(system, Engine):
                system.step(data, int(step - before))
            else:
                mujoco.mj_step(model, data, int(step - before))
        before = step
        if step in chosen:
            mujoco.mj_kinematics(model, data)
            places.append((data.xpos.copy(), data.xmat.reshape(-1, 3, 3).copy()))
    # Frames of the pictures; -1 between frames.
    pictures = np.full(len(chosen), -1)
    pictures[np.isin(chosen, frame_step)] = np.flatnonzero(np.isin(frame_step, chosen))
    moving = np.flatnonzero(model.body_weldid != 0)
    way = np.array([position[moving] for position, _ in places])
    heading = _heading((way - way.mean(axis=0))[..., :2].reshape(-1, 2))
    sideways = np.array([[*heading, 0.0], [0.0, 0.0, 1.0]])
    radius = float(model.geom_rbound.max(initial=0.1))
    across = float(np.ptp(way.reshape(-1, 3), axis=0).max()) if way.size else 1.0
    simulated, measured, still = [], [], []
    for body, solid in _solids(model, across + 4.0 * radius):
        if model.body_weldid[body] == 0:
            position, matrix = places[0]
            still.append(_outline((position[body] + solid @ matrix[body].T) @ sideways.T))
            continue
        simulated.append(
            np.array([_outline((p[body] + solid @ m[body].T) @ sideways.T) for p, m in places])
        )
        name = model.body(body).name
        if name in trajectory.bodies:
            place = trajectory.bodies.index(name)
            measured.append(_seen(prediction, place, solid, sideways, pictures))
    along = int(np.argmax(np.abs(heading)))
    straight = abs(heading[along]) > 1.0 - 1e-9
    return Clip(
        trajectory.name,
        np.asarray(chosen * float(model.opt.timestep), dtype=np.float64),
        tuple(still),
        tuple(simulated),
        tuple(measured),
        "xy"[along] if straight else "along the motion",
    )


def _pictures(frame_step: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the steps of the pictures: at frames, or of few frames anywhere."""
    if len(frame_step) >= _FEW_FRAMES:
        return frame_step[:: -(-len(frame_step) // _MOST_PICTURES)]
    return np.unique(np.linspace(0, int(frame_step[-1]), _MOST_PICTURES).round().astype(np.intp))


def _solids(model: mujoco.MjModel, extent: float) -> list[tuple[int, Array]]:
    """Return bodies and points (n, 3) in their frames: a geom's, or of many geoms all."""
    found = []
    for body in range(model.nbody):
        first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
        points = [
            _solid(model, geom, extent) @ _matrix(model.geom_quat[geom]).T + model.geom_pos[geom]
            for geom in range(first, first + count)
        ]
        if count > _MOST_APART and model.body_weldid[body] != 0:
            points = [np.concatenate(points)]
        found += [(body, solid) for solid in points]
    return found[:_MOST_SOLIDS]


def _heading(places: Array) -> Array:
    """Return the horizontal direction in which places (n, 2) differ most; x without any."""
    _, size, axes = np.linalg.svd(places - places.mean(axis=0), full_matrices=False)
    if not size.size or size[0] < 1e-9:
        return np.array([1.0, 0.0])
    first = axes[0] if abs(axes[0][0]) > 1e-9 or axes[0][1] > 0 else -axes[0]
    return np.asarray(first if first[int(np.argmax(np.abs(first)))] > 0 else -first)


def _solid(model: mujoco.MjModel, geom: int, extent: float) -> Array:
    """Return points (n, 3) in the frame of a geom whose hull is its outline."""
    kind, size = _T(int(model.geom_type[geom])), model.geom_size[geom]
    if kind == _T.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first = int(model.mesh_vertadr[mesh])
        return np.array(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])], dtype=float)
    if kind in (_T.mjGEOM_PLANE, _T.mjGEOM_HFIELD):
        half = [s if 0.0 < s < extent else extent for s in size[:2]]
        return np.array([[x, y, 0.0] for x in (-half[0], half[0]) for y in (-half[1], half[1])])
    if kind == _T.mjGEOM_BOX:
        return np.array(np.meshgrid(*([-s, s] for s in size))).reshape(3, -1).T
    if kind == _T.mjGEOM_CYLINDER:
        angle = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
        ring = size[0] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return np.concatenate([np.c_[ring, np.full(_ROUND, z)] for z in (-size[1], size[1])])
    ball = _ball()
    if kind == _T.mjGEOM_CAPSULE:
        return np.concatenate([size[0] * ball + [0, 0, z] for z in (-size[1], size[1])])
    return np.asarray(ball * (size if kind == _T.mjGEOM_ELLIPSOID else size[0]))


def _ball() -> Array:
    """Return points of a unit sphere."""
    height = np.linspace(-1.0, 1.0, 13)
    angle = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
    ring = np.sqrt(np.maximum(1.0 - height**2, 0.0))
    return np.concatenate(
        [
            np.stack([r * np.cos(angle), r * np.sin(angle), np.full(_ROUND, h)], axis=1)
            for r, h in zip(ring, height, strict=True)
        ]
    )


def _outline(points: Array) -> Array:
    """Return (32, 2) corners of the hull of points (n, 2), even along its length."""
    try:
        corners = points[ConvexHull(points).vertices]
    except QhullError:  # a line, seen from its side
        low, high = points[np.lexsort(points.T[::-1])[[0, -1]]]
        corners = np.array([low, high])
    closed = np.vstack([corners, corners[:1]])
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    if way[-1] == 0.0:
        return np.repeat(corners[:1], _ROUND, axis=0)
    # Corners stay: the even places nearest to them move onto them.
    even = np.linspace(0.0, way[-1], _ROUND, endpoint=False)
    if len(corners) <= _ROUND // 2:
        for place in way[:-1]:
            even[np.argmin(np.abs(even - place))] = place
    return np.stack([np.interp(even, way, closed[:, i]) for i in (0, 1)], axis=1)


def _seen(
    prediction: Prediction, body: int, solid: Array, sideways: Array, pictures: NDArray[np.intp]
) -> Array:
    """Return outlines of points (n, 3) of a body at its measured poses, NaN without."""
    trajectory = prediction.trajectory
    result = np.full((len(pictures), _ROUND, 2), np.nan)
    for row, frame in enumerate(pictures):
        if frame < 0:
            continue
        position, quaternion = trajectory.position[frame, body], trajectory.quaternion[frame, body]
        if np.isfinite(position).all() and np.isfinite(quaternion).all():
            result[row] = _outline((position + solid @ _matrix(quaternion).T) @ sideways.T)
    return result


def _matrix(quaternion: Array) -> Array:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)
