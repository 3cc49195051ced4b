"""How well things were measured: standard deviations, checked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot.checks import number, number_array


def deviation(name: str, value: object) -> float:
    """Return a standard deviation > 0, or inf; raise TypeError or ValueError naming it."""
    result = number(name, value)
    if not result > 0:
        raise ValueError(f"{name} must be > 0, or inf where nothing was measured, got {value!r}")
    return result


def position_deviations(value: object) -> float | tuple[float, float, float]:
    """Return one standard deviation, or three, of x, y and z."""
    if not _is_several(value):
        return deviation("position_sigma", value)
    several = tuple(value)
    if len(several) != 3:
        raise ValueError(f"position_sigma must be one number or three (x, y, z), got {value!r}")
    x, y, z = (deviation(f"position_sigma[{i}]", entry) for i, entry in enumerate(several))
    return x, y, z


def deviations_by_name(field: str, value: object) -> dict[str, tuple[float, ...]]:
    """Return standard deviations by name: one, or one for each number of a sensor."""
    if not isinstance(value, Mapping):
        raise TypeError(f"{field} must be a mapping from names to numbers, got {value!r}")
    result: dict[str, tuple[float, ...]] = {}
    for name, entry in value.items():
        if not isinstance(name, str):
            raise TypeError(f"{field} must have names as keys, got {name!r}")
        label = f"{field}[{name!r}]"
        if not _is_several(entry):
            result[name] = (deviation(label, entry),)
        else:
            result[name] = tuple(deviation(f"{label}[{i}]", e) for i, e in enumerate(entry))
    return result


def deviation_by_name(field: str, value: object) -> dict[str, float]:
    """Return one standard deviation by name."""
    result = {}
    for name, several in deviations_by_name(field, value).items():
        if len(several) != 1:
            raise ValueError(f"{field}[{name!r}] must be one number, got {several}")
        result[name] = several[0]
    return result


def initial_deviations(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return how well an initial state is known: one standard deviation, or one a coordinate."""
    sigma = np.array(number_array(name, value))
    if sigma.ndim > 1 or not (sigma >= 0.0).all():
        raise ValueError(
            f"{name} must be one number or one for each degree of freedom, >= 0, 0 where it is "
            f"known exactly and inf where not at all; got {value!r}"
        )
    return sigma


def _is_several(value: object) -> TypeGuard[Iterable[object]]:
    """Whether a value has entries; arrays of no dimension are called iterable, too."""
    single = isinstance(value, str) or (isinstance(value, np.ndarray) and value.ndim == 0)
    return isinstance(value, Iterable) and not single
