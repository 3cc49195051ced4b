"""Units of recordings: how many of SI's one of them is."""

from __future__ import annotations

import difflib
import math

from dashpot.checks import number

_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "km": 1e3, "in": 0.0254, "ft": 0.3048}
_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180.0}
UNITS = {
    **_LENGTHS,
    **_TIMES,
    **_ANGLES,
    "N": 1.0,
    "mN": 1e-3,
    "kN": 1e3,
    **{
        f"{name}/s{power}": factor
        for name, factor in (_LENGTHS | _ANGLES).items()
        for power in ("", "2")
    },
}


def factor_of(label: str, unit: str | float) -> float:
    """Return how many of SI's a unit is; a number is that already, negative for the other way.

    Raises
    ------
    ValueError
        Beginning with `label`, for a unit that is not known, or 0.
    """
    if isinstance(unit, str):
        factor = UNITS.get(unit.replace("µ", "u").replace("^", ""))
        if factor is not None:
            return factor
        near = difflib.get_close_matches(unit, UNITS, n=1)
        hint = f"did you mean {near[0]!r}?" if near else "give the factor to SI as a number"
        raise ValueError(f"{label} is {unit!r}, no unit that is known; {hint}")
    factor = number(label, unit)
    if not math.isfinite(factor) or factor == 0.0:
        raise ValueError(f"{label} must be a unit, or a finite number that is not 0, got {unit!r}")
    return factor
