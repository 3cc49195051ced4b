"""What turns a tool: a compliant axis, and a mass that is off it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashpot.checks import number, positive_number

__all__ = ["Imbalance", "Spindle"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Spindle:
    """A compliant axis between flange and tool: it gives way along the tool.

    Parameters
    ----------
    stiffness
        N/m, > 0.
    damping
        N s/m, >= 0.
    travel
        Largest way from the rest, m, > 0.

    Examples
    --------
    >>> compliant = cell.with_changes(spindle=grinding.Spindle(5e4, 50.0, 0.01))
    """

    stiffness: float
    damping: float = 20.0
    travel: float = 0.02

    def __post_init__(self) -> None:
        positive_number("Spindle: stiffness", self.stiffness)
        positive_number("Spindle: travel", self.travel)
        _not_negative("Spindle: damping", self.damping)


@dataclass(frozen=True)
class Imbalance:
    """A mass that a spindle turns off its axis: a force that turns across the tool's axis.

    Parameters
    ----------
    speed
        Turns per second, 1/s, > 0.
    mass
        kg, >= 0.
    radius
        Distance of the mass from the axis, m, >= 0.

    Examples
    --------
    >>> imbalance = grinding.Imbalance(speed=47, mass=1e-3, radius=0.02)
    >>> imbalance.mean_forces(np.array([0.0, 0.005, 0.01])).shape
    (2, 2)
    """

    speed: float
    mass: float
    radius: float = 0.02

    def __post_init__(self) -> None:
        positive_number("Imbalance: speed", self.speed)
        _not_negative("Imbalance: mass", self.mass)
        _not_negative("Imbalance: radius", self.radius)

    @property
    def force(self) -> float:
        """Size of the force, N: mass times radius times the square of the angular speed."""
        return self.mass * self.radius * (2 * math.pi * self.speed) ** 2

    def mean_forces(self, times: Array) -> Array:
        """Return (n, 2) means of the force between (n + 1,) times in s, along x and y of the tip.

        Means over steps, so that a step need not resolve the turn: the impulse is right.
        """
        rate = 2 * math.pi * self.speed
        # Integrals of the cosine and the sine.
        integral = np.stack([np.sin(rate * times), -np.cos(rate * times)], axis=1) / rate
        mean = np.diff(integral, axis=0) / np.diff(times)[:, None]
        return np.asarray(self.force * mean)


def _not_negative(name: str, value: object) -> float:
    result = number(name, value)
    if not (math.isfinite(result) and result >= 0):
        raise ValueError(f"{name} must be finite and >= 0, got {value!r}")
    return result
