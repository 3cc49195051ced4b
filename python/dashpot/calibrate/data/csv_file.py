"""Recordings in tables of text: the columns of a file, in the units of its instruments."""

from __future__ import annotations

import csv
import difflib
import math
import os
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.units import factor_of
from dashpot.checks import existing_file

if TYPE_CHECKING:
    from _csv import Reader

Array = NDArray[np.float64]

POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
PIXELS = ("u", "v")
_SENSOR, _SENSOR_IN_FILES = "sensor:", "sensors."
# Between cells, the first that a header has all wanted columns with.
_DELIMITERS = (",", ";", "\t")
# Lines before the header: comments of instruments.
_MOST_BEFORE = 50
_MOST_RUNS = 10_000
_MISSING = frozenset({"", "na", "n/a", "#n/a", "nan", "none", "null", "-", "--"})


@dataclass(frozen=True)
class Table:
    """Where things stand in a file.

    Attributes
    ----------
    columns
        Names of columns by what they hold: ``time``, ``x`` or, of several bodies, ``BODY.x``,
        ``sensor:NAME`` or ``sensor:NAME.0`` and on. None: the file's names say it.
    bodies
        Names of the bodies.
    run
        Column that tells runs apart, None: there is one.
    unit
        Units by what it holds, by column, or by ``position`` for all coordinates.
    pixels
        Whether a camera is there that ``u`` and ``v`` are of, or ``BODY.u``.
    """

    columns: Mapping[str, str] | None
    bodies: tuple[str, ...]
    run: str | None = None
    unit: Mapping[str, str | float] | None = None
    pixels: bool = False


def read_runs(file: str | os.PathLike[str], table: Table) -> dict[str, dict[str, Any]]:
    """Return by run, in the order of the file, the fields that make a `Trajectory`.

    Of one run the name is empty.

    Raises
    ------
    ValueError
        Naming the line and column at fault.
    OSError
        If the file cannot be read.
    """
    file = existing_file("table", file)
    try:
        # With or without the mark that spreadsheets put in front of UTF-8.
        runs, columns = _read(file, table, "utf-8-sig")
    except UnicodeDecodeError:
        # As programs of instruments write umlauts and micro signs.
        runs, columns = _read(file, table, "latin-1")
    return {name: _fields(run, columns, table) for name, run in runs.items()}


def _read(
    file: str | os.PathLike[str], table: Table, encoding: str
) -> tuple[dict[str, dict[str, array[float]]], dict[str, str]]:
    """Return numbers by run and key, and the column of each key."""
    with open(file, newline="", encoding=encoding) as stream:
        before = list(islice(stream, _MOST_BEFORE))
        start, delimiter, header = _header(before, table)
        reader = csv.reader(_rest(before[start + 1 :], stream), delimiter=delimiter)
        try:
            return _read_rows(reader, header, table, start + 1, delimiter != ",")
        except csv.Error as error:
            raise ValueError(f"line {start + 1 + reader.line_num}: {error}") from None


def _rest(first: Sequence[str], stream: Iterator[str]) -> Iterator[str]:
    yield from first
    yield from stream


