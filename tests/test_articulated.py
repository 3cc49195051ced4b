"""Articulated trees: MuJoCo's own motion without contact, right impulses and forces with it."""

import mujoco
import numpy as np
import pytest

import dashpot
from scene import GRAVITY

MACHINE = """<mujoco>
  <option integrator="{integrator}" timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" pos="0 0 -5"/>
    <body name="arm" pos="0 0 1">
      <joint name="shoulder" type="hinge" axis="0 1 0" damping="0.3" armature="0.02"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/>
      <body pos="0.4 0 0">
        <joint name="elbow" type="hinge" axis="0 1 0.3" stiffness="2" springref="0.4"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="0.7"/>
        <body pos="0.3 0 0">
          <joint name="wrist" type="ball" damping="0.01"/>
          <geom type="box" size="0.05 0.03 0.02" pos="0.05 0 0" mass="0.3"/>
          <site name="hand" pos="0.1 0 0"/>
        </body>
      </body>
    </body>
    <body name="cart" pos="2 0 1">
      <joint name="rail" type="slide" axis="1 0 0" damping="0.5"/>
      <geom type="box" size="0.1 0.1 0.1" mass="2"/>
      <body><joint name="pole" type="hinge" axis="0 1 0" armature="0.01"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.5" size="0.02" mass="0.2"/></body>
    </body>
    <body name="walker" pos="4 0 1"><freejoint/>
      <geom type="box" size="0.1 0.2 0.05" mass="3"/>
      <body pos="0.1 0 0"><joint name="leg" type="hinge" axis="0 1 0" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.4"/></body>
    </body>
  </worldbody>
  <actuator>
    <motor name="shoulder" joint="shoulder" gear="3"/><position joint="elbow" kp="20" kv="1"/>
    <velocity joint="rail" kv="5"/>
    <general joint="pole" dyntype="filter" dynprm="0.05" gainprm="2" biastype="affine"
             biasprm="0 -1 -0.2"/>
    <intvelocity joint="leg" kp="5" actrange="-2 2"/>
  </actuator>
  <sensor>
    <accelerometer site="hand"/><gyro site="hand"/><jointpos joint="elbow"/>
    <actuatorfrc actuator="shoulder"/><framelinacc objtype="body" objname="walker"/>
  </sensor>
</mujoco>"""


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit", "RK4"])
def test_without_contact_the_motion_is_mujocos_to_the_bit(integrator):
    model = mujoco.MjModel.from_xml_string(MACHINE.format(integrator=integrator))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)  # MuJoCo integrates then
    engine = dashpot.Engine(model)
    ours, theirs = engine.make_data(), mujoco.MjData(model)
    names = ["qpos", "qvel", "act", "ctrl", "qacc_warmstart", "sensordata"]
    # What RK4 has computed last is of its fourth stage in mj_step, here of the start of the step.
    if integrator != "RK4":
        names += ["qacc", "qfrc_actuator"]
    rng = np.random.default_rng(0)
    velocity = rng.normal(size=model.nv)
    ours.qvel[:], theirs.qvel[:] = velocity, velocity
    for step in range(300):
        control = rng.normal(size=model.nu)
        ours.ctrl[:], theirs.ctrl[:] = control, control
        if step % 50 == 0:
            push = rng.normal(size=6)
            ours.xfrc_applied[2], theirs.xfrc_applied[2] = push, push
        engine.step(ours)
        mujoco.mj_step(model, theirs)
        for name in names:
            assert getattr(ours, name).tobytes() == getattr(theirs, name).tobytes(), (name, step)
    assert ours.time == theirs.time


