"""Numbers recorded step by step, read at other times.

Step k ends at k h. Positions and velocities are known there, and lie on lines between. What needs
accelerations or forces is held through a step: its integral lies on lines, and the instant value on
lines between the middles of steps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def at_times(values: Array, times: Array, step: float) -> Array:
    """Return (items, rows, columns) of values (items, steps + 1, columns) at times (items, rows).

    Times before the first or after the last step read those.
    """
    return _on_lines(values, times / step)


def means_over(held: Array, times: Array, window: float, step: float) -> Array:
    """Return the means over `window` before times, of what steps held; see `at_times`.

    Parameters
    ----------
    held
        (items, steps + 1, columns) of the step that ends there; the first has no meaning.
    """
    integral = np.cumsum(held, axis=1) - held[:, :1]
    last = held.shape[1] - 1
    begin, end = (np.clip(t / step, 0.0, last) for t in (times - window, times))
    span = np.maximum(end - begin, 1e-12)[..., None]
    return np.asarray((_on_lines(integral, end) - _on_lines(integral, begin)) / span)


def instants_of(held: Array, times: Array, step: float) -> Array:
    """Return the values at times of what steps held; see `means_over`."""
    return _on_lines(held[:, 1:], times / step - 0.5)


def _on_lines(values: Array, place: Array) -> Array:
    """Return values (items, n, columns) at places (items, rows), in units of their distance."""
    last = values.shape[1] - 1
    place = np.clip(place, 0.0, last)
    lower = np.minimum(place.astype(np.intp), max(last - 1, 0))
    share = (place - lower)[..., None]
    item = np.arange(len(values))[:, None]
    below, above = values[item, lower], values[item, np.minimum(lower + 1, last)]
    return np.asarray(below + share * (above - below))
