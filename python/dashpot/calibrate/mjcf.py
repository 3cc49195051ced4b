"""Fitted models as MJCF."""

from __future__ import annotations

import ctypes
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import mujoco
import numpy as np

from dashpot.calibrate.problem.inertia_setter import InertiaSetter
from dashpot.calibrate.problem.parameters import Parameter
from dashpot.calibrate.problem.sensing import SensingSetter
from dashpot.calibrate.problem.setters import MaterialSetter, ModelSetter, PairSetter, model_of
from dashpot.calibrate.problem.systems import put_in
from dashpot.calibrate.problem.vectors import Joint
from dashpot.calibrate.result import Fit
from dashpot.calibrate.saved import SavedProblem, acting_parameters, setup_of
from dashpot.calibrate.solref_pairs import add_pairs
from dashpot.engine import Engine
from dashpot.mjcf_materials import PREFIX, numerics_of

Scene: TypeAlias = "str | os.PathLike[str] | mujoco.MjSpec"

# Digits that tell a double from its neighbours, and those that MuJoCo writes by itself.
_ALL_DIGITS = 17
# Numbers of a scene and of the model that differ by less are the same.
_ROUNDED = 1e-5


@dataclass(frozen=True)
class WrittenModel:
    """A fitted model in a file.

    Attributes
    ----------
    path
        Of the file.
    notes
        What is in it, what has to be given beside, and what MuJoCo makes of it; a sentence each.
    """

    path: Path
    notes: tuple[str, ...]

    def __str__(self) -> str:
        """Return the notes, a line each."""
        return "\n".join([f"{self.path}:", *(f"  {note}" for note in self.notes)])


def write_mjcf(
    fit: Fit,
    path: str | os.PathLike[str],
    scene: Scene | None,
    materials: str,
    trajectory: str | None,
) -> WrittenModel:
    """Write what `Fit.write_mjcf` does."""
    if materials not in ("numeric", "solref"):
        raise ValueError(f"materials must be 'numeric' or 'solref', got {materials!r}")
    acting = acting_parameters(fit, trajectory)
    sensing = [p.name for p in acting if isinstance(p.apply, SensingSetter)]
    parameters = [p for p in acting if p.name not in sensing]
    _check_setters(parameters)
    setup = setup_of(fit)
    file = Path(path)
    spec = _specification(fit, scene, file.parent)
    model = spec.compile()
    of_model = [p for p in parameters if isinstance(p.apply, ModelSetter | Joint)]
    live = not isinstance(fit.problem, SavedProblem)
    fitted = model_of(fit.problem.build(fit.values, trajectory)) if live else model
    _check_names(model, fitted)
    put_in(model, of_model, fit.values)
    _check_numbers(model, fitted)
    try:
        spec.copy_back(model)
    except ValueError as error:
        names = ", ".join(p.name for p in of_model)
        raise ValueError(f"the MJCF cannot say the values of {names}: {error}") from error
    notes = []
    if of_model:
        notes.append(f"In the model itself: {_listed(p.name for p in of_model)}.")
    if sensing:
        notes.append(f"Not in it, as recorders have them: {_listed(sensing)}.")
    if setup.options is not None:
        engine = setup.engine(model)
        put_in(engine, parameters, fit.values)
        notes += _write_materials(spec, engine, parameters)
        options = setup.options.changed()
        if options:
            given = ", ".join(f"{name}={value!r}" for name, value in options.items())
            notes.append(f"Not in it: options of the engine. Make it with Engine(model, {given}).")
        if materials == "solref":
            notes += add_pairs(spec, engine)
    elif materials == "solref":
        raise ValueError("the fit is one of MuJoCo's stepping: its solref are its own already")
    steps = sorted({round(step, 12) for step in setup.timesteps})
    if steps and not np.allclose(steps, model.opt.timestep, rtol=1e-6):
        shown = ", ".join(f"{1e3 * step:.6g}" for step in steps)
        notes.append(
            f"Fitted with time steps of {shown} ms; that of the file is "
            f"{1e3 * model.opt.timestep:.6g} ms, as of the scene."
        )
    with _digits(_ALL_DIGITS) as exact:
        text = spec.to_xml()
    if not exact:
        notes.append("Numbers have the six digits that MuJoCo writes.")
    file.write_text(text, encoding="utf-8")
    return WrittenModel(file, tuple(notes))


def _check_setters(parameters: Sequence[Parameter]) -> None:
    """Raise ValueError naming the parameters that no MJCF can hold."""
    known = (MaterialSetter, PairSetter, ModelSetter, InertiaSetter)
    foreign = [
        p.name
        for p in parameters
        if not isinstance(p.apply.function if isinstance(p.apply, Joint) else p.apply, known)
    ]
    if foreign:
        raise ValueError(
            f"an MJCF cannot hold {_listed(foreign)}: only what Parameter.material, pair, model "
            "and inertia make stands for something in it"
        )


