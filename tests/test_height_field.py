"""Height fields in contact queries, against closed forms and brute force over all prisms."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import dashpot
from dashpot.query import closest, distance, time_of_impact

ROWS, COLUMNS = 7, 5
HALF_X, HALF_Y, ELEVATION, BASE = 0.3, 0.5, 0.2, 0.1
SIZE = {
    "sphere": (0.05,),
    "capsule": (0.03, 0.08),
    "cylinder": (0.05, 0.06),
    "ellipsoid": (0.09, 0.05, 0.03),
    "box": (0.08, 0.04, 0.05),
}
CONVEX = (*SIZE, "mesh")
# Rounding of positions below 1 m through a few hundred operations.
ROUNDING = 1e-13
# Heights are single precision in the model; references use the same rounded heights.


def hull_points():
    points = np.random.default_rng(7).normal(size=(20, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * (0.08, 0.06, 0.05)


def make_model(heights, *, moving=False, pose='pos=".1 -.2 .3" euler="10 -20 30"'):
    """Make a height field, and one free body of each convex type with a geom of that name."""
    heights = np.asarray(heights)
    rows, columns = heights.shape
    vertices = " ".join(f"{x:.9g}" for x in hull_points().ravel())
    bodies = ""
    for kind in CONVEX:
        size = " ".join(map(str, SIZE.get(kind, ())))
        shape = 'type="mesh" mesh="hull"' if kind == "mesh" else f'type="{kind}" size="{size}"'
        bodies += (
            f'<body name="{kind}" pos="0 0 9"><freejoint/><geom name="{kind}" {shape}/></body>'
        )
    hills = '<geom name="hills" type="hfield" hfield="hills" density="100" {}/>'
    world = (
        f'<body name="hills"><freejoint/>{hills.format("")}</body>'
        if moving
        else hills.format(pose)
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0"/><asset><mesh name="hull" vertex="{vertices}"/>
        <hfield name="hills" nrow="{rows}" ncol="{columns}"
         size="{HALF_X} {HALF_Y} {ELEVATION} {BASE}"/></asset>
        <worldbody>{world}{bodies}</worldbody></mujoco>"""
    )
    model.hfield_data[:] = heights.ravel()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def rough(seed=0):
    return np.random.default_rng(seed).random((ROWS, COLUMNS))


def prisms(model, data):
    """Corners (6, 3) in the world of every prism, from the definition of the height field."""
    rows, columns = model.hfield_nrow[0], model.hfield_ncol[0]
    half_x, half_y, elevation, base = model.hfield_size[0]
    x, y = np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows)
    z = elevation * model.hfield_data.astype(float).reshape(rows, columns)
    pose = data.geom("hills")
    found = []
    for r, c in itertools.product(range(rows - 1), range(columns - 1)):
        for middle in ((r, c + 1), (r + 1, c)):
            top = [(x[j], y[i], z[i, j]) for i, j in ((r, c), middle, (r + 1, c + 1))]
            corners = np.array([*top, *((a, b, -base) for a, b, _ in top)])
            found.append(pose.xpos + corners @ pose.xmat.reshape(3, 3).T)
    return found


def place(model, data, name, position, rotation):
    """Put a geom at a pose in the frame of the height field."""
    hills = data.geom("hills")
    frame = hills.xmat.reshape(3, 3)
    index = model.geom(name).id
    data.geom_xpos[index] = hills.xpos + frame @ position
    data.geom_xmat[index] = (frame @ rotation).ravel()


def random_place(model, data, rng, name, spread=0.2):
    position = rng.normal(size=3) * spread + (0, 0, 0.15)
    place(model, data, name, position, Rotation.random(random_state=rng).as_matrix())


def core(model, data, kind):
    """Corners (n, 3) of a polytope's core in the world, and the radius that sweeps it."""
    size = SIZE.get(kind)
    if kind == "sphere":
        local, radius = np.zeros((1, 3)), size[0]
    elif kind == "capsule":
        local, radius = np.array([(0, 0, -size[1]), (0, 0, size[1])]), size[0]
    elif kind == "box":
        local, radius = np.array(list(itertools.product((-1, 1), repeat=3))) * size, 0.0
    else:
        local, radius = model.mesh_vert.astype(float), 0.0
    pose = data.geom(kind)
    return pose.xpos + local @ pose.xmat.reshape(3, 3).T, radius


