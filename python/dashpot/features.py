"""Which MJCF features of a model the engine honours, maps or refuses."""

from __future__ import annotations

import re
from collections.abc import Container, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import mujoco

__all__ = ["Feature", "Report", "Treatment"]

Treatment = Literal["honoured", "mapped", "refused"]


@dataclass(frozen=True)
class Feature:
    """One feature of a model and how the engine treats it.

    Examples
    --------
    >>> feature = engine.report().features[0]
    >>> print(feature.name, feature.treatment)
    option integrator=Euler honoured
    """

    name: str
    treatment: Treatment
    note: str


@dataclass(frozen=True, repr=False)
class Report:
    """All features worth telling of a model; prints as one line each, like ones as one.

    Examples
    --------
    >>> print(str(engine.report()).splitlines()[-1])
    mapped    option cone: friction cones are elliptic
    """

    features: tuple[Feature, ...]

    def of(self, treatment: Treatment) -> tuple[Feature, ...]:
        """Features with one treatment; ValueError if there is none of that name.

        Examples
        --------
        >>> [feature.name for feature in engine.report().of("honoured")]
        ['option integrator=Euler']
        """
        if treatment not in get_args(Treatment):
            known = ", ".join(get_args(Treatment))
            raise ValueError(f"treatment must be one of {known}, got {treatment!r}")
        return tuple(f for f in self.features if f.treatment == treatment)

    def __repr__(self) -> str:
        """Return the lines of the report, so that an interactive session shows them."""
        return str(self)

    def __str__(self) -> str:
        alike: dict[tuple[str, str, str, str], list[str]] = {}
        for feature in self.features:
            parts = re.fullmatch(r"(\w+) ('.*'|#\d+)(.*)", feature.name)
            kind, name, what = parts.groups() if parts else (feature.name, "", "")
            alike.setdefault((feature.treatment, kind, what, feature.note), []).append(name)
        return "\n".join(
            f"{treatment:<9} {' '.join(filter(None, (kind, _listed(names))))}{what}: {note}"
            for (treatment, kind, what, note), names in alike.items()
        )


def replaced_by_materials(
    model: mujoco.MjModel, geoms: Sequence[int], pairs: Container[tuple[int, int]]
) -> frozenset[str]:
    """Return the names of features that are without effect, since materials take their place.

    Parameters
    ----------
    model
        The model.
    geoms
        Ids of those with a material.
    pairs
        The same by (lower, higher) id.
    """
    names = [f"geom {_quoted(model.geom(geom).name, geom)}" for geom in geoms]
    for pair, both in enumerate(zip(model.pair_geom1, model.pair_geom2, strict=True)):
        first, second = sorted(map(int, both))
        if first in geoms or second in geoms or (first, second) in pairs:
            names.append(f"pair {_quoted(model.pair(pair).name, pair)}")
    return frozenset(f"{name} solref/solimp" for name in names)


def _quoted(name: str, index: int) -> str:
    return f"'{name}'" if name else f"#{index}"


def _listed(names: list[str]) -> str:
    """Join names, all of up to three, else the first two and how many more there are."""
    if len(names) <= 3:
        return ", ".join(names)
    return f"{names[0]}, {names[1]} and {len(names) - 2} more"
