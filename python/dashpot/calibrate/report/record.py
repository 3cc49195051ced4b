"""What a report tells of a fit, as plain numbers: it is saved with the fit and needs no model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Of one recorder; a file may say no more.
_MOST_STEPS = 10_000_000


@dataclass(frozen=True, eq=False)
class Curve:
    """One number that a recorder read, measured and simulated.

    Attributes
    ----------
    name
        Such as ``"ball z"``, or of a sensor, event or scalar.
    unit
        Empty where there is none.
    axis
        What `place` is: ``"time [s]"``, from the first frame, or ``"number"`` of events.
    place
        (n,) of the readings.
    measured, simulated
        (n,); NaN: not measured.
    sigma
        Standard deviation of the measured.
    spread
        (n,) standard deviation of the simulated over what the fit leaves open; NaN where it was
        not found.
    """

    name: str
    unit: str
    axis: str
    place: Array
    measured: Array
    simulated: Array
    sigma: float
    spread: Array

    def __post_init__(self) -> None:
        rows = (self.measured, self.simulated, self.spread)
        if self.place.ndim != 1 or any(row.shape != self.place.shape for row in rows):
            raise ValueError(f"'{self.name}': its numbers are not one a place")


@dataclass(frozen=True, eq=False)
class Residual:
    """Simulated less measured of one number, in standard deviations of the noise.

    Attributes
    ----------
    name, unit, sigma
        As of a `Curve`.
    time
        (n,) s, from the first frame.
    step
        (n,) places of the readings in their order: on the even grid of the frames, or one after
        the other.
    weighted
        (n,); NaN where it does not count.
    """

    name: str
    unit: str
    sigma: float
    time: Array
    step: Array
    weighted: Array

    def __post_init__(self) -> None:
        if self.time.ndim != 1 or not self.time.shape == self.step.shape == self.weighted.shape:
            raise ValueError(f"'{self.name}': its residuals are not one a reading")
        most = 10 * _MOST_STEPS
        if (np.diff(self.step) < 1).any() or not (self.step[:1] >= 0).all():
            raise ValueError(f"'{self.name}': its steps do not ascend")
        if not (self.step[-1:] < most).all():
            raise ValueError(f"'{self.name}': it has more than {most} steps")


@dataclass(frozen=True, eq=False)
class Shown:
    """A trajectory as a report shows it.

    Attributes
    ----------
    name
        Of the trajectory.
    frames
        How many it has.
    duration
        From the first frame to the last, s.
    window
        s that were fitted; None: all.
    curves, residuals
        Of its channels.
    """

    name: str
    frames: int
    duration: float
    window: float | None
    curves: tuple[Curve, ...]
    residuals: tuple[Residual, ...]

    @property
    def size(self) -> float:
        """Root mean square of the weighted residuals; NaN without any."""
        rows = [residual.weighted for residual in self.residuals]
        counted = np.concatenate(rows) if rows else np.empty(0)
        counted = counted[np.isfinite(counted)]
        return float(np.sqrt(np.mean(counted**2))) if counted.size else float("nan")


@dataclass(frozen=True, eq=False)
class Profile:
    """The cost along one parameter, the others moved as their correlation says.

    Attributes
    ----------
    name
        The parameter.
    value
        (k,) ascending.
    rise
        (k,) of twice the cost, over the variance of the residuals; NaN where simulations fail. Of
        clustered errors, or data without noise, in a unit of which it has 1 at a standard error.
    """

    name: str
    value: Array
    rise: Array

    def __post_init__(self) -> None:
        if self.value.ndim != 1 or self.rise.shape != self.value.shape:
            raise ValueError(f"profile of '{self.name}': there is not one rise a value")


@dataclass(frozen=True, eq=False)
class Clip:
    """Outlines of what moves, seen from the side, for an animation.

    Attributes
    ----------
    trajectory
        Its name.
    time
        (k,) of the pictures, s.
    still
        Outlines (vertices, 2) of what does not move, m.
    simulated, measured
        By body and picture, outlines (k, vertices, 2), m; NaN where a pose was not measured.
    label
        Of the horizontal axis.
    """

    trajectory: str
    time: Array
    still: tuple[Array, ...]
    simulated: tuple[Array, ...]
    measured: tuple[Array, ...]
    label: str

    def __post_init__(self) -> None:
        moving = [(outlines.shape[:1], outlines) for outlines in (*self.simulated, *self.measured)]
        still = [(self.time.shape, outline[None]) for outline in self.still]
        if any(s != self.time.shape or o.ndim != 3 or o.shape[2] != 2 for s, o in moving + still):
            raise ValueError(f"clip of '{self.trajectory}': its outlines are none")


@dataclass(frozen=True, eq=False)
class Record:
    """What a report tells of a fit beside its estimates.

    Attributes
    ----------
    stepper
        ``"dashpot"`` or ``"MuJoCo"``.
    units
        Of the parameters, by name.
    metrics
        As `Fit.metrics`.
    trajectories
        Those that were fitted.
    profiles
        Of the parameters that have a standard error.
    clips
        Of the median and the worst trajectory, by the size of their residuals.
    note
        What could not be found, and why.
    noise
        ``"stated"`` or ``"estimated"``.
    """

    stepper: Literal["dashpot", "MuJoCo"]
    units: Mapping[str, str]
    metrics: Mapping[str, float]
    trajectories: tuple[Shown, ...]
    profiles: tuple[Profile, ...] = ()
    clips: tuple[Clip, ...] = ()
    note: str = ""
    noise: Literal["stated", "estimated"] = "stated"
