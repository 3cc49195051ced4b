"""Checks of numbers that callers give; errors name the argument, its value and where it stands."""

from __future__ import annotations

import difflib
import numbers
import os
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot import _core

# Of the core's integers.
_LARGEST_COUNT = 2**31 - 1


def number(name: str, value: object) -> float:
    """Return a real number, nan and inf included, as a float; raise TypeError for anything else.

    Arrays of no dimension are numbers.
    """
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    # NumPy registers its durations as integers.
    if isinstance(value, bool | np.timedelta64) or not isinstance(value, numbers.Real):
        raise TypeError(f"{name} must be a number, got {value!r}")
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f"{name} is too large for a float") from None


def positive_number(name: str, value: object) -> float:
    """Return a finite number > 0; raise TypeError for no number, ValueError out of range."""
    result = number(name, value)
    if not (np.isfinite(result) and result > 0.0):
        raise ValueError(f"{name} must be finite and > 0, got {value!r}")
    return result


def number_array(
    name: str, value: ArrayLike, *, missing_as_nan: bool = False
) -> NDArray[np.float64]:
    """Return `value` as an array of floats; raise TypeError where it is not one of real numbers.

    NumPy would read text and True as numbers, times as counts of their unit, what is masked as what
    lies under the mask, and of complex numbers the real parts.

    Parameters
    ----------
    name
        Of the argument, for messages.
    value
        Integers or floats, or objects that are such; 0-d too.
    missing_as_nan
        Whether what is masked, and None among objects, is NaN rather than refused.
    """
    try:
        array = np.ma.array(value) if _holds_a_mask(value) else np.asarray(value)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} must be an array of numbers: {error}") from None
    raw, masked = np.ma.getdata(array), np.ma.getmask(array)
    if raw.dtype == np.object_:
        raw, none = _real_numbers(name, raw, np.ma.getmaskarray(array))
        masked = masked | none
    elif raw.dtype.kind not in "iuf":
        raise TypeError(f"{name} must be an array of numbers, got dtype {raw.dtype}")
    if not masked.any():
        return raw.astype(np.float64, copy=False)
    if not missing_as_nan:
        index = [int(i) for i in np.argwhere(masked)[0]]
        raise TypeError(f"{name}{index or ''} is missing (masked or None); it must be a number")
    return np.where(masked, np.nan, raw)


def _holds_a_mask(value: object) -> bool:
    """Whether a value, or an entry of a sequence, is a masked array."""
    entries = value if isinstance(value, list | tuple) else (value,)
    return any(isinstance(entry, np.ma.MaskedArray) for entry in entries)


def _real_numbers(
    name: str, objects: NDArray[np.object_], masked: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return an array of objects as floats, and where they are None; some may be `masked`."""
    result, none = np.zeros(objects.shape), np.zeros(objects.shape, dtype=bool)
    for index in map(tuple, np.argwhere(~masked)):
        if objects[index] is None:
            none[index] = True
        else:
            result[index] = number(f"{name}{[int(i) for i in index]}", objects[index])
    return result, none


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


def whole_number(name: str, value: object, *, lowest: int, highest: int = _LARGEST_COUNT) -> int:
    """Return an integer in a range; raise TypeError for no integer, ValueError otherwise."""
    if isinstance(value, bool | np.timedelta64) or not isinstance(value, int | np.integer):
        raise TypeError(f"{name} must be an integer, got {value!r}")
    if value < lowest:
        raise ValueError(f"{name} must be >= {lowest}, got {value}")
    if value > highest:
        raise ValueError(f"{name} must be <= {highest}, got {value}")
    return int(value)


def flag(name: str, value: object) -> bool:
    """Return True or False; raise TypeError for anything else."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} must be True or False, got {value!r}")
    return bool(value)


def text_or_none(name: str, value: object) -> str | None:
    """Return a string or None; raise TypeError for anything else."""
    if not isinstance(value, str | None):
        raise TypeError(f"{name} must be a string, got {value!r}")
    return value


def positive_count(name: str, value: object) -> int:
    """Return an integer >= 1; raise as `whole_number`."""
    return whole_number(name, value, lowest=1)


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


def existing_file(what: str, path: str | os.PathLike[str]) -> Path:
    """Return the path of a file; raise FileNotFoundError saying what helps where there is none."""
    file = Path(path)
    if os.path.exists(file):
        return file
    if not os.path.isdir(file.parent):
        raise FileNotFoundError(f"no {what} {file}: there is no folder {file.parent}")
    near = difflib.get_close_matches(file.name, os.listdir(file.parent), n=3, cutoff=0.5)
    hint = f"did you mean {', '.join(near)}?" if near else f"paths are seen from {Path.cwd()}"
    raise FileNotFoundError(f"no {what} {file}; {hint}")
