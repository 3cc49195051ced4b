"""Impacts, apices and peaks in what was recorded step by step.

An impact is seen in the gap g between geoms: it falls in the step in which the gap that it would
have in flight, on the parabola through its last three values, becomes negative. The root of that
parabola is its time: exact for a fall under gravity whatever the step, and smooth in the
parameters. Just after another impact, where there are not three values yet, lines serve.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def impact_times(gap: Array, step: float) -> Array:
    """Return the times (s) at which a gap (steps + 1,), read at the ends of steps, closes."""
    closed = np.where(gap <= 0.0, np.arange(gap.size), -1)
    last_closed = np.maximum.accumulate(closed)
    times = []
    first = 0  # of the values that are of the present flight
    for k in map(int, np.flatnonzero(_may_close(gap))):
        first = max(first, int(last_closed[k]) + 1)
        place = _closing(gap[max(first, k - 2) : k + 1], float(gap[k + 1]))
        if place is not None:
            times.append((k + place) * step)
            first = k + 1
    return np.array(times)


def _may_close(gap: Array) -> NDArray[np.bool_]:
    """Return (steps,) whether a gap that is open closes in the step, seen in any of the ways."""
    now, after = gap[:-1], gap[1:]
    slope = np.diff(gap, prepend=gap[0])[:-1]
    curve = np.zeros(now.size)
    curve[2:] = np.diff(gap[:-1], 2)
    return (now > 0.0) & ((after <= 0.0) | (now + slope <= 0.0) | (now + slope + curve <= 0.0))


def _closing(flight: Array, after: float) -> float | None:
    """Return where in the step after it, from 0 to 1, a flight ends; None where it does not.

    Parameters
    ----------
    flight
        The last gaps, one to three, the last of them > 0.
    after
        The gap at the end of the step.
    """
    now = float(flight[-1])
    if flight.size == 1:
        return now / (now - after) if after <= 0.0 else None
    curve = float(flight[-1] - 2.0 * flight[-2] + flight[-3]) if flight.size == 3 else 0.0
    slope = now - float(flight[-2]) + 0.5 * curve  # at the present value
    coming = now + slope + 0.5 * curve
    if coming > 0.0:
        return now / (now - after) if after <= 0.0 else None
    # The smaller positive root of now + slope s + curve s^2 / 2, in the form that cancels nothing.
    root = np.sqrt(max(slope * slope - 2.0 * curve * now, 0.0))
    return float(min(2.0 * now / (root - slope), 1.0))


def apex_heights(height: Array, impacts: Array, step: float) -> Array:
    """Return the heights of the apices between impacts, and after the last.

    Parameters
    ----------
    height
        (steps + 1,) m.
    impacts
        Times of impacts, s.
    """
    ends = [*impacts[1:], (height.size - 1) * step]
    heights = []
    for begin, end in zip(impacts, ends, strict=True):
        first, last = int(np.ceil(begin / step)) + 1, int(np.floor(end / step))
        if last - first < 2:
            continue
        top = first + int(np.argmax(height[first : last + 1]))
        if not first < top < last:
            continue  # it still rises where the recording ends, or fell from the start
        heights.append(_vertex(height[top - 1 : top + 2]))
    return np.array(heights)


def peak(reading: Array) -> float:
    """Return the entry that is farthest from 0, on the parabola through it and its neighbours."""
    top = int(np.argmax(np.abs(reading)))
    if 0 < top < reading.size - 1:
        return _vertex(reading[top - 1 : top + 2])
    return float(reading[top])


def _vertex(three: Array) -> float:
    """Return the extreme value of the parabola through three values, of which the middle is it."""
    below, middle, above = (float(value) for value in three)
    curve = below - 2.0 * middle + above
    return middle - (above - below) ** 2 / (8.0 * curve) if curve else middle


def in_order(found: Array, count: int, otherwise: float) -> Array:
    """Return (count,) the first entries of `found`, and something else where there are fewer."""
    result = np.full(count, otherwise)
    result[: min(count, found.size)] = found[:count]
    return result
