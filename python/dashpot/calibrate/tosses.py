"""Calibration on real cube tosses (ContactNets), dashpot and MuJoCo tuned the same way.

A toss is simulated from the last frame before the centre of the cube is below half width times
sqrt(3), the first height at which a corner could touch; its velocity there is fitted to the flight
before. Prediction errors are time means over all later frames: distance between the centres in
percent of the cube's width, and angle between the orientations in degrees.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.fit import Method, fit
from dashpot.calibrate.objective import Objective
from dashpot.calibrate.parameters import Parameter
from dashpot.calibrate.problem import Builder, Problem, StartStates
from dashpot.calibrate.result import Fit
from dashpot.calibrate.setters import System
from dashpot.calibrate.trajectory import Trajectory
from dashpot.engine import Engine
from dashpot.materials import Material

Array = NDArray[np.float64]

BODY = "cube"
# Standard deviations that weigh position against rotation: model error, not measurement noise, is
# what the fit leaves; 5 % of the width and 5 degrees are the size of it.
POSITION_SIGMA = 0.005
ROTATION_SIGMA = np.deg2rad(5.0)
# Corners of an ideal sharp cube; a corner radius replaces the box by spheres at its corners.
_SIGNS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]


class Toss(Protocol):
    """One toss as `dashpot.data.load_cube_tosses` returns it."""

    @property
    def name(self) -> str:
        """Name of the toss."""

    @property
    def time(self) -> Array:
        """(n,) s."""

    @property
    def position(self) -> Array:
        """(n, 3) centre in the world, m."""

    @property
    def quaternion(self) -> Array:
        """(n, 4) body to world, scalar first."""


@dataclass(frozen=True)
class Cube:
    """Body properties of the cube.

    Attributes
    ----------
    half_width
        m.
    mass
        kg.
    inertia
        About every axis through the centre of mass, kg m^2.
    corner_radius
        m, >= 0; 0: a box with sharp corners; else spheres of this radius in its corners.
    offset
        Centre of mass in the body frame, m.
    """

    half_width: float = 0.0524
    mass: float = 0.37
    inertia: float = 0.00081
    corner_radius: float = 0.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def model(self, *, timestep: float = 1.0 / 592.0) -> mujoco.MjModel:
        """Return the cube over a table at z = 0, elliptic friction cones, frictional condim 3."""
        half, radius = self.half_width, self.corner_radius
        if radius == 0.0:
            geoms = f'<geom name="cube" type="box" size="{half} {half} {half}"/>'
        else:
            inner = half - radius
            geoms = "".join(
                f'<geom name="corner{i}" type="sphere" size="{radius}" '
                f'pos="{x * inner} {y * inner} {z * inner}"/>'
                for i, (x, y, z) in enumerate(_SIGNS)
            )
        offset = " ".join(str(component) for component in self.offset)
        return mujoco.MjModel.from_xml_string(
            f"""
            <mujoco>
              <option timestep="{timestep}" gravity="0 0 -9.81" cone="elliptic"/>
              <worldbody>
                <geom name="table" type="plane" size="2 2 0.1"/>
                <body name="{BODY}" pos="0 0 0.2">
                  <freejoint/>
                  <inertial pos="{offset}" mass="{self.mass}"
                            diaginertia="{self.inertia} {self.inertia} {self.inertia}"/>
                  {geoms}
                </body>
              </worldbody>
            </mujoco>
            """
        )

    @property
    def geoms(self) -> tuple[str, ...]:
        """Names of the cube's geoms."""
        if self.corner_radius == 0.0:
            return ("cube",)
        return tuple(f"corner{i}" for i in range(8))