def support(model, data, kind, direction):
    """Furthest point of a convex geom along a unit direction."""
    pose = data.geom(kind)
    rotation, size = pose.xmat.reshape(3, 3), np.array(SIZE.get(kind, ()))
    d = rotation.T @ direction
    if kind == "cylinder":
        local = np.append(size[0] * d[:2] / np.hypot(*d[:2]), np.copysign(size[1], d[2]))
    elif kind == "ellipsoid":
        local = size**2 * d / np.linalg.norm(size * d)
    else:
        corners, radius = core(model, data, kind)
        return corners[np.argmax(corners @ direction)] + radius * direction
    return pose.xpos + rotation @ local


def convex_distance(points):
    """Signed distance of the origin from the convex hull of points (n, 3).

    Outside: the least norm of convex combinations, by non-negative least squares with the sum of
    the weights held at one by a heavy row. Inside: the nearest facet, by Qhull.
    """
    heavy = 1e3
    system = np.vstack((points.T, np.full(len(points), heavy)))
    weights, _ = nnls(system, np.array((0, 0, 0, heavy)))
    outside = np.linalg.norm(weights @ points) / weights.sum()
    # The heavy row leaves 1e-6 of the size where the origin is inside.
    return outside if outside > 1e-5 else ConvexHull(points).equations[:, 3].max()


def test_surface_is_that_of_mujocos_rays():
    """The heights that vertical rays hit are those at which small balls touch."""
    model, data = make_model(rough(), pose="")
    rng = np.random.default_rng(1)
    for _ in range(200):
        x, y = rng.uniform(-HALF_X, HALF_X), rng.uniform(-HALF_Y, HALF_Y)
        drop = mujoco.mj_rayHfield(
            model, data, 0, np.array((x, y, 1.0)), np.array((0.0, 0.0, -1.0)), None
        )
        surface = 1.0 - drop
        # The cone of slopes of the field bounds how far the nearest point is from below.
        for above in (0.0, 1e-3):
            place(model, data, "sphere", (x, y, surface + above), np.eye(3))
            near = distance(model, data, "hills", "sphere").distance + SIZE["sphere"][0]
            # MuJoCo's rays compute in single precision here and there.
            assert near <= above + 1e-7
            assert near >= -1e-7 if above == 0.0 else near > 0.0


def test_flat_field_is_a_box():
    """Apart from it, and in shallow overlap through its top, a flat field is a box."""
    model, data = make_model(np.full((ROWS, COLUMNS), 0.5))
    top = 0.5 * ELEVATION
    rng = np.random.default_rng(2)
    for _ in range(200):
        point = rng.uniform(-1, 1, size=3)
        place(model, data, "sphere", point, np.eye(3))
        outside = np.maximum(np.abs(point[:2]) - (HALF_X, HALF_Y), 0.0)
        above = max(point[2] - top, -BASE - point[2], 0.0)
        gap = np.hypot(np.linalg.norm(outside), above)
        if gap > 0.0:
            found = distance(model, data, "hills", "sphere")
            assert found.distance == pytest.approx(gap - SIZE["sphere"][0], abs=ROUNDING)
    for depth in (1e-9, 1e-4, 0.02):
        # Resting on a face: the deepest prisms are those wholly beneath it.
        place(model, data, "box", (0.01, 0.02, top + 0.05 - depth), np.eye(3))
        found = distance(model, data, "hills", "box")
        assert found.distance == pytest.approx(-depth, abs=ROUNDING)
        up = data.geom("hills").xmat.reshape(3, 3)[:, 2]
        np.testing.assert_allclose(found.normal, up, atol=1e-9)


@pytest.mark.parametrize("kind", CONVEX)
def test_aligned_with_a_flat_field(kind, capfd):
    """Above corners, edges and diagonals of cells, just apart, touching and just overlapping."""
    model, data = make_model(np.full((ROWS, COLUMNS), 0.5), pose="")
    top = 0.5 * ELEVATION
    x, y = 2 * HALF_X / (COLUMNS - 1), 2 * HALF_Y / (ROWS - 1)
    turns = [Rotation.identity(), Rotation.from_euler("xyz", (90, 0, 45), degrees=True)]
    for turn, at in itertools.product(turns, ((0, 0), (0, 0.5 * y), (0.5 * x, 0), (x / 2, y / 2))):
        place(model, data, kind, (*at, 0), turn.as_matrix())
        lowest = support(model, data, kind, np.array((0, 1e-300, -1.0)))[2]
        for gap in (1.0, 1e-3, 1e-9, 1e-15, 0.0, -1e-15, -1e-9, -1e-5, -1e-3):
            place(model, data, kind, (*at, top + gap - lowest), turn.as_matrix())
            found = distance(model, data, "hills", kind)
            # Curved overlaps: to 1e-10 of the size of the pair.
            assert found.distance == pytest.approx(gap, abs=1e-10)
            if abs(gap) > 1e-5:
                np.testing.assert_allclose(found.normal, (0, 0, 1), atol=1e-4)
    captured = capfd.readouterr()
    assert (captured.out, captured.err) == ("", "")


