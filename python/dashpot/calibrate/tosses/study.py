"""Prediction errors of cube tosses: fit on some, evaluate on the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.fit import fit
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.residuals.objective import Objective
from dashpot.calibrate.result import Fit
from dashpot.calibrate.search.strategy import Method
from dashpot.calibrate.tosses.cube import Cube
from dashpot.calibrate.tosses.flight import LENGTH_SCALE, Toss, flight_frames
from dashpot.calibrate.tosses.problems import toss_problem, weighed
from dashpot.checks import thread_count

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Errors:
    """Prediction errors of a set of tosses.

    Attributes
    ----------
    position
        (tosses,) time mean of the distance over the width, percent; over all frames after the
        first, which is given.
    rotation
        (tosses,) time mean of the angle, degrees; over the same frames.
    contact_position, contact_rotation
        The same over the frames from the first contact on.
    """

    position: Array
    rotation: Array
    contact_position: Array
    contact_rotation: Array

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
    """Return the prediction errors of `values` on the tosses of a problem, fitted or unseen.

    Parameters
    ----------
    problem
        As `toss_problem` makes it.
    values
        All parameters by name.
    cube
        Its half width is the scale of errors of position and says where contact begins.
    nthread
        Number of threads, >= 1. None: one per core.
    """
    objective = Objective(problem, nthread=thread_count(nthread))
    point = np.array([p.coordinate.to_search(values[p.name]) for p in objective.unknown])
    residuals = objective.residuals(point)[0]
    errors = np.empty((len(problem.trajectories), 4))
    for t, toss in enumerate(problem.trajectories):
        rows = residuals[objective.offsets[t] : objective.offsets[t + 1]].reshape(-1, 6)
        distance = np.linalg.norm(rows[:, :3] * problem.position_sigma, axis=1)
        angle = np.linalg.norm(rows[:, 3:], axis=1) * problem.rotation_sigma
        first = flight_frames(toss.position[:, 0], toss.quaternion[:, 0], cube)
        first = min(first, len(rows) - 1)
        errors[t] = [part[k:].mean() for k in (1, first) for part in (distance, angle)]
    errors[:, ::2] *= 100.0 / (2.0 * cube.half_width)
    errors[:, 1::2] = np.rad2deg(errors[:, 1::2])
    return Errors(*errors.T)


@dataclass(frozen=True, eq=False)
class Study:
    """A fit on some tosses and its errors on the others.

    Attributes
    ----------
    fit
        The fit.
    cube
        The cube before it: with ``body`` that with the centre of mass of the flights.
    seen, unseen
        Errors on the tosses that were fitted and on the others.
    """

    fit: Fit
    cube: Cube
    seen: Errors
    unseen: Errors


def study(
    tosses: Sequence[Toss],
    *,
    peer: bool = False,
    body: bool = True,
    load: bool = False,
    fitted: int = 60,
    cube: Cube | None = None,
    length_scale: float = LENGTH_SCALE,
    substeps: int = 4,
    seed: int = 0,
    method: Method = "cma",
    starts: int = 0,
    max_evaluations: int = 240,
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
        Fit body properties too: the centre of mass to the flights of the fitted tosses, inertia
        and corner radius together with the contact parameters.
    load
        Fit how friction falls with load too; not with ``peer``.
    fitted
        Number of tosses to fit on, 1 <= fitted < len(tosses), with ``body`` at least 2.
    cube
        Body properties; None: the published ones.
    length_scale
        As in `fit_flight`.
    substeps
        Simulation steps per frame of 1/148 s.
    seed
        Chooses the tosses, and starts.
    method, starts, max_evaluations, nthread, progress
        As in `dashpot.calibrate.fit`. Whole rollouts make a cost with many valleys, which CMA-ES
        takes best.
    """
    if not 1 <= fitted < len(tosses):
        raise ValueError(f"fitted must be in [1, {len(tosses) - 1}], got {fitted!r}")
    shape = Cube() if cube is None else cube
    order = np.random.default_rng(seed).permutation(len(tosses))
    seen, unseen = (
        [tosses[i] for i in sorted(chosen)] for chosen in (order[:fitted], order[fitted:])
    )
    if body:
        shape = weighed(seen, shape, length_scale=length_scale)
    problem, others = (
        toss_problem(
            part,
            shape,
            peer=peer,
            body=body,
            load=load,
            length_scale=length_scale,
            substeps=substeps,
        )
        for part in (seen, unseen)
    )
    result = fit(
        problem,
        method=method,
        # Some tosses are beyond every model, and one of them lasts four times as long as others:
        # a loss that grows with their errors would go by them.
        loss="cauchy",
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
        shape,
        evaluate(problem, result.values, shape, nthread=nthread),
        evaluate(others, result.values, shape, nthread=nthread),
    )
