"""Signed distance for every pair of geom types: error and time beside MuJoCo and python-fcl.

    python benchmarks/query_accuracy.py            # 1,000 random configurations a pair
    python benchmarks/query_accuracy.py -n 10000
    python benchmarks/query_accuracy.py --pair hfield box

Two geoms of about 0.1 m, their sizes drawn anew (each between 0.4 and 2.5 times) and their poses
too, overlapping and apart; a height field of 6 x 5 points gets new heights.

Reference: along a unit direction n from one convex shape to the other the gap
``s(n) = min n.b - max n.a`` is a lower bound of the signed distance, and the signed distance is the
largest of them. The reference searches for that maximum with support functions alone: from the best
of each of 16 groups of 64 random directions, by sampling cones that shrink where no sample is
better, half of the samples square to a nearby edge; and over the normals of all faces and the
products of all edges, which hold the maximum where polytopes overlap. Then the directions that the
libraries propose join in: each is a proven bound as well. Where shapes are apart, dashpot's witness
points are a bound from above once they are seen to lie in the shapes.
A height field is measured prism by prism: all prisms, but those that some sampled direction
proves to be further than dashpot's answer.

An answer is wrong where it is off by more than 1e-6 m + 1e-4 of the distance, or 1e-3 of it where
a curved core (cylinder, ellipsoid) takes part; dashpot's also where the gap along its normal is,
where a witness point is that far outside its shape, or where the two points do not differ by
distance times normal. `search` is how far the search alone ends below the reference, at worst, in
overlap, where nothing else proves that no direction is shorter (after eight times the samples where
it stalls).
python-fcl takes part where it is installed.
"""

from __future__ import annotations

import argparse
import itertools
import time

import mujoco
import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import dashpot

try:
    import fcl
except ImportError:
    fcl = None

KINDS = ("sphere", "capsule", "cylinder", "ellipsoid", "box", "mesh")
CURVED = {"cylinder", "ellipsoid"}
SIZE = {
    "plane": (0.0, 0.0, 0.0),
    "sphere": (0.08, 0.0, 0.0),
    "capsule": (0.05, 0.1, 0.0),
    "cylinder": (0.07, 0.09, 0.0),
    "ellipsoid": (0.1, 0.06, 0.04),
    "box": (0.09, 0.05, 0.07),
    "mesh": (0.0, 0.0, 0.0),
}
FIELD_ROWS, FIELD_COLUMNS = 6, 5
FIELD_SIZE = (0.15, 0.2, 0.1, 0.08)
CHUNK = 100  # configurations searched together
STARTS, SAMPLES, ROUNDS = 16, 10, 60


