"""Fields of a trajectory that say how its recorders work: clocks, sampling, events, scalars."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot.calibrate.data.trajectory_fields import finite_field, frozen, readings_field
from dashpot.checks import number_array

Array = NDArray[np.float64]
Sampling = Literal["instant", "mean"]


def sensor_fields(
    label: str, sensors: Mapping[str, ArrayLike], times: Mapping[str, ArrayLike], frames: int
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return readings (n, size) by sensor, and the times (n,) of those with a clock of their own.

    Raises
    ------
    TypeError, ValueError
        Naming the sensor, and the first time that is not later than the one before.
    """
    _check_mapping(label, "sensors", sensors, "readings")
    _check_mapping(label, "sensor_times", times, "times")
    own = {}
    for name, value in times.items():
        if name not in sensors:
            raise ValueError(f"{label}: sensor_times names {name!r}, of which there is no reading")
        time = finite_field(f"{label}: sensor_times[{name!r}]", value)
        if time.ndim != 1 or time.size < 2:
            raise ValueError(
                f"{label}: sensor_times[{name!r}] must be (n,) with n >= 2, got {time.shape}"
            )
        late = np.flatnonzero(np.diff(time) <= 0.0)
        if late.size:
            i = int(late[0]) + 1
            raise ValueError(
                f"{label}: sensor_times[{name!r}] must increase strictly, but [{i}] = "
                f"{time[i]:.6g} s follows {time[i - 1]:.6g} s"
            )
        own[name] = frozen(time)
    readings = {
        name: readings_field(label, name, value, own[name].size if name in own else frames)
        for name, value in sensors.items()
    }
    return readings, own


def sampling_field(
    label: str, sampling: Mapping[str, Sampling], sensors: Mapping[str, Array]
) -> dict[str, Sampling]:
    """Return how sensors sample, checked."""
    _check_mapping(label, "sampling", sampling, "'instant' or 'mean'")
    for name, kind in sampling.items():
        if name not in sensors:
            raise ValueError(f"{label}: sampling names {name!r}, of which there is no reading")
        if kind not in get_args(Sampling):
            raise ValueError(
                f"{label}: sampling[{name!r}] must be 'instant' or 'mean', got {kind!r}"
            )
    return dict(sampling)


def numbers_field(label: str, field: str, given: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """Return events or scalars by name: one number each or several, NaN for what was missed."""
    _check_mapping(label, field, given, "numbers")
    result = {}
    for name, value in given.items():
        array = np.atleast_1d(
            number_array(f"{label}: {field}[{name!r}]", value, missing_as_nan=True)
        )
        if array.ndim != 1 or np.isinf(array).any() or not np.isfinite(array).any():
            raise ValueError(
                f"{label}: {field}[{name!r}] must be one finite number, or some, got {value!r}"
            )
        if field == "events" and (np.diff(array[np.isfinite(array)]) <= 0.0).any():
            raise ValueError(f"{label}: events[{name!r}] must be ascending times, got {value!r}")
        result[name] = frozen(array)
    return result


def _check_mapping(label: str, field: str, given: object, values: str) -> None:
    if not isinstance(given, Mapping):
        raise TypeError(f"{label}: {field} must be a mapping from names to {values}, got {given!r}")
    for name in given:
        if not isinstance(name, str):
            raise TypeError(f"{label}: {field} must have names as keys, got {name!r}")
