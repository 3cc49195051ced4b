"""What data know of products of powers of parameters.

Contact parameters trade against each other: a bounce tells damping over the root of stiffness much
better than either. Their logarithms l, of covariance C, have uncorrelated combinations v . l, v the
eigenvectors of C, whose variances are its eigenvalues. In the parameters these are products of
powers: prod x_i^v_i is known to a relative error of the root of its eigenvalue. The first is what
the data know best, the last what they know least (the axes of the confidence ellipsoid; Transtrum
et al., J. Chem. Phys. 143, 010901, 2015, on stiff and sloppy ones).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Exponents below this are not printed.
_SMALL = 0.005


@dataclass(frozen=True)
class Combination:
    """A product of powers of parameters, whose estimate is uncorrelated with those of the others.

    Attributes
    ----------
    exponents
        By the parameters' names; the largest in magnitude is 1.
    value
        The product at the estimates, in the product of their units.
    relative_error
        Its standard error over its value, to first order (that of its logarithm).

    Examples
    --------
    >>> from dashpot.calibrate import Combination
    >>> known = Combination({"stiffness": 1.0, "mass": -1.0}, value=1e4, relative_error=0.01)
    >>> known.exponents["mass"]
    -1.0
    """

    exponents: Mapping[str, float]
    value: float
    relative_error: float

    def __str__(self) -> str:
        """Return it as a formula with its value, such as ``d · k^-0.50 = 0.29 ± 0.2 %``."""
        powers = sorted(self.exponents.items(), key=lambda item: -abs(item[1]))
        factors = [
            name if exponent == 1.0 else f"{name}^{exponent:.2f}"
            for name, exponent in powers
            if abs(exponent) >= _SMALL
        ]
        return f"{' · '.join(factors)} = {self.value:.4g} ± {100 * self.relative_error:.2g} %"


def combinations(
    names: Sequence[str], values: Sequence[float], relative_errors: Array, correlation: Array
) -> tuple[Combination, ...]:
    """Return the uncorrelated products of powers of positive parameters, the best known first.

    Parameters
    ----------
    names, values
        Of p parameters, values > 0.
    relative_errors
        (p,) standard errors of their logarithms, finite.
    correlation
        (p, p) of their logarithms.
    """
    covariance = correlation * np.outer(relative_errors, relative_errors)
    variances, directions = np.linalg.eigh(covariance)
    found = []
    for variance, direction in zip(variances, directions.T, strict=True):
        largest = direction[np.argmax(np.abs(direction))]
        exponents = direction / largest
        logarithm = sum(e * math.log(v) for e, v in zip(exponents, values, strict=True))
        found.append(
            Combination(
                {name: float(e) for name, e in zip(names, exponents, strict=True)},
                math.exp(logarithm),
                # Rounding may leave a variance of 0 below it.
                math.sqrt(max(float(variance), 0.0)) / abs(float(largest)),
            )
        )
    return tuple(found)
