"""Checks of what the contact queries take."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot.checks import is_data_of, number_array, require_finite
from dashpot.object_ids import Element, object_id

if TYPE_CHECKING:
    from dashpot.engine import Engine

Geom: TypeAlias = Element


def model_of(engine: Engine | mujoco.MjModel) -> mujoco.MjModel:
    """Return the model of an engine, or the model itself; TypeError for anything else."""
    model = engine if isinstance(engine, mujoco.MjModel) else getattr(engine, "model", None)
    if not isinstance(model, mujoco.MjModel) or isinstance(engine, mujoco.MjData):
        raise TypeError(
            f"expected a dashpot.Engine or a mujoco.MjModel, got {type(engine).__name__}"
        )
    return model


def check_data(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Raise TypeError where `data` is no ``mujoco.MjData``, ValueError where not of `model`."""
    if not is_data_of(model, data):
        raise ValueError("data was made from another model")


def geom_pair(
    model: mujoco.MjModel, data: mujoco.MjData, geom1: Geom, geom2: Geom
) -> tuple[int, int]:
    """Check data and return the ids of two different geoms."""
    check_data(model, data)
    return distinct_geoms(model, geom1, geom2)


def distinct_geoms(model: mujoco.MjModel, geom1: Geom, geom2: Geom) -> tuple[int, int]:
    """Return the ids of two geoms by name or id; ValueError where they are one."""
    id1, id2 = (
        object_id(model, geom, "geom", argument)
        for geom, argument in ((geom1, "geom1"), (geom2, "geom2"))
    )
    if id1 == id2:
        raise ValueError(f"geom1 and geom2 are the same geom: {geom1!r}")
    return id1, id2


def vectors(name: str, value: ArrayLike, size_name: str, size: int) -> NDArray[np.float64]:
    """Return an array (..., size) of finite numbers, contiguous."""
    array = number_array(name, value)
    if array.ndim == 0 or array.shape[-1] != size:
        raise ValueError(
            f"{name} must be (..., {size_name}) with {size_name} = {size}, got {array.shape}"
        )
    require_finite(name, array)
    return np.ascontiguousarray(array)
