"""Where the search of a quantity starts, and how far it goes, where nobody says."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.setters import FRICTION, FRICTION_INDEX
from dashpot.calibrate.problem.vectors import is_vector

#: Start, lower and upper bound of quantities of materials, in SI units: wide, of what there is.
RANGES: dict[str, tuple[float, float, float]] = {
    "stiffness": (1e4, 1e1, 1e8),
    "damping": (10.0, 1e-2, 1e4),
    "damping_ratio": (0.2, 1e-3, 5.0),
    # Smaller ones cannot be told from 0.05 where there is friction.
    "restitution": (0.6, 0.05, 0.99),
    "sliding_friction": (0.3, 0.01, 3.0),
    "torsional_friction": (5e-3, 1e-5, 0.2),
    "rolling_friction": (1e-3, 1e-6, 0.05),
    "loaded_friction": (0.2, 0.01, 3.0),
    "friction_load": (10.0, 1e-2, 1e4),
    "tangential_ratio": (0.7, 0.05, 5.0),
    "tangential_damping_ratio": (0.2, 1e-3, 5.0),
}
# A start given alone widens the bounds to this many times it, and a hundredth.
_WIDER = 100.0


def range_of(quantity: str, start: Any, bounds: Any) -> tuple[Any, Any]:
    """Return the start and the bounds of a material's quantity; tuples of them for its friction.

    Raises
    ------
    ValueError
        Where there are several numbers of one, or not three of friction.
    """
    if quantity != FRICTION:
        if is_vector(start, bounds):
            raise ValueError(f"{quantity} of a material is one number, got start {start!r}")
        return start_and_bounds(quantity, start, bounds)
    count = len(FRICTION_INDEX)
    starts = (None,) * count if start is None else start
    each = bounds if is_vector(None, bounds) else (bounds,) * count
    if not is_vector(starts, None) or len(starts) != count or len(each) != count:
        raise ValueError(
            f"{FRICTION} is {count} numbers, {', '.join(FRICTION_INDEX)}; got start {start!r} and "
            f"bounds {bounds!r}"
        )
    found = map(start_and_bounds, FRICTION_INDEX, starts, each)
    own_starts, own_bounds = zip(*found, strict=True)
    return own_starts, own_bounds


def start_and_bounds(
    quantity: str, start: float | None, bounds: tuple[float, float] | None
) -> tuple[float, tuple[float, float]]:
    """Return the start and the bounds of a material's quantity, those given where they are.

    Bounds given alone start the search at their geometric mean, of a restitution in the middle.
    """
    default, lower, upper = RANGES[quantity]
    if bounds is None and start is None:
        return default, (lower, upper)
    if bounds is None:
        if quantity != "restitution" and isinstance(start, float | int) and start > 0.0:
            lower, upper = min(lower, start / _WIDER), max(upper, start * _WIDER)
        return start, (lower, upper)  # type: ignore[return-value]
    if start is not None:
        return start, bounds
    return middle(bounds, logarithmic=quantity != "restitution"), bounds


def middle(bounds: Sequence[float] | NDArray[np.float64], *, logarithmic: bool) -> float:
    """Return the geometric or arithmetic mean of two bounds."""
    if logarithmic and min(bounds) > 0.0:
        return math.sqrt(bounds[0] * bounds[1])
    return float(0.5 * (bounds[0] + bounds[1]))
