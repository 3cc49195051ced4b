"""Gaps of moving shapes as functions of time, from closed forms, and where they first are zero.

Nothing here is shared with dashpot. A gap takes times (t,) and gives signed distances (t,), m, of
two shapes whose bodies keep their velocities (`free_flight.Motion`).
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.spatial import ConvexHull

from query_geoms import unit

CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def ball_and_box(ball, box):
    def gap(times):
        centre, _ = ball.at(times)
        position, rotation = box.at(times)
        local = np.einsum("tji,tj->ti", rotation, centre - position)
        excess = np.abs(local) - box.size
        outside = np.linalg.norm(np.maximum(excess, 0.0), axis=1)
        return outside + np.minimum(excess.max(axis=1), 0.0) - ball.size[0]

    return gap


def box_and_ground(box, ground):
    def gap(times):
        position, rotation = box.at(times)
        lowest = (rotation[:, 2] @ (CORNERS * box.size).T).min(axis=1)
        return position[:, 2] + lowest - ground.position[2]

    return gap


def two_boxes(box1, box2):
    def gap(times):
        position1, rotation1 = box1.at(times)
        position2, rotation2 = box2.at(times)
        crossed = np.cross(
            rotation1.transpose(0, 2, 1)[:, :, None], rotation2.transpose(0, 2, 1)[:, None]
        ).reshape(-1, 9, 3)
        length = np.linalg.norm(crossed, axis=2, keepdims=True)
        # Parallel edges: a face normal stands in.
        crossed = np.where(
            length > 1e-9, crossed / np.maximum(length, 1e-300), rotation1[:, None, :, 0]
        )
        axes = np.concatenate(
            (rotation1.transpose(0, 2, 1), rotation2.transpose(0, 2, 1), crossed), axis=1
        )
        apart = np.abs(np.einsum("tai,ti->ta", axes, position2 - position1))
        reach = np.abs(axes @ rotation1) @ box1.size + np.abs(axes @ rotation2) @ box2.size
        return (apart - reach).max(axis=1)

    return gap


def point_triangle(points, triangles):
    """Squared distances (t, k) of points (t, 3) from triangles (k, 3, 3)."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = unit(np.cross(b - a, c - a))
    height = points @ normal.T - np.einsum("ki,ki->k", normal, a)
    inside = np.ones_like(height, dtype=bool)
    nearest = np.full_like(height, np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        edge = q - p
        inward = np.cross(normal, edge)
        inside &= points @ inward.T - np.einsum("ki,ki->k", inward, p) >= 0.0
        from_p = points[:, None] - p
        along = np.einsum("tki,ki->tk", from_p, edge) / np.einsum("ki,ki->k", edge, edge)
        apart = from_p - np.clip(along, 0.0, 1.0)[..., None] * edge
        nearest = np.minimum(nearest, np.einsum("tki,tki->tk", apart, apart))
    return np.where(inside, height**2, nearest)


def segment_segment(start, end, edges):
    """Squared distances (t, k) where two segments come nearest at inner points of both."""
    p, d = edges[:, 0], edges[:, 1] - edges[:, 0]
    u = (end - start)[:, None]
    r = start[:, None] - p
    uu, dd = np.einsum("tki,tki->tk", u, u), np.einsum("ki,ki->k", d, d)
    ud, ur = np.einsum("tki,ki->tk", u, d), np.einsum("tki,tki->tk", np.broadcast_to(u, r.shape), r)
    dr = np.einsum("ki,tki->tk", d, r)
    determinant = uu * dd - ud**2
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (ud * dr - dd * ur) / determinant
        t = (uu * dr - ud * ur) / determinant
        apart = r + s[..., None] * u - t[..., None] * d
    squared = np.einsum("tki,tki->tk", apart, apart)
    inner = (determinant > 1e-12 * uu * dd) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    return np.where(inner, squared, np.inf)


def hull_and_capsule(vertices):
    hull = ConvexHull(vertices)
    triangles = vertices[hull.simplices]
    pairs = {tuple(sorted(p)) for s in hull.simplices for p in itertools.combinations(s, 2)}
    edges = vertices[np.array(sorted(pairs))]

    def make(mesh, capsule):
        def gap(times):
            position, rotation = mesh.at(times)
            centre, axes = capsule.at(times)
            ends = []
            for side in (-1.0, 1.0):
                end = centre + side * capsule.size[1] * axes[:, :, 2] - position
                ends.append(np.einsum("tji,tj->ti", rotation, end))
            # Vertices of the hull against the inside of the segment lie on edges as well.
            squared = np.minimum(
                segment_segment(*ends, edges).min(axis=1),
                np.minimum(*(point_triangle(end, triangles).min(axis=1) for end in ends)),
            )
            along = ends[1] - ends[0]
            share = np.clip(
                np.einsum("tvi,ti->tv", vertices - ends[0][:, None], along)
                / np.einsum("ti,ti->t", along, along)[:, None],
                0.0,
                1.0,
            )
            nearest = ends[0][:, None] + share[..., None] * along[:, None] - vertices
            squared = np.minimum(squared, np.einsum("tvi,tvi->tv", nearest, nearest).min(axis=1))
            return np.sqrt(squared) - capsule.size[0]

        return gap

    return make


def box_and_prisms(prisms):
    """Make the gap of a box to fixed prisms (p, 6, 3), in the world."""
    sides = [(1, 0), (2, 1), (0, 2)]
    ends = [*sides, *((i + 3, j + 3) for i, j in sides), (0, 3)]
    edges = np.stack([prisms[:, i] - prisms[:, j] for i, j in ends], axis=1)
    faces = [np.cross(edges[:, i], edges[:, 6]) for i in (3, 4, 5)]
    faces += [np.cross(edges[:, i], edges[:, i + 1]) for i in (0, 3)]
    normals = np.stack([unit(face) for face in faces], axis=1)

    def make(box, _):
        def gap(times):
            position, rotation = box.at(times)
            axes = rotation.transpose(0, 2, 1)
            crossed = np.cross(axes[:, None, :, None], edges[None, :, None])
            shape = (len(times), len(prisms), -1, 3)
            crossed = crossed.reshape(shape)
            length = np.linalg.norm(crossed, axis=-1, keepdims=True)
            # Parallel edges: a face normal stands in.
            up = axes[:, None, :1]
            crossed = np.where(length > 1e-9, crossed / np.maximum(length, 1e-300), up)
            candidates = np.concatenate(
                (
                    np.broadcast_to(axes[:, None], (*shape[:2], 3, 3)),
                    np.broadcast_to(normals, (*shape[:2], 5, 3)),
                    crossed,
                ),
                axis=2,
            )
            local = prisms - position[:, None, None]
            along = local @ candidates.transpose(0, 1, 3, 2)  # times, prisms, corners, axes
            reach = np.abs(candidates @ rotation[:, None]) @ box.size
            apart = np.maximum(along.min(axis=2) - reach, -reach - along.max(axis=2))
            return apart.max(axis=2).min(axis=1)

        return gap

    return make


def first_contact(gap, horizon, samples):
    """Time of the first zero of a gap (inf without one), and the least gap up to there."""
    times = np.linspace(0.0, horizon, samples)
    values = gap(times)
    least = values.min()
    end = int(np.argmax(values <= 0.0)) if least <= 0.0 else samples - 1
    bracket = (times[end - 1], times[end]) if least <= 0.0 else None
    dips = [i for i in range(1, end) if values[i] <= values[i - 1] and values[i] <= values[i + 1]]
    for i in dips:  # in order of time: the first that reaches zero is the first contact
        low, high = times[i - 1], times[i + 1]
        while high - low > 1e-9 * horizon:
            finer = np.linspace(low, high, 33)
            deep = gap(finer)
            least = min(least, deep.min())
            if deep.min() <= 0.0:
                first = int(np.argmax(deep <= 0.0))
                bracket = (finer[max(first - 1, 0)], finer[first])
                break
            k = int(deep.argmin())
            low, high = finer[max(k - 1, 0)], finer[min(k + 1, 32)]
        else:
            continue
        break
    if bracket is None:
        return np.inf, least
    low, high = bracket
    while True:
        finer = np.linspace(low, high, 33)
        first = int(np.argmax(gap(finer) <= 0.0))
        if first == 0 or finer[first] - finer[first - 1] <= 4e-16 * horizon:
            return finer[first], least
        low, high = finer[first - 1], finer[first]
