"""Contacts of dashpot.warp beside the C++ engine: what single precision leaves of its accuracy."""

import mujoco
import numpy as np
import pytest

from piles import heap
from scene import free_body, mjcf
from scenes import ball_drop, gripper, slide, slope, stack
from warp_worlds import Worlds, energy, engine_of, model_of, worlds_of


@pytest.mark.parametrize("timestep", [0.002, 0.010])
def test_a_bouncing_ball_is_that_of_the_engine(timestep):
    scene = ball_drop()
    worlds = worlds_of(scene, timestep, nconmax=8)
    engine, data = engine_of(scene, timestep)
    worst = 0.0
    for _ in range(round(3 / timestep)):
        worlds.step()
        engine.step(data)
        worst = max(worst, np.abs(worlds.qpos - data.qpos).max())
    assert worst < 1e-5


@pytest.mark.parametrize("timestep", [0.002, 0.010])
def test_nothing_creeps_on_a_slope(timestep):
    worlds = worlds_of(slope(), timestep, nconmax=8)
    worlds.step(round(1 / timestep))
    before = worlds.positions()[:3]
    worlds.step(round(9 / timestep))
    assert np.linalg.norm(worlds.positions()[:3] - before) < 1e-9


@pytest.mark.parametrize("timestep", [0.002, 0.010])
def test_a_sliding_box_stops_where_that_of_the_engine_does(timestep):
    scene = slide()
    worlds = worlds_of(scene, timestep, nconmax=8)
    engine, data = engine_of(scene, timestep)
    steps = round(scene.duration / timestep)
    worlds.step(steps)
    engine.step(data, steps)
    assert abs(worlds.qpos[0] - data.qpos[0]) < 2e-6
    assert np.abs(worlds.qvel).max() < 1e-6


def test_ten_boxes_sag_as_springs_do():
    worlds = worlds_of(stack(), 0.005, nconmax=40)
    worlds.step(600)
    height = worlds.positions().reshape(-1, 7)[:, 2]
    sag = np.diff(0.05 * (2 * np.arange(10) + 1) - height, prepend=0.0)
    exact = 9.81 * np.arange(10, 0, -1) / 4e5
    assert np.abs(sag - exact).max() < 2e-7


@pytest.mark.parametrize("timestep", [0.002, 0.005])
def test_a_rolling_ellipsoid_keeps_its_energy(timestep):
    """Frozen at the start of a step its contact would pump energy in proportion to the step."""
    body = free_body(
        "body", 'type="ellipsoid" size="0.1 0.08 0.06" mass="1" friction="1"', (0, 0, 0.06)
    )

    def roll(model, data):
        spin = np.array([0.0, 5.0, 0.5])
        data.qvel[:3], data.qvel[3:6] = -np.cross(spin, [0, 0, -0.06]), spin

    model = model_of(mjcf(body), timestep)
    worlds = Worlds(model, start=roll, nconmax=8)
    before = energy(model, worlds.qpos, worlds.qvel)
    for _ in range(6):
        worlds.step(round(0.5 / timestep))
        assert energy(model, worlds.qpos, worlds.qvel) == pytest.approx(before, rel=2e-3)


def test_a_pile_of_eight_comes_to_rest_with_little_overlap():
    model = model_of(mjcf(heap(8, size=0.05, half=0.2, seed=3)), 0.001)
    worlds = Worlds(model, nconmax=64)
    data = mujoco.MjData(model)
    overlaps = []
    for _ in range(100):
        worlds.step(10)
        data.qpos[:] = worlds.qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        overlaps.append([-c.dist for c in data.contact if c.dist < 0])
    assert np.mean(np.concatenate(overlaps)) < 6e-6
    assert np.max(np.concatenate(overlaps)) < 3e-4
    assert not worlds.d.dashpot.overflow.numpy().any()


def test_blocks_and_trees_couple_alike():
    """Beyond 64 contacts their forces are summed up body by body."""
    model = model_of(mjcf(heap(8, size=0.05, half=0.2, seed=3)), 0.001)
    by_blocks, by_trees = (Worlds(model, nconmax=nconmax) for nconmax in (64, 65))
    assert [worlds.d.dashpot.by_trees for worlds in (by_blocks, by_trees)] == [False, True]
    for worlds in (by_blocks, by_trees):
        worlds.step(130)  # some have landed; later they part by the chaos of a pile
    np.testing.assert_allclose(by_trees.qpos, by_blocks.qpos, atol=1e-5)


def test_a_world_has_room_for_fourteen_hundred_contacts():
    side, count = 19, 350
    bodies = "".join(
        free_body(
            f"b{i}",
            'type="box" size="0.05 0.05 0.05" mass="1"',
            (0.15 * (i % side), 0.15 * (i // side), 0.05),
        )
        for i in range(count)
    )
    worlds = Worlds(model_of(mjcf(bodies)), nconmax=1600)
    worlds.step(20)
    assert worlds.d.dashpot.rows.count.numpy()[0] == 4 * count
    push = worlds.d.qfrc_constraint.numpy()[0].reshape(count, 6)[:, 2]
    np.testing.assert_allclose(push, 9.81, rtol=0.05)
    assert not worlds.d.dashpot.overflow.numpy().any()


def test_a_gripper_holds_what_is_shaken():
    scene, timestep = gripper(), 0.005
    worlds = worlds_of(scene, timestep, nconmax=24)
    model, data = worlds.model, mujoco.MjData(worlds.model)
    address = [model.jnt_qposadr[model.joint(j).id] for j in ("left", "hand_y", "hand_z")]
    held = model.jnt_qposadr[model.joint("held").id]
    relative = []
    for i in range(2000):
        data.time = i * timestep
        scene.drive(model, data)
        worlds.d.ctrl.assign(data.ctrl[None].astype(np.float32))
        worlds.step()
        q = worlds.qpos
        relative.append(q[held : held + 3] - [0, 0, 1] - q[address])
    relative = np.array(relative)
    slip = relative[-100:].mean(axis=0) - relative[300:400].mean(axis=0)
    assert np.linalg.norm(slip) < 2e-5
