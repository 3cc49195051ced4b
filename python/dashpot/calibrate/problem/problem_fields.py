"""The fields of a problem, and what is read off them at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.observables import Sensor
from dashpot.calibrate.problem.own_residuals import OwnResiduals, ResidualFunction
from dashpot.calibrate.problem.parameters import Parameter
from dashpot.calibrate.problem.setters import System
from dashpot.calibrate.problem.systems import Builder

Array = NDArray[np.float64]
StartStates: TypeAlias = Callable[[Mapping[str, Any]], tuple[Array, Array]]
Noise = Literal["stated", "estimate"]
InitialState = Literal["given", "velocity", "pose_and_velocity"]


class ProblemFields:
    """The fields of `Problem`, and their names."""

    system: System | Builder
    parameters: Sequence[Parameter]
    trajectories: Sequence[Trajectory]
    position_sigma: float | tuple[float, float, float]
    rotation_sigma: float
    substeps: int | None
    window: float | None
    initial_state: InitialState
    start_states: StartStates | None
    sensor_sigma: Mapping[str, float | Sequence[float]]
    event_sigma: Mapping[str, float]
    scalar_sigma: Mapping[str, float]
    noise: Noise
    residuals: Mapping[str, ResidualFunction] | ResidualFunction
    _sensors: dict[str, Sensor]
    _start_sigma: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters in order, frozen ones included."""
        return tuple(p.name for p in self.parameters)

    @property
    def unknowns(self) -> tuple[Parameter, ...]:
        """The parameters that are fitted, in order."""
        return tuple(p for p in self.parameters if not p.frozen)

    @property
    def held(self) -> dict[str, float]:
        """Values of frozen parameters by name."""
        return {p.name: p.start for p in self.parameters if p.frozen}

    @property
    def start(self) -> dict[str, float]:
        """Start of the search by name, and what is held."""
        return {p.name: p.start for p in self.parameters}

    @property
    def sigma(self) -> Array:
        """(6,) standard deviations of x, y, z (m) and rotations about them (rad), inf included."""
        position = np.broadcast_to(np.asarray(self.position_sigma, dtype=np.float64), 3)
        return np.concatenate([position, np.full(3, self.rotation_sigma)])

    @property
    def start_sigma(self) -> Array:
        """(trajectories, s) how well estimated velocities, positions, clocks are known before.

        0: exactly; inf: not at all, as they are by default.
        """
        return self._start_sigma

    @property
    def deviations(self) -> dict[str, tuple[float, ...]]:
        """Standard deviations by name: positions (m), rotations (rad), sensors, events, scalars."""
        stated = {
            "position": self.sigma[:3],
            "rotation": self.sigma[3:4],
            **self.sensor_sigma,
            **self.event_sigma,
            **self.scalar_sigma,
            **{name: own.sigma for name, own in self.own.items()},
        }
        return {name: tuple(map(float, np.atleast_1d(s))) for name, s in stated.items()}

    @property
    def own(self) -> Mapping[str, OwnResiduals]:
        """Functions of residuals by name, with what is known of these."""
        return cast("Mapping[str, OwnResiduals]", self.residuals)

    def sensor(self, name: str) -> Sensor:
        """Return an observed sensor."""
        return self._sensors[name]
