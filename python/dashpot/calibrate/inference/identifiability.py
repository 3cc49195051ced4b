"""Whether data identify a parameter, said in a plain sentence.

A parameter is called *not identified* when

* the search ended before it converged: what its end would be is not known then, and the interval
  around the best point found is not that of a minimum, or
* candidates next to the estimate cannot be built or simulated: it may be the last that can, or
* residuals of a channel hang together in time and are more than a tenth of what it shows: the model
  does not describe it, or the search ended in a bad valley, or
* the residuals do not depend on it (alone, or once another unknown compensates it), or
* its estimate lies at a bound, or its interval reaches one: the data then only say that it is at
  least, or at most, the other end, as where friction never slips, or
* it goes along with what lies at a bound (parameters there together explain it with a correlation
  above 0.95): it is then known for that bound, not for what they would be beyond, or
* its interval covers more than half of the allowed range, or
* (log parameters) the ends of its interval differ by more than a factor of four: it is then not
  known to within a factor of two either way.

It is *identified within the misfit* when none of these holds, but residuals of a channel hang
together in time (`dashpot.calibrate.residuals.whiteness`): the model is not quite right there, or
the noise is not white. Its interval is widened for that (`dashpot.calibrate.residuals.misfit`), and
the sentence says how much. An interval does not know of what a wrong model does to the estimate
itself.

Else it is *identified*. Noise of another size than stated changes no interval; the sentence says by
how much it is off. Clustered errors measure how estimates differ between trajectories, whatever the
reason, and are not widened.

An estimate at a bound always names it, beside any other reason.

A correlation above 0.95 with another parameter is named in the sentence: then the data know a
combination of the two much better than each. So is a cost so rough over the interval that this
makes most of its width.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.inference.at_bounds import HIGH_CORRELATION, at_bounds, bound_of
from dashpot.calibrate.inference.estimate import (
    Estimate,
    Grade,
    interval_ends,
    interval_words,
    percent,
)
from dashpot.calibrate.inference.misfit_report import MOST_LEFT, ChannelReport, sizes_differ
from dashpot.calibrate.problem.parameters import Parameter

Array = NDArray[np.float64]

MAX_RANGE_SHARE = 0.5
MAX_FACTOR = 4.0


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
    size
        Root mean square of the weighted residuals where the noise is stated otherwise; None where
        it is as stated, or data had none.
    channels
        What residuals say of each channel.
    clustered
        Whether errors are clustered, so that a misfit is in them already.
    widening
        As in `Estimate`.
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
    size: float | None = None
    channels: Sequence[ChannelReport] = ()
    clustered: bool = False
    widening: float = 1.0
    nonlinearity: float = 0.0
    leader: str | None = None

    @property
    def ends(self) -> tuple[float, float]:
        """Ends of the interval in the parameter's unit."""
        lower, upper = (self.parameter.coordinate.to_value(end) for end in self.interval)
        return lower, upper

    @property
    def at_bounds(self) -> tuple[bool, bool]:
        """Whether the lower and the upper end are bounds of the search."""
        lower, upper = self.interval
        return at_bounds(self.parameter, lower)[0], at_bounds(self.parameter, upper)[1]

    @property
    def misfits(self) -> list[ChannelReport]:
        """Channels whose residuals hang together."""
        return [channel for channel in self.channels if channel.misfit]

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
            grade="not identified",
            at_bounds=(True, True),
        )
    reason = next((why for why in (reason(evidence) for reason in _REASONS) if why), None)
    statement = _identified(evidence) if reason is None else _not_identified(evidence, reason)
    grade: Grade = "not identified"
    if reason is None:
        grade = "within misfit" if evidence.misfits else "identified"
    return Estimate(
        parameter.name,
        value,
        evidence.standard_error * parameter.coordinate.slope(evidence.z),
        *evidence.ends,
        identified=reason is None,
        statement=statement,
        nonlinearity=evidence.nonlinearity,
        grade=grade,
        widening=evidence.widening,
        at_bounds=evidence.at_bounds,
    )


_INDEPENDENT = (
    "the observed motion does not depend on it, or only through a combination with other parameters"
)


def _unfinished(evidence: Evidence) -> str | None:
    return evidence.unfinished


def _undescribed(evidence: Evidence) -> str | None:
    if evidence.clustered:
        return None
    worst = max(evidence.misfits, key=lambda channel: channel.left_over, default=None)
    if worst is None or worst.left_over <= MOST_LEFT:
        return None
    return (
        f"residuals of {worst} are {worst.left_over:.0%} of what it shows: the model is not right, "
        f"or the search ended in a bad valley, and its interval, {evidence.interval_text}, is that "
        "of neither"
    )


def _at_a_bound(evidence: Evidence) -> str | None:
    return bound_of(evidence.parameter, evidence.z)


def _wide(evidence: Evidence) -> str | None:
    parameter, (lower, upper) = evidence.parameter, evidence.ends
    interval = f"its {percent(evidence.confidence)} interval"
    at_lower, at_upper = evidence.at_bounds
    if at_lower != at_upper:
        side, bound = ("upper", upper) if at_upper else ("lower", lower)
        return (
            f"it is {interval_words(lower, upper, evidence.at_bounds)}; {interval} reaches the "
            f"{side} bound {bound:.4g}, and could go on beyond"
        )
    share = _share(parameter, lower, upper)
    if share > MAX_RANGE_SHARE:
        return f"{interval} covers {share:.0%} of the allowed range"
    begin, end = evidence.interval
    if parameter.transform == "log" and end - begin > math.log(MAX_FACTOR):
        return (
            f"the ends of {interval}, {lower:.3g} and {upper:.3g}, differ by more than a factor of "
            f"{MAX_FACTOR:g}"
        )
    return None


def _led(evidence: Evidence) -> str | None:
    if evidence.leader is None:
        return None
    return f"it goes along with {evidence.leader}, whose estimate lies at a bound"


_REASONS: tuple[Callable[[Evidence], str | None], ...] = (
    _unfinished,
    _undescribed,
    _at_a_bound,
    _wide,
    _led,
)
"""Why a parameter may not be identified: the first that applies is told."""


def _identified(evidence: Evidence) -> str:
    interval = f"{percent(evidence.confidence)} interval {evidence.interval_text}"
    sentences = [f"identified: {interval}"]
    if evidence.misfits:
        sentences = [f"identified within the misfit: {interval}{_added(evidence)}"]
        named = ", ".join(map(str, evidence.misfits))
        sentences.append(
            f"residuals of {named} hang together in time: the model is not quite right there, or "
            "the noise is not white"
        )
    partner = _partner(evidence)
    if partner:
        sentences.append(f"{partner}, so the data know their combination better than each")
    if evidence.size is not None and not evidence.misfits:
        sentences.append(_sizes(evidence))
    if evidence.nonlinearity > 1.0:
        sentences.append("most of the interval is the roughness of the cost, so it is a rough one")
    return "; ".join(sentences)


def _added(evidence: Evidence) -> str:
    """Say how much of the interval is for the misfit."""
    if evidence.clustered:
        return ", of how trajectories differ"
    if evidence.widening < 1.05:
        return ", to which that adds nothing"
    return f", {evidence.widening:.2g} times as wide as noise alone would make it"


def _sizes(evidence: Evidence) -> str:
    """Say by how much the stated noise is wrong."""
    sizes = {"": evidence.size or 0.0}
    if sizes_differ(evidence.channels):
        sizes = {f" of {c.channel}": c.size for c in evidence.channels if c.count}
    said = ", ".join(f"{size:.3g} times as large{name}" for name, size in sizes.items())
    return f"noise is not as stated, but {said}"


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
