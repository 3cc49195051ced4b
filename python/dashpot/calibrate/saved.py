"""Fits in files: plain JSON, with all that reports, tables and draws need, but not the model."""

from __future__ import annotations

import copy
import dataclasses
import json
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import mujoco

from dashpot.calibrate.problem.parameters import Parameter
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.sensing import SensingSetter
from dashpot.calibrate.problem.setters import System
from dashpot.calibrate.problem.systems import put_in
from dashpot.calibrate.problem.vectors import Joint
from dashpot.calibrate.report.record import Record
from dashpot.calibrate.result import Fit
from dashpot.checks import existing_file
from dashpot.engine import Engine
from dashpot.engine_options import EngineOptions
from dashpot.materials import Material
from dashpot.object_ids import Element
from dashpot.plain import decoded, decoded_fields, encoded

_FORMAT = "dashpot fit"
_VERSION = 1
_MOST_BYTES = 400_000_000
# Fields of a fit that stand elsewhere in a file, or not at all.
_NOT_HELD = ("problem", "_record")


@dataclass(frozen=True)
class Function:
    """Stands for a function of the user's that set a parameter, which no file holds."""

    name: str

    def __call__(self, system: System, value: float) -> NoReturn:
        """Raise ValueError: nobody knows what it does."""
        raise ValueError(
            f"it is set by the function {self.name!r}, which a file cannot hold; give the problem "
            "to Fit.load"
        )


@dataclass(frozen=True)
class Setup:
    """How the system of a fit steps, apart from its model, before parameters are put in.

    Attributes
    ----------
    stepper
        ``"dashpot"`` or ``"MuJoCo"``.
    options
        Of the engine; None with MuJoCo.
    materials
        Geoms by name, or id where they have none, and their materials.
    pair_materials
        The same of pairs.
    timesteps
        s, of the trajectories in order.
    """

    stepper: str
    options: EngineOptions | None
    materials: tuple[tuple[Element, Material], ...]
    pair_materials: tuple[tuple[Element, Element, Material], ...]
    timesteps: tuple[float, ...]

    def engine(self, model: mujoco.MjModel, *, nthread: int = 1) -> Engine:
        """Return an engine of a model that steps so; ValueError where MuJoCo stepped."""
        if self.options is None:
            raise ValueError(
                "the fit is one of MuJoCo's stepping; its values are none of dashpot's"
            )
        options = {f.name: getattr(self.options, f.name) for f in dataclasses.fields(self.options)}
        engine = Engine(model, **options, nthread=nthread)
        for geom in engine.materials:
            engine.set_material(geom, None)
        for pair in engine.pair_materials:
            engine.set_pair_material(*pair, None)
        engine.set_materials(dict(self.materials))
        for first, second, material in self.pair_materials:
            engine.set_pair_material(first, second, material)
        return engine


@dataclass(frozen=True)
class SavedTrajectory:
    """What a file knows of a trajectory beside its record."""

    name: str
    frames: int
    bodies: tuple[str, ...]
    sensors: tuple[str, ...]


