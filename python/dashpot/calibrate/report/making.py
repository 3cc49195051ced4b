"""What a report tells of a fit, found by simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import special

from dashpot.calibrate.inference.spread import Neighbourhood
from dashpot.calibrate.problem.setters import model_of
from dashpot.calibrate.problem.units import parameter_unit
from dashpot.calibrate.report.channels import readings_of, shown, weighted_errors
from dashpot.calibrate.report.clips import clip
from dashpot.calibrate.report.record import Profile, Record, Shown
from dashpot.calibrate.residuals.losses import Loss
from dashpot.calibrate.residuals.objective import Objective
from dashpot.calibrate.result import Fit
from dashpot.checks import thread_count
from dashpot.engine import Engine

if TYPE_CHECKING:
    from collections.abc import Mapping

    from dashpot.calibrate.prediction import Prediction

Array = NDArray[np.float64]

_DRAWS = 16
_SEED = 0
# Variance of residuals of data without noise; values of a profile, in standard errors.
_NO_NOISE = 1e-6
_ALONG = np.array([-3.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 3.0])


def make_record(fit: Fit, nthread: int | None = None) -> Record:
    """Return what a report tells of a fit: some tens of simulated sets of its trajectories."""
    problem = fit.problem
    model = model_of(problem.build(fit.values))
    found = fit.predict(nthread=nthread)
    objective = Objective(problem, nthread=thread_count(nthread))
    note = ""
    draws: list[list[Mapping[str, Array]]] = [[] for _ in found]
    profiles: tuple[Profile, ...] = ()
    try:
        point = _point(fit, objective)
        around = Neighbourhood(objective, point)
        draws = _draws(fit, around, objective.nthread)
        profiles = _profiles(fit, objective, around, point)
    except ValueError as error:
        note = f"What the fit leaves open is not shown: {error}."
    trajectories = tuple(
        shown(problem, model, p.trajectory, [readings_of(p), *own], residuals)
        for p, own, residuals in zip(found, draws, fit.channel_residuals, strict=True)
    )
    return Record(
        stepper="dashpot" if isinstance(problem.build(fit.values), Engine) else "MuJoCo",
        units={p.name: parameter_unit(p, problem, model) for p in problem.parameters},
        metrics=fit.metrics(),
        trajectories=trajectories,
        profiles=profiles,
        clips=tuple(
            clip(
                problem.build(fit.values, found[t].trajectory.name),
                found[t],
                problem.steps_per_frame(found[t].trajectory, model),
            )
            for t in median_and_worst(trajectories)
        ),
        note=note,
        noise="estimated" if problem.noise == "estimate" else "stated",
    )


def shown_predictions(fit: Fit, found: Sequence[Prediction]) -> tuple[Shown, ...]:
    """Return predictions of other trajectories as a report shows them."""
    others = [p.trajectory for p in found]
    problem = replace(fit.problem, trajectories=others, window=None)
    model = model_of(problem.build(fit.values))
    return tuple(
        shown(
            problem,
            model,
            p.trajectory,
            [readings_of(p)],
            weighted_errors(problem, p.trajectory, p),
        )
        for p in found
    )


def median_and_worst(trajectories: Sequence[Shown]) -> list[int]:
    """Return which trajectories have the middle and the largest residuals, one where it is both."""
    order = sorted(range(len(trajectories)), key=lambda t: trajectories[t].size)
    return list(dict.fromkeys([order[(len(order) - 1) // 2], order[-1]]))


def _point(fit: Fit, objective: Objective) -> Array:
    """Return the estimate as a point of the search."""
    own = [
        p.coordinate.to_search(e.value)
        for p, e in zip(fit.problem.unknowns, fit.estimates, strict=True)
    ]
    point = np.concatenate([own, fit.states])
    if point.size != objective.size:
        raise ValueError("the fit has unknowns that its values do not tell")
    return point


def _draws(fit: Fit, around: Neighbourhood, nthread: int) -> list[list[Mapping[str, Array]]]:
    """Return by trajectory what is simulated at draws of all unknowns; those that fail are not."""
    parameters = fit.problem.unknowns
    drawn = np.array(
        [
            [p.coordinate.to_search(values[p.name]) for p in parameters]
            for values in fit.sample(_DRAWS, seed=_SEED)
        ]
    )
    whole = Objective(fit.problem.with_window(None), nthread=nthread)
    noise = np.random.default_rng(_SEED)
    points = around.points(drawn, noise, float(np.sqrt(fit.residual_variance)))
    result: list[list[Mapping[str, Array]]] = [[] for _ in fit.problem.trajectories]
    for point in points:
        try:
            observed = whole.observe(point)
        except ValueError:
            continue
        for own, one in zip(result, observed, strict=True):
            own.append(one)
    return result


def _unit_of_rise(fit: Fit, rise: Array) -> float:
    """Return what a rise of the cost is measured in: the variance of the residuals.

    Where errors are clustered, or there is no noise, intervals do not go by that: it is then what
    makes the middle of the profile a parabola that reaches 1 at one standard error.
    """
    if fit.errors != "clustered" and fit.residual_variance > _NO_NOISE:
        return fit.residual_variance
    inner = (np.abs(_ALONG) <= 1.0) & (_ALONG != 0.0) & np.isfinite(rise)
    steepness = float(np.mean(rise[inner] / _ALONG[inner] ** 2)) if inner.any() else 0.0
    return steepness if steepness > 0.0 else 1.0


def _profiles(
    fit: Fit, objective: Objective, around: Neighbourhood, point: Array
) -> tuple[Profile, ...]:
    """Return the cost along each parameter that has a standard error, within its bounds."""
    loss = Loss(fit.loss, fit.loss_scale)
    count = objective.parameters
    quantile = float(special.ndtri(0.5 + 0.5 * fit.confidence))
    coordinates = [p.coordinate for p in fit.problem.unknowns]
    errors = np.array(
        [
            (c.to_search(e.upper) - c.to_search(e.lower)) / (2.0 * quantile)
            if np.isfinite(e.standard_error)
            else 0.0
            for c, e in zip(coordinates, fit.estimates, strict=True)
        ]
    )
    lower, upper = (bound[:count] for bound in objective.bounds())
    begin = float(loss.values(objective.residuals(point)[0]).sum())
    result = []
    for i in np.flatnonzero(errors > 0.0):
        moved = np.outer(_ALONG, errors * fit.correlation[i])
        moved[:, i] = _ALONG * errors[i]
        parameters = np.clip(point[:count] + moved, lower, upper)
        found, _ = objective.attempt(around.points(parameters, None, 0.0))
        cost = np.full(len(found), np.nan)
        fine = np.isfinite(found).all(axis=1)
        cost[fine] = [float(loss.values(row).sum()) for row in found[fine]]
        result.append(
            Profile(
                fit.estimates[i].name,
                np.array([coordinates[i].to_value(float(z)) for z in parameters[:, i]]),
                (cost - begin) / _unit_of_rise(fit, cost - begin),
            )
        )
    return tuple(result)
