"""Signed distance and time of impact against closed forms and independent references."""

from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import dashpot
from dashpot.query import closest, distance, time_of_impact

CONVEX = ("sphere", "capsule", "cylinder", "ellipsoid", "box", "mesh")
SIZE = {
    "sphere": (0.08,),
    "capsule": (0.05, 0.1),
    "cylinder": (0.07, 0.09),
    "ellipsoid": (0.1, 0.06, 0.04),
    "box": (0.09, 0.05, 0.07),
}
# Rounding of positions of about 0.1 m through a few hundred operations.
ROUNDING = 1e-13


def hull_points():
    points = np.random.default_rng(7).normal(size=(30, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * (0.1, 0.07, 0.05)


@pytest.fixture(scope="module")
def zoo():
    """Two free bodies of each convex type, and a plane."""
    vertices = " ".join(f"{x:.9g}" for x in hull_points().ravel())
    bodies = ""
    for copy in "12":
        for kind in CONVEX:
            size = " ".join(map(str, SIZE.get(kind, ())))
            shape = 'type="mesh" mesh="hull"' if kind == "mesh" else f'type="{kind}" size="{size}"'
            bodies += f'<body><freejoint/><geom name="{kind}{copy}" {shape}/></body>'
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><mesh name="hull" vertex="{vertices}"/></asset><worldbody>
        <geom name="plane" type="plane" size="1 1 1"/>{bodies}</worldbody></mujoco>"""
    )


def scene(*geoms, gravity="0 0 -9.81"):
    """Make a model with one free body per MJCF geom; planes go to the world."""
    bodies = "".join(
        geom if 'type="plane"' in geom else f"<body><freejoint/>{geom}</body>" for geom in geoms
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="{gravity}"/><worldbody>{bodies}</worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def geom(name, kind, size, extra=""):
    return f'<geom name="{name}" type="{kind}" size="{size}" {extra}/>'


def place(model, data, name, position, rotation=None):
    """Put a geom, and only the geom, at a pose."""
    index = model.geom(name).id
    data.geom_xpos[index] = position
    data.geom_xmat[index] = (np.eye(3) if rotation is None else rotation).ravel()


def free_body(model, name):
    joint = model.body_jntadr[model.geom(name).bodyid[0]]
    return model.jnt_qposadr[joint], model.jnt_dofadr[joint]


def launch(model, data, name, position, rotation=None, linear=(0, 0, 0), angular=(0, 0, 0)):
    """Set the free body of a geom: pose, and velocities in the world."""
    rotation = Rotation.identity() if rotation is None else rotation
    at, dof = free_body(model, name)
    data.qpos[at : at + 3] = position
    data.qpos[at + 3 : at + 7] = np.roll(rotation.as_quat(), 1)
    data.qvel[dof : dof + 3] = linear
    data.qvel[dof + 3 : dof + 6] = rotation.inv().apply(angular)
    mujoco.mj_forward(model, data)


def support(model, data, name, direction):
    """Furthest point of a geom along a unit direction, written from the shapes' definitions."""
    index = model.geom(name).id
    position, rotation = data.geom_xpos[index], data.geom_xmat[index].reshape(3, 3)
    size, d = model.geom_size[index], rotation.T @ direction
    kind = name.rstrip("12")
    if kind == "sphere":
        local = size[0] * d
    elif kind == "capsule":
        local = size[0] * d + [0, 0, np.copysign(size[1], d[2])]
    elif kind == "cylinder":
        radial = np.hypot(*d[:2]) or 1.0
        local = np.append(size[0] * d[:2] / radial, np.copysign(size[1], d[2]))
    elif kind == "ellipsoid":
        local = size**2 * d / np.linalg.norm(size * d)
    elif kind == "box":
        local = np.copysign(size, d)
    else:
        vertices = model.mesh_vert.astype(float)
        local = vertices[np.argmax(vertices @ d)]
    return position + rotation @ local


def directional(model, data, name1, name2, normal):
    """Gap along a direction: a lower bound of the signed distance for every direction."""
    return normal @ (support(model, data, name2, -normal) - support(model, data, name1, normal))


def random_pair(model, data, rng, name1, name2, spread):
    for name in (name1, name2):
        place(
            model,
            data,
            name,
            rng.normal(size=3) * spread,
            Rotation.random(random_state=rng).as_matrix(),
        )


# --- distance: closed forms ---


def test_two_spheres():
    model, data = scene(geom("a", "sphere", "0.1"), geom("b", "sphere", "0.25"))
    place(model, data, "a", (1, 2, 3))
    for gap in (0.5, 1e-6, 0.0, -1e-6, -0.2):
        along = np.array([2, -1, 2]) / 3
        place(model, data, "b", (1, 2, 3) + (0.35 + gap) * along)
        found = distance(model, data, "a", "b")
        assert found.distance == pytest.approx(gap, abs=1e-15)
        np.testing.assert_allclose(found.normal, along, atol=1e-14)
        np.testing.assert_allclose(found.point1, (1, 2, 3) + 0.1 * along, atol=1e-14)
        np.testing.assert_allclose(found.point2 - found.point1, gap * along, atol=1e-14)


def test_concentric_spheres_are_as_deep_as_their_radii():
    model, data = scene(geom("a", "sphere", "0.1"), geom("b", "sphere", "0.25"))
    found = distance(model, data, "a", "b")
    assert found.distance == pytest.approx(-0.35, abs=1e-15)
    assert np.linalg.norm(found.normal) == pytest.approx(1.0)


def test_parallel_and_crossed_capsules():
    model, data = scene(geom("a", "capsule", "0.1 0.5"), geom("b", "capsule", "0.2 0.5"))
    place(model, data, "b", (0.4, 0, 0.6))
    parallel = distance(model, data, "a", "b")
    assert parallel.distance == pytest.approx(0.1, abs=1e-15)
    np.testing.assert_allclose(parallel.normal, (1, 0, 0), atol=1e-15)
    assert parallel.point1[2] == pytest.approx(0.3)  # middle of the facing stretch, 0.1 to 0.5
    place(model, data, "b", (0, 0, 0.9))  # in line, overlapping by 0.1 at the segments' ends
    assert distance(model, data, "a", "b").distance == pytest.approx(-0.3, abs=1e-15)
    quarter_turn = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    place(model, data, "b", (0, 0, 0), quarter_turn)  # segments cross at their middles
    crossed = distance(model, data, "a", "b")
    assert crossed.distance == pytest.approx(-0.3, abs=1e-15)
    np.testing.assert_allclose(np.abs(crossed.normal), (1, 0, 0), atol=1e-15)


@pytest.mark.parametrize(
    ("offset", "expected", "normal"),
    [
        ((0.5, 0.0, 0.0), 0.5 - 0.2 - 0.1, (1, 0, 0)),  # face
        ((0.5, 0.5, 0.0), 0.5 - 0.1, (0.6, 0.8, 0)),  # edge, apart by (.3, .4, 0)
        ((0.3, 0.3, 0.5), 0.3 - 0.1, (1 / 3, 2 / 3, 2 / 3)),  # corner, apart by (.1, .2, .2)
        ((0.19, 0.0, 0.0), -0.01 - 0.1, (1, 0, 0)),  # centre inside, nearest the face x = .2
        ((0.0, 0.02, 0.0), -0.08 - 0.1, (0, 1, 0)),  # centre inside, nearest the face y = .1
    ],
)
def test_sphere_and_box(offset, expected, normal):
    model, data = scene(geom("box", "box", "0.2 0.1 0.3"), geom("ball", "sphere", "0.1"))
    turn = Rotation.from_rotvec((0.3, -0.7, 1.1))
    centre = np.array((5.0, -2.0, 1.0))
    place(model, data, "box", centre, turn.as_matrix())
    place(model, data, "ball", centre + turn.apply(offset))
    found = distance(model, data, "box", "ball")
    assert found.distance == pytest.approx(expected, abs=1e-14)
    np.testing.assert_allclose(found.normal, turn.apply(normal), atol=1e-13)
    np.testing.assert_allclose(
        found.point2, data.geom("ball").xpos - 0.1 * turn.apply(normal), atol=1e-13
    )


@pytest.mark.parametrize(
    ("offset", "expected"),
    [
        ((0.5, 0.0, 0.1), 0.5 - 0.2 - 0.05),  # wall
        ((0.1, 0.0, 0.6), 0.6 - 0.3 - 0.05),  # cap
        ((0.3, 0.4, 0.7), 0.5 - 0.05),  # rim, apart by (.3, .4)
        ((0.19, 0.0, 0.1), -0.01 - 0.05),  # inside, nearest the wall
        ((0.05, 0.0, -0.28), -0.02 - 0.05),  # inside, nearest the lower cap
    ],
)
def test_sphere_and_cylinder(offset, expected):
    model, data = scene(geom("tube", "cylinder", "0.2 0.3"), geom("ball", "sphere", "0.05"))
    place(model, data, "ball", offset)
    assert distance(model, data, "tube", "ball").distance == pytest.approx(expected, abs=1e-15)


def test_edge_to_edge_boxes():
    """Unit cubes, both turned by 45 degrees about different axes, meet edge to edge."""
    model, data = scene(geom("a", "box", "0.5 0.5 0.5"), geom("b", "box", "0.5 0.5 0.5"))
    about_x = Rotation.from_euler("x", 45, degrees=True).as_matrix()
    about_y = Rotation.from_euler("y", 45, degrees=True).as_matrix()
    place(model, data, "a", (0, 0, 0), about_x)
    for gap in (0.3, 1e-5, -0.05):
        place(model, data, "b", (0.1, 0.2, np.sqrt(2) + gap), about_y)
        found = distance(model, data, "a", "b")
        assert found.distance == pytest.approx(gap, abs=1e-14)
        # The direction is a difference of points, each good to rounding, over the gap.
        np.testing.assert_allclose(found.normal, (0, 0, 1), atol=1e-15 / abs(gap))
        np.testing.assert_allclose(found.point1, (0.1, 0.0, np.sqrt(0.5)), atol=1e-13)


@pytest.mark.parametrize("kind", CONVEX)
def test_anything_and_plane(zoo, kind):
    """The lowest point decides: the shape's support against the plane's normal."""
    data = mujoco.MjData(zoo)
    rng = np.random.default_rng(1)
    for _ in range(50):
        tilt = Rotation.random(random_state=rng)
        up = tilt.apply((0, 0, 1))
        place(zoo, data, "plane", rng.normal(size=3), tilt.as_matrix())
        place(
            zoo, data, kind + "1", rng.normal(size=3), Rotation.random(random_state=rng).as_matrix()
        )
        lowest = support(zoo, data, kind + "1", -up)
        expected = up @ (lowest - data.geom("plane").xpos)
        found = distance(zoo, data, "plane", kind + "1")
        assert found.distance == pytest.approx(expected, abs=ROUNDING)
        np.testing.assert_allclose(found.normal, up, atol=ROUNDING)
        assert up @ (found.point1 - data.geom("plane").xpos) == pytest.approx(0.0, abs=ROUNDING)
        opposite = distance(zoo, data, kind + "1", "plane")
        assert opposite.distance == found.distance
        np.testing.assert_array_equal(opposite.normal, -found.normal)


def test_ellipsoid_and_sphere_along_the_axes():
    model, data = scene(geom("egg", "ellipsoid", "0.3 0.2 0.1"), geom("ball", "sphere", "0.05"))
    for axis, semi in enumerate((0.3, 0.2, 0.1)):
        place(model, data, "ball", np.eye(3)[axis] * (semi + 0.07))
        found = distance(model, data, "egg", "ball")
        assert found.distance == pytest.approx(0.02, abs=1e-14)
        np.testing.assert_allclose(found.normal, np.eye(3)[axis], atol=1e-7)
    place(model, data, "ball", (0, 0, 0))  # deepest at the shortest semi-axis
    assert distance(model, data, "egg", "ball").distance == pytest.approx(-0.15, abs=1e-9)


# --- distance: independent references on random configurations ---


@pytest.mark.parametrize(
    ("kind1", "kind2"), list(itertools.combinations_with_replacement(CONVEX, 2))
)
def test_bounds_prove_the_distance(zoo, kind1, kind2):
    """Any direction bounds the signed distance from below, any two points bound it from above.

    Where the shapes are apart the two bounds meet, which proves the answer. Where they overlap, the
    witnesses prove that the depth parts them, and no sampled direction may do it in less.
    """
    data = mujoco.MjData(zoo)
    rng = np.random.default_rng([CONVEX.index(kind1), CONVEX.index(kind2)])
    name1, name2 = kind1 + "1", kind2 + "2"
    signs = set()
    for trial in range(60):
        random_pair(zoo, data, rng, name1, name2, (0.02, 0.06, 0.15)[trial % 3])
        found = distance(zoo, data, name1, name2)
        signs.add(found.distance > 0)
        assert np.linalg.norm(found.normal) == pytest.approx(1.0, abs=ROUNDING)
        lower = directional(zoo, data, name1, name2, found.normal)
        apart = found.point2 - found.point1
        if found.distance > 0:
            # Stalls of GJK on curved shapes leave up to 4e-11 m in 20,000 trials.
            assert np.linalg.norm(apart) - lower < 1e-9
            assert lower <= found.distance + 1e-9
        else:
            # The polytope's bounds meet to 1e-10 of the size, or to 1e-5 before refinement where
            # a ring of directions is nearly as short; witnesses are then off by up to 1e-5.
            assert found.distance == pytest.approx(lower, abs=1e-9)
            np.testing.assert_allclose(apart, found.distance * found.normal, atol=1e-5)
            directions = rng.normal(size=(50, 3))
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
            others = (directional(zoo, data, name1, name2, n) for n in directions)
            assert max(others) <= found.distance + 1e-9
    assert signs == {True, False}


@pytest.mark.parametrize("kind", ["box", "mesh"])
def test_polytopes_against_their_minkowski_difference(zoo, kind):
    """The signed distance of the origin from the hull of all vertex differences (Qhull)."""
    data = mujoco.MjData(zoo)
    rng = np.random.default_rng(3)
    corners = {
        "box": np.array(list(itertools.product((-1, 1), repeat=3))) * SIZE["box"],
        "mesh": zoo.mesh_vert.astype(float),
    }
    deep = 0
    for _ in range(100):
        random_pair(zoo, data, rng, "box1", kind + "2", 0.05)
        world = [
            data.geom(name).xpos + vertices @ data.geom(name).xmat.reshape(3, 3).T
            for name, vertices in (("box1", corners["box"]), (kind + "2", corners[kind]))
        ]
        difference = (world[1][:, None] - world[0][None]).reshape(-1, 3)
        offsets = ConvexHull(difference).equations[:, 3]  # n.x + offset <= 0 inside
        found = distance(zoo, data, "box1", kind + "2")
        if offsets.max() < 0:
            deep += 1
            assert found.distance == pytest.approx(offsets.max(), abs=1e-12)
        else:
            assert found.distance > 0
            assert found.distance >= offsets.max() - 1e-12
    assert deep > 20


@pytest.mark.parametrize(
    ("kind1", "kind2"), list(itertools.combinations_with_replacement(CONVEX, 2))
)
def test_symmetry_and_rigid_motion(zoo, kind1, kind2):
    data = mujoco.MjData(zoo)
    rng = np.random.default_rng([5, CONVEX.index(kind1), CONVEX.index(kind2)])
    name1, name2 = kind1 + "1", kind2 + "2"
    for _ in range(10):
        random_pair(zoo, data, rng, name1, name2, 0.08)
        found = distance(zoo, data, name1, name2)
        swapped = distance(zoo, data, name2, name1)
        # Two searches of a curved overlap end within 1e-10 of the size of each other.
        assert swapped.distance == pytest.approx(found.distance, abs=1e-10)
        turn, shift = Rotation.random(random_state=rng), rng.normal(size=3)
        for name in (name1, name2):
            pose = data.geom(name)
            place(
                zoo,
                data,
                name,
                turn.apply(pose.xpos) + shift,
                turn.as_matrix() @ pose.xmat.reshape(3, 3),
            )
        moved = distance(zoo, data, name1, name2)
        assert moved.distance == pytest.approx(found.distance, abs=1e-10)
        if found.distance > 1e-3:  # apart: the direction is unique
            np.testing.assert_allclose(swapped.normal, -found.normal, atol=1e-5)
            np.testing.assert_allclose(moved.normal, turn.apply(found.normal), atol=1e-5)


@pytest.mark.parametrize(
    ("kind1", "kind2"), list(itertools.combinations_with_replacement(CONVEX, 2))
)
def test_degenerate_poses(zoo, kind1, kind2, capfd):
    """Same centre, same axes, quarter turns, exact touch: an answer, and nothing printed."""
    data = mujoco.MjData(zoo)
    name1, name2 = kind1 + "1", kind2 + "2"
    turns = [
        Rotation.from_euler("xyz", a, degrees=True) for a in ((0, 0, 0), (90, 0, 0), (0, 90, 90))
    ]
    for turn, offset in itertools.product(turns, (0.0, 1e-12, 1e-6, 0.01, 0.1, 1.0)):
        place(zoo, data, name1, (0, 0, 0))
        for axis in np.eye(3):
            place(zoo, data, name2, offset * axis, turn.as_matrix())
            found = distance(zoo, data, name1, name2)
            lower = directional(zoo, data, name1, name2, found.normal)
            assert found.distance == pytest.approx(lower, abs=1e-9)
    captured = capfd.readouterr()
    assert (captured.out, captured.err) == ("", "")


def test_size_does_not_matter():
    """A millimetre pair and a kilometre pair are as accurate, relative to their size."""
    for scale in (1e-3, 1e3):
        size, tube = (
            " ".join(f"{x * scale:.17g}" for x in sizes) for sizes in ((0.3, 0.2, 0.1), (0.1, 0.2))
        )
        heavy = 'mass="1"'  # MuJoCo refuses the mass of a millimetre body
        model, data = scene(
            geom("ellipsoid1", "ellipsoid", size, heavy), geom("cylinder2", "cylinder", tube, heavy)
        )
        turn = Rotation.from_rotvec((0.4, 0.2, -0.9)).as_matrix()
        for offset in (0.6, 0.25):
            place(model, data, "cylinder2", np.array((1, 0.3, -0.2)) * offset * scale, turn)
            found = distance(model, data, "ellipsoid1", "cylinder2")
            lower = directional(model, data, "ellipsoid1", "cylinder2", found.normal)
            assert found.distance == pytest.approx(lower, abs=1e-8 * scale)
            np.testing.assert_allclose(
                found.point2 - found.point1, found.distance * found.normal, atol=1e-5 * scale
            )


# --- time of impact ---


def test_ball_onto_plane():
    model, data = scene(geom("floor", "plane", "1 1 1"), geom("ball", "sphere", "0.1"))
    launch(model, data, "ball", (0, 0, 1.1), linear=(3, 0, -2), angular=(50, 20, 10))
    found = time_of_impact(model, data, "floor", "ball", horizon=1.0)
    assert found.hit
    assert found.time <= 0.5
    assert found.time == pytest.approx(0.5, rel=1e-9)
    np.testing.assert_allclose(found.normal, (0, 0, 1), atol=1e-15)
    np.testing.assert_allclose(found.point, (1.5, 0, 0), atol=1e-8)
    assert 0.0 < found.distance < 1e-9


@pytest.mark.parametrize("offset", [0.0, 0.1, 0.29, 0.299999, 0.300001, 0.31])
def test_two_balls_in_flight(offset):
    """Root of a quadratic: |r + v t| = r1 + r2; grazing and just missing included."""
    model, data = scene(geom("a", "sphere", "0.1"), geom("b", "sphere", "0.2"))
    launch(model, data, "a", (0, 0, 0), linear=(1, 0, 0), angular=(0, 0, 30))
    launch(model, data, "b", (3, offset, 0), linear=(-4, 0, 0))
    found = time_of_impact(model, data, "a", "b", horizon=2.0)
    assert found.hit == (offset < 0.3)
    if found.hit:
        exact = (3 - np.sqrt(0.09 - offset**2)) / 5
        assert found.time <= exact + 1e-15
        # The clearance at which contact counts, 3e-10 m, over the closing speed.
        closing = 5 * np.sqrt(0.09 - offset**2) / 0.3
        assert exact - found.time < 4e-10 / closing
    else:
        assert found.time == 2.0


def test_ball_at_100_m_per_s_against_a_thin_plate():
    model, data = scene(geom("ball", "sphere", "0.01"), geom("plate", "box", "0.5 0.5 0.0005"))
    rng = np.random.default_rng(4)
    for _ in range(200):
        aim = np.append(rng.uniform(-0.4, 0.4, size=2), 0.0)
        velocity = np.append(rng.normal(size=2) * 20, -100.0)
        start = aim - velocity * 0.004
        start[2] = 0.4 + 0.0005 + 0.01
        launch(model, data, "ball", start, linear=velocity, angular=rng.normal(size=3) * 100)
        found = time_of_impact(model, data, "ball", "plate", horizon=0.01)
        assert found.hit
        assert found.time <= 0.004
        assert found.time == pytest.approx(0.004, rel=1e-6)
        np.testing.assert_allclose(found.normal, (0, 0, -1), atol=1e-9)


def test_spinning_box_onto_the_ground():
    """First zero of the lowest corner's height, found by root bracketing of the exact motion."""
    half = np.array((0.2, 0.1, 0.05))
    corners = np.array(list(itertools.product((-1, 1), repeat=3))) * half
    model, data = scene(geom("floor", "plane", "1 1 1"), geom("box", "box", "0.2 0.1 0.05"))
    rng = np.random.default_rng(5)
    horizon = 0.2
    hits = 0
    for _ in range(40):
        turn = Rotation.random(random_state=rng)
        linear, angular = np.array((1.0, 0.5, rng.uniform(-6, 0))), rng.normal(size=3) * 20
        start = np.array((0, 0, rng.uniform(0.24, 0.8)))
        launch(model, data, "box", start, turn, linear, angular)

        def lowest(time, turn=turn, linear=linear, angular=angular, start=start):
            return (Rotation.from_rotvec(angular * time) * turn).apply(corners)[:, 2].min() + (
                start[2] + linear[2] * time
            )

        times = np.linspace(0, horizon, 4001)
        turns = Rotation.from_rotvec(times[:, None] * angular) * turn
        heights = (turns.as_matrix()[:, 2] @ corners.T).min(axis=1) + start[2] + linear[2] * times
        found = time_of_impact(model, data, "box", "floor", horizon=horizon)
        assert found.hit == bool((heights <= 0).any())
        if found.hit:
            hits += 1
            first = int(np.argmax(heights <= 0))
            exact = brentq(lowest, times[first - 1], times[first], xtol=1e-15)
            assert found.time <= exact + 1e-14
            assert exact - found.time < 1e-6 * exact
            np.testing.assert_allclose(found.normal, (0, 0, -1), atol=1e-15)
    assert 10 < hits < 40


@pytest.mark.parametrize(
    ("kind1", "kind2"), [("box", "box"), ("mesh", "capsule"), ("cylinder", "ellipsoid")]
)
def test_two_tumbling_bodies(zoo, kind1, kind2):
    """Against the first zero of the distance along the motion, from dense sampling."""
    data, moved = mujoco.MjData(zoo), mujoco.MjData(zoo)
    rng = np.random.default_rng([6, CONVEX.index(kind1), CONVEX.index(kind2)])
    names = (kind1 + "1", kind2 + "2")
    horizon = 0.05
    hits = 0
    for _ in range(12):
        motion = {}
        for name, side in zip(names, (-0.2, 0.2), strict=True):
            position = np.array((side, 0, 0)) + rng.normal(size=3) * 0.02
            linear = np.array((-20 * side, 0, 0)) + rng.normal(size=3)
            launch(
                zoo,
                data,
                name,
                position,
                Rotation.random(random_state=rng),
                linear,
                rng.normal(size=3) * 30,
            )
        for name in names:
            body = zoo.geom(name).bodyid[0]
            velocity = np.zeros(6)
            mujoco.mj_objectVelocity(zoo, data, mujoco.mjtObj.mjOBJ_BODY, body, velocity, 0)
            motion[name] = (data.xipos[body].copy(), velocity[3:], velocity[:3])

        def gap(time, motion=motion):
            for name, (centre, linear, angular) in motion.items():
                turn = Rotation.from_rotvec(angular * time)
                pose = data.geom(name)
                place(
                    zoo,
                    moved,
                    name,
                    centre + linear * time + turn.apply(pose.xpos - centre),
                    turn.as_matrix() @ pose.xmat.reshape(3, 3),
                )
            return distance(zoo, moved, *names).distance

        found = time_of_impact(zoo, data, *names, horizon=horizon)
        samples = np.linspace(0, found.time, 60)
        assert min(gap(t) for t in samples) > 0.0  # never late
        if found.hit:
            hits += 1
            assert gap(found.time) < 1e-8  # never early by more than the clearance
            assert gap(found.time + 1e-7) < 1e-7
        else:
            assert found.time == horizon
    assert hits >= 6


def test_ball_that_hovers_at_a_turning_face():
    """A face slides past and tilts at 3e-10 to 1e-8 m from the ball, and parts or touches.

    Along a fixed direction the far corners of the face would soon be in the way, and there would be
    no decision in thousands of advances.
    """
    half = np.array((0.09, 0.05, 0.07))
    model, data = scene(geom("ball", "sphere", "0.08"), geom("box", "box", "0.09 0.05 0.07"))
    rng = np.random.default_rng(13)
    horizon = 0.05
    hits = 0
    for _ in range(60):
        gap = 10.0 ** rng.uniform(-9.5, -8)
        start = np.array((0, 0, 0.15 + gap))
        linear, angular = np.append(rng.normal(size=2) * 5, 0.0), rng.normal(size=3) * 10
        launch(model, data, "ball", (0, 0, 0))
        launch(model, data, "box", start, None, linear, angular)
        found = time_of_impact(model, data, "ball", "box", horizon=horizon)
        times = np.linspace(0, found.time, 2001)
        turns = Rotation.from_rotvec(times[:, None] * angular)
        local = turns.inv().apply(-start - times[:, None] * linear)
        outside = np.linalg.norm(np.maximum(np.abs(local) - half, 0.0), axis=1)
        gaps = outside - 0.08
        assert gaps.min() > 0.0  # never late
        if found.hit:
            hits += 1
            assert gaps[-1] < 1e-9 * 0.3  # of the size of the pair
        else:
            assert found.time == horizon
    assert 10 < hits < 50


def test_parallel_motion_and_receding_do_not_hit():
    model, data = scene(geom("floor", "plane", "1 1 1"), geom("box", "box", "0.1 0.1 0.1"))
    launch(model, data, "box", (0, 0, 0.1 + 1e-6), linear=(100, 0, 0))
    assert not time_of_impact(model, data, "floor", "box", horizon=1.0).hit
    launch(model, data, "box", (0, 0, 0.2), linear=(1, 0, 5), angular=(0, 0, 40))
    away = time_of_impact(model, data, "floor", "box", horizon=1.0)
    assert (away.hit, away.time) == (False, 1.0)
    assert away.distance == pytest.approx(5.1, abs=1e-12)


def test_rolling_close_to_the_ground_does_not_hit():
    """A spinning body of revolution at rest sweeps nothing."""
    model, data = scene(geom("floor", "plane", "1 1 1"), geom("wheel", "cylinder", "0.1 0.05"))
    lying = Rotation.from_euler("x", 90, degrees=True)
    launch(model, data, "wheel", (0, 0, 0.1 + 1e-7), lying, linear=(1, 0, 0), angular=(0, 10, 0))
    assert not time_of_impact(model, data, "floor", "wheel", horizon=0.1).hit


def test_touching_bodies_have_time_zero():
    model, data = scene(geom("floor", "plane", "1 1 1"), geom("box", "box", "0.1 0.1 0.1"))
    for height in (0.1, 0.05):
        launch(model, data, "box", (0, 0, height), linear=(0, 0, 3))
        found = time_of_impact(model, data, "floor", "box", horizon=1.0)
        assert (found.hit, found.time) == (True, 0.0)
        assert found.distance == pytest.approx(height - 0.1, abs=1e-15)


def test_impact_beyond_the_horizon():
    model, data = scene(geom("floor", "plane", "1 1 1"), geom("ball", "sphere", "0.1"))
    launch(model, data, "ball", (0, 0, 1.1), linear=(0, 0, -1))
    found = time_of_impact(model, data, "floor", "ball", horizon=0.25)
    assert (found.hit, found.time) == (False, 0.25)
    assert found.distance == pytest.approx(0.75, abs=1e-14)


# --- close pairs ---


def test_closest_finds_what_all_pairs_find(zoo):
    """Against the distance of every pair of geoms, for all bodies and for one."""
    data = mujoco.MjData(zoo)
    rng = np.random.default_rng(9)
    names = [kind + copy for kind in CONVEX for copy in "12"]
    for spread in (0.1, 0.5):
        mujoco.mj_forward(zoo, data)
        for name in names:
            turn = Rotation.random(random_state=rng).as_matrix()
            place(zoo, data, name, rng.normal(size=3) * spread, turn)
        for body, radius in itertools.product((None, 4), (0.0, 0.05, 0.3)):
            expected = {}
            for pair in itertools.combinations(range(zoo.ngeom), 2):
                near = distance(zoo, data, *pair).distance
                if near <= radius and (body is None or body in zoo.geom_bodyid[list(pair)]):
                    expected[pair] = near
            found = closest(zoo, data, body, radius=radius)
            assert {tuple(map(int, pair)) for pair in found.geom} == set(expected)
            assert (np.diff(found.distance) >= 0).all()
            for i, pair in enumerate(map(tuple, found.geom)):
                assert found.distance[i] == expected[pair]
                np.testing.assert_array_equal(found.normal[i], distance(zoo, data, *pair).normal)


def test_closest_leaves_out_what_cannot_meet():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
        <geom name="wall" type="box" size="0.1 0.1 0.1"/>
        <body name="ball"><freejoint/><geom name="ball" size="0.1"/>
        <geom name="cap" size="0.1" pos="0 0 0.1"/>
        <geom name="paint" size="0.3" contype="0" conaffinity="0"/>
        </body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found = closest(model, data, "ball", radius=1.0)
    pairs = {tuple(model.geom(i).name for i in pair) for pair in found.geom}
    assert pairs == {("floor", "ball"), ("floor", "cap"), ("wall", "ball"), ("wall", "cap")}
    data.qpos[2] = 5.0
    mujoco.mj_forward(model, data)
    nothing = closest(model, data, radius=1.0)
    assert nothing.geom.shape == (0, 2)
    assert nothing.normal.shape == (0, 3)
    with pytest.raises(ValueError, match="no body named 'bal'; did you mean 'ball'"):
        closest(model, data, "bal", radius=1.0)
    for radius in (-1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="radius"):
            closest(model, data, radius=radius)


# --- callers ---


def test_bad_input(zoo):
    data = mujoco.MjData(zoo)
    mujoco.mj_forward(zoo, data)
    with pytest.raises(ValueError, match="no geom named 'bax1'; did you mean 'box1'"):
        distance(zoo, data, "bax1", "sphere1")
    with pytest.raises(ValueError, match="geom2 = 99 is not a geom id"):
        distance(zoo, data, "box1", 99)
    with pytest.raises(ValueError, match="geom1 = -1 is not a geom id"):
        distance(zoo, data, -1, "box1")
    with pytest.raises(TypeError, match="geom1 must be a geom name or id, got float"):
        distance(zoo, data, 1.0, "box1")
    with pytest.raises(ValueError, match="same geom"):
        distance(zoo, data, "box1", "box1")
    with pytest.raises(TypeError, match=r"Engine or a mujoco\.MjModel"):
        distance(data, data, "box1", "box2")
    with pytest.raises(TypeError, match=r"mujoco\.MjData"):
        distance(zoo, zoo, "box1", "box2")
    for horizon in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="horizon"):
            time_of_impact(zoo, data, "box1", "box2", horizon=horizon)
    other, other_data = scene(geom("a", "sphere", "0.1"), geom("b", "sphere", "0.1"))
    with pytest.raises(ValueError, match="another model"):
        distance(zoo, other_data, "box1", "box2")
    data.geom_xpos[zoo.geom("box1").id, 1] = np.nan
    with pytest.raises(ValueError, match="geom_xpos of geom 'box1' is not finite"):
        distance(zoo, data, "box1", "box2")
    with pytest.raises(ValueError, match="geom_xmat of geom 'a' is not a rotation"):
        distance(other, mujoco.MjData(other), "a", "b")
    other_data.cvel[1] = np.nan
    with pytest.raises(ValueError, match="velocity of the body of geom 'a' is not finite"):
        time_of_impact(other, other_data, "a", "b", horizon=1.0)


def test_mesh_that_takes_no_part_in_collisions():
    """MuJoCo computes no hull for it; its vertices have the same hull."""
    corners = " ".join(
        str(x) for corner in itertools.product((-0.1, 0.1), repeat=3) for x in corner
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><mesh name="cube" vertex="{corners} 0 0 0.05"/></asset><worldbody>
        <geom name="seen" type="mesh" mesh="cube" contype="0" conaffinity="0"/>
        <geom name="ball" size="0.1" pos="0 0 0.5"/></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    # Vertices are single precision.
    assert distance(model, data, "seen", "ball").distance == pytest.approx(0.3, abs=1e-7)


def test_engine_and_its_model_answer_alike():
    model, _ = scene(geom("floor", "plane", "1 1 1"), geom("ball", "sphere", "0.1"))
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qpos[2], data.qvel[2] = 0.5, -2.0
    mujoco.mj_forward(engine.model, data)
    assert dashpot.distance(engine, data, "floor", "ball").distance == pytest.approx(0.4)
    impact = dashpot.time_of_impact(engine, data, "floor", "ball", horizon=1.0)
    assert impact.time == pytest.approx(0.2, rel=1e-8)
    assert dashpot.closest(engine, data, radius=0.5).distance == pytest.approx([0.4])
    assert dashpot.distance(engine.model, data, 0, 1).distance == pytest.approx(0.4)


def test_two_planes_and_two_height_fields_are_refused():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><asset>
        <hfield name="h" nrow="2" ncol="2" size="1 1 1 1"/></asset><worldbody>
        <geom name="p" type="plane" size="1 1 1"/><geom name="q" type="plane" size="1 1 1"/>
        <geom name="hills" type="hfield" hfield="h"/><geom name="dunes" type="hfield" hfield="h"/>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with pytest.raises(ValueError, match="two planes"):
        distance(model, data, "p", "q")
    with pytest.raises(ValueError, match="two height fields"):
        distance(model, data, "dunes", "hills")
    with pytest.raises(ValueError, match="two height fields"):
        time_of_impact(model, data, "dunes", "hills", horizon=1.0)


def test_queries_from_several_threads_are_bit_equal(zoo):
    data = mujoco.MjData(zoo)
    rng = np.random.default_rng(8)
    data.qpos[:] = rng.normal(size=zoo.nq) * 0.15
    data.qvel[:] = rng.normal(size=zoo.nv) * 5
    mujoco.mj_forward(zoo, data)
    pairs = [(a + "1", b + "2") for a, b in itertools.product(CONVEX, CONVEX)]

    def ask(pair):
        found = distance(zoo, data, *pair)
        impact = time_of_impact(zoo, data, *pair, horizon=0.1)
        near = closest(zoo, data, zoo.geom(pair[0]).bodyid[0], radius=0.1)
        arrays = (found.point1, found.point2, found.normal, impact.point, impact.normal)
        numbers = (found.distance, impact.hit, impact.time, impact.distance)
        lists = (near.geom, near.distance, near.point1, near.point2, near.normal)
        return numbers, [array.tobytes() for array in (*arrays, *lists)]

    alone = [ask(pair) for pair in pairs]
    assert {numbers[1] for numbers, _ in alone} == {True, False}
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(ask, pairs * 5)) == alone * 5


def test_distances_over_a_trajectory_equal_single_ones_for_any_number_of_threads(zoo):
    rng = np.random.default_rng(3)
    qpos = rng.normal(scale=0.1, size=(4, 25, zoo.nq))
    data = mujoco.MjData(zoo)
    for first, second in (("box1", "mesh2"), ("plane", "cylinder1"), ("capsule2", "ellipsoid1")):
        many = dashpot.distances(zoo, first, second, qpos, nthread=1)
        for threads in (2, 3, None):
            again = dashpot.distances(zoo, first, second, qpos, nthread=threads)
            for name in ("distance", "point1", "point2", "normal"):
                assert getattr(many, name).tobytes() == getattr(again, name).tobytes()
        assert many.normal.shape == (4, 25, 3)
        for index in ((0, 0), (3, 24), (1, 13)):
            data.qpos[:] = qpos[index]
            mujoco.mj_kinematics(zoo, data)
            single = distance(zoo, data, first, second)
            assert many.distance[index] == single.distance
            assert many.point1[index].tobytes() == single.point1.tobytes()
            assert many.point2[index].tobytes() == single.point2.tobytes()
            assert many.normal[index].tobytes() == single.normal.tobytes()


def test_times_of_impact_equal_single_ones_for_any_number_of_threads(zoo):
    rng = np.random.default_rng(4)
    qpos = rng.normal(scale=0.3, size=(4, 15, zoo.nq))
    qvel = rng.normal(scale=10.0, size=(4, 15, zoo.nv))
    data = mujoco.MjData(zoo)
    names = ("hit", "time", "point", "normal", "distance")
    hits = 0
    for first, second in (("box1", "mesh2"), ("plane", "cylinder1"), ("capsule2", "ellipsoid1")):
        many = dashpot.times_of_impact(zoo, first, second, qpos, qvel, horizon=0.05, nthread=1)
        hits += many.hit.sum()
        for threads in (2, 3, None):
            again = dashpot.times_of_impact(
                zoo, first, second, qpos, qvel, horizon=0.05, nthread=threads
            )
            for name in names:
                assert getattr(many, name).tobytes() == getattr(again, name).tobytes()
        assert many.point.shape == (4, 15, 3)
        for index in itertools.product(range(4), range(15)):
            data.qpos[:], data.qvel[:] = qpos[index], qvel[index]
            mujoco.mj_forward(zoo, data)
            single = time_of_impact(zoo, data, first, second, horizon=0.05)
            for name in names:
                one = np.asarray(getattr(single, name))
                assert getattr(many, name)[index].tobytes() == one.tobytes()
    assert 20 < hits < 160
    assert dashpot.times_of_impact(zoo, 0, 1, qpos[:0], qvel[:0], horizon=1.0).time.shape == (0, 15)


def test_times_of_impact_refuses_by_name(zoo):
    qpos, qvel = np.tile(zoo.qpos0, (3, 1)), np.zeros((3, zoo.nv))
    with pytest.raises(ValueError, match=r"qvel must be \(\.\.\., nv\)"):
        dashpot.times_of_impact(zoo, 0, 1, qpos, qpos, horizon=1.0)
    with pytest.raises(ValueError, match="same states"):
        dashpot.times_of_impact(zoo, 0, 1, qpos, qvel[:2], horizon=1.0)
    with pytest.raises(ValueError, match="horizon"):
        dashpot.times_of_impact(zoo, 0, 1, qpos, qvel, horizon=0.0)
    with pytest.raises(ValueError, match="nthread"):
        dashpot.times_of_impact(zoo, 0, 1, qpos, qvel, horizon=1.0, nthread=-1)
    qvel[1, 2] = np.inf
    with pytest.raises(ValueError, match=r"qvel\[1, 2\] is inf"):
        dashpot.times_of_impact(zoo, 0, 1, qpos, qvel, horizon=1.0)


def test_distances_of_no_and_of_one_configuration(zoo):
    assert dashpot.distances(zoo, "box1", "box2", np.zeros((0, zoo.nq))).point1.shape == (0, 3)
    one = dashpot.distances(zoo, "plane", "sphere1", zoo.qpos0)
    assert one.distance.shape == ()
    assert one.distance == pytest.approx(-SIZE["sphere"][0], abs=ROUNDING)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"qpos": np.zeros((3, 2))}, ValueError, r"nq = \d+, got \(3, 2\)"),
        ({"qpos": 1.0}, ValueError, r"got \(\)"),
        ({"qpos": "no numbers"}, TypeError, "qpos"),
        ({"qpos": "nan"}, ValueError, r"qpos\[2, 5\] is nan"),
        ({"nthread": 0}, ValueError, "nthread"),
        ({"nthread": 1.5}, TypeError, "nthread"),
        ({"geom2": "box1"}, ValueError, "same geom"),
        ({"geom2": "bax2"}, ValueError, "did you mean 'box2'"),
    ],
)
def test_distances_refuses_by_name(zoo, change, error, message):
    qpos = np.tile(zoo.qpos0, (4, 1))
    given = {"geom1": "box1", "geom2": "box2", "qpos": qpos, "nthread": None} | change
    if isinstance(given["qpos"], str) and given["qpos"] == "nan":
        qpos[2, 5] = np.nan
        given["qpos"] = qpos
    with pytest.raises(error, match=message):
        dashpot.distances(
            zoo, given["geom1"], given["geom2"], given["qpos"], nthread=given["nthread"]
        )


