"""Angles of hinges that are read within a turn: those that jump from one end of it to the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TURN = 2.0 * np.pi
# Readings between -pi and pi, rounded, span this much more than a turn.
_SLACK = 1e-3


def turn_of(readings: Array) -> float:
    """Return the turn (rad) within which angles (n, 1) are read, 0 where none ends it.

    They are where all are within one, and two that follow each other differ by more than half.
    """
    seen = readings[~np.isnan(readings)]
    if seen.size < 2 or np.ptp(seen) > TURN * (1.0 + _SLACK):
        return 0.0
    return TURN if np.abs(np.diff(seen)).max() > 0.5 * TURN else 0.0


def unwrapped(readings: Array) -> Array:
    """Return angles (n, 1) that go on where a turn ends within which they are read; NaN stays."""
    result = readings.copy()
    if turn_of(readings):
        seen = ~np.isnan(readings)
        result[seen] = np.unwrap(readings[seen])
    return result
