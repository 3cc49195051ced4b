"""Close pairs against the distances of all pairs."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dashpot.query import closest, distance
from query_geoms import CONVEX
from query_scenes import place


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
    assert len(found) == 4
    data.qpos[2] = 5.0
    mujoco.mj_forward(model, data)
    nothing = closest(model, data, radius=1.0)
    assert len(nothing) == 0
    assert nothing.geom.shape == (0, 2)
    assert nothing.normal.shape == (0, 3)
    with pytest.raises(ValueError, match="no body named 'bal'; did you mean 'ball'"):
        closest(model, data, "bal", radius=1.0)
    with pytest.raises(TypeError, match=r"^radius must be a number, got 'a'"):
        closest(model, data, radius="a")
    for radius in (-1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="radius"):
            closest(model, data, radius=radius)
