"""Signed distance of random configurations against bounds and other references."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from dashpot.query import distance
from query_geoms import CONVEX, SIZE
from query_scenes import ROUNDING, directional, geom, place, random_pair, scene


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
