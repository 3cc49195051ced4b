"""Prediction errors of tosses: time means over the frames after the first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.prediction import predictions, with_exact_rates
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.tosses.cube import Cube
from dashpot.calibrate.tosses.flight import flight_frames
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
    hinge
        (tosses,) time mean of how far the angle of a hinge is off, degrees, the shorter way round;
        NaN where none is observed.

    Examples
    --------
    >>> from dashpot.calibrate import tosses as study
    >>> problem = study.toss_problem(tosses[:3], study.Cube())
    >>> errors = study.evaluate(problem, problem.start, study.Cube())
    >>> errors.rotation.shape, errors.contact_position.shape
    ((3,), (3,))
    """

    position: Array
    rotation: Array
    contact_position: Array
    contact_rotation: Array
    hinge: Array

    @property
    def mean_position(self) -> float:
        """Mean over the tosses, percent of the width."""
        return float(self.position.mean())

    @property
    def mean_rotation(self) -> float:
        """Mean over the tosses, degrees."""
        return float(self.rotation.mean())

    @property
    def mean_hinge(self) -> float:
        """Mean over the tosses, degrees."""
        return float(self.hinge.mean())


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

    Examples
    --------
    >>> from dashpot.calibrate import tosses as study
    >>> problem = study.toss_problem(tosses[:3], study.Cube())
    >>> errors = study.evaluate(problem, problem.start, study.Cube())
    >>> errors.position.shape
    (3,)
    """
    contact = [
        flight_frames(t.position[:, 0], t.quaternion[:, 0], cube) for t in problem.trajectories
    ]
    return errors_of(problem, values, 2.0 * cube.half_width, contact=contact, nthread=nthread)


def errors_of(
    problem: Problem,
    values: Mapping[str, float],
    width: float,
    *,
    contact: Sequence[int] | None = None,
    nthread: int | None = None,
) -> Errors:
    """Return the errors of predictions with `values` within the window of a problem.

    Parameters
    ----------
    problem
        With given initial states. One body is observed, and angles of hinges may be.
    values
        All parameters by name.
    width
        Scale of errors of position, m.
    contact
        By toss, the number of its frames before the first contact. None: not told apart.
    nthread
        Number of threads, >= 1. None: one per core.

    Examples
    --------
    >>> from dashpot.calibrate import tosses as study
    >>> problem = study.toss_problem(tosses[:3], study.Cube())
    >>> study.errors_of(problem, problem.start, width=0.1).position.shape
    (3,)
    """
    found = predictions(with_exact_rates(problem), dict(values), np.empty(0), thread_count(nthread))
    errors = np.empty((len(found), 5))
    for t, prediction in enumerate(found):
        trajectory = problem.trajectories[t]
        frames = (trajectory if problem.window is None else trajectory.head(problem.window)).frames
        distance = np.linalg.norm(prediction.position_error[:frames, 0], axis=1)
        angle = np.linalg.norm(prediction.rotation_error[:frames, 0], axis=1)
        first = 1 if contact is None else min(contact[t], frames - 1)
        errors[t, :4] = [part[k:].mean() for k in (1, first) for part in (distance, angle)]
        turned = [error[1:frames, 0] for error in prediction.sensor_errors.values()]
        shorter = [np.abs((a + np.pi) % (2.0 * np.pi) - np.pi) for a in turned]
        errors[t, 4] = np.mean(shorter) if shorter else np.nan
    errors[:, [0, 2]] *= 100.0 / width
    errors[:, [1, 3, 4]] = np.rad2deg(errors[:, [1, 3, 4]])
    return Errors(*errors.T)
