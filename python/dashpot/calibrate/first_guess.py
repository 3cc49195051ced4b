"""Initial states of trajectories, and first guesses of those that are not known.

Guesses are straight lines through a trajectory's first frames, of bodies that fall freely or of
bodies that rest on something or roll over it, whichever the frames are nearer to.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.clock import gravity_of
from dashpot.calibrate.trajectory import Trajectory

Array = NDArray[np.float64]

# Frames that lines are drawn through, few enough to come before most contacts.
_START_FRAMES = 5
# Robust lines go on over this many times as many frames, to this many at most, as long as half of
# the last third lies within so many standard deviations of them: of normal noise, 95 % do.
_LONGER = 1.5
_MOST_FRAMES = 64
_ON_THE_LINE = 2.0


# Bodies count as carried where that leaves less than this share of what a fall leaves.
_CARRIED = 0.5


def free_joint(model: mujoco.MjModel, body: int) -> int | None:
    """Return the id of the free joint of a body, None where it has another or none."""
    joint = int(model.body_jntadr[body])
    if joint >= 0 and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
        return joint
    return None


def free_bodies(trajectory: Trajectory, model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Return the indices of observed bodies on a free joint, and their joints."""
    joints = (free_joint(model, model.body(body).id) for body in trajectory.bodies)
    return [(i, joint) for i, joint in enumerate(joints) if joint is not None]


