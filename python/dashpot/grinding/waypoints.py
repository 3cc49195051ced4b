"""Set points of a plan as a table that a robot's controller can read."""

from __future__ import annotations

import csv
import math
import os
from pathlib import Path as File
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.grinding.motion import Motion

if TYPE_CHECKING:
    from dashpot.grinding.passes import PlannedPass
    from dashpot.grinding.plan import Plan

__all__ = ["waypoints", "write_waypoints"]

Array = NDArray[np.float64]

_PLACE = ("x", "y", "z", "qw", "qx", "qy", "qz")
_MOTION = ("pass", "time", "way", "feed", "offset", "force")


def waypoints(plan: Plan) -> tuple[list[str], Array]:
    """Return the columns and (n, columns) rows of a plan's set points, at the controller's rate.

    ``pass`` from 1; ``time`` in s from its start; ``way`` along the path, m; ``feed``, m/s;
    ``offset``, how far below the surface the tip is sent, m; ``force`` that is expected, N; ``x``
    to ``qz``, the pose of the tip in the world that belongs to the joint angles, m and unit; each
    joint's angle, rad, by name; and under ``NAME.sent`` what the simulated servos are sent, ahead
    by speed, weight and load over their stiffness. A controller with a feed-forward of its own
    takes the angles.
    """
    columns = [*_MOTION, *_PLACE]
    names = plan.cell.parts.joint_names
    columns += names
    if plan.cell.control.kind != "impedance":
        columns += [f"{name}.sent" for name in names]
    rows = [_rows(planned, index + 1) for index, planned in enumerate(plan.passes)]
    return columns, np.concatenate(rows)


def write_waypoints(plan: Plan, file: str | os.PathLike[str]) -> File:
    """Write the table of `waypoints` as CSV."""
    columns, rows = waypoints(plan)
    with open(file, "w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        for row in rows:
            writer.writerow([f"{int(row[0])}", *(f"{value:.9g}" for value in row[1:])])
    return File(file)


def _rows(planned: PlannedPass, number: int) -> Array:
    cell, command = planned.cell, planned.command
    motion = Motion(cell, planned.path)
    period = cell.control.period
    ticks = np.arange(math.ceil(command.law.duration / period) + 1)
    time = np.asarray(period * ticks, dtype=np.float64)
    way, speed, _ = command.law.at(time)
    offset = np.interp(way, command.law.distance, command.offset)
    angles = motion.angles(way, offset)
    blocks = [
        np.full(len(time), float(number)),
        time,
        way,
        speed,
        offset,
        command.wanted(time),
    ]
    columns = [np.stack(blocks, axis=1), _poses(planned, angles), angles]
    if cell.control.kind != "impedance":
        columns.append(motion.set_points(command, time))
    return np.concatenate(columns, axis=1)


def _poses(planned: PlannedPass, angles: Array) -> Array:
    parts = planned.cell.rigid
    data = mujoco.MjData(parts.model)
    poses = np.empty((len(angles), 7))
    for index, each in enumerate(angles):
        data.qpos[:] = each
        mujoco.mj_kinematics(parts.model, data)
        poses[index, :3] = data.site_xpos[parts.tip]
        mujoco.mju_mat2Quat(poses[index, 3:], data.site_xmat[parts.tip])
    return poses
