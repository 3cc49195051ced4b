"""Far jumps of mocap bodies that hold something: motions, unless what is held goes along."""

import math

import mujoco
import numpy as np
import pytest

from dashpot import Engine

WELD = """<mujoco><option timestep="0.002" gravity="0 0 {gravity}"/><worldbody>
  <body name="hand" mocap="true" pos="0 0 1"/>
  <body name="tool" pos="0 0 1"><freejoint/><geom size="0.1" mass="1"/></body>
</worldbody><equality><weld body1="hand" body2="tool"/></equality></mujoco>"""
TIMECONST = 0.02  # s, of the engine's follower and MuJoCo's default solref


def scene(gravity=0.0, **options):
    """Return an engine and data that know the first pose."""
    engine = Engine(mujoco.MjModel.from_xml_string(WELD.format(gravity=gravity)), **options)
    data = engine.make_data()
    engine.step(data, nstep=10)
    return engine, data


def follower(time):
    """Return the part of a jump that a critically damped follower has gone."""
    return 1.0 - (1.0 + time / TIMECONST) * np.exp(-time / TIMECONST)


@pytest.mark.parametrize("impact", ["none", "cut"])
@pytest.mark.parametrize("gravity", [0.0, -9.81])
@pytest.mark.parametrize("jump", [0.2, 1.0])
def test_a_welded_tool_follows_a_far_jump_as_a_near_one(jump, gravity, impact):
    engine, data = scene(gravity, impact=impact)
    data.mocap_pos[0, 0] = jump
    time = engine.model.opt.timestep * np.arange(1, 101)
    way = []
    for _ in time:
        engine.step(data)
        way.append(data.qpos[0])
    # The spring of the weld, 5e4 1/s^2, is far faster than the follower.
    assert np.asarray(way) == pytest.approx(jump * follower(time), abs=0.03 * jump)
    assert data.qpos[0] == pytest.approx(jump, abs=1e-3 * jump)


def test_a_welded_tool_turns_by_a_quarter_at_once_told():
    engine, data = scene()
    data.mocap_quat[0] = math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)
    engine.step(data, nstep=100)
    assert 2.0 * math.atan2(data.qpos[6], data.qpos[3]) == pytest.approx(math.pi / 2, abs=1e-3)


@pytest.mark.parametrize(
    ("tool", "equality"),
    [
        ('pos="0 0 1"', '<weld body1="hand" body2="tool"/>'),
        ('pos="0 0 1"', '<weld body1="tool" body2="hand"/>'),
        ('pos="0 0 1"', '<connect body1="hand" body2="tool" anchor="0 0 0"/>'),
        (
            'pos="0 0.3 1" quat="1 0 0 1"',
            '<weld body1="hand" body2="tool" relpose="0 0.3 0 1 0 0 1"/>',
        ),
    ],
)
def test_a_tool_that_is_far_from_its_hand_at_first_is_fetched_as_after_a_jump(tool, equality):
    xml = WELD.format(gravity=0.0).replace('name="tool" pos="0 0 1"', f'name="tool" {tool}')
    xml = xml.replace('<weld body1="hand" body2="tool"/>', equality)
    engine = Engine(mujoco.MjModel.from_xml_string(xml))
    data = engine.make_data()
    data.mocap_pos[0, 0] = jump = 0.5  # before any step, as resets do
    time = engine.model.opt.timestep * np.arange(1, 101)
    way = []
    for _ in time:
        engine.step(data)
        way.append(data.qpos[0])
    # As in test_a_welded_tool_follows_a_far_jump_as_a_near_one.
    assert np.asarray(way) == pytest.approx(jump * follower(time), abs=0.03 * jump)
    mujoco.mj_kinematics(engine.model, data)
    assert data.body("tool").xpos[0] == pytest.approx(jump, abs=1e-3 * jump)


def test_a_tool_that_is_turned_away_from_its_hand_at_first_is_turned_back():
    engine = Engine(mujoco.MjModel.from_xml_string(WELD.format(gravity=0.0)))
    data = engine.make_data()
    data.qpos[3:7] = math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)
    engine.step(data, nstep=100)
    assert 2.0 * math.atan2(data.qpos[6], data.qpos[3]) == pytest.approx(0.0, abs=2e-3)


def test_what_is_taken_along_by_its_position_stays_at_rest():
    engine, data = scene()
    for state in (data.qpos, data.mocap_pos[0]):
        state[:3] = 2.0, -1.0, 3.0
    engine.step(data)
    # Positions differ by rounding.
    assert abs(data.qvel).max() < 1e-9
    assert data.qpos[:3] == pytest.approx([2.0, -1.0, 3.0], abs=1e-12)


def test_a_hand_that_holds_nothing_now_jumps():
    engine, data = scene()
    data.eq_active[0] = 0
    data.mocap_pos[0, 0] = 1.0
    engine.step(data)
    assert abs(data.qvel).max() == 0.0
    mujoco.mj_kinematics(engine.model, data)
    engine.step(data)
    assert data.body("hand").xpos[0] == 1.0


def test_a_far_jump_within_a_step_throws_nothing():
    engine, data = scene(mocap_timeconst=0.0)
    data.mocap_pos[0, 0] = 1.0
    engine.step(data, nstep=100)
    # The hand would go at 500 m/s; the tool is recovered at 0.1 m/s instead.
    assert abs(data.qvel).max() < 0.2
    assert data.qpos[0] == pytest.approx(0.02, abs=0.005)
