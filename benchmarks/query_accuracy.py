"""Signed distance for every pair of geom types: error and time beside MuJoCo and python-fcl.

    python benchmarks/query_accuracy.py            # 1,000 random poses a pair, about a minute
    python benchmarks/query_accuracy.py -n 10000

Reference: along a unit direction n from one convex shape to the other, the gap
``s(n) = min n.b - max n.a`` is a lower bound of the signed distance, and the signed distance is the
largest of them. The reference is the largest ``s(n)`` over the directions that all libraries
propose and 200 random ones.

An answer is wrong where it is off by more than 1e-6 m + 1e-4 of the distance, or 1e-3 of it where
a curved core (cylinder, ellipsoid) takes part. python-fcl takes part where it is installed.
"""

from __future__ import annotations

import argparse
import itertools
import time

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import dashpot

try:
    import fcl
except ImportError:
    fcl = None

KINDS = ("sphere", "capsule", "cylinder", "ellipsoid", "box", "mesh")
CURVED = {"cylinder", "ellipsoid"}
SIZE = {
    "sphere": (0.08,),
    "capsule": (0.05, 0.1),
    "cylinder": (0.07, 0.09),
    "ellipsoid": (0.1, 0.06, 0.04),
    "box": (0.09, 0.05, 0.07),
}


