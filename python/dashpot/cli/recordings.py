"""Recordings of trajectories in files: .npz archives and tables."""

from __future__ import annotations

import csv
import difflib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

_POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
_SENSOR = "sensors."


def read_npz(file: Path, bodies: Sequence[str]) -> dict[str, Any]:
    """Return the fields of a trajectory in an archive; poses where there are `bodies`.

    Raises
    ------
    ValueError
        Naming the array that is unknown or missing.
    """
    required = ("time", "position", "quaternion") if bodies else ("time",)
    optional = (
        "initial_qpos", "initial_qvel", "initial_qpos_sigma", "initial_qvel_sigma", "control"
    )  # fmt: skip
    with np.load(file, allow_pickle=False) as archive:
        if not isinstance(archive, np.lib.npyio.NpzFile):
            raise ValueError("it holds one array; an .npz archive of named arrays is needed")
        arrays = {key: archive[key] for key in archive.files}
    sensors = {key: arrays.pop(key) for key in list(arrays) if key.startswith(_SENSOR)}
    check_keys("the arrays", arrays, required, optional)
    return {**arrays, "sensors": {k.removeprefix(_SENSOR): v for k, v in sensors.items()}}


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
        lines = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    rows = [row for _, row in lines]
    if len(rows) < 3:
        raise ValueError("a header and at least two rows are needed")
    header = [name.strip() for name in rows[0]]
    prefixes = [""] if len(bodies) == 1 and "x" in header else [f"{body}." for body in bodies]
    poses = [prefix + name for prefix in prefixes for name in _POSE]
    sensors = _sensor_columns(header)
    wanted = ["time", *poses, *(column for columns in sensors.values() for column in columns)]
    missing = [name for name in wanted if name not in header]
    if missing:
        raise ValueError(f"no column {missing[0]!r}; there are {', '.join(header)}")
    twice = [name for name in wanted if header.count(name) > 1]
    if twice:
        raise ValueError(f"{header.count(twice[0])} columns are named {twice[0]!r}")
    for number, row in lines[1:]:
        if len(row) != len(header):
            raise ValueError(f"line {number} has {len(row)} values, the header {len(header)}")
    table = {
        name: np.array([_cell(row[header.index(name)], number, name) for number, row in lines[1:]])
        for name in wanted
    }
    fields: dict[str, Any] = {"time": table["time"]}
    fields["sensors"] = {
        name: np.stack([table[column] for column in columns], axis=1)
        for name, columns in sensors.items()
    }
    if bodies:
        block = np.stack([table[name] for name in poses], axis=1).reshape(-1, len(bodies), 7)
        fields |= {"position": block[..., :3], "quaternion": block[..., 3:]}
    return fields


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
