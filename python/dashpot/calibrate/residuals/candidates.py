"""Systems and initial states to be simulated, and errors where that fails."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.setters import System

Array = NDArray[np.float64]


class SimulationError(ValueError):
    """A candidate cannot be built or simulated; names the trajectory and its parameters."""


def failure_of(values: Mapping[str, float], error: ValueError) -> SimulationError:
    """Return the error of a candidate, with the values of its parameters by name."""
    listed = ", ".join(f"{name} = {value:.6g}" for name, value in values.items())
    # The core counts variants within its batch: there, the only one.
    what = str(error).replace("variant 0, ", "", 1)
    failure = SimulationError(f"{what}; with {listed}")
    failure.__cause__ = error
    return failure


@dataclass(frozen=True, eq=False)
class Candidate:
    """A system and the initial states of the trajectories: qpos (trajectories, nq), and qvel."""

    system: System
    qpos: Array
    qvel: Array


def batch(candidates: Collection[Candidate]) -> tuple[list[tuple[int, Any]], Array, Array]:
    """Return the variants of the core, qpos and qvel (variants, trajectories, nq or nv)."""
    variants = [_variant(candidate.system) for candidate in candidates]
    qpos = np.stack([candidate.qpos for candidate in candidates])
    return variants, qpos, np.stack([candidate.qvel for candidate in candidates])


def _variant(system: System) -> tuple[int, Any]:
    """Address of the model and parameters of the engine, None for MuJoCo's own step."""
    if isinstance(system, mujoco.MjModel):
        return system._address, None
    return system.model._address, system._parameters()
