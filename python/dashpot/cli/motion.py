"""A motion as a table to read, and as one to calibrate with."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

if TYPE_CHECKING:
    from rich.table import Table

_ROWS = 12
_POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")


def happenings(arrays: dict[str, Any]) -> Table:
    """Return a table of what happens, in about a dozen spans of time.

    Parameters
    ----------
    arrays
        Rows of every step: ``time``, ``contacts``, ``penetration`` (m), ``kinetic``, ``potential``,
        ``elastic`` and ``dissipated`` (J).
    """
    from rich.table import Table

    table = Table(
        title="What happens",
        caption="contacts, penetration: the most of each span; total: kinetic, potential, elastic",
    )
    for heading in (
        "until [s]",
        "contacts",
        "penetration [mm]",
        "kinetic [J]",
        "total [J]",
        "dissipated [J]",
    ):
        table.add_column(heading, justify="right")
    count = len(arrays["time"])
    ends = np.unique(np.linspace(0, count - 1, min(count, _ROWS + 1)).round().astype(int))
    total = arrays["kinetic"] + arrays["potential"] + arrays["elastic"]
    for before, end in zip([-1, *ends[:-1]], ends, strict=True):
        span = slice(before + 1, end + 1)
        table.add_row(
            f"{arrays['time'][end]:.4g}",
            str(int(arrays["contacts"][span].max())),
            f"{1e3 * arrays['penetration'][span].max():.3g}",
            f"{arrays['kinetic'][end]:.4g}",
            f"{total[end]:.4g}",
            f"{arrays['dissipated'][end]:.4g}",
        )
    return table


def write_poses(file: Path, model: mujoco.MjModel, arrays: dict[str, Any]) -> None:
    """Write the poses of the named bodies that move as a table, a row a step.

    Columns are ``time`` (s) and ``ball.x`` (m) ... ``ball.qz`` for each body, without its name
    where there is one alone: those that a problem file reads.
    """
    moving = [b for b in range(1, model.nbody) if model.body_weldid[b] and model.body(b).name]
    if not moving:
        raise ValueError("no body that moves has a name; --save writes those that have")
    data = mujoco.MjData(model)
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        prefix = [f"{model.body(b).name}." if len(moving) > 1 else "" for b in moving]
        writer.writerow(["time", *(f"{p}{column}" for p in prefix for column in _POSE)])
        for time, qpos in zip(arrays["time"], arrays["qpos"], strict=True):
            data.qpos[:] = qpos
            mujoco.mj_kinematics(model, data)
            poses = np.concatenate([[*data.xpos[b], *data.xquat[b]] for b in moving])
            writer.writerow([repr(float(number)) for number in (time, *poses)])
