"""Presses of a tool onto a part, recorded or simulated."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path as File
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

import dashpot
from dashpot.checks import finite_array, number, positive_number
from dashpot.grinding.cell import Cell
from dashpot.grinding.cell_model import LOAD
from dashpot.grinding.motion import Motion, held_means
from dashpot.grinding.path import Path

__all__ = ["PressLog", "press_motion", "record_press"]

Array = NDArray[np.float64]

_SPAN = 0.004  # m, of the path that stands for the point that is pressed
_MOST_DEPTH, _LEAST_DEPTH = 0.1, 1e-6  # m
_SLOWEST = 0.2  # s between readings
# How late, in steps, the force of a press follows set points that are means over the steps: found
# against steps of 25 us, the same share at 0.1, 0.25 and 0.5 ms.
_LATE, _LATE_EXPLICIT = 0.17, 0.09
_OFF = 30.0  # how many times a stiffness may be what the cell expects


@dataclass(frozen=True, eq=False)
class PressLog:
    """A recorded press: force against position over time.

    Attributes
    ----------
    time
        (n,) s, evenly spaced.
    force
        (n,) normal force that the load cell read, N, positive when pushed.
    position
        (n,) how far below the surface the tip was sent, along the normal, m; negative above it.
        It is what the controller was told, from which the arm gives way under load.
    point
        (3,) where it presses, world, m: a point over the part, from which a ray along `direction`
        meets it.
    direction
        (3,) of that ray.
    sampling
        ``"instant"``: the load cell reads what is at the time; ``"mean"``: the mean over the time
        since the last reading; ``"auto"``: it is not known.

    Examples
    --------
    >>> log = grinding.record_press(cell, (0.0, 0.5, 0.3), depth=1e-3)
    >>> log.save("press.csv").name
    'press.csv'
    >>> again = grinding.PressLog.from_csv("press.csv", point=(0.0, 0.5, 0.3))
    >>> bool(np.allclose(again.force, log.force, atol=1e-3))
    True
    """

    time: Array
    force: Array
    position: Array
    point: Array
    direction: Array
    sampling: Literal["instant", "mean", "auto"] = "auto"

    @classmethod
    def of(
        cls,
        time: ArrayLike,
        force: ArrayLike,
        position: ArrayLike,
        point: ArrayLike,
        *,
        direction: ArrayLike = (0.0, 0.0, -1.0),
        sampling: Literal["instant", "mean", "auto"] = "auto",
    ) -> PressLog:
        """Return a log of arrays; ValueError names one that is of another length or unit."""
        arrays = {"time": time, "force": force, "position": position}
        checked = {name: finite_array(f"log: {name}", array) for name, array in arrays.items()}
        count = checked["time"].shape
        for name, array in checked.items():
            if array.ndim != 1 or array.shape != count:
                raise ValueError(f"log: {name} must be ({count[0]},) as time, got {array.shape}")
        if count[0] < 10:
            raise ValueError(f"log: a press needs 10 readings or more, got {count[0]}")
        steps = np.diff(checked["time"])
        if (steps <= 0).any():
            raise ValueError(f"log: time[{int((steps <= 0).argmax()) + 1}] does not ascend")
        if sampling not in ("instant", "mean", "auto"):
            raise ValueError(f"log: sampling is {sampling!r}, none of 'instant', 'mean', 'auto'")
        place = finite_array("log: point", point)
        if place.shape != (3,):
            raise ValueError(f"log: point must be (3,), got {place.shape}")
        ray = finite_array("log: direction", direction)
        log = cls(**checked, point=place, direction=ray, sampling=sampling)
        log._check_units()
        return log

    @classmethod
    def from_csv(
        cls,
        file: str | os.PathLike[str],
        point: ArrayLike,
        *,
        columns: Mapping[str, str] | None = None,
        direction: ArrayLike = (0.0, 0.0, -1.0),
        sampling: Literal["instant", "mean", "auto"] = "auto",
    ) -> PressLog:
        """Read a table with the columns ``time`` (s), ``force`` (N) and ``position`` (m).

        `columns` has other names of theirs: ``{"time": "t"}``.
        """
        named = {name: name for name in ("time", "force", "position")} | dict(columns or {})
        with open(file, newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
        arrays: dict[str, Any] = {}
        for name in ("time", "force", "position"):
            column = named[name]
            if not rows or column not in rows[0]:
                known = ", ".join(rows[0]) if rows else "nothing"
                raise ValueError(f"log {os.fspath(file)!r}: no column {column!r} among {known}")
            try:
                arrays[name] = [float(row[column]) for row in rows]
            except (TypeError, ValueError) as error:
                raise ValueError(f"log {os.fspath(file)!r}: column {column!r}: {error}") from None
        return cls.of(**arrays, point=point, direction=direction, sampling=sampling)

    def save(self, file: str | os.PathLike[str]) -> File:
        """Write the table that `from_csv` reads."""
        with open(file, "w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(("time", "force", "position"))
            for row in zip(self.time, self.force, self.position, strict=True):
                writer.writerow([f"{value:.9g}" for value in row])
        return File(file)

    @property
    def spacing(self) -> float:
        """Time between readings, s."""
        return float(np.median(np.diff(self.time)))

    def _check_units(self) -> None:
        span = float(np.ptp(self.position))
        if self.spacing > _SLOWEST:
            raise ValueError(
                f"log: time has readings {self.spacing:.3g} s apart; is it in ms? It has to be in s"
            )
        if not _LEAST_DEPTH < span < _MOST_DEPTH:
            raise ValueError(
                f"log: position spans {span:.3g} m; is it in mm or um? It has to be in m"
            )
        if self.force.max() < -self.force.min():
            raise ValueError("log: force is negative when pushed; turn its sign")

    def check_stiffness(self, cell: Cell) -> None:
        """Raise ValueError where force over position cannot be newtons over metres in a cell."""
        pressed = self.position > 0.3 * self.position.max()
        if self.position.max() <= 0 or not pressed.any():
            raise ValueError("log: position is never below the surface: it holds no press")
        apparent = float(np.median(self.force[pressed] / self.position[pressed]))
        # The arm gives way too, so that a right one is below the contact's own.
        if not cell.stiffness / _OFF**2 < apparent < cell.stiffness * _OFF:
            raise ValueError(
                f"log: force over position is {apparent:.3g} N/m, in a cell of "
                f"{cell.stiffness:.3g} N/m; is force in N and position in m?"
            )


def press_motion(cell: Cell, log_point: Array, direction: Array, depth: float) -> Motion:
    """Return a motion whose path's middle is the point that is pressed; it can go `depth` deep."""
    ray = direction / np.linalg.norm(direction)
    across = np.cross(ray, (1.0, 0.0, 0.0) if abs(ray[0]) < 0.9 else (0.0, 1.0, 0.0))
    across *= 0.5 * _SPAN / np.linalg.norm(across)
    path = Path.on_surface(
        cell,
        np.stack([log_point - across, log_point + across]),
        spacing=_SPAN / 4,
        direction=ray,
        run_in=0.0,
        clearance=0.01,
        depth=max(0.01, 1.2 * depth),
    )
    return Motion(cell, path)


