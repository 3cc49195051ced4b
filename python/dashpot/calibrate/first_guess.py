"""Initial states of trajectories, and first guesses of those that are not known.

Guesses are straight lines through a trajectory's first frames.
"""

from __future__ import annotations

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
        q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        if trajectory.initial_qpos is None:
            qpos[q : q + 3] = np.where(measured[:3], trajectory.position[0, i], qpos[q : q + 3])
            if measured[3]:
                qpos[q + 3 : q + 7] = trajectory.quaternion[0, i]
        if trajectory.initial_qvel is None:
            qvel[v : v + 6] = np.where(
                measured,
                _line(*_motion(trajectory, model, i, trajectory.quaternion[0, i], _START_FRAMES)),
                0.0,
            )
    return qpos, qvel


def robust_guess(
    trajectory: Trajectory, model: mujoco.MjModel, sigma: Array, qvel: Array
) -> tuple[Array, Array]:
    """Return velocity and displacement of the initial state, outliers in its first frames aside.

    What the trajectory carries stays: the displacement is then 0, the velocity that of `qvel`.
    """
    qvel, displacement = qvel.copy(), np.zeros(model.nv)
    measured = np.isfinite(sigma)
    for i, joint in free_bodies(trajectory, model):
        first = trajectory.quaternion[0, i]
        start, reference = np.empty(6), first.copy()
        # Vectors from a first frame that is itself an outlier are no straight line: twice, then.
        for _ in range(2):
            time, motion = _motion(trajectory, model, i, reference, _MOST_FRAMES)
            lines = [_robust_line(time, motion[:, k], sigma[k]) for k in (slice(3), slice(3, 6))]
            value, slope = (np.concatenate(part) for part in zip(*lines, strict=True))
            mujoco.mju_quatIntegrate(reference, value[3:], 1.0)
        start[:3] = value[:3]
        mujoco.mju_subQuat(start[3:], reference, first)
        v = int(model.jnt_dofadr[joint])
        if trajectory.initial_qpos is None:
            displacement[v : v + 6] = np.where(measured, start, 0.0)
        if trajectory.initial_qvel is None:
            qvel[v : v + 6] = np.where(measured, slope, 0.0)
    return qvel, displacement


def _motion(
    trajectory: Trajectory, model: mujoco.MjModel, body: int, reference: Array, most: int
) -> tuple[Array, Array]:
    """Return times (n,) of at `most` so many frames and the motion (n, 6) of a body in them.

    That is how far it is from its first position, fall taken out, and the rotation vector from the
    quaternion `reference`: straight lines in free fall at a constant rate of rotation.
    """
    frames = min(most, trajectory.frames)
    position, quaternion = trajectory.position[:, body], trajectory.quaternion[:, body]
    t = trajectory.time[:frames] - trajectory.time[0]
    turn = np.empty((frames, 3))
    for k in range(frames):
        mujoco.mju_subQuat(turn[k], quaternion[k], reference)
    fall = position[:frames] - position[0] - 0.5 * gravity_of(model) * t[:, None] ** 2
    return t, np.hstack([fall, turn])


def _line(time: Array, values: Array) -> Array:
    """Return the slopes of the least-squares lines through (n, k) `values`."""
    return np.asarray(np.polynomial.polynomial.polyfit(time, values, 1)[1])


def _robust_line(time: Array, values: Array, sigma: Array) -> tuple[Array, Array]:
    """Return values at time 0 and slopes of lines that outlying rows do not move far.

    Slopes are the medians of those between all pairs of rows, values the medians of what these
    leave (Theil 1950; Sen 1968): of five rows one may be anywhere, of many 29 %. They are drawn
    through as many rows as lie on one line, five at least.

    Parameters
    ----------
    time
        (n,) ascending from 0.
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
