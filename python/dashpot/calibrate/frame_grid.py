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


def frame_numbers(time: Array) -> NDArray[np.intp]:
    """Return (n,) the places of ascending times on their even grid, from 0.

    The interval that most have is one spacing, longer ones are as many as come nearest.

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
    single = np.abs(interval - usual) <= SPACING_TOLERANCE * usual
    # Rounding of single times averages out, which long gaps need.
    mean = float(interval[single].mean()) if single.any() else usual
    spacings = np.maximum(np.rint(interval / mean), 1.0)
    spacings[single] = 1.0
    tolerance = np.where(spacings > 1.0, GAP_TOLERANCE, SPACING_TOLERANCE)
    uneven = np.flatnonzero(np.abs(interval - spacings * mean) > tolerance * usual)
    if uneven.size:
        i = int(uneven[0]) + 1
        kind = "gap" if interval[i - 1] > usual else "short interval"
        raise ValueError(
            f"{kind} of {interval[i - 1]:.6g} s before time[{i}] = {time[i]:.6g} "
            f"s; frames must be {usual:.6g} s apart within {SPACING_TOLERANCE:.0%}, or a multiple "
            "of that where some were lost (resample or split the trajectory)"
        )
    return np.concatenate([[0], np.cumsum(spacings.astype(np.intp))])


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
            f"{GRID_TOLERANCE:.0%} of that (resample the trajectory)"
        )
    return even
