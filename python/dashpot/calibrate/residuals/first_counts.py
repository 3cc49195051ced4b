"""How many residuals functions of the user's own return: found by simulating the start once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.own_residuals import ResidualError
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.sensing import sensing
from dashpot.calibrate.problem.setters import model_of
from dashpot.calibrate.residuals.candidates import Batch, Candidate, failure_of
from dashpot.calibrate.residuals.recorder import Recorder

Array = NDArray[np.float64]


def with_counts(
    problem: Problem,
    model: mujoco.MjModel,
    values: Mapping[str, float],
    qpos: Array,
    qvel: Array,
    nthread: int,
) -> Problem:
    """Return the problem, its functions knowing how many residuals each trajectory has.

    Parameters
    ----------
    problem, model
        What is simulated; trajectories of which all is known, or less than the whole is used, are
        not.
    values, qpos, qvel
        Of the parameters, and initial states of the trajectories.
    nthread
        Number of threads.

    Raises
    ------
    SimulationError
        Where the simulation fails, or a function of it.
    TypeError, ValueError
        Where a function returns no residuals, or nothing is left to compare.
    """
    asked = [
        t
        for t, trajectory in enumerate(problem.trajectories)
        if any(trajectory.name not in own.counts for own in problem.own.values())
        and (problem.window is None or trajectory.head(problem.window) is trajectory)
    ]
    if not asked:
        return problem
    trajectories = [problem.trajectories[t] for t in asked]
    systems = [problem.build(values, trajectory.name) for trajectory in trajectories]
    recorders = [Recorder(problem, trajectory, model) for trajectory in trajectories]
    pace = np.ones(len(asked))
    candidate = Candidate(dict(values), systems, qpos[asked], qvel[asked], pace)
    counts: dict[str, dict[str, int]] = {name: {} for name in problem.own}
    batch = Batch({0: candidate}, recorders)
    for some in batch.record(nthread):
        for simulation, row, failure in some:
            if failure:
                raise failure_of(values, failure)
            for _, k in batch.users[simulation]:
                trajectory, recorder = trajectories[k], recorders[k]
                seen = sensing(
                    problem.sensing_setters(trajectory), [values], [model_of(systems[k])]
                )
                readings, _ = recorder.readings(row[None], seen, pace[:1])
                named = {
                    channel.name: reading[0]
                    for channel, reading in zip(recorder.channels, readings, strict=True)
                }
                simulated = recorder.simulated(
                    row.reshape(recorder.recording(1.0).shape), named, 1.0
                )
                for name, own in problem.own.items():
                    try:
                        counts[name][trajectory.name] = own(simulated, trajectory).size
                    except ResidualError as error:
                        raise failure_of(values, error) from error
    known = {name: own.with_counts(counts[name]) for name, own in problem.own.items()}
    result = replace(problem, residuals=known)
    for trajectory in result.trajectories:
        if not any(channel.measured.any() for channel in result.channels(trajectory)):
            raise ValueError(
                f"trajectory '{trajectory.name}': nothing was measured of it, and functions return "
                "no residuals"
            )
    return result