def _header(lines: Sequence[str], table: Table) -> tuple[int, str, list[str]]:
    """Return the line of the header, from 0, what is between cells, and the names of columns."""
    wanted = {"time"} if table.columns is None else set(table.columns.values())
    if table.run is not None:
        wanted.add(table.run)
    best: tuple[int, list[str]] = (-1, [])
    for delimiter in _DELIMITERS:
        for i, line in enumerate(lines):
            names = [name.strip() for name in _cells(line.lstrip("# "), delimiter)]
            found = len(wanted.intersection(names))
            if found == len(wanted):
                return i, delimiter, names
            if any(names) and found > best[0]:
                best = found, names
    names = best[1]
    if not names:
        raise ValueError("it is empty; a header and at least two rows are needed")
    missing = next(name for name in [*(table.columns or {"": "time"}).values(), table.run or ""]
                   if name in wanted and name not in names)  # fmt: skip
    near = difflib.get_close_matches(missing, names, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else f"; there are {_shown(names)}"
    raise ValueError(f"no column {missing!r}{hint}")


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:
        return []


def _shown(names: Sequence[str]) -> str:
    text = ", ".join(names)
    return text if len(text) <= 200 else f"{text[:200]} ..."


def _keys(header: Sequence[str], table: Table) -> dict[str, str]:
    """Return columns by what they hold; raise ValueError for what no trajectory holds."""
    bodies = table.bodies
    alone = len(bodies) == 1
    of_bodies = (*POSE, *PIXELS) if table.pixels or table.columns is not None else POSE
    poses = {f"{body}.{name}": f"{body}.{name}" for body in bodies for name in of_bodies}
    if alone:
        poses |= {name: f"{bodies[0]}.{name}" for name in of_bodies}
    keys: dict[str, str] = {}
    given = {name: name for name in header} if table.columns is None else table.columns
    for key, column in given.items():
        own = key.replace(_SENSOR_IN_FILES, _SENSOR, 1) if key.startswith(_SENSOR_IN_FILES) else key
        own = poses.get(own, own)
        known = own == "time" or own in poses.values() or own.startswith(_SENSOR)
        if not known and table.columns is None:
            continue  # files have columns of their own
        if not known:
            if key in (*POSE, *PIXELS):
                what = "in pixels" if key in PIXELS else "of a pose"
                raise ValueError(f"column {key!r} is {what}: say of which body")
            known_keys = ["time", *(poses if bodies else ()), f"{_SENSOR}NAME"]
            near = difflib.get_close_matches(key, known_keys, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known_keys)}"
            raise ValueError(f"columns: {key!r} is nothing that a trajectory holds; {hint}")
        if own in keys:
            raise ValueError(f"columns {keys[own]!r} and {column!r} are both {own!r}")
        if header.count(column) > 1:
            raise ValueError(f"{header.count(column)} columns are named {column!r}")
        keys[own] = column
    if "time" not in keys:
        raise ValueError(f"no column 'time'; there are {_shown(list(header))}")
    for body in bodies:
        turned = [name for name in POSE[3:] if f"{body}.{name}" in keys]
        seen = [name for name in PIXELS if f"{body}.{name}" in keys]
        prefix = "" if alone else f"{body}."
        if not any(f"{body}.{name}" in keys for name in (*POSE, *PIXELS)):
            raise ValueError(f"no column '{prefix}x', '{prefix}y' or '{prefix}z' of body '{body}'")
        if seen and not table.pixels:
            raise ValueError(
                f"column '{prefix}{seen[0]}' is in pixels: say which camera saw them, one of the "
                "model or an ImagePlane"
            )
        if turned and len(turned) < 4:
            missing = next(name for name in POSE[3:] if name not in turned)
            raise ValueError(f"no column {missing!r} of the quaternion of body '{body}'")
    return keys


def _read_rows(
    reader: Reader, header: list[str], table: Table, before: int, decimal_comma: bool
) -> tuple[dict[str, dict[str, array[float]]], dict[str, str]]:
    """Return numbers by run and key, and the column of each key.

    Cells become numbers row by row: text takes many times the room.
    """
    columns = _keys(header, table)
    places = [(key, column, header.index(column)) for key, column in columns.items()]
    if table.run is not None and header.count(table.run) > 1:
        raise ValueError(f"{header.count(table.run)} columns are named {table.run!r}")
    of_run = None if table.run is None else header.index(table.run)
    runs: dict[str, dict[str, array[float]]] = {}
    for row in reader:
        if not any(cell.strip() for cell in row):
            continue
        line = before + reader.line_num
        if len(row) != len(header):
            raise ValueError(f"line {line} has {len(row)} values, the header {len(header)}")
        name = "" if of_run is None else row[of_run].strip()
        if of_run is not None and not name:
            raise ValueError(f"line {line}, column {table.run!r}: no name of a run")
        if name not in runs:
            if len(runs) == _MOST_RUNS:
                raise ValueError(f"line {line}: more than {_MOST_RUNS} runs in {table.run!r}")
            runs[name] = {key: array("d") for key in columns}
        numbers = runs[name]
        for key, column, place in places:
            numbers[key].append(_number(row[place], line, column, key == "time", decimal_comma))
    few = next(
        (name for name, run in runs.items() if len(run["time"]) < 2), "" if not runs else None
    )
    if few is not None:
        of = f" of run {few!r}" if few else ""
        raise ValueError(f"a header and at least two rows{of} are needed")
    return runs, columns