def pendulum(timestep: float, links: int) -> mujoco.MjModel:
    """Horizontal chain of rods above a floor that its tip meets almost straight."""
    xml, close = "", ""
    for i in range(links):
        tip = (
            '<geom name="tip" type="sphere" size="0.02" pos="0.3 0 0" mass="0.1" condim="1"/>'
            if i == links - 1
            else ""
        )
        xml += f"""<body pos="{0.3 if i else 0} 0 {0 if i else 0.0201}">
          <joint name="joint{i}" type="hinge" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.01" mass="0.5"
                contype="0" conaffinity="0"/>{tip}"""
        close += "</body>"
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}" gravity="0 0 0"/><worldbody>
        <geom name="floor" type="plane" size="0 0 1" condim="1"/>{xml}{close}
        </worldbody></mujoco>"""
    )


@pytest.mark.parametrize("links", [1, 2, 3])
@pytest.mark.parametrize("restitution", [1.0, 0.6])
@pytest.mark.parametrize("timestep", [0.0005, 0.002])
def test_impact_of_a_chain_is_newtons(links, restitution, timestep):
    """A stiff tip leaves at -e times its approach; the joints change by M^-1 J^T p."""
    model = pendulum(timestep, links)
    engine = dashpot.Engine(model)
    engine.set_material("tip", dashpot.Material(1e6, restitution=restitution))
    data = engine.make_data()
    data.qvel[:] = [0.1, 0.2, -0.05][:links]  # positive turns the tip down
    mujoco.mj_forward(engine.model, data)
    jacobian = np.zeros((3, model.nv))
    tip = engine.model.geom("tip").id
    mujoco.mj_jacGeom(engine.model, data, jacobian, None, tip)
    row = jacobian[2:3]
    response = np.zeros_like(row)
    mujoco.mj_solveM(engine.model, data, response, row)
    before = data.qvel.copy()
    approach = (row @ before).item()
    assert approach < 0
    expected = before - response[0] * (1 + restitution) * approach / (row @ response.T).item()
    duration = 0.1e-3 / -approach + 2 * np.pi / np.sqrt(1e6 * (row @ response.T).item())
    engine.step(data, nstep=int(np.ceil(duration / timestep)) + 2)
    # The chain turns by a milliradian during flight and impact, which changes M and J by 1e-3.
    np.testing.assert_allclose(data.qvel, expected, atol=5e-3 * np.abs(expected - before).max())


@pytest.mark.parametrize("timestep", [0.0005, 0.002, 0.005])
def test_double_pendulum_on_a_floor_gains_no_energy(timestep):
    xml = """<mujoco><option timestep="0.001"/><worldbody>
      <geom name="floor" type="plane" size="0 0 1" friction="0.5"/>
      <body pos="0 0 0.5"><joint type="hinge" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.35 0 0" size="0.02" mass="1"/>
        <body pos="0.35 0 0"><joint type="hinge" axis="0 1 0"/>
          <geom name="lower" type="capsule" fromto="0 0 0 0.35 0 0" size="0.02" mass="1"/></body>
      </body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.timestep = timestep
    engine = dashpot.Engine(model)
    engine.set_material("lower", dashpot.Material(1e5, restitution=0.5))
    data = engine.make_data()
    energy = engine.energy(data)
    start = energy.kinetic + energy.potential
    scale = 2 * 0.5 * GRAVITY  # from the height of the pivot to the floor
    touched = 0
    for _ in range(round(5 / timestep)):
        touched += engine.step(data).touching
        energy = engine.energy(data)
        # MuJoCo's semi-implicit smooth step drifts by up to a percent of the scale at 5 ms.
        assert energy.kinetic + energy.potential <= start + 0.01 * scale
    assert touched > 10


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit"])
@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_arm_pressing_on_a_table(timestep, integrator):
    """At rest the contact force balances actuators and weight: J^T f = bias - actuation."""
    xml = f"""<mujoco><option timestep="{timestep}" integrator="{integrator}"/><worldbody>
      <geom name="table" type="box" size="0.4 0.4 0.05" pos="0.5 0 0.05" friction="0.8"/>
      <body pos="0 0 0.3"><joint name="shoulder" type="hinge" axis="0 1 0" damping="2"
                                 armature="0.05"/>
        <geom type="capsule" fromto="0 0 0 0.35 0 0.1" size="0.03" mass="2"
              contype="0" conaffinity="0"/>
        <body pos="0.35 0 0.1"><joint name="elbow" type="hinge" axis="0 1 0" damping="2"
                                      armature="0.05"/>
          <geom type="capsule" fromto="0 0 0 0.2 0 -0.2" size="0.03" mass="1"
                contype="0" conaffinity="0"/>
          <geom name="tip" type="sphere" size="0.03" pos="0.2 0 -0.2" mass="0.2"/></body>
      </body></worldbody>
      <actuator><position joint="shoulder" kp="200" kv="10"/>
        <position joint="elbow" kp="200" kv="10"/></actuator></mujoco>"""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    model, data = engine.model, engine.make_data()
    data.ctrl[:] = [0.3, 0.2]
    engine.step(data, nstep=round(4 / timestep))
    np.testing.assert_allclose(data.qvel, 0, atol=1e-8)  # settled at 10 1/s for 4 s
    contacts = engine.contacts(data)
    assert contacts.force.shape[0] == 1
    assert contacts.force[0, 0] > 20
    generalised = np.zeros(model.nv)
    jacobian = np.zeros((3, model.nv))
    mujoco.mj_jac(
        model, data, jacobian, None, contacts.position[0], model.geom_bodyid[model.geom("tip").id]
    )
    sign = 1 if contacts.geom[0, 1] == model.geom("tip").id else -1
    generalised = jacobian.T @ (contacts.frame[0].T @ contacts.force[0]) * sign
    np.testing.assert_allclose(
        generalised, data.qfrc_bias - data.qfrc_passive - data.qfrc_actuator, rtol=1e-5, atol=1e-6
    )
    np.testing.assert_allclose(generalised, data.qfrc_constraint, rtol=1e-9, atol=1e-9)


