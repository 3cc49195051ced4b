"""Fields of a trajectory: arrays of numbers of the right shape, which nobody changes later."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot.checks import number_array

Array = NDArray[np.float64]


def finite_field(label: str, value: ArrayLike, *, lost: bool = False) -> Array:
    """Return a new array of finite numbers; with `lost`, NaN too, of what is masked or None."""
    array = np.array(number_array(label, value, missing_as_nan=lost))
    bad = np.argwhere(np.isinf(array) if lost else ~np.isfinite(array))
    if bad.size:
        index = tuple(int(i) for i in bad[0])
        raise ValueError(f"{label}{list(index)} is {array[index]}")
    return array


def poses_field(label: str, value: ArrayLike, shape: tuple[int, int, int]) -> Array:
    """Return positions or quaternions by time and body; of one body the body may be left out."""
    array = finite_field(label, value, lost=True)
    n, bodies, width = shape
    if bodies == 1 and array.shape == (n, width):
        array = array[:, None, :]
    if array.shape != shape:
        raise ValueError(
            f"{label} must be ({n}, {bodies}, {width}) for {n} times and {bodies} bodies, "
            f"got {array.shape}"
        )
    return array


def readings_field(label: str, name: object, value: ArrayLike, n: int) -> Array:
    """Return the readings (n, size) of the sensor `name`."""
    if not isinstance(name, str):
        raise TypeError(f"{label}: sensors must have names as keys, got {name!r}")
    array = finite_field(f"{label}: sensors[{name!r}]", value, lost=True)
    if array.shape == (n,):
        array = array[:, None]
    if array.ndim != 2 or array.shape[0] != n:
        raise ValueError(
            f"{label}: sensors[{name!r}] must be ({n}, size) or ({n},) for {n} times, "
            f"got {array.shape}"
        )
    return frozen(array)


def frozen(array: Array) -> Array:
    """Return a copy that cannot be written to."""
    array = np.array(array, order="C")
    array.flags.writeable = False
    return array