def flight_state(
    time: Array, position: Array, quaternion: Array, gravity: float = 9.81
) -> tuple[Array, Array]:
    """Return velocity (3,) in the world and angular velocity (3,) in the body at the last frame.

    The velocity is the least-squares fit of a parabola with known gravity through all frames, the
    angular velocity the mean rate between first and last frame (constant for an isotropic inertia).

    Raises
    ------
    ValueError
        With fewer than two frames.
    """
    if len(time) < 2:
        raise ValueError("a velocity needs at least two frames of flight")
    t = time - time[-1]
    lifted = position + 0.5 * np.array([0.0, 0.0, gravity]) * t[:, None] ** 2
    design = np.stack([np.ones_like(t), t], axis=1)
    velocity = np.linalg.lstsq(design, lifted, rcond=None)[0][1]
    rate = np.zeros(3)
    turn = np.zeros(3)
    for before, after in itertools.pairwise(quaternion):
        mujoco.mju_subQuat(turn, after, before)
        rate += turn
    return velocity, rate / (time[-1] - time[0])


def trajectory(
    toss: Toss, cube: Cube, *, length_scale: float = 1.0, gravity: float = 9.81
) -> Trajectory:
    """Return the part of a toss that is simulated, with its initial state.

    Parameters
    ----------
    toss
        The toss.
    cube
        Its half width says where the simulated part begins.
    length_scale
        Factor on all lengths of the toss; 1.0215 makes the published lengths consistent with
        gravity.
    gravity
        m/s^2, for the parabola of the flight.

    Raises
    ------
    ValueError
        Naming the toss, where it never comes down or has no two frames of flight.
    """
    position = np.asarray(toss.position, dtype=float) * length_scale
    first = _last_free_frame(toss, position, cube)
    flight = slice(0, first + 1)
    velocity, rate = flight_state(
        toss.time[flight], position[flight], toss.quaternion[flight], gravity
    )
    return Trajectory(
        name=toss.name,
        time=toss.time[first:],
        position=position[first:],
        quaternion=toss.quaternion[first:],
        bodies=(BODY,),
        initial_qpos=np.concatenate([position[first], toss.quaternion[first]]),
        initial_qvel=np.concatenate([velocity, rate]),
    )


def velocity_per_offset(toss: Toss, cube: Cube, *, length_scale: float = 1.0) -> Array:
    """Return (3, 3): change of the centre's initial velocity with the centre of mass, 1/s.

    It is the centre of mass, at offset r in the body, that flies on a parabola: with rotations R_k
    of the flight and weights c_k of the least-squares slope, the velocity of the cube's centre is
    that of a centred mass plus ``(sum_k c_k R_k - R_last [w]x) r``.
    """
    position = np.asarray(toss.position, dtype=float) * length_scale
    first = _last_free_frame(toss, position, cube)
    flight = slice(0, first + 1)
    rate = flight_state(toss.time[flight], position[flight], toss.quaternion[flight])[1]
    t = toss.time[flight] - toss.time[first]
    weights = np.linalg.pinv(np.stack([np.ones_like(t), t], axis=1))[1]
    rotations = np.empty((first + 1, 9))
    for k in range(first + 1):
        mujoco.mju_quat2Mat(rotations[k], toss.quaternion[k])
    slope = (weights @ rotations).reshape(3, 3)
    cross = np.cross(np.eye(3), rate).T  # columns rate x e_i
    return np.asarray(slope + rotations[-1].reshape(3, 3) @ cross)


def _last_free_frame(toss: Toss, position: Array, cube: Cube) -> int:
    low = np.flatnonzero(position[:, 2] < cube.half_width * np.sqrt(3.0))
    if low.size == 0 or low[0] < 2:
        raise ValueError(f"'{toss.name}' has no two frames of flight before its first contact")
    return int(low[0]) - 1


@dataclass(frozen=True, eq=False)
class Errors:
    """Prediction errors of a set of tosses.

    Attributes
    ----------
    position
        (tosses,) time mean of the distance over the width, percent.
    rotation
        (tosses,) time mean of the angle, degrees.
    """

    position: Array
    rotation: Array

    @property
    def mean_position(self) -> float:
        """Mean over the tosses, percent of the width."""
        return float(self.position.mean())

    @property
    def mean_rotation(self) -> float:
        """Mean over the tosses, degrees."""
        return float(self.rotation.mean())


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


