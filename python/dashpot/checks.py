"""Checks of numbers that callers give; errors name the argument, its value and where it stands."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot import _core


def number_array(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return `value` as an array of floats; raise TypeError where it is not one of numbers."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} must be an array of numbers: {error}") from None


def require_finite(name: str, array: NDArray[np.float64]) -> None:
    """Raise ValueError with the index of the first number that is not finite."""
    bad = np.argwhere(~np.isfinite(array))
    if bad.size:
        index = tuple(int(i) for i in bad[0])
        raise ValueError(f"{name}{list(index)} is {array[index]}")


def finite_array(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return `value` as an array of finite floats; raise as the two checks above."""
    array = number_array(name, value)
    require_finite(name, array)
    return array


def positive_count(name: str, value: int) -> int:
    """Return an integer >= 1; raise TypeError for anything else, ValueError below 1."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise TypeError(f"{name} must be an integer, got {value!r}")
    if value < 1:
        raise ValueError(f"{name} must be >= 1, got {value}")
    return int(value)


def is_data_of(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Whether data are of a model; raise TypeError where they are no ``mujoco.MjData``.

    Compiled models and their data carry a signature. Pickling loses it (it is 0 then): what the
    data were made from has to agree with the model in all sizes instead.
    """
    if not isinstance(data, mujoco.MjData):
        raise TypeError(f"data is {type(data).__name__}; it must be a mujoco.MjData")
    if model.signature and data.signature:
        return bool(model.signature == data.signature)
    return _core.have_same_sizes(model._address, data.model._address)


def thread_count(nthread: int | None) -> int:
    """Return a checked number of threads; the core takes 0, here for None, as one per core."""
    return 0 if nthread is None else positive_count("nthread", nthread)
