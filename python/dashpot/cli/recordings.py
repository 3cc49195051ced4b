"""Recordings of trajectories in .npz archives, and tables of keys."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco

from dashpot.calibrate.problem.observables import find_sensor
from dashpot.data.archive import ArrayArchive

_SENSOR, _PIXELS = "sensors.", "pixels."
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
        own = [name for name in archive if not name.startswith((_SENSOR, _PIXELS))]
        check_keys("the arrays", dict.fromkeys(own), required, _OPTIONAL)
        most = _most_numbers(archive, bodies, model)
        for name, header in archive.items():
            if math.prod(header.shape) > most.get(name, math.inf):
                raise ValueError(
                    f"array {name!r} has shape {header.shape}; the model and the times have "
                    f"{most[name]} numbers for it"
                )
        arrays: dict[str, Any] = {name: archive.read(name) for name in archive}
    for field, prefix in (("sensors", _SENSOR), ("pixels", _PIXELS)):
        named = [name for name in arrays if name.startswith(prefix)]
        if named or field == "sensors":
            arrays[field] = {name.removeprefix(prefix): arrays.pop(name) for name in named}
    return arrays


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
        if name.startswith(_PIXELS):
            most[name] = 2 * frames
        if name.startswith(_SENSOR):
            sensor = find_sensor(model, name.removeprefix(_SENSOR), "the arrays")
            most[name] = frames * sensor.size
    return most


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
