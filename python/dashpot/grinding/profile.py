"""Feed and force along a path, as splines of few numbers: what a plan chooses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from dashpot.grinding.cell import Cell
from dashpot.grinding.motion import Command
from dashpot.grinding.path import Path
from dashpot.grinding.time_law import TimeLaw

__all__ = ["Profiles"]

Array = NDArray[np.float64]

_NODES = 1e-3  # m, between nodes of a motion
_DEGREE = 3


@dataclass(frozen=True, eq=False)
class Profiles:
    """Maps between the unknowns of a plan and the command of a pass.

    The unknowns are coefficients of cubic B-splines of the way: shares of the largest feed, then
    forces in N, whose ends are 0. A spline lies between its coefficients, and each acts on four
    intervals alone.

    Attributes
    ----------
    way
        (n,) nodes, m.
    largest_feed
        (n,) bound of the feed at the nodes, m/s.
    feed_basis, force_basis
        (n, m) values of the splines at the nodes.
    compliance
        How far the tip is sent below the surface per newton, m/N: that of contact and spindle.
    hover
        How far above the surface the pass begins, m, and over which way it comes down.
    acceleration
        Largest along the path, m/s^2.
    """

    way: Array
    largest_feed: Array
    feed_basis: Array
    force_basis: Array
    compliance: float
    hover: Array
    acceleration: float

    @classmethod
    def of(
        cls,
        cell: Cell,
        path: Path,
        largest_feed: Array,
        *,
        feed_spacing: float,
        force_spacing: float,
        acceleration: float,
        hover: float,
        landing: float,
    ) -> Profiles:
        """Return the profiles of a path.

        `largest_feed` (m/s) is that at the path's points; the tool comes down over `landing` m.
        """
        way = np.linspace(0.0, path.length, max(9, round(path.length / _NODES) + 1))
        spindle = 0.0 if cell.spindle is None else 1.0 / cell.spindle.stiffness
        left = np.clip(1 - np.minimum(way, path.length - way) / landing, 0.0, 1.0)
        return cls(
            way,
            np.interp(way, path.distance, largest_feed),
            _basis(way, feed_spacing),
            _basis(way, force_spacing)[:, 2:-2],
            1.0 / cell.stiffness + spindle,
            hover * left**3 * (10 - 15 * left + 6 * left**2),
            acceleration,
        )

    @property
    def feeds(self) -> int:
        """Number of unknowns of the feed, which come first."""
        return int(self.feed_basis.shape[1])

    @property
    def forces(self) -> int:
        """Number of unknowns of the force."""
        return int(self.force_basis.shape[1])

    @property
    def centres(self) -> Array:
        """Where each unknown acts most, m."""
        both = (self.feed_basis, self.force_basis)
        return np.concatenate([self.way @ basis / basis.sum(axis=0) for basis in both])

    def feed(self, unknowns: Array) -> Array:
        """Return (n,) the feed that is asked for at the nodes, m/s."""
        return np.asarray(self.largest_feed * (self.feed_basis @ unknowns[: self.feeds]))

    def force(self, unknowns: Array) -> Array:
        """Return (n,) the force at the nodes, N."""
        return np.asarray(self.force_basis @ unknowns[self.feeds :])

    def law(self, unknowns: Array) -> TimeLaw:
        """Return the motion."""
        return TimeLaw.of_feed(self.way, self.feed(unknowns), self.acceleration)

    def command(self, unknowns: Array) -> Command:
        """Return what the pass is told."""
        force = self.force(unknowns)
        return Command(self.law(unknowns), self.compliance * force - self.hover, force)

    def fitted(self, feed_share: Array, force: Array) -> Array:
        """Return unknowns whose splines are nearest to shares and forces (n,) at the nodes."""
        shares = np.linalg.lstsq(self.feed_basis, feed_share, rcond=None)[0]
        forces = np.linalg.lstsq(self.force_basis, force, rcond=None)[0]
        return np.concatenate([shares, forces])


def _basis(way: Array, spacing: float) -> Array:
    """Return (n, m) cubic B-splines on an even grid of about `spacing`, ends clamped."""
    pieces = max(4, round(way[-1] / spacing))
    inner = np.linspace(way[0], way[-1], pieces + 1)
    knots = np.r_[[inner[0]] * _DEGREE, inner, [inner[-1]] * _DEGREE]
    return np.asarray(BSpline.design_matrix(way, knots, _DEGREE).toarray())
