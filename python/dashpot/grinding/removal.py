"""What a pass takes off a surface, after Preston, and the surface that is left.

Preston (1927): the rate at which a surface recedes is ``preston p v``, the pressure times the
sliding speed. A point of a tool presses on a patch of radius ``a`` with the force f that the
simulation found, spread as a paraboloid::

    p(r) = f w(r),    w(r) = 2 / (pi a^2) (1 - r^2 / a^2),    integral of w over the patch = 1.

A straight pass at the feed u leaves ``preston f v / u * 8 / (3 pi a)`` in the middle of its track,
and removes the volume ``preston f v`` in a second, whatever the patch is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dashpot.checks import positive_number
from dashpot.grinding.path import Path
from dashpot.grinding.simulation import Pass
from dashpot.grinding.surface import Surface
from dashpot.grinding.work import Work

__all__ = ["DepthMap", "depth_along", "removed_volume", "track_width"]

Array = NDArray[np.float64]

_MOST_DISTANCES = 2_000_000


def track_width(footprint: float) -> float:
    """Return the width, m, over which a straight track of a patch counts as evenly ground."""
    return 3 * math.pi * footprint / 8


def removed_volume(found: Pass, preston: float) -> float:
    """Return the volume that a pass removes, m^3: Preston's law over the patch and the time.

    Examples
    --------
    >>> volume = grinding.removed_volume(plan.passes[0].found, 4.7e-10)
    >>> bool(1e-8 < volume < 1e-7)  # m^3
    True
    """
    return float(preston * found.timestep * np.sum(found.force * found.slide))


def depth_along(
    found: Pass, points: Array, normals: Array, *, preston: float, footprint: float
) -> Array:
    """Return the depth that a pass removes at points of the surface.

    Parameters
    ----------
    found
        The pass.
    points, normals
        (n, 3) points and outward normals, world.
    preston
        Coefficient, 1/Pa.
    footprint
        Radius of the patch, m.

    Returns
    -------
    (n,) depth, m.

    Examples
    --------
    >>> found, (points, normals) = plan.passes[0].found, path.judged_points(0.005)
    >>> depth = grinding.depth_along(found, points, normals, preston=4.7e-10, footprint=0.005)
    >>> bool(abs(depth.mean() / 50e-6 - 1) < 0.02)
    True
    """
    owner = np.zeros(len(found.time), dtype=np.intp)
    whole = depth_by_step(found, points, normals, owner, 1, preston=preston, footprint=footprint)
    return np.asarray(whole[:, 0])


def depth_by_step(
    found: Pass,
    points: Array,
    normals: Array,
    owner: NDArray[np.intp],
    count: int,
    *,
    preston: float,
    footprint: float,
) -> Array:
    """Return the depth (n, count) at points by groups of steps.

    `owner` (steps,) names the group of each step, from 0; the rest is as of `depth_along`.
    """
    place, volume, step = _touches(found, preston)
    grouped = np.zeros((len(place), count))
    grouped[np.arange(len(place)), owner[step]] = volume
    depth = np.zeros((len(points), count))
    chunk = max(1, _MOST_DISTANCES // max(1, len(place)))
    size = np.sum(place**2, axis=1)
    for first in range(0, len(points), chunk):
        at, up = points[first : first + chunk], normals[first : first + chunk]
        # Apart along the surface alone: a place lies between two surfaces that overlap.
        away = np.sum(at * up, axis=1)[:, None] - up @ place.T
        square = np.sum(at**2, axis=1)[:, None] + size - 2 * at @ place.T - away**2
        depth[first : first + chunk] = np.maximum(1 - square / footprint**2, 0.0) @ grouped
    return np.asarray(depth * 2 / (math.pi * footprint**2))


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Depth removed over a surface, on a grid in the plane across the direction of the rays.

    Attributes
    ----------
    u, v
        (nu,) and (nv,) places of the nodes along `axes`, m.
    axes
        (3, 3) rows: the directions of u and v, and the rays'.
    points, normals
        (nv, nu, 3) nodes on the surface and outward normals; NaN off the part.
    depth
        (nv, nu) along the normal, m.

    Examples
    --------
    >>> depth_map = plan.depth_map(spacing=0.002)
    >>> bool(np.nanmax(depth_map.depth) > 40e-6)
    True
    """

    u: Array
    v: Array
    axes: Array
    points: Array
    normals: Array
    depth: Array

    @classmethod
    def around(cls, work: Work, path: Path, *, spacing: float, margin: float) -> DepthMap:
        """Return a map without depth of the surface around a path.

        Parameters
        ----------
        work
            The workpiece.
        path
            The path.
        spacing
            Of the nodes, m, > 0.
        margin
            How far the map goes beyond the path's points, m.
        """
        positive_number("map: spacing", spacing)
        mean = -path.normals.mean(axis=0)
        ray = mean / np.linalg.norm(mean)
        first = path.points[-1] - path.points[0]
        if np.linalg.norm(np.cross(first, ray)) < 1e-9:
            first = path.tangents[0]
        first = first - (first @ ray) * ray
        first /= np.linalg.norm(first)
        axes = np.stack([first, np.cross(ray, first), ray])
        flat = path.points @ axes[:2].T
        low, high = flat.min(axis=0) - margin, flat.max(axis=0) + margin
        u, v = (
            np.linspace(a, b, max(2, math.ceil((b - a) / spacing) + 1))
            for a, b in zip(low, high, strict=True)
        )
        return cls._laid(work, u, v, axes)

    @classmethod
    def of_height_field(cls, work: Work) -> DepthMap:
        """Return a map without depth whose nodes are those of a height field."""
        x, y = work.grid
        axes = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
        assert work.heights is not None
        across, along = np.meshgrid(x, y)
        points = np.stack([across, along, work.position[2] + work.heights], axis=-1)
        along_y, along_x = np.gradient(work.heights, y, x)
        normals = np.stack([-along_x, -along_y, np.ones_like(along_x)], axis=-1)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        return cls(x, y, axes, points, normals, np.zeros(work.heights.shape))

    @classmethod
    def _laid(cls, work: Work, u: Array, v: Array, axes: Array) -> DepthMap:
        across, along = np.meshgrid(u, v)
        origins = across[..., None] * axes[0] + along[..., None] * axes[1]
        points, normals = Surface(work).meet(origins.reshape(-1, 3), axes[2])
        shape = (len(v), len(u), 3)
        return cls(u, v, axes, points.reshape(shape), normals.reshape(shape), np.zeros(shape[:2]))

    @property
    def area(self) -> Array:
        """(nv, nu) surface that each node stands for, m^2; 0 off the part."""
        du, dv = np.gradient(self.u), np.gradient(self.v)
        for spacing in (du, dv):  # nodes at the edge stand for half
            spacing[[0, -1]] /= 2
        lean = np.abs(self.normals @ self.axes[2])
        return np.asarray(np.nan_to_num(np.outer(dv, du) / lean))

    @property
    def volume(self) -> float:
        """Volume removed, m^3."""
        return float(np.sum(self.depth * self.area))

    def with_pass(self, found: Pass, *, preston: float, footprint: float) -> DepthMap:
        """Return the map with what a pass removes on top; its volume is that of `removed_volume`.

        What a patch has beyond the edge of the part or the map is not removed from it.
        """
        place, volume, _ = _touches(found, preston)
        flat = place @ self.axes[:2].T
        depth, area = self.depth.copy(), self.area
        nodes = np.where(area[..., None] > 0, self.points, np.inf)
        first = (
            np.searchsorted(self.u, flat[:, 0] - footprint),
            np.searchsorted(self.v, flat[:, 1] - footprint),
        )
        last = (
            np.searchsorted(self.u, flat[:, 0] + footprint),
            np.searchsorted(self.v, flat[:, 1] + footprint),
        )
        for index in range(len(place)):
            window = (
                slice(first[1][index], last[1][index]),
                slice(first[0][index], last[0][index]),
            )
            apart = nodes[window] - place[index]
            normal = np.nan_to_num(self.normals[window])
            with np.errstate(invalid="ignore"):
                away = np.sum(apart * normal, axis=-1)
                square = np.sum(apart**2, axis=-1) - away**2
            weight = np.nan_to_num(np.maximum(1 - square / footprint**2, 0.0), nan=0.0)
            total = float(np.sum(weight * area[window]))
            whole = 0.5 * math.pi * footprint**2
            inside = (
                first[0][index] > 0
                and first[1][index] > 0
                and last[0][index] < len(self.u)
                and last[1][index] < len(self.v)
                and bool((area[window] > 0).all())
            )
            # A patch all on the part gives all of its volume, however coarse the nodes are.
            scale = total if inside and total > 0 else whole
            depth[window] += volume[index] / scale * weight
        return replace(self, depth=depth)

    def receded(self, work: Work) -> Work:
        """Return the height field with the map's depth taken off, by heights."""
        if work.heights is None or work.heights.shape != self.depth.shape:
            raise ValueError("receded: the map has not the nodes of the height field")
        lean = self.normals[..., 2]
        return work.with_heights(work.heights - self.depth / lean)


def _touches(found: Pass, preston: float) -> tuple[Array, Array, NDArray[np.intp]]:
    """Return where points touch (m, 3), the volume (m,) removed there, m^3, and the step."""
    positive_number("preston", preston)
    bears = (found.force > 0) & np.isfinite(found.place[..., 0])
    volume = preston * found.timestep * (found.force * found.slide)[bears]
    return found.place[bears], volume, np.nonzero(bears)[0]