@pytest.mark.parametrize("kind", ["sphere", "capsule", "box", "mesh"])
def test_polytopes_against_all_prisms(kind):
    """The least signed distance over every prism, each by least squares or Qhull."""
    model, data = make_model(rough())
    solids = prisms(model, data)
    rng = np.random.default_rng(CONVEX.index(kind))
    deep = 0
    for _ in range(25):
        random_place(model, data, rng, kind)
        corners, radius = core(model, data, kind)
        nearest = min(convex_distance((corners[:, None] - p[None]).reshape(-1, 3)) for p in solids)
        found = distance(model, data, "hills", kind)
        deep += nearest < 0.0
        # Least squares and Qhull leave 1e-9 of sizes below 1 m.
        assert found.distance == pytest.approx(nearest - radius, abs=1e-8)
        np.testing.assert_allclose(
            found.point2 - found.point1, found.distance * found.normal, atol=1e-9
        )
    assert deep > 2


@pytest.mark.parametrize("kind", CONVEX[1:])
def test_bounds_prove_the_distance(kind):
    """Points of both solids bound it from above, a separating direction per prism from below."""
    model, data = make_model(rough(3))
    solids = prisms(model, data)
    hills = data.geom("hills")
    frame = hills.xmat.reshape(3, 3)
    rng = np.random.default_rng([9, CONVEX.index(kind)])
    signs = set()
    for _ in range(40):
        random_place(model, data, rng, kind)
        found = distance(model, data, "hills", kind)
        signs.add(found.distance > 0)
        opposite = distance(model, data, kind, "hills")
        assert opposite.distance == found.distance
        np.testing.assert_array_equal(opposite.normal, -found.normal)
        # Along the normal, the gap to the prism that holds point1 is the distance.
        gaps = [
            found.normal @ support(model, data, kind, -found.normal) - (p @ found.normal).max()
            for p in solids
        ]
        # Curved overlaps: to 1e-10 of the size of the pair.
        assert min(abs(np.array(gaps) - found.distance)) < 1e-9
        if found.distance <= 0.0:
            continue
        local = frame.T @ (found.point1 - hills.xpos)
        assert (np.abs(local) <= (HALF_X + 1e-9, HALF_Y + 1e-9, ELEVATION + 1e-9)).all()
        # No point of the geom's surface is nearer to the field: sampled points.
        for direction in rng.normal(size=(40, 3)):
            point = support(model, data, kind, direction / np.linalg.norm(direction))
            place(model, data, "sphere", frame.T @ (point - hills.xpos), np.eye(3))
            near = distance(model, data, "hills", "sphere").distance + SIZE["sphere"][0]
            assert near >= found.distance - 1e-9
    assert signs == {True, False}


