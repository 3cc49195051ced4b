"""What dashpot.warp does not have: refused by name, never ignored."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import numpy as np

from dashpot.materials import Material

__all__ = ["refuse"]


def _tendon_rows_at_mocap(model: Any) -> bool:
    """Whether a tendon with rows of its own goes by what a mocap body takes along."""
    has_rows = (model.tendon_limited > 0) | (model.tendon_frictionloss > 0)
    for i in range(model.neq):
        if model.eq_type[i] == mujoco.mjtEq.mjEQ_TENDON:
            pair = np.array([model.eq_obj1id[i], model.eq_obj2id[i]])
            has_rows[pair[pair >= 0]] = True
    for tendon in np.flatnonzero(has_rows):
        first = model.tendon_adr[tendon]
        for wrap in range(first, first + model.tendon_num[tendon]):
            kind, index = mujoco.mjtWrap(model.wrap_type[wrap]), model.wrap_objid[wrap]
            if kind == mujoco.mjtWrap.mjWRAP_SITE:
                body = model.site_bodyid[index]
            elif kind in (mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER):
                body = model.geom_bodyid[index]
            else:
                continue
            if model.body_mocapid[model.body_rootid[body]] >= 0:
                return True
    return False


# Description and test of everything that a model may have and this engine has not.
_MISSING: tuple[tuple[str, Callable[[Any], bool]], ...] = (
    ("flexes", lambda m: m.nflex > 0),
    ("signed distance fields", lambda m: bool((m.geom_type == mujoco.mjtGeom.mjGEOM_SDF).any())),
    ("integrator 'RK4'", lambda m: m.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4),
    ("integrator 'discrete'", lambda m: m.opt.integrator == mujoco.mjtIntegrator.mjINT_DISCRETE),
    ("the flag 'sleep'", lambda m: bool(m.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP)),
    (
        "the flag 'override'",
        lambda m: bool(m.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE),
    ),
    ("adhesion of geoms", lambda m: bool(m.geom_adhesion.any())),
    (
        "adhesion actuators (transmission 'body')",
        lambda m: bool((m.actuator_trntype == mujoco.mjtTrn.mjTRN_BODY).any()),
    ),
    ("gaps of geoms or pairs", lambda m: bool((m.geom_gap > 0).any() or (m.pair_gap > 0).any())),
    (
        "limits, equalities or dry friction of tendons that go to mocap bodies",
        lambda m: _tendon_rows_at_mocap(m),
    ),
)


def refuse(
    model: mujoco.MjModel,
    materials: Mapping[int, Material],
    pair_materials: Mapping[tuple[int, int], Material],
    law: str,
) -> None:
    """Raise NotImplementedError that lists what the model has and this engine has not."""
    names = [name for name, has in _MISSING if has(model)]
    if law == "comfree" and model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICIT:
        names.append("integrator 'implicit' with law='comfree' (use 'implicitfast')")
    explicit = {*model.pair_geom1.tolist(), *model.pair_geom2.tolist()}
    for geom, material in materials.items():
        of_geom = f"of the material of geom {model.geom(geom).name or geom!r}"
        if material.loaded_friction < 1.0:
            names.append(f"loaded_friction {of_geom}")
        if material.friction is not None and geom in explicit:
            names.append(f"friction {of_geom}, which is in an explicit pair")
    for pair, material in pair_materials.items():
        if material.friction is not None or material.loaded_friction < 1.0:
            geoms = " and ".join(model.geom(geom).name or repr(geom) for geom in pair)
            names.append(f"friction of the material of the pair of geoms {geoms}")
    if names:
        raise NotImplementedError("dashpot.warp has no " + "; no ".join(names))