def make_model():
    """Two free bodies of each convex type, a plane and a height field."""
    points = np.random.default_rng(7).normal(size=(30, 3))
    points *= np.array((0.1, 0.07, 0.05)) / np.linalg.norm(points, axis=1, keepdims=True)
    vertices = " ".join(f"{x:.9g}" for x in points.ravel())
    bodies = ""
    for copy, kind in itertools.product("12", KINDS):
        size = " ".join(map(str, SIZE[kind]))
        shape = 'type="mesh" mesh="hull"' if kind == "mesh" else f'type="{kind}" size="{size}"'
        bodies += f'<body><freejoint/><geom name="{kind}{copy}" {shape}/></body>'
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><mesh name="hull" vertex="{vertices}"/>
        <hfield name="hills" nrow="{FIELD_ROWS}" ncol="{FIELD_COLUMNS}"
         size="{" ".join(map(str, FIELD_SIZE))}"/></asset><worldbody>
        <geom name="plane1" type="plane" size="1 1 1"/>
        <geom name="hfield1" type="hfield" hfield="hills"/>{bodies}</worldbody></mujoco>"""
    )


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
                corners = prism_corners(corners).reshape(len(corners), -1, 3)
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


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


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


def prism_corners(heights):
    """Corners (n, prisms, 6, 3) of all prisms of fields of heights (n, rows, columns)."""
    half_x, half_y, elevation, base = FIELD_SIZE
    x, y = np.linspace(-half_x, half_x, FIELD_COLUMNS), np.linspace(-half_y, half_y, FIELD_ROWS)
    points = np.empty((*heights.shape, 3))
    points[..., 0], points[..., 1], points[..., 2] = x, y[:, None], elevation * heights
    top = []
    for r, c in itertools.product(range(FIELD_ROWS - 1), range(FIELD_COLUMNS - 1)):
        for i, j in ((r, c + 1), (r + 1, c)):
            top.append(np.stack((points[:, r, c], points[:, i, j], points[:, r + 1, c + 1]), 1))
    top = np.stack(top, axis=1)
    bottom = top.copy()
    bottom[..., 2] = -base
    return np.concatenate((top, bottom), axis=2)


def search_field(field, shape, answer, normals, tolerance, rng):
    """Signed distance (n,) of height fields: least over prisms of the largest s(n) found."""
    corners = prism_corners(field.vertices)
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


class Pair:
    """Two geoms in the hands of the three libraries, in `count` random configurations."""

    def __init__(self, model, kind1, kind2, count, rng):
        self.model, self.data = model, mujoco.MjData(model)
        mujoco.mj_forward(model, self.data)
        self.kinds = (kind1, kind2)
        second = kind2 + ("1" if kind2 == "hfield" else "2")
        self.ids = [model.geom(name).id for name in (kind1 + "1", second)]
        self.mesh = model.mesh_vert.astype(float)
        self.fcl = fcl is not None and kind1 not in ("plane", "hfield")  # its plane crashes
        self.shapes = []
        spread = np.array((0.02, 0.06, 0.15))[np.arange(count) % 3, None]
        for kind in self.kinds:
            size = np.array(SIZE.get(kind, (0, 0, 0))) * np.exp(rng.uniform(-0.9, 0.9, (count, 3)))
            position = rng.normal(size=(count, 3)) * spread
            rotation = Rotation.random(count, random_state=rng).as_matrix()
            vertices = self.mesh if kind == "mesh" else None
            if kind == "hfield":
                rough = rng.random((count, FIELD_ROWS, FIELD_COLUMNS))
                vertices = (rough * rng.random((count, 1, 1))).astype(np.float32).astype(float)
            self.shapes.append(Shapes(kind, size, position, rotation, vertices))
        if kind1 == "hfield":  # spread over the field, about its surface
            offset = rng.normal(size=(count, 3)) * (0.1, 0.13, 0.08) + (0, 0, 0.07)
            self.shapes[1].position = self.shapes[0].position + np.einsum(
                "nij,nj->ni", self.shapes[0].rotation, offset
            )

    def place(self, trial):
        """Put both geoms as configuration `trial` has them, in every library."""
        for geom, kind, shape in zip(self.ids, self.kinds, self.shapes, strict=True):
            self.data.geom_xpos[geom] = shape.position[trial]
            self.data.geom_xmat[geom] = shape.rotation[trial].ravel()
            if kind in ("sphere", "capsule", "cylinder", "ellipsoid", "box"):
                self.model.geom_size[geom] = shape.size[trial]
                self.model.geom_rbound[geom] = np.linalg.norm(shape.size[trial]) * 2
            elif kind == "hfield":
                self.model.hfield_data[:] = shape.vertices[trial].ravel()
        if self.fcl:
            self.objects = [
                fcl.CollisionObject(
                    self.fcl_shape(shape.kind, shape.size[trial]),
                    fcl.Transform(shape.rotation[trial], shape.position[trial]),
                )
                for shape in self.shapes
            ]

    def fcl_shape(self, kind, size):
        """Make python-fcl's shape; a mesh is its hull, from MuJoCo's hull graph."""
        if kind == "sphere":
            return fcl.Sphere(size[0])
        if kind == "capsule":
            return fcl.Capsule(size[0], 2 * size[1])
        if kind == "cylinder":
            return fcl.Cylinder(size[0], 2 * size[1])
        if kind == "ellipsoid":
            return fcl.Ellipsoid(*size)
        if kind == "box":
            return fcl.Box(*(2 * size))
        graph = self.model.mesh_graph
        count, faces = graph[0], graph[1]
        ids = graph[2 + count : 2 + 2 * count]
        triangles = graph[2 + 3 * count + 3 * faces :][: 3 * faces].reshape(-1, 3)
        position = {int(g): i for i, g in enumerate(ids)}
        flat = [x for t in triangles for x in (3, *(position[int(v)] for v in t))]
        return fcl.Convex(self.mesh[ids], int(faces), np.array(flat))

    def answer(self, library):
        """Signed distance, witness points and normal by one library, and its time in s."""
        if library == "dashpot":
            start = time.perf_counter()
            found = dashpot.distance(self.model, self.data, *self.ids)
            spent = time.perf_counter() - start
            return found.distance, found.point1, found.point2, found.normal, spent
        if library == "mujoco":
            segment = np.zeros(6)
            start = time.perf_counter()
            value = mujoco.mj_geomDistance(self.model, self.data, *self.ids, 10.0, segment)
            spent = time.perf_counter() - start
            point1, point2 = segment[:3], segment[3:]
        else:
            request = fcl.DistanceRequest(enable_nearest_points=True, enable_signed_distance=True)
            result = fcl.DistanceResult()
            start = time.perf_counter()
            value = fcl.distance(*self.objects, request, result)
            spent = time.perf_counter() - start
            point1, point2 = result.nearest_points
        apart = np.subtract(point2, point1)
        length = np.linalg.norm(apart)
        normal = np.sign(value) * apart / length if length > 0 else np.array((0.0, 0.0, 1.0))
        return value, point1, point2, normal, spent


def measure(pair, count, rng, peers):
    """Worst error (m), number of wrong answers and median time (s) by library; worst of search."""
    libraries = ["dashpot", *(peer for peer in peers if peer != "python-fcl" or pair.fcl)]
    answers = {library: [] for library in libraries}
    for trial in range(count):
        pair.place(trial)
        for library in libraries:
            answers[library].append(pair.answer(library))
    columns = {
        library: [np.array(c) for c in zip(*answers[library], strict=True)] for library in libraries
    }
    shape1, shape2 = pair.shapes
    value, point1, point2, normal, _ = columns["dashpot"]
    relative = 1e-3 if CURVED & set(pair.kinds) else 1e-4
    tolerance = 1e-6 + relative * np.abs(value)
    if shape1.kind == "hfield":
        alone, reference = search_field(shape1, shape2, value, normal, tolerance, rng)
        along = reference  # the normal takes part in it, prism by prism
    else:
        proposed = unit(np.stack([columns[library][3] for library in libraries], axis=1))
        bounds = gaps(shape1, shape2, proposed)
        along = bounds[:, 0]
        if shape1.kind == "plane":
            alone = gaps(shape1, shape2, shape1.rotation[:, None, :, 2])[:, 0]
        else:
            alone = search(shape1, shape2, rng)
            stalled = np.nonzero((alone < bounds.max(axis=1) - 0.5 * tolerance) & (value < 0.0))[0]
            if len(stalled):
                again = search(shape1[stalled], shape2[stalled], rng, 4 * STARTS, 2 * SAMPLES)
                alone[stalled] = np.maximum(alone[stalled], again)
        reference = np.maximum(alone, bounds.max(axis=1))
    results = {}
    tolerance = 1e-6 + relative * np.abs(reference)
    for library in libraries:
        error = np.abs(columns[library][0] - reference)
        wrong = ~(error <= tolerance)  # NaN is wrong
        if library == "dashpot":
            wrong |= np.abs(along - reference) > tolerance
            for shape, point in ((shape1, point1), (shape2, point2)):
                # In overlap, witnesses are off by what the polytope's bounds leave.
                wrong |= shape.outside(point) > tolerance + 1e-5 * (reference < 0)
            misfit = np.linalg.norm(point2 - point1 - value[:, None] * normal, axis=1)
            wrong |= misfit > tolerance + 1e-5 * (reference < 0)
        results[library] = (error.max(), int(wrong.sum()), np.median(columns[library][4]))
        if library == "dashpot" and wrong.any():
            first = int(np.argmax(wrong))
            print(f"# wrong: configuration {first}, {value[first]} for {reference[first]}")
    return results, float((reference - alone)[reference < 0].max(initial=0.0))


def all_pairs():
    pairs = [("plane", kind) for kind in (*KINDS, "hfield")]
    pairs += itertools.combinations_with_replacement(KINDS, 2)
    return pairs + [("hfield", kind) for kind in KINDS]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", "--count", type=int, default=1000, help="configurations a pair")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pair", nargs=2, metavar=("KIND1", "KIND2"), help="only this pair")
    arguments = parser.parse_args()
    peers = ["mujoco"] + (["python-fcl"] if fcl else [])
    columns = ["dashpot", *peers]
    print("| pair | " + " | ".join(f"{c} worst m, wrong, time" for c in columns) + " | search m |")
    print("|---" * (len(columns) + 2) + "|")
    for kind1, kind2 in [tuple(arguments.pair)] if arguments.pair else all_pairs():
        rng = np.random.default_rng(arguments.seed)
        pair = Pair(make_model(), kind1, kind2, arguments.count, rng)
        results, alone = measure(pair, arguments.count, rng, peers)
        cells = [
            f"{r[0]:.0e}, {r[1]}, {1e6 * r[2]:.1f} us" if r else "-"
            for r in map(results.get, columns)
        ]
        print(f"| {kind1}, {kind2} | " + " | ".join(cells) + f" | {alone:.0e} |", flush=True)


if __name__ == "__main__":
    main()
