"""Where the residuals of a trajectory stand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
T = TypeVar("T", np.float64, np.bool_)


@dataclass(frozen=True)
class Layout:
    """Residuals in a row: poses (frames, bodies, 6), sensors (frames, channels), starts (starts,).

    The last are of initial states that are known beforehand, but not exactly.
    """

    frames: int
    bodies: int
    channels: int
    starts: int = 0

    @property
    def size(self) -> int:
        """Number of residuals."""
        return self.frames * (6 * self.bodies + self.channels) + self.starts

    def split(self, rows: NDArray[T]) -> tuple[NDArray[T], NDArray[T]]:
        """Return (..., frames, bodies, 6) and (..., frames, channels) of rows (..., size)."""
        ends = [6 * self.frames * self.bodies, self.size - self.starts]
        poses, sensors, _ = np.split(rows, ends, axis=-1)
        shape = rows.shape[:-1]
        return (
            poses.reshape(*shape, self.frames, self.bodies, 6),
            sensors.reshape(*shape, self.frames, self.channels),
        )

    def by_frame(self, rows: Array) -> Array:
        """Return (..., frames, components) of rows (..., size): poses first, then sensors."""
        poses, sensors = self.split(rows)
        flat = poses.reshape(*poses.shape[:-2], 6 * self.bodies)
        return np.concatenate([flat, sensors], axis=-1)

    def in_live_channels(self, row: Array, least: float) -> NDArray[np.bool_]:
        """Return (size,) whether the channel of each residual has one of this size, or larger.

        A channel is a component of all frames, or of a start.
        """
        large = np.abs(row) >= least
        parts = [np.broadcast_to(part.any(axis=0), part.shape) for part in self.split(large)]
        starts = large[self.size - self.starts :]
        return np.concatenate([*(part.reshape(-1) for part in parts), starts])
