"""Springs and servos on free bodies give them no energy."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine, Material

BAR = '<geom name="bar" type="box" size=".03 .1 .12" mass="1.5"/><site name="top" pos=".02 0 .12"/>'
TENDON = """<tendon><spatial stiffness="{}" springlength=".3">
  <site site="hook"/><site site="top"/></spatial></tendon>"""


def make(timestep, body=BAR, rest="", *, option="", joint="<freejoint/>", floor=""):
    return Engine(
        mujoco.MjModel.from_xml_string(
            f'<mujoco><option timestep="{timestep}" {option}/><worldbody>{floor}'
            f'<site name="hook" pos="0 0 1.8"/><body name="bar" pos="0 0 1.4">{joint}{body}</body>'
            f"</worldbody>{rest}</mujoco>"
        )
    )


def energies(engine, data, duration):
    """Return the kinetic and potential energy, and the total, each 50 ms from now on, J."""
    found = []
    for _ in range(round(duration / 0.05)):
        now = engine.energy(data)
        found.append([now.kinetic + now.potential, now.total])
        engine.step(data, nstep=round(0.05 / engine.model.opt.timestep))
    return np.array(found)


@pytest.mark.parametrize("option", ["", 'integrator="implicitfast"'])
@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("stiffness", [200, 5000])
def test_a_body_on_a_spring_keeps_its_energy(stiffness, timestep, option):
    # Under the force of the start of each step the stiff one diverges from 2 ms on.
    engine = make(timestep, rest=TENDON.format(stiffness), option=option)
    data = engine.make_data()
    data.qvel[3:] = 1, 2, 1
    found = energies(engine, data, 10.0)
    assert np.ptp(found, axis=0).max() < 4000 * timestep**2
    assert data.qpos[2] > 0.5  # it hangs on it still


def test_a_body_on_a_spring_of_its_joint_swings_as_long_as_it_should():
    stiffness, mass = 150.0, 1.5
    joint = f'<joint type="free" stiffness="{stiffness}"/>'
    errors = []
    for timestep in (0.002, 0.004):
        engine = make(timestep, joint=joint, option='gravity="0 0 0"')
        data = engine.make_data()
        data.qpos[0] += 0.1
        engine.step(data, nstep=round(10.0 / timestep))
        errors.append(abs(data.qpos[0] - 0.1 * np.cos(10.0 * np.sqrt(stiffness / mass))))
    # Of second order; the phase of 100 rad is late by (omega H)^2 / 24 of it.
    assert errors[0] < 0.1 * 100 * 0.02**2 / 24
    assert errors[0] < errors[1] / 3


def test_a_body_that_hangs_on_a_spring_stays():
    engine = make(0.005, rest=TENDON.format(200))
    data = engine.make_data()
    # Its site hangs below the hook, its centre of mass below the site.
    length = 0.3 + 1.5 * 9.81 / 200
    tilt = np.arctan2(0.02, 0.12)
    data.qpos[:3] = 0, 0, 1.8 - length - np.hypot(0.02, 0.12)
    data.qpos[3:] = np.cos(tilt / 2), 0, -np.sin(tilt / 2), 0
    start = data.qpos.copy()
    engine.step(data, nstep=1000)
    assert data.qpos == pytest.approx(start, abs=1e-12)


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_a_pivoted_body_on_a_spring_keeps_its_energy(timestep):
    """Equalities hold it in all steps; it had 4 times its energy after 5 s at 1 ms."""
    rest = (
        '<equality><connect body1="bar" anchor=".02 0 .12"/></equality>'
        '<tendon><spatial stiffness="200" springlength=".1"><site site="low"/><site site="foot"/>'
        "</spatial></tendon>"
    )
    engine = make(
        timestep,
        BAR + '<site name="foot" pos=".02 0 -.15"/>',
        rest,
        option='gravity="0 0 0"',
        floor='<site name="low" pos=".2 0 1"/>',
    )
    data = engine.make_data()
    data.qvel[3:] = 0, 4, 1
    data.qvel[:3] = -np.cross(data.qvel[3:], [0.02, 0, 0.12])
    mujoco.mj_kinematics(engine.model, data)
    pivot = data.site("top").xpos.copy()
    found = energies(engine, data, 5.0)
    mujoco.mj_kinematics(engine.model, data)
    # The equality holds its pivot in place.
    np.testing.assert_allclose(data.site("top").xpos, pivot, atol=1e-3)
    assert np.ptp(found[:, 0]) < 3000 * timestep**2


@pytest.mark.parametrize("timestep", [0.001, 0.005])
def test_a_body_bounces_under_a_spring(timestep):
    engine = make(
        timestep,
        rest=TENDON.format(50).replace('".3"', '"1.2"'),
        floor='<geom name="floor" type="plane" size="9 9 1"/>',
    )
    engine.set_pair_material("bar", "floor", Material(1e4, restitution=1.0, friction=0.0))
    data = engine.make_data()
    data.qpos[2] = 0.5
    data.qvel[3:] = 1, 2, 1
    start, total, touched, hits = engine.energy(data), [], False, 0
    for _ in range(round(5.0 / timestep)):
        touches = engine.step(data).touching > 0
        hits += touches and not touched
        touched = touches
        total.append(engine.energy(data).total)
    # It falls from 0.4 m, and is thrown back: bounces of the spring's rate and of free fall.
    assert hits >= 5
    assert np.ptp(total) < 250 * timestep**2
    # Elastic and without friction: all that goes is what overlap that recovers gives or takes.
    assert engine.energy(data).mechanical == pytest.approx(start.mechanical, rel=0.01)


@pytest.mark.parametrize("timestep", [0.001, 0.005])
def test_a_servo_on_a_free_body_gives_it_no_energy_unseen(timestep):
    rest = '<actuator><position site="top" refsite="hook" gear="0 0 1 0 0 0" kp="400"/></actuator>'
    engine = make(timestep, rest=rest, option='gravity="0 0 0"')
    data = engine.make_data()
    data.ctrl[0] = -0.2
    found = energies(engine, data, 10.0)
    swing = 0.5 * 400 * (1.8 - 1.52 - 0.2) ** 2
    # Half a step of the turn omega H = 16 H, of either sign.
    assert found[:, 0].max() == pytest.approx(swing, rel=1e-3 + 0.5 * 16 * timestep)
    assert np.ptp(found[:, 1]) < 2000 * timestep**2


def test_a_part_whose_weight_is_compensated_holds_the_rest_as_a_pendulum():
    child = '<body name="float" pos="0 0 .3" gravcomp="1"><geom size=".05" mass="1.5"/></body>'
    engine = make(0.002, BAR + child)
    model, data = engine.model, engine.make_data()
    data.qpos[3:] = np.cos(0.3), np.sin(0.3), 0, 0
    found, float_body = [], model.body("float").id
    for _ in range(200):
        now = engine.energy(data)
        mujoco.mj_kinematics(model, data)
        lift = 9.81 * model.body_mass[float_body] * data.xipos[float_body, 2]
        found.append(now.kinetic + now.potential - lift)
        engine.step(data, nstep=10)
    assert np.ptp(found) < 2e-3


@pytest.mark.parametrize("timestep", [0.001, 0.002])
def test_a_body_on_a_hardening_spring_of_its_joint_keeps_its_energy(timestep):
    # f = -k1 x - k3 |x|^2 x, at the largest stretch with the frequency 47 rad/s.
    joint = '<joint type="free" stiffness="10 0 1.1e5"/>'
    engine = make(timestep, joint=joint, option='gravity="0 0 0"')
    data = engine.make_data()
    data.qpos[0] += 0.1
    found = energies(engine, data, 10.0)
    stretched = 0.5 * 10 * 0.1**2 + 0.25 * 1.1e5 * 0.1**4
    assert found[0, 0] == pytest.approx(stretched, rel=1e-12)
    # Second order in the phase of a step.
    assert np.ptp(found[:, 0]) < (47 * timestep) ** 2 * stretched


def test_servos_of_a_disabled_group_do_nothing():
    servo = '<position group="3" site="top" refsite="hook" gear="1 0 0 0 0 0" kp="1000"/>'
    engine = make(
        0.002,
        rest=f"<actuator>{servo}</actuator>",
        option='gravity="0 0 0" actuatorgroupdisable="3"',
    )
    data = engine.make_data()
    data.qvel[0] = 0.3
    engine.step(data, nstep=1000)
    assert data.qvel[0] == pytest.approx(0.3, abs=1e-12)
    assert engine.energy(data).work == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("timestep", [0.000125, 0.001, 0.002])
@pytest.mark.parametrize("shaken", [1.8, 3.0])
def test_a_heavy_table_on_a_spring_keeps_its_swing_under_what_hops_on_it(shaken, timestep):
    """The ball is a fifty-thousandth of it. The table swung nine times as far after ten seconds.

    A tree that left its rows, and could not lead because they barred its way, moved as if it led.
    """
    omega = 2.0 * np.pi * 30.0
    speed = shaken * 9.81 / omega
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}"/><worldbody>
        <body pos="0 0 -.05"><joint type="slide" axis="0 0 1" stiffness="{1000 * omega**2}"
            springref="{9.81 / omega**2}"/>
          <geom name="table" type="box" size="2 .2 .05" mass="1000"/></body>
        <body pos="0 0 .01"><freejoint/><geom name="ball" size=".01" mass=".02"/></body>
        </worldbody></mujoco>"""
    )
    engine = Engine(model)
    for geom in ("ball", "table"):
        engine.set_material(geom, Material(restitution=0.0))
    data = engine.make_data()
    data.qvel[0] = data.qvel[3] = speed
    engine.step(data, nstep=round(1.0 / timestep))
    velocity = []
    for _ in range(round(2.0 / 30.0 / timestep)):
        engine.step(data)
        velocity.append(data.qvel[0])
    # Landings and departures are exact to second order in omega H = 0.19 and 0.38, of either sign.
    tolerance = 0.01 + 0.4 * (omega * timestep) ** 2
    assert np.ptp(velocity) / 2.0 == pytest.approx(speed, rel=tolerance)
