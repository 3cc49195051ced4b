"""The closed-form flow of one contact and of one spring-damper."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot import _core
from dashpot.law.arguments import over_arrays, real_array


class Propagator(NamedTuple):
    """``E0`` to ``E4`` at one time: s^n for ``En``.

    Examples
    --------
    >>> at = dashpot.law.propagate(1e-3, stiffness=1e4, damping=10.0, inverse_mass=1.0)
    >>> float(at.e0.round(6)), float(at.e1.round(9))
    (0.985087, 0.000993359)
    """

    e0: NDArray[np.float64]
    e1: NDArray[np.float64]
    e2: NDArray[np.float64]
    e3: NDArray[np.float64]
    e4: NDArray[np.float64]


class Flow(NamedTuple):
    """What a contact does over an interval.

    Examples
    --------
    >>> flow = dashpot.law.flow_contact(
    ...     1e-3, -1.0, -9.81, 0.1, stiffness=1e4, damping=20.0, inverse_mass=1.0
    ... )
    >>> bool(flow.touched), int(flow.events), float(flow.rate.round(4))
    (True, 2, 0.0752)
    """

    impulse: NDArray[np.float64]
    """``p``, the time integral of the force, N s; never negative for a contact."""
    moment: NDArray[np.float64]
    """``r``, the double time integral of the force, N s^2: the gap changes by ``w r``."""
    gap: NDArray[np.float64]
    """Gap at the end, m."""
    rate: NDArray[np.float64]
    """Gap rate at the end, m/s."""
    force: NDArray[np.float64]
    """Force at the end, N."""
    touched: NDArray[np.bool_]
    """Whether the contact acted at some instant."""
    events: NDArray[np.int32]
    """Onsets, releases and re-contacts inside the interval."""


def _parameters(
    stiffness: ArrayLike, damping: ArrayLike, inverse_mass: ArrayLike
) -> dict[str, Any]:
    return {
        "stiffness": real_array("stiffness", stiffness, lower=0.0),
        "damping": real_array("damping", damping, lower=0.0),
        "inverse_mass": real_array("inverse_mass", inverse_mass, lower=0.0, strict=True),
    }


def propagate(
    time: ArrayLike, *, stiffness: ArrayLike, damping: ArrayLike, inverse_mass: ArrayLike
) -> Propagator:
    """Return the propagator ``E0 ... E4`` of a spring-damper.

    ``En`` (n >= 2) solves ``y'' + w d y' + w k y = t^(n-2)/(n-2)!`` from rest, ``E1 = E2'`` and
    ``E0 = E1'``.

    Parameters
    ----------
    time : array_like
        s, >= 0.
    stiffness, damping, inverse_mass : array_like
        N/m, >= 0; N s/m, >= 0; 1/kg, > 0.

    Raises
    ------
    TypeError, ValueError
        An argument is not real, not finite or out of range.

    Examples
    --------
    >>> at = dashpot.law.propagate([0.0, 1e-3], stiffness=1e4, damping=0.0, inverse_mass=1.0)
    >>> at.e0.round(6)  # cos(omega t) without damping
    array([1.      , 0.995004])
    """
    arguments = _parameters(stiffness, damping, inverse_mass)
    arguments["time"] = real_array("time", time, lower=0.0)
    return Propagator(*over_arrays(_core.propagate, arguments))


def flow_contact(
    gap: ArrayLike,
    rate: ArrayLike,
    load: ArrayLike,
    time: ArrayLike,
    *,
    stiffness: ArrayLike,
    damping: ArrayLike,
    inverse_mass: ArrayLike,
) -> Flow:
    """Return the exact flow of a unilateral Kelvin-Voigt contact over an interval.

    A contact that starts in penetration with ``-k g - d g' < 0`` counts as released.

    Parameters
    ----------
    gap, rate : array_like
        Gap (m, negative in penetration) and gap rate (m/s) at the start.
    load : array_like
        Acceleration ``b`` of the gap without this contact, m/s^2; negative presses.
    time : array_like
        Length of the interval, s, >= 0.
    stiffness, damping, inverse_mass : array_like
        N/m, >= 0; N s/m, >= 0; 1/kg, > 0.

    Raises
    ------
    TypeError, ValueError
        An argument is not real, not finite or out of range.

    Examples
    --------
    >>> flow = dashpot.law.flow_contact(
    ...     1e-3, -1.0, 0.0, 0.1, stiffness=1e4, damping=20.0, inverse_mass=1.0
    ... )
    >>> float(flow.rate.round(4))  # m/s: it came with 1 m/s, and has left
    0.7441
    """
    parameters = _parameters(stiffness, damping, inverse_mass)
    return _flow(_core.flow_contact, parameters, "gap", gap, rate, load, time)


def flow_spring(
    displacement: ArrayLike,
    rate: ArrayLike,
    load: ArrayLike,
    time: ArrayLike,
    *,
    stiffness: ArrayLike,
    damping: ArrayLike,
    inverse_mass: ArrayLike,
) -> Flow:
    """Return the exact flow of a bilateral spring-damper: ``f = -k x - d x'`` of either sign.

    Parameters are those of `flow_contact`, with a displacement (m) in place of the gap.

    Raises
    ------
    TypeError, ValueError
        An argument is not real, not finite or out of range.

    Examples
    --------
    >>> half_swing = math.pi / 100
    >>> flow = dashpot.law.flow_spring(
    ...     1e-3, 0.0, 0.0, half_swing, stiffness=1e4, damping=0.0, inverse_mass=1.0
    ... )
    >>> float(flow.gap.round(9))
    -0.001
    """
    parameters = _parameters(stiffness, damping, inverse_mass)
    return _flow(_core.flow_spring, parameters, "displacement", displacement, rate, load, time)


def _flow(
    function: Any,
    parameters: dict[str, Any],
    position_name: str,
    position: ArrayLike,
    rate: ArrayLike,
    load: ArrayLike,
    time: ArrayLike,
) -> Flow:
    """Call a flow of the core from a position, a gap or a displacement."""
    arguments = {
        **parameters,
        position_name: real_array(position_name, position),
        "rate": real_array("rate", rate),
        "load": real_array("load", load),
        "time": real_array("time", time, lower=0.0),
    }
    return Flow(*over_arrays(function, arguments))
