"""How recorders see: delay, gain and offset of channels, scale of positions, pictures.

A channel that shows the number s(t) of the model at the time t reads

    gain * s(t - delay) + offset

and positions p, about a centre c that the tracker takes for right,

    c + scale * (p - c).

What a picture's scale, tilt and origin are says `dashpot.calibrate.problem.pixels`.

A delay > 0 is a recorder whose stamps are late: the world is shown as it was before. Times of
events are read later by it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.channels import POSES
from dashpot.calibrate.problem.setters import System

Array = NDArray[np.float64]
ImageQuantity = Literal["scale", "tilt", "origin_u", "origin_v"]
SensingQuantity = Literal["delay", "gain", "offset"] | ImageQuantity


@dataclass(frozen=True)
class SensingSetter:
    """Sets how a channel is read; no system knows of it."""

    quantity: SensingQuantity
    channel: str
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    #: Which of how many numbers of the channel it is of; None: of all alike.
    number: int | None = None
    count: int = 1
    #: Further channels of the same recorder.
    others: tuple[str, ...] = ()

    def __call__(self, system: System, value: float) -> None:
        """Leave the system as it is."""

    @property
    def channels(self) -> tuple[str, ...]:
        """All that it is of."""
        return (self.channel, *self.others)

    @property
    def targets(self) -> tuple[str, ...]:
        """What it sets, in words."""
        return tuple(f"{self.quantity} of {channel}" for channel in self.channels)

    def component(self, number: int, count: int) -> SensingSetter:
        """Return the setter of one of so many numbers of the channel."""
        if self.quantity not in ("gain", "offset"):
            raise ValueError(f"{self.quantity} is one number, and there are {count}")
        return replace(self, number=number, count=count)


@dataclass(frozen=True, eq=False)
class Sensing:
    """How the channels of one trajectory read in each of some simulations.

    Attributes
    ----------
    values
        (simulations,) by quantity and channel, or (simulations, numbers) where these differ.
    centre
        (3,) of the scale of positions, m.
    models
        (simulations,) where pictures need them.
    """

    values: Mapping[tuple[SensingQuantity, str], Array]
    centre: Array
    models: Sequence[mujoco.MjModel] = field(default=())

    def of(self, quantity: SensingQuantity, channel: str) -> Array | None:
        """Return its values, None where no parameter sets the quantity."""
        return self.values.get((quantity, channel))

    def through(self, reading: Array, channel: str) -> Array:
        """Return what a channel reads (simulations, rows, columns) with its gain and offset."""
        gain, offset = self.of("gain", channel), self.of("offset", channel)
        if gain is not None:
            reading = gain.reshape(len(gain), 1, -1) * reading
        return reading if offset is None else reading + offset.reshape(len(offset), 1, -1)


def sensing(
    setters: Mapping[str, SensingSetter],
    values: Iterable[Mapping[str, float]],
    models: Sequence[mujoco.MjModel] = (),
) -> Sensing:
    """Return how channels read for values of parameters by name, of which `setters` are some."""
    rows = list(values)
    centre = np.zeros(3)
    found: dict[tuple[SensingQuantity, str], Array] = {}
    for name, setter in setters.items():
        column = np.array([row[name] for row in rows])
        for channel in setter.channels:
            key = setter.quantity, channel
            if setter.number is None:
                found[key] = column
            else:
                table = found.setdefault(key, np.empty((len(rows), setter.count)))
                table[:, setter.number] = column
        if f"scale of {POSES}" in setter.targets:
            centre = np.array(setter.centre)
    return Sensing(found, centre, models)


def check_channel(name: str, setter: SensingSetter, channels: Mapping[str, str]) -> None:
    """Raise ValueError where a parameter reads a channel that no trajectory has, or not so.

    Parameters
    ----------
    name
        Of the parameter.
    setter
        What it sets.
    channels
        Kinds by name of the channels of the trajectories that the parameter is of.
    """
    label = f"parameter '{name}'"
    for channel in setter.channels:
        kind = channels.get(channel)
        if kind is None:
            raise ValueError(
                f"{label}: no trajectory has a channel {channel!r}; there are {', '.join(channels)}"
            )
        if kind == "residual":
            raise ValueError(f"{label}: {channel!r} is a function's, and has no recorder")
        of_picture = setter.quantity in get_args(ImageQuantity)
        if of_picture and kind != "camera" and (setter.quantity, channel) != ("scale", POSES):
            raise ValueError(f"{label}: {channel!r} is no camera, and has no {setter.quantity}")
        if kind == "camera" and not (of_picture or setter.quantity == "delay"):
            raise ValueError(f"{label}: camera {channel!r} has no {setter.quantity}")
        if setter.quantity in ("gain", "offset") and channel == POSES:
            raise ValueError(
                f"{label}: poses have no {setter.quantity}; they have a scale and a delay"
            )
        if setter.quantity == "delay" and kind == "scalar":
            raise ValueError(f"{label}: {channel!r} is no reading at a time, and has no delay")
        if setter.quantity in ("gain", "offset") and kind == "event":
            raise ValueError(f"{label}: times of {channel!r} have a delay, no {setter.quantity}")


def check_numbers(name: str, setter: SensingSetter, counts: Mapping[str, int]) -> None:
    """Raise ValueError where a vector has not one number for each of its channel's, by `counts`."""
    for channel in setter.channels:
        if setter.number is not None and setter.count != counts[channel]:
            raise ValueError(
                f"parameter '{name}': there are {setter.count} numbers, and {channel!r} has "
                f"{counts[channel]}"
            )