def test_contacts_filtered_by_geom_body_and_pair():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
        <body name="low" pos="0 0 .05"><freejoint/><geom name="low" type="box" size=".1 .1 .05"/>
        </body>
        <body name="high" pos="0 0 .15"><freejoint/><geom name="high" type="box" size=".1 .1 .05"/>
        </body></worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    engine.step(data, nstep=50)
    everything = engine.contacts(data)
    assert len(everything) == 8
    assert len(engine.contacts(data, geom="floor")) == 4
    assert len(engine.contacts(data, geom="low")) == 8
    assert len(engine.contacts(data, body="high")) == 4
    assert len(engine.contacts(data, body="low", geom="floor")) == 4
    assert len(engine.contacts(data, pair=("floor", "high"))) == 0
    between = engine.contacts(data, pair=("high", "low"))
    names = [{model.geom(g).name for g in pair} for pair in between.geom]
    assert names == [{"low", "high"}] * 4
    # Each interface carries the weight above it; statics settle to far better than 1e-3.
    weight = model.body_mass[2] * 9.81
    assert between.force[:, 0].sum() == pytest.approx(weight, rel=1e-3)
    assert engine.contacts(data, geom="floor").force[:, 0].sum() == pytest.approx(
        2 * weight, rel=1e-3
    )
    for bad in ({"geom": "flor"}, {"body": "mid"}, {"pair": ("low", "low")}, {"pair": ("low",)}):
        with pytest.raises(ValueError, match=r"did you mean|no body|same geom|two geoms"):
            engine.contacts(data, **bad)
