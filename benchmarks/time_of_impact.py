"""Time of impact against dense sampling and bisection of independent gaps.

    python benchmarks/time_of_impact.py            # 1,000 cases of each kind, a few minutes
    python benchmarks/time_of_impact.py -n 100

Cases: a ball at 100 m/s against a plate of 1 mm, a spinning box above the ground, two tumbling
boxes, a tumbling mesh against a tumbling capsule, a tumbling box above a height field of 6 x 5
points; sizes, poses, velocities, spins and heights drawn anew.

Reference: the gap of the two as a function of time, from closed forms that share nothing with
dashpot: distance of a point from a box; height of the lowest corner; the largest gap along the 15
separating axes of two boxes; distances of the capsule's segment from the faces and edges of the
hull; the least over all prisms of the largest gap along their separating axes from the box. It is
sampled at 2,000 times (mesh and height field: 600), every local minimum before the first contact is
sampled again down to 1e-9 of the horizon, and the first zero is narrowed to rounding.

A contact is missed where the reference finds one deeper than 1e-9 m and the query none; it is
false where the query finds one and the gap stays above the clearance that counts as contact, 1e-9
of the size. `late` counts times after the first contact by more than 1e-12 of the horizon. The
error is how early a time is, as a part of the horizon.
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

CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
CLEARANCE = 1e-9  # m, of shapes whose sizes add up to less than 1 m


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


class Motion:
    """Poses of a geom whose body keeps its velocities."""

    def __init__(self, model, data, name):
        geom = model.geom(name).id
        body = model.geom_bodyid[geom]
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, velocity, 0)
        self.angular, self.linear = velocity[:3], velocity[3:]
        self.centre = data.xipos[body].copy()
        self.position = data.geom_xpos[geom].copy()
        self.rotation = data.geom_xmat[geom].reshape(3, 3).copy()
        self.size = model.geom_size[geom].copy()

    def at(self, times):
        """Positions (t, 3) and rotations (t, 3, 3)."""
        turns = Rotation.from_rotvec(np.multiply.outer(times, self.angular)).as_matrix()
        moved = self.centre + np.multiply.outer(times, self.linear)
        return moved + turns @ (self.position - self.centre), turns @ self.rotation


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


def scene(bodies):
    vertices = unit(np.random.default_rng(7).normal(size=(30, 3))) * (0.1, 0.07, 0.05)
    text = " ".join(f"{x:.9g}" for x in vertices.ravel())
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="hull" vertex="{text}"/></asset>'
        f"<worldbody>{bodies}</worldbody></mujoco>"
    )


def free(name, shape):
    return f'<body name="{name}"><freejoint/><geom name="{name}" {shape}/></body>'


def launch(model, data, name, position, rotation, linear, angular):
    """Set the free body of that name: pose, and velocities in the world."""
    joint = model.body(name).jntadr[0]
    at, dof = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
    data.qpos[at : at + 3] = position
    data.qpos[at + 3 : at + 7] = np.roll(rotation.as_quat(), 1)
    data.qvel[dof : dof + 3] = linear
    data.qvel[dof + 3 : dof + 6] = rotation.inv().apply(angular)


def ball_against_plate(rng):
    radius = rng.uniform(0.002, 0.02)
    model = scene(
        free("a", f'type="sphere" size="{radius}" mass="1"')
        + free("b", 'type="box" size="0.2 0.2 0.0005" mass="1"')
    )
    data = mujoco.MjData(model)
    turn = Rotation.random(random_state=rng)
    aim = turn.apply(np.append(rng.uniform(-0.22, 0.22, size=2), 0.0))
    velocity = 100.0 * unit(rng.normal(size=3))
    start = aim - velocity * rng.uniform(0.002, 0.008)
    launch(model, data, "a", start, Rotation.identity(), velocity, rng.normal(size=3) * 100)
    launch(model, data, "b", (0, 0, 0), turn, (0, 0, 0), (0, 0, 0))
    return model, data, 0.01, ball_and_box, 2000


def box_above_ground(rng):
    size = " ".join(map(str, rng.uniform(0.03, 0.2, size=3)))
    model = scene(
        '<geom name="b" type="plane" size="1 1 1"/>' + free("a", f'type="box" size="{size}"')
    )
    data = mujoco.MjData(model)
    velocity = np.append(rng.normal(size=2), rng.uniform(-6, 0.5))
    launch(
        model,
        data,
        "a",
        (0, 0, rng.uniform(0.36, 0.9)),
        Rotation.random(random_state=rng),
        velocity,
        rng.normal(size=3) * 20,
    )
    return model, data, 0.2, box_and_ground, 2000


def tumble(model, rng, names):
    data = mujoco.MjData(model)
    for name, side in zip(names, (-0.3, 0.3), strict=True):
        position = np.array((side, 0, 0)) + rng.normal(size=3) * 0.05
        linear = np.array((-20 * side, 0, 0)) + rng.normal(size=3)
        launch(
            model,
            data,
            name,
            position,
            Rotation.random(random_state=rng),
            linear,
            rng.normal(size=3) * 30,
        )
    return data


def tumbling_boxes(rng):
    sizes = [" ".join(map(str, rng.uniform(0.03, 0.13, size=3))) for _ in range(2)]
    model = scene(
        "".join(free(n, f'type="box" size="{s}"') for n, s in zip("ab", sizes, strict=True))
    )
    return model, tumble(model, rng, "ab"), 0.06, two_boxes, 2000


def mesh_against_capsule(rng):
    size = f"{rng.uniform(0.02, 0.08)} {rng.uniform(0.03, 0.12)}"
    model = scene(free("a", 'type="mesh" mesh="hull"') + free("b", f'type="capsule" size="{size}"'))
    gap = hull_and_capsule(model.mesh_vert.astype(float))
    return model, tumble(model, rng, "ab"), 0.06, gap, 600


def box_above_hills(rng):
    rows, columns = 6, 5
    half_x, half_y, elevation, base = 0.3, 0.4, 0.15, 0.05
    size = " ".join(map(str, rng.uniform(0.02, 0.1, size=3)))
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><hfield name="hills" nrow="{rows}" ncol="{columns}"
        size="{half_x} {half_y} {elevation} {base}"/></asset><worldbody>
        <geom name="b" type="hfield" hfield="hills" euler="10 -20 30"/>
        {free("a", f'type="box" size="{size}"')}</worldbody></mujoco>"""
    )
    model.hfield_data[:] = rng.random(rows * columns)
    data = mujoco.MjData(model)
    start = np.append(rng.uniform(-0.4, 0.4, size=2), rng.uniform(0.35, 0.5))
    velocity = np.append(rng.normal(size=2), rng.uniform(-12, -2))
    turn = Rotation.random(random_state=rng)
    launch(model, data, "a", start, turn, velocity, rng.normal(size=3) * 30)
    mujoco.mj_forward(model, data)

    x, y = np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows)
    z = elevation * model.hfield_data.astype(float).reshape(rows, columns)
    prisms = []
    for r, c in itertools.product(range(rows - 1), range(columns - 1)):
        for middle in ((r, c + 1), (r + 1, c)):
            top = [(x[j], y[i], z[i, j]) for i, j in ((r, c), middle, (r + 1, c + 1))]
            prisms.append([*top, *((a, b, -base) for a, b, _ in top)])
    world = np.array(prisms) @ data.geom("b").xmat.reshape(3, 3).T + data.geom("b").xpos
    return model, data, 0.06, box_and_prisms(world), 600


