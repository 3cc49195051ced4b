"""Estimates of single parameters, and how many digits of them are told."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Grade = Literal["identified", "within misfit", "not identified"]


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
        Whether the data identify it, within the misfit or without one.
    statement
        A sentence that says why or why not.
    nonlinearity
        How far the residuals' departure from a linear model over the interval moves the estimate,
        in standard errors of that model. It is part of `standard_error` and of the interval;
        where it is above 1, most of their width comes from it and their confidence is a rough one.
    grade
        ``"identified"``; ``"within misfit"``: identified, but residuals of some channel hang
        together in time, as those of a model do that is not quite right; ``"not identified"``.
    widening
        How many times wider the interval is for that misfit; 1 without.
    at_bounds
        Whether `lower` and `upper` are bounds of the search, beyond which the interval may go on.

    Examples
    --------
    >>> estimate = result["stiffness"]
    >>> estimate.lower < 1e4 < estimate.upper, estimate.grade
    (True, 'identified')
    """

    name: str
    value: float
    standard_error: float
    lower: float
    upper: float
    identified: bool
    statement: str
    nonlinearity: float = 0.0
    grade: Grade = "identified"
    widening: float = 1.0
    at_bounds: tuple[bool, bool] = (False, False)

    @property
    def interval(self) -> str:
        """The interval in words: ``9.9e+03 – 1.01e+04``.

        Where one end is a bound of the search: ``at least 9.9e+03``, or ``at most 1.01e+04``.
        """
        return interval_words(self.lower, self.upper, self.at_bounds)


def percent(confidence: float) -> str:
    """Return a confidence as a percentage with all its digits, such as 99.9%."""
    return f"{100.0 * confidence:.6g}%"


def interval_ends(lower: float, upper: float) -> tuple[str, str]:
    """Return the ends of an interval with four digits, or as many as tell its width."""
    digits = interval_digits(lower, upper)
    return f"{lower:.{digits}g}", f"{upper:.{digits}g}"


def interval_words(lower: float, upper: float, at_bounds: tuple[bool, bool]) -> str:
    """Return an interval in words; of an end at a bound alone only the other end is known."""
    ends = interval_ends(lower, upper)
    if at_bounds[0] == at_bounds[1]:
        return " – ".join(ends)
    return f"at least {ends[0]}" if at_bounds[1] else f"at most {ends[1]}"


def interval_digits(lower: float, upper: float) -> int:
    """Return how many digits numbers in an interval need: the last is a tenth of its width.

    They are four at least, and 16 at most.
    """
    width, size = upper - lower, max(abs(lower), abs(upper))
    if not width > 0.0:
        return 4
    first = math.floor(math.log10(size))
    return min(max(4, math.ceil(first + 2 - math.log10(width))), 16)
