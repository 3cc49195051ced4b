"""Parameter values drawn as likely as a fit holds them.

In the search coordinate z each parameter has the distribution whose quantiles are the ends of its
interval: normal scores n, stretched on either side of the estimate,

    z = estimate + n (upper - estimate) / q  for n > 0,   estimate + n (estimate - lower) / q  else,

q the normal quantile of the confidence, cut off at the bounds. The scores of the parameters have
the correlation of the estimates (a normal copula: Nelsen, An Introduction to Copulas, 2006, section
2.3). Parameters that the data say nothing of are drawn evenly, in z, from their range.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import special

from dashpot.calibrate.inference.estimate import Estimate
from dashpot.calibrate.problem.parameters import Parameter

Array = NDArray[np.float64]


def draw(
    parameters: Sequence[Parameter],
    estimates: Sequence[Estimate],
    correlation: Array,
    confidence: float,
    count: int,
    rng: np.random.Generator,
) -> Array:
    """Return (count, p) values of the p parameters.

    Parameters
    ----------
    parameters, estimates
        p of each.
    correlation
        (p, p) of the estimates, positive semidefinite but for rounding.
    confidence
        Of the intervals of the estimates.
    count
        Number of draws.
    rng
        Source of chance.
    """
    size, axes = np.linalg.eigh(correlation)
    root = axes * np.sqrt(np.maximum(size, 0.0))
    scores = rng.standard_normal((count, len(parameters))) @ root.T
    quantile = float(special.ndtri(0.5 + 0.5 * confidence))
    values = np.empty(scores.shape)
    for i, (parameter, estimate) in enumerate(zip(parameters, estimates, strict=True)):
        coordinate = parameter.coordinate
        if np.isfinite(estimate.standard_error):
            z, lower, upper = (
                coordinate.to_search(x) for x in (estimate.value, estimate.lower, estimate.upper)
            )
            side = np.where(scores[:, i] > 0.0, upper - z, z - lower)
            drawn = z + scores[:, i] * side / quantile
        else:
            lower, upper = coordinate.search_bounds
            drawn = lower + (upper - lower) * special.ndtr(scores[:, i])
        values[:, i] = [coordinate.to_value(float(z)) for z in drawn]
    return values
