"""Models on the device: MuJoCo Warp's, with materials and options of the law beside them."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import mujoco
import mujoco_warp
import numpy as np
import warp as wp
from numpy.typing import NDArray

from dashpot import Engine, Material
from dashpot.law import restitution_to_damping_ratio
from dashpot.warp.features import refuse
from dashpot.warp.material import DAMPING, FROM_MODEL, RATIO, RESTITUTION, vec7

__all__ = ["LawModel", "Model", "put_model"]

Law = Literal["kelvin_voigt", "comfree"]
Numbers = float | NDArray[np.floating[Any]]

MICROSTEP = 2.5e-4  # s, the longest of rigid contacts
FEWEST = 13
MOST = 64


@dataclass
class LawModel:
    """What the law adds to a model. Arrays of shape (k, ...) hold for the worlds ``world % k``."""

    law: Law
    microsteps: int
    recovery_speed: wp.array
    comfree_stiffness: wp.array
    comfree_damping: wp.array
    constraint_rows: int
    has_joints: bool
    geom_tree: wp.array
    dof_tree: wp.array
    jnt_bodyid: wp.array
    body_is_free: wp.array
    tree_factor: wp.array
    factor_size: int
    geom_margin: wp.array
    pair_margin: wp.array
    jnt_margin: wp.array
    tendon_margin: wp.array
    limits: int
    nmocap: int
    body_mocap: wp.array
    mocap_body: wp.array
    eq_mocap: wp.array
    mocap_timeconst: wp.array
    explicit_pairs: wp.array
    pair_geoms: wp.array
    pair_values: wp.array
    stiffness: wp.array
    damping: wp.array
    form: wp.array
    tangential_ratio: wp.array
    tangential_damping: wp.array
    own: list[wp.array] = field(default_factory=list)
    materials: dict[int, Material] = field(default_factory=dict)
    geom_id: dict[str, int] = field(default_factory=dict)


class Model(mujoco_warp.Model):  # type: ignore[misc]
    """MuJoCo Warp's model with the law's part of it, `dashpot`.

    Examples
    --------
    >>> m.nv, type(m.dashpot).__name__
    (12, 'LawModel')
    """

    dashpot: LawModel


def put_model(
    mjm: mujoco.MjModel,
    *,
    materials: Mapping[Any, Material] | None = None,
    pair_materials: Mapping[Any, Material] | None = None,
    law: Law = "kelvin_voigt",
    microsteps: int | Literal["auto"] = "auto",
    recovery_speed: Numbers = 0.1,
    comfree_stiffness: Numbers = 0.2,
    comfree_damping: Numbers = 0.001,
    mocap_timeconst: Numbers = 0.02,
    batch_sizes: dict[str, int] | None = None,
) -> Model:
    """Put a model on the device.

    Parameters
    ----------
    mjm
        Compiled model. It is not changed; its friction cone counts as elliptic.
    materials
        By geom, as `Engine.set_materials` takes them. Others are rigid, or as soft as the model's
        own ``solref`` says where it sets one. Without materials those of the MJCF count, as in
        `Engine`.
    pair_materials
        By pair of geoms, as `Engine.set_pair_material` takes them; without friction.
    law
        ``"kelvin_voigt"``, the closed-form law with true stiction, or ``"comfree"``, the
        complementarity-free update of ComFree-Sim (arXiv 2603.12185).
    microsteps
        Number of micro-steps of every step, the same in all worlds, 1 to 64. ``"auto"``: as many as
        make them 0.25 ms, at least 13.
    recovery_speed
        How fast overlap that no spring took up recovers at most, m/s, >= 0.
    comfree_stiffness, comfree_damping
        k_user (1/s, > 0) and d_user (>= 0) of ``law="comfree"``.
    mocap_timeconst
        s, >= 0: time constant with which mocap bodies follow their poses that connects or welds
        hold something to. Others are there at the end of the step.
    batch_sizes
        As in ``mujoco_warp.put_model``: how many values fields have, taken ``world % k``.

    Numbers may be arrays of shape (k,); world w has entry ``w % k``.

    Raises
    ------
    NotImplementedError
        Naming what the model has that this engine has not.
    ValueError
        For options out of range.

    Examples
    --------
    >>> m = dw.put_model(model, microsteps=20)
    >>> m.nv
    12
    """
    if law not in ("kelvin_voigt", "comfree"):
        raise ValueError(f"law must be 'kelvin_voigt' or 'comfree', got {law!r}")
    given, pairs = _materials(mjm, materials, pair_materials)
    refuse(mjm, given, pairs, law)
    private = copy.copy(mjm)
    private.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    if mjm.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICIT:
        # What it has beside `implicitfast`, Coriolis forces, are those of the middle of the step.
        private.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # Two boxes have MuJoCo's own manifold: the convex one keeps four points, and may leave out the
    # deepest where it looks ahead.
    private.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_NATIVECCD
    m: Model = mujoco_warp.put_model(private, batch_sizes)
    m.__class__ = Model
    m.dashpot = LawModel(
        law=law,
        microsteps=_microsteps(microsteps, mjm.opt.timestep),
        recovery_speed=_numbers("recovery_speed", recovery_speed, 0.0),
        comfree_stiffness=_numbers("comfree_stiffness", comfree_stiffness, 0.0),
        comfree_damping=_numbers("comfree_damping", comfree_damping, 0.0),
        mocap_timeconst=_numbers("mocap_timeconst", mocap_timeconst, 0.0),
        constraint_rows=_constraint_rows(mjm),
        **_topology(mjm, m),
        **_material_arrays(mjm, given, m),
        **_pair_arrays(pairs),
        own=_own_solrefs(mjm),
        materials=given,
        geom_id={mjm.geom(i).name: i for i in range(mjm.ngeom)},
    )
    return m


def _numbers(name: str, value: Numbers, least: float) -> wp.array:
    """Return (k,) numbers, checked."""
    array = np.atleast_1d(np.asarray(value, dtype=np.float32))
    if array.ndim != 1 or array.size == 0 or not (array >= least).all():
        raise ValueError(f"{name} must be numbers >= {least:g} of shape (k,), got {value!r}")
    return wp.array(array, dtype=wp.float32)


def _microsteps(given: int | Literal["auto"], timestep: float) -> int:
    if given == "auto":
        return int(min(MOST, max(FEWEST, np.ceil(timestep / MICROSTEP - 1e-6))))
    if not isinstance(given, int) or not 1 <= given <= MOST:
        raise ValueError(f"microsteps must be 'auto' or 1 to {MOST}, got {given!r}")
    return given


def _dims(mjm: mujoco.MjModel) -> int:
    largest = max([1, *mjm.geom_condim.tolist(), *mjm.pair_dim.tolist()])
    return 3 if largest <= 3 else 6


def _materials(
    mjm: mujoco.MjModel,
    materials: Mapping[Any, Material] | None,
    pair_materials: Mapping[Any, Material] | None,
) -> tuple[dict[int, Material], dict[tuple[int, int], Material]]:
    """Materials by geom id and by pair, checked as `Engine` does."""
    engine = Engine(mjm)
    if materials is not None or pair_materials is not None:
        engine.set_materials(dict.fromkeys(engine.materials))
        for pair in engine.pair_materials:
            engine.set_pair_material(*pair, None)
        engine.set_materials(materials or {})
        for (first, second), material in (pair_materials or {}).items():
            engine.set_pair_material(first, second, material)
    return dict(engine.materials), dict(engine.pair_materials)


def _constraint_rows(mjm: mujoco.MjModel) -> int:
    """How many rows of limits, equalities and dry friction a model may have."""
    sizes = {mujoco.mjtEq.mjEQ_CONNECT: 3, mujoco.mjtEq.mjEQ_WELD: 6}
    rows = sum(sizes.get(mujoco.mjtEq(kind), 1) for kind in mjm.eq_type)
    rows += int((mjm.dof_frictionloss > 0).sum() + (mjm.tendon_frictionloss > 0).sum())
    return int(rows) + _limits(mjm)


def _sides(mjm: mujoco.MjModel) -> int:
    """How many trees a row of contacts, equalities or tendons may join."""
    most = [2]
    for tendon in range(mjm.ntendon):
        trees = set()
        first = mjm.tendon_adr[tendon]
        for wrap in range(first, first + mjm.tendon_num[tendon]):
            kind, index = mujoco.mjtWrap(mjm.wrap_type[wrap]), mjm.wrap_objid[wrap]
            if kind == mujoco.mjtWrap.mjWRAP_JOINT:
                trees.add(mjm.dof_treeid[mjm.jnt_dofadr[index]])
            elif kind == mujoco.mjtWrap.mjWRAP_SITE:
                trees.add(mjm.body_treeid[mjm.site_bodyid[index]])
            elif kind in (mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER):
                trees.add(mjm.body_treeid[mjm.geom_bodyid[index]])
        most.append(2 * len(trees - {-1}))  # an equality may tie two tendons
    return int(max(1, min(mjm.ntree, max(most))))


def _limits(mjm: mujoco.MjModel) -> int:
    return int((mjm.jnt_limited > 0).sum() + (mjm.tendon_limited > 0).sum())


def _topology(mjm: mujoco.MjModel, m: Any) -> dict[str, Any]:
    """Trees, free bodies and the reach of geoms."""
    geom_tree = mjm.body_treeid[mjm.geom_bodyid]
    sizes = mjm.tree_dofnum.astype(np.int64)
    is_free = np.zeros(mjm.nbody, dtype=np.int32)
    free = m.body_freeadr.numpy()
    is_free[free] = 1
    pairs = np.stack([mjm.pair_geom1, mjm.pair_geom2], axis=1) if mjm.npair else np.zeros((0, 2))
    return {
        "has_joints": bool(6 * len(free) < mjm.nv),
        "geom_tree": wp.array(geom_tree.astype(np.int32)),
        "dof_tree": wp.array(mjm.dof_treeid.astype(np.int32)),
        "jnt_bodyid": wp.array(mjm.jnt_bodyid.astype(np.int32)),
        "body_is_free": wp.array(is_free),
        "tree_factor": wp.array((np.cumsum(sizes**2) - sizes**2).astype(np.int32)),
        "factor_size": int((sizes**2).sum()),
        "geom_margin": m.geom_margin,
        "pair_margin": m.pair_margin,
        "jnt_margin": m.jnt_margin,
        "tendon_margin": m.tendon_margin,
        "limits": _limits(mjm),
        "nmocap": int(mjm.nmocap),
        **_mocap(mjm),
        "explicit_pairs": wp.array(pairs.astype(np.int32), dtype=wp.vec2i),
    }


def _material_arrays(mjm: mujoco.MjModel, materials: dict[int, Material], m: Any) -> dict[str, Any]:
    """One row of numbers a geom; friction goes to MuJoCo Warp's own array."""
    n = mjm.ngeom
    stiffness, damping = np.zeros((1, n), np.float32), np.ones((1, n), np.float32)
    form = np.full(n, FROM_MODEL, np.int32)
    ratio, zeta = np.ones((1, n), np.float32), np.ones((1, n), np.float32)
    friction = mjm.geom_friction.astype(np.float32).copy()
    for geom, material in materials.items():
        stiffness[0, geom] = material.stiffness or 0.0
        form[geom], damping[0, geom] = _form_of(material)
        ratio[0, geom] = material.tangential_ratio
        zeta[0, geom] = material.tangential_damping_ratio
        if material.friction is not None:
            given = np.atleast_1d(np.asarray(material.friction, dtype=np.float32))
            friction[geom, : len(given)] = np.where(
                np.isnan(given), friction[geom, : len(given)], given
            )
    m.geom_friction = wp.array(friction[None], dtype=wp.vec3)
    return {
        "stiffness": wp.array(stiffness),
        "damping": wp.array(damping),
        "form": wp.array(form),
        "tangential_ratio": wp.array(ratio),
        "tangential_damping": wp.array(zeta),
    }


