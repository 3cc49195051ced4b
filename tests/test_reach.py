"""Detection reaches as far as bodies move in a step."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import dashpot
from reach import starts_and_misses

SCENES_PER_TEST = 25


@pytest.mark.parametrize("first", range(0, 100, SCENES_PER_TEST))
def test_no_contact_that_starts_inside_a_step_is_missed(first):
    results = [starts_and_misses(seed) for seed in range(first, first + SCENES_PER_TEST)]
    assert sum(len(started) for started, _ in results) > 0
    assert [misses for _, misses in results if misses] == []


def corner_to_corner() -> dashpot.Engine:
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option gravity="0 0 0" timestep="0.01"/><worldbody>
        <body><freejoint/><geom type="box" size=".1 .1 .1"/></body>
        <body pos=".3 .3 .3"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
        </worldbody></mujoco>"""
    )
    return dashpot.Engine(model)


def test_boxes_that_will_meet_corner_to_corner():
    """Seen from either, the other is beyond an edge: face clipping finds no point."""
    engine = corner_to_corner()
    data = engine.make_data()
    data.qvel[6:9] = -15.0
    engine.step(data)
    assert data.ncon > 0
    assert data.contact.dist[0] == pytest.approx(0.1 * 3**0.5, rel=1e-6)


def test_a_callback_that_steps_another_model_takes_nothing_from_the_reach():
    """Boxes that will meet corner to corner, found after the filter has stepped other ones."""
    engine, other = corner_to_corner(), corner_to_corner()
    data, theirs = engine.make_data(), other.make_data()
    data.qvel[6:9] = theirs.qvel[6:9] = -15.0

    def step_other(*_) -> int:
        mujoco.set_mjcb_contactfilter(None)
        other.step(theirs)
        return 0

    mujoco.set_mjcb_contactfilter(step_other)
    try:
        engine.step(data)
    finally:
        mujoco.set_mjcb_contactfilter(None)
    assert theirs.ncon == data.ncon == 1


def test_reach_leaves_the_model_as_it_was():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
        <body pos="0 0 1"><freejoint/><geom size=".1" margin=".01" gap=".02"/></body>
        </worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qvel[2] = -50.0
    before = engine.model.body_margin.copy(), engine.model.geom_gap.copy()
    engine.step(data)
    assert engine.model.body_margin.tolist() == before[0].tolist()
    assert engine.model.geom_gap.tolist() == before[1].tolist()


def test_a_contact_that_no_joint_can_close_is_left_out():
    """A sled on a rail beside a wall is within reach of it at speed, but moves along it."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option gravity="0 0 0" timestep="0.01"/><worldbody>
        <geom type="plane" size="9 9 1"/>
        <body pos="0 0 .1001"><joint type="slide" axis="1 0 0"/>
        <geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qvel[0] = 1.0
    stats = engine.step(data)
    assert data.maxuse_con > 0  # MuJoCo has found them
    assert stats.contacts == stats.islands == 0
    assert data.qpos[0] == pytest.approx(0.01, rel=1e-15)


@pytest.mark.parametrize(("tilt", "contacts"), [(0.0, 0), (0.01, 4)])
def test_a_link_that_turns_beside_another_is_left_out_if_its_joint_keeps_it_apart(tilt, contacts):
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0" timestep="0.01" cone="elliptic"/><worldbody>
        <geom type="box" size=".1 .1 .1"/>
        <body pos="0 0 .2001"><joint axis="{tilt} 0 1" damping="0"/>
        <geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qvel[0] = 0.5
    stats = engine.step(data)
    assert stats.contacts == data.maxuse_con == contacts


@pytest.mark.parametrize(("speed", "gap"), [(100.0, 1e-3), (60.0, 5e-4)])
def test_a_cam_that_comes_around_within_a_step_meets_the_wall(speed, gap):
    """Its contact moves along the wall at first, and closes with the turn, 0.6 and 1 rad."""
    eccentricity, radius = 0.008, 0.1
    wall = radius - eccentricity + gap
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0" timestep="0.01" cone="elliptic"/><worldbody>
        <geom type="box" size=".1 1 1" pos="{wall + 0.1} 0 0"/>
        <body><joint axis="0 0 1"/><geom size="{radius}" pos="-{eccentricity} 0 0" mass="1"/></body>
        </worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qvel[0] = speed
    engine.step(data)
    assert wall - radius + eccentricity * np.cos(data.qpos[0]) > -1e-4
