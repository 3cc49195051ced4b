"""The integrator `discrete`: springs, dampers and servos at any stiffness, implicit in position."""

import mujoco
import numpy as np
import pytest

from test_integrators import engine_of, pendulum

GRAVITY = 9.81
PRESSED = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/><body pos="0 0 .3">
  <joint type="slide" axis="0 0 1" stiffness="{stiffness}" damping="{damping}" springref="-.22"/>
  <geom type="box" size=".1 .1 .1" mass="1"/></body></worldbody></mujoco>"""
REACHING = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/><body pos="0 0 .5">
  <joint name="a" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1" contype="0" conaffinity="0"/>
  <body pos=".3 0 0"><joint name="b" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass=".5"/></body></body></worldbody>
  <actuator><position joint="a" kp="{kp}" kv="{kv}"/><position joint="b" kp="{kp}" kv="{kv}"/>
  </actuator></mujoco>"""
JOINED = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/>
  <body pos="0 0 .1"><joint type="slide" axis="0 0 1"/><joint type="slide" axis="1 0 0"/>
    <geom type="box" size=".1 .1 .1" mass="1"/><site name="low"/></body>
  <body pos="0 0 .5"><joint type="slide" axis="0 0 1"/>
    <geom type="box" size=".1 .1 .1" mass="2"/><site name="high"/></body></worldbody>
  <tendon><spatial stiffness="{stiffness}" damping="20" springlength=".4">
    <site site="low"/><site site="high"/></spatial></tendon></mujoco>"""


@pytest.mark.parametrize("timestep", [0.001, 0.004, 0.01])
@pytest.mark.parametrize(("stiffness", "damping"), [(1e3, 1.0), (1e5, 10.0), (1e7, 100.0)])
def test_the_floor_bears_what_a_spring_presses_with(stiffness, damping, timestep):
    """A box falls, drawn down by a spring that would pull it 2 cm deep; omega H is up to 32."""
    engine, data = engine_of(
        PRESSED.format(stiffness=stiffness, damping=damping), "discrete", timestep
    )
    start = engine.energy(data)
    most = start.kinetic + start.potential
    for _ in range(int(1.5 / timestep)):
        engine.step(data)
        energy = engine.energy(data)
        assert energy.kinetic + energy.potential + energy.elastic <= most
    assert abs(data.qvel[0]) < 1e-9
    force = engine.contacts(data).force[:, 0].sum()
    assert force == pytest.approx(GRAVITY + stiffness * (data.qpos[0] + 0.22), rel=1e-9)
    assert data.qpos[0] == pytest.approx(-0.2, abs=4e-4)


@pytest.mark.parametrize("timestep", [0.002, 0.01])
@pytest.mark.parametrize(("kp", "kv"), [(50.0, 1.0), (2e3, 20.0)])
def test_an_arm_presses_as_its_servos_turn_it(kp, kv, timestep):
    """The force on the tip balances the servos about the first joint, whatever the step."""
    engine, data = engine_of(REACHING.format(kp=kp, kv=kv), "discrete", timestep)
    data.ctrl[:] = [0.9, 0.5]
    engine.step(data, int(2.0 / timestep))
    assert np.abs(data.qvel).max() < 1e-9
    contacts = engine.contacts(data)
    upper, total = data.qpos[0], data.qpos[0] + data.qpos[1]
    torque = kp * (data.ctrl[0] - upper)  # about y: down where positive
    weights = GRAVITY * (0.15 * np.cos(upper) + 0.5 * (0.3 * np.cos(upper) + 0.15 * np.cos(total)))
    up = contacts.force @ np.eye(contacts.force.shape[1], 1)[:, 0]
    borne = (up * contacts.position[:, 0]).sum()
    along = np.einsum("nij,ni->nj", contacts.frame, contacts.force[:, :3])
    turning = (along[:, 2] * contacts.position[:, 0]).sum()
    turning -= (along[:, 0] * (contacts.position[:, 2] - 0.5)).sum()
    assert borne > 0.0
    assert turning == pytest.approx(torque + weights, rel=1e-6)


@pytest.mark.parametrize("stiffness", [1e2, 1e4, 1e7])
def test_a_tendon_carries_one_body_above_another(stiffness):
    """Its spring is implicit between trees: 1e7 N/m at 4 ms is a hundred times the mass."""
    engine, data = engine_of(JOINED.format(stiffness=stiffness), "discrete", 0.004)
    engine.step(data, 2000)
    assert np.abs(data.qvel).max() < 1e-6
    assert engine.contacts(data).force[:, 0].sum() == pytest.approx(3 * GRAVITY, rel=1e-6)
    assert 0.4 - data.ten_length[0] == pytest.approx(2 * GRAVITY / stiffness, rel=1e-3)


def test_a_model_that_becomes_discrete_needs_another_engine_where_that_couples_branches():
    engine, data = engine_of(JOINED.format(stiffness=1e3), "implicitfast")
    engine.model.opt.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    before = data.qpos.copy()
    with pytest.raises(ValueError, match="became discrete after the engine was made"):
        engine.step(data)
    np.testing.assert_array_equal(data.qpos, before)


def test_a_model_that_becomes_discrete_steps_where_its_trees_are_as_before():
    engine, data = engine_of(pendulum('stiffness="3"', 'damping=".2"'), "implicitfast")
    engine.model.opt.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    engine.step(data, 100)
    assert np.isfinite(data.qpos).all()
    assert any("integrator=discrete" in f.name for f in engine.report().features)
