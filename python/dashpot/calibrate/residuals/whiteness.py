"""Whether residuals hang together in time, as a misfit does and noise does not.

Where noise is stated larger than it is, or is not known, the size of residuals tells nothing: a
misfit below the noise passes for it. Its residuals are alike in neighbouring readings, though. Of
white noise the sum of the products of neighbours has the mean 0 and the variance
sum r_k^2 r_{k+1}^2, whatever its sizes are; over the sum of squares it is the correlation on which
the tests of von Neumann and of Durbin and Watson (Biometrika 37, 1950) rest. A misfit that is small
but lasts shows in the means of 2 to 32 successive readings, which are tested alike.

Each channel is tested by itself, from one of its readings to the next, at whatever rate it has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from dashpot.calibrate.residuals.objective import Objective

Array = NDArray[np.float64]

# Root mean square below which residuals are those of data without noise, as of a simulation.
EXACT = 1e-3
# Over so many readings means are taken.
_SCALES = (1, 2, 4, 8, 16, 32)
# Fewer products tell nothing.
_LEAST_PRODUCTS = 12


@dataclass(frozen=True)
class Whiteness:
    """How residuals of a channel go along with those of the reading before.

    Attributes
    ----------
    channel
        Its name; of poses ``"position"`` and ``"rotation"`` are two.
    correlation
        Of neighbouring residuals, weighted by their variances; 0 of white noise.
    deviations
        How unlikely white noise of the same sizes is, in standard deviations of a normal number: of
        the scale that shows it best, allowing for the choice.
    exact
        Whether residuals are so small that data had no noise; nothing is told then.
    """

    channel: str
    correlation: float
    deviations: float
    exact: bool

    def holds(self, deviations: float) -> bool:
        """Whether residuals are white to so many standard deviations."""
        return self.exact or self.deviations < deviations


def whiteness(
    objective: Objective, residuals: Array, counted: NDArray[np.bool_]
) -> list[Whiteness]:
    """Return by channel how residuals (m,), of those `counted` (m,), go along with each other."""
    columns: dict[str, list[Array]] = {}
    for first, layout in zip(objective.offsets, objective.layouts, strict=False):
        for name, places in layout.groups():
            own = columns.setdefault(name, [])
            own += [residuals[column[counted[column]]] for column in (first + places).T]
    return [_of_channel(name, of_channel) for name, of_channel in columns.items()]


def least_white(channels: Sequence[Whiteness]) -> Whiteness:
    """Return the channel that is white noise least likely, allowing for the choice."""
    worst = max(channels, key=lambda channel: 0.0 if channel.exact else channel.deviations)
    return Whiteness(
        worst.channel,
        worst.correlation,
        _allowing(worst.deviations, len(channels)),
        all(channel.exact for channel in channels),
    )


def _of_channel(name: str, columns: Sequence[Array]) -> Whiteness:
    count = sum(column.size for column in columns)
    squares = sum(float(column @ column) for column in columns)
    if not squares > EXACT**2 * count:
        return Whiteness(name, 0.0, 0.0, True)
    found = []
    for scale in _SCALES:
        products = np.concatenate([_products(column, scale) for column in columns])
        spread = float(np.sqrt(products @ products))
        if scale == 1:
            correlation = float(products.sum()) / squares
        if spread > 0.0 and (scale == 1 or products.size >= _LEAST_PRODUCTS):
            found.append(float(products.sum()) / spread)
    return Whiteness(
        name, correlation, _allowing(max(found, default=0.0), max(len(found), 1)), False
    )


def _products(column: Array, scale: int) -> Array:
    """Return the products of successive means over `scale` readings."""
    whole = column.size // scale
    means = column[: whole * scale].reshape(whole, scale).mean(axis=1)
    return np.asarray(means[1:] * means[:-1])


def _allowing(deviations: float, tries: int) -> float:
    """Return deviations as unlikely as the largest of so many tries is."""
    if tries == 1 or deviations < 0.0:
        return deviations
    single = float(special.ndtr(-deviations))
    return float(-special.ndtri(min(tries * single, 0.5))) if single > 0.0 else deviations
