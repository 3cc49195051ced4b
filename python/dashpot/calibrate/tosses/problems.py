"""Calibration problems of cube tosses, in dashpot and in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.parameters import Parameter
from dashpot.calibrate.problem import Builder, Problem, StartStates
from dashpot.calibrate.setters import System
from dashpot.calibrate.tosses.cube import Cube
from dashpot.calibrate.tosses.flight import Toss, trajectory, velocity_per_offset
from dashpot.calibrate.trajectory import Trajectory
from dashpot.engine import Engine
from dashpot.materials import Material

Array = NDArray[np.float64]

# Standard deviations that weigh position against rotation: model error, not measurement noise, is
# what the fit leaves; 5 % of the width and 5 degrees are the size of it.
POSITION_SIGMA = 0.005
ROTATION_SIGMA = np.deg2rad(5.0)


def dashpot_problem(
    trajectories: Iterable[Trajectory], cube: Cube, *, substeps: int = 4
) -> Problem:
    """Return the problem of stiffness, damping ratio and sliding friction in dashpot."""
    engine = _engine(cube)
    return _problem(engine, _contact_parameters(cube.geoms), trajectories, substeps)


def mujoco_problem(trajectories: Iterable[Trajectory], cube: Cube, *, substeps: int = 4) -> Problem:
    """Return the same problem in MuJoCo: time constant, damping ratio and friction."""
    parameters = _peer_parameters((*cube.geoms, "table"))
    return _problem(cube.model(), parameters, trajectories, substeps)


def body_problem(
    tosses: Sequence[Toss],
    cube: Cube,
    *,
    peer: bool = False,
    length_scale: float = 1.0,
    substeps: int = 4,
) -> Problem:
    """Return the problem with body properties unknown too, in dashpot or (``peer``) in MuJoCo.

    Beside the contact parameters: inertia, corner radius and the three components of the centre of
    mass. The initial velocity follows the centre of mass (see `velocity_per_offset`).
    """
    trajectories = tuple(trajectory(toss, cube, length_scale=length_scale) for toss in tosses)
    effects = np.stack(
        [velocity_per_offset(toss, cube, length_scale=length_scale) for toss in tosses]
    )
    qpos = np.stack([np.asarray(t.initial_qpos) for t in trajectories])
    qvel = np.stack([np.asarray(t.initial_qvel) for t in trajectories])
    offsets = ("offset_x", "offset_y", "offset_z")
    rounded = replace(cube, corner_radius=0.003)
    contact = (
        _peer_parameters((*rounded.geoms, "table")) if peer else _contact_parameters(rounded.geoms)
    )

    def build(values: Mapping[str, float]) -> System:
        offset = (values["offset_x"], values["offset_y"], values["offset_z"])
        shaped = replace(
            rounded,
            inertia=values["inertia"],
            corner_radius=values["corner_radius"],
            offset=offset,
        )
        return shaped.model() if peer else _engine(shaped)

    def start_states(values: Mapping[str, float]) -> tuple[Array, Array]:
        velocity = qvel.copy()
        velocity[:, :3] += effects @ np.array([values[name] for name in offsets])
        return qpos, velocity

    body = (
        Parameter("inertia", start=cube.inertia, bounds=(4e-4, 2e-3)),
        Parameter("corner_radius", start=0.003, bounds=(2e-4, 0.012), transform="linear"),
        *(
            Parameter(name, start=0.0, bounds=(-0.012, 0.012), transform="linear")
            for name in offsets
        ),
    )
    return _problem(build, (*contact, *body), trajectories, substeps, start_states)


def _engine(cube: Cube) -> Engine:
    engine = Engine(cube.model())
    for geom in cube.geoms:
        engine.set_material(geom, Material(2e4, damping_ratio=0.5, friction=0.2))
    engine.set_material("table", Material(friction=0.0))
    return engine


def _contact_parameters(geoms: tuple[str, ...]) -> tuple[Parameter, ...]:
    return (
        Parameter.material(geoms, "stiffness", start=2e4, bounds=(1e3, 1e6)),
        Parameter.material(geoms, "damping_ratio", start=0.5, bounds=(0.05, 5.0)),
        Parameter.material(geoms, "sliding_friction", start=0.3, bounds=(0.03, 1.0)),
    )


def _peer_parameters(geoms: tuple[str, ...]) -> tuple[Parameter, ...]:
    return tuple(
        Parameter.model(attribute, geoms, index=index, start=start, bounds=bounds, name=name)
        for name, attribute, index, start, bounds in (
            ("timeconst", "geom_solref", 0, 0.02, (0.004, 0.2)),
            ("dampratio", "geom_solref", 1, 0.7, (0.05, 5.0)),
            ("friction", "geom_friction", 0, 0.3, (0.03, 1.0)),
        )
    )


def _problem(
    system: System | Builder,
    parameters: Sequence[Parameter],
    trajectories: Iterable[Trajectory],
    substeps: int,
    start_states: StartStates | None = None,
) -> Problem:
    return Problem(
        system,
        parameters,
        tuple(trajectories),
        POSITION_SIGMA,
        ROTATION_SIGMA,
        substeps=substeps,
        start_states=start_states,
    )
