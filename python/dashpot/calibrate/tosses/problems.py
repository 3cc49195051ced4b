"""Calibration problems of cube tosses, in dashpot and in MuJoCo."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.parameters import Parameter
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.setters import System
from dashpot.calibrate.tosses.cube import Cube
from dashpot.calibrate.tosses.flight import (
    LENGTH_SCALE,
    Toss,
    centre_of_mass,
    fit_flight,
    trajectory,
)
from dashpot.data.cube_tosses import GRAVITY
from dashpot.engine import Engine
from dashpot.materials import Material

Array = NDArray[np.float64]

# Standard deviations that weigh position against rotation: model error, not measurement noise, is
# what the fit leaves; 5 % of the width and 5 degrees are the size of it.
POSITION_SIGMA = 0.005
ROTATION_SIGMA = np.deg2rad(5.0)

# Where the search starts a corner radius, m.
_CORNER_RADIUS = 0.003

# N, between the 1 N on a corner at rest and the 100 N of an impact; only the friction at either end
# is identified, not how it goes from one to the other.
FRICTION_LOAD = 10.0


def toss_problem(
    tosses: Sequence[Toss],
    cube: Cube,
    *,
    peer: bool = False,
    body: bool = False,
    load: bool = False,
    length_scale: float = LENGTH_SCALE,
    substeps: int = 4,
) -> Problem:
    """Return the problem of contact parameters, in dashpot or (``peer``) in MuJoCo.

    Unknown are stiffness, damping ratio and sliding friction in dashpot, time constant, damping
    ratio and friction in MuJoCo. With ``body`` also inertia and corner radius, with ``load`` also
    how friction falls with load. The centre of mass is that of `cube` (see `weighed`), and start
    states follow from it and the flights.

    Parameters
    ----------
    tosses
        At least one.
    cube
        Body properties that are not searched for; where inertia and corner radius start.
    peer
        Simulate with ``mj_step``.
    body
        Inertia and corner radius are unknown too.
    load
        Friction falls with load: ``loaded_friction`` of the material is unknown too, at a
        ``friction_load`` of 10 N.
    length_scale
        As in `fit_flight`.
    substeps
        Simulation steps per frame.

    Raises
    ------
    ValueError
        With ``peer`` and ``load``: MuJoCo's friction does not depend on load.

    Examples
    --------
    >>> from dashpot.calibrate import tosses as study
    >>> problem = study.toss_problem(tosses[:3], study.Cube())
    >>> problem.names
    ('stiffness', 'damping_ratio', 'sliding_friction')
    """
    if peer and load:
        raise ValueError("load=True needs peer=False: MuJoCo's friction does not depend on load")
    flights = [fit_flight(toss, cube, length_scale=length_scale) for toss in tosses]
    trajectories = tuple(
        trajectory(toss, flight, cube, length_scale=length_scale)
        for toss, flight in zip(tosses, flights, strict=True)
    )
    if peer:
        # With semi-implicit steps of h, flight is a parabola of a velocity g h / 2 less.
        lead = 0.5 * GRAVITY * (tosses[0].time[1] - tosses[0].time[0]) / substeps
        trajectories = tuple(
            replace(t, initial_qvel=np.asarray(t.initial_qvel) + lead * np.eye(6)[2])
            for t in trajectories
        )
    start = replace(cube, corner_radius=cube.corner_radius or _CORNER_RADIUS) if body else cube

    def build(values: Mapping[str, float]) -> System:
        shaped = replace(
            start,
            inertia=values.get("inertia", start.inertia),
            corner_radius=values.get("corner_radius", start.corner_radius),
        )
        return shaped.model() if peer else _engine(shaped)

    contact = _peer_parameters(start.geoms) if peer else _contact_parameters(start.geoms)
    return Problem(
        build,
        (
            *contact,
            *(_load_parameters(start.geoms) if load else ()),
            *(_body_parameters(start) if body else ()),
        ),
        trajectories,
        POSITION_SIGMA,
        ROTATION_SIGMA,
        substeps=substeps,
    )


def weighed(tosses: Sequence[Toss], cube: Cube, *, length_scale: float = LENGTH_SCALE) -> Cube:
    """Return `cube` with the centre of mass that the flights of `tosses` show.

    Examples
    --------
    >>> from dashpot.calibrate import tosses as study
    >>> len(study.weighed(tosses[:20], study.Cube()).offset)
    3
    """
    flights = (fit_flight(toss, cube, length_scale=length_scale) for toss in tosses)
    x, y, z = centre_of_mass(flights)[0]
    return replace(cube, offset=(float(x), float(y), float(z)))


def _engine(cube: Cube) -> Engine:
    engine = Engine(cube.model())
    material = Material(2e4, damping_ratio=0.5, friction=0.2, friction_load=FRICTION_LOAD)
    engine.set_materials({**dict.fromkeys(cube.geoms, material), "table": Material(friction=0.0)})
    return engine


def _contact_parameters(geoms: tuple[str, ...]) -> tuple[Parameter, ...]:
    return (
        Parameter.material(geoms, "stiffness", start=5e4, bounds=(3e3, 1e6)),
        Parameter.material(geoms, "damping_ratio", start=0.7, bounds=(0.15, 3.0)),
        Parameter.material(geoms, "sliding_friction", start=0.2, bounds=(0.1, 0.4)),
    )


def _load_parameters(geoms: tuple[str, ...]) -> tuple[Parameter, ...]:
    return (Parameter.material(geoms, "loaded_friction", start=0.8, bounds=(0.4, 1.0)),)


def _peer_parameters(geoms: tuple[str, ...]) -> tuple[Parameter, ...]:
    return tuple(
        Parameter.model(
            attribute, (*geoms, "table"), index=index, start=start, bounds=bounds, name=name
        )
        for name, attribute, index, start, bounds in (
            ("timeconst", "geom_solref", 0, 0.015, (0.0034, 0.06)),
            ("dampratio", "geom_solref", 1, 0.7, (0.15, 3.0)),
            ("friction", "geom_friction", 0, 0.2, (0.1, 0.4)),
        )
    )


def _body_parameters(cube: Cube) -> tuple[Parameter, ...]:
    return (
        Parameter("inertia", start=cube.inertia, bounds=(5e-4, 1.6e-3)),
        Parameter(
            "corner_radius", start=cube.corner_radius, bounds=(2e-4, 0.01), transform="linear"
        ),
    )
