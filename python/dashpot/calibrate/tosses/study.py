"""Prediction errors of cube tosses: fit on some, evaluate on the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.fit import Method, fit
from dashpot.calibrate.objective import Objective
from dashpot.calibrate.problem import Problem
from dashpot.calibrate.result import Fit
from dashpot.calibrate.tosses.cube import Cube
from dashpot.calibrate.tosses.flight import Toss, trajectory
from dashpot.calibrate.tosses.problems import body_problem, dashpot_problem, mujoco_problem
from dashpot.checks import thread_count

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Errors:
    """Prediction errors of a set of tosses.

    Attributes
    ----------
    position
        (tosses,) time mean of the distance over the width, percent.
    rotation
        (tosses,) time mean of the angle, degrees.
    """

    position: Array
    rotation: Array

    @property
    def mean_position(self) -> float:
        """Mean over the tosses, percent of the width."""
        return float(self.position.mean())

    @property
    def mean_rotation(self) -> float:
        """Mean over the tosses, degrees."""
        return float(self.rotation.mean())


def evaluate(
    problem: Problem, values: Mapping[str, float], cube: Cube, *, nthread: int | None = None
) -> Errors:
    """Return the prediction errors of `values` on the tosses of a problem, fitted or unseen."""
    objective = Objective(problem, nthread=thread_count(nthread))
    point = np.array(
        [c.to_search(values[n]) for c, n in zip(objective.coordinates, problem.names, strict=True)]
    )
    residuals = objective.residuals(point)[0]
    count = len(problem.trajectories)
    position = np.empty(count)
    rotation = np.empty(count)
    for t in range(count):
        rows = residuals[objective.offsets[t] : objective.offsets[t + 1]].reshape(-1, 6)[1:]
        distance = np.linalg.norm(rows[:, :3], axis=1) * problem.position_sigma
        angle = np.linalg.norm(rows[:, 3:], axis=1) * problem.rotation_sigma
        position[t] = 100.0 * distance.mean() / (2.0 * cube.half_width)
        rotation[t] = np.rad2deg(angle.mean())
    return Errors(position, rotation)


@dataclass(frozen=True, eq=False)
class Study:
    """A fit on some tosses and its errors on the others."""

    fit: Fit
    seen: Errors
    unseen: Errors


def study(
    tosses: Sequence[Toss],
    *,
    peer: bool = False,
    body: bool = False,
    fitted: int = 60,
    cube: Cube | None = None,
    length_scale: float = 1.0,
    substeps: int = 4,
    seed: int = 0,
    method: Method = "least_squares",
    starts: int = 16,
    max_evaluations: int = 120,
    nthread: int | None = None,
    progress: bool = False,
) -> Study:
    """Fit on `fitted` tosses chosen by `seed`, evaluate on all others.

    Parameters
    ----------
    tosses
        As `dashpot.data.load_cube_tosses` returns them.
    peer
        Tune MuJoCo instead of dashpot, the same way.
    body
        Fit body properties too: inertia, centre of mass, corner radius.
    fitted
        Number of tosses to fit on, 1 <= fitted < len(tosses).
    cube
        Body properties; None: the published ones.
    length_scale
        As in `trajectory`.
    substeps
        Simulation steps per frame of 1/148 s.
    seed
        Chooses the tosses, and starts.
    method, starts, max_evaluations, nthread, progress
        As in `dashpot.calibrate.fit`.
    """
    if not 1 <= fitted < len(tosses):
        raise ValueError(f"fitted must be in [1, {len(tosses) - 1}], got {fitted!r}")
    shape = Cube() if cube is None else cube
    order = np.random.default_rng(seed).permutation(len(tosses))
    seen, unseen = (
        _study_problem(
            [tosses[i] for i in sorted(chosen)], shape, peer, body, length_scale, substeps
        )
        for chosen in (order[:fitted], order[fitted:])
    )
    result = fit(
        seen,
        method=method,
        loss="soft_l1",
        starts=starts,
        local_searches=1,
        max_evaluations=max_evaluations,
        errors="clustered",
        seed=seed,
        nthread=nthread,
        progress=progress,
    )
    return Study(
        result,
        evaluate(seen, result.values, shape, nthread=nthread),
        evaluate(unseen, result.values, shape, nthread=nthread),
    )


def _study_problem(
    tosses: Sequence[Toss],
    cube: Cube,
    peer: bool,
    body: bool,
    length_scale: float,
    substeps: int,
) -> Problem:
    if body:
        return body_problem(tosses, cube, peer=peer, length_scale=length_scale, substeps=substeps)
    trajectories = [trajectory(toss, cube, length_scale=length_scale) for toss in tosses]
    return (mujoco_problem if peer else dashpot_problem)(trajectories, cube, substeps=substeps)
