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
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.inference.at_bounds import HIGH_CORRELATION, at_bounds, bound_of
from dashpot.calibrate.inference.estimate import Estimate, interval_ends, percent
from dashpot.calibrate.inference.stated_noise import MAX_VARIANCE
from dashpot.calibrate.problem.parameters import Parameter

Array = NDArray[np.float64]

MAX_RANGE_SHARE = 0.5
MAX_FACTOR = 4.0
# Share of the variance, as the correlation of neighbouring frames tells it, that a misfit may have:
# as much as in `MAX_VARIANCE` where noise is stated rightly.
_MOST_MISFIT = 1.0 - 1.0 / MAX_VARIANCE


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """What is known of the estimate of one parameter.

    Attributes
    ----------
    parameter
        The parameter.
    z, standard_error, interval
        Estimate, its standard error (inf where the data say nothing) and the ends of its interval
        in the search coordinate.
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

    parameter: Parameter
    z: float
    standard_error: float
    interval: tuple[float, float]
    correlation: Array
    names: tuple[str, ...]
    confidence: float
    unfinished: str | None = None
    unexplained: float | None = None
    overstated: float | None = None
    together: float = 0.0
    clustered: bool = False
    nonlinearity: float = 0.0
    leader: str | None = None

    @property
    def ends(self) -> tuple[float, float]:
        """Ends of the interval in the parameter's unit."""
        lower, upper = (self.parameter.coordinate.to_value(end) for end in self.interval)
        return lower, upper

    @property
    def interval_text(self) -> str:
        """The same in words."""
        return " to ".join(interval_ends(*self.ends))


def judge(evidence: Evidence) -> Estimate:
    """Return the estimate of one parameter with its statement."""
    parameter = evidence.parameter
    value = parameter.coordinate.to_value(evidence.z)
    if not math.isfinite(evidence.standard_error):
        return Estimate(
            parameter.name,
            value,
            math.inf,
            *parameter.bounds,
            identified=False,
            statement=f"not identified: {bound_of(parameter, evidence.z) or _INDEPENDENT}",
        )
    reason = next((why for why in (reason(evidence) for reason in _REASONS) if why), None)
    statement = _identified(evidence) if reason is None else _not_identified(evidence, reason)
    return Estimate(
        parameter.name,
        value,
        evidence.standard_error * parameter.coordinate.slope(evidence.z),
        *evidence.ends,
        identified=reason is None,
        statement=statement,
        nonlinearity=evidence.nonlinearity,
    )


_INDEPENDENT = (
    "the observed motion does not depend on it, or only through a combination with other parameters"
)


def _unfinished(evidence: Evidence) -> str | None:
    return evidence.unfinished


def _unexplained(evidence: Evidence) -> str | None:
    variance = evidence.unexplained
    if variance is None or variance <= MAX_VARIANCE or evidence.clustered:
        return None
    return (
        f"the stated noise does not explain the residuals, whose variance is {variance:.3g}: the "
        "model is not right, or the search ended in a bad valley, and its interval, "
        f"{evidence.interval_text}, is that of neither"
    )


def _at_a_bound(evidence: Evidence) -> str | None:
    return bound_of(evidence.parameter, evidence.z)


def _wide(evidence: Evidence) -> str | None:
    parameter, (lower, upper) = evidence.parameter, evidence.ends
    interval = f"its {percent(evidence.confidence)} interval"
    share = _share(parameter, lower, upper)
    if share > MAX_RANGE_SHARE:
        return f"{interval} covers {share:.0%} of the allowed range"
    begin, end = evidence.interval
    if parameter.transform == "log" and end - begin > math.log(MAX_FACTOR):
        return (
            f"the ends of {interval}, {lower:.3g} and {upper:.3g}, differ by more than a factor of "
            f"{MAX_FACTOR:g}"
        )
    for side, (z_end, bound) in enumerate(zip(evidence.interval, parameter.bounds, strict=True)):
        if at_bounds(parameter, z_end)[side]:
            return (
                f"{interval} reaches the {('lower', 'upper')[side]} bound {bound:.4g}, and could "
                "go on beyond"
            )
    return None


def _led(evidence: Evidence) -> str | None:
    if evidence.leader is None:
        return None
    return f"it goes along with {evidence.leader}, whose estimate lies at a bound"


def _hanging_together(evidence: Evidence) -> str | None:
    if evidence.together <= _MOST_MISFIT or evidence.clustered:
        return None
    return (
        "residuals hang together from frame to frame, with a correlation of "
        f"{evidence.together:.2f}, as a misfit does: the stated noise is too large and hides it, "
        f"or has such a correlation, and its interval, {evidence.interval_text}, does not know of "
        "that"
    )


_REASONS: tuple[Callable[[Evidence], str | None], ...] = (
    _unfinished,
    _unexplained,
    _at_a_bound,
    _wide,
    _led,
    _hanging_together,
)
"""Why a parameter may not be identified: the first that applies is told."""


def _identified(evidence: Evidence) -> str:
    sentences = [f"identified: {percent(evidence.confidence)} interval {evidence.interval_text}"]
    partner = _partner(evidence)
    if partner:
        sentences.append(f"{partner}, so the data know their combination better than each")
    if evidence.unexplained is not None:
        sentences.append(
            "but noise does not explain the residuals, whose variance is "
            f"{evidence.unexplained:.3g}"
        )
    if evidence.overstated is not None:
        sentences.append(
            f"noise is stated too large: the variance of the residuals is {evidence.overstated:.3g}"
        )
    if evidence.nonlinearity > 1.0:
        sentences.append("most of the interval is the roughness of the cost, so it is a rough one")
    return "; ".join(sentences)


def _not_identified(evidence: Evidence, reason: str) -> str:
    bound, partner = bound_of(evidence.parameter, evidence.z), _partner(evidence)
    if bound is not None and bound != reason:
        reason = f"{bound}, and {reason}"
    return f"not identified: {reason}; {partner}" if partner else f"not identified: {reason}"


def _share(parameter: Parameter, lower: float, upper: float) -> float:
    """Return the share of the allowed range between two values, of log parameters in the log."""
    low, high = parameter.bounds
    if parameter.transform == "log":
        low, high, lower, upper = (math.log(x) for x in (low, high, lower, upper))
    return (upper - lower) / (high - low)


def _partner(evidence: Evidence) -> str | None:
    """Name the parameter that it is correlated with most, if it is highly."""
    own = evidence.parameter.name
    others = [
        (abs(correlation), correlation, name)
        for correlation, name in zip(evidence.correlation, evidence.names, strict=True)
        if name != own
    ]
    if not others:
        return None
    size, signed, other = max(others)
    return f"correlated {signed:+.2f} with {other}" if size > HIGH_CORRELATION else None
