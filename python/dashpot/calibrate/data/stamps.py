"""Places of frames in time, and whether their stamps or their numbers tell it.

A path is smooth in the time that is right. So is an even camera told from a clock that varies: by
how far readings are from smooth paths, over their numbers and over their stamps. Where paths are
too slow to tell, intervals do: what a stamp is late one interval gains and the next one loses, so
that neighbouring intervals of jittering stamps have a correlation of -1/2. Of a clock that varies
they have none, and it wanders from any even grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.frame_grid import GRID_TOLERANCE, check_grid, frame_numbers
from dashpot.calibrate.data.jitter import jittered_frame_numbers, offsets, slope_error, without_loss

Array = NDArray[np.float64]
Frames = Literal["stamped", "even"]

# Scatter over stamps over that over numbers, either way, from which on paths tell: this, and of m
# stretches 1 + 4 / sqrt(m).
_TELLING, _TELLING_OF_FEW = 1.5, 4.0
# Stretches of four readings that this takes, and the most frames that one of them spans.
_FEWEST, _LONGEST_STRETCH = 12, 9
# Spacings by which the last frame may be off where a rate that is known puts it.
_MOST_OFF_RATE = 1.0
# Intervals that correlations take, and what a correlation of jitter is below: its -1/2, halved.
_FEWEST_INTERVALS = 30
_JITTER_BELOW = -0.25
# The variance of a clock that varies is n / 15 of that of its intervals, off the line through n.
_WANDER = 0.02


@dataclass(frozen=True)
class FrameTimes:
    """Times (n,) of frames in s, their places on an even grid, and its spacing, s.

    How well the spacing is known is a standard deviation, as a share of it.
    """

    time: Array
    number: NDArray[np.intp]
    spacing: float
    rate_sigma: float = 0.0


def frame_times(
    time: Array, channels: Array, frames: Frames, rate: float | None = None
) -> FrameTimes:
    """Return when frames were taken.

    Parameters
    ----------
    time
        (n,) stamps, s.
    channels
        (n, c) what was measured at them; NaN: not measured.
    frames
        ``"stamped"``: stamps are right. ``"even"``: frames are even, and stamps jitter.
    rate
        Frames a second, where they are even and it is known.

    Raises
    ------
    ValueError
        Without a label, saying which of the two it looks like.
    """
    if frames == "even":
        return _even(time, channels, rate)
    if rate is not None:
        raise ValueError("rate is of even frames: say frames='even'")
    try:
        number = frame_numbers(time)
        return FrameTimes(time, number, check_grid(time, number))
    except ValueError as error:
        raise ValueError(f"{error}{_remedy(time, channels)}") from None


def _even(time: Array, channels: Array, rate: float | None) -> FrameTimes:
    back = np.flatnonzero(np.diff(time) < 0)
    if back.size:
        i = int(back[0]) + 1
        raise ValueError(f"time must not decrease, but time[{i}] = {time[i]:.6g} s does")
    whole = without_loss(time)
    try:
        number = frame_numbers(time)
        check_grid(time, number)
    except ValueError as error:
        jittered = jittered_frame_numbers(time)
        if jittered is None:
            raise ValueError(
                f"frames='even', but some may be lost, or the clock itself varies: {error}"
            ) from None
        number = jittered
    # Stamps that come in pairs look like frames of which some are lost: paths tell.
    if whole is not None and _scatter_ratio(number.astype(np.float64), whole, channels) > 1.0:
        number = whole
    looks, reason = _looks(time, number, channels)
    if looks == "stamped":
        raise ValueError(
            f"frames='even', but the clock itself varies: {reason}; "
            "if they are even all the same, give time=spacing * numpy.arange(n)"
        )
    spacing, off = offsets(time, number)
    first = float(time[0] - spacing * off[0])
    rate_sigma = slope_error(number, off)
    if rate is not None:
        if abs(rate * spacing - 1.0) * number[-1] > _MOST_OFF_RATE:
            raise ValueError(
                f"rate is {rate:.6g} frames a second, but there are {1.0 / spacing:.6g} a second "
                "by their stamps"
            )
        # Both grids are level where frames are half through.
        first += (spacing - 1.0 / rate) * float(number.mean())
        spacing, rate_sigma = 1.0 / rate, 0.0
    even = first + np.asarray(spacing * number, dtype=np.float64)
    return FrameTimes(even, number, spacing, rate_sigma)


def _remedy(time: Array, channels: Array) -> str:
    """Return what helps with times that are not even as they are stamped."""
    if (np.diff(time) < 0).any():
        return ""
    number = jittered_frame_numbers(time)
    if number is None:
        return "; resample or split the trajectory"
    looks, reason = _looks(time, number, channels)
    if looks == "even":
        return f"; frames look even, and their stamps jitter: {reason}. Say frames='even'"
    if looks == "stamped":
        return f"; the clock itself looks uneven: {reason}. Resample or split the trajectory"
    return "; say frames='even' if frames are even and their stamps jitter, else resample it"


def _looks(time: Array, number: NDArray[np.intp], channels: Array) -> tuple[str, str]:
    """Return ``"even"``, ``"stamped"`` or, where neither, ``""``, and the reason."""
    ratio = _scatter_ratio(time, number, channels)
    scatter = f"readings scatter {max(ratio, 1 / ratio):.2g} times as far over"
    if ratio > 1.0:
        return "even", f"{scatter} stamps as over numbers"
    if ratio < 1.0:
        return "stamped", f"{scatter} numbers as over stamps"
    _, off = offsets(time, number)
    if time.size <= _FEWEST_INTERVALS or np.abs(off).max() <= GRID_TOLERANCE:
        return "", ""
    error = np.diff(off)
    centred = error - error.mean()
    correlation = float(centred[1:] @ centred[:-1] / (centred @ centred))
    reason = f"neighbouring intervals have a correlation of {correlation:.2f}"
    if correlation < _JITTER_BELOW:
        return "even", reason
    wanders = off @ off > _WANDER * time.size * (centred @ centred)
    return ("stamped", f"{reason}, and times wander off the grid") if wanders else ("", "")


def _scatter_ratio(time: Array, number: NDArray[np.intp], channels: Array) -> float:
    """Return how much further readings scatter over times than over numbers: 1 where none tells.

    That is the median of stretches of four readings, of the channel that tells most.
    """
    most = 1.0
    for channel in channels.T:
        seen = np.flatnonzero(~np.isnan(channel))
        if seen.size < _FEWEST + 3:
            continue
        stretch = np.lib.stride_tricks.sliding_window_view(seen, 4)
        place = number[stretch] - number[stretch[:, :1]]
        near = place[:, 3] < _LONGEST_STRETCH
        stretch, place = stretch[near], place[near]
        values = channel[stretch]
        over_times = _off_parabola(time[stretch] - time[stretch[:, :1]], values)
        over_numbers = _off_parabola(np.asarray(place, dtype=np.float64), values)
        usable = np.isfinite(over_times)
        count, least = int(np.count_nonzero(usable)), 1e-9 * float(np.ptp(channel[seen]))
        if count < _FEWEST or least == 0.0:
            continue
        change = np.log((over_times[usable] + least) / (over_numbers[usable] + least))
        ratio = float(np.exp(np.median(change)))
        telling = max(_TELLING, 1.0 + _TELLING_OF_FEW / np.sqrt(count))
        if abs(np.log(ratio)) > max(np.log(telling), abs(np.log(most))):
            most = ratio
    return most


def _off_parabola(time: Array, values: Array) -> Array:
    """Return how far four values (m, 4) each are from a parabola, as noise: of one variance."""
    apart = time[:, :, None] - time[:, None, :] + np.eye(4)
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = 1.0 / apart.prod(axis=2)
        weight /= np.linalg.norm(weight, axis=1, keepdims=True)
        return np.asarray(np.abs(np.sum(weight * values, axis=1)))
