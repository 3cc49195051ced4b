"""Signed distance for every pair of geom types: error and time beside MuJoCo and python-fcl.

    python benchmarks/query_accuracy.py            # 1,000 random configurations a pair
    python benchmarks/query_accuracy.py -n 10000
    python benchmarks/query_accuracy.py --pair hfield box

Two geoms of about 0.1 m, their sizes drawn anew (each between 0.4 and 2.5 times) and their poses
too, overlapping and apart; a height field of 6 x 5 points gets new heights.

Reference: the largest gap along a direction that `support_search` finds. Then the directions that
the libraries propose join in: each is a proven bound as well. Where shapes are apart, dashpot's
witness points are a bound from above once they are seen to lie in the shapes.

An answer is wrong where it is off by more than 1e-6 m + 1e-4 of the distance, or 1e-3 of it where
a curved core (cylinder, ellipsoid) takes part; dashpot's also where the gap along its normal is,
where a witness point is that far outside its shape, or where the two points do not differ by
distance times normal. `search` is how far the search alone ends below the reference, at worst, in
overlap, where nothing else proves that no direction is shorter (after eight times the samples where
it stalls).
python-fcl takes part where it is installed. MuJoCo takes part as shipped, and with a tolerance of
1e-10 and 200 iterations.
"""

from __future__ import annotations

import argparse
import itertools
import time

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import dashpot
from query_geoms import CONVEX, SIZE, hull_mesh, hull_points, two_of_each, unit
from support_search import (
    FIELD_COLUMNS,
    FIELD_ROWS,
    FIELD_SIZE,
    SAMPLES,
    STARTS,
    Shapes,
    gaps,
    search,
    search_field,
)

try:
    import fcl
except ImportError:
    fcl = None

CURVED = {"cylinder", "ellipsoid"}
# Options of MuJoCo's model.
MUJOCO = {"mujoco": {}, "mujoco fine": {"ccd_tolerance": 1e-10, "ccd_iterations": 200}}


def make_model():
    """Two free bodies of each convex type, a plane and a height field."""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset>{hull_mesh(hull_points())}
        <hfield name="hills" nrow="{FIELD_ROWS}" ncol="{FIELD_COLUMNS}"
         size="{" ".join(map(str, FIELD_SIZE))}"/></asset><worldbody>
        <geom name="plane1" type="plane" size="1 1 1"/>
        <geom name="hfield1" type="hfield" hfield="hills"/>{two_of_each()}</worldbody></mujoco>"""
    )


class Pair:
    """Two geoms in the hands of the three libraries, in `count` random configurations."""

    def __init__(self, model, kind1, kind2, count, rng):
        self.model, self.data = model, mujoco.MjData(model)
        self.shipped = model.opt.ccd_tolerance, model.opt.ccd_iterations
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
        if library in MUJOCO:
            option = self.model.opt
            option.ccd_tolerance, option.ccd_iterations = self.shipped
            for name, value in MUJOCO[library].items():
                setattr(option, name, value)
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
    pairs = [("plane", kind) for kind in (*CONVEX, "hfield")]
    pairs += itertools.combinations_with_replacement(CONVEX, 2)
    return pairs + [("hfield", kind) for kind in CONVEX]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", "--count", type=int, default=1000, help="configurations a pair")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pair", nargs=2, metavar=("KIND1", "KIND2"), help="only this pair")
    arguments = parser.parse_args()
    peers = [*MUJOCO, *(["python-fcl"] if fcl else [])]
    columns = ["dashpot", *peers]
    print("| pair | " + " | ".join(f"{c} worst m, wrong, time" for c in columns) + " | search m |")
    print("|---" * (len(columns) + 2) + "|")
    wrong = dict.fromkeys(columns, 0)
    for kind1, kind2 in [tuple(arguments.pair)] if arguments.pair else all_pairs():
        rng = np.random.default_rng(arguments.seed)
        pair = Pair(make_model(), kind1, kind2, arguments.count, rng)
        results, alone = measure(pair, arguments.count, rng, peers)
        cells = [
            f"{r[0]:.0e}, {r[1]}, {1e6 * r[2]:.1f} us" if r else "-"
            for r in map(results.get, columns)
        ]
        print(f"| {kind1}, {kind2} | " + " | ".join(cells) + f" | {alone:.0e} |", flush=True)
        for library, found in results.items():
            wrong[library] += found[1]
    print("wrong: " + ", ".join(f"{library} {count}" for library, count in wrong.items()))


if __name__ == "__main__":
    main()
