"""Times of a camera whose frames are even, while the stamps that it gave them jitter.

A stamp is when a frame arrived, which the load of a computer decides as well. Frames are counted
in two ways. Where jitter stays well below half a spacing the phase of the stamps tells the place of
each, and so which are lost. Where it does not, frames may have been none lost, or not: they count
as none lost where their stamps do not wander from an even grid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.frame_grid import even_grid

Array = NDArray[np.float64]
Places = NDArray[np.intp]

# Spacings that frames may be off their even grid for their places to be told by the phases alone:
# the most, and the root mean square. Times of no grid are 0.29 off any, and few of them 0.24.
_MOST_OFF, _USUALLY_OFF = 0.45, 0.2
# Spacings tried, as shares of the median interval: of frames that jitter few are lost.
_SHORTEST, _LONGEST = 0.6, 1.6
# Frames from which the spacing is found at first, and the most median intervals a frame.
_AT_FIRST, _MOST_SPACINGS = 256, 3.0
# Frames without loss may be this many spacings off on the median of neighbours, and of so many at
# either end: one frame lost in the middle puts those before and after it 0.5 off.
_WANDER, _MOST_NEIGHBOURS = 0.25, 20
_WANDER_AT_END, _AT_END = 0.5, 3
# Lost frames have to leave so much less of what jitter there would be without.
_BETTER = 0.5
_FEWEST = 8


def jittered_frame_numbers(time: Array) -> Places | None:
    """Return (n,) the places of stamps that do not descend on an even grid; None if ambiguous."""
    whole, lossy = without_loss(time), _by_phase(time)
    if whole is None or lossy is None:
        return lossy if whole is None else whole
    jitter = [np.sqrt(np.mean(offsets(time, frame)[1] ** 2)) for frame in (whole, lossy)]
    return lossy if jitter[1] < _BETTER * jitter[0] else whole


def offsets(time: Array, frame: Places) -> tuple[float, Array]:
    """Return the spacing of the even grid of frames, and how far each is off it, in spacings.

    Frames that were held up are left out of the fit: delays of three times the usual and more.
    """
    used = np.ones(time.size, dtype=bool)
    for _ in range(5):
        spacing, off = even_grid(time[used], frame[used])
        line = np.polynomial.Polynomial.fit(frame[used], time[used] - off, 1)
        off = time - line(frame)
        kept = _usual(off, 1e-6 * spacing)
        few = np.count_nonzero(kept) < max(_FEWEST, time.size // 2)
        if (kept == used).all() or few or np.ptp(time[kept]) == 0.0:
            break
        used = kept
    return spacing, off / spacing


def slope_error(frame: Places, off: Array) -> float:
    """Return the standard error of the spacing from which frames are `off`, both in spacings."""
    used = _usual(off, 1e-6)
    place = frame[used] - frame[used].mean()
    variance = float(off[used] @ off[used]) / max(place.size - 2, 1)
    return float(np.sqrt(variance / (place @ place)))


def _usual(off: Array, least: float) -> NDArray[np.bool_]:
    """Return which frames are no more than three usual offsets off."""
    return np.abs(off) <= 3.0 * max(1.4826 * float(np.median(np.abs(off))), least)


def _by_phase(time: Array) -> Places | None:
    """Return places told by the phases of stamps, None where these are not near one another.

    The spacing is that at which phases agree best (Rayleigh's periodogram).
    """
    if time.size < _FEWEST:
        return None
    time = time - time[0]
    known = min(time.size, _AT_FIRST)
    usual = float(np.median(np.diff(time[:known])))
    if usual <= 0.0 or time[-1] > _MOST_SPACINGS * time.size * usual:
        return None
    first = time[:known]
    rates = np.arange(1.0 / (_LONGEST * usual), 1.0 / (_SHORTEST * usual), 0.2 / first[-1])
    sums = [np.exp(2j * np.pi * rate * first).sum() for rate in rates]
    best = int(np.argmax(np.abs(sums)))
    line = np.array([-np.angle(sums[best]) / (2.0 * np.pi), rates[best]])
    frame = np.rint(line[0] + line[1] * first).astype(np.intp)
    while True:
        for _ in range(3):
            spacing, off = even_grid(time[:known], frame)
            frame = frame + np.rint(off / spacing).astype(np.intp)
        if known == time.size:
            break
        # As many again, counted on from those that are known.
        spacing, off = even_grid(time[:known], frame)
        more = time[known : 2 * known] - (time[known - 1] - off[-1])
        frame = np.concatenate([frame, frame[-1] + np.rint(more / spacing).astype(np.intp)])
        known = frame.size
    spacing, off = even_grid(time, frame)
    off /= spacing
    if np.abs(off).max() > _MOST_OFF or np.sqrt(np.mean(off**2)) > _USUALLY_OFF:
        return None
    return frame - frame[0] if (np.diff(frame) > 0).all() else None


def without_loss(time: Array) -> Places | None:
    """Return places of frames of which none was lost; None where some may have been."""
    if time.size < _FEWEST or time[-1] <= time[0]:
        return None
    frame = np.arange(time.size)
    _, off = offsets(time, frame)
    beside = int(np.clip(time.size // 6, min(7, time.size // 4), _MOST_NEIGHBOURS))
    neighbours = np.lib.stride_tricks.sliding_window_view(off, 2 * beside + 1)
    if np.abs(np.median(neighbours, axis=1)).max() > _WANDER:
        return None
    ends = [np.median(off[:_AT_END]), np.median(off[-_AT_END:])]
    return frame if np.abs(ends).max() <= _WANDER_AT_END else None
