"""A calibration problem: what moves, what is unknown, what was observed and how well."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.noise import (
    deviation,
    deviation_by_name,
    deviations_by_name,
    position_deviations,
)
from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.groups import check_acting, single_parameters
from dashpot.calibrate.problem.inertia_setter import with_inertia
from dashpot.calibrate.problem.known_starts import start_sigma
from dashpot.calibrate.problem.observables import Sensor
from dashpot.calibrate.problem.own_residuals import ResidualFunction, own_residuals
from dashpot.calibrate.problem.parameters import Parameter
from dashpot.calibrate.problem.pixel_starts import out_of_sight
from dashpot.calibrate.problem.pixels import with_deviations_of_pixels
from dashpot.calibrate.problem.problem_checks import (
    check_against_model,
    check_options,
    check_sensing,
    observed_sensors,
)
from dashpot.calibrate.problem.problem_entries import (
    all_of,
    check_reach,
    check_targets,
    check_unique,
)
from dashpot.calibrate.problem.problem_fields import InitialState, Noise, StartStates
from dashpot.calibrate.problem.problem_starts import ProblemStarts
from dashpot.calibrate.problem.problem_systems import ProblemSystems
from dashpot.calibrate.problem.replaced_materials import check_nothing_is_lost
from dashpot.calibrate.problem.setters import System, model_of
from dashpot.calibrate.problem.systems import Builder
from dashpot.calibrate.problem.unseen_turns import turns_held
from dashpot.engine import Engine

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Problem(ProblemSystems, ProblemStarts):
    """Everything that defines a calibration.

    The simulation of a trajectory starts at its first frame without contact memory; frame k is
    reached after ``k * substeps`` steps of ``spacing / substeps``.

    Parameters
    ----------
    system
        A `dashpot.Engine`, or a `mujoco.MjModel`, which is then stepped with ``mj_step`` (to tune
        MuJoCo the same way). Or a function from the values of all parameters by name to either, for
        parameters that need the model to be compiled anew. It is never changed: every candidate
        works on a copy.
    parameters
        The unknowns, and what is frozen, with different names. Those with ``per`` are replaced by
        one for each trajectory or group, vectors by one for each of their numbers.
    trajectories
        The observations, with different names.
    position_sigma
        Standard deviation of an observed coordinate, m, > 0; or three, of x, y and z of the world.
        Infinite, the default: not measured, so that the trajectories' numbers there (any finite
        ones) do not count, nor give the initial state.
    rotation_sigma
        Standard deviation of an observed rotation about an axis, rad, > 0; infinite, the default:
        not measured (any unit quaternion will do).
    sensor_sigma
        Standard deviations of observed sensors by name, in the unit of the sensor, > 0: one, or one
        for each of its numbers; infinite: not measured. All sensors of trajectories need one.
        ``"pixels"``: of all points in pixels that are not named, as ``"CAMERA:POINT"``.
    noise
        ``"stated"``: standard deviations are as stated, up to one factor. ``"estimate"``: a fit
        estimates them, those of positions, of rotations and of each sensor, event and scalar. It
        starts from the stated ones (`dashpot.calibrate.inference.noise_estimate`).
    event_sigma, scalar_sigma
        Standard deviations of events (s) and of scalars (their units) by kind, > 0. All events and
        scalars of trajectories need one.
    substeps
        Steps per frame, >= 1. None: as many as keep the step at or below the model's timestep.
    window
        Seconds of each trajectory that are used. Short windows after the first contact fix damping
        and the friction of impacts; long ones see sliding and rolling. Scalars are of the
        whole, and count in no window that is shorter. None: all of it.
    residuals
        Functions by name, or one, of a `SimulatedRecording` and its `Trajectory`, that return (n,)
        residuals in units of their standard deviation, or a pair, residuals and their standard
        deviations (`dashpot.calibrate.problem.own_residuals`). n may differ between trajectories,
        0 too, but is one for all values of the parameters. Candidates for which a function raises,
        or returns what is not finite, count as failed. They are of the whole, as scalars are.
    start_states
        Function from the values of all parameters by name to initial qpos (trajectories, nq) and
        qvel (trajectories, nv), for parameters on which the initial states depend. Where the centre
        of mass is decides what a tracked point's flight says about velocity. None: what the
        trajectories carry. Only with ``initial_state="given"``.
    initial_state
        ``"given"``: trajectories carry their initial state. ``"velocity"``: the initial velocity of
        every trajectory is estimated too. ``"pose_and_velocity"``: the initial position as well:
        the choice for measured poses. With the other two a trajectory without ``initial_qpos``
        starts at its first observed pose as if that had no noise, and intervals are too narrow.
        What of it is known beforehand trajectories say (``initial_qpos_sigma``). Rotations that
        nothing measured, of a body whose centre of mass is off its origin, are held as the model
        has them, unless the trajectory has ``initial_qpos_sigma``. For intervals a state counts as
        known to 10 m, 10 rad, 100 m/s and 100 rad/s at least.

    Raises
    ------
    ValueError, TypeError
        Naming the parameter or trajectory and the field.

    Examples
    --------
    >>> [parameter.name for parameter in problem.parameters]
    ['stiffness', 'restitution']
    >>> held = problem.freeze("restitution")
    >>> [parameter.frozen for parameter in held.parameters]
    [False, True]
    """

    system: System | Builder
    parameters: Sequence[Parameter]
    trajectories: Sequence[Trajectory]
    position_sigma: float | tuple[float, float, float] = math.inf
    rotation_sigma: float = math.inf
    substeps: int | None = None
    window: float | None = None
    initial_state: InitialState = "given"
    start_states: StartStates | None = None
    sensor_sigma: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    event_sigma: Mapping[str, float] = field(default_factory=dict)
    scalar_sigma: Mapping[str, float] = field(default_factory=dict)
    noise: Noise = "stated"
    residuals: Mapping[str, ResidualFunction] | ResidualFunction = field(default_factory=dict)
    _sensors: dict[str, Sensor] = field(init=False, repr=False)
    _start_sigma: Array = field(init=False, repr=False)

    if TYPE_CHECKING:
        # What is taken, which is more than the types that fields have in the end.
        def __init__(
            self,
            system: System | Builder,
            parameters: Sequence[Parameter],
            trajectories: Sequence[Trajectory],
            position_sigma: float | Sequence[float] = ...,
            rotation_sigma: float = ...,
            substeps: int | None = None,
            window: float | None = None,
            initial_state: InitialState = "given",
            start_states: StartStates | None = None,
            sensor_sigma: Mapping[str, float | Sequence[float]] = ...,
            event_sigma: Mapping[str, float] = ...,
            scalar_sigma: Mapping[str, float] = ...,
            noise: Noise = ...,
            residuals: Mapping[str, ResidualFunction] | ResidualFunction = ...,
        ) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", all_of("parameters", self.parameters, Parameter))
        object.__setattr__(
            self, "trajectories", all_of("trajectories", self.trajectories, Trajectory)
        )
        if not self.parameters:
            raise ValueError("a problem needs at least one parameter")
        if not self.trajectories:
            raise ValueError("a problem needs at least one trajectory")
        names = [t.name for t in self.trajectories]
        check_unique("trajectory", names)
        stated = with_inertia(self.parameters, names, self.system)
        object.__setattr__(self, "parameters", single_parameters(stated, names))
        check_unique("parameter", [p.name for p in self.parameters])
        check_acting(self.parameters, names)
        object.__setattr__(self, "position_sigma", position_deviations(self.position_sigma))
        object.__setattr__(self, "rotation_sigma", deviation("rotation_sigma", self.rotation_sigma))
        views = {name: view for t in self.trajectories for name, view in t.views.items()}
        sensor_sigma = deviations_by_name("sensor_sigma", self.sensor_sigma)
        sensor_sigma = with_deviations_of_pixels(sensor_sigma, views)
        object.__setattr__(self, "sensor_sigma", sensor_sigma)
        sigmas = [self.sigma, *map(np.array, sensor_sigma.values())]
        for name in ("event_sigma", "scalar_sigma"):
            sigma = deviation_by_name(name, getattr(self, name))
            object.__setattr__(self, name, sigma)
            sigmas.append(np.array([*sigma.values()]))
        taken = {**sensor_sigma, **self.event_sigma, **self.scalar_sigma}
        object.__setattr__(self, "residuals", own_residuals(self.residuals, taken))
        sigmas.append(np.ones(len(self.own)))
        if not np.isfinite(np.concatenate(sigmas)).any():
            raise ValueError(
                "position_sigma and rotation_sigma are all infinite, and so is what else is "
                "stated: nothing was measured"
            )
        check_options(self)
        check_reach(self.parameters, self.system, self.start_states is not None)
        model = model_of(self.build(self.start))
        check_targets(self.parameters, model)
        object.__setattr__(self, "_sensors", observed_sensors(self, model))
        untouched = self.bare_system()
        if isinstance(untouched, Engine):
            check_nothing_is_lost(untouched, self.parameters)
        for trajectory in self.trajectories:
            check_against_model(self, trajectory, model)
        check_sensing(self)
        unseen = [out_of_sight(t, model) for t in self.trajectories]
        if not self.residuals:  # which may tell rotations
            unseen = [
                hidden | turns_held(t, model, self.sigma)
                for hidden, t in zip(unseen, self.trajectories, strict=True)
            ]
        known = start_sigma(self.trajectories, self.initial_state, unseen)
        object.__setattr__(self, "_start_sigma", known)
