"""Whether data identify a parameter, said in a plain sentence.

A parameter is called *not identified* when

* the search ended before it converged: what its end would be is not known then, and the interval
  around the best point found is not that of a minimum, or
* candidates next to the estimate cannot be built or simulated: it may be the last that can, or
* the stated noise explains the residuals by far not (their variance is above `MAX_VARIANCE`, and
  above 1 by more than three standard deviations) and errors are those of independent residuals: the
  model differs from what was observed, or the search ended in a bad valley, and intervals that are
  scaled with the residuals, as they are here, then hold for neither, or
* a third of the variance of residuals hangs together from frame to frame, as a misfit does, which
  noise that is stated too large hides, or
* the residuals do not depend on it (alone, or once another unknown compensates it), or
* its estimate lies at a bound, or its interval reaches one: the data then say nothing of how far it
  would go on, as where friction never slips, or
* it goes along with what lies at a bound (parameters there together explain it with a correlation
  above 0.95): it is then known for that bound, not for what they would be beyond, or
* its interval covers more than half of the allowed range, or
* (log parameters) the ends of its interval differ by more than a factor of four: it is then not
  known to within a factor of two either way.

Clustered errors measure how estimates differ between trajectories, whatever the reason: a parameter
that they identify is one of the best model of its kind, and its sentence says where that does not
explain the residuals.

An estimate at a bound always names it, beside any other reason.

A correlation above 0.95 with another parameter is named in the sentence: then the data know a
combination of the two much better than each. So is noise that is somewhat larger than stated, or
far smaller, and a cost so rough over the interval that this makes most of its width.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.parameters import Parameter

Array = NDArray[np.float64]

MAX_RANGE_SHARE = 0.5
MAX_FACTOR = 4.0
HIGH_CORRELATION = 0.95
# Residual variance up to which noise counts as stated not quite rightly (22 % too small).
MAX_VARIANCE = 1.5
# Share of the variance, as the correlation of neighbouring frames tells it, that a misfit may have:
# as much as in `MAX_VARIANCE` where noise is stated rightly.
_MOST_MISFIT = 1.0 - 1.0 / MAX_VARIANCE
# Where a tenth of the residuals lies far beyond the quantile of `intervals.residual_variance`:
# (Phi^-1(0.5 + 0.35 / 0.9) / Phi^-1(0.85))^2.
_OUTLIERS_MAKE = 1.39
# Share of the range (of log parameters in the log) within which a value counts as being at its
# bound.
_AT_BOUND = 1e-3


@dataclass(frozen=True)
class Estimate:
    """One estimated parameter.

    Attributes
    ----------
    name
        The parameter.
    value
        The estimate, in the parameter's unit.
    standard_error
        In the same unit, to first order in the search coordinate; inf where the data say nothing.
        It is scaled with the residuals (`Fit.residual_variance`), not with the stated noise.
    lower, upper
        Ends of the confidence interval; the bounds where the data say nothing. They go on to where
        the cost has risen enough, farther than `standard_error` says where that is flat.
    identified
        Whether the data identify it.
    statement
        A sentence that says why or why not.
    nonlinearity
        How far the residuals' departure from a linear model over the interval moves the estimate,
        in standard errors of that model. It is part of `standard_error` and of the interval;
        where it is above 1, most of their width comes from it and their confidence is a rough one.
    """

    name: str
    value: float
    standard_error: float
    lower: float
    upper: float
    identified: bool
    statement: str
    nonlinearity: float = 0.0


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


def percent(confidence: float) -> str:
    """Return a confidence as a percentage with all its digits, such as 99.9%."""
    return f"{100.0 * confidence:.6g}%"


def interval_ends(lower: float, upper: float) -> tuple[str, str]:
    """Return the ends of an interval with four digits, or as many as tell its width."""
    digits = interval_digits(lower, upper)
    return f"{lower:.{digits}g}", f"{upper:.{digits}g}"


def interval_digits(lower: float, upper: float) -> int:
    """Return how many digits numbers in an interval need: the last is a tenth of its width.

    They are four at least, and 16 at most.
    """
    width, size = upper - lower, max(abs(lower), abs(upper))
    if not width > 0.0:
        return 4
    first = math.floor(math.log10(size))
    return min(max(4, math.ceil(first + 2 - math.log10(width))), 16)


def judge(
    parameter: Parameter,
    *,
    z: float,
    standard_error: float,
    interval: tuple[float, float],
    correlation: Array,
    names: tuple[str, ...],
    confidence: float,
    unfinished: str | None = None,
    unexplained: float | None = None,
    overstated: float | None = None,
    together: float = 0.0,
    clustered: bool = False,
    nonlinearity: float = 0.0,
    leader: str | None = None,
) -> Estimate:
    """Return the estimate of one parameter with its statement.

    Parameters
    ----------
    parameter
        The parameter.
    z, standard_error, interval
        Estimate, its standard error and the ends of its interval in the search coordinate.
    correlation
        Correlations with the parameters `names`.
    confidence
        Of the interval, for the sentence.
    unfinished
        Why the interval is not that of a minimum, in words; None where it is.
    unexplained
        Residual variance where the stated noise does not explain it, else None.
    overstated
        Residual variance where the stated noise is far larger, else None.
    together
        Correlation of the residuals of neighbouring frames; 0 where data had no noise.
    clustered
        Whether errors are clustered, and so do not need the noise to explain the residuals.
    nonlinearity
        As in `Estimate`.
    leader
        The parameter at a bound that it goes along with, as `leaders` says.
    """
    coordinate = parameter.coordinate
    value = coordinate.to_value(z)
    bound = _bound(parameter, z)
    if not math.isfinite(standard_error):
        independent = (
            "the observed motion does not depend on it, or only through a combination with other "
            "parameters"
        )
        return Estimate(
            parameter.name,
            value,
            math.inf,
            *parameter.bounds,
            identified=False,
            statement=f"not identified: {bound or independent}",
        )
    lower, upper = (coordinate.to_value(end) for end in interval)
    if unfinished is not None:
        reason: str | None = unfinished
    elif unexplained is not None and unexplained > MAX_VARIANCE and not clustered:
        reason = (
            f"the stated noise does not explain the residuals, whose variance is {unexplained:.3g}:"
            " the model is not right, or the search ended in a bad valley, and its interval, "
            f"{' to '.join(interval_ends(lower, upper))}, is that of neither"
        )
    else:
        reason = bound or _reason(parameter, interval, lower, upper, confidence)
        if reason is None and leader is not None:
            reason = f"it goes along with {leader}, whose estimate lies at a bound"
        if reason is None and together > _MOST_MISFIT and not clustered:
            reason = (
                "residuals hang together from frame to frame, with a correlation of "
                f"{together:.2f}, as a misfit does: the stated noise is too large and hides it, or "
                "has such a correlation, and its interval, "
                f"{' to '.join(interval_ends(lower, upper))}, does not know of that"
            )
    if bound is not None and reason is not None and reason != bound:
        reason = f"{bound}, and {reason}"
    partner = _partner(parameter.name, correlation, names)
    if reason is None:
        ends = " to ".join(interval_ends(lower, upper))
        statement = f"identified: {percent(confidence)} interval {ends}"
        if partner:
            statement += f"; {partner}, so the data know their combination better than each"
        if unexplained is not None:
            statement += (
                f"; but noise does not explain the residuals, whose variance is {unexplained:.3g}"
            )
        if overstated is not None:
            statement += (
                f"; noise is stated too large: the variance of the residuals is {overstated:.3g}"
            )
        if nonlinearity > 1.0:
            statement += "; most of the interval is the roughness of the cost, so it is a rough one"
    else:
        statement = f"not identified: {reason}"
        if partner:
            statement += f"; {partner}"
    return Estimate(
        parameter.name,
        value,
        standard_error * coordinate.slope(z),
        lower,
        upper,
        identified=reason is None,
        statement=statement,
        nonlinearity=nonlinearity,
    )


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
        [_bound(p, float(z)) is not None for p, z in zip(parameters, point, strict=True)]
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


def _reason(
    parameter: Parameter,
    interval: tuple[float, float],
    lower: float,
    upper: float,
    confidence: float,
) -> str | None:
    share = _share(parameter, lower, upper)
    if share > MAX_RANGE_SHARE:
        return f"its {percent(confidence)} interval covers {share:.0%} of the allowed range"
    if parameter.transform == "log" and interval[1] - interval[0] > math.log(MAX_FACTOR):
        return (
            f"the ends of its {percent(confidence)} interval, {lower:.3g} and {upper:.3g}, differ "
            f"by more than a factor of {MAX_FACTOR:g}"
        )
    for side, (z_end, bound) in enumerate(zip(interval, parameter.bounds, strict=True)):
        if _at_bounds(parameter, z_end)[side]:
            return (
                f"its {percent(confidence)} interval reaches the {('lower', 'upper')[side]} bound "
                f"{bound:.4g}, and could go on beyond"
            )
    return None


def _bound(parameter: Parameter, z: float) -> str | None:
    """Say at which bound an estimate lies; None where at none."""
    at_lower, at_upper = _at_bounds(parameter, z)
    if at_lower:
        return f"the estimate lies at its lower bound {parameter.bounds[0]:.4g}"
    if at_upper:
        return f"the estimate lies at its upper bound {parameter.bounds[1]:.4g}"
    return None


def _at_bounds(parameter: Parameter, z: float) -> tuple[bool, bool]:
    """Whether a search coordinate lies at the lower and at the upper bound, or beyond."""
    if parameter.transform == "logit":
        # Near its ends the search coordinate moves on with little of the range: a share of that.
        z, (low, high) = parameter.coordinate.to_value(z), parameter.bounds
    else:
        low, high = parameter.coordinate.search_bounds
    margin = _AT_BOUND * (high - low)
    return z - low <= margin, high - z <= margin


def _share(parameter: Parameter, lower: float, upper: float) -> float:
    """Return the share of the allowed range between two values, of log parameters in the log."""
    low, high = parameter.bounds
    if parameter.transform == "log":
        low, high, lower, upper = (math.log(x) for x in (low, high, lower, upper))
    return (upper - lower) / (high - low)


def _partner(name: str, correlation: Array, names: tuple[str, ...]) -> str | None:
    others = [(abs(c), c, n) for c, n in zip(correlation, names, strict=True) if n != name]
    if not others:
        return None
    size, signed, other = max(others)
    return f"correlated {signed:+.2f} with {other}" if size > HIGH_CORRELATION else None
