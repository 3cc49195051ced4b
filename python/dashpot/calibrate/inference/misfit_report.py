"""What a fit says of each channel: how large its residuals are, and whether they are white."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.inference.stated_noise import MAX_VARIANCE
from dashpot.calibrate.residuals.losses import Loss
from dashpot.calibrate.residuals.misfit import ResidualCovariance, residual_covariance
from dashpot.calibrate.residuals.objective import Objective
from dashpot.calibrate.residuals.whiteness import Whiteness, whiteness

Array = NDArray[np.float64]

# A channel of a right model is called a misfit in one of 740 fits.
_DEVIATIONS = 3.0
# Residuals hang together by so much at least where that is worth saying.
_LEAST_CORRELATION = 0.05
# A model of which more than this share of what a channel shows is left over does not describe it.
MOST_LEFT = 0.1


@dataclass(frozen=True)
class ChannelReport:
    """What residuals of one channel say, over all trajectories.

    Attributes
    ----------
    channel
        ``"position"``, ``"rotation"``, or the name of the sensor, event or scalar.
    size
        Root mean square of its weighted residuals: near 1 where the noise is stated rightly.
    count
        Residuals that carry noise.
    correlation
        Of neighbouring residuals: 0 of noise.
    deviations
        How unlikely that is of white noise, in standard deviations of a normal number.
    misfit
        Whether residuals hang together in time: the model is not right there, or the noise is not
        white.
    left_over
        Root mean square of the residuals over that of what the channel shows about its mean.
    """

    channel: str
    size: float
    count: int
    correlation: float
    deviations: float
    misfit: bool
    left_over: float

    def __str__(self) -> str:
        """Return the channel with its correlation."""
        return f"{self.channel} (correlation {self.correlation:.2f})"


def report_channels(objective: Objective, residuals: Array) -> list[ChannelReport]:
    """Return what residuals (m,) at an estimate say of each channel."""
    counted = objective.live(residuals)
    white = {w.channel: w for w in whiteness(objective, residuals, counted)}
    found: dict[str, list[tuple[Array, Array]]] = {}
    for t, layout in enumerate(objective.layouts):
        shown = objective.recorders[t].spread()
        for name, places in layout.groups():
            seen = counted[objective.offsets[t] + places]
            own = residuals[objective.offsets[t] + places]
            found.setdefault(name, []).append((own[seen], shown[places][seen]))
    return [_of_channel(white[name], parts) for name, parts in found.items()]


def misfit_covariance(
    objective: Objective, residuals: Array, channels: Sequence[ChannelReport], loss: Loss
) -> ResidualCovariance | None:
    """Return the covariance of scores where residuals are no noise of one size; None: they are."""
    coloured = [c.channel for c in channels if c.misfit]
    if not coloured and not sizes_differ(channels):
        return None
    live = objective.live(residuals)
    return residual_covariance(objective, loss.scores(residuals), live, coloured)


def sizes_differ(channels: Sequence[ChannelReport]) -> bool:
    """Whether the noise of some channel is stated otherwise wrong than that of others."""
    counts = np.array([c.count for c in channels], dtype=np.float64)
    squares = np.array([c.size**2 for c in channels])
    if len(channels) < 2 or not counts.sum() or not squares.any():
        return False
    mean = float(counts @ squares / counts.sum())
    with np.errstate(divide="ignore"):
        off = np.abs(squares / mean - 1.0) / (3.0 * np.sqrt(2.0 / counts))
    large = np.maximum(squares / mean, mean / np.maximum(squares, 1e-12)) > MAX_VARIANCE
    return bool((large & (off > 1.0) & (counts > 0)).any())


def hangs_together(white: Whiteness) -> bool:
    """Whether residuals of a channel hang together in time so that it is worth saying."""
    return not white.holds(_DEVIATIONS) and white.correlation > _LEAST_CORRELATION


def _of_channel(white: Whiteness, parts: Sequence[tuple[Array, Array]]) -> ChannelReport:
    own = np.concatenate([residuals for residuals, _ in parts])
    shown = np.concatenate([spread for _, spread in parts])
    size = float(np.sqrt(np.mean(own**2))) if own.size else 0.0
    spread = float(np.sqrt(np.mean(shown**2))) if own.size else 0.0
    return ChannelReport(
        channel=white.channel,
        size=size,
        count=own.size,
        correlation=0.0 if white.exact else white.correlation,
        deviations=0.0 if white.exact else white.deviations,
        misfit=hangs_together(white),
        left_over=size / spread if spread > 0.0 else 0.0,
    )
