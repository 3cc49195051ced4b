"""Damping ratio and coefficient of restitution."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dashpot import _core
from dashpot.law.arguments import real_array


def damping_ratio_to_restitution(damping_ratio: ArrayLike) -> Any:
    """Return the coefficient of restitution of an unloaded contact that never pulls.

    With ``zeta = cos(psi)`` it is ``exp(-2 zeta psi / sin(psi))``, continued to ``zeta > 1`` by
    ``zeta = cosh(eta)``. It is 1 at zeta = 0, exp(-2) at 1, about 1/(4 zeta^2) for large zeta, 0 at
    inf (Schwager and Poeschel, Granular Matter 9, 2007).

    Raises
    ------
    TypeError, ValueError
        `damping_ratio` is not real, NaN or negative.

    Examples
    --------
    >>> dashpot.law.damping_ratio_to_restitution([0.0, 0.1, 1.0]).round(4)
    array([1.    , 0.7441, 0.1353])
    """
    ratios = real_array("damping_ratio", damping_ratio, lower=0.0, infinite=True)
    return _core.damping_ratio_to_restitution(ratios)


def restitution_to_damping_ratio(restitution: ArrayLike) -> Any:
    """Return the damping ratio that gives a coefficient of restitution; inf for restitution 0.

    The inverse of `damping_ratio_to_restitution` to rounding.

    Raises
    ------
    TypeError, ValueError
        `restitution` is not real or not in [0, 1].

    Examples
    --------
    >>> dashpot.law.restitution_to_damping_ratio([1.0, 0.5, 0.0]).round(4)
    array([0.    , 0.2553,    inf])
    """
    values = real_array("restitution", restitution)
    good = (values >= 0.0) & (values <= 1.0)
    if not np.all(good):
        raise ValueError(f"restitution must be in [0, 1], got {values[~good].flat[0]:g}")
    return _core.restitution_to_damping_ratio(values)
