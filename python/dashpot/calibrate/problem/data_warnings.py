"""Warnings of data that a fit takes, but that were hardly meant so."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.clock import falls_up, gravity_of, in_millimetres, in_milliseconds
from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.first_guess import free_bodies, free_joint
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.setters import model_of
from dashpot.calibrate.problem.systems import own_system

Array = NDArray[np.float64]

# Of what called fit, or predict, which call these.
_STACK_LEVEL = 4


def warn_of_noisy_starts(problem: Problem, consequence: str) -> None:
    """Warn where simulations start at a measured pose as if it had no noise.

    Parameters
    ----------
    problem
        The problem.
    consequence
        What comes of it, and what helps.
    """
    _warn(
        noisy_starts(problem),
        "no initial_qpos, so that the simulation starts at the first observed pose as if that had "
        f"no noise{consequence}",
    )


def warn_of_strange_falls(problem: Problem) -> None:
    """Warn where bodies begin in a fall as of other units or axes than the model's."""
    for begins, what in (
        (
            in_milliseconds,
            "it begins in a fall at a millionth of gravity, as with times in milliseconds; they "
            "must be in s",
        ),
        (
            in_millimetres,
            "it begins in a fall at a thousand times gravity, as with positions in mm; they must "
            "be in m",
        ),
        (
            falls_up,
            "it begins in a fall against gravity, as with an axis that points down; positions must "
            "be in the world of the model",
        ),
    ):
        _warn(strange_falls(problem, begins), what)


def noisy_starts(problem: Problem) -> tuple[str, ...]:
    """Return the trajectories whose simulation starts at their first observed pose.

    That is, those without ``initial_qpos`` of which a body on a free joint was observed, where
    neither `initial_state` nor `start_states` gives the initial pose.
    """
    if not problem.starts_at_first_poses():
        return ()
    model = model_of(own_system(problem.system, problem.start))
    return tuple(
        trajectory.name
        for trajectory in problem.trajectories
        if trajectory.initial_qpos is None and free_bodies(trajectory, model)
    )


def strange_falls(
    problem: Problem, begins: Callable[[Trajectory, Sequence[int], Array, Array], bool]
) -> tuple[str, ...]:
    """Return the trajectories whose bodies on free joints begin as a function of `clock` says."""
    model = model_of(own_system(problem.system, problem.start))
    found = []
    for trajectory in problem.trajectories:
        ids = [model.body(body).id for body in trajectory.bodies]
        free = [i for i, body in enumerate(ids) if free_joint(model, body) is not None]
        if begins(trajectory, free, gravity_of(model), problem.sigma[:3]):
            found.append(trajectory.name)
    return tuple(found)


def _warn(names: Sequence[str], what: str) -> None:
    if not names:
        return
    others = f" and {len(names) - 1} more" if len(names) > 1 else ""
    warnings.warn(f"trajectory '{names[0]}'{others}: {what}", stacklevel=_STACK_LEVEL)
