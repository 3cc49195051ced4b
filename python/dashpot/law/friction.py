"""The limit surface of friction impulses, and their return to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot import _core
from dashpot.law.arguments import broadcast, real_array

_MAX_FRICTION_DIRECTIONS = 5


def _friction_arguments(
    impulse: ArrayLike, mu: ArrayLike, normal_impulse: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return checked impulses and coefficients (..., m) and normal impulses (...)."""
    trial = real_array("impulse", impulse)
    coefficients = real_array("mu", mu, lower=0.0)
    normal = real_array("normal_impulse", normal_impulse, lower=0.0)
    if trial.ndim == 0 or not 1 <= trial.shape[-1] <= _MAX_FRICTION_DIRECTIONS:
        raise ValueError(
            f"impulse must have shape (..., m) with m from 1 to {_MAX_FRICTION_DIRECTIONS}, "
            f"got shape {trial.shape}"
        )
    trial, coefficients, normal = broadcast(
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

    Examples
    --------
    >>> dashpot.law.radial_return([3.0, 4.0], [0.5, 0.5], 2.0)
    array([0.6, 0.8])
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

    Examples
    --------
    >>> mu, response = [0.5, 0.5], [1.0, 1.0]
    >>> impulse, sticks = dashpot.law.return_to_limit([3.0, 4.0], mu, response, 2.0)
    >>> impulse.round(6), bool(sticks)
    (array([0.6, 0.8]), False)
    """
    trial, coefficients, normal = _friction_arguments(impulse, mu, normal_impulse)
    trial, coefficients, answers = broadcast(
        {
            "impulse": trial,
            "mu": coefficients,
            "response": real_array("response", response, lower=0.0),
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
