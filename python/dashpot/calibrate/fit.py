"""Fit the parameters of a problem to its trajectories."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.inference.at_bounds import leaders
from dashpot.calibrate.inference.explanation import Explanation
from dashpot.calibrate.inference.explanations import explanations
from dashpot.calibrate.inference.identifiability import Evidence, judge
from dashpot.calibrate.inference.intervals import check_count
from dashpot.calibrate.inference.misfit_report import sizes_differ
from dashpot.calibrate.inference.noise_estimate import with_estimated_noise
from dashpot.calibrate.inference.settlement import End, reserve_for, settle
from dashpot.calibrate.inference.stated_noise import noise_explains, noise_overstated
from dashpot.calibrate.inference.sunk_bodies import warn_of_sunk_bodies
from dashpot.calibrate.problem.data_warnings import (
    refuse_strange_falls,
    warn_of_buried_starts,
    warn_of_held_turns,
    warn_of_noisy_starts,
)
from dashpot.calibrate.problem.idle_parameters import warn_of_idle_friction
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.setters import model_of
from dashpot.calibrate.provenance import provenance
from dashpot.calibrate.report.progress import ProgressBar
from dashpot.calibrate.residuals.checkpoint import Checkpoint
from dashpot.calibrate.residuals.losses import Loss, LossName
from dashpot.calibrate.residuals.objective import Objective
from dashpot.calibrate.residuals.whiteness import EXACT
from dashpot.calibrate.residuals.workers import Workers, checked_executor
from dashpot.calibrate.result import Fit
from dashpot.calibrate.search.advice import advice
from dashpot.calibrate.search.budget import Budget
from dashpot.calibrate.search.search import Search
from dashpot.calibrate.search.strategy import Method, finish, run_automatic, run_searches
from dashpot.checks import (
    flag,
    number,
    number_array,
    positive_count,
    positive_number,
    thread_count,
    whole_number,
)

Array = NDArray[np.float64]
Errors = Literal["auto", "independent", "clustered"]

# Clustered errors need many clusters to be estimated well; with fewer they are too small.
_MIN_CLUSTERS = 20


def fit(
    problem: Problem,
    *,
    method: Method = "least_squares",
    loss: LossName = "linear",
    loss_scale: float = 1.0,
    windows: Sequence[float] | None = None,
    starts: int | None = None,
    local_searches: int = 4,
    max_evaluations: int = 2000,
    errors: Errors = "auto",
    confidence: float = 0.95,
    seed: int = 0,
    nthread: int | None = None,
    progress: bool = False,
    executor: Executor | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> Fit:
    """Estimate the parameters of `problem` and say what the data identify.

    A trajectory with impacts makes a cost with many valleys. Shortly after the first impact there
    are few, so `windows` can be searched first, each from the last one's estimate, before the
    problem's own window. `starts` spreads further starts over the bounds. Where neither is given,
    both are chosen. First come values at which parameters begin to act that do not (friction that
    always holds), then 31 more starts and windows that grow from the onset of contact. Least
    squares takes them only where the stated noise does not explain the residuals at the end of a
    search from the parameters' own start. It searches from the best starts in turn. The others take
    them at once, from the best start. A model that is not quite right explains no end, and such
    fits spend most of their budget on better ones; ``starts=0`` saves that. What noise explains may
    be a bad valley yet. The cost is then followed along each parameter to its bounds, all other
    unknowns refitted, and the search goes on from where it is lower, if anywhere (see
    `dashpot.calibrate.inference.settlement`). On rough ground, as of blocks that slide from the
    first frame on, a search ends where the cost changes by a small part of what one standard error
    does.

    What was not measured, or carries no noise (see `Problem`), counts as no residual in any of
    this.

    Standard errors are scaled with the residuals, as `scipy.optimize.curve_fit` does without
    ``absolute_sigma``: noise stated too small or too large by the same factor everywhere changes
    no interval. But where residuals are far larger than stated, no parameter counts as identified
    (unless errors are clustered). The model is not right then, and scaling does not tell what that
    does to the estimates. Noise stated too large would hide that, so residuals have to be white
    too. In a bad valley, or of a model that is not right, those of neighbouring frames are alike.
    Noise that is so itself, as of a tracker that smooths, counts as such a misfit; of every third
    frame alone it may be white.

    Intervals are those of a linear model over their own width, and contain what it leaves over
    (see `dashpot.calibrate.inference.statistical_linearization`). They go on to where the cost
    itself has risen by as much as their confidence asks for. Around the end of a search that has
    not converged they are rougher, and no parameter counts as identified.

    Parameters
    ----------
    problem
        What moves, what is unknown, what was observed.
    method
        ``"least_squares"``: trust-region Gauss-Newton with a finite-difference Jacobian, one
        parallel batch each. ``"cma"``: CMA-ES over the parameters, one parallel batch per
        generation, for costs with many valleys; initial states stay where they start.
        ``"cma+least_squares"``: CMA-ES in the first window with at most half of the budget, least
        squares from there.
    loss
        ``"linear"`` or a robust loss of `scipy.optimize.least_squares`, for data with outliers.
        What the noise explains is then read off the smaller 70 % of the residuals (see
        `Fit.residual_variance`). Searches go on to further starts where more than a tenth of the
        residuals are beyond four standard deviations, or noise does not explain the others.
    loss_scale
        Weighted residual (in standard deviations) from which a robust loss counts as outlying, > 0;
        the ``"linear"`` one has no use for it.
    windows
        Seconds; ascending windows to search first, shorter than the problem's. None: none, or,
        where `starts` is None too, chosen (at most three, at 1/8, 1/4 and 1/2 of the time after the
        onset of contact).
    starts
        Number of extra starts, spread over the parameters' ranges by a Sobol sequence and evaluated
        in one batch; those whose simulation fails are left out. None: none, or, where `windows` is
        None too, chosen: 31. The search of ``method="least_squares"`` from the given start
        then takes at most half of the budget, and all of one that does not suffice for a search
        from others.
    local_searches
        At most how many of the best starts are searched from, >= 1; one after the other until the
        stated noise explains the residuals. CMA-ES starts from the best alone.
    max_evaluations
        Budget in simulated sets of trajectories, as ``Fit.evaluations`` counts them: of the search,
        its derivatives, and the intervals, for which searches leave up to half of it where they
        converge. It may be overrun by one batch of derivatives. Where it leaves too little for
        intervals, statements say so.
    errors
        ``"independent"`` residuals; ``"clustered"``: residuals of a trajectory hang together
        (model error); ``"auto"``: clustered from 20 trajectories on and five per unknown.
    confidence
        Of the intervals, in (0, 1).
    seed
        Of starts, CMA-ES and the points that intervals come from.
    nthread
        Number of threads, >= 1. None: one per core. The result does not depend on it.
    progress
        Show a progress bar.
    executor
        Any `concurrent.futures.Executor`, which simulates in place of threads here: of processes,
        ``client.get_executor()`` of Dask, or MPI's (``mpi4py.futures.MPIPoolExecutor``). Of Ray any
        object will do whose ``submit(function, *args)`` returns
        ``ray.remote(function).remote(*args).future()``. The result is the same bit for bit. The
        problem has to be one that can be pickled; functions of a notebook or a script are where
        cloudpickle is installed, as it is with Dask and Ray.
    checkpoint
        A file, ``fit.npz``, that keeps what is simulated: where it is there, the fit goes on from
        it to the same bits, and repeats nothing. It is written every ten seconds or more, at an
        exception (an interrupt, a worker that was killed), and at the end.

    Raises
    ------
    TypeError
        If `problem` is no `Problem`, or an option is not of its type.
    ValueError
        For options out of range, and where there are no more residuals than unknowns. Where bodies
        fall as if times were in milliseconds or microseconds, naming the trajectory. Where the
        start, or all that is tried, cannot be built or simulated, naming trajectory and values.
        Other candidates that fail count as infinitely bad.

    Warns
    -----
    UserWarning
        Of data that were hardly meant so, as first frames that have a body deep in the floor. Of
        rotations that are held, since nothing measured them. Of friction that has no effect between
        its bounds. Where a body sinks through a geom in the simulation with the estimate.

    Examples
    --------
    >>> result = fit(problem, starts=0)
    >>> estimate = result["restitution"]
    >>> estimate.identified, f"{estimate.value:.2f}"
    (True, '0.60')
    """
    if not isinstance(problem, Problem):
        raise TypeError(f"problem is {type(problem).__name__}; it must be a calibrate.Problem")
    for name, value, known in (
        ("method", method, Method), ("loss", loss, LossName), ("errors", errors, Errors)
    ):  # fmt: skip
        if value not in get_args(known):
            raise ValueError(f"{name} must be one of {', '.join(get_args(known))}, got {value!r}")
    chosen_loss = Loss(loss, positive_number("loss_scale", loss_scale))
    first_windows = _windows(() if windows is None else windows)
    automatic = starts is None and windows is None
    starts = 0 if starts is None else whole_number("starts", starts, lowest=0)
    local_searches = positive_count("local_searches", local_searches)
    max_evaluations = positive_count("max_evaluations", max_evaluations)
    if not 0 < number("confidence", confidence) < 1:
        raise ValueError(f"confidence must be in (0, 1), got {confidence!r}")
    seed = whole_number("seed", seed, lowest=0)
    progress = flag("progress", progress)
    threads = thread_count(nthread)
    began = time.perf_counter()
    if problem.window is not None and first_windows and first_windows[-1] >= problem.window:
        raise ValueError(
            f"windows end with {first_windows[-1]:g} s; they must be shorter than the problem's, "
            f"{problem.window:g} s"
        )
    stages = [problem.with_window(w) for w in first_windows] + [problem]
    chosen = checked_executor(executor)
    workers = None if chosen is None else Workers(chosen)
    kept = None if checkpoint is None else Checkpoint(checkpoint)
    objectives = [
        Objective(stage, nthread=threads, workers=workers, checkpoint=kept) for stage in stages
    ]
    objective = objectives[-1]
    problem = objective.problem
    check_count(objective.measured_count, objective.unknowns)
    errors_kind = _errors_kind(errors, problem, objective)
    warn_of_noisy_starts(
        problem,
        ", and intervals are too narrow; give initial_qpos, or estimate the start with "
        "initial_state='pose_and_velocity'",
    )
    warn_of_held_turns(problem)
    warn_of_buried_starts(problem)
    refuse_strange_falls(problem)
    warn_of_idle_friction(problem)
    with kept or nullcontext(), ProgressBar(progress, max_evaluations) as bar:
        reserve = reserve_for(objective, max_evaluations, converges=method != "cma")
        budget = Budget(max_evaluations, bar.report, reserve)
        if automatic or not problem.unknowns:
            search = run_automatic(objective, budget, chosen_loss, method, local_searches, seed)
        else:
            search = run_searches(
                objectives, budget, chosen_loss, method, starts, local_searches, seed
            )
        if method != "cma" and problem.unknowns and not search.converged:
            # Better an estimate without much of an interval than an interval around no end.
            budget.release(keep=2 * search.iteration)
            finish(search)
        if problem.noise == "estimate":
            search = with_estimated_noise(search)
            objective = search.objective
            problem = objective.problem
        end = settle(search, errors_kind, confidence, seed)
        explained_by = explanations(search, end)
        if not search.converged:
            search.message = advice(search, max_evaluations)
        warn_of_sunk_bodies(objective, end.point, end.residuals)
    return _result(
        problem,
        objective,
        end,
        search,
        explained_by,
        evaluations=budget.spent,
        seconds=time.perf_counter() - began,
        method=method,
        errors=errors_kind,
        confidence=confidence,
        seed=seed,
    )


def _result(
    problem: Problem,
    objective: Objective,
    end: End,
    search: Search,
    explained_by: tuple[Explanation, ...],
    *,
    evaluations: int,
    seconds: float,
    method: str,
    errors: str,
    confidence: float,
    seed: int,
) -> Fit:
    point, residuals, estimated = end.point, end.residuals, end.covariance
    correlation = estimated.correlation
    counted = objective.live(residuals)
    live = int(np.count_nonzero(counted))
    variance, robust = estimated.residual_variance, search.loss.robust
    explained = noise_explains(variance, live, robust=robust)
    exact = all(channel.size < EXACT for channel in end.channels)
    wrong = not explained or (not exact and noise_overstated(variance, live, robust=robust))
    unfinished = None
    if not search.converged:
        unfinished = f"the search ended before it converged ({search.message})"
    elif end.failure is not None:
        unfinished = f"simulations next to the estimate fail ({end.failure})"
    elif end.elsewhere is not None:
        unfinished = f"the search ended in a bad valley (the cost is lower at {end.elsewhere})"
    elif not end.complete:
        unfinished = (
            f"max_evaluations = {search.budget.total} left too little to follow the cost along it, "
            "so that its interval may be too narrow"
        )
    leading = leaders(problem.unknowns, point[: objective.parameters], correlation)
    estimates = tuple(
        judge(
            Evidence(
                parameter=parameter,
                z=float(point[i]),
                standard_error=float(estimated.standard_error[i]),
                interval=(float(end.intervals[i, 0]), float(end.intervals[i, 1])),
                correlation=correlation[i],
                names=tuple(p.name for p in problem.unknowns),
                confidence=confidence,
                unfinished=unfinished,
                size=math.sqrt(variance) if wrong or sizes_differ(end.channels) else None,
                channels=end.channels,
                clustered=errors == "clustered",
                widening=float(estimated.widening[i]),
                nonlinearity=float(end.departure[i]),
                leader=leading[i],
            )
        )
        for i, parameter in enumerate(problem.unknowns)
    )
    velocity, displacement = objective.initial_estimates(point)
    return Fit(
        estimates=estimates,
        correlation=correlation,
        channel_residuals=tuple(objective.by_channel(residuals)),
        cost=float(search.costs(residuals)),
        cost_history=np.array(search.budget.history),
        residual_variance=variance,
        live_residuals=live,
        evaluations=evaluations,
        seconds=seconds,
        method=method,
        loss=search.loss.name,
        loss_scale=search.loss.scale,
        errors=errors,
        confidence=confidence,
        converged=search.converged,
        message=search.message,
        channels=end.channels,
        explanations=explained_by,
        problem=problem,
        initial_velocity=velocity,
        initial_displacement=displacement,
        frame_pace=objective.frame_pace(point),
        made=provenance(model_of(problem.bare_system()), seed),
    )


def _errors_kind(errors: Errors, problem: Problem, objective: Objective) -> str:
    clusters = len(problem.trajectories)
    if errors == "auto":
        enough = clusters >= _MIN_CLUSTERS and clusters >= 5 * objective.parameters
        return "clustered" if enough else "independent"
    if errors == "clustered" and clusters < 2:
        raise ValueError("errors='clustered' needs at least two trajectories")
    return errors


def _windows(windows: Sequence[float]) -> list[float]:
    array = number_array("windows", windows)
    if array.ndim != 1:
        raise TypeError(f"windows must be a sequence of numbers, got {windows!r}")
    if not (array > 0).all() or (np.diff(array) <= 0).any():
        raise ValueError(f"windows must be > 0 and ascend, got {tuple(windows)}")
    return [float(window) for window in array]
