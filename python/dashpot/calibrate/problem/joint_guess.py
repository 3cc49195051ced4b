"""First guesses of joints from their own readings, as those of encoders."""

from __future__ import annotations

from collections.abc import Collection

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.angles import unwrapped
from dashpot.calibrate.problem.first_guess import START_FRAMES, medians

Array = NDArray[np.float64]


def joint_readings(trajectory: Trajectory, model: mujoco.MjModel) -> dict[str, int]:
    """Return the observed sensors of positions of joints, and the joints they are of."""
    found = {}
    for name in trajectory.sensors:
        if name in trajectory.views:
            continue
        sensor = model.sensor(name)
        if sensor.type[0] == mujoco.mjtSensor.mjSENS_JOINTPOS:
            found[name] = int(sensor.objid[0])
    return found


def guess_joints(
    trajectory: Trajectory,
    model: mujoco.MjModel,
    qpos: Array,
    qvel: Array,
    *,
    positions: bool,
    left_out: Collection[str],
) -> None:
    """Put in `qpos` (nq,) and `qvel` (nv,) what the first readings of joints tell of the start.

    What a trajectory carries stays.

    Parameters
    ----------
    positions
        Whether positions are estimated too; else they are as they are.
    left_out
        Sensors that read something else, by an unknown gain, offset or delay.
    """
    for name, joint in joint_readings(trajectory, model).items():
        time = trajectory.sensor_time(name) - trajectory.time[0]
        readings = unwrapped(trajectory.sensors[name])
        seen = np.flatnonzero(~np.isnan(readings[:, 0]))
        if name in left_out or seen.size == 0:
            continue
        values = readings[seen[:START_FRAMES]]
        start, rate = values[0], np.zeros(1)
        if len(values) > 1:
            start, rate = medians(time[seen[: len(values)]], values)
        if positions and trajectory.initial_qpos is None:
            qpos[model.jnt_qposadr[joint]] = start[0]
        if trajectory.initial_qvel is None:
            qvel[model.jnt_dofadr[joint]] = rate[0]
