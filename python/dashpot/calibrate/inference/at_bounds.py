"""Which estimates lie at a bound, and which go along with those."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.parameters import Parameter

Array = NDArray[np.float64]

HIGH_CORRELATION = 0.95
# Share of the range (of log parameters in the log) within which a value counts as being at its
# bound.
_AT_BOUND = 1e-3


def bound_of(parameter: Parameter, z: float) -> str | None:
    """Say at which bound an estimate lies; None where at none."""
    at_lower, at_upper = at_bounds(parameter, z)
    if at_lower:
        return f"the estimate lies at its lower bound {parameter.bounds[0]:.4g}"
    if at_upper:
        return f"the estimate lies at its upper bound {parameter.bounds[1]:.4g}"
    return None


def at_bounds(parameter: Parameter, z: float) -> tuple[bool, bool]:
    """Whether a search coordinate lies at the lower and at the upper bound, or beyond."""
    if parameter.transform == "logit":
        # Near its ends the search coordinate moves on with little of the range: a share of that.
        z, (low, high) = parameter.coordinate.to_value(z), parameter.bounds
    else:
        low, high = parameter.coordinate.search_bounds
    margin = _AT_BOUND * (high - low)
    return z - low <= margin, high - z <= margin


def leaders(
    parameters: Sequence[Parameter], point: Array, correlation: Array
) -> tuple[str | None, ...]:
    """Return by parameter which one at a bound it goes along with; None: with none.

    It does where those at bounds together explain it with a multiple correlation that is high; the
    one that is correlated most is named.

    Parameters
    ----------
    parameters
        All p.
    point
        (p,) their estimates in search coordinates.
    correlation
        (p, p).
    """
    bound = np.array(
        [bound_of(p, float(z)) is not None for p, z in zip(parameters, point, strict=True)],
        dtype=bool,
    )
    known = np.flatnonzero(bound & (np.abs(correlation).sum(axis=1) > 1.0))
    if known.size == 0:
        return (None,) * len(parameters)
    among = correlation[np.ix_(known, known)]
    to_them = correlation[:, known]
    explained = np.einsum("ij,ji->i", to_them, np.linalg.pinv(among, hermitian=True) @ to_them.T)
    most = known[np.abs(to_them).argmax(axis=1)]
    return tuple(
        parameters[most[i]].name if not bound[i] and explained[i] > HIGH_CORRELATION**2 else None
        for i in range(len(parameters))
    )