def test_callbacks_read_the_same_forces_within_a_call_of_many_steps():
    """Rows that hold bear what no micro-step has, and that is found only where it may be read."""
    xml = """<mujoco><option timestep="0.002"/><worldbody><geom type="plane" size="2 2 .1"/>
      <body pos="0 0 .3"><joint name="lift" type="slide" axis="0 0 1"/>
        <geom size=".02" mass="1" contype="0"  conaffinity="0"/>
        <body><joint name="swing" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 .2 0 -.25" size=".03" mass="1"/></body>
      </body></worldbody></mujoco>"""

    def seen(calls, steps):
        engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
        data = engine.make_data()
        forces = []
        mujoco.set_mjcb_control(
            lambda _, d: forces.append([d.qfrc_constraint.copy(), d.qacc.copy()])
        )
        try:
            for _ in range(calls):
                engine.step(data, nstep=steps)
        finally:
            mujoco.set_mjcb_control(None)
        return np.array(forces)

    one_by_one = seen(200, 1)
    assert np.any(one_by_one[:, 0])
    np.testing.assert_array_equal(seen(1, 200), one_by_one)


@pytest.mark.parametrize("tilt", [5e-6, -5e-6])
@pytest.mark.parametrize("gap", [1e-12, 1e-8])
def test_links_that_turn_just_above_a_floor_go_on(gap, tilt):
    """A contact that no joint can close stops nothing, however its normal speed is rounded."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody>
        <geom type="plane" size="1 1 .1"/>
        <body pos="0 0 {0.05 + gap}" euler="{np.degrees(tilt)} 0 0"><joint axis="0 0 1"/>
          <geom size=".01" mass=".1" pos=".1 0 .1" contype="0" conaffinity="0"/>
          <body pos=".2 0 0"><joint axis="0 0 1"/><geom size=".05" pos=".2 0 0" mass="1"/></body>
        </body></worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    ours, theirs = engine.make_data(), mujoco.MjData(model)
    ours.qvel[:] = theirs.qvel[:] = [3.0, -2.0]
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    for _ in range(20):
        engine.step(ours)
        mujoco.mj_step(model, theirs)
    # In contact positions are those of the time, and no longer lead by half a step.
    half_a_step = 0.5 * model.opt.timestep * np.abs(theirs.qvel).max()
    np.testing.assert_allclose(ours.qpos, theirs.qpos, atol=half_a_step)


def test_pushed_cart_feels_contact_through_its_mechanism():
    """A cart pushed into a ball by a constant force: both accelerate at F / (m1 + m2)."""
    xml = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody>
      <body name="cart"><joint type="slide" axis="1 0 0"/>
        <geom name="cart" type="box" size="0.1 0.1 0.1" mass="2"/></body>
      <body name="ball" pos="0.2 0 0"><freejoint/>
        <geom name="ball" type="sphere" size="0.1" mass="3"/></body></worldbody>
      <actuator><motor joint="cart"/></actuator></mujoco>""".replace(
        '<joint type="slide"', '<joint name="cart" type="slide"'
    )
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    engine.set_pair_material("cart", "ball", dashpot.Material(1e4))
    data = engine.make_data()
    data.ctrl[0] = 10.0
    engine.step(data, nstep=250)
    before = data.qvel[:2].copy()
    engine.step(data, nstep=250)
    np.testing.assert_allclose((data.qvel[:2] - before) / 0.5, 2.0, rtol=1e-9)
    # The spring between them carries the ball's share, 3 kg at 2 m/s^2.
    assert data.qpos[0] - (data.qpos[1] - 0.2) == pytest.approx(6 / 1e4, rel=1e-9)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit"])