def evaluate(
    problem: Problem, values: Mapping[str, float], cube: Cube, *, nthread: int | None = None
) -> Errors:
    """Return the prediction errors of `values` on the tosses of a problem, fitted or unseen."""
    objective = Objective(problem, nthread=0 if nthread is None else nthread)
    point = np.array(
        [c.to_search(values[n]) for c, n in zip(objective.coordinates, problem.names, strict=True)]
    )
    residuals = objective.residuals(point)[0]
    count = len(problem.trajectories)
    position = np.empty(count)
    rotation = np.empty(count)
    for t in range(count):
        rows = residuals[objective.offsets[t] : objective.offsets[t + 1]].reshape(-1, 6)[1:]
        distance = np.linalg.norm(rows[:, :3], axis=1) * problem.position_sigma
        angle = np.linalg.norm(rows[:, 3:], axis=1) * problem.rotation_sigma
        position[t] = 100.0 * distance.mean() / (2.0 * cube.half_width)
        rotation[t] = np.rad2deg(angle.mean())
    return Errors(position, rotation)


@dataclass(frozen=True, eq=False)
class Study:
    """A fit on some tosses and its errors on the others."""

    fit: Fit
    seen: Errors
    unseen: Errors


def study(
    tosses: Sequence[Toss],
    *,
    peer: bool = False,
    body: bool = False,
    fitted: int = 60,
    cube: Cube | None = None,
    length_scale: float = 1.0,
    substeps: int = 4,
    seed: int = 0,
    method: Method = "least_squares",
    starts: int = 16,
    max_evaluations: int = 120,
    nthread: int | None = None,
    progress: bool = False,
) -> Study:
    """Fit on `fitted` tosses chosen by `seed`, evaluate on all others.

    Parameters
    ----------
    tosses
        As `dashpot.data.load_cube_tosses` returns them.
    peer
        Tune MuJoCo instead of dashpot, the same way.
    body
        Fit body properties too: inertia, centre of mass, corner radius.
    fitted
        Number of tosses to fit on, 1 <= fitted < len(tosses).
    cube
        Body properties; None: the published ones.
    length_scale
        As in `trajectory`.
    substeps
        Simulation steps per frame of 1/148 s.
    seed
        Chooses the tosses, and starts.
    method, starts, max_evaluations, nthread, progress
        As in `dashpot.calibrate.fit`.
    """
    if not 1 <= fitted < len(tosses):
        raise ValueError(f"fitted must be in [1, {len(tosses) - 1}], got {fitted!r}")
    shape = Cube() if cube is None else cube
    order = np.random.default_rng(seed).permutation(len(tosses))
    seen, unseen = (
        _study_problem(
            [tosses[i] for i in sorted(chosen)], shape, peer, body, length_scale, substeps
        )
        for chosen in (order[:fitted], order[fitted:])
    )
    result = fit(
        seen,
        method=method,
        loss="soft_l1",
        starts=starts,
        local_searches=1,
        max_evaluations=max_evaluations,
        errors="clustered",
        seed=seed,
        nthread=nthread,
        progress=progress,
    )
    return Study(
        result,
        evaluate(seen, result.values, shape, nthread=nthread),
        evaluate(unseen, result.values, shape, nthread=nthread),
    )


def _study_problem(
    tosses: Sequence[Toss],
    cube: Cube,
    peer: bool,
    body: bool,
    length_scale: float,
    substeps: int,
) -> Problem:
    if body:
        return body_problem(tosses, cube, peer=peer, length_scale=length_scale, substeps=substeps)
    trajectories = [trajectory(toss, cube, length_scale=length_scale) for toss in tosses]
    return (mujoco_problem if peer else dashpot_problem)(trajectories, cube, substeps=substeps)


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
