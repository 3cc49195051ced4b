"""Ids of geoms, bodies and other elements of a model that are given by name or id."""

from __future__ import annotations

import difflib
import operator
from typing import SupportsIndex, TypeAlias

import mujoco

# What identifies a geom, body, joint ... of a model: its name or its id.
Element: TypeAlias = str | SupportsIndex

# By kind: MuJoCo's type, and where a model has their number.
_OBJECT = {
    "geom": (mujoco.mjtObj.mjOBJ_GEOM, "ngeom"),
    "body": (mujoco.mjtObj.mjOBJ_BODY, "nbody"),
    "joint": (mujoco.mjtObj.mjOBJ_JOINT, "njnt"),
    "site": (mujoco.mjtObj.mjOBJ_SITE, "nsite"),
    "pair": (mujoco.mjtObj.mjOBJ_PAIR, "npair"),
    "actuator": (mujoco.mjtObj.mjOBJ_ACTUATOR, "nu"),
    "camera": (mujoco.mjtObj.mjOBJ_CAMERA, "ncam"),
    "tendon": (mujoco.mjtObj.mjOBJ_TENDON, "ntendon"),
}


def object_id(model: mujoco.MjModel, key: Element, kind: str, argument: str) -> int:
    """Id of the geom, body, ... that `argument` names."""
    object_type, size = _OBJECT[kind]
    count: int = getattr(model, size)
    if isinstance(key, str):
        index = id_of_name(model, object_type, key)
        if index >= 0:
            return index
        accessor = getattr(model, kind)
        names = [name for i in range(count) if (name := accessor(i).name)]
        near = difflib.get_close_matches(key, names, n=3)
        hint = f"; did you mean {', '.join(map(repr, near))}?" if near else ""
        raise ValueError(f"{argument}: the model has no {kind} named {key!r}{hint}")
    if isinstance(key, bool):
        raise TypeError(f"{argument} must be a {kind} name or id, got {key!r}")
    try:
        index = operator.index(key)
    except TypeError:
        raise TypeError(
            f"{argument} must be a {kind} name or id, got {type(key).__name__}"
        ) from None
    if not 0 <= index < count:
        if count == 0:
            raise ValueError(f"{argument} = {index}: the model has no {kind}")
        raise ValueError(f"{argument} = {index} is not a {kind} id of the model, 0 to {count - 1}")
    return index


def geom_label(model: mujoco.MjModel, geom: int) -> str:
    """Return the name of a geom in quotes or, where it has none, its id."""
    name = model.geom(geom).name
    return repr(name) if name else str(geom)


def id_of_name(model: mujoco.MjModel, object_type: mujoco.mjtObj, name: str) -> int:
    """Return the id of what has exactly this name, -1 for none: MuJoCo reads up to a NUL."""
    return -1 if "\0" in name else int(mujoco.mj_name2id(model, object_type, name))
