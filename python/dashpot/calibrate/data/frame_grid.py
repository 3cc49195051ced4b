"""Times of frames: those of an even grid, some of which may be lost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Frames count as evenly spaced when no time is off the best even grid, and no interval off a
# multiple of its spacing, by more than these fractions of a spacing. Times rounded to 1 ms pass up
# to 240 Hz, where they are off by 0.12 and intervals, 4 or 5 ms, by 0.25.
GRID_TOLERANCE = 0.15
SPACING_TOLERANCE = 0.3
# Of gaps, in which a spacing that is not quite known counts many times, it is more.
GAP_TOLERANCE = 0.4
# Of frames of which four in five were lost at random the median interval is three spacings, and is
# five in one trajectory of a hundred that has 20 left.
_MOST_IN_USUAL = 5


def frame_numbers(time: Array) -> NDArray[np.intp]:
    """Return (n,) the places of ascending times on their even grid, from 0.

    The median interval is one spacing or, where that leaves some over, up to `_MOST_IN_USUAL`: of
    frames that were lost at random, more than half, it is two, and more of more. Of random losses
    single spacings are the most frequent intervals all the same, and at least half as many as of
    any other length is asked for: times of no grid at all fit ever finer ones. Longer intervals are
    as many spacings as come nearest.

    Raises
    ------
    ValueError
        Without a label, for times that do not ascend, and intervals that are no multiple.
    """
    interval = np.diff(time)
    backward = np.flatnonzero(interval <= 0)
    if backward.size:
        i = int(backward[0]) + 1
        raise ValueError(
            f"time must increase strictly, but time[{i}] = {time[i]:.6g} s "
            f"follows time[{i - 1}] = {time[i - 1]:.6g} s"
        )
    usual = float(np.sort(interval)[(interval.size - 1) // 2])  # of two the shorter
    spacings, uneven = _multiples(interval, usual)
    first_uneven = uneven
    for share in range(2, _MOST_IN_USUAL + 1):
        if not uneven.any():
            break
        spacings, uneven = _multiples(interval, usual / share)
        count = np.bincount(spacings)
        if 2 * count[1] < count.max():
            uneven = first_uneven
    if uneven.any():
        i = int(np.flatnonzero(first_uneven)[0]) + 1
        kind = "gap" if interval[i - 1] > usual else "short interval"
        raise ValueError(
            f"{kind} of {interval[i - 1]:.6g} s before time[{i}] = {time[i]:.6g} s. Half of the "
            f"intervals are at most {usual:.6g} s. No even grid, lost frames left out, has all of "
            f"these times within {SPACING_TOLERANCE:.0%} of its spacing"
        )
    return np.concatenate([[0], np.cumsum(spacings)])


def _multiples(interval: Array, about: float) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return how many spacings of `about` some s intervals are, and which are no multiple."""
    single = np.abs(interval - about) <= SPACING_TOLERANCE * about
    # Rounding of single times averages out, which long gaps need.
    mean = float(interval[single].mean()) if single.any() else about
    spacings = np.maximum(np.rint(interval / mean), 1.0)
    spacings[single] = 1.0
    tolerance = np.where(spacings > 1.0, GAP_TOLERANCE, SPACING_TOLERANCE)
    uneven = np.abs(interval - spacings * mean) > tolerance * about
    return spacings.astype(np.intp), uneven


def even_grid(time: Array, frame: NDArray[np.intp]) -> tuple[float, Array]:
    """Return the spacing of the even grid next to times by least squares, and their offsets."""
    centered_frame = frame - frame.mean()
    # About their mean, so that the time of day costs no digits.
    centered = time - time[0]
    centered = centered - centered.mean()
    spacing = float(centered_frame @ centered / (centered_frame @ centered_frame))
    return spacing, centered - spacing * centered_frame


def check_grid(time: Array, frame: NDArray[np.intp]) -> float:
    """Return the spacing of the even grid; raise ValueError where the clock drifts away from it.

    The message has no label.
    """
    even, off = even_grid(time, frame)
    worst = int(np.argmax(np.abs(off)))
    if abs(off[worst]) > GRID_TOLERANCE * even:
        raise ValueError(
            f"the clock drifts: time[{worst}] = {time[worst]:.6g} s is "
            f"{abs(off[worst]):.3g} s off an even grid of {even:.6g} s, more than "
            f"{GRID_TOLERANCE:.0%} of that"
        )
    return even
