"""What parameters take: starts, bounds, groups, and elements of models by name or id."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.transforms import TransformName
from dashpot.object_ids import Element

Groups: TypeAlias = Literal["trajectory"] | Mapping[str, Sequence[str]]
Start: TypeAlias = float | Sequence[float] | NDArray[np.float64]
Bounds: TypeAlias = Sequence[float | Sequence[float]] | NDArray[np.float64]
Transforms: TypeAlias = TransformName | Sequence[TransformName]
Frozen: TypeAlias = bool | Sequence[bool]


def elements_of(argument: str, given: Element | Sequence[Element]) -> tuple[Element, ...]:
    """Return one name or id, or several, as a tuple of at least one."""
    several = (given,) if isinstance(given, str) or not isinstance(given, Iterable) else given
    found = tuple(several)
    if not all(map(is_element, found)):
        raise TypeError(f"{argument} must be names or ids, one or a sequence, got {given!r}")
    if not found:
        raise ValueError(f"{argument} names nothing")
    return tuple(e if isinstance(e, str) else operator.index(e) for e in found)


def is_element(key: object) -> bool:
    """Whether `key` can be the name or the id of an element of a model."""
    return isinstance(key, str | int | np.integer) and not isinstance(key, bool)


def pairs_of(given: object) -> tuple[tuple[Element, Element], ...]:
    """Return one pair of geoms or more; raise TypeError or ValueError for anything else."""
    if not isinstance(given, Iterable) or isinstance(given, str):
        raise TypeError(f"pairs must be two geoms by name or id, or several twos, got {given!r}")
    found: list[tuple[Element, Element]] = []
    for pair in given:
        geoms = () if isinstance(pair, str) or not isinstance(pair, Iterable) else tuple(pair)
        if len(geoms) != 2 or not all(map(is_element, geoms)):
            raise TypeError(f"a pair is two geoms by name or id, got {pair!r}")
        first, second = (g if isinstance(g, str) else operator.index(g) for g in geoms)
        if (first, second) in found or (second, first) in found:
            raise ValueError(f"pairs has {first!r} and {second!r} twice")
        found.append((first, second))
    if not found:
        raise ValueError("pairs names nothing")
    return tuple(found)


def columns_of(index: int | Sequence[int] | None) -> tuple[int, ...] | None:
    """Return the columns that a parameter sets, None for all."""
    if index is None:
        return None
    columns = np.atleast_1d(np.asarray(index))
    if columns.ndim != 1 or not np.issubdtype(columns.dtype, np.integer):
        raise TypeError(f"index must be an integer or a sequence of integers, got {index!r}")
    if not columns.size:
        raise ValueError("index names no column")
    return tuple(int(column) for column in columns)
