"""Geoms that contact queries are measured on: every convex type, and height fields as prisms."""

from __future__ import annotations

import itertools

import numpy as np

from scene import free_body

CONVEX = ("sphere", "capsule", "cylinder", "ellipsoid", "box", "mesh")
SIZE = {
    "sphere": (0.08, 0.0, 0.0),
    "capsule": (0.05, 0.1, 0.0),
    "cylinder": (0.07, 0.09, 0.0),
    "ellipsoid": (0.1, 0.06, 0.04),
    "box": (0.09, 0.05, 0.07),
}


def unit(vectors):
    """Vectors (..., 3) scaled to length 1."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def hull_points(count=30, semi_axes=(0.1, 0.07, 0.05)):
    """Points (count, 3) on an ellipsoid, m: the vertices of a convex hull."""
    return unit(np.random.default_rng(7).normal(size=(count, 3))) * semi_axes


def hull_mesh(points):
    """MJCF of the mesh ``hull`` with these vertices."""
    return f'<mesh name="hull" vertex="{" ".join(f"{x:.9g}" for x in points.ravel())}"/>'


def shape(kind, sizes=SIZE):
    """MJCF attributes of a geom of a convex type; a mesh is ``hull``."""
    if kind == "mesh":
        return 'type="mesh" mesh="hull"'
    return f'type="{kind}" size="{" ".join(map(str, sizes[kind]))}"'


def two_of_each():
    """MJCF of two free bodies of each convex type, with geoms ``sphere1``, ``sphere2`` ..."""
    return "".join(
        free_body(kind + copy, shape(kind), (0, 0, 0))
        for copy, kind in itertools.product("12", CONVEX)
    )


def prism_corners(size, heights):
    """Corners (..., prisms, 6, 3) in the frame of height fields, from their definition.

    `size` is MuJoCo's ``hfield_size``, `heights` (..., rows, columns) in parts of its elevation.
    Each cell has two prisms; their three upper corners come first, then the three below them.
    """
    half_x, half_y, elevation, base = size
    rows, columns = heights.shape[-2:]
    points = np.empty((*heights.shape, 3))
    points[..., 0] = np.linspace(-half_x, half_x, columns)
    points[..., 1] = np.linspace(-half_y, half_y, rows)[:, None]
    points[..., 2] = elevation * heights
    top = np.stack(
        [
            np.stack([points[..., i, j, :] for i, j in ((r, c), middle, (r + 1, c + 1))], axis=-2)
            for r, c in itertools.product(range(rows - 1), range(columns - 1))
            for middle in ((r, c + 1), (r + 1, c))
        ],
        axis=-3,
    )
    bottom = top.copy()
    bottom[..., 2] = -base
    return np.concatenate((top, bottom), axis=-2)
