"""What the recorders of a problem read of candidates, by parallel simulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.sensing import sensing
from dashpot.calibrate.problem.setters import model_of
from dashpot.calibrate.residuals.candidates import Batch, Candidate, SimulationError, failure_of
from dashpot.calibrate.residuals.recorder import Recorder

Array = NDArray[np.float64]


def readings_of(
    problem: Problem,
    recorders: Sequence[Recorder],
    candidates: Mapping[int, Candidate],
    failures: dict[int, SimulationError],
    nthread: int,
) -> Iterator[tuple[int, list[int], list[Array]]]:
    """Simulate candidates; yield a trajectory, some candidates, and what channels read of them.

    Candidates of which a simulation fails are added to `failures` in the end, each with that of
    its first trajectory that does.
    """
    if not candidates:
        return
    batch = Batch(candidates, recorders)
    setters = [problem.sensing_setters(t) for t in problem.trajectories]
    failed: dict[int, tuple[int, str]] = {}
    for some in batch.record(nthread):
        found: dict[int, tuple[list[int], list[Array]]] = {}
        for simulation, row, failure in some:
            for v, t in batch.users[simulation]:
                if failure:
                    failed[v] = min(failed.get(v, (t, failure)), (t, failure))
                    continue
                users, rows = found.setdefault(t, ([], []))
                users.append(v)
                rows.append(row)
        for t, (users, rows) in found.items():
            seen = sensing(
                setters[t],
                [candidates[v].values for v in users],
                [model_of(candidates[v].systems[t]) for v in users],
            )
            pace = np.array([candidates[v].pace[t] for v in users])
            readings, refused = recorders[t].readings(np.array(rows), seen, pace)
            for item, reason in refused.items():
                v = users[item]
                failed[v] = min(failed.get(v, (t, reason)), (t, reason))
            yield t, users, readings
    for v, (_, failure) in failed.items():
        failures[v] = failure_of(candidates[v].values, failure)
