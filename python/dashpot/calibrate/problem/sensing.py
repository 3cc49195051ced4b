"""How recorders see: delay, gain and offset of channels, scale of positions.

A channel that shows the number s(t) of the model at the time t reads

    gain * s(t - delay) + offset

and positions p, about a centre c that the tracker takes for right,

    c + scale * (p - c).

A delay > 0 is a recorder whose stamps are late: the world is shown as it was before. Times of
events are read later by it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.channels import POSES
from dashpot.calibrate.problem.setters import System

Array = NDArray[np.float64]
SensingQuantity = Literal["delay", "gain", "offset", "scale"]

_NEUTRAL: dict[SensingQuantity, float] = {"delay": 0.0, "gain": 1.0, "offset": 0.0, "scale": 1.0}


@dataclass(frozen=True)
class SensingSetter:
    """Sets how a channel is read; no system knows of it."""

    quantity: SensingQuantity
    channel: str
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __call__(self, system: System, value: float) -> None:
        """Leave the system as it is."""

    @property
    def target(self) -> str:
        """What it sets, in words."""
        return f"{self.quantity} of {self.channel}"


@dataclass(frozen=True, eq=False)
class Sensing:
    """How the channels of one trajectory read in each of some simulations.

    Attributes
    ----------
    values
        (simulations,) by quantity and channel.
    centre
        (3,) of the scale of positions, m.
    """

    values: Mapping[tuple[SensingQuantity, str], Array]
    centre: Array

    def of(self, quantity: SensingQuantity, channel: str) -> Array | None:
        """Return (simulations,) values, None where no parameter sets the quantity."""
        return self.values.get((quantity, channel))


def sensing(setters: Mapping[str, SensingSetter], values: Iterable[Mapping[str, float]]) -> Sensing:
    """Return how channels read for values of parameters by name, of which `setters` are some."""
    rows = list(values)
    centre = np.zeros(3)
    found: dict[tuple[SensingQuantity, str], Array] = {}
    for name, setter in setters.items():
        found[setter.quantity, setter.channel] = np.array([row[name] for row in rows])
        if setter.quantity == "scale":
            centre = np.array(setter.centre)
    return Sensing(found, centre)


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
    kind = channels.get(setter.channel)
    if kind is None:
        raise ValueError(
            f"{label}: no trajectory has a channel {setter.channel!r}; there are "
            f"{', '.join(channels)}"
        )
    if kind == "residual":
        raise ValueError(f"{label}: {setter.channel!r} is a function's, and has no recorder")
    if setter.quantity in ("gain", "offset") and setter.channel == POSES:
        raise ValueError(f"{label}: poses have no {setter.quantity}; they have a scale and a delay")
    if setter.quantity == "delay" and kind == "scalar":
        raise ValueError(f"{label}: {setter.channel!r} is no reading at a time, and has no delay")
    if setter.quantity in ("gain", "offset") and kind == "event":
        raise ValueError(f"{label}: times of {setter.channel!r} have a delay, no {setter.quantity}")
