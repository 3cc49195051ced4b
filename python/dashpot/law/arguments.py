"""Checked array arguments of the law, and calls of the core over them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dashpot.checks import number_array


def real_array(
    name: str,
    value: ArrayLike,
    *,
    lower: float | None = None,
    strict: bool = False,
    infinite: bool = False,
) -> Any:
    """Return `value` as a float array, at least `lower` (above it if `strict`), or raise.

    Numbers have to be finite; if `infinite`, inf is one too.
    """
    array = number_array(name, value)
    good = ~np.isnan(array) if infinite else np.isfinite(array)
    if lower is not None:
        good &= (array > lower) if strict else (array >= lower)
    if not np.all(good):
        bound = "" if lower is None else f" and {'>' if strict else '>='} {lower:g}"
        raise ValueError(f"{name} must be finite{bound}, got {array[~good].flat[0]:g}")
    return array


def broadcast(arguments: dict[str, Any]) -> Any:
    """Return arrays of one shape; raise ValueError with the names and shapes that have none."""
    try:
        return np.broadcast_arrays(*arguments.values())
    except ValueError:
        shapes = ", ".join(f"{name} {np.shape(array)}" for name, array in arguments.items())
        raise ValueError(f"shapes do not broadcast: {shapes}") from None


def over_arrays(function: Any, arguments: dict[str, Any]) -> list[Any]:
    """Call a core function of one-dimensional arrays on broadcast arguments, in their order."""
    arrays = broadcast(arguments)
    shape = arrays[0].shape
    results = function(*(np.ascontiguousarray(array).ravel() for array in arrays))
    return [result.reshape(shape)[()] for result in results]
