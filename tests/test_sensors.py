"""Sensors and mj_contactForce report the forces that acted."""

import mujoco
import numpy as np
import pytest

import dashpot
from scene import GRAVITY

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
    # It has come to rest, so that the floor gave what weight took in the second.
    assert abs(data.qvel[2]) < 1e-9
    assert impulse == pytest.approx(3.5 * GRAVITY * steps * 0.002, rel=1e-9)


def test_inner_contact_force_balances_in_cfrc_ext():
    engine, data = engine_at(0.05)
    engine.step(data, nstep=1000)
    mujoco.mj_rnePostConstraint(engine.model, data)
    # Spatial force on the box from contacts: its last three numbers are the force.
    np.testing.assert_allclose(data.cfrc_ext[1, 3:], [0, 0, 3.5 * GRAVITY], atol=1e-7)


TUMBLING = f"""<mujoco>
  <option gravity="0 0 -{GRAVITY}" timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" condim="6" friction="0.6 0.01 0.002"/>
    <body name="box" pos="0 0 0.12" quat="0.9 0.3 0.2 0.1"><freejoint/>
      <geom name="box" type="box" size="0.1 0.08 0.05" mass="1" condim="6"/>
      <site name="centre"/>
    </body>
    <body name="ball" pos="0.05 0 0.4"><freejoint/>
      <geom name="ball" type="sphere" size="0.06" mass="0.5" condim="6"/>
    </body>
  </worldbody>
  <sensor>
    <contact name="contact" geom1="box" num="8" data="found force torque pos normal"/>
    <accelerometer name="accelerometer" site="centre"/>
    <gyro name="gyro" site="centre"/>
  </sensor>
</mujoco>"""


def tumbling() -> tuple[dashpot.Engine, mujoco.MjData]:
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(TUMBLING))
    data = engine.make_data()
    data.qvel[:] = [0.5, 0.2, 0, 3, -2, 4, 0, 0, -1, 0, 5, 3]
    return engine, data


def test_contact_forces_of_every_direction_agree_everywhere():
    """mj_contactForce, contact sensor and Engine.contacts, over a tumble with six directions."""
    engine, data = tumbling()
    seen, twisted = 0, 0.0
    for _ in range(300):
        engine.step(data)
        contacts = engine.contacts(data)
        wrenches = np.zeros((data.ncon, 6))
        for i, wrench in enumerate(wrenches):
            mujoco.mj_contactForce(engine.model, data, i, wrench)
        reported = np.hstack([contacts.force, contacts.torque])
        # Contacts that are near but apart carry nothing and may be left out of either list.
        np.testing.assert_allclose(reported.sum(axis=0), wrenches.sum(axis=0), atol=1e-9)
        sensor = data.sensor("contact").data.reshape(8, -1)
        carried = sensor[sensor[:, 0] > 0]
        with_box = [i for i in range(data.ncon) if 1 in data.contact[i].geom]
        assert len(carried) == min(len(with_box), 8)
        for row in carried:
            match = min(with_box, key=lambda i: np.linalg.norm(data.contact[i].pos - row[7:10]))
            np.testing.assert_allclose(np.abs(row[1:7]), np.abs(wrenches[match]), atol=1e-9)
        seen += len(carried)
        twisted = max(twisted, np.abs(wrenches[:, 3:]).max(initial=0.0))
    assert seen > 100
    assert twisted > 1e-3


def test_contacts_explain_every_change_of_momentum():
    """cfrc_ext about the centres of mass, times the step, is what momentum gained beyond weight."""
    engine, data = tumbling()
    masses, largest = {"box": 1.0, "ball": 0.5}, 0.0
    for _ in range(300):
        before = data.qvel.copy()
        engine.step(data)
        mujoco.mj_rnePostConstraint(engine.model, data)
        for start, (name, mass) in zip((0, 6), masses.items(), strict=True):
            gained = mass * (data.qvel[start : start + 3] - before[start : start + 3])
            impulse = data.cfrc_ext[data.body(name).id, 3:] * 0.002
            weight = np.array([0, 0, -mass * GRAVITY * 0.002])
            np.testing.assert_allclose(gained, impulse + weight, atol=1e-10)
            largest = max(largest, impulse[2] / -weight[2])
    assert largest > 10.0