def test_plane_under_a_height_field():
    """The lowest corner decides; the surface counts where the field is upside down."""
    heights = rough()
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><hfield name="hills" nrow="{ROWS}" ncol="{COLUMNS}"
        size="{HALF_X} {HALF_Y} {ELEVATION} {BASE}"/></asset>
        <worldbody><geom name="floor" type="plane" size="1 1 1"/>
        <body name="hills"><freejoint/><geom name="hills" type="hfield" hfield="hills"
        density="100"/></body></worldbody></mujoco>"""
    )
    model.hfield_data[:] = heights.ravel()
    data = mujoco.MjData(model)
    rng = np.random.default_rng(5)
    for _ in range(20):
        data.qpos[:3] = rng.normal(size=3)
        data.qpos[3:7] = Rotation.random(random_state=rng).as_quat()
        data.qvel[2] = -3.0
        mujoco.mj_forward(model, data)
        lowest = min(p[:, 2].min() for p in prisms(model, data))
        assert distance(model, data, "floor", "hills").distance == pytest.approx(
            lowest, abs=ROUNDING
        )
        found = time_of_impact(model, data, "floor", "hills", horizon=1.0)
        assert found.hit == (lowest < 3.0)
        if 0.0 < lowest < 3.0:
            assert found.time == pytest.approx(lowest / 3.0, abs=1e-9)


# --- time of impact ---


def launch(model, data, name, position, rotation, linear=(0, 0, 0), angular=(0, 0, 0)):
    """Set the free body of that name: pose, and velocities in the world."""
    joint = model.body(name).jntadr[0]
    at, dof = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
    data.qpos[at : at + 3] = position
    data.qpos[at + 3 : at + 7] = np.roll(rotation.as_quat(), 1)
    data.qvel[dof : dof + 3] = linear
    data.qvel[dof + 3 : dof + 6] = rotation.inv().apply(angular)
    mujoco.mj_forward(model, data)


@pytest.mark.parametrize("speed", [0.5, 100.0])
def test_ball_onto_a_slope(speed):
    """Heights on a plane z = a x + b: the ball meets it where its centre is a radius away."""
    slope = np.linspace(0.0, 1.0, COLUMNS) * np.ones((ROWS, 1))
    model, data = make_model(slope, pose="")
    tangent = ELEVATION / (2 * HALF_X)
    normal = np.array((-tangent, 0, 1)) / np.hypot(tangent, 1)
    radius = SIZE["sphere"][0]
    rng = np.random.default_rng(6)
    horizon = 1.0 / speed
    for _ in range(50):
        x, y = rng.uniform(-0.2, 0.2), rng.uniform(-0.4, 0.4)
        foot = np.array((x, y, ELEVATION * (x + HALF_X) / (2 * HALF_X)))
        velocity = np.array((*rng.normal(size=2) * 0.2, -1.0)) * speed
        time = rng.uniform(0.1, 0.9) * horizon
        start = foot + radius * normal - velocity * time
        launch(model, data, "sphere", start, Rotation.identity(), velocity, rng.normal(size=3) * 50)
        found = time_of_impact(model, data, "hills", "sphere", horizon=horizon)
        # Heights in single precision: 1e-8 m, at a closing speed above half the speed.
        assert found.hit
        assert found.time == pytest.approx(time, abs=4e-8 / speed)
        np.testing.assert_allclose(found.normal, normal, atol=1e-6)
        receding = time_of_impact(model, data, "sphere", "hills", horizon=0.5 * time)
        assert (receding.hit, receding.time) == (False, 0.5 * time)
        assert receding.distance > 0.0


@pytest.mark.parametrize("kind", CONVEX)
@pytest.mark.parametrize("moving", [False, True])
def test_tumbling_bodies_onto_hills(kind, moving):
    """Against the distance along the motion: positive before, zero at the time of impact."""
    model, data = make_model(rough(4), moving=moving)
    moved = mujoco.MjData(model)
    rng = np.random.default_rng([8, CONVEX.index(kind), moving])
    horizon = 0.1
    hits = 0
    for _ in range(8):
        turn = Rotation.random(random_state=rng)
        centre = np.array((0.1, -0.2, 0.3)) * (not moving)
        aim = centre + np.append(rng.uniform(-0.25, 0.25, size=2), 0.5)
        linear = np.append(rng.normal(size=2), rng.uniform(-9, -4))
        launch(model, data, kind, aim, turn, linear, rng.normal(size=3) * 30)
        bodies = [kind]
        if moving:
            bodies.append("hills")
            tilt = Rotation.from_rotvec(rng.normal(size=3) * 0.3)
            spin = rng.normal(size=3) * 2
            launch(model, data, "hills", (0, 0, 0), tilt, rng.normal(size=3) * 0.5, spin)
        motion = {}
        for name in bodies:
            body = model.body(name).id
            velocity = np.zeros(6)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, velocity, 0)
            motion[name] = (data.xipos[body].copy(), velocity[3:], velocity[:3])

        def gap(time, motion=motion):
            moved.geom_xpos[:], moved.geom_xmat[:] = data.geom_xpos, data.geom_xmat
            for name, (middle, linear, angular) in motion.items():
                turn = Rotation.from_rotvec(angular * time)
                index = model.geom(name).id
                moved.geom_xpos[index] = (
                    middle + linear * time + turn.apply(data.geom_xpos[index] - middle)
                )
                rotation = turn.as_matrix() @ data.geom_xmat[index].reshape(3, 3)
                moved.geom_xmat[index] = rotation.ravel()
            return distance(model, moved, "hills", kind).distance

        found = time_of_impact(model, data, "hills", kind, horizon=horizon)
        before = [gap(t) for t in np.linspace(0, found.time, 60)]
        assert min(before[:-1]) > 0.0  # never late
        if found.hit:
            hits += 1
            assert gap(found.time) < 1e-8  # never early by more than the clearance
            assert found.distance == pytest.approx(gap(found.time), abs=1e-9)
        else:
            assert found.time == horizon
            assert found.distance == pytest.approx(before[-1], abs=1e-12)
    assert hits >= 4


def test_flight_over_and_past_the_field_does_not_hit():
    model, data = make_model(rough(), pose="")
    still = Rotation.identity()
    launch(model, data, "box", (-5, 0, ELEVATION + 0.2), still, (100, 0, 0), (0, 0, 50))
    assert not time_of_impact(model, data, "hills", "box", horizon=1.0).hit
    launch(model, data, "box", (-5, 2 * HALF_Y, 0), still, (100, 0, 0))
    away = time_of_impact(model, data, "hills", "box", horizon=1e4)
    assert (away.hit, away.time) == (False, 1e4)
    launch(model, data, "box", (0, 0, 1), still)
    rest = time_of_impact(model, data, "hills", "box", horizon=1.0)
    assert (rest.hit, rest.distance) == (False, distance(model, data, "hills", "box").distance)
    launch(model, data, "box", (0, 0, 0), still, (0, 0, 9))
    overlapping = time_of_impact(model, data, "hills", "box", horizon=1.0)
    assert (overlapping.hit, overlapping.time) == (True, 0.0)
    assert overlapping.distance == distance(model, data, "hills", "box").distance


# --- callers ---


def test_closest_and_distances():
    model, _ = make_model(rough())
    rng = np.random.default_rng(11)
    qpos = rng.normal(scale=0.3, size=(3, 5, model.nq))
    data = mujoco.MjData(model)
    data.qpos[:] = qpos[1, 2]
    mujoco.mj_forward(model, data)
    for kind in CONVEX:
        many = dashpot.distances(model, "hills", kind, qpos, nthread=1)
        assert many.distance[1, 2] == distance(model, data, "hills", kind).distance
        again = dashpot.distances(model, "hills", kind, qpos, nthread=3)
        assert many.point1.tobytes() == again.point1.tobytes()
    found = closest(model, data, radius=0.3)
    with_hills = {int(pair.max()) for pair in found.geom if 0 in pair}
    near = {i for i in range(1, model.ngeom) if distance(model, data, 0, i).distance <= 0.3}
    assert with_hills == near
    assert near


def test_heights_that_are_not_finite_are_named():
    heights = rough()
    model, data = make_model(heights, pose="")
    place(model, data, "sphere", (0, 0, 0.5), np.eye(3))
    model.hfield_data[3 * COLUMNS + 2] = np.nan
    with pytest.raises(ValueError, match="geom 'hills': the height of row 3, column 2 is nan"):
        distance(model, data, "hills", "sphere")


def test_contacts_filtered_by_height_field():
    model, _ = make_model(np.full((ROWS, COLUMNS), 0.5), pose="")
    model.opt.gravity[2] = -9.81
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qpos[:] = model.qpos0
    launch(engine.model, data, "box", (0, 0, 0.1 + 0.05), Rotation.identity())
    engine.step(data, nstep=50)
    on_hills = engine.contacts(data, geom="hills")
    assert len(on_hills) > 0
    between = engine.contacts(data, pair=("hills", "box"))
    assert len(between) == len(on_hills)
    weight = engine.model.body_mass[engine.model.body("box").id] * 9.81
    # Forces point along normals that are all vertical on a flat field, and have settled.
    assert abs(between.force[:, 0].sum()) == pytest.approx(weight, rel=1e-3)


def test_fast_ball_does_not_pass_a_thin_height_field():
    """`impact="cut"` looks at height fields too."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option gravity="0 0 0" timestep="0.005"/><asset>
        <hfield name="sheet" nrow="5" ncol="5" size="1 1 0.01 0.002"/></asset><worldbody>
        <geom name="sheet" type="hfield" hfield="sheet"/>
        <body><freejoint/><geom name="ball" size="0.01"/></body></worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model, impact="cut")
    rng = np.random.default_rng(12)
    for _ in range(20):
        data = engine.make_data()
        data.qpos[:3] = *rng.uniform(-0.5, 0.5, size=2), rng.uniform(0.1, 0.5)
        data.qvel[:3] = *rng.normal(size=2) * 10, -rng.uniform(20, 200)
        engine.step(data, nstep=10)
        assert data.qpos[2] > 0.0
        assert data.qvel[2] >= -1e-6
