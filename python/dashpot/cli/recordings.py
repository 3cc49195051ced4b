"""Recordings of trajectories in files: .npz archives and tables."""

from __future__ import annotations

import csv
import difflib
import math
from array import array
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from dashpot.calibrate.problem.observables import find_sensor
from dashpot.data.archive import ArrayArchive

if TYPE_CHECKING:
    from _csv import Reader

_POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
_SENSOR = "sensors."
_OPTIONAL = (
    "initial_qpos",
    "initial_qvel",
    "initial_qpos_sigma",
    "initial_qvel_sigma",
    "control",
)


def read_npz(file: Path, bodies: Sequence[str], model: mujoco.MjModel) -> dict[str, Any]:
    """Return the fields of a trajectory in an archive; poses where there are `bodies`.

    Names are checked, and sizes against the model's, before any array is read.

    Raises
    ------
    ValueError
        Naming the array that is unknown, missing, too large or damaged.
    """
    required = ("time", "position", "quaternion") if bodies else ("time",)
    with ArrayArchive(file) as archive:
        own = [name for name in archive if not name.startswith(_SENSOR)]
        check_keys("the arrays", dict.fromkeys(own), required, _OPTIONAL)
        most = _most_numbers(archive, bodies, model)
        for name, header in archive.items():
            if math.prod(header.shape) > most.get(name, math.inf):
                raise ValueError(
                    f"array {name!r} has shape {header.shape}; the model and the times have "
                    f"{most[name]} numbers for it"
                )
        arrays = {name: archive.read(name) for name in archive}
    sensors = {name.removeprefix(_SENSOR): arrays.pop(name) for name in archive if name not in own}
    return {**arrays, "sensors": sensors}


def _most_numbers(
    archive: ArrayArchive, bodies: Sequence[str], model: mujoco.MjModel
) -> dict[str, int]:
    """Return how many numbers there can be in each array but the times."""
    frames = math.prod(archive["time"].shape)
    most = {
        "position": 3 * frames * len(bodies),
        "quaternion": 4 * frames * len(bodies),
        "control": frames * model.nu,
        "initial_qpos": model.nq,
        "initial_qvel": model.nv,
        "initial_qpos_sigma": model.nv,
        "initial_qvel_sigma": model.nv,
    }
    for name in archive:
        if name.startswith(_SENSOR):
            sensor = find_sensor(model, name.removeprefix(_SENSOR), "the arrays")
            most[name] = frames * sensor.size
    return most


def read_csv(file: Path, bodies: Sequence[str]) -> dict[str, Any]:
    """Return times, sensors, and the poses of `bodies`, in a table.

    Raises
    ------
    ValueError
        Naming line and column at fault.
    """
    # With or without the mark that spreadsheets put in front of UTF-8.
    with file.open(newline="", encoding="utf-8-sig") as stream:
        reader = csv.reader(stream)
        try:
            table, sensors, poses = _read_table(reader, bodies)
        except csv.Error as error:
            raise ValueError(f"line {reader.line_num}: {error}") from None
    fields: dict[str, Any] = {"time": table["time"]}
    fields["sensors"] = {
        name: np.stack([table[column] for column in columns], axis=1)
        for name, columns in sensors.items()
    }
    if bodies:
        block = np.stack([table[name] for name in poses], axis=1).reshape(-1, len(bodies), 7)
        fields |= {"position": block[..., :3], "quaternion": block[..., 3:]}
    return fields


def _read_table(
    reader: Reader, bodies: Sequence[str]
) -> tuple[dict[str, array[float]], dict[str, list[str]], list[str]]:
    """Return the columns that are wanted, those of each sensor, and those of poses.

    Cells become numbers row by row: text takes many times the room.
    """
    rows = (row for row in reader if any(cell.strip() for cell in row))
    header = [name.strip() for name in next(rows, [])]
    prefixes = [""] if len(bodies) == 1 and "x" in header else [f"{body}." for body in bodies]
    poses = [prefix + name for prefix in prefixes for name in _POSE]
    sensors = _sensor_columns(header)
    wanted = ["time", *poses, *(column for columns in sensors.values() for column in columns)]
    table = {name: array("d") for name in wanted}
    for row in rows:
        if not table["time"]:
            _check_header(header, wanted)
        if len(row) != len(header):
            raise ValueError(
                f"line {reader.line_num} has {len(row)} values, the header {len(header)}"
            )
        for name, column in table.items():
            column.append(_cell(row[header.index(name)], reader.line_num, name))
    if len(table["time"]) < 2:
        raise ValueError("a header and at least two rows are needed")
    return table, sensors, poses


def _check_header(header: Sequence[str], wanted: Sequence[str]) -> None:
    """Raise ValueError for a column that is missing, or there twice."""
    missing = [name for name in wanted if name not in header]
    if missing:
        raise ValueError(f"no column {missing[0]!r}; there are {', '.join(header)}")
    twice = [name for name in wanted if header.count(name) > 1]
    if twice:
        raise ValueError(f"{header.count(twice[0])} columns are named {twice[0]!r}")


def check_keys(
    label: str, table: Mapping[str, Any], required: Sequence[str], optional: Sequence[str]
) -> None:
    """Raise ValueError for keys of a table that are unknown or missing."""
    known = [*required, *optional]
    for key in table:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else f"; known: {', '.join(known)}"
            raise ValueError(f"{label}: unknown key {key!r}{hint}")
    for key in required:
        if key not in table:
            raise ValueError(f"{label}: {key!r} is missing")


def _sensor_columns(header: Sequence[str]) -> dict[str, list[str]]:
    """Return the columns ``sensors.NAME``, or ``sensors.NAME.0`` and on, of each sensor."""
    columns: dict[str, list[str]] = {}
    for column in header:
        if not column.startswith(_SENSOR):
            continue
        name, dot, index = column.removeprefix(_SENSOR).rpartition(".")
        numbered = bool(dot) and index.isdecimal()
        columns.setdefault(name if numbered else column.removeprefix(_SENSOR), []).append(column)
    for name, found in columns.items():
        expected = [f"{_SENSOR}{name}.{i}" for i in range(len(found))]
        if found != [_SENSOR + name] and sorted(found) != sorted(expected):
            raise ValueError(f"columns of sensor {name!r} must be {', '.join(expected)}")
        columns[name] = expected if found != [_SENSOR + name] else found
    return columns


def _cell(text: str, line: int, column: str) -> float:
    if not text.strip() and column != "time":
        return math.nan  # as trackers write what they lost
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"line {line}, column {column!r}: {text!r} is not a number") from None
