"""Static equilibrium: contact forces carry loads exactly and sags are load over stiffness."""

import mujoco
import numpy as np
import pytest

import dashpot
from scene import GRAVITY, free_body, mjcf

TIMESTEPS = (0.001, 0.002, 0.005, 0.010)
BALL = 'type="sphere" size="0.1" mass="2"'


def settle(xml, materials, timestep, time=3.0):
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.timestep = timestep
    engine = dashpot.Engine(model)
    for geom, material in materials.items():
        engine.set_material(geom, material)
    data = engine.make_data()
    engine.step(data, nstep=round(time / timestep))
    return engine, data


@pytest.mark.parametrize("timestep", TIMESTEPS)
@pytest.mark.parametrize("stiffness", [1e3, 1e4, 1e6])
def test_ball_sinks_by_weight_over_stiffness(stiffness, timestep):
    xml = mjcf(free_body("ball", BALL, (0, 0, 0.1)))
    engine, data = settle(xml, {"ball": dashpot.Material(stiffness)}, timestep)
    # Critically damped at >= 22 rad/s for 3 s: exp(-66), so rounding is all there is. The velocity
    # rounds to 1e-14 m/s.
    assert 0.1 - data.qpos[2] == pytest.approx(2 * GRAVITY / stiffness, abs=1e-12)
    contacts = engine.contacts(data)
    assert contacts.force[:, 0].sum() == pytest.approx(2 * GRAVITY, rel=1e-9)
    assert np.abs(data.qvel).max() <= 1e-12


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_box_on_four_corners(timestep):
    box = 'type="box" size="0.1 0.06 0.05" mass="3"'
    xml = mjcf(free_body("box", box, (0, 0, 0.05)))
    _, data = settle(xml, {"box": dashpot.Material(2e4)}, timestep)
    assert 0.05 - data.qpos[2] == pytest.approx(3 * GRAVITY / 8e4, rel=1e-9)
    assert np.abs(data.qvel).max() <= 1e-10


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_rigid_contact_force_is_the_weight(timestep):
    engine, data = settle(mjcf(free_body("ball", BALL, (0, 0, 0.1))), {}, timestep, 1.0)
    assert engine.contacts(data).force[:, 0].sum() == pytest.approx(2 * GRAVITY, rel=1e-9)
    # Micro-steps h of at most 0.2 ms resolve frequencies of about 0.2 / h: sag g / (0.2 / h)^2.
    assert 0 < 0.1 - data.qpos[2] <= 1e-5


@pytest.mark.parametrize("timestep", [0.001, 0.010])
def test_ball_in_a_groove(timestep):
    """Two frictionless planes at 45 deg: each carries m g / sqrt(2), the ball sinks m g / k."""
    stiffness = 1e5
    side = 'type="plane" size="0 0 1" condim="1"'
    quat = np.cos(np.pi / 8), np.sin(np.pi / 8)
    xml = f"""<mujoco><option gravity="0 0 -{GRAVITY}"/><worldbody>
      <geom name="left" {side} quat="{quat[0]} {quat[1]} 0 0"/>
      <geom name="right" {side} quat="{quat[0]} {-quat[1]} 0 0"/>
      {free_body("ball", BALL + ' condim="1"', (0, 0, 0.1 * 2**0.5))}
    </worldbody></mujoco>"""
    engine, data = settle(xml, {"ball": dashpot.Material(stiffness)}, timestep)
    # The two damped springs are coupled; after 3 s both have settled to rounding.
    expected = 2 * GRAVITY / 2**0.5
    np.testing.assert_allclose(engine.contacts(data).force[:, 0], expected, rtol=1e-7)
    assert 0.1 * 2**0.5 - data.qpos[2] == pytest.approx(2 * GRAVITY / stiffness, rel=1e-7)


@pytest.mark.parametrize("timestep", [0.001, 0.010])
def test_applied_force_adds_to_the_weight(timestep):
    model = mujoco.MjModel.from_xml_string(mjcf(free_body("ball", BALL, (0, 0, 0.1))))
    model.opt.timestep = timestep
    engine = dashpot.Engine(model)
    engine.set_material("ball", dashpot.Material(1e5))
    data = engine.make_data()
    data.xfrc_applied[1, 2] = -50.0
    engine.step(data, nstep=round(2 / timestep))
    assert engine.contacts(data).force[:, 0].sum() == pytest.approx(50 + 2 * GRAVITY, rel=1e-9)


def test_two_materials_are_springs_in_series():
    xml = mjcf(free_body("ball", BALL, (0, 0, 0.1)))
    materials = {"ball": dashpot.Material(3e4), "floor": dashpot.Material(6e4)}
    _, data = settle(xml, materials, 0.002)
    assert 0.1 - data.qpos[2] == pytest.approx(2 * GRAVITY / 2e4, abs=1e-12)


