"""How recorders may read otherwise than the problem says, tried at an estimate.

Each way is one parameter more, of which residuals are found by value, all other unknowns as they
are: that takes no simulation but the one at the estimate.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.channels import POSES, Channel
from dashpot.calibrate.problem.parameters import Parameter
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.sensing import SensingSetter, check_channel
from dashpot.calibrate.problem.setters import model_of
from dashpot.calibrate.problem.units import parameter_unit
from dashpot.calibrate.residuals.objective import Objective
from dashpot.engine import Engine

Array = NDArray[np.float64]
Quantity = Literal["delay", "gain", "offset", "scale", "sampling"]

# Delays are tried up to so long, s, and up to this share of a recording, at so many places.
_LONGEST_DELAY, _DELAY_SHARE, _DELAYS = 0.1, 0.2, 41

# Gains and scales that seem smaller are begun with here.
_LEAST_FACTOR = 0.1
_FACTORS = np.array([1.0, 1.1])


@dataclass(frozen=True, eq=False)
class Trial:
    """One way in which a channel may read.

    Attributes
    ----------
    channel, quantity
        As in `dashpot.calibrate.inference.explanations.Explanation`.
    values
        (k,) at which to look; the first is the neutral one. Residuals are linear in what has two.
    residuals
        Returns (n, m) of values (n,).
    rows
        (m,) whether residuals count: those of delays have no use for what may be of the time
        before the start.
    unit, remedy
        Of a value, and how the problem would say it.
    problem
        That reads so; `parameter` is its last one, None where it is one without.
    simulated
        Returns how many sets of trajectories looking has simulated so far.
    """

    channel: str
    quantity: Quantity
    values: Array
    residuals: Callable[[Array], Array]
    rows: NDArray[np.bool_]
    unit: str
    remedy: str
    problem: Problem
    simulated: Callable[[], int]
    parameter: Parameter | None = None

    def around(self, value: float) -> Problem:
        """Return the problem, its parameter near a value."""
        if self.parameter is None:
            return self.problem
        if self.quantity in ("gain", "scale"):
            value = max(value, _LEAST_FACTOR)
            bounds = (0.5 * value, 2.0 * value)
        else:
            bounds = (value - abs(value), value + abs(value))
        near = replace(self.parameter, start=value, bounds=bounds)
        return replace(self.problem, parameters=[*self.problem.parameters[:-1], near])


@dataclass(frozen=True)
class _Without:
    """A function of the user's own, which gets all values but that of one parameter."""

    function: Callable[[Mapping[str, float]], Any]
    name: str

    def __call__(self, values: Mapping[str, float]) -> Any:
        return self.function({name: v for name, v in values.items() if name != self.name})


def recorder_trials(objective: Objective, point: Array) -> Iterator[Trial]:
    """Yield in how many ways the channels of a problem may read that are no unknowns of it."""
    problem = objective.problem
    setters = [p.apply for p in problem.parameters if isinstance(p.apply, SensingSetter)]
    known = {(setter.quantity, name) for setter in setters for name in setter.channels}
    channels: dict[str, list[Channel]] = {}
    for recorder in objective.recorders:
        for channel in recorder.channels:
            if channel.measured.any():
                channels.setdefault(_recorder_of(channel), []).append(channel)
    kinds = {name: _kind_of(of_name[0]) for name, of_name in channels.items()}
    for name, of_name in channels.items():
        for parameter, values in _parameters(name, of_name):
            setter = parameter.apply
            assert isinstance(setter, SensingSetter)
            if (setter.quantity, name) in known:
                continue
            try:
                check_channel(parameter.name, setter, kinds)
                trial = _of_parameter(objective, point, parameter, setter, values)
            except ValueError:
                continue  # it cannot read so, or nothing would be left of it
            yield trial
        read = () if kinds[name] == "camera" else of_name
        windows = {channel.window > 0.0 for channel in read if channel.sensor is not None}
        if len(windows) == 1:
            yield _of_sampling(objective, point, name, mean=windows.pop())


