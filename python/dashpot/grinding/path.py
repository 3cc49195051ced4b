"""Paths of a tool over a workpiece: points with normals, and the joint angles that reach them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot.checks import finite_array, number, positive_number
from dashpot.grinding.curves import extended, resampled
from dashpot.grinding.kinematics import PoseSolver, rotations
from dashpot.grinding.surface import Surface

if TYPE_CHECKING:
    from dashpot.grinding.cell import Cell

__all__ = ["Path"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Path:
    """Points on a surface that the tip of a tool follows, and how the arm reaches them.

    Attributes
    ----------
    points, normals, tangents
        (n, 3) points, outward normals and directions of travel, world, m and unit.
    distance
        (n,) way along the path, m, from 0.
    frames
        (n, 3, 3) orientations of the tip, its z into the part.
    offsets
        (3,) depths below the surface, m, at which `angles` were found: above it, on it, in it.
    angles
        (3, n, joints) joint angles, rad, for the tip at these depths.
    run_in
        Length at either end on which the tool comes down and lifts, m, and which is not judged.
    laid
        How `on_surface` was called, to lay the path again on a surface that has receded.

    Examples
    --------
    >>> path.points.shape == path.normals.shape, path.angles.shape[2]
    (True, 6)
    """

    points: Array
    normals: Array
    tangents: Array
    distance: Array
    frames: Array
    offsets: Array
    angles: Array
    run_in: float
    laid: Mapping[str, Any]

    @classmethod
    def on_surface(
        cls,
        cell: Cell,
        curve: ArrayLike,
        spacing: float = 0.005,
        *,
        direction: ArrayLike = (0.0, 0.0, -1.0),
        run_in: float | None = None,
        tilt: float = 0.0,
        lead: float = 0.0,
        clearance: float = 0.005,
        depth: float = 0.02,
    ) -> Path:
        """Lay a curve on the workpiece and find the joint angles along it.

        Parameters
        ----------
        cell
            Arm, tool and workpiece.
        curve
            (n, 2) points in x and y or (n, 3) points of a polyline, m, which rays along `direction`
            carry on to the surface; `dashpot.grinding.curves` makes rasters.
        spacing
            Of the path's points, m, > 0.
        direction
            Of the rays, world.
        run_in
            Length, m, >= 0, by which the curve is continued at both ends: there the tool comes
            down and lifts. It has to be on the part. None: 20 mm, and what a tool is wide.
        tilt, lead
            Angles of the tool against the normal, rad, across and along the way.
        clearance, depth
            How far above the surface, and how far into it, the tip may be sent, m, > 0.

        Raises
        ------
        ValueError
            Naming the point: off the part, out of reach, or a jump of a joint.

        Examples
        --------
        >>> short = grinding.line((-0.05, 0.5), (0.05, 0.5))
        >>> along = grinding.Path.on_surface(cell, short, spacing=0.01)
        >>> round(float(along.distance[-1]), 3)  # m, with the run-in at both ends
        0.14
        """
        if run_in is None:
            run_in = 0.02 + (reach(cell) + cell.tool.footprint if reach(cell) else 0.0)
        given = {
            "curve": curve,
            "spacing": spacing,
            "direction": direction,
            "run_in": run_in,
            "tilt": tilt,
            "lead": lead,
            "clearance": clearance,
            "depth": depth,
        }
        plane = finite_array("path: curve", curve)
        if plane.ndim != 2 or plane.shape[1] not in (2, 3) or len(plane) < 2:
            raise ValueError(f"path: curve must be (n, 2) or (n, 3), n >= 2, got {plane.shape}")
        positive_number("path: spacing", spacing)
        positive_number("path: clearance", clearance)
        positive_number("path: depth", depth)
        if not (math.isfinite(number("path: run_in", run_in)) and run_in >= 0):
            raise ValueError(f"path: run_in must be finite and >= 0, got {run_in!r}")
        for name, angle in (("tilt", tilt), ("lead", lead)):
            if not abs(number(f"path: {name}", angle)) < math.pi / 2:
                raise ValueError(f"path: {name} must be within 90 degrees, got {angle!r} rad")
        along = finite_array("path: direction", direction)
        along = along / np.linalg.norm(along)
        if (np.linalg.norm(np.diff(plane, axis=0), axis=1) == 0).any():
            raise ValueError("path: two points of the curve that follow each other are the same")
        if run_in > 0:
            plane = extended(plane, run_in)
        if plane.shape[1] == 2:
            plane = np.c_[plane, np.zeros(len(plane))]
        points, normals = _laid(Surface(cell.part), plane, along, spacing)
        distance = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
        tangents = np.gradient(points, distance, axis=0)
        tangents -= np.sum(tangents * normals, axis=1, keepdims=True) * normals
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        across = np.cross(normals, tangents)
        into = -(normals + math.tan(tilt) * across + math.tan(lead) * tangents)
        into /= np.linalg.norm(into, axis=1, keepdims=True)
        solver = PoseSolver(cell)
        frames = rotations(into, solver.home_frame()[:, 0])
        # The tip's own point is not where a tilted ball touches: it is put such that it does.
        places = points + _tip_shift(cell, normals, into)
        offsets = np.array([-clearance, 0.0, depth])
        start = None
        angles = []
        for offset in offsets:
            angles.append(solver.along(places - offset * normals, frames, start))
            start = angles[-1][0]
        return cls(
            points,
            normals,
            tangents,
            distance,
            frames,
            offsets,
            np.stack(angles),
            float(run_in),
            given,
        )

    def again(self, cell: Cell) -> Path:
        """Return the path laid anew, as on a workpiece that was ground."""
        return Path.on_surface(cell, **self.laid)

    def judged_points(self, spacing: float) -> tuple[Array, Array]:
        """Return points (m, 3) and normals of the judged part, at most `spacing` m apart."""
        first, last = self.run_in, self.length - self.run_in
        if last <= first:
            raise ValueError(f"path: {self.length:.3g} m are all run-in of {self.run_in:.3g} m")
        way = np.linspace(first, last, max(2, math.ceil((last - first) / spacing) + 1))
        at, up = (
            np.stack([np.interp(way, self.distance, axis) for axis in values.T], axis=1)
            for values in (self.points, self.normals)
        )
        return at, up / np.linalg.norm(up, axis=1, keepdims=True)

    @property
    def length(self) -> float:
        """Of all the path, m."""
        return float(self.distance[-1])

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        """Return number of points and length."""
        return f"Path({len(self)} points, {self.length:.4g} m)"


def _laid(surface: Surface, curve: Array, direction: Array, spacing: float) -> tuple[Array, Array]:
    """Return points of the surface at an even spacing under a curve, and normals there."""
    fine = resampled(curve, spacing / 4)
    points, _ = surface.meet(fine, direction)
    _check_met(points, fine)
    # Even on the surface, where the curve was even in its plane.
    way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    even = np.linspace(0.0, way[-1], max(3, math.ceil(way[-1] / spacing - 1e-6) + 1))
    seen = np.stack([np.interp(even, way, axis) for axis in fine.T], axis=1)
    points, normals = surface.meet(seen, direction)
    _check_met(points, seen)
    return points, normals


def _check_met(points: Array, curve: Array) -> None:
    missed = np.flatnonzero(np.isnan(points[:, 0]))
    if missed.size:
        where = ", ".join(f"{x:.3f}" for x in curve[missed[0]])
        raise ValueError(
            f"path is off the part at ({where}) m, {missed.size} of {len(curve)} points "
            "(its run-in counts)"
        )


def reach(cell: Cell) -> float:
    """Return how far from its axis a tool presses, m."""
    from dashpot.grinding.tools import Disc

    return cell.tool.radius if isinstance(cell.tool, Disc) else 0.0


def _tip_shift(cell: Cell, normals: Array, into: Array) -> Array:
    """Return where the tip is, seen from the point at which a ball nose touches."""
    from dashpot.grinding.tools import BallNose

    radius = cell.tool.radius if isinstance(cell.tool, BallNose) else 0.0
    return np.asarray(radius * (normals + into))
