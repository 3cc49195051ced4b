"""Dataclasses as plain JSON, and back, checked against the types of their fields.

Numbers that JSON has not are the words "nan", "inf" and "-inf". Arrays are nested lists; those
without any number say their shape. Where a field may be one of several dataclasses, an object says
which under "is".
"""

from __future__ import annotations

import dataclasses
import math
import types
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, SupportsIndex, Union, get_args, get_origin, get_type_hints

import numpy as np

__all__ = ["decoded", "decoded_fields", "encoded"]

_WORDS = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
_MOST_DIMENSIONS = 8
_NONE: Mapping[str, type] = types.MappingProxyType({})


def encoded(value: Any) -> Any:
    """Return a value as what `json` writes; raise TypeError naming the type that has no form."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, np.ndarray):
        return _array_encoded(value)
    if isinstance(value, Mapping):
        return {str(key): encoded(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [encoded(item) for item in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        told = {
            field.name: encoded(getattr(value, field.name))
            for field in dataclasses.fields(value)
            if field.init
        }
        return {"is": type(value).__name__, **told}
    raise TypeError(f"{type(value).__name__} has no plain form")


def decoded(kind: Any, value: Any, label: str, known: Mapping[str, type] = _NONE) -> Any:
    """Return what `encoded` was given, of the type `kind`.

    Parameters
    ----------
    kind
        An annotation: a plain type, dataclass, tuple, mapping, array, literal, or a union.
    value
        What `json` has read.
    label
        Names it in messages.
    known
        Dataclasses by name, one of which stands where `kind` is a function.

    Raises
    ------
    ValueError
        Naming what is missing, unknown or of another type.
    """
    origin = get_origin(kind)
    if origin in (Union, types.UnionType):
        return _of_union(get_args(kind), value, label, known)
    if origin is Literal:
        _require(value in get_args(kind) and not isinstance(value, list | dict), label, kind, value)
        return value
    if origin is tuple:
        return _tuple(get_args(kind), value, label, known)
    if origin is np.ndarray:
        return _array(value, label)
    if origin is Sequence:
        return _tuple((get_args(kind)[0], ...), value, label, known)
    if origin is not None and issubclass(origin, Mapping):
        _require(isinstance(value, dict), label, "an object", value)
        item = get_args(kind)[1]
        return {key: decoded(item, part, f"{label}.{key}", known) for key, part in value.items()}
    if origin is not None and issubclass(origin, Callable):  # type: ignore[arg-type]
        _require(isinstance(value, dict) and value.get("is") in known, label, "known", value)
        return decoded(known[value["is"]], value, label, known)
    if dataclasses.is_dataclass(kind):
        return _dataclass(kind, value, label, known)
    if kind in (None, type(None)):
        _require(value is None, label, "null", value)
        return None
    if kind is float:
        number = _WORDS.get(value, value) if isinstance(value, str) else value
        fits = isinstance(number, int | float) and not isinstance(number, bool)
        _require(fits, label, "a number", value)
        return float(number)
    if kind is SupportsIndex:
        kind = int
    if kind in (int, str, bool):
        fits = isinstance(value, kind) and (kind is bool or not isinstance(value, bool))
        _require(fits, label, kind.__name__, value)
        return value
    raise TypeError(f"{label}: {kind} has no plain form")


def _require(holds: bool, label: str, kind: Any, value: Any) -> None:
    if not holds:
        shown = repr(value)
        raise ValueError(f"{label} is {shown[:80]}{'...' * (len(shown) > 80)}; it must be {kind}")


def _of_union(kinds: tuple[Any, ...], value: Any, label: str, known: Mapping[str, type]) -> Any:
    """Return a value of the first kind that takes it; of one kind beside None its message is it."""
    if value is None and type(None) in kinds:
        return None
    left = [kind for kind in kinds if kind is not type(None)]
    # A whole number is no float where both may be.
    left.sort(key=lambda kind: kind is float)
    problem: ValueError | None = None
    for kind in left:
        if dataclasses.is_dataclass(kind) and isinstance(value, dict):
            name = getattr(kind, "__name__", "")
            if len(left) > 1 and value.get("is") != name:
                continue
        try:
            return decoded(kind, value, label, known)
        except ValueError as error:
            problem = problem or error
    raise problem or ValueError(f"{label} is none of {kinds}")


def _tuple(kinds: tuple[Any, ...], value: Any, label: str, known: Mapping[str, type]) -> Any:
    _require(isinstance(value, list), label, "a list", value)
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        kinds = (kinds[0],) * len(value)
    _require(len(kinds) == len(value), label, f"a list of {len(kinds)}", value)
    return tuple(
        decoded(kind, item, f"{label}[{i}]", known)
        for i, (kind, item) in enumerate(zip(kinds, value, strict=True))
    )


def decoded_fields(
    kind: Any,
    value: Any,
    label: str,
    known: Mapping[str, type] = _NONE,
    *,
    left_out: tuple[str, ...] = (),
    names: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Return the fields of a dataclass by name, decoded; as `decoded` does.

    Those `left_out` may not be there; `names` are known to annotations beside their module's.
    """
    _require(isinstance(value, dict), label, f"an object, {kind.__name__}", value)
    hints = get_type_hints(kind, localns=names)
    own = {f.name: f for f in dataclasses.fields(kind) if f.init and f.name not in left_out}
    given = {key: part for key, part in value.items() if key != "is"}
    unknown = given.keys() - own.keys()
    if unknown:
        raise ValueError(f"{label}.{min(unknown)} is unknown; {kind.__name__} has no such field")
    empty = dataclasses.MISSING
    for name, field in own.items():
        if name not in given and field.default is empty and field.default_factory is empty:
            raise ValueError(f"{label}.{name} is missing")
    return {
        name: decoded(hints[name], part, f"{label}.{name}", known) for name, part in given.items()
    }


def _dataclass(kind: Any, value: Any, label: str, known: Mapping[str, type]) -> Any:
    parts = decoded_fields(kind, value, label, known)
    try:
        return kind(**parts)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{label}: {error}") from error


def _array_encoded(array: np.ndarray[Any, Any]) -> Any:
    if not array.size:
        return {"shape": list(array.shape)}
    if np.isfinite(array).all():
        return array.tolist()
    return _nested(array.tolist())


def _nested(value: Any) -> Any:
    return [_nested(item) for item in value] if isinstance(value, list) else encoded(value)


def _array(value: Any, label: str) -> np.ndarray[Any, Any]:
    try:
        if isinstance(value, list):
            return np.array(_numbers(value, 0), dtype=np.float64)
        sizes = list(value["shape"])
        if 0 in sizes and all(type(size) is int for size in sizes):
            return np.empty(sizes)
    except (ValueError, TypeError, KeyError, OverflowError, MemoryError):
        pass
    raise ValueError(f"{label} is no array of numbers")


def _numbers(value: Any, depth: int) -> Any:
    """Return nested lists of numbers with words made numbers; raise ValueError for all else."""
    if isinstance(value, list) and depth < _MOST_DIMENSIONS:
        return [_numbers(item, depth + 1) for item in value]
    if type(value) in (int, float):
        return value
    return _WORDS[value] if isinstance(value, str) and value in _WORDS else _no_number()


def _no_number() -> float:
    raise ValueError("no number")
