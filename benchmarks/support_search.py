"""Signed distance by a search with support functions.

Along a unit direction n from one convex shape to the other the gap ``s(n) = min n.b - max n.a`` is
a lower bound of the signed distance, and the signed distance is the largest of them. That maximum
is searched with support functions alone: from the best of each of 16 groups of 64 random
directions, by sampling cones that shrink where no sample is better, half of the samples square to a
nearby edge; and over the normals of all faces and the products of all edges, which hold the maximum
where polytopes overlap.
A height field is measured prism by prism: all prisms, but those that some sampled direction
proves to be further than the answer under test.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.spatial import ConvexHull

from query_geoms import prism_corners, unit

FIELD_ROWS, FIELD_COLUMNS = 6, 5
FIELD_SIZE = (0.15, 0.2, 0.1, 0.08)
CHUNK = 100  # configurations searched together
STARTS, SAMPLES, ROUNDS = 16, 10, 60


class Shapes:
    """One shape per configuration, all of one kind: sizes (n, 3), positions, rotations (n, 3, 3).

    `vertices` (v, 3) or (n, v, 3) in the frame of the shape, of a mesh or a prism.
    """

    def __init__(self, kind, size, position, rotation, vertices=None):
        self.kind, self.size, self.vertices = kind, size, vertices
        self.position, self.rotation = position, rotation

    def __getitem__(self, index):
        vertices = self.vertices
        if vertices is not None and vertices.ndim == 3:
            vertices = vertices[index]
        arrays = self.size[index], self.position[index], self.rotation[index]
        return Shapes(self.kind, *arrays, vertices)

    def supports(self, directions):
        """Furthest points (n, k, 3) along unit directions (n, k, 3)."""
        d = directions @ self.rotation
        size = self.size[:, None]
        if self.kind == "sphere":
            local = size[..., :1] * d
        elif self.kind == "capsule":
            local = size[..., :1] * d
            local[..., 2] += np.copysign(size[..., 1], d[..., 2])
        elif self.kind == "cylinder":
            radial = np.maximum(np.hypot(d[..., 0], d[..., 1]), 1e-300)
            local = np.copysign(size[..., 1:2], d)
            local[..., :2] = size[..., :1] * d[..., :2] / radial[..., None]
        elif self.kind == "ellipsoid":
            local = size * d
            local *= size / np.linalg.norm(local, axis=-1, keepdims=True)
        elif self.kind == "box":
            local = np.copysign(size, d)
        elif self.vertices.ndim == 2:
            local = self.vertices[np.argmax(d @ self.vertices.T, axis=-1)]
        else:
            corners = self.vertices
            if self.kind == "hfield":
                corners = prism_corners(FIELD_SIZE, corners).reshape(len(corners), -1, 3)
            best = np.argmax(d @ corners.transpose(0, 2, 1), axis=-1)
            local = np.take_along_axis(corners, best[..., None], axis=1)
        return self.position[:, None] + local @ self.rotation.transpose(0, 2, 1)

    def face_normals(self):
        """Outer normals (n, k, 3) of all flat faces, up to their sign."""
        if self.kind == "box":
            local = np.eye(3)
        elif self.kind == "cylinder":
            local = np.eye(3)[2:]
        elif self.kind == "mesh":
            local = ConvexHull(self.vertices).equations[:, :3]
        elif self.kind == "prism":
            v = self.vertices
            sides = np.stack([v[:, 1] - v[:, 0], v[:, 2] - v[:, 1], v[:, 0] - v[:, 2]], axis=1)
            up = np.broadcast_to((0.0, 0.0, 1.0), sides[:, :1].shape)
            top = np.cross(sides[:, :1], sides[:, 1:2])
            local = np.concatenate((up, top, np.cross(sides, up)), axis=1)
            local = local / np.linalg.norm(local, axis=-1, keepdims=True)
        else:
            local = np.zeros((0, 3))
        return local @ self.rotation.transpose(0, 2, 1)

    def edges(self):
        """Directions (n, k, 3) of all straight edges of the core."""
        if self.kind == "box":
            local = np.eye(3)
        elif self.kind in ("capsule", "cylinder"):
            local = np.eye(3)[2:]
        elif self.kind == "mesh":
            triangles = ConvexHull(self.vertices).simplices
            pairs = {tuple(sorted(p)) for t in triangles for p in itertools.combinations(t, 2)}
            local = np.array([self.vertices[j] - self.vertices[i] for i, j in sorted(pairs)])
        elif self.kind == "prism":
            v = self.vertices
            ends = ((0, 1), (1, 2), (0, 2), (3, 4), (4, 5), (3, 5), (0, 3))
            local = np.stack([v[:, j] - v[:, i] for i, j in ends], axis=1)
        else:
            local = np.zeros((0, 3))
        return local @ self.rotation.transpose(0, 2, 1)

    def outside(self, points):
        """How far, m, points (n, 3) are outside at most (0 inside)."""
        local = np.einsum("nji,nj->ni", self.rotation, points - self.position)
        size = self.size
        if self.kind == "plane":
            excess = local[:, 2]
        elif self.kind == "sphere":
            excess = np.linalg.norm(local, axis=1) - size[:, 0]
        elif self.kind == "capsule":
            nearest = np.clip(local[:, 2], -size[:, 1], size[:, 1])
            local[:, 2] -= nearest
            excess = np.linalg.norm(local, axis=1) - size[:, 0]
        elif self.kind == "cylinder":
            wall = np.hypot(local[:, 0], local[:, 1]) - size[:, 0]
            excess = np.maximum(wall, np.abs(local[:, 2]) - size[:, 1])
        elif self.kind == "ellipsoid":
            excess = (np.linalg.norm(local / size, axis=1) - 1.0) * size.max(axis=1)
        elif self.kind == "box":
            excess = (np.abs(local) - size).max(axis=1)
        elif self.kind == "mesh":
            equations = ConvexHull(self.vertices).equations
            excess = (local @ equations[:, :3].T + equations[:, 3]).max(axis=1)
        else:
            excess = self.outside_field(local)
        return np.maximum(excess, 0.0)

    def outside_field(self, local):
        """As `outside` for the height field; `vertices` holds the heights (n, rows, columns)."""
        half_x, half_y, elevation, base = FIELD_SIZE
        x = (local[:, 0] + half_x) / (2 * half_x) * (FIELD_COLUMNS - 1)
        y = (local[:, 1] + half_y) / (2 * half_y) * (FIELD_ROWS - 1)
        c = np.clip(np.floor(x), 0, FIELD_COLUMNS - 2).astype(int)
        r = np.clip(np.floor(y), 0, FIELD_ROWS - 2).astype(int)
        u, v = np.clip(x - c, 0, 1), np.clip(y - r, 0, 1)
        n = np.arange(len(local))
        h = elevation * self.vertices
        low, high = h[n, r, c], h[n, r + 1, c + 1]
        right, left = h[n, r, c + 1], h[n, r + 1, c]
        surface = np.where(
            u > v,
            low + u * (right - low) + v * (high - right),
            low + v * (left - low) + u * (high - left),
        )
        rim = np.maximum(np.abs(local[:, 0]) - half_x, np.abs(local[:, 1]) - half_y)
        return np.maximum(np.maximum(rim, -base - local[:, 2]), local[:, 2] - surface)


def gaps(shape1, shape2, directions):
    """s(n) (n, k) of unit directions (n, k, 3) from shape 1 to shape 2."""
    second = shape2.supports(-directions)
    if shape1.kind == "plane":
        up = shape1.rotation[:, :, 2]
        heights = np.einsum("nki,ni->nk", second - shape1.position[:, None], up)
        return np.where(np.einsum("nki,ni->nk", directions, up) > 1 - 1e-12, heights, -np.inf)
    return np.einsum("nki,nki->nk", second - shape1.supports(directions), directions)


def feature_directions(shape1, shape2):
    """Face normals and products of edges, both signs (n, k, 3)."""
    edges1, edges2 = shape1.edges(), shape2.edges()
    products = np.cross(edges1[:, :, None], edges2[:, None]).reshape(len(edges1), -1, 3)
    if edges1.shape[1] and not edges2.shape[1]:
        products = np.zeros((len(edges1), 0, 3))
    length = np.linalg.norm(products, axis=-1, keepdims=True)
    up = np.array((0.0, 0.0, 1.0))  # a direction like any other where edges are parallel
    products = np.where(length > 1e-9, products / np.maximum(length, 1e-300), up)
    normals = np.concatenate((shape1.face_normals(), shape2.face_normals(), products), axis=1)
    return np.concatenate((normals, -normals), axis=1)


def on_ridges(directions, centre, edges, rng):
    """Turn directions (n, s, k, 3) square to one of the three edges that are nearest to it.

    s(n) has ridges on the great circles that are square to straight edges.
    """
    kept = min(3, edges.shape[1])
    slope = np.abs(np.einsum("nsi,nei->nse", centre, edges))
    nearest = np.argpartition(slope, kept - 1, axis=2)[..., :kept]
    pick = rng.integers(kept, size=directions.shape[:3])
    index = np.take_along_axis(nearest, pick.reshape(*nearest.shape[:2], -1), axis=2)
    edge = np.take_along_axis(edges[:, None], index[..., None], axis=2)
    return directions - np.einsum("nski,nski->nsk", directions, edge)[..., None] * edge


def search(shape1, shape2, rng, starts=STARTS, samples=SAMPLES):
    """Largest s(n) found (n,), by the search that the module describes."""
    count = len(shape1.size)
    best = np.empty(count)
    features = feature_directions(shape1, shape2)
    ridges = np.concatenate((shape1.edges(), shape2.edges()), axis=1)
    ridges = unit(ridges)
    for begin in range(0, count, CHUNK):
        chunk = slice(begin, min(begin + CHUNK, count))
        one, two = shape1[chunk], shape2[chunk]
        size = len(one.size)
        pool = unit(rng.normal(size=(size, 64 * starts, 3)))
        heights = gaps(one, two, pool).reshape(size, starts, 64)
        winner = heights.argmax(axis=2)[..., None]
        height = np.take_along_axis(heights, winner, 2)[..., 0]
        centre = np.take_along_axis(pool.reshape(size, starts, 64, 3), winner[..., None], 2)[
            :, :, 0
        ]
        radius = np.full((size, starts), 0.3)
        for _ in range(ROUNDS):
            around = centre[:, :, None] + radius[..., None, None] * rng.normal(
                size=(size, starts, samples, 3)
            )
            if ridges.shape[1]:
                around[:, :, ::2] = on_ridges(around[:, :, ::2], centre, ridges[chunk], rng)
            around = unit(around)
            heights = gaps(one, two, around.reshape(size, -1, 3)).reshape(size, starts, samples)
            winner = heights.argmax(axis=2)[..., None]
            raised = np.take_along_axis(heights, winner, 2)[..., 0]
            better = raised > height
            moved = np.take_along_axis(around, winner[..., None], 2)[:, :, 0]
            centre = np.where(better[..., None], moved, centre)
            height = np.where(better, raised, height)
            radius *= np.where(better, 1.2, 0.6)
        best[chunk] = height.max(axis=1)
        if features.shape[1]:
            best[chunk] = np.maximum(best[chunk], gaps(one, two, features[chunk]).max(axis=1))
    return best


def search_field(field, shape, answer, normals, tolerance, rng):
    """Signed distance (n,) of height fields: least over prisms of the largest s(n) found."""
    corners = prism_corners(FIELD_SIZE, field.vertices)
    count, prisms = corners.shape[:2]
    coarse = np.empty((count, prisms))
    for begin in range(0, count, CHUNK):
        chunk = slice(begin, min(begin + CHUNK, count))
        rotation = field.rotation[chunk]
        directions = unit(rng.normal(size=(len(rotation), 512, 3)))
        lowest = np.einsum("nki,nki->nk", shape[chunk].supports(-directions), directions)
        local = directions @ rotation
        own = np.einsum("nki,ni->nk", directions, field.position[chunk])
        flat = corners[chunk].reshape(len(rotation), -1, 3)
        reach = (flat @ local.transpose(0, 2, 1)).reshape(len(rotation), prisms, 6, -1).max(axis=2)
        coarse[chunk] = ((lowest - own)[:, None] - reach).max(axis=2)
    # All that are not proven to be further than the answer, and the three least proven.
    open_ = coarse < (answer + tolerance)[:, None]
    np.put_along_axis(open_, np.argpartition(coarse, 3, axis=1)[:, :3], True, axis=1)
    trial, prism = np.nonzero(open_)
    items = Shapes(
        "prism",
        field.size[trial],
        field.position[trial],
        field.rotation[trial],
        corners[trial, prism],
    )
    others = shape[trial]
    found = search(items, others, rng)
    proposed = gaps(items, others, normals[trial][:, None])[:, 0]
    # Where the search stalls short of the answer, again with eight times the samples.
    stalled = np.nonzero(found < answer[trial] - 0.5 * tolerance[trial])[0]
    if len(stalled):
        again = search(items[stalled], others[stalled], rng, 4 * STARTS, 2 * SAMPLES)
        found[stalled] = np.maximum(found[stalled], again)
    best = np.maximum(found, proposed)
    alone, reference = np.full(count, np.inf), np.full(count, np.inf)
    np.minimum.at(alone, trial, found)
    np.minimum.at(reference, trial, best)
    return alone, reference
