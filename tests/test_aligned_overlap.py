"""Overlaps without a single nearest direction: parallel faces, common axes, common centres."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import dashpot
from query_scenes import geom, place, scene

UNIT = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
KINDS = ("capsule", "cylinder", "box", "mesh")


def two_geoms(kinds, sizes):
    """Model of geoms ``<kind>1`` and ``<kind>2``; a mesh is a box with a corner at every end."""
    meshes = "".join(
        f'<mesh name="m{i}" vertex="{" ".join(map(repr, (UNIT * size).ravel().tolist()))}"/>'
        for i, size in enumerate(sizes)
    )
    bodies = "".join(
        f'<body><freejoint/><geom name="{kind}{i + 1}" mass="1" '
        + (
            f'type="mesh" mesh="m{i}"/></body>'
            if kind == "mesh"
            else f'type="{kind}" size="{size[0]!r} {size[1]!r} {size[2]!r}"/></body>'
        )
        for i, (kind, size) in enumerate(zip(kinds, np.asarray(sizes).tolist(), strict=True))
    )
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><asset>{meshes}</asset><worldbody>{bodies}</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def excess(half, point):
    """How far (m) a point in a box's frame lies outside it."""
    return np.max(np.abs(point) - half)


@pytest.mark.parametrize("kinds", [("box", "box"), ("box", "mesh"), ("mesh", "mesh")])
@pytest.mark.parametrize("yaw", [0.0, np.pi / 4, 0.3])
def test_boxes_turned_alike_part_along_the_axis_of_least_overlap(kinds, yaw):
    """Nearest point of the surface of their difference, a box of the sum of their sizes."""
    rng = np.random.default_rng(7)
    turn = Rotation.from_euler("z", yaw)
    for trial in range(24):
        sizes = np.exp(rng.uniform(np.log(0.01), 0.0, (2, 3)))
        if trial % 2:
            sizes[1] = sizes[0]
        model, data = two_geoms(kinds, sizes)
        own = [data.geom_xmat[i].reshape(3, 3).copy() for i in range(2)]  # a mesh has its own axes
        if "mesh" in kinds:  # vertices are in single precision
            for i, kind in enumerate(kinds):
                if kind == "mesh":
                    start = model.mesh_vertadr[model.geom_dataid[i]]
                    corners = model.mesh_vert[start : start + 8] @ own[i].T
                    sizes[i] = np.abs(corners).max(axis=0)
        for spread in (0.0, 1e-3, 0.3, 1.0):
            offset = rng.uniform(-1, 1, 3) * sizes.sum(axis=0) * spread * rng.choice((0, 1), 3)
            place(model, data, kinds[0] + "1", (0, 0, 0), turn.as_matrix() @ own[0])
            place(model, data, kinds[1] + "2", turn.apply(offset), turn.as_matrix() @ own[1])
            found = dashpot.distance(model, data, 0, 1)
            expected = -np.min(sizes.sum(axis=0) - np.abs(offset))
            rounding = 1e-6 * sizes.max() if "mesh" in kinds else 1e-11 * sizes.max()
            assert found.distance == pytest.approx(expected, abs=rounding)
            assert excess(sizes[0], turn.inv().apply(found.point1)) < rounding
            assert excess(sizes[1], turn.inv().apply(found.point2) - offset) < rounding
            np.testing.assert_allclose(
                found.point2 - found.point1, found.distance * found.normal, atol=rounding
            )


@pytest.mark.parametrize("depth", [1e-8, 1e-6, 1e-4, 1e-2])
def test_a_plate_on_a_table_touches_where_both_are(depth):
    rng = np.random.default_rng(3)
    for _ in range(40):
        table, plate = np.exp(rng.uniform(np.log(0.02), 0.0, (2, 3)))
        model, data = two_geoms(("box", "box"), (table, plate))
        turn = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi))
        position = np.append(rng.uniform(-0.5, 0.5, 2) * table[:2], table[2] + plate[2] - depth)
        place(model, data, "box2", position, turn.as_matrix())
        found = dashpot.distance(model, data, "box1", "box2")
        assert found.distance == pytest.approx(-min(depth, *(table + plate)), abs=1e-11)
        assert excess(table, found.point1) < 1e-11
        assert excess(plate, turn.inv().apply(found.point2 - position)) < 1e-11


