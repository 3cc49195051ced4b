"""The contact law of the C++ core, vectorised over numpy arrays.

One contact with gap ``g`` (m, negative in penetration), gap rate ``u = g'`` (m/s), apparent inverse
mass ``w`` (1/kg) and acceleration ``b`` (m/s^2) of the gap from everything but its own force obeys

    g'' = b + w f,    f = max(0, -k g - d g')  while g < 0,  else 0.

Between events this is linear and its flow is closed form; onset, release and re-contact inside the
interval are solved. All arguments broadcast; results have the broadcast shape.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot import _core

__all__ = [
    "Flow",
    "Propagator",
    "damping_ratio_to_restitution",
    "flow_contact",
    "flow_spring",
    "propagate",
    "radial_return",
    "restitution_to_damping_ratio",
    "return_to_limit",
    "solref_to_spring",
    "solref_to_spring_at_rest",
]

_MAX_FRICTION_DIRECTIONS = 5


class Propagator(NamedTuple):
    """``E0`` to ``E4`` at one time: s^n for ``En``."""

    e0: NDArray[np.float64]
    e1: NDArray[np.float64]
    e2: NDArray[np.float64]
    e3: NDArray[np.float64]
    e4: NDArray[np.float64]


class Flow(NamedTuple):
    """What a contact does over an interval."""

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


def _array(
    name: str,
    value: ArrayLike,
    *,
    lower: float | None = None,
    strict: bool = False,
    infinite: bool = False,
) -> Any:
    """Return `value` as a float array, at least `lower` (above it if `strict`), or raise.

    Numbers have to be finite; if `infinite`, inf is one too.
    """
    raw = np.asarray(value)
    if raw.dtype.kind not in "iuf":
        raise TypeError(f"{name} must be real numbers, got {value!r}")
    array = raw.astype(np.float64)
    good = ~np.isnan(array) if infinite else np.isfinite(array)
    if lower is not None:
        good &= (array > lower) if strict else (array >= lower)
    if not np.all(good):
        bound = "" if lower is None else f" and {'>' if strict else '>='} {lower:g}"
        raise ValueError(f"{name} must be finite{bound}, got {array[~good].flat[0]:g}")
    return array


def _parameters(
    stiffness: ArrayLike, damping: ArrayLike, inverse_mass: ArrayLike
) -> dict[str, Any]:
    return {
        "stiffness": _array("stiffness", stiffness, lower=0.0),
        "damping": _array("damping", damping, lower=0.0),
        "inverse_mass": _array("inverse_mass", inverse_mass, lower=0.0, strict=True),
    }


def _broadcast(arguments: dict[str, Any]) -> Any:
    """Return arrays of one shape; raise ValueError with the names and shapes that have none."""
    try:
        return np.broadcast_arrays(*arguments.values())
    except ValueError:
        shapes = ", ".join(f"{name} {np.shape(array)}" for name, array in arguments.items())
        raise ValueError(f"shapes do not broadcast: {shapes}") from None


def _over_arrays(function: Any, arguments: dict[str, Any]) -> list[Any]:
    """Call a core function of one-dimensional arrays on broadcast arguments, in their order."""
    arrays = _broadcast(arguments)
    shape = arrays[0].shape
    results = function(*(np.ascontiguousarray(array).ravel() for array in arrays))
    return [result.reshape(shape)[()] for result in results]


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
    """
    arguments = _parameters(stiffness, damping, inverse_mass)
    arguments["time"] = _array("time", time, lower=0.0)
    return Propagator(*_over_arrays(_core.propagate, arguments))


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
        position_name: _array(position_name, position),
        "rate": _array("rate", rate),
        "load": _array("load", load),
        "time": _array("time", time, lower=0.0),
    }
    return Flow(*_over_arrays(function, arguments))


