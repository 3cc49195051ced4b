"""Many worlds of dashpot.warp: independent, reset one by one, captured, flagged."""

import mujoco
import numpy as np
import pytest

import dashpot
from piles import heap
from random_scenes import random_scene
from scene import free_body, mjcf
from warp_worlds import Worlds, dw, model_of, wp

from dashpot.warp.memory import forget  # isort: skip

COUNT = 24


def tumbling(worlds, seed=0):
    """Give every world a start of its own."""
    rng = np.random.default_rng(seed)
    qvel = rng.normal(size=worlds.d.qvel.shape).astype(np.float32)
    worlds.d.qvel.assign(qvel)
    return qvel


def begin_anew(worlds):
    """As `reset_data`, which compiles kernels at every call."""
    worlds.d.qpos.assign(worlds.model.qpos0[None].astype(np.float32))
    none = wp.zeros(1, dtype=wp.bool)
    state = worlds.d.dashpot
    inputs = [none, False, worlds.m.nq, state.memory, state.work]
    wp.launch(forget, dim=worlds.d.nworld, inputs=inputs)


def boxes(timestep=0.002):
    bodies = free_body("a", 'type="box" size="0.05 0.04 0.03"', (0, 0, 0.06))
    bodies += free_body("b", 'type="capsule" size="0.03 0.04"', (0.02, 0, 0.16))
    return model_of(mjcf(bodies), timestep)


def test_worlds_are_those_alone_bit_for_bit_in_any_order():
    model = boxes()
    together = Worlds(model, nworld=COUNT, nconmax=16)
    qvel = tumbling(together)
    together.step(60)
    qpos = together.d.qpos.numpy()
    order = np.random.default_rng(1).permutation(COUNT)
    mixed = Worlds(model, nworld=COUNT, nconmax=16)
    mixed.d.qvel.assign(qvel[order])
    mixed.step(60)
    np.testing.assert_array_equal(mixed.d.qpos.numpy(), qpos[order])
    alone = Worlds(model, nconmax=16)
    for world in range(COUNT):
        begin_anew(alone)
        alone.d.qvel.assign(qvel[world : world + 1])
        alone.step(60)
        np.testing.assert_array_equal(alone.qpos, qpos[world])


def test_a_reset_world_begins_anew_and_leaves_others_alone():
    worlds, other = (Worlds(boxes(), nworld=3, nconmax=16) for _ in range(2))
    fresh = Worlds(boxes(), nworld=3, nconmax=16)
    for each in (worlds, other):
        tumbling(each)
        each.step(50)
    dw.reset_data(worlds.m, worlds.d, wp.array([False, True, False], dtype=wp.bool))
    worlds.step(50)
    other.step(50)
    fresh.step(50)
    np.testing.assert_array_equal(worlds.d.qpos.numpy()[1], fresh.d.qpos.numpy()[1])
    np.testing.assert_array_equal(worlds.d.qpos.numpy()[::2], other.d.qpos.numpy()[::2])


def test_a_world_goes_on_elsewhere_with_its_memory():
    model = boxes()
    worlds = Worlds(model, nworld=2, nconmax=16)
    tumbling(worlds)
    worlds.step(200)
    data = mujoco.MjData(model)
    memory = dw.get_data_into(data, model, worlds.d, 1)
    other = Worlds(model, nconmax=16)
    other.d = dw.put_data(model, data, nconmax=16, memory=memory)
    other.capture()
    other.step(50)
    worlds.step(50)
    np.testing.assert_array_equal(other.qpos, worlds.d.qpos.numpy()[1])
    with pytest.raises(ValueError, match="of another model or nconmax"):
        dw.put_data(model, data, nconmax=20, memory=memory)


def test_a_graph_takes_the_steps_that_calls_take():
    called, launched = (Worlds(boxes(), nworld=2, nconmax=16) for _ in range(2))
    tumbling(called)
    tumbling(launched)
    for _ in range(20):
        dw.step(called.m, called.d)
    launched.step(20)
    np.testing.assert_array_equal(called.d.qpos.numpy(), launched.d.qpos.numpy())


def test_a_step_reads_nothing_back(monkeypatch):
    worlds = Worlds(boxes(), nconmax=16)

    def refuse(*_):
        raise AssertionError("the host reads from the device in a step")

    monkeypatch.setattr(wp.array, "numpy", refuse)
    dw.step(worlds.m, worlds.d)


def test_forward_changes_no_state_and_finds_the_weight():
    worlds = Worlds(
        model_of(mjcf(free_body("b", 'type="box" size=".1 .1 .1" mass="2"', (0, 0, 0.1))))
    )
    worlds.step(500)
    before = worlds.d.qpos.numpy().copy(), worlds.d.qvel.numpy().copy()
    dw.forward(worlds.m, worlds.d)
    np.testing.assert_array_equal(worlds.d.qpos.numpy(), before[0])
    np.testing.assert_array_equal(worlds.d.qvel.numpy(), before[1])
    assert worlds.d.qfrc_constraint.numpy()[0, 2] == pytest.approx(2 * 9.81, rel=1e-4)