@pytest.mark.parametrize("kinds", list(itertools.combinations_with_replacement(KINDS, 2)))
def test_points_of_aligned_overlaps_lie_in_both_geoms(kinds):
    rng = np.random.default_rng(11)
    directions = rng.normal(size=(300, 3))
    directions = np.concatenate([directions, np.eye(3), -np.eye(3)])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    turns = [Rotation.from_euler(axis, 90 if axis != "z" else 45, degrees=True) for axis in "xyz"]
    turns = [Rotation.identity(), *turns]
    for trial in range(5):
        model, data = two_geoms(kinds, rng.choice((1.0, 0.5, 0.1, 0.01), (2, 3)))
        names = [kind + str(i + 1) for i, kind in enumerate(kinds)]
        for _ in range(10):
            offset = rng.normal(size=3) * rng.choice((0, 1e-3, 0.1, 0.3)) * rng.choice((0, 1), 3)
            place(model, data, names[0], (0, 0, 0), turns[rng.integers(4)].as_matrix())
            place(model, data, names[1], offset, turns[rng.integers(4)].as_matrix())
            found = dashpot.distance(model, data, *names)
            for name, point in zip(names, (found.point1, found.point2), strict=True):
                furthest = supports(model, data, name, directions)
                assert np.max(directions @ point - furthest) < 1e-7, (trial, name)


def supports(model, data, name, directions):
    """Return how far (n,) a geom reaches along directions (n, 3), from its definition."""
    index = model.geom(name).id
    size, d = model.geom_size[index], directions @ data.geom_xmat[index].reshape(3, 3)
    along = np.abs(d)
    if name.startswith("mesh"):
        mesh = model.geom_dataid[index]
        start = model.mesh_vertadr[mesh]
        vertices = model.mesh_vert[start : start + model.mesh_vertnum[mesh]].astype(float)
        reach = np.max(d @ vertices.T, axis=1)
    elif name.startswith("capsule"):
        reach = size[0] + size[1] * along[:, 2]
    elif name.startswith("cylinder"):
        reach = size[0] * np.hypot(d[:, 0], d[:, 1]) + size[1] * along[:, 2]
    else:
        reach = along @ size
    return directions @ data.geom_xpos[index] + reach


@pytest.mark.parametrize("second", ["cylinder", "capsule"])
def test_cylinders_with_parallel_axes(second):
    """The distance of a point from a cylinder of the sum of their sizes."""
    rng = np.random.default_rng(2)
    seen = set()
    for _ in range(120):
        (radius1, half1), (radius2, half2) = np.exp(rng.uniform(-3, 0, (2, 2))).tolist()
        model, data = scene(
            geom("a", "cylinder", f"{radius1!r} {half1!r}"),
            geom("b", second, f"{radius2!r} {half2!r}"),
        )
        turn = Rotation.random(random_state=rng)
        offset = rng.normal(size=3) * rng.choice((0.0, 1e-4, 0.1, 1.0))
        flip = Rotation.from_euler("x", 180 * rng.integers(2), degrees=True)
        place(model, data, "a", (0, 0, 0), turn.as_matrix())
        place(model, data, "b", turn.apply(offset), (turn * flip).as_matrix())
        core = radius2 if second == "cylinder" else 0.0
        swept = radius2 - core
        wall = np.hypot(*offset[:2]) - radius1 - core
        cap = abs(offset[2]) - half1 - half2
        inside = wall <= 0 and cap <= 0
        expected = max(wall, cap) if inside else np.hypot(max(wall, 0), max(cap, 0))
        seen.add((inside, wall > cap))
        found = dashpot.distance(model, data, "a", "b")
        assert found.distance == pytest.approx(expected - swept, abs=1e-14)
        np.testing.assert_allclose(
            found.point2 - found.point1, found.distance * found.normal, atol=1e-14
        )
        local1 = turn.inv().apply(found.point1)
        local2 = turn.inv().apply(found.point2 + swept * found.normal) - offset
        for local, radius, half in (
            (local1, radius1, half1),
            (local2, core, half2),
        ):
            assert np.hypot(*local[:2]) < radius + 1e-14
            assert abs(local[2]) < half + 1e-14
    assert len(seen) == 4


def test_a_ball_in_a_cylinder_about_its_centre():
    """An ellipsoid with equal axes is a ball; of the wall and both lids, one is nearest."""
    rng = np.random.default_rng(4)
    for trial in range(60):
        radius, half, ball = 1.0, (1.0, 0.7)[trial % 2], (1.0, 0.2)[trial // 2 % 2]
        model, data = scene(
            geom("tube", "cylinder", f"{radius} {half}"),
            geom("ball", "ellipsoid", f"{ball} {ball} {ball}"),
        )
        turn = Rotation.random(random_state=rng)
        offset = rng.normal(size=3) * 10.0 ** rng.uniform(-5, -1)
        place(model, data, "tube", (0, 0, 0), turn.as_matrix())
        any_turn = Rotation.random(random_state=rng).as_matrix()
        place(model, data, "ball", turn.apply(offset), any_turn)
        expected = max(np.hypot(*offset[:2]) - radius, abs(offset[2]) - half) - ball
        found = dashpot.distance(model, data, "tube", "ball")
        size = np.hypot(radius, half) + ball
        assert found.distance == pytest.approx(expected, abs=1e-5 * size)
        np.testing.assert_allclose(
            found.point2 - found.point1, found.distance * found.normal, atol=2e-4 * size
        )
