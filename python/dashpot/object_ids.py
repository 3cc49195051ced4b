"""Ids of geoms and bodies that are given by name or id."""

from __future__ import annotations

import difflib
import operator

import mujoco

_OBJECT = {"geom": mujoco.mjtObj.mjOBJ_GEOM, "body": mujoco.mjtObj.mjOBJ_BODY}


def object_id(model: mujoco.MjModel, key: str | int, kind: str, argument: str) -> int:
    """Id of the geom or body that `argument` names."""
    count: int = getattr(model, f"n{kind}")
    if isinstance(key, str):
        index = mujoco.mj_name2id(model, _OBJECT[kind], key)
        if index >= 0:
            return int(index)
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
        raise ValueError(f"{argument} = {index} is not a {kind} id of the model, 0 to {count - 1}")
    return index
