"""The spring and damper that a MuJoCo ``solref`` means."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dashpot import _core
from dashpot.law.arguments import real_array


def _solref_pair(solref: ArrayLike) -> Any:
    pair = real_array("solref", solref)
    if pair.shape != (2,):
        raise ValueError(f"solref must have shape (2,), got {pair.shape}")
    return pair


def _one_number(name: str, value: ArrayLike, **limits: Any) -> float:
    array = real_array(name, value, **limits)
    if array.shape != ():
        raise TypeError(f"{name} must be one number, got {value!r}")
    return float(array)


def solref_to_spring(solref: ArrayLike, *, impedance_width: float = 1.0) -> tuple[float, float]:
    """Return mass-normalised stiffness (1/s^2) and damping (1/s) of a MuJoCo solref pair.

    Parameters
    ----------
    solref : array_like, shape (2,)
        (timeconst, dampratio), both > 0, or (-stiffness, -damping), both <= 0.
    impedance_width : float
        ``d_width`` of solimp, in (0, 1].

    Returns
    -------
    tuple
        (1 / (d_width timeconst dampratio)^2, 2 / (d_width timeconst)) or (stiffness / d_width^2,
        damping / d_width), as in MuJoCo's documentation, "Solver parameters".

    Raises
    ------
    TypeError, ValueError
        An argument is not real, of a wrong shape or out of range.

    Examples
    --------
    >>> k, d = dashpot.law.solref_to_spring([0.02, 1.0], impedance_width=0.95)  # MuJoCo's defaults
    >>> round(k, 2), round(d, 2)
    (2770.08, 105.26)
    """
    pair = _solref_pair(solref)
    width = _one_number("impedance_width", impedance_width)
    stiffness, damping = _core.solref_to_spring(pair[0], pair[1], width)
    return stiffness, damping


def solref_to_spring_at_rest(
    solref: ArrayLike,
    *,
    solimp: ArrayLike = (0.9, 0.95, 0.001, 0.5, 2.0),
    load: float | None = None,
) -> tuple[float, float]:
    """Return the mass-normalised spring and damper that the engine takes a MuJoCo row for.

    At rest a row of MuJoCo carries a load with the stiffness d^2 k / (1 - d). d is its impedance at
    that deformation, and k that of :func:`solref_to_spring` with its d_width. In free motion it
    swings with d^2 k, as if its mass were 1 / (1 - d) times as large. The spring and damper deform
    as far at rest and have the same damping ratio, hence the same restitution.

    Parameters
    ----------
    solref : array_like, shape (2,)
        (timeconst, dampratio), both > 0, or (-stiffness, -damping), both <= 0.
    solimp : array_like, shape (5,)
        (d_0, d_width, width, midpoint, power), all >= 0, width in m or rad. Impedances and the
        midpoint are clipped to [0.0001, 0.9999], as in MuJoCo.
    load : float, optional
        Acceleration (m/s^2 or rad/s^2, > 0) that the row has to balance, for which d is found;
        without it d is d_width. The engine takes the weight of the lighter tree for contacts, which
        is g for a free body, and d_width for limits, equalities and friction loss.

    Returns
    -------
    tuple
        (d^2 k / (1 - d), d b / sqrt(1 - d)), in 1/s^2 and 1/s. The engine's row has the first over
        A as its stiffness (N/m) and the second over sqrt(A w) as its damping (N s/m). A is MuJoCo's
        estimate of the inverse mass (``efc_diagApprox``), w the apparent inverse mass.

    Raises
    ------
    TypeError, ValueError
        An argument is not real, of a wrong shape or out of range.

    Examples
    --------
    >>> solimp = [0.9, 0.95, 0.001, 0.5, 2]
    >>> k, d = dashpot.law.solref_to_spring_at_rest([0.02, 1.0], solimp=solimp, load=9.81)
    >>> round(1e3 * 9.81 / k, 3)  # mm, by which it sags under its weight
    0.367
    """
    pair = _solref_pair(solref)
    impedance = real_array("solimp", solimp, lower=0.0)
    if impedance.shape != (5,):
        raise ValueError(f"solimp must have shape (5,), got {impedance.shape}")
    value = np.inf if load is None else _one_number("load", load, lower=0.0, strict=True)
    stiffness, damping = _core.solref_to_spring_at_rest(pair, impedance, value)
    return stiffness, damping
