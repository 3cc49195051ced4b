"""Residuals by the workers of an executor: processes of this machine, of a cluster, of Dask.

Points are many and trajectories may be, and every pair of the two is simulated by itself. Where
there are trajectories enough, a job is some of them at all points; else it is all of them at some
points. What a job returns depends on nothing else, so that results are the same bit for bit as on
threads, however many workers there are.

Jobs carry their problem, pickled; a worker keeps those it has seen.
"""

from __future__ import annotations

import hashlib
import importlib.util
import itertools
import pickle
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.residuals.candidates import SimulationError

if TYPE_CHECKING:
    from dashpot.calibrate.residuals.objective import Objective

Array = NDArray[np.float64]

# Workers are asked for more jobs than they are, so that none waits long for the slowest.
_JOBS_PER_WORKER = 3
_FEW_TRAJECTORIES = 8
_MOST_KEPT = 64


class Workers:
    """An executor that simulates for objectives.

    Parameters
    ----------
    executor
        Any with ``submit`` of `concurrent.futures.Executor`; it is not shut down.
    """

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self._sent: dict[tuple[int, int, int], bytes] = {}
        self._problems: list[Problem] = []  # alive, so that their ids stay theirs

    def attempt(
        self, objective: Objective, points: Array
    ) -> tuple[Array, dict[int, SimulationError]]:
        """Return residuals (points, residual_count), infinite where one fails, and why, by row."""
        residuals = np.full((len(points), objective.residual_count), np.inf)
        problem, held = objective.problem, objective.held
        jobs: list[tuple[NDArray[np.intp], slice, Future[Any]]] = []
        try:
            for rows, first, last in self._parts(objective, len(points)):
                payload = self._payload(problem, first, last)
                own = objective.points_of(points[rows], first, last)
                future = self._executor.submit(_attempt, payload, held, own)
                columns = slice(objective.offsets[first], objective.offsets[last])
                jobs.append((rows, columns, future))
            found = [(rows, columns, *future.result()) for rows, columns, future in jobs]
        except BaseException:
            for _, _, future in jobs:
                future.cancel()
            raise
        failures: dict[int, SimulationError] = {}
        for rows, columns, part, why in found:
            residuals[rows, columns] = part
            for row, message in why.items():
                failures.setdefault(int(rows[row]), SimulationError(message))
        residuals[list(failures)] = np.inf
        return residuals, failures

    def _parts(self, objective: Objective, points: int) -> list[tuple[NDArray[np.intp], int, int]]:
        """Return jobs: rows of points, and the range of the trajectories."""
        trajectories = len(objective.recorders)
        count = _JOBS_PER_WORKER * worker_count(self._executor)
        rows = np.arange(points)
        if trajectories < _FEW_TRAJECTORIES or objective.problem.start_states is not None:
            return [(part, 0, trajectories) for part in np.array_split(rows, min(count, points))]
        edges = np.linspace(0, trajectories, min(count, trajectories) + 1).astype(int)
        return [(rows, first, last) for first, last in itertools.pairwise(edges.tolist())]

    def _payload(self, problem: Problem, first: int, last: int) -> bytes:
        key = (id(problem), first, last)
        if key not in self._sent:
            if not any(problem is known for known in self._problems):
                self._problems.append(problem)
            part = problem
            if (first, last) != (0, len(problem.trajectories)):
                part = replace(problem, trajectories=problem.trajectories[first:last])
            self._sent[key] = _pickled(part)
        return self._sent[key]


def worker_count(executor: Executor) -> int:
    """Return how many workers an executor says it has, and 8 where it does not."""
    client = getattr(executor, "_client", None)  # of Dask
    if client is not None:
        return max(1, int(sum(client.nthreads().values())))
    return int(getattr(executor, "_max_workers", 8))


def _pickled(problem: Problem) -> bytes:
    # It takes functions of notebooks, too; Dask and Ray bring it along.
    found = importlib.util.find_spec("cloudpickle") is not None
    module = importlib.import_module("cloudpickle" if found else "pickle")
    try:
        return bytes(module.dumps(problem))
    except Exception as error:
        named = [f", residuals {o.name!r}" for o in problem.own.values() if not _fits(module, o)]
        raise TypeError(
            "an executor needs a problem that can be pickled: functions that build systems or set "
            f"parameters{''.join(named)} have to be those of a module, or cloudpickle installed "
            f"({error})"
        ) from error


def _fits(module: Any, value: object) -> bool:
    try:
        module.dumps(value)
    except Exception:
        return False
    return True


_kept: OrderedDict[tuple[str, str], Objective] = OrderedDict()


def _attempt(
    payload: bytes, held: Mapping[str, float] | None, points: Array
) -> tuple[Array, dict[int, str]]:
    """Simulate in a worker: return residuals, and by row why one fails."""
    from dashpot.calibrate.residuals.objective import Objective

    key = (hashlib.sha256(payload).hexdigest(), repr(held))
    objective = _kept.get(key)
    if objective is None:
        # What comes from the process that asked for it is its own.
        objective = _kept[key] = Objective(pickle.loads(payload), nthread=1, held=held)
        while len(_kept) > _MOST_KEPT:
            _kept.popitem(last=False)
    residuals, failures = objective.simulate(points)
    return residuals, {row: str(failure) for row, failure in failures.items()}


def checked_executor(executor: object) -> Executor | None:
    """Return an executor, or None; raise TypeError where it is none."""
    if executor is None or callable(getattr(executor, "submit", None)):
        return executor  # type: ignore[return-value]
    raise TypeError(
        "executor must have submit() as concurrent.futures.Executor has, "
        f"got {type(executor).__name__}"
    )


__all__: Sequence[str] = ("Workers", "checked_executor", "worker_count")
