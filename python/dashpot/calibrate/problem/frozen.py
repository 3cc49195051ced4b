"""Parameters that are held: set and listed, but not fitted. What is left is a nested model."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from dashpot.checks import number

if TYPE_CHECKING:
    from dashpot.calibrate.problem.parameters import Parameter


def frozen_at(
    parameters: Sequence[Parameter], values: Iterable[str] | Mapping[str, float]
) -> tuple[Parameter, ...]:
    """Return single parameters, those that `values` names held at these, or at their starts.

    Raises
    ------
    ValueError, TypeError
        Naming what is no parameter, or no number.
    """
    starts: Mapping[str, float | None]
    if isinstance(values, Mapping):
        starts = {name: number(f"parameter '{name}'", value) for name, value in values.items()}
    else:
        starts = dict.fromkeys(_names(values))
    found: dict[str, Parameter] = {}
    for name, start in starts.items():
        for parameter in _named(parameters, name):
            held = parameter.start if start is None else start
            found[parameter.name] = dataclasses.replace(parameter, start=held, frozen=True)
    return tuple(found.get(p.name, p) for p in parameters)


def released(parameters: Sequence[Parameter], names: Iterable[str] | str) -> tuple[Parameter, ...]:
    """Return single parameters, those of these names fitted from where they were held."""
    chosen = {p.name for name in _names(names) for p in _named(parameters, name)}
    return tuple(
        dataclasses.replace(p, frozen=False) if p.name in chosen else p for p in parameters
    )


def _names(names: Iterable[str] | str) -> tuple[str, ...]:
    several = (names,) if isinstance(names, str) else tuple(names)
    if not all(isinstance(name, str) for name in several):
        raise TypeError(f"names of parameters must be strings, got {names!r}")
    return several


def _named(parameters: Sequence[Parameter], name: str) -> list[Parameter]:
    """Return the single parameters of a name, or of a vector or of groups of it."""
    found = [p for p in parameters if name in (p.name, p.vector, p.base)]
    if not found:
        known = ", ".join(p.name for p in parameters)
        raise ValueError(f"no parameter is named {name!r}; there are {known}")
    return found