class SavedProblem:
    """What a file knows of the problem: parameters, trajectories' names, how the system steps.

    Anything else of a `Problem` is refused by name.
    """

    def __init__(
        self,
        parameters: tuple[Parameter, ...],
        trajectories: tuple[SavedTrajectory, ...],
        setup: Setup,
        file: str,
    ) -> None:
        self.parameters = parameters
        self.trajectories = trajectories
        self.setup = setup
        self.file = file

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters in order, frozen ones included."""
        return tuple(p.name for p in self.parameters)

    @property
    def unknowns(self) -> tuple[Parameter, ...]:
        """The parameters that were fitted, in order."""
        return tuple(p for p in self.parameters if not p.frozen)

    @property
    def held(self) -> dict[str, float]:
        """Values of frozen parameters by name."""
        return {p.name: p.start for p in self.parameters if p.frozen}

    def __getattr__(self, name: str) -> NoReturn:
        if name.startswith("__") or "file" not in self.__dict__:
            raise AttributeError(name)
        raise AttributeError(
            f"the fit was loaded from {self.file}, which holds no problem: {name!r} of it needs "
            "the model and the trajectories. Give the problem to Fit.load"
        )

    def __repr__(self) -> str:
        """Return the names of the parameters."""
        return f"SavedProblem({', '.join(self.names)})"


def setup_of(fit: Fit) -> Setup:
    """Return how the system of a fit steps."""
    problem = fit.problem
    if isinstance(problem, SavedProblem):
        return problem.setup
    system = problem.bare_system(fit.values)
    if isinstance(system, mujoco.MjModel):
        return Setup("MuJoCo", None, (), (), _timesteps(problem, system))
    model = system.model

    def name(geom: int) -> Element:
        return str(model.geom(geom).name) or geom

    return Setup(
        "dashpot",
        system._options,
        tuple((name(geom), material) for geom, material in system.materials.items()),
        tuple((name(a), name(b), material) for (a, b), material in system.pair_materials.items()),
        _timesteps(problem, model),
    )


def acting_parameters(fit: Fit, trajectory: str | None) -> list[Parameter]:
    """Return the parameters that act in the system of a trajectory.

    Raises
    ------
    ValueError
        Where none is named and trajectories differ, naming the parameter and the trajectories; or
        there is none of that name.
    """
    parameters = fit.problem.parameters
    names = [t.name for t in fit.problem.trajectories]
    if trajectory is not None and trajectory not in names:
        raise ValueError(f"no trajectory is named {trajectory!r}; there are {', '.join(names)}")
    if trajectory is None:
        own = [p for p in parameters if p.trajectories is not None]
        differs = [p.base or p.name for p in own if not isinstance(p.apply, SensingSetter)]
        if differs:
            raise ValueError(
                f"'{differs[0]}' has a value for each of several trajectories; say of which: "
                f"trajectory={names[0]!r}, or another of {', '.join(names)}"
            )
        trajectory = names[0]
    return [p for p in parameters if p.acts_in(trajectory)]


def apply_fit(
    fit: Fit, model: mujoco.MjModel, *, trajectory: str | None = None, nthread: int = 1
) -> Engine:
    """Return an engine of a model with the options, materials and values of a fit put in.

    Parameters
    ----------
    fit, model
        Of which, and what to step.
    trajectory
        Whose values count, where parameters have one for each.
    nthread
        Of the engine.

    Raises
    ------
    ValueError
        Naming what the model has not, the parameter that a file cannot hold, or that the fit is
        one of MuJoCo's stepping.
    """
    parameters = acting_parameters(fit, trajectory)
    untold = [p.name for p in parameters if p.apply is None]
    if untold:
        raise ValueError(
            f"parameter '{untold[0]}' acts in a function that builds the model, which the scene "
            "does not have"
        )
    engine = setup_of(fit).engine(model, nthread=nthread)
    put_in(engine, parameters, fit.values)
    return engine


def save(fit: Fit, path: str | os.PathLike[str]) -> Path:
    """Write what `Fit.save` does."""
    parameters = []
    for p in fit.problem.parameters:
        joint = isinstance(p.apply, Joint)
        setter: Any = p.apply.function if isinstance(p.apply, Joint) else p.apply
        if setter is not None and type(setter).__name__ not in _setters():
            setter = Function(str(getattr(setter, "__qualname__", type(setter).__name__)))
        p = dataclasses.replace(p, apply=Joint(setter) if joint else setter)
        parameters.append(encoded(p))
    content = {
        "format": _FORMAT,
        "version": _VERSION,
        "fit": {
            f.name: encoded(getattr(fit, f.name))
            for f in dataclasses.fields(fit)
            if f.name not in _NOT_HELD
        },
        "parameters": parameters,
        "trajectories": encoded(_trajectories(fit)),
        "setup": encoded(setup_of(fit)),
        "record": encoded(fit.record()),
    }
    file = Path(path)
    text = json.dumps(content, allow_nan=False, separators=(",", ":"))
    file.write_text(text + "\n", encoding="utf-8")
    return file


def load(path: str | os.PathLike[str], problem: Problem | None) -> Fit:
    """Read what `Fit.load` does."""
    if not isinstance(problem, Problem | None):
        raise TypeError(f"problem is {type(problem).__name__}; it must be a calibrate.Problem")
    file = existing_file("saved fit", path)
    if file.stat().st_size > _MOST_BYTES:
        raise ValueError(f"{file} is larger than a fit can be, {_MOST_BYTES} bytes")
    try:
        content = json.loads(file.read_text(encoding="utf-8"), parse_constant=_no_constant)
        return _read(content, file, problem)
    except RecursionError:
        raise ValueError(f"{file}: it is nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error
    except TypeError as error:
        raise ValueError(f"{file}: it says what no fit does ({error})") from error


def _read(content: Any, file: Path, problem: Problem | None) -> Fit:
    if not isinstance(content, dict) or content.get("format") != _FORMAT:
        raise ValueError("it is no fit that dashpot saved")
    if content.get("version") != _VERSION:
        raise ValueError(f"its version is {content.get('version')!r}, not {_VERSION}")
    sections = ("fit", "parameters", "trajectories", "setup", "record")
    for name in sections:
        if name not in content:
            raise ValueError(f"{name} is missing")
    known = _setters()
    parameters = decoded(tuple[Parameter, ...], content["parameters"], "parameters", known)
    trajectories = decoded(tuple[SavedTrajectory, ...], content["trajectories"], "trajectories")
    if not trajectories:
        raise ValueError("trajectories are none")
    setup = decoded(Setup, content["setup"], "setup")
    record = decoded(Record, content["record"], "record")
    fields = decoded_fields(
        Fit, content["fit"], "fit", left_out=_NOT_HELD, names={"Record": Record}
    )
    held: Any = problem
    if problem is None:
        held = SavedProblem(parameters, trajectories, setup, file.name)
    names = tuple(p.name for p in parameters)
    unknowns = tuple(p for p in parameters if not p.frozen)
    fitted = tuple(p.name for p in unknowns)
    for label, own, those in (
        ("estimates", tuple(e.name for e in fields["estimates"]), fitted),
        ("problem", held.names, names),
        ("the problem's unknowns", tuple(p.name for p in held.unknowns), fitted),
    ):
        if own != those:
            raise ValueError(f"the parameters are {those}, those of {label} are {own}")
    for parameter, estimate in zip(unknowns, fields["estimates"], strict=True):
        if not parameter.bounds[0] <= estimate.value <= parameter.bounds[1]:
            raise ValueError(
                f"the estimate of '{estimate.name}' is {estimate.value:g}, beyond its bounds "
                f"{parameter.bounds}"
            )
    size = len(fitted)
    shape = fields["correlation"].shape
    if shape != (size, size):
        raise ValueError(f"fit.correlation is of shape {shape}, not {(size, size)}")
    return Fit(**fields, problem=held, _record=record)


def _trajectories(fit: Fit) -> tuple[SavedTrajectory, ...]:
    if isinstance(fit.problem, SavedProblem):
        return fit.problem.trajectories
    return tuple(
        SavedTrajectory(t.name, t.frames, t.bodies, tuple(t.sensors))
        for t in fit.problem.trajectories
    )


def _setters() -> Mapping[str, type]:
    """Return the dataclasses of the package, by name, that may set a parameter."""
    found: dict[str, type] = {"Function": Function}
    for name, module in copy.copy(sys.modules).items():
        if name.startswith("dashpot.calibrate.problem."):
            found |= {
                label: own
                for label, own in vars(module).items()
                if isinstance(own, type) and hasattr(own, "__dataclass_fields__")
            }
    return found


def _timesteps(problem: Problem, model: mujoco.MjModel) -> tuple[float, ...]:
    return tuple(t.spacing / problem.steps_per_frame(t, model) for t in problem.trajectories)


def _no_constant(word: str) -> NoReturn:
    raise ValueError(f"{word} is no JSON")