def test_accelerometer_is_the_mean_over_the_step():
    engine, data = tumbling()
    largest = 0.0
    for _ in range(300):
        before, turn = data.qvel[:3].copy(), np.zeros(9)
        mujoco.mju_quat2Mat(turn, data.qpos[3:7])
        engine.step(data)
        gained = (data.qvel[:3] - before) / 0.002 + (0, 0, GRAVITY)
        measured = turn.reshape(3, 3) @ data.sensor("accelerometer").data
        # The site is the centre of mass, so that turning adds nothing.
        np.testing.assert_allclose(measured, gained, atol=1e-8)
        largest = max(largest, np.abs(measured).max())
    assert largest > 10 * GRAVITY


def mixed_scene(sensors: str = "") -> mujoco.MjModel:
    """Return a hinged arm, a box and a ball tumbling on a floor, with every condim."""
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco><option timestep="0.002"/><worldbody>
      <geom name="floor" type="plane" size="2 2 0.1"/>
      <body pos="0 0 0.3"><joint axis="0 1 0" range="-60 60"/>
        <geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" mass="0.5"/></body>
      <body name="box" pos="0.2 0 0.5" euler="20 10 0"><freejoint/>
        <geom type="box" size="0.05 0.04 0.03" condim="4"/></body>
      <body pos="0.25 0.02 0.7"><freejoint/><geom type="sphere" size="0.04" condim="6"/></body>
    </worldbody>{sensors}</mujoco>""")


def test_rows_between_the_steps_of_one_call_are_left_out_without_consequence():
    """Only the last step of a call has MuJoCo's rows of contacts, unless a sensor reads them."""
    model = mixed_scene()
    engine = dashpot.Engine(model)
    together, apart = engine.make_data(), engine.make_data()
    engine.step(together, nstep=400)
    for _ in range(400):
        engine.step(apart)
    sensing = dashpot.Engine(
        mixed_scene('<sensor><framelinacc objtype="body" objname="box"/></sensor>')
    )
    sensed = sensing.make_data()
    sensing.step(sensed, nstep=400)
    assert together.ncon > 0
    for other in (apart, sensed):
        assert np.array_equal(together.qpos, other.qpos)
        assert np.array_equal(together.qvel, other.qvel)
    wrench = np.zeros((2, 6))
    for index in range(together.ncon):
        for of, data in zip(wrench, (together, apart), strict=True):
            mujoco.mj_contactForce(engine.model, data, index, of)
        assert np.array_equal(*wrench)


def test_a_tactile_sensor_reads_the_compression_that_a_material_gives():
    model = mujoco.MjModel.from_xml_string("""<mujoco>
      <asset><mesh name="pad" builtin="sphere" params="2" scale=".1 .1 .1"/></asset><worldbody>
      <geom name="floor" type="plane" size="5 5 .1"/>
      <body pos="0 0 .1"><freejoint/><geom name="pad" type="mesh" mesh="pad" mass="1"/></body>
      </worldbody><sensor><tactile name="skin" geom="pad" mesh="pad"/></sensor></mujoco>""")
    engine = dashpot.Engine(model)
    tactile = [f for f in engine.report().features if f.name == "sensor 'skin' tactile"]
    assert [f.treatment for f in tactile] == ["mapped"]
    assert "material" in tactile[0].note
    stiffness = 1e4
    engine.set_pair_material("pad", "floor", dashpot.Material(stiffness, damping_ratio=1.0))
    data = engine.make_data()
    engine.step(data, nstep=1000)
    # It stands on one corner of the mesh.
    assert data.sensordata.max() == pytest.approx(9.81 / stiffness, rel=1e-4)
