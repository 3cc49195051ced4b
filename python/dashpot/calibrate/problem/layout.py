"""Where the residuals of a trajectory stand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
T = TypeVar("T", np.float64, np.bool_, np.intp)

POSES = "poses"
"""Name of the channel of all poses of a trajectory."""


@dataclass(frozen=True)
class Block:
    """Residuals of one channel, row by row; a row is of one time, a column of one number."""

    name: str
    rows: int
    columns: int

    @property
    def size(self) -> int:
        """Number of residuals."""
        return self.rows * self.columns


@dataclass(frozen=True)
class Layout:
    """Residuals in a row: those of each channel, block by block, then starts (starts,).

    The last are of initial states that are known beforehand, but not exactly.
    """

    blocks: tuple[Block, ...]
    starts: int = 0

    @property
    def size(self) -> int:
        """Number of residuals."""
        return sum(block.size for block in self.blocks) + self.starts

    def groups(self) -> list[tuple[str, NDArray[np.intp]]]:
        """Return the places (rows, columns) of residuals that have one kind of noise, by name.

        Poses are two groups, ``"position"`` and ``"rotation"``; other channels are one.
        """
        result = []
        for block, places in zip(self.blocks, self.split(np.arange(self.size)), strict=True):
            if block.name != POSES:
                result.append((block.name, places))
                continue
            of_bodies = places.reshape(block.rows, -1, 2, 3)
            for i, name in enumerate(("position", "rotation")):
                result.append((name, of_bodies[:, :, i].reshape(block.rows, -1)))
        return result

    def split(self, rows: NDArray[T]) -> list[NDArray[T]]:
        """Return by block (..., rows, columns) of residuals (..., size), without the starts."""
        ends = np.cumsum([block.size for block in self.blocks], dtype=np.intp)
        parts = np.split(rows, ends, axis=-1)[:-1]
        return [
            part.reshape(*rows.shape[:-1], block.rows, block.columns)
            for part, block in zip(parts, self.blocks, strict=True)
        ]

    def in_live_channels(self, row: Array, least: float) -> NDArray[np.bool_]:
        """Return (size,) whether the column of each residual has one of this size, or larger.

        Each of the starts is a column of its own.
        """
        large = np.abs(row) >= least
        parts = [np.broadcast_to(part.any(axis=0), part.shape) for part in self.split(large)]
        starts = large[self.size - self.starts :]
        return np.concatenate([*(part.reshape(-1) for part in parts), starts])
