"""Residuals that a function of the user's own computes of a simulated trajectory.

What no recorder of `dashpot.calibrate` reads is compared so: how long a contact lasted, which share
of its energy a ball kept, at which angle a block came to rest::

    def duration(simulated, trajectory):
        touching = simulated.sensors["load"][1:, 0] > 0.0
        step = simulated.time[1] - simulated.time[0]
        return [(touching.sum() * step - measured[trajectory.name]) / 1e-4]

    problem = Problem(engine, unknown, drops, residuals={"duration": duration})

They are a channel of their own, tested and shown by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.channels import POSES, Channel
from dashpot.checks import number_array

Array = NDArray[np.float64]

_TAKEN = (POSES, "position", "rotation")


@dataclass(frozen=True, eq=False)
class SimulatedRecording:
    """One trajectory as it was simulated, for functions that compare it.

    Its arrays are read-only.

    Attributes
    ----------
    time
        (n,) ends of the steps, s, on the clock of the trajectory; the first is the start. It goes
        on beyond the last frame where readings are late or early. Where the rate of frames is
        estimated, steps and `times` are as far apart as the estimate says.
    position, quaternion
        By observed body, (n, 3) origin of its frame in the world, m, and (n, 4) orientation body to
        world, scalar first.
    sensors
        By name, (n, size) of all sensors of the model that can be observed. Those of accelerations
        and forces are means over the step that ends there, and NaN at the start.
    times
        By channel (``"poses"``, sensors, events, scalars), (rows,) of what was observed, s, on the
        same clock.
    readings
        By channel, (rows, columns) what its recorder reads at these times, delays and gains
        included; of poses position and quaternion of each body.

    Examples
    --------
    >>> def apex(simulated, recorded):
    ...     heights = simulated.position["ball"][:, 2], recorded.position[:, 0, 2]
    ...     return [(heights[0].max() - heights[1].max()) / 1e-3]
    ...
    >>> with_apex = Problem(engine, unknown, [throw], 1e-4, initial_state="given", residuals=apex)
    >>> fit(with_apex, starts=0).converged
    True
    """

    time: Array
    position: Mapping[str, Array]
    quaternion: Mapping[str, Array]
    sensors: Mapping[str, Array]
    times: Mapping[str, Array]
    readings: Mapping[str, Array]


ResidualFunction: TypeAlias = Callable[
    [SimulatedRecording, Trajectory], "ArrayLike | tuple[ArrayLike, ArrayLike]"
]


class ResidualError(ValueError):
    """A function of the user's own found no residuals of a candidate."""


@dataclass(frozen=True, eq=False)
class OwnResiduals:
    """A function of the user's own, and what is known of the residuals that it returns.

    Attributes
    ----------
    name
        Of the channel.
    function
        That returns residuals.
    sigma
        Their standard deviation, 1 unless it was estimated.
    counts
        How many they are, by trajectory that was simulated once.
    """

    name: str
    function: ResidualFunction
    sigma: float = 1.0
    counts: Mapping[str, int] = field(default_factory=dict)

    def __call__(self, simulated: SimulatedRecording, trajectory: Trajectory) -> Array:
        """Return (n,) what the function does.

        Raises
        ------
        ResidualError
            Where it raises, or returns what is not finite.
        TypeError, ValueError
            Where it returns no numbers, or not as many as at first.
        """
        label = f"trajectory '{trajectory.name}': residuals {self.name!r}"
        try:
            returned = self.function(simulated, trajectory)
        except Exception as error:
            raise ResidualError(f"{label} failed: {type(error).__name__}: {error}") from error
        parts: tuple[Any, ...] = returned if isinstance(returned, tuple) else (returned,)
        if len(parts) > 2:
            raise ValueError(f"{label} are one array, or two, with sigmas; got {len(parts)}")
        values = np.atleast_1d(number_array(label, parts[0]))
        if len(parts) == 2:
            sigma = number_array(f"sigmas of {label}", parts[1])
            if sigma.shape not in ((), values.shape) or not (sigma > 0.0).all():
                raise ValueError(
                    f"sigmas of {label} must be > 0, one or {values.shape}, got {parts[1]!r}"
                )
            values = values / sigma
        if values.ndim != 1:
            raise ValueError(f"{label} must be (n,), got {values.shape}")
        count = self.counts.get(trajectory.name, values.size)
        if values.size != count:
            raise ValueError(
                f"{label} must be as many for all values of the parameters: {count} at the start, "
                f"now {values.size}"
            )
        if not np.isfinite(values).all():
            place = int(np.argmin(np.isfinite(values)))
            raise ResidualError(f"{label} are not finite: [{place}] = {values[place]}")
        return np.asarray(values, dtype=np.float64)

    def with_counts(self, counts: Mapping[str, int]) -> OwnResiduals:
        """Return the same, which knows how many residuals trajectories have."""
        return replace(self, counts={**self.counts, **counts})

    def channel(self, trajectory: Trajectory) -> Channel:
        """Return the channel of a trajectory of which the count is known."""
        count = self.counts[trajectory.name]
        end = float(trajectory.time[-1] - trajectory.time[0])
        return Channel(
            name=self.name,
            kind="residual",
            time=np.full(count, end),
            observed=np.zeros((count, 1)),
            sigma=np.array([self.sigma]),
            measured=np.ones((count, 1), dtype=bool),
        )


def own_residuals(given: object, taken: Mapping[str, object]) -> dict[str, OwnResiduals]:
    """Return functions by name, checked; `taken` are names of other channels.

    Raises
    ------
    TypeError, ValueError
        Naming the entry.
    """
    if callable(given):
        given = {getattr(given, "__name__", type(given).__name__): given}
    if not isinstance(given, Mapping):
        raise TypeError(f"residuals must be functions by name, or one, got {given!r}")
    result = {}
    for name, function in given.items():
        if not isinstance(name, str) or not callable(function):
            raise TypeError(f"residuals must be functions by name, got {name!r}: {function!r}")
        if name in taken or name in _TAKEN:
            raise ValueError(f"residuals {name!r} need another name: a channel has it")
        known = isinstance(function, OwnResiduals)
        result[name] = function if known else OwnResiduals(name, function)
    return result


def own_channels(
    residuals: Mapping[str, OwnResiduals], trajectory: Trajectory, used: Trajectory
) -> list[Channel]:
    """Return the channels of functions that have residuals of a trajectory.

    They are of the whole, and none where less of it is `used`.
    """
    if used.frames < trajectory.frames:
        return []
    return [
        own.channel(trajectory) for own in residuals.values() if own.counts.get(trajectory.name)
    ]