@pytest.mark.parametrize("where", ["joint", "actuator"])
@pytest.mark.parametrize("quadratic", [2.0, 2000.0])
def test_quadratic_damping_is_implicit_with_rows_as_without(integrator, where, quadratic):
    """Speed falls as v_0 / (1 + c v_0 t / m); dry friction of 1 uN puts the joint into rows."""
    damping = f'damping="0 {quadratic} 0"'
    on_joint = damping if where == "joint" else ""
    # An actuator's damping counts with the square of its gear.
    halved = f'gear="2" damping="0 {quadratic / 4} 0"'
    motor = f'<motor joint="cart" {halved}/>' if where == "actuator" else ""
    xml = f"""<mujoco><option timestep="0.001" gravity="0 0 0" integrator="{integrator}"/>
      <worldbody><body><joint name="cart" type="slide" axis="1 0 0" frictionloss="1e-6" {on_joint}/>
        <geom size="0.1" mass="2"/></body></worldbody><actuator>{motor}</actuator></mujoco>"""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    data = engine.make_data()
    data.qvel[0] = 3.0
    engine.step(data, nstep=1000)
    exact = 3.0 / (1 + quadratic * 3.0 / 2)
    # First order in the step, 0.2 % of the exact change; the stiff one forgets its first steps.
    assert data.qvel[0] == pytest.approx(exact, rel=0.01)
    # Explicitly, 2000 would have multiplied the speed by -2 in the first step.
    assert data.qvel[0] > 0.0


def test_a_contact_along_a_hinge_carries_nothing():
    """A turntable in its bearing: overlap along its axis, turned any way, can move nothing."""
    table = """<mujoco><option gravity="0 0 0"/><worldbody>
      <body quat="0.7 0.3 -0.5 0.4"><geom type="box" size="1 1 .1" pos="0 0 -.1"/>
        <body><joint axis="0 0 1"/><geom type="cylinder" size=".3 .05" pos=".1 .05 .049"/></body>
      </body></worldbody></mujoco>"""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(table))
    data = engine.make_data()
    data.qvel[0] = 2.0
    for _ in range(200):
        stats = engine.step(data)
        # A spring of 1 N/m stands in for what cannot be loaded, over 1 mm.
        assert np.abs(engine.contacts(data).force).max(initial=0.0) < 2e-3
    assert stats.contacts > 0
    assert data.qvel[0] == pytest.approx(2.0, abs=1e-2)
