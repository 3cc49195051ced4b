"""Vector parameters: several numbers under one name, each an unknown of its own.

A parameter with a sequence as its start, or with bounds for each number, stands for as many single
ones: ``offset[0]``, ``offset[1]`` ... Where what it sets has a place for each number (columns of an
array, numbers of a sensor, coefficients of friction), these are set one by one. A function of the
user's gets all of them as an array.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from dashpot.calibrate.problem.setters import System
from dashpot.checks import number_array

if TYPE_CHECKING:
    from dashpot.calibrate.problem.parameters import Parameter


@dataclass(frozen=True)
class Joint:
    """Sets all numbers of a vector together, by a function of the system and their array."""

    function: Callable[[System, Any], None]

    def __call__(self, system: System, value: float) -> NoReturn:
        """Raise ValueError: one number does not suffice."""
        raise ValueError("it is one number of a vector, which is set as a whole")


def is_vector(start: object, bounds: object) -> bool:
    """Whether a start or bounds are those of several numbers."""
    return _depth(start) >= 1 or _depth(bounds) >= 2


def vector_fields(
    label: str, start: Any, bounds: Any, *, transform: Any, frozen: Any
) -> dict[str, Any]:
    """Return the fields of a vector by name, each a tuple of one entry a number.

    Raises
    ------
    TypeError, ValueError
        Where they are not numbers, or of different counts, naming the field.
    """
    starts = number_array(f"{label}: start", start)
    ends = number_array(f"{label}: bounds", () if bounds is None else bounds)
    if starts.ndim > 1 or ends.ndim not in (1, 2) or ends.shape[-1] != 2:
        raise ValueError(
            f"{label}: start must be numbers in a row and bounds (lower, upper), or one such for "
            f"each, got {start!r} and {bounds!r}"
        )
    count = starts.size if starts.ndim else len(ends)
    if count == 0:
        raise ValueError(f"{label}: start has no number")
    if ends.ndim == 2 and len(ends) != count:
        raise ValueError(f"{label}: start has {count} numbers, and there are {len(ends)} bounds")
    fields: dict[str, Any] = {
        "start": tuple(map(float, np.broadcast_to(starts, count))),
        "bounds": tuple((float(a), float(b)) for a, b in np.broadcast_to(ends, (count, 2))),
    }
    for name, value in (("transform", transform), ("frozen", frozen)):
        alike = isinstance(value, str) or not isinstance(value, Iterable)
        several = (value,) * count if alike else tuple(value)
        if len(several) != count:
            raise ValueError(f"{label}: {name} has {len(several)} entries, and start {count}")
        fields[name] = several
    return fields


def components(parameter: Parameter) -> tuple[Parameter, ...]:
    """Return the single parameters that one stands for: itself, unless it is a vector."""
    if not isinstance(parameter.start, tuple):
        return (parameter,)
    count = len(parameter.start)
    setter: Any = parameter.apply
    labels = getattr(setter, "labels", range(count))
    split = getattr(setter, "component", None)
    joint = None if setter is None else setter if isinstance(setter, Joint) else Joint(setter)
    found = []
    for i, label in enumerate(labels):
        try:
            own = joint if split is None else split(i, count)
        except ValueError as error:
            raise ValueError(f"parameter '{parameter.name}': {error}") from None
        found.append(
            dataclasses.replace(
                parameter,
                name=f"{parameter.name}[{label}]",
                start=parameter.start[i],
                bounds=parameter.bounds[i],
                transform=parameter.transform[i],
                frozen=parameter.frozen[i],
                apply=own,
                vector=parameter.name,
                component=i,
            )
        )
    return tuple(found)


def vectors_of(parameters: Sequence[Parameter], values: Mapping[str, float]) -> dict[str, Any]:
    """Return the vectors among parameters by name, as arrays of the values of their numbers."""
    found: dict[str, list[float]] = {}
    for parameter in parameters:
        if parameter.vector is not None:
            found.setdefault(parameter.vector, []).append(values[parameter.name])
    return {name: np.array(numbers) for name, numbers in found.items()}


def builder_values(parameters: Sequence[Parameter], values: Mapping[str, float]) -> dict[str, Any]:
    """Return what a function that builds a system gets: values by the names that were given.

    Parameters
    ----------
    parameters
        Those that act in the system.
    values
        Of single parameters by name.
    """
    arrays = vectors_of(parameters, values)
    return {
        p.base or p.vector or p.name: values[p.name] if p.vector is None else arrays[p.vector]
        for p in parameters
    }


def _depth(value: object) -> int:
    """Return how deep sequences are nested in a value; 0 of a number or None."""
    if isinstance(value, np.ndarray):
        return value.ndim
    if isinstance(value, str) or not isinstance(value, Sequence):
        return 0
    return 1 + max((_depth(entry) for entry in value), default=0)
