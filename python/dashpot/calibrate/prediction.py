"""Simulate trajectories with given parameter values, and compare."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, get_args

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.inference.intervals import check_count
from dashpot.calibrate.problem.channels import POSES
from dashpot.calibrate.problem.data_warnings import warn_of_noisy_starts
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.residuals.losses import Loss, LossName
from dashpot.calibrate.residuals.objective import Objective
from dashpot.calibrate.residuals.poses import rotation_between
from dashpot.calibrate.search.budget import Budget
from dashpot.calibrate.search.least_squares import least_squares
from dashpot.calibrate.search.search import Search
from dashpot.checks import number, positive_number, thread_count
from dashpot.tables import table_html, table_text

if TYPE_CHECKING:
    from rich.table import Table

Array = NDArray[np.float64]

# Of the search for initial states, whose cost is smooth before contact and takes a few.
_MOST_ITERATIONS = 40


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a model says of one trajectory: poses at all of its frames, errors beside.

    Attributes
    ----------
    trajectory
        What was observed; times and bodies are its own.
    position
        (frames, bodies, 3) simulated origin of the body frame in the world, m.
    quaternion
        (frames, bodies, 4) simulated orientation body to world, scalar first.
    position_error
        (frames, bodies, 3) simulated less observed position in the world, m; NaN where that
        was not measured.
    rotation_error
        (frames, bodies, 3) rotation vector of ``R_observed^T R_simulated``, rad; NaN likewise.
    initial_qpos
        (nq,) where the simulation started.
    initial_qvel
        (nv,)
    sensors
        By name, (frames, size) simulated readings of the sensors that were observed, in their
        units; NaN at the first frame of those that are means.
    sensor_errors
        By name, (frames, size) simulated less observed. Angles of hinges that are read within a
        turn are counted on where it ends.
    moments
        By kind, simulated times of events (s, on the clock of the trajectory) and scalars.
    residuals
        By function of the problem's own, (n,) what it returns.

    Examples
    --------
    >>> (prediction,) = result.predict()
    >>> float(np.abs(prediction.position_error).max()) < 5e-4  # m
    True
    """

    trajectory: Trajectory
    position: Array = field(repr=False)
    quaternion: Array = field(repr=False)
    position_error: Array = field(repr=False)
    rotation_error: Array = field(repr=False)
    initial_qpos: Array = field(repr=False)
    initial_qvel: Array = field(repr=False)
    sensors: Mapping[str, Array] = field(default_factory=dict, repr=False)
    sensor_errors: Mapping[str, Array] = field(default_factory=dict, repr=False)
    moments: Mapping[str, Array] = field(default_factory=dict, repr=False)
    residuals: Mapping[str, Array] = field(default_factory=dict, repr=False)

    def __str__(self) -> str:
        """Return the errors as a table of text."""
        return str(Predictions([self]))

    def _repr_html_(self) -> str:
        """Return the errors as a table for notebooks."""
        return Predictions([self])._repr_html_()


class Predictions(tuple[Prediction, ...]):
    """Predictions of several trajectories; a tuple that shows their errors as a table."""

    __slots__ = ()

    def table(self) -> Table:
        """Return a rich table of root mean square errors, one row for each trajectory."""
        from dashpot.calibrate.report.prediction_report import prediction_table

        return prediction_table(self)

    def __str__(self) -> str:
        """Return the table as text."""
        return table_text(self.table())

    def _repr_html_(self) -> str:
        """Return the table for notebooks."""
        return table_html(self.table())


