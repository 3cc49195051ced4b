"""The ways in which a comparison steps a model: dashpot, and MuJoCo with chosen options.

MuJoCo's contact parameters live in acceleration space. A direct ``solref = (-s, -c)`` makes a
contact whose free impact is that of a spring and damper with

    s = k w,    c = d w,    w the apparent inverse mass (1/kg),

so the fit of "solref-direct" to an SI stiffness k and damping d needs the mass that a contact
moves. A geom has one solref for all its contacts: w is taken as that of its body alone
(``body_invweight0``), which is right against anything fixed and, between two equal bodies,
half of what it should be. A steady load is another matter: MuJoCo's impedance takes most of it
away, so that bodies at rest sag by ``1 - solimp`` of what the spring says. A rigid contact has no
SI stiffness; it gets the stiffest ``solref`` that MuJoCo itself deems safe, (2 timestep, 1).
"""

from __future__ import annotations

import copy
import difflib
import math
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from dashpot import _core
from dashpot.engine import Engine


@dataclass(frozen=True)
class Setting:
    """One way to step a model with MuJoCo.

    Attributes
    ----------
    name, description
        For tables and plots.
    apply
        Changes a private copy of the model; gets the dashpot engine too, for its materials. The
        copy comes with pyramidal cones, ``impratio`` 1 and no noslip iterations.

    Examples
    --------
    >>> def noslip(model, engine):
    ...     model.opt.noslip_iterations = 20
    >>> setting = dashpot.compare.Setting("noslip", "20 iterations without slip", noslip)
    >>> comparison = dashpot.compare.run(model, duration=0.1, settings=["dashpot", setting])
    >>> [run.name for run in comparison.runs]
    ['dashpot', 'noslip']
    """

    name: str
    description: str
    apply: Callable[[mujoco.MjModel, Engine], None]


DASHPOT = "dashpot"
"""Name of the setting that steps with the engine itself."""

_IMPRATIO = 10.0
_NOSLIP_ITERATIONS = 10
_DEFAULT_SOLREF = (0.02, 1.0)


def _default(model: mujoco.MjModel, engine: Engine) -> None:
    """Leave the model as it is."""


def _elliptic(model: mujoco.MjModel, engine: Engine) -> None:
    model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC


def _impratio(model: mujoco.MjModel, engine: Engine) -> None:
    _elliptic(model, engine)
    model.opt.impratio = _IMPRATIO


def _noslip(model: mujoco.MjModel, engine: Engine) -> None:
    _elliptic(model, engine)
    model.opt.noslip_iterations = _NOSLIP_ITERATIONS


def _discrete(model: mujoco.MjModel, engine: Engine) -> None:
    _elliptic(model, engine)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE


def _solref_direct(model: mujoco.MjModel, engine: Engine) -> None:
    _elliptic(model, engine)
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        inverse_mass = float(model.body_invweight0[body, 0])
        if model.body_weldid[body] != 0 and inverse_mass > 0:
            model.geom_solref[geom] = direct_solref(model, engine, geom, inverse_mass)


def direct_solref(
    model: mujoco.MjModel, engine: Engine, geom: int, inverse_mass: float
) -> tuple[float, float]:
    """Return MuJoCo's solref for a moving geom's contact with the fixed geoms of the model.

    Parameters
    ----------
    model
        The model.
    engine
        Engine with the materials.
    geom
        Id of a geom of a moving body.
    inverse_mass
        1/kg, of its body.

    Returns
    -------
    tuple
        (-stiffness, -damping) in MuJoCo's acceleration units where the stiffest of the contacts
        with fixed geoms (with its own kind, in a model without any) has an SI stiffness;
        (2 timestep, 1) where it is rigid. A geom whose MJCF sets a solref, and to which nobody
        gave a material, keeps it: dashpot takes that for its material too.
    """
    own = model.geom_solref[geom]
    if geom not in engine.materials and not np.array_equal(own, _DEFAULT_SOLREF):
        return float(own[0]), float(own[1])
    fixed = np.flatnonzero(model.body_weldid[model.geom_bodyid] == 0)
    pairs = [_pair(engine, geom, int(other)) for other in fixed] or [_pair(engine, geom, geom)]
    soft = [pair for pair in pairs if not pair.rigid]
    if not soft:
        return 2.0 * float(model.opt.timestep), 1.0
    stiffest = max(soft, key=lambda pair: float(pair.stiffness))
    damping = _core.damping_of(stiffest, stiffest.stiffness, inverse_mass)
    if not math.isfinite(damping):  # restitution 0: all that one explicit step can take out
        damping = 1.0 / (inverse_mass * float(model.opt.timestep))
    return -stiffest.stiffness * inverse_mass, -damping * inverse_mass


def _pair(engine: Engine, geom1: int, geom2: int) -> _core.Material:
    """Return the core form of the material of a contact."""
    own = engine.pair_material(geom1, geom2) if geom1 != geom2 else None
    if own is not None:
        return own._to_core()
    materials = (engine.material(geom1)._to_core(), engine.material(geom2)._to_core())
    return _core.combine(*materials, engine.rules._to_core())


