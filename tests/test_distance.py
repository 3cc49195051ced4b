"""Signed distance against closed forms, and of many configurations at once."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import dashpot
from dashpot.query import distance
from query_geoms import CONVEX, SIZE
from query_scenes import ROUNDING, geom, place, scene, support


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


@pytest.mark.parametrize("apart", [1e-15, 1e-13, 1e-10, 1e-7])
def test_axes_of_capsules_that_nearly_meet_are_square_to_the_normal(apart):
    """The normal of axes that cross, whatever rounding leaves of the way between them.

    Near the origin that is 1e-16 m: where the way is longer than 1e-8 of the size its direction is
    good to 1e-8 rad.
    """
    model, data = scene(geom("a", "capsule", "0.1 0.5"), geom("b", "capsule", "0.2 0.5"))
    rng = np.random.default_rng(15)
    for _ in range(50):
        turn = Rotation.random(random_state=rng)
        second = turn * Rotation.from_euler("x", rng.uniform(0.1, 3.0))
        normal = turn.as_matrix()[:, 0]
        place(model, data, "a", turn.apply((0, 0, rng.uniform(-0.4, 0.4))), turn.as_matrix())
        along = second.apply((0, 0, rng.uniform(-0.4, 0.4)))
        place(model, data, "b", along + apart * normal, second.as_matrix())
        found = distance(model, data, "a", "b")
        assert found.distance == pytest.approx(apart - 0.3, abs=1e-14)
        assert abs(found.normal @ normal) == pytest.approx(1.0, abs=1e-15)
        np.testing.assert_allclose(np.cross(found.normal, normal), 0.0, atol=2e-8)
        assert apart < 1e-12 or found.normal @ normal > 0.0


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


@pytest.mark.parametrize("kind", ["sphere", "capsule", "box", "cylinder", "ellipsoid"])
def test_points_are_apart_by_the_distance_along_the_normal(kind):
    """To what `Distance` says."""
    size = {"sphere": ".1", "capsule": ".05 .1"}.get(kind, ".1 .05 .2")
    shape = f'<body><freejoint/><geom name="{{}}" type="{kind}" size="{size}"/></body>'
    xml = f"<mujoco><worldbody>{shape.format('a')}{shape.format('b')}</worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    rng = np.random.default_rng(0)
    qpos = rng.normal(size=(500, 14)) * np.tile([0.1] * 3 + [1.0] * 4, 2)
    found = dashpot.query.distances(model, "a", "b", qpos)
    off = found.point2 - found.point1 - found.distance[:, None] * found.normal
    curved = kind in ("cylinder", "ellipsoid")
    np.testing.assert_allclose(off, 0.0, atol=1e-5 * 0.2 if curved else 1e-14)