def predict(
    problem: Problem,
    values: Mapping[str, float],
    trajectories: Sequence[Trajectory] | None = None,
    *,
    head: float | None = None,
    loss: LossName = "linear",
    loss_scale: float = 1.0,
    nthread: int | None = None,
) -> Predictions:
    """Simulate trajectories to their ends with `values`, as a fit does, and compare.

    A simulation starts somewhere. Without `head` it starts in the state that the trajectory carries
    (or that ``start_states`` gives), as with ``initial_state="given"``. Where the problem estimates
    initial states and none is known, say how many seconds of a trajectory tell it. The initial
    state is then fitted to this `head`, parameters being held, and what comes after is predicted. A
    head that ends before the first contact is independent of contact parameters. Its noise makes an
    error of the start, which grows with time and is part of the errors returned.

    Parameters
    ----------
    problem
        What moves, and how steps, noise and initial states are. Its ``window`` does not count.
    values
        All parameters by name.
    trajectories
        Any of the model, fitted or not. None: those of the problem.
    head
        Seconds from the first frame, > 0 and shorter than each trajectory, to which initial states
        are fitted. Only with ``initial_state="velocity"`` or ``"pose_and_velocity"``.
    loss, loss_scale
        Of that fit, as in `dashpot.calibrate.fit`.
    nthread
        Number of threads, >= 1. None: one per core. The result does not depend on it.

    Raises
    ------
    TypeError
        If an argument is not of its type.
    ValueError
        Naming the parameter, trajectory or option; where a trajectory carries no ``initial_qvel``
        and there is no `head`; and where a simulation fails.

    Examples
    --------
    >>> from dashpot.calibrate import predict
    >>> (prediction,) = predict(problem, {"stiffness": 1e4, "restitution": 0.6})
    >>> float(np.abs(prediction.position_error).max()) < 5e-4  # m
    True
    """
    if not isinstance(problem, Problem):
        raise TypeError(f"problem is {type(problem).__name__}; it must be a calibrate.Problem")
    if not isinstance(values, Mapping):
        raise TypeError(f"values must be a mapping from names to values, got {values!r}")
    if loss not in get_args(LossName):
        raise ValueError(f"loss must be one of {', '.join(get_args(LossName))}, got {loss!r}")
    chosen_loss = Loss(loss, positive_number("loss_scale", loss_scale))
    threads = thread_count(nthread)
    held = {name: number(f"parameter '{name}'", value) for name, value in values.items()}
    problem.check_values(held)
    estimated = problem.initial_state != "given"
    if head is not None:
        head = positive_number("head", head)
        if not estimated:
            raise ValueError(
                "head needs a problem that estimates initial states, with initial_state="
                "'velocity' or 'pose_and_velocity'"
            )
    if trajectories is not None:
        if problem.start_states is not None:
            raise ValueError(
                "start_states gives the initial states of the problem's own trajectories; make a "
                "Problem of the others, with theirs"
            )
        problem = replace(problem, trajectories=trajectories)
    if head is not None:
        for trajectory in problem.trajectories:
            length = float(trajectory.time[-1] - trajectory.time[0])
            if head >= length:
                raise ValueError(
                    f"head is {head:g} s; it leaves nothing to predict of trajectory "
                    f"'{trajectory.name}', which lasts {length:g} s"
                )
    if head is None and estimated:
        for trajectory in problem.trajectories:
            if trajectory.initial_qvel is None:
                raise ValueError(
                    f"trajectory '{trajectory.name}' has no initial_qvel; give it, or a head to "
                    "estimate its initial state from"
                )
        problem = replace(problem, initial_state="given")
    if head is None:
        problem = with_exact_rates(problem)
    warn_of_noisy_starts(problem, "; give it, or a head with initial_state='pose_and_velocity'")
    states = np.empty(0)
    if head is not None:
        states = fitted_states(problem.with_window(head), held, chosen_loss, threads)
    return predictions(problem, held, states, threads)


def with_exact_rates(problem: Problem) -> Problem:
    """Return the same problem whose frames run as stated, where nothing tells of clocks."""
    exact = [replace(t, rate_sigma=0.0) if t.rate_sigma else t for t in problem.trajectories]
    return replace(problem, trajectories=exact)


def predictions(
    problem: Problem, values: Mapping[str, float], states: Array, nthread: int
) -> Predictions:
    """Return what `values` predict of a problem's trajectories, from unknowns of their `states`.

    These are as in points of the search (`dashpot.calibrate.residuals.objective`): velocity and
    displacement by trajectory, none where they are given.
    """
    objective = Objective(problem.with_window(None), nthread=nthread, held=values)
    qpos, qvel = objective.initial_states(states)
    result = []
    for t, readings in enumerate(objective.observe(states)):
        trajectory = problem.trajectories[t]
        channels = {channel.name: channel for channel in objective.recorders[t].channels}
        poses = readings.get(POSES, np.empty((trajectory.frames, 0)))
        poses = poses.reshape(trajectory.frames, len(trajectory.bodies), 7)
        position, quaternion = poses[..., :3].copy(), poses[..., 3:].copy()
        observed = {**trajectory.sensors, **trajectory.events, **trajectory.scalars}
        others = {name: read for name, read in readings.items() if name != POSES}
        start = {name: trajectory.time[0] for name in trajectory.events}
        others = {name: read + start.get(name, 0.0) for name, read in others.items()}
        result.append(
            Prediction(
                trajectory=trajectory,
                position=position,
                quaternion=quaternion,
                position_error=position - trajectory.position,
                rotation_error=rotation_between(trajectory.quaternion, quaternion),
                initial_qpos=qpos[t].copy(),
                initial_qvel=qvel[t].copy(),
                sensors={name: others[name] for name in trajectory.sensors},
                sensor_errors={
                    name: np.where(np.isnan(seen), np.nan, channels[name].off(others[name]))
                    for name, seen in trajectory.sensors.items()
                },
                moments={
                    name: others[name][:, 0] for name in observed if name not in trajectory.sensors
                },
                residuals={name: others[name][:, 0] for name in problem.own if name in others},
            )
        )
    return Predictions(result)


def fitted_states(
    heads: Problem,
    values: Mapping[str, float],
    loss: Loss,
    nthread: int,
    start: Array | None = None,
) -> Array:
    """Return the unknowns of the initial states that fit the heads of trajectories best."""
    objective = Objective(heads, nthread=nthread, held=values)
    check_count(objective.measured_count, objective.unknowns)
    # Each iteration takes a point and its Jacobian.
    budget = Budget(_MOST_ITERATIONS * (objective.initial_size + 1), lambda *_: None)
    search = Search(objective, loss, budget)
    begin = objective.start(robust=loss.robust) if start is None else start
    least_squares(search, begin, _MOST_ITERATIONS)
    if not search.converged:
        warnings.warn(
            f"the search for initial states ended before it converged ({search.message}); a head "
            "that ends before the first contact is easier",
            stacklevel=3,
        )
    return search.best_point
