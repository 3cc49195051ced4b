"""Sensors and mj_contactForce report the forces that acted."""

import mujoco
import numpy as np
import pytest

import dashpot
from scenes import GRAVITY

XML = f"""<mujoco>
  <option gravity="0 0 -{GRAVITY}" timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body name="box" pos="0 0 {{height}}"><freejoint/>
      <geom name="box" type="box" size="0.1 0.1 0.05" mass="3"/>
      <site name="base" type="box" size="0.11 0.11 0.06" rgba="1 0 0 0.1"/>
      <body name="mast" pos="0 0 0.05">
        <geom type="capsule" fromto="0 0 0.03 0 0 0.3" size="0.02" mass="0.5" contype="0"
              conaffinity="0"/>
        <site name="joint"/>
      </body>
    </body>
  </worldbody>
  <sensor>
    <touch name="touch" site="base"/><force name="force" site="joint"/>
    <torque name="torque" site="joint"/><accelerometer name="accelerometer" site="base"/>
  </sensor>
</mujoco>"""


def engine_at(height: float) -> tuple[dashpot.Engine, mujoco.MjData]:
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(XML.format(height=height)))
    engine.set_material("box", dashpot.Material(1e5))
    return engine, engine.make_data()


def test_at_rest():
    engine, data = engine_at(0.05)
    engine.step(data, nstep=1000)
    # 2 s at 100 1/s and more: settled to rounding of forces of 34 N.
    assert data.sensor("touch").data.item() == pytest.approx(3.5 * GRAVITY, rel=1e-9)
    np.testing.assert_allclose(data.sensor("accelerometer").data, [0, 0, GRAVITY], atol=1e-8)
    # MuJoCo's force sensor: what the child exerts on the parent... its sign is MuJoCo's own.
    assert abs(data.sensor("force").data[2]) == pytest.approx(0.5 * GRAVITY, rel=1e-8)
    np.testing.assert_allclose(data.sensor("torque").data, 0, atol=1e-8)
    assert data.ncon == 4
    for i in range(4):
        force = np.zeros(6)
        mujoco.mj_contactForce(engine.model, data, i, force)
        assert force[0] == pytest.approx(3.5 * GRAVITY / 4, rel=1e-7)


def test_in_free_fall():
    engine, data = engine_at(2.0)
    engine.step(data, nstep=50)
    assert data.sensor("touch").data.item() == 0
    np.testing.assert_allclose(data.sensor("accelerometer").data, 0, atol=1e-12)
    np.testing.assert_allclose(data.sensor("force").data, 0, atol=1e-12)


def test_mean_of_touch_over_an_impact_is_the_impulse():
    """Touch reports the mean force of each step, so its sum times the step is m dv + m g t."""
    engine, data = engine_at(0.15)
    impulse = 0.0
    steps = 500
    for _ in range(steps):
        engine.step(data)
        impulse += data.sensor("touch").data.item() * 0.002
    gained = 3.5 * (data.qvel[2] + GRAVITY * steps * 0.002)
    assert impulse == pytest.approx(gained, rel=1e-9)


def test_inner_contact_force_balances_in_cfrc_ext():
    engine, data = engine_at(0.05)
    engine.step(data, nstep=1000)
    mujoco.mj_rnePostConstraint(engine.model, data)
    # Spatial force on the box from contacts: its last three numbers are the force.
    np.testing.assert_allclose(data.cfrc_ext[1, 3:], [0, 0, 3.5 * GRAVITY], atol=1e-7)
