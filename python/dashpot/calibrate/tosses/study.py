"""Prediction errors of cube tosses: fit on some, evaluate on the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.fit import fit
from dashpot.calibrate.flights import with_flights
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.result import Fit
from dashpot.calibrate.search.strategy import Method
from dashpot.calibrate.tosses.cube import Cube
from dashpot.calibrate.tosses.errors import Errors, errors_of, evaluate
from dashpot.calibrate.tosses.flight import LENGTH_SCALE, Toss
from dashpot.calibrate.tosses.problems import toss_problem, weighed

Array = NDArray[np.float64]
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Study:
    """A fit on some tosses and its errors on the others.

    Attributes
    ----------
    fit
        The fit.
    seen, unseen
        Errors on the tosses that were fitted and on the others.
    cube
        The cube before it: with ``body`` that with the centre of mass of the flights. None of
        others.

    Examples
    --------
    >>> from dashpot.calibrate import tosses as study
    >>> quick = {"method": "least_squares", "starts": 0, "max_evaluations": 20}
    >>> found = study.study(tosses[:4], fitted=2, **quick)
    >>> found.seen.position.shape, found.fit.problem.names
    ((2,), ('stiffness', 'damping_ratio', 'sliding_friction', 'inertia', 'corner_radius'))
    """

    fit: Fit
    seen: Errors
    unseen: Errors
    cube: Cube | None = None


def fit_and_predict(
    problem: Problem,
    *,
    fitted: int,
    width: float,
    window: float | None = None,
    clearance: float = 0.003,
    seed: int = 0,
    method: Method = "cma",
    starts: int = 0,
    max_evaluations: int = 240,
    nthread: int | None = None,
    progress: bool = False,
) -> Study:
    """Fit on `fitted` of the tosses of any body, chosen by `seed`, and predict all others.

    Parameters
    ----------
    problem
        Of all tosses, one of whose bodies was observed, and hinges of it. With
        ``initial_state="pose_and_velocity"`` they start as their flights say
        (`dashpot.calibrate.with_flights`). Its window is that of the fit.
    fitted
        Number of tosses to fit on, 1 <= fitted < number of tosses.
    width
        Scale of errors of position, m.
    window
        Seconds from the first frame over which errors are means. None: to the end.
    clearance
        Of flights, m.
    seed
        Chooses the tosses, and starts.
    method, starts, max_evaluations, nthread, progress
        As in `dashpot.calibrate.fit`.

    Examples
    --------
    >>> from dashpot.calibrate import tosses as study
    >>> problem = study.toss_problem(tosses[:4], study.Cube())
    >>> quick = {"method": "least_squares", "starts": 0, "max_evaluations": 20}
    >>> found = study.fit_and_predict(problem, fitted=2, width=0.1, **quick)
    >>> found.unseen.position.shape
    (2,)
    """
    if problem.initial_state != "given":
        problem = with_flights(problem, clearance=clearance, nthread=nthread)
    seen, unseen = (
        replace(problem, trajectories=part) for part in split(problem.trajectories, fitted, seed)
    )
    result = _fitted(
        seen,
        method=method,
        starts=starts,
        max_evaluations=max_evaluations,
        seed=seed,
        nthread=nthread,
        progress=progress,
    )
    known, others = (
        errors_of(part.with_window(window), result.values, width, nthread=nthread)
        for part in (seen, unseen)
    )
    return Study(result, known, others)


def split(tosses: Sequence[T], fitted: int, seed: int) -> tuple[list[T], list[T]]:
    """Return the tosses to fit on, drawn by `seed`, and the others.

    Examples
    --------
    >>> from dashpot.calibrate import tosses as study
    >>> fitted, others = study.split(tosses, 100, seed=0)
    >>> len(fitted), len(others)
    (100, 300)
    """
    if not 1 <= fitted < len(tosses):
        raise ValueError(f"fitted must be in [1, {len(tosses) - 1}], got {fitted!r}")
    order = np.random.default_rng(seed).permutation(len(tosses))
    seen, unseen = (
        [tosses[i] for i in sorted(chosen)] for chosen in (order[:fitted], order[fitted:])
    )
    return seen, unseen


def _fitted(problem: Problem, **options: Any) -> Fit:
    # Some tosses are beyond every model, and one of them lasts four times as long as others:
    # a loss that grows with their errors would go by them.
    return fit(problem, loss="cauchy", local_searches=1, errors="clustered", **options)


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

    Examples
    --------
    >>> from dashpot.calibrate import tosses as study
    >>> quick = {"method": "least_squares", "starts": 0, "max_evaluations": 20}
    >>> found = study.study(tosses[:4], fitted=2, **quick)
    >>> found.unseen.position.shape
    (2,)
    """
    shape = Cube() if cube is None else cube
    seen, unseen = split(tosses, fitted, seed)
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
    result = _fitted(
        problem,
        method=method,
        starts=starts,
        max_evaluations=max_evaluations,
        seed=seed,
        nthread=nthread,
        progress=progress,
    )
    return Study(
        result,
        evaluate(problem, result.values, shape, nthread=nthread),
        evaluate(others, result.values, shape, nthread=nthread),
        shape,
    )