def _mocap(mjm: mujoco.MjModel) -> dict[str, Any]:
    """Which mocap body takes every body along, -1 for none; and which ones equalities hold."""
    bodies = [int(np.flatnonzero(mjm.body_mocapid == i)[0]) for i in range(mjm.nmocap)]
    return {
        "body_mocap": wp.array(mjm.body_mocapid[mjm.body_rootid].astype(np.int32)),
        "mocap_body": wp.array(np.array(bodies, dtype=np.int32)),
        "eq_mocap": wp.array(_held_by_mocap(mjm), dtype=wp.vec2i),
    }


def _held_by_mocap(mjm: mujoco.MjModel) -> NDArray[np.int32]:
    """Mocap bodies that the two sides of connects and welds are or are fixed to, -1 for none."""
    held = np.full((mjm.neq, 2), -1, dtype=np.int32)
    for i in range(mjm.neq):
        if mujoco.mjtEq(mjm.eq_type[i]) in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            body = np.array([mjm.eq_obj1id[i], mjm.eq_obj2id[i]])
            if mjm.eq_objtype[i] == mujoco.mjtObj.mjOBJ_SITE:
                body = mjm.site_bodyid[body]
            held[i] = np.where(
                mjm.body_treeid[body] < 0, mjm.body_mocapid[mjm.body_rootid[body]], -1
            )
    return held


