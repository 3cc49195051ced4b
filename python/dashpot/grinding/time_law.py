"""When a tool is where on its path: feed along the way, from rest to rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["TimeLaw"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TimeLaw:
    """Motion along a path, of constant acceleration between nodes.

    Attributes
    ----------
    distance
        (n,) nodes, m, ascending from 0.
    speed
        (n,) speed at the nodes, m/s, 0 at both ends.
    time
        (n,) when the nodes are reached, s.
    """

    distance: Array
    speed: Array
    time: Array

    @classmethod
    def of_feed(cls, distance: Array, feed: Array, acceleration: float) -> TimeLaw:
        """Return the motion at a feed, from rest to rest at no more than an acceleration.

        Parameters
        ----------
        distance, feed
            (n,) nodes, m, and the feed wanted there, m/s, > 0.
        acceleration
            Largest along the path, m/s^2, > 0.
        """
        square = feed**2
        square[0] = square[-1] = 0.0
        gain = 2.0 * acceleration * np.diff(distance)
        # The lower envelope of what every node allows the others, forwards and backwards.
        risen = np.r_[0.0, np.cumsum(gain)]
        square = risen + np.minimum.accumulate(square - risen)
        fallen = risen[-1] - risen
        square = fallen + np.minimum.accumulate((square - fallen)[::-1])[::-1]
        speed = np.sqrt(np.maximum(square, 0.0))
        taken = 2.0 * np.diff(distance) / (speed[1:] + speed[:-1])
        return cls(distance, speed, np.r_[0.0, np.cumsum(taken)])

    @property
    def duration(self) -> float:
        """From rest to rest, s."""
        return float(self.time[-1])

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return way (m), speed (m/s) and acceleration (m/s^2) at times; at rest after the end."""
        node = np.clip(np.searchsorted(self.time, times, "right") - 1, 0, len(self.time) - 2)
        length = self.time[node + 1] - self.time[node]
        rate = (self.speed[node + 1] - self.speed[node]) / length
        passed = np.clip(times - self.time[node], 0.0, length)
        moving = (times >= 0) & (times < self.time[-1])
        speed = np.where(moving, self.speed[node] + rate * passed, 0.0)
        way = self.distance[node] + (self.speed[node] + 0.5 * rate * passed) * passed
        return way, speed, np.where(moving, rate, 0.0)
