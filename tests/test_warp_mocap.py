"""Mocap bodies of dashpot.warp: what they push, carry and hold goes with them."""

import math

import mujoco
import numpy as np
import pytest

import dashpot
from warp_worlds import Worlds, dw, model_of

OPTION = '<option gravity="0 0 -9.81"/>'
HELD = (
    f'<mujoco>{OPTION}<worldbody><body name="hand" mocap="true" pos="0 0 1"/>'
    '<body name="tool" pos="0.1 0 1" quat="0.9 0.1 0.2 0.3"><freejoint/>'
    '<geom type="box" size="0.1 0.05 0.02" mass="1"/></body></worldbody>'
    "<equality><{}/></equality></mujoco>"
)
WELD = HELD.format('weld body1="{}" body2="{}" torquescale="0.5"')
CONNECT = HELD.format('connect body1="{}" body2="{}" anchor="0.05 0 0"')
ARM = (
    f'<mujoco>{OPTION}<worldbody><body name="hand" mocap="true" pos="0.6 0 0">'
    '<site name="hand"/></body><body><joint axis="0 1 0" damping="0.1"/>'
    '<geom type="capsule" fromto="0 0 0 0.3 0 0.2" size="0.02"/><body pos="0.3 0 0.2">'
    '<joint axis="0 1 0" damping="0.1"/><site name="tip" pos="0.3 0 -0.2"/>'
    '<geom type="capsule" fromto="0 0 0 0.3 0 -0.2" size="0.02"/></body></body></worldbody>'
    '<equality><connect site1="hand" site2="tip"/></equality></mujoco>'
)
FINGER = (
    f'<mujoco>{OPTION}<worldbody><geom type="plane" size="5 5 .1"/>'
    '<body name="hand" mocap="true" pos="-0.3 0 0.1"><body pos="0.05 0 0">'
    '<joint type="slide" axis="1 0 0" stiffness="500" damping="20"/>'
    '<geom type="box" size=".02 .05 .05" mass="0.2"/></body></body><body pos="0 0 0.05">'
    '<freejoint/><geom type="box" size=".05 .05 .05" mass="0.1" friction="0.2"/></body>'
    "</worldbody></mujoco>"
)


def both(xml, command, *, timestep=0.002, seconds=0.5, timeconst=0.02, nconmax=4):
    """Return positions at all steps under `command(t)`, of a world and of the engine."""
    model = model_of(xml, timestep)
    worlds = Worlds(model, nconmax=nconmax, mocap_timeconst=timeconst)
    engine = dashpot.Engine(model, mocap_timeconst=timeconst)
    data = engine.make_data()
    worlds.step()
    engine.step(data)  # both know the first pose
    ways = []
    for i in range(1, round(seconds / timestep) + 1):
        position, turn = command(i * timestep)
        data.mocap_pos[0], data.mocap_quat[0] = position, turn
        worlds.d.mocap_pos.assign(np.array([[position]], dtype=np.float32))
        worlds.d.mocap_quat.assign(np.array([[turn]], dtype=np.float32))
        worlds.step()
        engine.step(data)
        ways.append((worlds.positions(), data.qpos.copy()))
    return np.array(ways).transpose(1, 0, 2)


def wave(t):
    """Return a pose that leaves (0, 0, 1) from rest."""
    position = [0.1 * (1 - math.cos(3 * t)), 0.05 * (1 - math.cos(5 * t)), 1.0]
    angle = 0.5 * (1 - math.cos(t))
    return position, [math.cos(angle), 0.6 * math.sin(angle), 0, 0.8 * math.sin(angle)]


@pytest.mark.parametrize("timeconst", [0.0, 0.02])
@pytest.mark.parametrize("bodies", [("hand", "tool"), ("tool", "hand")])
def test_a_welded_tool_moves_as_in_the_engine(bodies, timeconst):
    # An impedance that no load changes; both are of second order in what the hand turns.
    xml = WELD.format(*bodies).replace("<weld", '<weld solimp="0.95 0.95 0.001"')
    ours, theirs = both(xml, wave, timeconst=timeconst)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=3e-5)


@pytest.mark.parametrize("bodies", [("hand", "tool"), ("tool", "hand")])
def test_a_tool_on_a_ball_joint_moves_as_near_to_the_converged_motion_as_in_the_engine(bodies):
    xml = CONNECT.format(*bodies)
    ours, theirs = both(xml, wave, timeconst=0.0, seconds=0.3)
    _, exact = both(xml, wave, timestep=0.000125, timeconst=0.0, seconds=0.3)
    assert np.abs(ours[-1] - exact[-1]).max() < 1.5 * np.abs(theirs[-1] - exact[-1]).max()


