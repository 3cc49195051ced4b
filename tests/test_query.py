"""What all contact queries share: checks of arguments, engines and models, threads."""

from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.query import closest, distance, time_of_impact
from query_geoms import CONVEX
from query_scenes import geom, scene


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
