"""Mass, centre and moments of inertia of a body, from a fit of the numbers that make it.

Intervals are those of a linear model around the estimate (the delta method): with G the derivative
of a quantity by the numbers, C their covariance and q Student's quantile,

    half width = q (G C G^T)^(1/2),

of masses, moments and ratios in the logarithm. What depends on a number that the data say
nothing of is not known; what does not is, though it may be made of the same numbers: of a body in
free flight the moments are not known, but their ratios.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.inference.estimate import (
    Estimate,
    Grade,
    interval_ends,
    percent,
)
from dashpot.calibrate.inference.identifiability import MAX_FACTOR
from dashpot.calibrate.problem.inertia_setter import InertiaSetter
from dashpot.calibrate.problem.parameters import Parameter
from dashpot.calibrate.problem.pseudo_inertia import body_of, principal
from dashpot.tables import table_html, table_text

if TYPE_CHECKING:
    from rich.table import Table

Array = NDArray[np.float64]

_STEP = 1e-5
# What of a derivative, by a number in its unit, is rounding, as a share of the quantity's scale.
_NOTHING = 1e-7
_MATRIX = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
# Moments are known where their interval is narrower than by this factor, as parameters are; others
# where it is narrower than this share of the scale that they are compared with.
_SHARE = 0.5
# Of the logarithm of a positive quantity: beyond it an interval counts as without an end.
_MOST = math.log(1e3)


@dataclass(frozen=True, eq=False)
class BodyInertia:
    """Mass, centre and inertia of a body with intervals. Prints as a table.

    Attributes
    ----------
    body
        Name or id.
    mass
        kg.
    centre
        (3,) centre of mass in the frame of the body, m.
    matrix
        (3, 3) inertia about the centre, along the axes of the body, kg m^2.
    moments
        (3,) principal moments, the largest first, kg m^2 (``diaginertia`` of MJCF).
    axes
        (3, 3) the principal axes in the frame of the body, as columns.
    estimates
        By name the same, and ``moment 2 / moment 1``, ``moment 3 / moment 1``, with standard
        errors, intervals and statements; what is held has no width.
    """

    body: str | int
    mass: float
    centre: Array
    matrix: Array
    moments: Array
    axes: Array
    estimates: tuple[Estimate, ...]
    units: tuple[str, ...] = field(repr=False)
    confidence: float = 0.95

    def __getitem__(self, name: str) -> Estimate:
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        known = ", ".join(e.name for e in self.estimates)
        raise KeyError(f"no {name!r}; there are {known}")

    def table(self) -> Table:
        """Return a rich table of the estimates."""
        from dashpot.calibrate.report.inertia_table import inertia_table

        return inertia_table(self)

    def __str__(self) -> str:
        """Return the table as text."""
        return table_text(self.table())

    def _repr_html_(self) -> str:
        """Return the table for notebooks."""
        return table_html(self.table())


@dataclass(frozen=True)
class _Quantity:
    """One number of a body: its name, unit, and what a difference of it is compared with."""

    name: str
    unit: str
    positive: bool = False


_QUANTITIES = (
    _Quantity("mass", "kg", positive=True),
    *(_Quantity(f"centre {axis}", "m") for axis in "xyz"),
    *(_Quantity(f"moment {i}", "kg m²", positive=True) for i in (1, 2, 3)),
    *(_Quantity(f"moment {i} / moment 1", "", positive=True) for i in (2, 3)),
    *(_Quantity(f"inertia {'xyz'[i]}{'xyz'[j]}", "kg m²", positive=i == j) for i, j in _MATRIX),
)


def body_inertia(
    setter: InertiaSetter,
    parameters: Sequence[Parameter],
    values: Sequence[float],
    covariance: Array,
    *,
    quantile: float,
    confidence: float,
    unfinished: str | None,
    misfit: bool,
) -> BodyInertia:
    """Return the inertia of a body at an estimate of the numbers that `setter` takes.

    Parameters
    ----------
    setter
        Of the body.
    parameters, values
        Of its n numbers, and their estimates.
    covariance
        (n, n) of these; 0 of what is held, infinite where the data say nothing.
    quantile, confidence
        Half-width of an interval in standard errors, and what it is the interval of.
    unfinished
        Why no interval counts; None where they do.
    misfit
        Whether residuals hang together in time.
    """
    numbers = np.asarray(values, dtype=np.float64)
    ranges = np.array([p.bounds[1] - p.bounds[0] for p in parameters])
    units = np.where([p.transform == "log" for p in parameters], numbers, ranges)
    mass, centre, matrix = body_of(setter.numbers(numbers), setter.axes)
    moments, axes = principal(matrix)
    found = _quantities(setter, numbers)
    scale = _scales(found)
    slopes = _slopes(setter, numbers, units)
    slopes[np.abs(slopes) < _NOTHING * scale[:, None]] = 0.0
    estimates = []
    rows = zip(_QUANTITIES, map(float, found), slopes, map(float, scale), strict=True)
    for quantity, value, slope, size in rows:
        error = _error(slope / units, covariance)
        unknown = [
            p.name
            for p, s, c in zip(parameters, slope, np.diagonal(covariance), strict=True)
            if s != 0.0 and not np.isfinite(c)
        ]
        half = quantile * error
        if quantity.positive:
            stretch = math.exp(half / value) if half < _MOST * value else math.inf
            lower, upper = value / stretch, value * stretch
            known = stretch < math.sqrt(MAX_FACTOR)
        else:
            lower, upper = value - half, value + half
            known = half < _SHARE * size
        reason = unfinished
        if unknown:
            reason = f"it depends on {', '.join(unknown)}, of which the data say nothing"
        interval = ""
        if math.isfinite(upper):
            ends = " to ".join(interval_ends(lower, upper))
            interval = f"{percent(confidence)} interval {ends}"
        if not known and reason is None:
            reason = f"its {interval} is wide" if interval else "its interval has no end"
        grade: Grade = "within misfit" if misfit else "identified"
        statement = f"identified{' within the misfit' * misfit}: {interval}"
        if error == 0.0:
            statement = "held"
        elif reason is not None:
            grade, statement = "not identified", f"not identified: {reason}"
        estimates.append(
            Estimate(
                quantity.name,
                value,
                error,
                lower,
                upper,
                identified=grade != "not identified",
                statement=statement,
                grade=grade,
            )
        )
    return BodyInertia(
        body=setter.body if isinstance(setter.body, str) else int(setter.body),
        mass=mass,
        centre=centre,
        matrix=matrix,
        moments=moments,
        axes=axes,
        estimates=tuple(estimates),
        units=tuple(q.unit for q in _QUANTITIES),
        confidence=confidence,
    )


def _quantities(setter: InertiaSetter, values: Array) -> Array:
    mass, centre, matrix = body_of(setter.numbers(values), setter.axes)
    moments, _ = principal(matrix)
    own = [matrix[i, j] for i, j in _MATRIX]
    return np.array([mass, *centre, *moments, *(moments[1:] / moments[0]), *own])


def _scales(found: Array) -> Array:
    """Return what a difference of each quantity is compared with."""
    mass, moments = found[0], found[4:7]
    spread = math.sqrt(0.5 * float(moments.sum()) / mass)
    return np.array([mass, *[spread] * 3, *moments, 1.0, 1.0, *[moments[0]] * 6])


def _slopes(setter: InertiaSetter, numbers: Array, units: Array) -> Array:
    """Return the derivatives (quantities, n) by numbers in `units` (n,)."""
    steps = _STEP * np.diag(units)
    changes = [_quantities(setter, numbers + s) - _quantities(setter, numbers - s) for s in steps]
    return np.stack(changes, axis=1) / (2.0 * _STEP)


def _error(slope: Array, covariance: Array) -> float:
    """Return the standard error of a quantity with these derivatives; inf where there is none."""
    moves = slope != 0.0
    own = covariance[np.ix_(moves, moves)]
    if not np.isfinite(np.diagonal(own)).all():
        return math.inf
    return math.sqrt(max(float(slope[moves] @ own @ slope[moves]), 0.0))