@pytest.mark.parametrize("jump", [0.05, 0.3])
def test_a_jump_is_followed_as_in_the_engine(jump):
    ours, theirs = both(WELD.format("hand", "tool"), lambda _: ([jump, 0, 1], [1, 0, 0, 0]))
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=5e-5)
    assert ours[-1, 0] == pytest.approx(0.1 + jump, abs=1e-4)


def test_an_arm_that_a_hand_holds_follows_it_as_in_the_engine():
    ours, theirs = both(ARM, lambda t: ([0.6, 0, 0.1 * math.sin(4 * t)], [1, 0, 0, 0]))
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=2e-5)


def test_a_finger_on_joints_of_a_hand_pushes_at_the_speed_of_the_hand():
    def command(t):
        return [-0.3 + 0.3 * t, 0, 0.1], [1, 0, 0, 0]

    ours, theirs = both(FINGER, command, seconds=1.0, nconmax=24)
    # The hit comes within 0.14 mm of the engine's; then the box is pushed at 0.3 m/s.
    np.testing.assert_allclose(ours[:, :4], theirs[:, :4], rtol=0, atol=3e-4)
    assert (ours[-1, 1] - ours[-51, 1]) / 0.1 == pytest.approx(0.3, rel=1e-2)


def test_motion_goes_on_from_a_saved_world_bit_for_bit():
    model = model_of(WELD.format("hand", "tool"))
    first = Worlds(model, nconmax=4)
    first.step()
    first.d.mocap_pos.assign(np.array([[[0.1, 0, 1]]], dtype=np.float32))
    first.step(5)
    data = mujoco.MjData(model)
    memory = dw.get_data_into(data, model, first.d)
    second = Worlds(model, nconmax=4)
    second.d = dw.put_data(model, data, nconmax=4, memory=memory)
    second.capture()
    for worlds in (first, second):
        worlds.step(50)
    np.testing.assert_array_equal(first.qpos, second.qpos)


def test_a_belt_that_users_move_carries_what_lies_on_it():
    """A mocap plate that accelerates at 2 m/s^2, less than friction bears, and then stops."""
    xml = (
        f'<mujoco>{OPTION}<worldbody><body name="plate" mocap="true" pos="0 0 -0.05">'
        '<geom type="box" size="2 0.5 0.05"/></body><body pos="0 0 0.05"><freejoint/>'
        '<geom type="box" size="0.05 0.05 0.05" mass="1"/></body></worldbody></mujoco>'
    )
    timestep = 0.002
    worlds = Worlds(model_of(xml, timestep), nconmax=12)
    place = np.array([[[0.0, 0.0, -0.05]]], dtype=np.float32)
    worlds.step(100)
    for i in range(1, 251):
        place[0, 0, 0] = (i * timestep) ** 2
        worlds.d.mocap_pos.assign(place)
        worlds.step()
        np.testing.assert_array_equal(worlds.d.mocap_pos.numpy(), place)
    # It sticks: the box has the way of the plate, but for the give of friction's springs.
    assert worlds.qpos[0] == pytest.approx(place[0, 0, 0], abs=2e-4)
    assert worlds.qvel[0] == pytest.approx(1.0, abs=5e-3)


def test_a_wall_that_users_move_pushes_a_ball_without_lag():
    xml = (
        f'<mujoco>{OPTION}<worldbody><geom type="plane" size="5 5 .1"/>'
        '<body name="wall" mocap="true" pos="-0.2 0 0.1"><geom type="box" size="0.05 0.5 0.1"/>'
        '</body><body pos="0 0 0.1"><freejoint/><geom type="sphere" size="0.1" mass="1"/></body>'
        "</worldbody></mujoco>"
    )
    worlds = Worlds(model_of(xml), nconmax=8)
    place = np.array([[[-0.2, 0.0, 0.1]]], dtype=np.float32)
    for i in range(1, 501):
        place[0, 0, 0] = -0.2 + i * 0.002 * 0.5
        worlds.d.mocap_pos.assign(place)
        worlds.step()
        assert worlds.qpos[0] > place[0, 0, 0] + 0.15 - 1e-3  # never deep in the wall
    assert worlds.qvel[0] >= 0.5 - 1e-2
