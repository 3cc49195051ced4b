"""Initial states of trajectories, and first guesses of those that are not known.

Guesses are straight lines through a trajectory's first frames, of bodies that fall freely or of
bodies that rest on something or roll over it, whichever the frames are nearer to.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory

Array = NDArray[np.float64]

# Frames that lines are drawn through, few enough to come before most contacts.
START_FRAMES = 5
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


def gravity_of(model: mujoco.MjModel) -> Array:
    """Return the gravity (3,) that acts in a model, m/s^2."""
    weightless = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    return np.zeros(3) if weightless else np.array(model.opt.gravity)


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
        position, quaternion, slope = _start(path, _fall(path, gravity_of(model)))
        q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        if trajectory.initial_qpos is None:
            qpos[q : q + 3] = np.where(path.known[:3], position, qpos[q : q + 3])
            if path.known[3]:
                qpos[q + 3 : q + 7] = quaternion
        if trajectory.initial_qvel is None:
            qvel[v : v + 6] = slope
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
        fall = _fall(path, gravity_of(model))
        position, first, _ = _start(path, fall)
        start, slope, guessed = np.zeros(6), np.zeros(6), np.zeros(6, dtype=bool)
        ways = {k: way for k, way in enumerate(_ways(path, fall)) if way.time.size > 1}
        # Contact ends the lines of all coordinates, also of those that hardly feel it.
        last = min((_last_on_line(way, sigma[k]) for k, way in ways.items()), default=0.0)
        for k, way in ways.items():
            frames = max(np.searchsorted(way.time, last, side="right"), START_FRAMES)
            value, rate = medians(way.time[:frames], way.value[:frames])
            start[k] = value[0] + path.position[k].value[0, 0] - position[k]
            slope[k], guessed[k] = rate[0], True
        if path.rotation.time.size > 1:
            reference = path.rotation.value[0].copy()
            # Vectors from a first frame that is itself an outlier are no line: twice, then.
            for _ in range(2):
                turn = _turn(path.rotation, reference)
                last = _last_on_line(turn, sigma[3:])
                frames = int(np.searchsorted(turn.time, last, side="right"))
                value, slope[3:] = medians(turn.time[:frames], turn.value[:frames])
                mujoco.mju_quatIntegrate(reference, value, 1.0)
            mujoco.mju_subQuat(start[3:], reference, first)
            guessed[3:] = True
        v = int(model.jnt_dofadr[joint])
        if trajectory.initial_qpos is None:
            displacement[v : v + 6] = start
        if trajectory.initial_qvel is None:
            qvel[v : v + 6] = np.where(guessed, slope, qvel[v : v + 6])
    return qvel, displacement


@dataclass(frozen=True, eq=False)
class _Samples:
    """What was measured of one quantity, and when.

    Attributes
    ----------
    time
        (m,) s, from the first frame of the trajectory.
    value
        (m, k).
    """

    time: Array
    value: Array


@dataclass(frozen=True, eq=False)
class _Path:
    """Coordinates (1 column each) and rotation (quaternions) of a body, each where it was seen.

    Trackers lose them in different frames: two cameras have an axis each, a gyroscope turns alone.
    """

    position: tuple[_Samples, _Samples, _Samples]
    rotation: _Samples

    @property
    def known(self) -> NDArray[np.bool_]:
        """(6,) whether x, y, z and rotations about them were ever measured."""
        seen = [samples.time.size > 0 for samples in (*self.position, self.rotation)]
        return np.array([*seen, seen[3], seen[3]])


def _path(trajectory: Trajectory, body: int, measured: NDArray[np.bool_]) -> _Path:
    seen = trajectory.measured[:, body] & measured
    time = trajectory.time - trajectory.time[0]
    x, y, z = (
        _Samples(time[frames], trajectory.position[frames, body, k : k + 1])
        for k, frames in enumerate(seen[:, :3].T)
    )
    turned = seen[:, 3]
    return _Path((x, y, z), _Samples(time[turned], trajectory.quaternion[turned, body]))


def _fall(path: _Path, gravity: Array) -> Array:
    """Return the acceleration of a body in its first frames: gravity, or 0 where it is carried."""
    left = np.zeros((2, 3))
    for row, acceleration in zip(left, (gravity, np.zeros(3)), strict=True):
        for k, way in enumerate(_ways(path, acceleration)):
            time, value = way.time[:START_FRAMES], way.value[:START_FRAMES]
            if time.size > 2:
                start, slope = medians(time, value)
                row[k] = np.median(np.abs(value - start - time[:, None] * slope))
    falling, carried = np.linalg.norm(left, axis=1)
    return np.zeros(3) if carried < _CARRIED * falling else gravity


def _start(path: _Path, fall: Array) -> tuple[Array, Array, Array]:
    """Return position, quaternion and rates (6,) at time 0: as first seen, or on the line there.

    They are 0, and no rotation, of what was never seen.
    """
    position, quaternion, slope = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(6)
    for k, way in enumerate(_ways(path, fall)):
        if way.time.size:
            value, rate = _beginning(way)
            position[k], slope[k] = path.position[k].value[0, 0] + value[0], rate[0]
    if path.rotation.time.size:
        quaternion[:] = path.rotation.value[0]
        value, slope[3:] = _beginning(_turn(path.rotation, quaternion))
        mujoco.mju_quatIntegrate(quaternion, value, 1.0)
    return position, quaternion, slope


def _beginning(way: _Samples) -> tuple[Array, Array]:
    """Return at time 0 the value, 0 where it was seen there, and the slope of the first frames."""
    nothing = np.zeros(way.value.shape[1])
    if way.time.size < 2:
        return nothing, nothing
    value, slope = _line(way.time[:START_FRAMES], way.value[:START_FRAMES])
    return (value if way.time[0] > 0.0 else nothing), slope


def _ways(path: _Path, fall: Array) -> list[_Samples]:
    """Return how far each coordinate is from its first, fall from rest at time 0 taken out.

    In free fall these are straight lines.
    """
    return [
        _Samples(s.time, s.value - s.value[:1] - 0.5 * fall[k] * s.time[:, None] ** 2)
        for k, s in enumerate(path.position)
    ]


def _turn(rotation: _Samples, reference: Array) -> _Samples:
    """Return rotation vectors from the quaternion `reference`: a line at a constant rate."""
    turn = np.empty((rotation.time.size, 3))
    for k, quaternion in enumerate(rotation.value):
        mujoco.mju_subQuat(turn[k], quaternion, reference)
    return _Samples(rotation.time, turn)


def _line(time: Array, values: Array) -> tuple[Array, Array]:
    """Return values at time 0 and slopes of the least-squares lines through (n, k) `values`."""
    value, slope = np.polynomial.polynomial.polyfit(time, values, 1)
    return np.asarray(value), np.asarray(slope)


def _last_on_line(way: _Samples, sigma: Array) -> float:
    """Return the time of the last frame that lies with those before it on one robust line.

    They are five at least.

    Parameters
    ----------
    way
        (m, k) values.
    sigma
        (k,) standard deviations of the values.
    """
    time, values = way.time, way.value
    frames = longest = min(START_FRAMES, time.size)
    while frames < min(time.size, _MOST_FRAMES):
        frames = min(int(_LONGER * frames), time.size, _MOST_FRAMES)
        value, slope = medians(time[:frames], values[:frames])
        last = slice(frames - frames // 3, frames)
        off = np.abs(values[last] - value - time[last, None] * slope) / sigma
        if (np.median(off, axis=0) > _ON_THE_LINE).any():
            break
        longest = frames
    return float(time[longest - 1])


def medians(time: Array, values: Array) -> tuple[Array, Array]:
    """Return values at time 0 and slopes of lines through (n, k) that outlying rows hardly move.

    Slopes are the medians of those between all pairs of rows, values the medians of what these
    leave (Theil 1950; Sen 1968): of five rows one may be anywhere, of many 29 %.
    """
    first, second = np.triu_indices(len(time), 1)
    run = (time[second] - time[first])[:, None]
    slope = np.median((values[second] - values[first]) / run, axis=0)
    return np.median(values - time[:, None] * slope, axis=0), slope