SETTINGS: dict[str, Setting] = {
    s.name: s
    for s in (
        Setting("mujoco-default", "MuJoCo, pyramidal cones, its own solref", _default),
        Setting("elliptic", "MuJoCo, elliptic cones", _elliptic),
        Setting("impratio", f"MuJoCo, elliptic cones, impratio {_IMPRATIO:g}", _impratio),
        Setting(
            "noslip",
            f"MuJoCo, elliptic cones, {_NOSLIP_ITERATIONS} noslip iterations",
            _noslip,
        ),
        Setting(
            "solref-direct",
            "MuJoCo, elliptic cones, solref fitted to the same stiffness and damping",
            _solref_direct,
        ),
        Setting("discrete", "MuJoCo, elliptic cones, discrete integrator", _discrete),
    )
}
"""MuJoCo settings by name."""

DEFAULT_SETTINGS = (
    DASHPOT,
    "mujoco-default",
    "elliptic",
    "impratio",
    "solref-direct",
    "discrete",
)
"""What :func:`dashpot.compare.run` compares unless told."""


def mujoco_model(setting: Setting, pristine: mujoco.MjModel, engine: Engine) -> mujoco.MjModel:
    """Return a copy of the pristine model as `setting` steps it, with the engine's friction.

    Raises
    ------
    ValueError
        If the engine's friction cannot be said in MuJoCo: another rule than "max", friction that
        falls with load, or a friction of a pair both of whose geoms may meet others.
    """
    model = copy.deepcopy(pristine)
    model.opt.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    model.opt.impratio = 1.0
    model.opt.noslip_iterations = 0
    # A diverging run has to be seen, not silently started over.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    _refuse_loaded_friction(engine)
    overridden = False
    for geom, material in engine.materials.items():
        if material.friction is not None:
            overridden = True
            values = np.atleast_1d(material.friction)
            model.geom_friction[geom, : len(values)] = values
    if overridden and engine.rules.friction != "max":
        raise ValueError(
            f"friction rule {engine.rules.friction!r} has no counterpart in MuJoCo, whose rule "
            'is "max": compare with settings=("dashpot",) only'
        )
    for (geom1, geom2), pair in engine.pair_materials.items():
        if pair.friction is not None and not (
            _give_pair_friction(model, geom1, geom2, pair.friction)
            or _give_pair_friction(model, geom2, geom1, pair.friction)
        ):
            names = [model.geom(g).name or g for g in (geom1, geom2)]
            raise ValueError(
                f"the friction of the pair {names[0]!r}, {names[1]!r} has no counterpart in "
                "MuJoCo's geoms, which meet others too: give it to the geoms"
            )
    setting.apply(model, engine)
    return model


def _refuse_loaded_friction(engine: Engine) -> None:
    """Raise ValueError where friction falls with load, which MuJoCo's does not."""
    geoms = [((geom,), material) for geom, material in engine.materials.items()]
    for ids, material in [*geoms, *engine.pair_materials.items()]:
        if material.loaded_friction != 1.0:
            names = ", ".join(repr(engine.model.geom(i).name or i) for i in ids)
            what = f"the {'pair' if len(ids) > 1 else 'geom'} {names}"
            raise ValueError(
                f"loaded_friction {material.loaded_friction:g} of {what} has no counterpart in "
                'MuJoCo: compare with settings=("dashpot",) only'
            )


def _give_pair_friction(
    model: mujoco.MjModel, geom: int, other: int, friction: float | tuple[float, ...]
) -> bool:
    """Give a pair's friction to one of its geoms, with priority, if it can meet no other geom."""
    weld = model.body_weldid[model.geom_bodyid]
    meets = (model.geom_contype[geom] & model.geom_conaffinity) | (
        model.geom_contype & model.geom_conaffinity[geom]
    )
    partners = np.flatnonzero((meets != 0) & (weld != weld[geom]))
    # The rest of what MuJoCo reads of the geom with priority has to be what both mean.
    alike = all(
        np.array_equal(array[geom], array[other])
        for array in (model.geom_solref, model.geom_solimp)
    )
    if list(partners) != [other] or not alike or model.npair:
        return False
    values = np.atleast_1d(friction)
    merged = np.maximum(model.geom_friction[geom], model.geom_friction[other])
    merged[: len(values)] = values
    model.geom_friction[geom] = merged
    model.geom_condim[geom] = max(model.geom_condim[geom], model.geom_condim[other])
    model.geom_priority[geom] = model.geom_priority.max() + 1
    return True


def find_setting(setting: str | Setting) -> str | Setting:
    """Return the setting of a name ("dashpot" stays a name); ValueError names near matches."""
    if isinstance(setting, Setting) or setting == DASHPOT:
        return setting
    if setting in SETTINGS:
        return SETTINGS[setting]
    if not isinstance(setting, str):
        raise TypeError(f"a setting is {setting!r}; it must be a name or a Setting")
    names = (DASHPOT, *SETTINGS)
    near = difflib.get_close_matches(setting, names, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise ValueError(f"setting {setting!r} is none of {', '.join(names)}{hint}")
