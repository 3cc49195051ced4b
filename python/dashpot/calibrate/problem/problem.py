"""A calibration problem: what moves, what is unknown, what was observed and how well."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.noise import (
    deviation,
    deviation_by_name,
    deviations_by_name,
    position_deviations,
)
from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.channels import Channel
from dashpot.calibrate.problem.channels_of import channels_of
from dashpot.calibrate.problem.first_guess import free_bodies, initial_state, robust_guess
from dashpot.calibrate.problem.gaps import check_kinds
from dashpot.calibrate.problem.groups import check_acting, single_parameters
from dashpot.calibrate.problem.joint_guess import guess_joints
from dashpot.calibrate.problem.known_starts import is_reading, start_sigma
from dashpot.calibrate.problem.layout import Layout
from dashpot.calibrate.problem.observables import Sensor, body_id, find_sensor
from dashpot.calibrate.problem.parameters import Parameter
from dashpot.calibrate.problem.problem_entries import (
    all_of,
    check_reach,
    check_sensors,
    check_shapes,
    check_targets,
    check_unique,
    checked_states,
)
from dashpot.calibrate.problem.replaced_materials import check_nothing_is_lost
from dashpot.calibrate.problem.sensing import SensingSetter, check_channel
from dashpot.calibrate.problem.setters import System, model_of
from dashpot.calibrate.problem.systems import Builder, own_system, put_in
from dashpot.checks import number, positive_count
from dashpot.engine import Engine

Array = NDArray[np.float64]
StartStates: TypeAlias = Callable[[Mapping[str, float]], tuple[Array, Array]]
Noise = Literal["stated", "estimate"]
InitialState = Literal["given", "velocity", "pose_and_velocity"]


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything that defines a calibration.

    The simulation of a trajectory starts at its first frame without contact memory; frame k is
    reached after ``k * substeps`` steps of ``spacing / substeps``.

    Parameters
    ----------
    system
        A `dashpot.Engine`; or a `mujoco.MjModel`, which is then stepped with ``mj_step`` (to tune
        MuJoCo the same way); or a function from the values of all parameters by name to either,
        for parameters that need the model to be compiled anew. It is never changed: every
        candidate works on a copy.
    parameters
        The unknowns, with different names. Those with ``per`` are replaced by one for each
        trajectory or group.
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
    noise
        ``"stated"``: standard deviations are as stated, up to one factor; or ``"estimate"``: a fit
        estimates them, those of positions, of rotations and of each sensor, event and scalar, and
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
    start_states
        Function from the values of all parameters by name to initial qpos (trajectories, nq) and
        qvel (trajectories, nv), for parameters on which the initial states depend (where the centre
        of mass is decides what a tracked point's flight says about velocity). None: what the
        trajectories carry. Only with ``initial_state="given"``.
    initial_state
        ``"given"``: trajectories carry their initial state. ``"velocity"``: the initial velocity of
        every trajectory is estimated too. ``"pose_and_velocity"``: the initial position as well:
        the choice for measured poses. With the other two a trajectory without ``initial_qpos``
        starts at its first observed pose as if that had no noise, and intervals are too narrow.
        What of it is known beforehand trajectories say (``initial_qpos_sigma``). For intervals a
        state counts as known to 10 m, 10 rad, 100 m/s and 100 rad/s at least.

    Raises
    ------
    ValueError, TypeError
        Naming the parameter or trajectory and the field.
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
        object.__setattr__(self, "parameters", single_parameters(self.parameters, names))
        check_unique("parameter", [p.name for p in self.parameters])
        check_acting(self.parameters, names)
        object.__setattr__(self, "position_sigma", position_deviations(self.position_sigma))
        object.__setattr__(self, "rotation_sigma", deviation("rotation_sigma", self.rotation_sigma))
        sensor_sigma = deviations_by_name("sensor_sigma", self.sensor_sigma)
        object.__setattr__(self, "sensor_sigma", sensor_sigma)
        stated = [self.sigma, *map(np.array, sensor_sigma.values())]
        for name in ("event_sigma", "scalar_sigma"):
            sigma = deviation_by_name(name, getattr(self, name))
            object.__setattr__(self, name, sigma)
            stated.append(np.array([*sigma.values()]))
        if not np.isfinite(np.concatenate(stated)).any():
            raise ValueError(
                "position_sigma and rotation_sigma are all infinite, and so is what else is "
                "stated: nothing was measured"
            )
        if self.window is not None and not number("window", self.window) > 0:
            raise ValueError(f"window must be > 0 s, got {self.window!r}")
        if self.substeps is not None:
            positive_count("substeps", self.substeps)
        if self.initial_state not in ("given", "velocity", "pose_and_velocity"):
            raise ValueError(
                "initial_state must be 'given', 'velocity' or 'pose_and_velocity', "
                f"got {self.initial_state!r}"
            )
        if self.noise not in ("stated", "estimate"):
            raise ValueError(f"noise must be 'stated' or 'estimate', got {self.noise!r}")
        if self.start_states is not None:
            if not callable(self.start_states):
                raise TypeError(f"start_states must be a function, got {self.start_states!r}")
            if self.initial_state != "given":
                raise ValueError("start_states needs initial_state='given'")
        check_reach(self.parameters, self.system, self.start_states is not None)
        model = model_of(self.build(self.start))
        check_targets(self.parameters, model)
        object.__setattr__(self, "_sensors", {})
        for name, deviations in self.sensor_sigma.items():
            sensor = self._sensors[name] = find_sensor(model, name, "sensor_sigma")
            if np.size(deviations) not in (1, sensor.size):
                raise ValueError(
                    f"sensor_sigma[{name!r}] must be one number or {sensor.size}, "
                    f"got {np.size(deviations)}"
                )
        for trajectory in self.trajectories:
            for name in trajectory.scalars:
                if name.startswith("peak:") and name[5:] not in self._sensors:
                    label = f"trajectory '{trajectory.name}': scalar {name!r}"
                    sensor = self._sensors[name[5:]] = find_sensor(model, name[5:], label)
                    if sensor.size != 1:
                        raise ValueError(f"{label}: the sensor has {sensor.size} numbers, not one")
        untouched = own_system(self.system, self._values_in(self.start, names[0]))
        if isinstance(untouched, Engine):
            check_nothing_is_lost(untouched, self.parameters)
        for trajectory in self.trajectories:
            self._check_against_model(trajectory, model)
        self._check_sensing()
        known = [start_sigma(t, model.nv, self.initial_state) for t in self.trajectories]
        object.__setattr__(self, "_start_sigma", np.array(known))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters in order."""
        return tuple(p.name for p in self.parameters)

    @property
    def sigma(self) -> Array:
        """(6,) standard deviations of x, y, z (m) and rotations about them (rad), inf included."""
        position = np.broadcast_to(np.asarray(self.position_sigma, dtype=np.float64), 3)
        return np.concatenate([position, np.full(3, self.rotation_sigma)])

    @property
    def start_sigma(self) -> Array:
        """(trajectories, s) how well the estimated velocities, then positions are known before.

        0: exactly; inf: not at all, as they are by default.
        """
        return self._start_sigma

    @property
    def start(self) -> dict[str, float]:
        """Start of the search by name."""
        return {p.name: p.start for p in self.parameters}

    def build(self, values: Mapping[str, float], trajectory: str | None = None) -> System:
        """Return a system of its own with `values` (all parameters by name) put in.

        Parameters
        ----------
        values
            Of all parameters.
        trajectory
            Name of the one of which the system is: parameters that act in others alone are left
            out. None: the first.

        Raises
        ------
        ValueError
            Naming the parameter that is missing or unknown, or whose value was refused.
        """
        self.check_values(values)
        name = self.trajectories[0].name if trajectory is None else trajectory
        system = own_system(self.system, self._values_in(values, name))
        put_in(system, [p for p in self.parameters if p.acts_in(name)], values)
        return system

    def acting(self, trajectory: Trajectory) -> list[bool]:
        """Return for each parameter whether the system of a trajectory depends on it."""
        return [
            p.acts_in(trajectory.name) and not isinstance(p.apply, SensingSetter)
            for p in self.parameters
        ]

    def sensing_setters(self, trajectory: Trajectory) -> dict[str, SensingSetter]:
        """Return by name the parameters that say how channels of a trajectory read."""
        return {
            p.name: p.apply
            for p in self.parameters
            if isinstance(p.apply, SensingSetter) and p.acts_in(trajectory.name)
        }

    def channels(self, trajectory: Trajectory) -> list[Channel]:
        """Return the channels of a trajectory of the problem, within the window."""
        used = trajectory if self.window is None else trajectory.head(self.window)
        return channels_of(
            used,
            self.sigma,
            [(self._sensors[name], self.sensor_sigma[name]) for name in used.sensors],
            self.event_sigma,
            self.scalar_sigma,
            self.delays(trajectory),
        )

    def sensor(self, name: str) -> Sensor:
        """Return an observed sensor."""
        return self._sensors[name]

    def check_values(self, values: Mapping[str, float]) -> None:
        """Raise ValueError where `values` are not those of all parameters by name."""
        if set(values) != set(self.names):
            raise ValueError(
                f"values must be given for exactly {', '.join(self.names)}; got {', '.join(values)}"
            )

    def layouts(self) -> list[Layout]:
        """Return by trajectory where its residuals within the window stand."""
        return [
            Layout(
                tuple(channel.block for channel in self.channels(t)),
                int(np.count_nonzero(is_reading(sigma))),
            )
            for t, sigma in zip(self.trajectories, self.start_sigma, strict=True)
        ]

    def measured(self) -> list[NDArray[np.bool_]]:
        """Return by trajectory which of its residuals (as `layouts`) are of what was measured."""
        return [
            np.concatenate(
                [
                    *(channel.measured.reshape(-1) for channel in self.channels(t)),
                    np.ones(layout.starts, dtype=bool),
                ]
            )
            for t, layout in zip(self.trajectories, self.layouts(), strict=True)
        ]

    def with_window(self, window: float | None) -> Problem:
        """Return the same problem over another window."""
        return replace(self, window=window)

    def with_noise(self, factors: Mapping[str, float]) -> Problem:
        """Return the same problem with standard deviations multiplied by `factors`.

        Parameters
        ----------
        factors
            By name: ``"position"``, ``"rotation"``, sensors, events and scalars; those that are not
            named stay.
        """

        def times(stated: Mapping[str, Any]) -> dict[str, Any]:
            return {
                name: tuple(factors.get(name, 1.0) * np.atleast_1d(sigma))
                if np.ndim(sigma)
                else factors.get(name, 1.0) * sigma
                for name, sigma in stated.items()
            }

        return replace(
            self,
            position_sigma=tuple(factors.get("position", 1.0) * self.sigma[:3]),
            rotation_sigma=factors.get("rotation", 1.0) * self.rotation_sigma,
            sensor_sigma=times(self.sensor_sigma),
            event_sigma=times(self.event_sigma),
            scalar_sigma=times(self.scalar_sigma),
        )

    @property
    def deviations(self) -> dict[str, tuple[float, ...]]:
        """Standard deviations by name: positions (m), rotations (rad), sensors, events, scalars."""
        stated = {
            "position": self.sigma[:3],
            "rotation": self.sigma[3:4],
            **self.sensor_sigma,
            **self.event_sigma,
            **self.scalar_sigma,
        }
        return {name: tuple(map(float, np.atleast_1d(s))) for name, s in stated.items()}

    def initial_states(
        self, model: mujoco.MjModel, values: Mapping[str, float] | None = None
    ) -> tuple[Array, Array]:
        """Return initial qpos (trajectories, nq) and qvel (trajectories, nv) of `values`.

        Raises
        ------
        ValueError
            If `start_states` returns arrays of another shape or numbers that are not finite.
        """
        count = len(self.trajectories)
        if self.start_states is not None:
            starts = self.start_states(self.start if values is None else values)
            return checked_states(starts, count, model)
        qpos = np.empty((count, model.nq))
        qvel = np.empty((count, model.nv))
        for i, trajectory in enumerate(self.trajectories):
            qpos[i], qvel[i] = initial_state(trajectory, model, np.isfinite(self.sigma))
            guess_joints(
                trajectory,
                model,
                qpos[i],
                qvel[i],
                positions=not self.starts_at_first_poses(),
                left_out={s.channel for s in self.sensing_setters(trajectory).values()},
            )
        return qpos, qvel

    def robust_guesses(self, model: mujoco.MjModel, qvel: Array) -> tuple[Array, Array]:
        """Return velocities and displacements (trajectories, nv) to start an estimation with.

        Outliers in the first frames do not lead them astray, as they do those of
        `initial_states`, of which `qvel` (trajectories, nv) are the velocities.
        """
        guesses = [
            robust_guess(
                t if self.window is None else t.head(self.window), model, self.sigma, given
            )
            for t, given in zip(self.trajectories, qvel, strict=True)
        ]
        velocity, displacement = zip(*guesses, strict=True)
        return np.array(velocity), np.array(displacement)

    def starts_at_first_poses(self) -> bool:
        """Whether simulations without ``initial_qpos`` start at their first observed pose."""
        return self.initial_state != "pose_and_velocity" and self.start_states is None

    def steps_per_frame(self, trajectory: Trajectory, model: mujoco.MjModel) -> int:
        """Return the number of simulation steps between two frames."""
        if self.substeps is not None:
            return int(self.substeps)
        # The slack keeps rounding in the times from adding a step.
        return max(1, math.ceil(trajectory.spacing / float(model.opt.timestep) - 1e-6))

    def _values_in(self, values: Mapping[str, float], trajectory: str) -> dict[str, float]:
        """Return the values that a function which builds the system of a trajectory gets."""
        return {p.base or p.name: values[p.name] for p in self.parameters if p.acts_in(trajectory)}

    def delays(self, trajectory: Trajectory) -> dict[str, tuple[float, float]]:
        """Return by channel of a trajectory the bounds of its delay, s."""
        return {
            p.apply.channel: p.bounds
            for p in self.parameters
            if isinstance(p.apply, SensingSetter)
            and p.apply.quantity == "delay"
            and p.acts_in(trajectory.name)
        }

    def _check_sensing(self) -> None:
        for parameter in self.parameters:
            if isinstance(parameter.apply, SensingSetter):
                kinds = {
                    channel.name: channel.kind
                    for trajectory in self.trajectories
                    if parameter.acts_in(trajectory.name)
                    for channel in self.channels(trajectory)
                }
                check_channel(parameter.name, parameter.apply, kinds)

    def _check_against_model(self, trajectory: Trajectory, model: mujoco.MjModel) -> None:
        label = f"trajectory '{trajectory.name}'"
        for body in trajectory.bodies:
            body_id(model, body, label)
        carried = self.initial_state == "given" and self.start_states is None
        if trajectory.initial_qvel is None and carried:
            raise ValueError(
                f"{label} has no initial_qvel; give it, or estimate it with "
                "initial_state='velocity'"
            )
        check_sensors(trajectory, model, self.sensor_sigma)
        check_kinds(trajectory, model)
        if not any(channel.measured.any() for channel in self.channels(trajectory)):
            raise ValueError(f"{label}: nothing that was measured is left of it")
        if trajectory.initial_qpos is None and self.starts_at_first_poses():
            for i, _ in free_bodies(trajectory, model):
                if not trajectory.measured[0, i, np.isfinite(self.sigma)].all():
                    raise ValueError(
                        f"{label}: body '{trajectory.bodies[i]}' was not measured in the first "
                        "frame; give initial_qpos, or estimate the start with "
                        "initial_state='pose_and_velocity'"
                    )
        check_shapes(trajectory, model)
