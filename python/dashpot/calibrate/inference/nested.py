"""Whether data need the parameters that a nested model holds.

With C half the sum of squares of the larger model and C_0 of the one that holds k of its
parameters, s^2 the residual variance of the larger with f degrees of freedom,

    F = 2 (C_0 - C) / (k s^2)

has the F distribution with k and f degrees of freedom where the nested model is right and the
larger is nearly linear over what it leaves open (Seber and Wild, Nonlinear Regression, 1989,
section 5.3). Residuals that hang together in time count for more than they tell: p is then too
small.
"""

from __future__ import annotations

from dataclasses import dataclass

from scipy import stats


@dataclass(frozen=True)
class NestedComparison:
    """Two fits of the same data, of which one holds parameters that the other fits.

    Attributes
    ----------
    names
        The parameters that are fitted in the larger model alone.
    gain
        By how much the cost is lower with them.
    statistic
        F, the mean gain of a parameter over what noise gives one.
    degrees_of_freedom
        Of F: how many parameters, and of the noise.
    p_value
        How likely noise alone makes F as large, where the nested model is right.
    caveat
        Why p is a rough one; empty where it is not.
    """

    names: tuple[str, ...]
    gain: float
    statistic: float
    degrees_of_freedom: tuple[int, int]
    p_value: float
    caveat: str = ""

    def __str__(self) -> str:
        """Return a sentence."""
        needed = "data need" if self.p_value < 0.05 else "data do not need"
        count, freedom = self.degrees_of_freedom
        said = (
            f"{needed} {', '.join(self.names)}: F = {self.statistic:.3g} with {count} and "
            f"{freedom} degrees of freedom, p = {self.p_value:.2g}"
        )
        return f"{said}; {self.caveat}" if self.caveat else said


def f_test(
    names: tuple[str, ...], gain: float, variance: float, freedom: int, caveat: str
) -> NestedComparison:
    """Return the comparison of a model with one that holds the parameters `names`.

    Parameters
    ----------
    names
        Of k parameters.
    gain
        Of the cost, >= 0 but where a search has not converged.
    variance
        Of the weighted residuals of the larger model, > 0.
    freedom
        Its degrees of freedom.
    caveat
        Of the result.
    """
    statistic = max(2.0 * gain / (len(names) * variance), 0.0)
    p = float(stats.f.sf(statistic, len(names), freedom))
    return NestedComparison(names, gain, statistic, (len(names), freedom), p, caveat)