def press_controls(motion: Motion, log_time: Array, position: Array, times: Array) -> Array:
    """Return (n, nu) controls for steps that begin at even times (n,), s.

    The controller sends the tip to `position` (m,) at `log_time` (m,), straight on in between.
    """
    cell = motion.cell
    period, timestep = cell.control.period, float(times[1] - times[0])
    first = log_time[0]
    ticks = first + period * np.arange(math.ceil((times[-1] - first) / period) + 2)
    nothing = np.zeros(len(ticks))
    middle = np.full(len(ticks), motion.path.length / 2)
    slope = np.gradient(position, log_time)
    sent = motion.set_points_at(
        middle,
        nothing,
        nothing,
        np.interp(ticks, log_time, position),
        np.interp(ticks, log_time, slope),
        nothing,
    )
    controls = np.zeros((len(times), cell.parts.model.nu))
    ahead = (_LATE if cell.integrator == "discrete" else _LATE_EXPLICIT) * timestep
    controls[:, cell.parts.actuators] = held_means(sent, period, times - first + ahead, timestep)
    return controls


def press_start(motion: Motion, position: float) -> Array:
    """Return ``qpos`` at rest at a position above the pressed point."""
    qpos = motion.start(position)
    qpos[motion.cell.parts.joints] = motion.angles(
        np.array([motion.path.length / 2]), np.array([position])
    )[0]
    return qpos


