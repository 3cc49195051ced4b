"""Whether the noise that data state is as large as residuals are."""

from __future__ import annotations

import math

# Residual variance up to which noise counts as stated not quite rightly (22 % too small).
MAX_VARIANCE = 1.5
# Where a tenth of the residuals lies far beyond the quantile of `intervals.residual_variance`:
# (Phi^-1(0.5 + 0.35 / 0.9) / Phi^-1(0.85))^2.
_OUTLIERS_MAKE = 1.39


def noise_explains(residual_variance: float, count: int, *, robust: bool = False) -> bool:
    """Whether the variance of `count` weighted residuals is 1 to three sigma, or less.

    That of robust losses is allowed what a tenth of outliers makes of 1, and varies as a quantile
    does (by ``3.6 / count``: Cramer, Mathematical Methods of Statistics, 1946, section 28.5).
    """
    if robust:
        return bool(residual_variance <= _OUTLIERS_MAKE + 3.0 * math.sqrt(3.6 / count))
    return bool(residual_variance <= 1.0 + 3.0 * math.sqrt(2.0 / count))


def noise_overstated(residual_variance: float, count: int, *, robust: bool = False) -> bool:
    """Whether the variance of `count` weighted residuals is far below 1, by three sigma and more.

    "Far" is what `MAX_VARIANCE` is above 1.
    """
    spread = math.sqrt((3.6 if robust else 2.0) / count)
    return bool(residual_variance < min(1.0 / MAX_VARIANCE, 1.0 - 3.0 * spread))
