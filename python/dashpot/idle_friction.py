"""Friction that a geom was given and no contact takes, since that of the other geom counts."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.materials import CombinationRules, Material
from dashpot.object_ids import geom_label

Pairs: TypeAlias = Mapping[tuple[int, int], Material]

#: Coefficients of friction, in the order of ``geom_friction``.
COEFFICIENTS = ("sliding", "torsional", "rolling")
# The least ``condim`` with which each acts.
_LEAST_CONDIM = (3, 4, 6)
_REASON = {
    "priority": "which has the higher priority",
    "max": "and the larger of the two counts",
    "min": "and the smaller of the two counts",
}


def warn_of_idle_friction(
    model: mujoco.MjModel,
    materials: Mapping[int, Material],
    pairs: Pairs,
    rules: CombinationRules,
    geoms: Iterable[int],
    stack_level: int,
) -> None:
    """Warn of friction in the materials of `geoms` that none of their contacts takes."""
    said = []
    for geom in geoms:
        named = np.isfinite(friction_of(model, materials, geom, of_model=False))
        for i in map(int, np.flatnonzero(named)):
            found = outvoted(model, materials, pairs, rules, geom, i)
            if found is not None:
                value = friction_of(model, materials, geom)[i]
                said.append(
                    f"{COEFFICIENTS[i]} friction {value:g} of geom {geom_label(model, geom)} "
                    f"has no effect: {found}"
                )
    if said:
        others = f" (and {len(said) - 1} more like it)" if len(said) > 1 else ""
        warnings.warn(
            f"{said[0]}{others}; give both geoms what is meant in one call of "
            "Engine.set_materials, or the pair by Engine.set_pair_material",
            stacklevel=stack_level + 1,
        )


def outvoted(
    model: mujoco.MjModel,
    materials: Mapping[int, Material],
    pairs: Pairs,
    rules: CombinationRules,
    geom: int,
    coefficient: int,
) -> str | None:
    """Say whose friction counts where a coefficient of a geom counts in no contact, else None.

    Pairs with a material of their own are left out, and so are those of the MJCF where neither geom
    was given friction. A geom that can touch nothing else, or a flex, counts as one that acts, and
    so does friction of 0 beside a material with friction, which it leaves to decide.
    """
    if model.nflex:
        return None
    own = friction_of(model, materials, geom)[coefficient]
    nearest, said = np.inf, None
    for other in partners(model, geom):
        pair = (min(geom, other), max(geom, other))
        named = _names_friction(materials, geom) or _names_friction(materials, other)
        if pair in pairs or (pair in listed_pairs(model) and not named):
            continue
        ahead = int(model.geom_priority[other]) - int(model.geom_priority[geom])
        condim = np.maximum(*model.geom_condim[[geom, other]])
        if ahead:
            condim = model.geom_condim[other if ahead > 0 else geom]
        if condim < _LEAST_CONDIM[coefficient]:
            continue
        theirs = friction_of(model, materials, other)[coefficient]
        rule = "priority" if ahead else rules.friction if named else "max"
        lost = {"priority": ahead > 0, "max": theirs > own, "min": theirs < own}
        left = own == 0.0 and _names_friction(materials, other)
        if left or not lost.get(rule, False):
            return None
        if abs(theirs - own) < nearest:
            nearest = abs(theirs - own)
            said = f"that of geom {geom_label(model, other)} is {theirs:g}, {_REASON[rule]}"
    return said


def _names_friction(materials: Mapping[int, Material], geom: int) -> bool:
    return geom in materials and materials[geom].friction is not None


def friction_of(
    model: mujoco.MjModel, materials: Mapping[int, Material], geom: int, *, of_model: bool = True
) -> NDArray[np.float64]:
    """Return (sliding, torsional, rolling) friction of a geom.

    What its material does not name is the model's, or nan without `of_model`.
    """
    given = materials[geom].friction if geom in materials else None
    found = np.array(model.geom_friction[geom]) if of_model else np.full(3, np.nan)
    if isinstance(given, tuple):
        return np.array(given)
    if given is not None:
        found[0] = given
    return found


def partners(model: mujoco.MjModel, geom: int) -> list[int]:
    """Return the geoms that the model lets a geom touch."""
    body: NDArray[Any] = model.geom_bodyid
    weld = model.body_weldid[body]
    parent = model.body_weldid[model.body_parentid[weld]]
    touches = weld != weld[geom]
    touches &= (model.geom_contype[geom] & model.geom_conaffinity) | (
        model.geom_contype & model.geom_conaffinity[geom]
    ) != 0
    if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT and weld[geom]:
        touches &= (weld == 0) | ((parent != weld[geom]) & (weld != parent[geom]))
    for signature in model.exclude_signature:
        one, two = int(signature) >> 16, int(signature) & 0xFFFF
        for mine, theirs in ((one, two), (two, one)):
            if body[geom] == mine:
                touches &= body != theirs
    for pair in listed_pairs(model):
        if geom in pair:
            touches[pair[0] + pair[1] - geom] = True
    return [int(other) for other in np.flatnonzero(touches)]


def listed_pairs(model: mujoco.MjModel) -> set[tuple[int, int]]:
    """Return the pairs of geoms that the MJCF lists, the lower id first."""
    pairs = np.sort(np.stack([model.pair_geom1, model.pair_geom2], axis=1), axis=1)
    return {(int(one), int(two)) for one, two in pairs}
