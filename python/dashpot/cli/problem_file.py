"""Calibration problems stated in a TOML or JSON file; see `dashpot.cli.problem_format`."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco

from dashpot.calibrate import ImagePlane, Parameter, Problem, Trajectory
from dashpot.checks import existing_file
from dashpot.cli.recordings import check_keys, read_npz
from dashpot.engine import Engine
from dashpot.materials import Material
from dashpot.model_sources import read_model

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_FIT_OPTIONS = (
    "method",
    "loss",
    "loss_scale",
    "windows",
    "starts",
    "local_searches",
    "max_evaluations",
    "errors",
    "confidence",
    "seed",
)
# Of trajectories; of tables but for the last.
_OF_TABLES = ("columns", "unit", "camera", "frames")
_OF_PICTURES = ("origin", "right", "down", "tilt", "name")
_MAX_BYTES = 10_000_000
_PARAMETER_COMMON = ("kind", "start", "bounds", "name", "transform", "difference", "per", "frozen")
_PARAMETER_KINDS = {
    "material": ("geoms", "quantity"),
    "pair": ("geoms", "quantity"),
    "model": ("attribute", "elements", "index"),
    "image": ("quantity", "camera"),
    "delay": ("channel",),
    "gain": ("channel",),
    "offset": ("channel",),
    "scale": (),
}
_OPTIONAL = ("index", "camera")
_OF_READINGS = ("image", "delay", "gain", "offset", "scale")
_OF_READINGS_COMMON = ("kind", "start", "bounds", "name", "per", "frozen")
_INERTIA = ("mass", "centre", "shape", "name", "difference", "per", "frozen")


def read_problem(path: str | os.PathLike[str]) -> tuple[Problem, dict[str, Any]]:
    """Return the calibration problem that a file states, and options for the fit.

    Raises
    ------
    ValueError
        Naming the file and the table or key at fault: unknown, missing or refused.
    FileNotFoundError
        If the file, its model or a trajectory is not there.
    """
    file = Path(path)
    try:
        content = _parse(existing_file("problem file", file))
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error
    try:
        return _problem(content, file.parent)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{file}: {error}") from error
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{file}: {error}") from error


def _parse(file: Path) -> dict[str, Any]:
    parsers = {".toml": tomllib.loads, ".json": json.loads}
    if file.suffix not in parsers:
        raise ValueError(f"a problem file ends in .toml or .json, not {file.suffix!r}")
    if file.stat().st_size > _MAX_BYTES:
        raise ValueError(f"a problem file has at most {_MAX_BYTES} bytes")
    try:
        content = parsers[file.suffix](file.read_text(encoding="utf-8"))
    except RecursionError:
        raise ValueError("its tables are nested too deeply") from None
    if not isinstance(content, dict):
        raise ValueError("the file holds no table of keys")
    return content


def _problem(content: Mapping[str, Any], folder: Path) -> tuple[Problem, dict[str, Any]]:
    optional = ("initial_state", "substeps", "window", "sensor_sigma", "noise")
    others = ("position_sigma", "rotation_sigma", "materials", "fit")
    required = ("model", "parameters", "trajectories")
    check_keys("the problem", content, required, (*optional, *others))
    engine = Engine(_model(folder / _typed("model", content["model"], str)))
    materials: dict[int, Material] = {}
    for geom, fields in _typed("materials", content.get("materials", {}), dict).items():
        label = f"materials.{geom}"
        check_keys(label, _typed(label, fields, dict), (), tuple(Material.__dataclass_fields__))
        try:
            materials[engine.geom_id(geom)] = Material(**fields)
        except (ValueError, TypeError) as error:
            raise ValueError(f"{label}: {error}") from error
    engine.set_materials(materials)
    options = _typed("fit", content.get("fit", {}), dict)
    check_keys("fit", options, (), _FIT_OPTIONS)
    chosen = {key: content[key] for key in optional if key in content}
    problem = Problem(
        engine,
        [
            _parameter(f"parameters[{index}]", entry)
            for index, entry in enumerate(_typed("parameters", content["parameters"], list))
        ],
        [
            _trajectory(f"trajectories[{index}]", entry, folder, engine.model)
            for index, entry in enumerate(_typed("trajectories", content["trajectories"], list))
        ],
        _typed("position_sigma", content.get("position_sigma", math.inf), (int, float, list)),
        _typed("rotation_sigma", content.get("rotation_sigma", math.inf), (int, float)),
        **chosen,
    )
    return problem, dict(options)


def _model(file: Path) -> mujoco.MjModel:
    if not os.path.isfile(file):  # False, too, of what no file can be called
        raise FileNotFoundError(
            f"model: no file {file}; it is an MJCF, URDF or .mjb file, seen from the folder of the "
            "problem"
        )
    return read_model(file)


def _parameter(label: str, entry: Any) -> Parameter:
    kind = _typed(label, entry, dict).get("kind")
    if kind == "inertia":
        return _inertia(label, entry)
    if kind not in _PARAMETER_KINDS:
        kinds = ", ".join((*_PARAMETER_KINDS, "inertia"))
        raise ValueError(f"{label}: kind is {kind!r}, none of {kinds}")
    own = _PARAMETER_KINDS[kind]
    required = tuple(key for key in own if key not in _OPTIONAL)
    common = _OF_READINGS_COMMON if kind in _OF_READINGS else _PARAMETER_COMMON
    start = () if kind in _OF_READINGS else ("start",)
    check_keys(label, entry, (*start, "bounds", *required), (*common, *own))
    values = {key: value for key, value in entry.items() if key not in ("kind", *own)}
    values["bounds"] = tuple(_typed(f"{label}.bounds", entry["bounds"], list))
    given = entry.get("geoms")
    several = kind == "pair" and isinstance(given, list) and any(type(g) is list for g in given)
    geoms = _names(f"{label}.geoms", given) if "geoms" in own and not several else ()
    try:
        if several:
            return Parameter.pair(given, entry["quantity"], **values)
        if kind == "model":
            index = entry.get("index")
            return Parameter.model(entry["attribute"], entry["elements"], index=index, **values)
        if kind in _OF_READINGS:
            first = [entry[key] for key in own if key in entry]
            made: Parameter = getattr(Parameter, kind)(*first, **values)
            return made
        if kind == "material":
            return Parameter.material(geoms, entry["quantity"], **values)
        if len(geoms) != 2:
            raise ValueError(f"a pair has two geoms, not {len(geoms)}")
        return Parameter.pair(geoms[0], geoms[1], entry["quantity"], **values)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{label}: {error}") from error


def _inertia(label: str, entry: Mapping[str, Any]) -> Parameter:
    check_keys(label, entry, ("kind", "body"), _INERTIA)
    values = {key: value for key, value in entry.items() if key not in ("kind", "body")}
    try:
        if "mass" in values:
            values["mass"] = tuple(_typed("mass", values["mass"], list))
        return Parameter.inertia(entry["body"], **values)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{label}: {error}") from error


def _trajectory(label: str, entry: Any, folder: Path, model: mujoco.MjModel) -> Trajectory:
    check_keys(label, _typed(label, entry, dict), ("file",), ("name", "bodies", *_OF_TABLES))
    file = folder / _typed(f"{label}.file", entry["file"], str)
    bodies = _names(f"{label}.bodies", entry.get("bodies", []))
    if not os.path.isfile(file):
        raise FileNotFoundError(f"{label}: no file {file}")
    name = str(entry.get("name", file.stem))
    options = {key: entry[key] for key in _OF_TABLES if key in entry}
    try:
        if "camera" in options:
            options["camera"] = _camera(f"{label}.camera", options["camera"])
        if file.suffix == ".csv":
            made: Trajectory
            for key, kind in (("columns", dict), ("unit", dict), ("frames", str)):
                _typed(f"{label}.{key}", options.get(key, kind()), kind)
            made = Trajectory.from_csv(file, body=bodies, name=name, **options)
            return made
        if set(options) - {"camera", "frames"}:
            raise ValueError(f"{next(iter(options))!r} is of .csv files")
        try:
            arrays = {**read_npz(file, bodies, model), **options}
        except (KeyError, OSError, ValueError) as error:
            raise ValueError(f"{file}: {error}") from error
        if not bodies:
            return Trajectory.of_sensors(name, **arrays)
        return Trajectory(name=name, bodies=bodies, **arrays)
    except (KeyError, OSError, ValueError, TypeError) as error:
        raise ValueError(f"{label}: {error}") from error


def _camera(label: str, entry: Any) -> str | ImagePlane:
    """Return the name of a camera, or the picture that a table describes."""
    if isinstance(entry, str):
        return entry
    check_keys(label, _typed(label, entry, dict), ("scale",), _OF_PICTURES)
    return ImagePlane(**entry)


def _names(label: str, value: Any) -> tuple[str, ...]:
    names = [value] if isinstance(value, str) else _typed(label, value, list)
    return tuple(_typed(label, name, str) for name in names)


def _typed(label: str, value: Any, kind: type | tuple[type, ...]) -> Any:
    if not isinstance(value, kind) or isinstance(value, bool):
        kinds = kind if isinstance(kind, tuple) else (kind,)
        expected = " or ".join(k.__name__ for k in kinds)
        raise ValueError(f"{label} is {value!r}, not of type {expected}")
    return value