def record_press(
    cell: Cell,
    point: ArrayLike,
    *,
    depth: float = 0.008,
    duration: float = 0.6,
    rate: float = 500.0,
    sampling: Literal["instant", "mean"] = "mean",
    noise: float = 0.5,
    seed: int = 0,
    timestep: float = 1e-4,
    direction: ArrayLike = (0.0, 0.0, -1.0),
) -> PressLog:
    """Return the log of a press that is simulated: down, to and fro twice, and up again.

    Parameters
    ----------
    cell
        The cell as it is.
    point
        (3,) over the part.
    depth
        How far below the surface the tip is sent, m, > 0.
    duration, rate
        s, and readings a second.
    sampling
        What the load cell reads.
    noise
        Standard deviation of its readings, N, >= 0.
    seed
        Of the noise.
    timestep
        Of the simulation, s.

    Examples
    --------
    >>> log = grinding.record_press(cell, (0.0, 0.5, 0.3), depth=1e-3)
    >>> log.force.shape == log.time.shape
    True
    """
    positive_number("press: depth", depth)
    if not (math.isfinite(number("press: noise", noise)) and noise >= 0):
        raise ValueError(f"press: noise must be finite and >= 0, got {noise!r}")
    period = 1.0 / positive_number("press: rate", rate)
    frames = round(positive_number("press: duration", duration) / period) + 1
    share = np.linspace(0.0, 1.0, frames)
    hill = np.clip(4 * np.minimum(share, 1 - share), 0, 1)
    position = (depth + 1e-3) * hill**2 * (3 - 2 * hill) - 1e-3
    position -= 0.15 * depth * np.sin(np.clip(2 * share - 0.5, 0, 1) * 8 * np.pi) * (hill >= 1)
    place = finite_array("press: point", point)
    ray = finite_array("press: direction", direction)
    motion = press_motion(cell, place, ray, 1.2 * depth)
    engine = cell.engine()
    steps = max(1, math.ceil(period / timestep - 1e-9))
    engine.model.opt.timestep = period / steps
    data = engine.make_data()
    data.qpos[:] = press_start(motion, float(position[0]))
    load = engine.model.sensor(LOAD).adr[0]
    time = np.asarray(period * np.arange(frames), dtype=np.float64)
    within = np.asarray(period / steps * np.arange(steps * (frames - 1)), dtype=np.float64)
    controls = press_controls(motion, time, position, within)
    state = np.concatenate([[0.0], data.qpos, data.qvel])
    _, sensed = dashpot.rollout(engine, state, controls, nthread=1)
    readings = sensed[0, :, load].reshape(frames - 1, steps)
    if sampling == "mean":
        read = readings.mean(axis=1)
    else:  # between the steps before and after
        after = np.r_[readings[1:, 0], readings[-1, -1]]
        read = 0.5 * (readings[:, -1] + after)
    force = np.r_[0.0, read]
    force += noise * np.random.default_rng(seed).standard_normal(frames)
    return PressLog.of(time, force, position, place, direction=ray, sampling="auto")
