"""Plane curves and polylines: what a path is before it lies on a surface."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot.checks import finite_array, positive_number

__all__ = ["line", "raster", "resampled"]

Array = NDArray[np.float64]

_ARC_POINTS = 9


def line(start: ArrayLike, end: ArrayLike) -> Array:
    """Return the straight curve (2, 2) or (2, 3) between two points, m.

    Examples
    --------
    >>> grinding.line((-0.1, 0.48), (0.1, 0.52))
    array([[-0.1 ,  0.48],
           [ 0.1 ,  0.52]])
    """
    both = np.stack([finite_array("line: start", start), finite_array("line: end", end)])
    if both.shape not in ((2, 2), (2, 3)):
        raise ValueError(f"line: points must be (2,) or (3,), got {both.shape[1:]}")
    return both


def raster(centre: ArrayLike, size: tuple[float, float], step: float, *, angle: float = 0) -> Array:
    """Return strokes to and fro over a rectangle, joined by half circles.

    Parameters
    ----------
    centre
        (2,) x and y of the middle of the rectangle, m.
    size
        Length of the strokes, and of the rectangle across them, m, > 0.
    step
        Distance of the strokes, m, > 0; it is reduced such that the strokes fill the rectangle.
    angle
        Of the strokes from x, rad.

    Returns
    -------
    (n, 2) points, m.

    Examples
    --------
    >>> strokes = grinding.raster((0.0, 0.5), (0.1, 0.05), 0.01)
    >>> strokes.min(axis=0).round(3), strokes.max(axis=0).round(3)
    (array([-0.055,  0.475]), array([0.055, 0.525]))
    """
    middle = finite_array("raster: centre", centre)
    if middle.shape != (2,):
        raise ValueError(f"raster: centre must be (2,), got {middle.shape}")
    length = positive_number("raster: size[0]", size[0])
    width = positive_number("raster: size[1]", size[1])
    gaps = max(1, math.ceil(width / positive_number("raster: step", step) - 1e-9))
    radius = width / gaps / 2
    bend = np.linspace(-math.pi / 2, math.pi / 2, _ARC_POINTS)[1:-1]
    points: list[Array] = []
    for stroke in range(gaps + 1):
        y = -width / 2 + 2 * radius * stroke
        side = 1.0 if stroke % 2 == 0 else -1.0
        points.append(np.array([[-side * length / 2, y], [side * length / 2, y]]))
        if stroke < gaps:
            points.append(
                np.stack(
                    [side * (length / 2 + radius * np.cos(bend)), y + radius * (1 + np.sin(bend))],
                    axis=1,
                )
            )
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    return np.asarray(middle + np.concatenate(points) @ turn)


def resampled(points: Array, spacing: float) -> Array:
    """Return points at an even spacing, at most `spacing` m, along a polyline, ends included."""
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    count = max(2, math.ceil(along[-1] / spacing - 1e-9) + 1)
    even = np.linspace(0.0, along[-1], count)
    return np.stack([np.interp(even, along, axis) for axis in points.T], axis=1)


def extended(points: Array, length: float) -> Array:
    """Return a polyline with `length` m more at both ends, straight on."""
    first, last = points[0] - points[1], points[-1] - points[-2]
    first, last = first / np.linalg.norm(first), last / np.linalg.norm(last)
    return np.concatenate([[points[0] + length * first], points, [points[-1] + length * last]])