CASES = {
    "ball at 100 m/s, plate of 1 mm": ball_against_plate,
    "spinning box, ground": box_above_ground,
    "two tumbling boxes": tumbling_boxes,
    "tumbling mesh, tumbling capsule": mesh_against_capsule,
    "tumbling box, height field": box_above_hills,
}


def measure(make, count, seed):
    """Numbers of contacts and of missed, false and late ones; errors; times of a call in s."""
    rng = np.random.default_rng(seed)
    number = dict.fromkeys(("contacts", "missed", "false", "late"), 0)
    errors, spent = [], []
    for _ in range(count):
        model, data, horizon, gap_of, samples = make(rng)
        mujoco.mj_forward(model, data)
        gap = gap_of(Motion(model, data, "a"), Motion(model, data, "b"))
        if gap(np.zeros(1))[0] <= 0.0:
            expected, least = 0.0, -np.inf
        else:
            expected, least = first_contact(gap, horizon, samples)
        start = time.perf_counter()
        found = dashpot.time_of_impact(model, data, "a", "b", horizon=horizon)
        spent.append(time.perf_counter() - start)
        touches = expected <= horizon
        number["contacts"] += touches
        if touches and not found.hit:
            number["missed"] += least < -CLEARANCE
        elif found.hit and not touches:
            number["false"] += least > CLEARANCE
        elif found.hit:
            errors.append((expected - found.time) / horizon)
            number["late"] += errors[-1] < -1e-12
    return number, errors, spent


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", "--count", type=int, default=1000, help="cases of each kind")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print("| case | contacts | missed | false | late | median error | worst error | median time |")
    print("|---|---|---|---|---|---|---|---|")
    for label, make in CASES.items():
        number, errors, spent = measure(make, arguments.count, arguments.seed)
        print(
            f"| {label} | {number['contacts']} of {arguments.count} | {number['missed']} "
            f"| {number['false']} | {number['late']} | {np.median(errors):.0e} "
            f"| {max(errors):.0e} | {1e6 * np.median(spent):.0f} us |",
            flush=True,
        )


if __name__ == "__main__":
    main()
