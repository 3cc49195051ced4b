"""Parameters of single trajectories, or of groups of them: one unknown each, or a vector.

A parameter with ``per`` stands for several, which are named after it and the trajectory or group:
``stiffness[thin]``. Each acts in its own trajectories alone.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from dashpot.calibrate.problem.vectors import components

if TYPE_CHECKING:
    from dashpot.calibrate.problem.parameters import Parameter


def checked_groups(label: str, per: object) -> object:
    """Return what ``per`` of a parameter may be: None, "trajectory", or names by group."""
    if per is None or (isinstance(per, str) and per == "trajectory"):
        return per
    if not isinstance(per, Mapping):
        raise TypeError(
            f"{label}: per must be 'trajectory' or a mapping from groups to names of trajectories, "
            f"got {per!r}"
        )
    groups: dict[str, tuple[str, ...]] = {}
    owner: dict[str, str] = {}
    for group, names in per.items():
        several = (names,) if isinstance(names, str) else names
        if not isinstance(group, str) or not isinstance(several, Iterable):
            raise TypeError(f"{label}: per must map names to names, got {group!r}: {names!r}")
        groups[group] = tuple(several)
        for name in groups[group]:
            if not isinstance(name, str):
                raise TypeError(f"{label}: per[{group!r}] must hold names, got {name!r}")
            if name in owner:
                raise ValueError(
                    f"{label}: trajectory {name!r} is in two groups, {owner[name]!r} and {group!r}"
                )
            owner[name] = group
    if not groups:
        raise ValueError(f"{label}: per names no group")
    return groups


def single_parameters(
    parameters: Sequence[Parameter], trajectories: Sequence[str]
) -> tuple[Parameter, ...]:
    """Return the unknowns that `parameters` stand for in a problem of named `trajectories`.

    Raises
    ------
    ValueError
        Where a trajectory is in none of the groups of a parameter.
    """
    result: list[Parameter] = []
    for parameter in parameters:
        per = parameter.per
        if per is None:
            result += components(parameter)
            continue
        groups = {name: (name,) for name in trajectories} if isinstance(per, str) else per
        _check_all_in_groups(parameter.name, groups.values(), trajectories)
        for group, names in groups.items():
            own = dataclasses.replace(
                parameter,
                name=f"{parameter.name}[{group}]",
                per=None,
                trajectories=tuple(names),
                base=parameter.name,
            )
            result += components(own)
    return tuple(result)


def check_acting(parameters: Sequence[Parameter], trajectories: Sequence[str]) -> None:
    """Raise ValueError where a trajectory has no value of a parameter that others have one of."""
    groups: dict[str, list[tuple[str, ...]]] = {}
    for parameter in parameters:
        if parameter.trajectories is not None:
            groups.setdefault(parameter.base or parameter.name, []).append(parameter.trajectories)
    for name, members in groups.items():
        _check_all_in_groups(name, members, trajectories)


def _check_all_in_groups(
    name: str, groups: Iterable[Sequence[str]], trajectories: Sequence[str]
) -> None:
    known = {trajectory for group in groups for trajectory in group}
    for trajectory in trajectories:
        if trajectory not in known:
            raise ValueError(
                f"parameter '{name}' has no value for trajectory '{trajectory}': it is in none of "
                "its groups (per)"
            )
