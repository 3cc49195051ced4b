"""Materials in an MJCF: custom numerics, which MuJoCo keeps and ignores, and engines read.

    <custom>
      <numeric name="dashpot:geom:stiffness:ball" data="10000"/>
      <numeric name="dashpot:geom:friction:ball" data="0.5 0.005 0.0001"/>
      <numeric name="dashpot:pair:restitution:ball & floor" data="0.8"/>
    </custom>

Each is one field of `Material` of a geom, or of a pair of geoms, by name or by id (``#3``) where
there is none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeAlias

import mujoco
import numpy as np

from dashpot.materials import Material
from dashpot.object_ids import id_of_name

__all__ = ["PREFIX", "numerics_of", "read_materials"]

PREFIX = "dashpot:"
_Key: TypeAlias = tuple[int, ...]
_AND = " & "
_FIELDS = tuple(field.name for field in fields(Material))
# Its default says no more than that there is a material.
_MARK = "tangential_ratio"


def read_materials(
    model: mujoco.MjModel,
) -> tuple[dict[int, Material], dict[tuple[int, int], Material]]:
    """Return the materials that a model's numerics give to geoms, and to pairs (lower id first).

    Raises
    ------
    ValueError
        Naming the numeric that means nothing, or whose material is none.
    """
    found: dict[_Key, dict[str, Any]] = {}
    for index in range(model.nnumeric):
        name = model.numeric(index).name
        if not name.startswith(PREFIX):
            continue
        kind, _, rest = name.removeprefix(PREFIX).partition(":")
        quantity, _, geoms = rest.partition(":")
        key = (_pair if kind == "pair" else _geom)(model, geoms)
        if kind not in ("geom", "pair") or quantity not in _FIELDS or key is None:
            raise ValueError(
                f"numeric {name!r} is none of {PREFIX}geom:FIELD:NAME and "
                f"{PREFIX}pair:FIELD:NAME{_AND}NAME, with fields of Material and geoms of the model"
            )
        first = int(model.numeric_adr[index])
        data = model.numeric_data[first : first + int(model.numeric_size[index])].tolist()
        found.setdefault(key, {})[quantity] = data[0] if len(data) == 1 else data
    of_geoms: dict[int, Material] = {}
    of_pairs: dict[tuple[int, int], Material] = {}
    for ids, values in found.items():
        try:
            material = Material(**values)
        except (ValueError, TypeError) as error:
            names = _AND.join(_name(model, geom) for geom in ids)
            raise ValueError(f"numerics {PREFIX}... of {names}: {error}") from error
        if len(ids) == 1:
            of_geoms[ids[0]] = material
        else:
            of_pairs[(ids[0], ids[1])] = material
    return of_geoms, of_pairs


def numerics_of(
    model: mujoco.MjModel,
    materials: Mapping[int, Material],
    pair_materials: Mapping[tuple[int, int], Material],
) -> dict[str, list[float]]:
    """Return numerics by name that `read_materials` makes the same materials of."""
    result: dict[str, list[float]] = {}
    keyed: list[tuple[str, _Key, Material]] = [("geom", (g,), m) for g, m in materials.items()]
    keyed += [("pair", pair, m) for pair, m in pair_materials.items()]
    for kind, geoms, material in keyed:
        names = _AND.join(_name(model, geom) for geom in geoms)
        for quantity in _FIELDS:
            value = getattr(material, quantity)
            if value != getattr(_PLAIN, quantity) or quantity == _MARK:
                numbers = np.atleast_1d(np.asarray(value, dtype=np.float64)).tolist()
                result[f"{PREFIX}{kind}:{quantity}:{names}"] = numbers
    return result


_PLAIN = Material()


def _name(model: mujoco.MjModel, geom: int) -> str:
    return str(model.geom(geom).name) or f"#{geom}"


def _geom(model: mujoco.MjModel, name: str) -> _Key | None:
    row = id_of_name(model, mujoco.mjtObj.mjOBJ_GEOM, name)
    if row >= 0:
        return (row,)
    number = name.removeprefix("#")
    if name.startswith("#") and number.isascii() and number.isdigit() and len(number) < 10:
        return (int(number),) if int(number) < model.ngeom else None
    return None


def _pair(model: mujoco.MjModel, names: str) -> _Key | None:
    """Return the two geoms of a pair; names may themselves have what stands between them."""
    at = names.find(_AND)
    while at >= 0:
        first, second = _geom(model, names[:at]), _geom(model, names[at + len(_AND) :])
        if first is not None and second is not None and first != second:
            return min(first[0], second[0]), max(first[0], second[0])
        at = names.find(_AND, at + 1)
    return None