def make_model():
    """Two free bodies of each type, and a plane."""
    points = np.random.default_rng(7).normal(size=(30, 3))
    points *= np.array((0.1, 0.07, 0.05)) / np.linalg.norm(points, axis=1, keepdims=True)
    vertices = " ".join(f"{x:.9g}" for x in points.ravel())
    bodies = ""
    for copy, kind in itertools.product("12", KINDS):
        size = " ".join(map(str, SIZE.get(kind, ())))
        shape = 'type="mesh" mesh="hull"' if kind == "mesh" else f'type="{kind}" size="{size}"'
        bodies += f'<body><freejoint/><geom name="{kind}{copy}" {shape}/></body>'
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><mesh name="hull" vertex="{vertices}"/></asset><worldbody>
        <geom name="plane" type="plane" size="1 1 1"/>{bodies}</worldbody></mujoco>"""
    )


def supports(kind, size, vertices, position, rotation, directions):
    """Furthest points (n, 3) of a shape along unit directions (n, 3)."""
    d = directions @ rotation
    if kind == "sphere":
        local = size[0] * d
    elif kind == "capsule":
        local = size[0] * d
        local[:, 2] += np.copysign(size[1], d[:, 2])
    elif kind == "cylinder":
        radial = np.maximum(np.hypot(d[:, 0], d[:, 1]), 1e-300)
        local = np.stack(
            (size[0] * d[:, 0] / radial, size[0] * d[:, 1] / radial, np.copysign(size[1], d[:, 2])),
            axis=1,
        )
    elif kind == "ellipsoid":
        local = size**2 * d / np.linalg.norm(size * d, axis=1, keepdims=True)
    elif kind == "box":
        local = np.copysign(size, d)
    else:
        local = vertices[np.argmax(d @ vertices.T, axis=1)]
    return position + local @ rotation.T


class Pair:
    """Two geoms in the hands of the three libraries."""

    def __init__(self, model, kind1, kind2):
        self.model, self.data = model, mujoco.MjData(model)
        mujoco.mj_forward(model, self.data)
        self.kinds = (kind1, kind2)
        names = ("plane" if kind1 == "plane" else kind1 + "1", kind2 + "2")
        self.ids = [model.geom(name).id for name in names]
        self.vertices = model.mesh_vert.astype(float)
        self.fcl = None
        if fcl is not None and kind1 != "plane":  # its plane crashes
            self.fcl = [self.fcl_object(kind, model.geom_size[i]) for kind, i in self.geoms()]

    def geoms(self):
        """Kinds and ids of the two geoms."""
        return zip(self.kinds, self.ids, strict=True)

    def fcl_object(self, kind, size):
        """Make python-fcl's object of a shape; a mesh is its hull, from MuJoCo's hull graph."""
        if kind == "sphere":
            shape = fcl.Sphere(size[0])
        elif kind == "capsule":
            shape = fcl.Capsule(size[0], 2 * size[1])
        elif kind == "cylinder":
            shape = fcl.Cylinder(size[0], 2 * size[1])
        elif kind == "ellipsoid":
            shape = fcl.Ellipsoid(*size)
        elif kind == "box":
            shape = fcl.Box(*(2 * size))
        else:
            graph = self.model.mesh_graph
            count, faces = graph[0], graph[1]
            ids = graph[2 + count : 2 + 2 * count]
            triangles = graph[2 + 3 * count + 3 * faces :][: 3 * faces].reshape(-1, 3)
            position = {int(g): i for i, g in enumerate(ids)}
            flat = [x for t in triangles for x in (3, *(position[int(v)] for v in t))]
            shape = fcl.Convex(self.vertices[ids], int(faces), np.array(flat))
        return fcl.CollisionObject(shape)

    def place(self, index, position, rotation):
        """Put one of the two at a pose, in every library."""
        geom = self.ids[index]
        self.data.geom_xpos[geom] = position
        self.data.geom_xmat[geom] = rotation.ravel()
        if self.fcl:
            self.fcl[index].setTransform(fcl.Transform(rotation, position))

    def gaps(self, directions):
        """s(n) of unit directions (n, 3)."""
        poses = [
            (self.data.geom_xpos[i], self.data.geom_xmat[i].reshape(3, 3), self.model.geom_size[i])
            for i in self.ids
        ]
        second = supports(
            self.kinds[1], poses[1][2], self.vertices, poses[1][0], poses[1][1], -directions
        )
        if self.kinds[0] == "plane":
            up = poses[0][1][:, 2]
            heights = (second - poses[0][0]) @ up
            return np.where(directions @ up > 1 - 1e-12, heights, -np.inf)
        first = supports(
            self.kinds[0], poses[0][2], self.vertices, poses[0][0], poses[0][1], directions
        )
        return np.einsum("ij,ij->i", second - first, directions)

    def answer(self, library):
        """Signed distance and direction by one library, and the time of its call in s."""
        if library == "dashpot":
            start = time.perf_counter()
            found = dashpot.distance(self.model, self.data, *self.ids)
            spent = time.perf_counter() - start
            return found.distance, found.normal, spent
        if library == "mujoco":
            segment = np.zeros(6)
            start = time.perf_counter()
            value = mujoco.mj_geomDistance(self.model, self.data, *self.ids, 10.0, segment)
            spent = time.perf_counter() - start
            apart = segment[3:] - segment[:3]
        else:
            request = fcl.DistanceRequest(enable_nearest_points=True, enable_signed_distance=True)
            result = fcl.DistanceResult()
            start = time.perf_counter()
            value = fcl.distance(*self.fcl, request, result)
            spent = time.perf_counter() - start
            apart = result.nearest_points[1] - result.nearest_points[0]
        length = np.linalg.norm(apart)
        normal = np.sign(value) * apart / length if length > 0 else np.zeros(3)
        return value, normal, spent


def measure(pair, count, rng):
    """Worst error (m), share of wrong answers and median time (s) of each library."""
    libraries = ["dashpot", "mujoco"] + (["python-fcl"] if pair.fcl else [])
    error = {library: [] for library in libraries}
    spent = {library: [] for library in libraries}
    wrong = dict.fromkeys(libraries, 0)
    relative = 1e-3 if CURVED & set(pair.kinds) else 1e-4
    for trial in range(count):
        spread = (0.02, 0.06, 0.15)[trial % 3]
        for index in (0, 1):
            turn = Rotation.random(random_state=rng).as_matrix()
            pair.place(index, rng.normal(size=3) * spread, turn)
        answers = {library: pair.answer(library) for library in libraries}
        directions = rng.normal(size=(200, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        proposed = [n for _, n, _ in answers.values() if abs(np.linalg.norm(n) - 1) < 1e-6]
        reference = pair.gaps(np.concatenate((proposed, directions))).max()
        for library, (value, _, seconds) in answers.items():
            off = abs(value - reference)
            error[library].append(off)
            spent[library].append(seconds)
            wrong[library] += off > 1e-6 + relative * abs(reference)
    return {
        library: (max(error[library]), wrong[library] / count, np.median(spent[library]))
        for library in libraries
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", "--count", type=int, default=1000, help="random poses a pair")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    model = make_model()
    peers = ["dashpot", "mujoco"] + (["python-fcl"] if fcl else [])
    print("| pair | " + " | ".join(f"{p} worst m, wrong, time" for p in peers) + " |")
    print("|---" * (len(peers) + 1) + "|")
    pairs = [("plane", kind) for kind in KINDS]
    pairs += itertools.combinations_with_replacement(KINDS, 2)
    for kind1, kind2 in pairs:
        rng = np.random.default_rng(arguments.seed)
        results = measure(Pair(model, kind1, kind2), arguments.count, rng)
        cells = [
            f"{r[0]:.0e}, {r[1]:.1%}, {1e6 * r[2]:.1f} us" if r else "-"
            for r in map(results.get, peers)
        ]
        print(f"| {kind1}, {kind2} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