def _friction_arguments(
    impulse: ArrayLike, mu: ArrayLike, normal_impulse: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return checked impulses and coefficients (..., m) and normal impulses (...)."""
    trial = _array("impulse", impulse)
    coefficients = _array("mu", mu, lower=0.0)
    normal = _array("normal_impulse", normal_impulse, lower=0.0)
    if trial.ndim == 0 or not 1 <= trial.shape[-1] <= _MAX_FRICTION_DIRECTIONS:
        raise ValueError(
            f"impulse must have shape (..., m) with m from 1 to {_MAX_FRICTION_DIRECTIONS}, "
            f"got shape {trial.shape}"
        )
    trial, coefficients, normal = _broadcast(
        {"impulse": trial, "mu": coefficients, "normal_impulse[..., None]": normal[..., np.newaxis]}
    )
    return trial, coefficients, normal[..., 0]


def radial_return(
    impulse: ArrayLike, mu: ArrayLike, normal_impulse: ArrayLike
) -> NDArray[np.float64]:
    """Return friction impulses scaled back to the elliptic limit surface.

    The surface is ``sum_i (p_i / mu_i)^2 <= p_n^2``; impulses inside are returned unchanged, and a
    direction with ``mu_i = 0`` carries nothing.

    Parameters
    ----------
    impulse : array_like, shape (..., m), m <= 5
        Trial impulses, N s (N m s for torsion and rolling).
    mu : array_like, broadcastable with ``impulse``
        Friction coefficients, >= 0 (m for torsion and rolling).
    normal_impulse : array_like, shape (...)
        Normal impulse, N s, >= 0.

    Returns
    -------
    ndarray, shape (..., m)
        Impulses on or inside the limit surface.

    Raises
    ------
    TypeError, ValueError
        An argument is not real, not finite, out of range or of a wrong shape.
    """
    trial, coefficients, normal = _friction_arguments(impulse, mu, normal_impulse)
    directions = trial.shape[-1]
    factor = _core.radial_return(
        trial.reshape(-1, directions),
        coefficients.reshape(-1, directions),
        normal.ravel(),
    )
    scaled = trial * factor.reshape(trial.shape[:-1])[..., np.newaxis]
    return np.where(coefficients > 0.0, scaled, 0.0)


def return_to_limit(
    impulse: ArrayLike, mu: ArrayLike, response: ArrayLike, normal_impulse: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return friction impulses whose sliders slip where they dissipate most.

    Outside the surface ``sum_i (p_i / mu_i)^2 <= p_n^2`` the trial impulses ``t`` become
    ``p_i = t_i / (1 + gamma c_i / mu_i^2)`` with the ``gamma >= 0`` that puts them on it: the slip,
    ``(t_i - p_i) / c_i``, is normal to the surface. Where all ``c_i / mu_i^2`` agree this is
    `radial_return`.

    Parameters
    ----------
    impulse, mu, normal_impulse : array_like
        As in `radial_return`.
    response : array_like, broadcastable with ``impulse``
        Impulse ``c_i >= 0`` by which each direction answers a unit of rate, N s per m/s (N m s per
        rad/s); only their proportions matter.

    Returns
    -------
    impulse : ndarray, shape (..., m)
        Impulses on or inside the limit surface.
    sticks : ndarray of bool, shape (...)
        Whether nothing had to slip.

    Raises
    ------
    TypeError, ValueError
        An argument is not real, not finite, out of range or of a wrong shape.
    """
    trial, coefficients, normal = _friction_arguments(impulse, mu, normal_impulse)
    trial, coefficients, answers = _broadcast(
        {
            "impulse": trial,
            "mu": coefficients,
            "response": _array("response", response, lower=0.0),
        }
    )
    normal = np.broadcast_to(normal, trial.shape[:-1])
    directions = trial.shape[-1]
    returned, sticks = _core.return_to_limit(
        trial.reshape(-1, directions),
        coefficients.reshape(-1, directions),
        answers.reshape(-1, directions),
        normal.ravel(),
    )
    return returned.reshape(trial.shape), sticks.reshape(trial.shape[:-1])


def damping_ratio_to_restitution(damping_ratio: ArrayLike) -> Any:
    """Return the coefficient of restitution of an unloaded contact that never pulls.

    With ``zeta = cos(psi)`` it is ``exp(-2 zeta psi / sin(psi))``, continued to ``zeta > 1`` by
    ``zeta = cosh(eta)``: 1 at zeta = 0, exp(-2) at 1, about 1/(4 zeta^2) for large zeta, 0 at inf
    (Schwager and Poeschel, Granular Matter 9, 2007).

    Raises
    ------
    TypeError, ValueError
        `damping_ratio` is not real, NaN or negative.
    """
    ratios = _array("damping_ratio", damping_ratio, lower=0.0, infinite=True)
    return _core.damping_ratio_to_restitution(ratios)


def restitution_to_damping_ratio(restitution: ArrayLike) -> Any:
    """Return the damping ratio that gives a coefficient of restitution; inf for restitution 0.

    The inverse of `damping_ratio_to_restitution` to rounding.

    Raises
    ------
    TypeError, ValueError
        `restitution` is not real or not in [0, 1].
    """
    values = _array("restitution", restitution)
    good = (values >= 0.0) & (values <= 1.0)
    if not np.all(good):
        raise ValueError(f"restitution must be in [0, 1], got {values[~good].flat[0]:g}")
    return _core.restitution_to_damping_ratio(values)


def _solref_pair(solref: ArrayLike) -> Any:
    pair = _array("solref", solref)
    if pair.shape != (2,):
        raise ValueError(f"solref must have shape (2,), got {pair.shape}")
    return pair


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
    """
    pair = _solref_pair(solref)
    width = _array("impedance_width", impedance_width)
    stiffness, damping = _core.solref_to_spring(pair[0], pair[1], float(width))
    return stiffness, damping


def solref_to_spring_at_rest(
    solref: ArrayLike,
    *,
    solimp: ArrayLike = (0.9, 0.95, 0.001, 0.5, 2.0),
    load: float | None = None,
) -> tuple[float, float]:
    """Return the mass-normalised spring and damper that the engine takes a MuJoCo row for.

    At rest a row of MuJoCo carries a load with the stiffness d^2 k / (1 - d), d being its impedance
    at that deformation and k that of :func:`solref_to_spring`; in free motion it swings with d^2 k,
    as if its mass were 1 / (1 - d) times as large. The spring and damper deform as far at rest and
    have the same damping ratio, hence the same restitution.

    Parameters
    ----------
    solref : array_like, shape (2,)
        (timeconst, dampratio), both > 0, or (-stiffness, -damping), both <= 0.
    solimp : array_like, shape (5,)
        (d_0, d_width, width, midpoint, power); width in m or rad.
    load : float, optional
        Acceleration (m/s^2 or rad/s^2, > 0) that the row has to balance, for which d is found;
        without it d is d_width. The engine takes the weight of the lighter tree for contacts, which
        is g for a free body, and d_width for limits, equalities and friction loss.

    Returns
    -------
    tuple
        (d^2 k / (1 - d), d b / sqrt(1 - d)), in 1/s^2 and 1/s. Over MuJoCo's estimate A of the
        inverse mass (``efc_diagApprox``) and over sqrt(A w), w being the apparent inverse mass,
        they are the stiffness (N/m) and damping (N s/m) of the engine's row.

    Raises
    ------
    TypeError, ValueError
        An argument is not real, of a wrong shape or out of range.
    """
    pair = _solref_pair(solref)
    impedance = _array("solimp", solimp, lower=0.0)
    if impedance.shape != (5,):
        raise ValueError(f"solimp must have shape (5,), got {impedance.shape}")
    value = np.inf if load is None else float(_array("load", load, lower=0.0, strict=True))
    stiffness, damping = _core.solref_to_spring_at_rest(pair, impedance, value)
    return stiffness, damping