def initial_state(
    trajectory: Trajectory, model: mujoco.MjModel, measured: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Return the initial state of a trajectory; missing parts come from its first frames.

    Velocities are slopes of least-squares lines: a start for their estimation. What of (x, y, z,
    rotations) was not `measured` starts as the model has it, at rest.
    """
    qpos = np.array(model.qpos0)
    qvel = np.zeros(model.nv)
    if trajectory.initial_qpos is not None:
        qpos[:] = trajectory.initial_qpos
    if trajectory.initial_qvel is not None:
        qvel[:] = trajectory.initial_qvel
    for i, joint in free_bodies(trajectory, model):
        path = _path(trajectory, i, measured)
        if not path.time.size:
            continue
        q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        position, quaternion, slope = _start(path, _fall(path, gravity_of(model)))
        if trajectory.initial_qpos is None:
            qpos[q : q + 3] = np.where(path.known[:3], position, qpos[q : q + 3])
            if path.known[3]:
                qpos[q + 3 : q + 7] = quaternion
        if trajectory.initial_qvel is None:
            qvel[v : v + 6] = np.where(path.known, slope, 0.0)
    return qpos, qvel


def robust_guess(
    trajectory: Trajectory, model: mujoco.MjModel, sigma: Array, qvel: Array
) -> tuple[Array, Array]:
    """Return velocity and displacement of the initial state, outliers in its first frames aside.

    What the trajectory carries stays: the displacement is then 0, the velocity that of `qvel`.
    """
    qvel, displacement = qvel.copy(), np.zeros(model.nv)
    for i, joint in free_bodies(trajectory, model):
        path = _path(trajectory, i, np.isfinite(sigma))
        if path.time.size < 2:
            continue
        fall = _fall(path, gravity_of(model))
        position, first, _ = _start(path, fall)
        start, reference = np.empty(6), path.quaternion[0].copy()
        # Vectors from a first frame that is itself an outlier are no straight line: twice, then.
        for _ in range(2):
            time, motion = _motion(path, fall, reference, _MOST_FRAMES)
            lines = [_robust_line(time, motion[:, k], sigma[k]) for k in (slice(3), slice(3, 6))]
            value, slope = (np.concatenate(part) for part in zip(*lines, strict=True))
            mujoco.mju_quatIntegrate(reference, value[3:], 1.0)
        start[:3] = value[:3] + path.position[0] - position
        mujoco.mju_subQuat(start[3:], reference, first)
        v = int(model.jnt_dofadr[joint])
        if trajectory.initial_qpos is None:
            displacement[v : v + 6] = np.where(path.known, start, 0.0)
        if trajectory.initial_qvel is None:
            qvel[v : v + 6] = np.where(path.known, slope, 0.0)
    return qvel, displacement


@dataclass(frozen=True, eq=False)
class _Path:
    """Frames of a body in which all was measured that ever is of it.

    Attributes
    ----------
    time
        (m,) s, from the first frame of the trajectory.
    position, quaternion
        (m, 3) and (m, 4); any numbers where nothing is known.
    known
        (6,) whether x, y, z and rotations about them were measured.
    """

    time: Array
    position: Array
    quaternion: Array
    known: NDArray[np.bool_]


def _path(trajectory: Trajectory, body: int, measured: NDArray[np.bool_]) -> _Path:
    frames = trajectory.measured[:, body] & measured
    known = np.asarray(frames.any(axis=0))
    seen = frames[:, known].all(axis=1) & known.any()
    return _Path(
        trajectory.time[seen] - trajectory.time[0],
        np.where(known[:3], trajectory.position[seen, body], 0.0),
        np.where(known[3:4], trajectory.quaternion[seen, body], (1.0, 0.0, 0.0, 0.0)),
        known,
    )


def _fall(path: _Path, gravity: Array) -> Array:
    """Return the acceleration of a body in its first frames: gravity, or 0 where it is carried."""
    time = path.time[:_START_FRAMES]
    if time.size < 3:
        return gravity
    left = []
    for acceleration in (gravity, np.zeros(3)):
        way = path.position[: time.size] - 0.5 * acceleration * time[:, None] ** 2
        value, slope = _medians(time, way)
        off = np.median(np.abs(way - value - time[:, None] * slope), axis=0)
        left.append(float(np.linalg.norm(off[path.known[:3]])))
    return np.zeros(3) if left[1] < _CARRIED * left[0] else gravity


def _start(path: _Path, gravity: Array) -> tuple[Array, Array, Array]:
    """Return position, quaternion and rates (6,) at time 0: as first seen, or on the line there."""
    position, quaternion = path.position[0].copy(), path.quaternion[0].copy()
    if path.time.size < 2:
        return position, quaternion, np.zeros(6)
    value, slope = _line(*_motion(path, gravity, quaternion, _START_FRAMES))
    if path.time[0] > 0.0:
        position += value[:3]
        mujoco.mju_quatIntegrate(quaternion, value[3:], 1.0)
    return position, quaternion, slope


def _motion(path: _Path, gravity: Array, reference: Array, most: int) -> tuple[Array, Array]:
    """Return times (n,) of at `most` so many frames and the motion (n, 6) of a body in them.

    That is how far it is from its first position, fall from rest at time 0 taken out, and the
    rotation vector from the quaternion `reference`: straight lines in free fall at a constant rate
    of rotation.
    """
    time = path.time[:most]
    turn = np.empty((time.size, 3))
    for k in range(time.size):
        mujoco.mju_subQuat(turn[k], path.quaternion[k], reference)
    fall = path.position[: time.size] - path.position[0] - 0.5 * gravity * time[:, None] ** 2
    return time, np.hstack([fall, turn])


def _line(time: Array, values: Array) -> tuple[Array, Array]:
    """Return values at time 0 and slopes of the least-squares lines through (n, k) `values`."""
    value, slope = np.polynomial.polynomial.polyfit(time, values, 1)
    return np.asarray(value), np.asarray(slope)


def _robust_line(time: Array, values: Array, sigma: Array) -> tuple[Array, Array]:
    """Return values at time 0 and slopes of lines that outlying rows do not move far.

    Slopes are the medians of those between all pairs of rows, values the medians of what these
    leave (Theil 1950; Sen 1968): of five rows one may be anywhere, of many 29 %. They are drawn
    through as many rows as lie on one line, five at least.

    Parameters
    ----------
    time
        (n,) ascending.
    values
        (n, k).
    sigma
        (k,) standard deviations of the values, infinite where they do not count.
    """
    found = _medians(time[:_START_FRAMES], values[:_START_FRAMES])
    frames = _START_FRAMES
    while frames < min(len(time), _MOST_FRAMES):
        frames = min(int(_LONGER * frames), len(time), _MOST_FRAMES)
        value, slope = _medians(time[:frames], values[:frames])
        last = slice(frames - frames // 3, frames)
        off = np.abs(values[last] - value - time[last, None] * slope) / sigma
        if (np.median(off, axis=0) > _ON_THE_LINE).any():
            break
        found = value, slope
    return found


def _medians(time: Array, values: Array) -> tuple[Array, Array]:
    first, second = np.triu_indices(len(time), 1)
    run = (time[second] - time[first])[:, None]
    slope = np.median((values[second] - values[first]) / run, axis=0)
    return np.median(values - time[:, None] * slope, axis=0), slope
