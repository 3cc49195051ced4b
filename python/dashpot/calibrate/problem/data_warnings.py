"""Data that were hardly meant so: refused, or taken with a warning."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from dashpot.calibrate.data.falls import TIMES, strange_units
from dashpot.calibrate.problem.buried_starts import buried_starts
from dashpot.calibrate.problem.falling_paths import falling_paths
from dashpot.calibrate.problem.first_guess import free_bodies, gravity_of
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.setters import model_of
from dashpot.calibrate.problem.unseen_turns import unseen_turns

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


def warn_of_held_turns(problem: Problem) -> None:
    """Warn where rotations of a start are held, since nothing measured them, naming the body."""
    if problem.initial_state == "given" or problem.residuals:
        return
    model = model_of(problem.bare_system())
    found: dict[str, list[str]] = {}
    for trajectory in problem.trajectories:
        if trajectory.initial_qpos_sigma is None and trajectory.initial_qvel_sigma is None:
            for body, (_, off) in unseen_turns(trajectory, model, problem.sigma).items():
                found.setdefault(
                    f"rotations of body '{body}' were not measured, and its centre of mass is "
                    f"{1e3 * off:.3g} mm off its origin: it starts unturned and does not turn "
                    "before it touches something. Where it may, give initial_qpos_sigma=inf and "
                    "initial_qvel_sigma=inf",
                    [],
                ).append(trajectory.name)
    for what, names in found.items():
        _warn(names, what)


def warn_of_buried_starts(problem: Problem) -> None:
    """Warn where first frames have a body deeper in a geom than its contact can give way."""
    for name, what in buried_starts(problem).items():
        _warn(
            [name],
            f"{what}: units, the origin of positions or sizes in the model may differ from what "
            "was recorded",
        )


def refuse_strange_falls(problem: Problem) -> None:
    """Refuse times of another unit than the model's, warn of positions and axes of others.

    Times in ms would take a thousand times as long to simulate, and no parameter is their unit. The
    scale of positions may be an unknown of the fit.
    """
    found = strange_falls(problem)
    for what in dict.fromkeys(found.values()):
        names = [name for name, said in found.items() if said == what]
        said = f"{what}; times must be in s, positions in m, in the world of the model"
        if TIMES not in what:
            _warn(names, said)
        else:
            raise ValueError(
                f"{_listed(names)}: {said}. Trajectory.from_csv(unit={{'time': 'ms', 'z': 'cm'}}) "
                "converts such files"
            )


def noisy_starts(problem: Problem) -> tuple[str, ...]:
    """Return the trajectories whose simulation starts at their first observed pose.

    That is, those without ``initial_qpos`` of which a body on a free joint was observed, where
    neither `initial_state` nor `start_states` gives the initial pose.
    """
    if not problem.starts_at_first_poses():
        return ()
    model = model_of(problem.bare_system())
    return tuple(
        trajectory.name
        for trajectory in problem.trajectories
        if trajectory.initial_qpos is None and free_bodies(trajectory, model)
    )


def strange_falls(problem: Problem) -> dict[str, str]:
    """Return what is strange about units or axes by trajectory, of those where something is."""
    model = model_of(problem.bare_system())
    gravity = float(np.linalg.norm(gravity_of(model)))
    found = {
        trajectory.name: strange_units(falling_paths(trajectory, model, problem.sigma[:3]), gravity)
        for trajectory in problem.trajectories
    }
    return {name: what for name, what in found.items() if what}


def _warn(names: Sequence[str], what: str) -> None:
    if names:
        warnings.warn(f"{_listed(names)}: {what}", stacklevel=_STACK_LEVEL)


def _listed(names: Sequence[str]) -> str:
    others = f" and {len(names) - 1} more" if len(names) > 1 else ""
    return f"trajectory '{names[0]}'{others}"