def test_a_pair_material_overrides_both():
    model = mujoco.MjModel.from_xml_string(mjcf(free_body("ball", BALL, (0, 0, 0.1))))
    engine = dashpot.Engine(model)
    engine.set_material("ball", dashpot.Material(3e4))
    engine.set_pair_material("floor", "ball", dashpot.Material(5e4))
    data = engine.make_data()
    engine.step(data, nstep=1500)
    assert 0.1 - data.qpos[2] == pytest.approx(2 * GRAVITY / 5e4, abs=1e-12)


def soft_ball(height, stiffness):
    """Return an engine and data of a ball of 1 kg on a floor, its centre `height` (m) above it."""
    xml = mjcf(free_body("ball", 'type="sphere" size="0.1" mass="1"', (0, 0, height)))
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    engine.set_material("ball", dashpot.Material(stiffness))
    return engine, engine.make_data()


@pytest.mark.parametrize("stiffness", [1e3, 1e5])
@pytest.mark.parametrize("overlap", [0.0, 0.5, 1.0, 2.0])
def test_soft_ball_rests_at_its_sag_whatever_overlap_it_starts_from(stiffness, overlap):
    sag = GRAVITY / stiffness
    engine, data = soft_ball(0.1 - overlap * sag, stiffness)
    engine.step(data)
    if overlap == 1.0:  # it is at rest from the start; gravity's work on 2 ms rounds
        assert abs(data.qvel[2]) < 1e-12
    engine.step(data, nstep=4000)
    assert 0.1 - data.qpos[2] == pytest.approx(sag, rel=1e-9)


def test_soft_ball_at_rest_stays_so_in_a_rollout_from_its_physical_state():
    # Full-physics states carry no memory of contacts.
    engine, data = soft_ball(0.1, 1e3)
    engine.step(data, nstep=4000)
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(engine.model, kind))
    mujoco.mj_getState(engine.model, data, state, kind)
    states, _ = dashpot.rollout(engine, state, nstep=500)
    assert states[0, :, 3] == pytest.approx(data.qpos[2], abs=1e-12)


def test_soft_ball_put_into_the_floor_later_is_pushed_out_to_its_sag():
    engine, data = soft_ball(0.5, 1e3)
    engine.step(data)
    data.qpos[2], data.qvel[2] = 0.07, 0.0
    fastest = 0.0
    for _ in range(4000):
        engine.step(data)
        fastest = max(fastest, data.qvel[2])
    assert 0.1 - data.qpos[2] == pytest.approx(GRAVITY / 1e3, rel=1e-9)
    assert fastest <= 0.1 * (1 + 1e-9)  # the recovery speed


def test_soft_ball_sinks_to_its_new_sag_when_its_stiffness_falls():
    engine, data = soft_ball(0.1, 1e4)
    engine.step(data, nstep=2000)
    engine.set_material("ball", dashpot.Material(1e3))
    engine.step(data, nstep=4000)
    assert 0.1 - data.qpos[2] == pytest.approx(GRAVITY / 1e3, rel=1e-9)


def test_a_slack_tendon_over_light_bodies_leaves_a_soft_box_to_its_own_weight():
    """The trees that it joins are heavy enough for what the box is pressed in by."""
    light = """<body pos="{} 0 1"><joint name="{}" type="slide" axis="1 0 0"/>
      <geom size=".1" mass=".001" contype="0" conaffinity="0"/></body>"""
    tendon = """<tendon><fixed limited="true" range="-9 9"><joint joint="left" coef="1"/>
      <joint joint="box" coef="1"/><joint joint="right" coef="1"/></fixed></tendon>"""
    xml = f"""<mujoco><worldbody><geom type="plane" size="2 2 .1"/>{light.format(-1, "left")}
      <body pos="0 0 .095"><joint name="box" type="slide" axis="0 0 1"/>
        <geom name="box" type="box" size=".1 .1 .1" mass="10"/></body>{light.format(1, "right")}
      </worldbody>{{}}</mujoco>"""
    material = dashpot.Material(1e5, restitution=0.5)
    heights = []
    for joined in ("", tendon):
        _, data = settle(xml.format(joined), {"box": material}, 0.002, time=0.06)
        heights.append(data.joint("box").qpos[0])
    # It leaps from 5 mm of overlap, off four springs, by the closed form of one contact. Positions
    # of joints in flight are up to half a step ahead, at some 0.7 m/s.
    damping = 2 * dashpot.law.restitution_to_damping_ratio(0.5) * np.sqrt(4e5 * 10)
    leap = dashpot.law.flow_contact(
        -0.005, 0.0, -GRAVITY, 0.06, stiffness=4e5, damping=damping, inverse_mass=0.1
    )
    assert heights[0] == pytest.approx(0.005 + leap.gap, abs=0.001 * 0.7)
    # The light bodies are 2e-4 of the mass.
    assert heights[1] == pytest.approx(heights[0], rel=1e-3)
