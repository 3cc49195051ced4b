"""One recording whose truth is hidden, and how it is simulated apart from the fit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import dashpot
from dashpot.calibrate import Problem

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Case:
    """A fit of a recording, and what it should say.

    Attributes
    ----------
    problem
        What a laboratory states.
    truth
        Hidden values by name of the parameters that the recording tells.
    silent
        Names of parameters that it cannot tell.
    options
        Of `fit`.
    wrong
        Whether the model leaves something out, so that residuals should be called a misfit.
    """

    problem: Problem
    truth: Mapping[str, float]
    silent: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    wrong: bool = False


Scene = Callable[[np.random.Generator], list[Case]]


def simulate(
    engine: dashpot.Engine, qpos: Array, qvel: Array, step: float, count: int
) -> tuple[Array, Array]:
    """Return qpos (count + 1, nq) and sensors (count + 1, m) at the ends of steps of `step` s."""
    engine.model.opt.timestep = step
    data = engine.make_data()
    data.qpos[:], data.qvel[:] = qpos, qvel
    path, read = [data.qpos.copy()], [data.sensordata.copy()]
    for _ in range(count):
        engine.step(data)
        path.append(data.qpos.copy())
        read.append(data.sensordata.copy())
    return np.array(path), np.array(read)


def on_lines(values: Array, time: Array, step: float) -> Array:
    """Return values (n, k) of the ends of steps at times, on lines between them."""
    ends = step * np.arange(len(values))
    return np.stack([np.interp(time, ends, column) for column in values.T], axis=1)


def means_before(held: Array, time: Array, window: float, step: float) -> Array:
    """Return means over `window` s before times of a number (n,) that each step held."""
    ends = step * np.arange(len(held))
    integral = np.concatenate([[0.0], np.cumsum(held[1:])]) * step
    return np.asarray(
        (np.interp(time, ends, integral) - np.interp(time - window, ends, integral)) / window
    )


def draw(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number between two, uniform in its logarithm where both are of one sign."""
    if low > 0.0:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return float(rng.uniform(low, high))