def _form_of(material: Material) -> tuple[int, float]:
    """How damping is given, and a damping ratio or N s/m."""
    if material.damping is not None:
        return DAMPING, material.damping
    if material.restitution is not None:
        return RESTITUTION, min(restitution_to_damping_ratio(material.restitution), 1e6)
    return RATIO, 1.0 if material.damping_ratio is None else material.damping_ratio


def _pair_arrays(materials: dict[tuple[int, int], Material]) -> dict[str, Any]:
    """Seven numbers a pair, as `pair_material` returns them."""
    values = np.zeros((len(materials), 7), np.float32)
    for row, material in zip(values, materials.values(), strict=True):
        form, number = _form_of(material)
        row[:] = (
            material.stiffness or 0.0,
            1.0 if form == DAMPING else number,
            number if form == DAMPING else -1.0,
            0.0,
            float(form == RESTITUTION),
            material.tangential_ratio,
            material.tangential_damping_ratio,
        )
    geoms = np.array(list(materials) or np.zeros((0, 2)), dtype=np.int32).reshape(-1, 2)
    return {
        "pair_geoms": wp.array(geoms, dtype=wp.vec2i),
        "pair_values": wp.array(values, dtype=vec7),
    }


def _own_solrefs(mjm: mujoco.MjModel) -> list[wp.array]:
    """Which geoms, equalities, dofs, tendons and joints set solref or solimp themselves.

    Of equalities also those that mocap bodies hold: a rigid row would tear at what cannot follow.
    """

    def own(solref: Any, solimp: Any, also: Any = False) -> wp.array:
        usual = np.array([0.9, 0.95, 0.001, 0.5, 2.0])
        differs = (np.abs(solref - [0.02, 1.0]) > 0).any(1) | (np.abs(solimp - usual) > 0).any(1)
        return wp.array((differs | also).astype(np.int32))

    return [
        own(mjm.geom_solref, mjm.geom_solimp),
        own(mjm.eq_solref, mjm.eq_solimp, (_held_by_mocap(mjm) >= 0).any(1)),
        own(mjm.dof_solref, mjm.dof_solimp),
        own(mjm.tendon_solref_fri, mjm.tendon_solimp_fri),
        own(mjm.jnt_solref, mjm.jnt_solimp),
        own(mjm.tendon_solref_lim, mjm.tendon_solimp_lim),
    ]