def _number(text: str, line: int, column: str, time: bool, decimal_comma: bool) -> float:
    word = text.strip()
    if not time and word.lower() in _MISSING:
        return math.nan  # as trackers write what they lost
    try:
        if "_" in word:  # Python has it between digits, no instrument does
            raise ValueError
        value = float(word.replace(",", ".", 1) if decimal_comma else word)
    except ValueError:
        shown = text if len(text) <= 40 else f"{text[:40]}..."
        raise ValueError(f"line {line}, column {column!r}: {shown!r} is not a number") from None
    if math.isinf(value) or (time and math.isnan(value)):
        raise ValueError(f"line {line}, column {column!r}: {word[:40]} is not a finite number")
    return value


def _fields(
    run: Mapping[str, array[float]], columns: Mapping[str, str], table: Table
) -> dict[str, Any]:
    """Return time, bodies, positions, quaternions, pixels and sensors of a run, in SI units."""
    factors = _factors(columns, table)
    numbers = {key: factors[key] * np.array(values) for key, values in run.items()}
    n = len(run["time"])
    lost = np.full(n, np.nan)
    posed = [body for body in table.bodies if any(f"{body}.{name}" in numbers for name in POSE)]
    poses = [[numbers.get(f"{body}.{name}", lost) for name in POSE] for body in posed]
    block: Array = np.array(poses).reshape(len(posed), 7, n).transpose(2, 0, 1)
    pixels = {
        body: np.stack([numbers.get(f"{body}.{name}", lost) for name in PIXELS], axis=1)
        for body in table.bodies
        if any(f"{body}.{name}" in numbers for name in PIXELS)
    }
    turned = any(key.endswith(".qw") for key in numbers if not key.startswith(_SENSOR))
    sensors = {
        name: np.stack([numbers[key] for key in keys], axis=1)
        for name, keys in _sensors(columns).items()
    }
    fields: dict[str, Any] = {"time": numbers["time"], "sensors": sensors}
    if pixels:
        fields["pixels"] = pixels
    if posed:
        fields |= {"position": block[..., :3], "quaternion": block[..., 3:] if turned else None}
        fields["bodies"] = posed
    return fields


def _sensors(columns: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the keys ``sensor:NAME``, or ``sensor:NAME.0`` and on, of each sensor."""
    found: dict[str, list[str]] = {}
    for key in columns:
        if not key.startswith(_SENSOR):
            continue
        name, dot, index = key.removeprefix(_SENSOR).rpartition(".")
        numbered = bool(dot) and index.isdecimal()
        found.setdefault(name if numbered else key.removeprefix(_SENSOR), []).append(key)
    for name, keys in found.items():
        expected = [f"{_SENSOR}{name}.{i}" for i in range(len(keys))]
        if keys != [_SENSOR + name]:
            if sorted(keys) != sorted(expected):
                raise ValueError(f"columns of sensor {name!r} must be {', '.join(expected[:20])}")
            found[name] = expected
    return found


def _factors(columns: Mapping[str, str], table: Table) -> dict[str, float]:
    """Return what numbers are multiplied with by key; raise ValueError for a unit of nothing."""
    factors = dict.fromkeys(columns, 1.0)
    for name, unit in (table.unit or {}).items():
        factor = factor_of(f"unit[{name!r}]", unit)
        meant = [
            key
            for key, column in columns.items()
            if name in (key, column)
            or (not key.startswith(_SENSOR) and key.rpartition(".")[2] == name)
            or (name == "position" and key.rpartition(".")[2] in POSE[:3])
        ]
        if not meant:
            known = dict.fromkeys([*columns, *columns.values()])
            raise ValueError(f"unit: {name!r} is none of {_shown(list(known))}")
        for key in meant:
            factors[key] = factor
    return factors