def test_rollouts_are_steps():
    worlds, other = (Worlds(boxes(), nworld=2, nconmax=16) for _ in range(2))
    tumbling(worlds)
    tumbling(other)
    qpos, qvel = dw.rollout(worlds.m, worlds.d, 15)
    other.step(15)
    np.testing.assert_array_equal(qpos.numpy()[-1], other.d.qpos.numpy())
    np.testing.assert_array_equal(qvel.numpy()[-1], other.d.qvel.numpy())
    with pytest.raises(ValueError, match="ctrl must have shape"):
        dw.rollout(worlds.m, worlds.d, 2, ctrl=wp.zeros((3, 2, 0)))


def test_materials_masses_and_gravity_differ_from_world_to_world():
    """Sags m g / k of three worlds in one launch."""
    body = free_body("ball", 'type="sphere" size="0.1" mass="1"', (0, 0, 0.1))
    model = model_of(mjcf(body))
    worlds = Worlds(model, nworld=3, nconmax=8, materials={"ball": dashpot.Material(1e4)})
    dw.set_material(worlds.m, "ball", stiffness=[1e4, 2e4, 4e4])
    mass = np.tile(model.body_mass.astype(np.float32), (3, 1))
    mass[:, 1] = [1.0, 2.0, 1.0]
    inertia = np.tile(model.body_inertia.astype(np.float32), (3, 1, 1))
    inertia[1] *= 2.0
    worlds.m.body_mass = wp.array(mass)
    worlds.m.body_inertia = wp.array(inertia, dtype=wp.vec3)
    gravity = np.array([[0, 0, -9.81], [0, 0, -9.81], [0, 0, -1.62]], dtype=np.float32)
    worlds.m.opt.gravity = wp.array(gravity, dtype=wp.vec3)
    worlds.capture()
    worlds.step(1500)
    sag = 0.1 - worlds.d.qpos.numpy()[:, 2]
    np.testing.assert_allclose(sag, [9.81e-4, 9.81e-4, 0.405e-4], rtol=2e-3)


def test_what_does_not_fit_is_flagged():
    worlds = Worlds(model_of(mjcf(heap(8, size=0.05, half=0.1, seed=3))), nconmax=3)
    worlds.m.opt.warn_overflow = 0
    worlds.capture()
    worlds.step(400)
    assert worlds.d.dashpot.overflow.numpy()[0] == 1


def test_a_diverged_world_harms_no_other():
    worlds, other = (Worlds(boxes(), nworld=3, nconmax=16) for _ in range(2))
    qvel = tumbling(worlds)
    other.d.qvel.assign(qvel)
    qvel[1, 0] = np.nan
    worlds.d.qvel.assign(qvel)
    worlds.step(30)
    other.step(30)
    np.testing.assert_array_equal(worlds.d.dashpot.diverged.numpy(), [0, 1, 0])
    np.testing.assert_array_equal(worlds.d.qpos.numpy()[::2], other.d.qpos.numpy()[::2])


def test_given_stiffness_that_is_not_resolved_is_counted():
    body = free_body("b", 'type="box" size=".1 .1 .1" mass="0.01"', (0, 0, 0.1))
    materials = {"b": dashpot.Material(1e9)}
    worlds = Worlds(model_of(mjcf(body), 0.01), materials=materials)
    worlds.step(10)
    assert worlds.d.dashpot.clipped.numpy()[0] > 0
    assert np.isfinite(worlds.qpos).all()


@pytest.mark.parametrize("distance", [100.0, 1000.0])
def test_far_from_the_origin_it_stops_nearly_where_it_should(distance):
    """Coordinates have ulps of 8 and 61 um there; friction knows its way by velocities."""
    body = 'type="box" size="0.1 0.1 0.05" mass="1" friction="0.2"'
    model = model_of(mjcf(free_body("box", body, (distance, 0, 0.05)), floor='friction="0.2"'))

    def push(_, data):
        data.qvel[0] = 1.0

    worlds = Worlds(model, start=push)
    worlds.step(500)
    way = worlds.qpos[0] - distance
    assert way == pytest.approx(1 / (2 * 0.2 * 9.81), abs=1e-7 * distance + 2e-6)


def test_random_scenes_keep_their_numbers():
    for seed in range(2):
        scene = random_scene(seed, steps=60)
        model = mujoco.MjModel.from_xml_string(scene.xml)
        model.opt.timestep = scene.timestep

        def start(_, data, scene=scene):
            data.qvel[:] = scene.velocity.ravel()

        worlds = Worlds(model, start=start, nconmax=60, materials=scene.materials)
        worlds.step(60)
        assert np.isfinite(worlds.qpos).all(), seed
        assert worlds.d.dashpot.diverged.numpy()[0] == 0