def _specification(fit: Fit, scene: Scene | None, folder: Path) -> mujoco.MjSpec:
    """Return the specification of a scene, whose assets are found from `folder`."""
    if isinstance(scene, mujoco.MjSpec):
        return scene.copy()
    if scene is None:
        return _last_specification(fit)
    if isinstance(scene, str) and scene.lstrip().startswith("<"):
        return mujoco.MjSpec.from_string(scene)
    file = Path(scene)
    if not file.is_file():
        raise FileNotFoundError(f"no scene file {file}")
    if file.suffix == ".mjb":
        raise ValueError(f"{file} is compiled; give the MJCF or URDF that it was compiled from")
    spec = mujoco.MjSpec.from_file(str(file))
    if file.parent.resolve() != folder.resolve():
        for name in ("meshdir", "texturedir"):
            own = getattr(spec, name)
            setattr(spec, name, os.path.relpath(file.parent.resolve() / own, folder.resolve()))
    return spec


def _last_specification(fit: Fit) -> mujoco.MjSpec:
    """Return the specification of what MuJoCo compiled last, which has to be the fitted model."""
    remedy = "say what the model was compiled from, as scene='scene.xml'"
    if isinstance(fit.problem, SavedProblem):
        raise ValueError(f"the fit was loaded without its model; {remedy}")
    model = model_of(fit.problem.build(fit.problem.start))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "last.xml"
        try:
            with _digits(_ALL_DIGITS):
                mujoco.mj_saveLastXML(str(file), model)
            return mujoco.MjSpec.from_string(file.read_text(encoding="utf-8"))
        except (ValueError, mujoco.FatalError) as error:
            said = " ".join(str(error).split())
            raise ValueError(
                f"the model is not what MuJoCo compiled last from MJCF ({said}); {remedy}"
            ) from error


def _check_names(model: mujoco.MjModel, fitted: mujoco.MjModel) -> None:
    """Raise ValueError where a scene has other elements than the fitted model."""
    for kind, count in _COUNT.items():
        own, theirs = (
            [getattr(each, kind)(i).name for i in range(getattr(each, count))]
            for each in (model, fitted)
        )
        if own != theirs:
            said = f"are {_listed(own)}, not {_listed(theirs)}"
            raise ValueError(f"the scene is not the fitted model: its {kind}s {said}")


def _check_numbers(model: mujoco.MjModel, fitted: mujoco.MjModel) -> None:
    """Raise ValueError where a scene, fitted values put in, has other numbers than the model."""
    pairs = [(name, getattr(model, name), getattr(fitted, name)) for name in _ARRAYS]
    for name in ("gravity", "wind", "density", "viscosity"):
        pairs.append((f"opt.{name}", getattr(model.opt, name), getattr(fitted.opt, name)))
    for name, own, theirs in pairs:
        same = np.shape(own) == np.shape(theirs)
        if not same or not np.allclose(own, theirs, rtol=_ROUNDED, atol=1e-12):
            raise ValueError(
                f"the scene is not the fitted model: {name} differs. Edits of a model after it was "
                "compiled are not in the scene; edit the scene, or its MjSpec"
            )


_COUNT = {
    "body": "nbody",
    "geom": "ngeom",
    "joint": "njnt",
    "site": "nsite",
    "actuator": "nu",
    "tendon": "ntendon",
    "sensor": "nsensor",
}
_ARRAYS = (
    "body_pos",
    "body_quat",
    "body_mass",
    "body_inertia",
    "body_ipos",
    "body_iquat",
    "geom_pos",
    "geom_quat",
    "geom_size",
    "geom_friction",
    "geom_solref",
    "geom_solimp",
    "geom_margin",
    "geom_gap",
    "dof_damping",
    "dof_frictionloss",
    "dof_armature",
    "jnt_pos",
    "jnt_axis",
    "jnt_range",
    "jnt_stiffness",
    "qpos0",
    "qpos_spring",
    "actuator_gainprm",
    "actuator_biasprm",
    "actuator_gear",
    "site_pos",
)


def _write_materials(
    spec: mujoco.MjSpec, engine: Engine, parameters: Sequence[Parameter]
) -> list[str]:
    """Put materials into a specification, in place of those that it has; return notes."""
    for numeric in list(spec.numerics):
        if numeric.name.startswith(PREFIX):
            spec.delete(numeric)
    materials, pairs = engine.materials, engine.pair_materials
    for name, data in numerics_of(engine.model, materials, pairs).items():
        spec.add_numeric(name=name, size=len(data), data=data)
    fitted = [p.name for p in parameters if isinstance(p.apply, MaterialSetter | PairSetter)]
    if not (materials or pairs):
        return []
    count = len(materials) + len(pairs)
    return [
        f"As custom numerics, which dashpot.Engine reads and MuJoCo ignores: "
        f"{count} material{'s' * (count > 1)}"
        + (f", with {_listed(fitted)} fitted." if fitted else ".")
    ]


@contextmanager
def _digits(count: int) -> Iterator[bool]:
    """Have MuJoCo write so many digits of each number within the block; yield whether it does."""
    try:
        library = ctypes.CDLL(f"libmujoco.so.{mujoco.mj_versionString()}")  # it is loaded
        get, put = library._mjPRIVATE__get_xml_precision, library._mjPRIVATE__set_xml_precision
    except (AttributeError, OSError):
        yield False
        return
    before = int(get())
    put(count)
    try:
        yield True
    finally:
        put(before)


def _listed(names: object) -> str:
    found = [str(name) for name in names]  # type: ignore[attr-defined]
    return ", ".join(found[:8]) + (f" and {len(found) - 8} more" if len(found) > 8 else "")
