"""Systems and initial states to be simulated, and errors where that fails."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot import _core
from dashpot.calibrate.problem.setters import System
from dashpot.calibrate.residuals.recorder import Recorder

Array = NDArray[np.float64]

# At most so many numbers are recorded at once, 64 MB, however many simulations there are.
_MOST_NUMBERS = 8_000_000


class SimulationError(ValueError):
    """A candidate cannot be built or simulated; names the trajectory and its parameters."""


def failure_of(values: Mapping[str, float], reason: str | Exception) -> SimulationError:
    """Return the error of a candidate, with the values of its parameters by name."""
    listed = ", ".join(f"{name} = {value:.6g}" for name, value in values.items())
    failure = SimulationError(f"{reason}; with {listed}")
    if isinstance(reason, Exception):
        failure.__cause__ = reason
    return failure


@dataclass(frozen=True, eq=False)
class Candidate:
    """What is simulated of one point.

    Attributes
    ----------
    values
        Of the parameters by name.
    systems
        By trajectory.
    qpos, qvel
        (trajectories, nq), (trajectories, nv) initial states.
    pace
        (trajectories,) how many times as long as stated frames are apart.
    """

    values: dict[str, float]
    systems: Sequence[System]
    qpos: Array
    qvel: Array
    pace: Array


class Batch:
    """Simulations of candidates, each different one once.

    A trajectory that one candidate moves as another does, in the same system from the same state,
    is simulated for both: where parameters act in other trajectories, or only in what recorders
    read, derivatives cost nothing.
    """

    def __init__(self, candidates: Mapping[int, Candidate], recorders: Sequence[Recorder]) -> None:
        self._recordings: list[_core.Recording] = []
        self._variants: list[tuple[int, Any]] = []
        self._items: list[tuple[int, int]] = []
        self._states: list[tuple[Array, Array]] = []
        #: By simulation, the candidates and trajectories that it is of.
        self.users: list[list[tuple[int, int]]] = []
        number: dict[int, int] = {}
        known: dict[tuple[int, int, bytes, bytes], int] = {}
        place: dict[tuple[int, float], int] = {}
        for v, candidate in candidates.items():
            for t, recorder in enumerate(recorders):
                system = candidate.systems[t]
                if id(system) not in number:
                    number[id(system)] = len(self._variants)
                    self._variants.append(_variant(system))
                qpos, qvel = candidate.qpos[t], candidate.qvel[t]
                paced = (t, float(candidate.pace[t]))
                if paced not in place:
                    place[paced] = len(self._recordings)
                    self._recordings.append(recorder.recording(paced[1]))
                key = (number[id(system)], place[paced], qpos.tobytes(), qvel.tobytes())
                if key not in known:
                    known[key] = len(self._items)
                    self._items.append(key[:2])
                    self._states.append((qpos, qvel))
                    self.users.append([])
                self.users[known[key]].append((v, t))

    def record(self, nthread: int) -> Iterator[list[tuple[int, Array, str]]]:
        """Yield some simulations at a time, as many as memory is meant for.

        Each with what is recorded of it (n,), and why it failed: "" where it did not.

        Raises
        ------
        ValueError
            Where the systems cannot be simulated together.
        """
        sizes = [int(np.prod(self._recordings[r].shape)) for _, r in self._items]
        first = 0
        while first < len(self._items):
            last, numbers = first, 0
            while last < len(self._items) and (last == first or numbers < _MOST_NUMBERS):
                numbers += sizes[last]
                last += 1
            qpos, qvel = (np.stack(parts) for parts in zip(*self._states[first:last], strict=True))
            flat, failures = _core.record(
                self._variants, self._recordings, self._items[first:last], qpos, qvel, nthread
            )
            rows = np.split(np.asarray(flat), np.cumsum(sizes[first:last])[:-1])
            yield list(zip(range(first, last), rows, failures, strict=True))
            first = last


def _variant(system: System) -> tuple[int, Any]:
    """Address of the model and parameters of the engine, None for MuJoCo's own step."""
    if isinstance(system, mujoco.MjModel):
        return system._address, None
    return system.model._address, system._parameters()
