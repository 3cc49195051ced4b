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
    """Residuals of poses (frames, bodies, 6), then of sensors (frames, channels), in one row."""

    frames: int
    bodies: int
    channels: int

    @property
    def size(self) -> int:
        """Number of residuals."""
        return self.frames * (6 * self.bodies + self.channels)

    def split(self, rows: NDArray[T]) -> tuple[NDArray[T], NDArray[T]]:
        """Return (..., frames, bodies, 6) and (..., frames, channels) of rows (..., size)."""
        poses, sensors = np.split(rows, [6 * self.frames * self.bodies], axis=-1)
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