def _recorder_of(channel: Channel) -> str:
    """Return the name of what reads a channel: its own, or that of the camera of a point."""
    view = None if channel.sensor is None else channel.sensor.view
    return channel.name if view is None else view.camera


def _kind_of(channel: Channel) -> str:
    """Return the kind of what reads a channel."""
    return channel.kind if _recorder_of(channel) == channel.name else "camera"


def _parameters(name: str, channels: Sequence[Channel]) -> Iterator[tuple[Parameter, Array]]:
    """Yield parameters of a channel, and values at which to look, the neutral one first."""
    label = f"tried of {name}"
    if name == POSES:
        yield Parameter.scale(bounds=(0.5, 2.0), name=label), _FACTORS
    elif _kind_of(channels[0]) != "camera":
        sigma = float(min(channel.sigma.min() for channel in channels))
        yield Parameter.gain(name, bounds=(0.5, 2.0), name=label), _FACTORS
        offset = Parameter.offset(name, bounds=(-sigma, sigma), name=label)
        yield offset, np.array([0.0, sigma])
    duration = min(float(channel.time.max()) for channel in channels)
    longest = min(_LONGEST_DELAY, _DELAY_SHARE * duration)
    if longest > 0.0:
        places = np.linspace(-longest, longest, _DELAYS)
        order = np.argsort(np.abs(places), kind="stable")
        yield Parameter.delay(name, bounds=(-longest, longest), name=label), places[order]


def _of_parameter(
    objective: Objective,
    point: Array,
    parameter: Parameter,
    setter: SensingSetter,
    values: Array,
) -> Trial:
    problem, name = objective.problem, parameter.name
    system, starts = problem.system, problem.start_states
    if not isinstance(system, Engine | mujoco.MjModel):
        system = _Without(system, name)
    extended = replace(
        problem,
        system=system,
        start_states=None if starts is None else _Without(starts, name),
        parameters=[*problem.parameters, parameter],
    )
    tried = objective.of(extended, kept=False)
    count, coordinate = objective.parameters, parameter.coordinate
    # Where joints are read otherwise, they start elsewhere.
    near = tried.as_from(objective, point)
    looks: list[int] = []

    def residuals(at: Array) -> Array:
        # However many values there are, one set of trajectories is simulated.
        looks.append(1)
        rows = [np.insert(near, count, coordinate.to_search(float(value))) for value in at]
        return tried.residuals(np.array(rows))

    quoted = f'"{setter.channel}"' if setter.quantity != "scale" else ""
    return Trial(
        setter.channel,
        cast("Quantity", setter.quantity),
        values,
        residuals,
        np.concatenate(extended.measured()),
        parameter_unit(parameter, extended, model_of(problem.build(objective.values(point)))),
        f"Parameter.{setter.quantity}({quoted})",
        extended,
        looks.__len__,
        parameter,
    )


def _of_sampling(objective: Objective, point: Array, name: str, *, mean: bool) -> Trial:
    problem = objective.problem
    other: Literal["instant", "mean"] = "instant" if mean else "mean"
    trajectories = [_sampled(t, name, other) for t in problem.trajectories]
    changed = replace(problem, trajectories=trajectories)
    tried = objective.of(changed, kept=False)

    looks: list[int] = []

    def residuals(at: Array) -> Array:
        looks.append(2)
        both = [objective.residuals(point[None])[0], tried.residuals(point[None])[0]]
        return np.array([both[0] + value * (both[1] - both[0]) for value in at])

    return Trial(
        name,
        "sampling",
        np.array([0.0, 1.0]),
        residuals,
        np.concatenate([*changed.measured()]) & np.concatenate(problem.measured()),
        "",
        f'sampling={{"{name}": "{other}"}}',
        changed,
        lambda: sum(looks),
    )


def _sampled(trajectory: Trajectory, name: str, how: Literal["instant", "mean"]) -> Trajectory:
    if name not in trajectory.sensors:
        return trajectory
    changed = copy.copy(trajectory)
    object.__setattr__(changed, "sampling", {**trajectory.sampling, name: how})
    return changed
