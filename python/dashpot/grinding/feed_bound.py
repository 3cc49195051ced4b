"""What a pass is to do, and the feed and force that its depth, bounds and joints leave."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashpot.grinding.cell import Cell
from dashpot.grinding.path import Path
from dashpot.grinding.tools import Disc

__all__ = ["Need", "Target"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Target:
    """What a pass is to do.

    Attributes
    ----------
    depth
        To remove along the path, m.
    preston
        Coefficient, 1/Pa.
    max_force
        Largest normal force, N.
    feed
        Smallest and largest, m/s.
    uniformity, largest
        Standard deviation and largest deviation of the depth that are allowed, of the depth.
    acceleration
        Largest along the path, m/s^2.
    """

    depth: float
    preston: float
    max_force: float
    feed: tuple[float, float]
    uniformity: float
    largest: float
    acceleration: float


@dataclass(frozen=True, eq=False)
class Need:
    """Force that a depth needs at a feed, after Preston, and the largest feed that is allowed.

    Attributes
    ----------
    cell, path, target
        What moves where, and to what end.
    left
        Depth that this pass is to remove, m.
    width
        Over which a track counts as evenly ground, m.
    """

    cell: Cell
    path: Path
    target: Target
    left: float
    width: float

    def slide(self, feed: Array) -> Array:
        """Return the sliding speed at the path's points for a feed there, m/s."""
        path, tool = self.path, self.cell.tool
        axis = path.frames[:, :, 2]
        arm = -getattr(tool, "radius", 0.0) * path.normals
        if isinstance(tool, Disc):  # of the outer ring; it only starts the search
            arm = 0.6 * tool.radius * path.tangents
        spun = 2 * math.pi * tool.spin * np.cross(axis, arm)
        spun -= np.sum(spun * path.normals, axis=1, keepdims=True) * path.normals
        return np.asarray(np.linalg.norm(spun + feed[:, None] * path.tangents, axis=1))

    def needed_force(self, feed: Array) -> Array:
        """Return the force that removes the depth at a feed, at the path's points, N."""
        target = self.target
        slide = np.maximum(self.slide(feed), 1e-9)
        return np.asarray(self.left * self.width * feed / (target.preston * slide))

    def largest_feed(self) -> Array:
        """Return the bound of the feed at the path's points: given, of joints, and of the force."""
        target, path = self.target, self.path
        joints = np.abs(np.gradient(path.angles[1], path.distance, axis=0)).max(axis=1)
        upper = np.minimum(target.feed[1], self.cell.arm.joint_speed / np.maximum(joints, 1e-9))
        # A tenth is left for what swings.
        allowed = 0.9 * target.max_force
        lower = np.full(len(path), target.feed[0])
        least = self.needed_force(lower)
        if (least > allowed).any():
            worst = int(least.argmax())
            raise ValueError(
                f"depth {target.depth:g} m needs {least[worst]:.3g} N at path point {worst} even "
                f"at the smallest feed, {target.feed[0]:g} m/s; max_force {target.max_force:g} N "
                f"leaves {allowed:.3g} N: plan more passes, or a slower feed"
            )
        if (upper < lower).any():
            slow = int((upper - lower).argmin())
            raise ValueError(
                f"path point {slow}: joints allow {upper[slow]:.3g} m/s, less than the smallest "
                f"feed, {target.feed[0]:g} m/s"
            )
        low, high = lower, upper.copy()
        for _ in range(50):
            middle = 0.5 * (low + high)
            fits = self.needed_force(middle) <= allowed
            low, high = np.where(fits, middle, low), np.where(fits, high, middle)
        return np.where(self.needed_force(upper) <= allowed, upper, low)
