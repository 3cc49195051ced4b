"""Limits, equalities and dry friction: rows of the same micro-steps as contacts."""

import mujoco
import numpy as np
import pytest

import dashpot

TIMESTEPS = (1e-3, 2e-3, 5e-3)


def engine_of(xml: str, timestep: float) -> tuple[dashpot.Engine, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{xml}</mujoco>")
    model.opt.timestep = timestep
    engine = dashpot.Engine(model)
    return engine, engine.make_data()


def advance(engine: dashpot.Engine, data: mujoco.MjData, duration: float) -> None:
    engine.step(data, round(duration / engine.model.opt.timestep))


PENDULUM = """<worldbody><body><joint name="hinge" type="hinge" axis="0 1 0" {joint}/>
  <geom type="sphere" size=".05" pos=".5 0 0" mass="1" contype="0" conaffinity="0"/>
</body></worldbody>"""


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_pendulum_rests_on_its_joint_limit(timestep):
    engine, data = engine_of(PENDULUM.format(joint='range="-30 30"'), timestep)
    advance(engine, data, 2.0)
    angle = np.deg2rad(30)
    # A rigid limit sags by less than a milliradian and comes to rest.
    assert data.qpos[0] == pytest.approx(angle, abs=1e-3)
    assert abs(data.qvel[0]) < 1e-9
    # The limit carries the whole torque of gravity, m g l cos(angle), at the angle it has.
    torque = 9.81 * 0.5 * np.cos(data.qpos[0])
    assert -data.qfrc_constraint[0] == pytest.approx(torque, rel=1e-9)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_limit_reached_inside_a_step_stops_the_joint_at_it(timestep):
    slide = """<option gravity="0 0 0"/><worldbody><body>
      <joint type="slide" axis="1 0 0" range="-1 0.5"/>
      <geom type="sphere" size=".05" mass="1" contype="0" conaffinity="0"/></body></worldbody>"""
    engine, data = engine_of(slide, timestep)
    data.qvel[0] = 3.0
    overshoot = 0.0
    for _ in range(round(0.5 / timestep)):
        engine.step(data)
        overshoot = max(overshoot, data.qpos[0] - 0.5)
    # Unseen until the next step it would overshoot by up to v dt: 3 mm at 1 ms, 15 mm at 5 ms.
    assert overshoot < 1.5e-3
    # Critically damped without load its force is zero two time constants after it began, when the
    # speed is exp(-2) of what it was; nothing holds it afterwards.
    assert data.qvel[0] == pytest.approx(-3.0 * np.exp(-2.0), rel=1e-9)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_dry_friction_above_the_torque_holds_for_good(timestep):
    engine, data = engine_of(PENDULUM.format(joint='frictionloss="5"'), timestep)
    advance(engine, data, 1.0)
    held = data.qpos[0]
    advance(engine, data, 5.0)
    # 4.905 N m of gravity against 5 N m: elastic give, then nothing, to rounding.
    assert abs(held) < 1e-3
    assert data.qpos[0] == pytest.approx(held, abs=1e-12)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_dry_friction_below_the_force_takes_its_limit_off(timestep):
    slide = """<worldbody><body><joint type="slide" axis="0 0 1" frictionloss="5"/>
      <geom type="sphere" size=".05" mass="1" contype="0" conaffinity="0"/></body></worldbody>"""
    engine, data = engine_of(slide, timestep)
    advance(engine, data, 1.0)
    # (g - 5 N / 1 kg) t^2 / 2; the friction spring takes a moment to reach the limit, a part of a
    # step of 5 m/s^2.
    assert data.qvel[0] == pytest.approx(-4.81, abs=5.0 * timestep)
    assert data.qpos[0] == pytest.approx(-2.405, abs=5.0 * timestep)


@pytest.mark.parametrize("timestep", [2e-3, 5e-3])
def test_a_trace_of_dry_friction_leaves_a_swing_as_it_is(timestep):
    swing = """<option gravity="0 0 0"/><worldbody><body><joint type="slide" axis="0 0 1"
      stiffness="900" {}/><geom type="sphere" size=".05" mass="1" contype="0" conaffinity="0"/>
      </body></worldbody>"""
    engine, data = engine_of(swing.format('frictionloss="1e-9"'), timestep)
    data.qpos[0] = 0.1
    advance(engine, data, 10.0)
    # The spring acts along in 13 micro-steps: its phase is early by phase (omega dt / 13)^2 / 24,
    # and nothing of the swing is lost.
    phase, angle = 30.0 * 10.0, 30.0 * timestep / 13
    early = phase * angle**2 / 24
    assert data.qpos[0] == pytest.approx(0.1 * np.cos(phase + early), abs=0.1 * (early + angle**2))
    assert data.qpos[0] ** 2 + (data.qvel[0] / 30.0) ** 2 == pytest.approx(0.01, rel=angle**2)


def test_a_motor_weaker_than_dry_friction_moves_nothing_but_in_mujoco_where_that_creeps():
    slide = """<option gravity="0 0 0"/><worldbody><body><joint name="finger" type="slide" {}/>
      <geom type="sphere" size=".05" mass="0.5" contype="0" conaffinity="0"/></body></worldbody>
      <actuator><motor joint="finger"/></actuator>"""
    rubbing = slide.format('frictionloss="5"')
    engine, data = engine_of(rubbing, 2e-3)
    data.ctrl[:] = force = 4.0
    advance(engine, data, 2.0)
    assert abs(data.qvel[0]) < 1e-12
    mapped = [feature.name for feature in engine.report().of("mapped")]
    assert "joint 'finger' frictionloss" in mapped
    # MuJoCo's row has the impedance d_0 = 0.9 at any load, the width's 0.95 and a time constant of
    # 20 ms: a damper of 947/s times the mass. One of the model's own moves a finger so here, too.
    damper = 2 * 0.9 / (0.1 * 0.95 * 0.02) * 0.5
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{rubbing}</mujoco>")
    creeping = mujoco.MjData(model)
    creeping.ctrl[:] = force
    mujoco.mj_step(model, creeping, 1000)
    assert creeping.qvel[0] == pytest.approx(force / damper, rel=1e-9)
    engine, data = engine_of(slide.format(f'damping="{damper}"'), 2e-3)
    data.ctrl[:] = force
    advance(engine, data, 2.0)
    assert data.qvel[0] == pytest.approx(force / damper, rel=1e-9)


def test_dry_friction_dissipates_its_limit_times_the_way():
    slide = """<worldbody><body><joint type="slide" axis="0 0 1" frictionloss="5"/>
      <geom type="sphere" size=".05" mass="1" contype="0" conaffinity="0"/></body></worldbody>"""
    engine, data = engine_of(slide, 1e-3)
    advance(engine, data, 0.5)
    way = -data.qpos[0]
    # Loading its spring takes less than the first millimetre, 5 mJ, and the semi-implicit update is
    # half a step of velocity ahead of the motion that friction resists, 5 N * 2.4 m/s * 0.5 ms.
    assert engine.energy(data).dissipated_constraint == pytest.approx(5.0 * way, abs=1e-2)


def test_a_weld_carries_a_body_without_drift():
    scene = """<worldbody><body name="load" pos="0 0 1"><freejoint/>
      <geom type="box" size=".1 .1 .1" mass="2" pos=".2 0 0" contype="0" conaffinity="0"/></body>
      </worldbody><equality><weld body1="load"/></equality>"""
    engine, data = engine_of(scene, 2e-3)
    advance(engine, data, 4.0)
    settled = data.qpos.copy()
    assert np.abs(settled - (0, 0, 1, 1, 0, 0, 0)).max() < 1e-4
    advance(engine, data, 4.0)
    assert np.abs(data.qpos - settled).max() < 1e-9
    # It carries the weight and its moment about the body frame.
    assert data.qfrc_constraint[2] == pytest.approx(2 * 9.81, rel=1e-6)
    assert data.qfrc_constraint[4] == pytest.approx(-2 * 9.81 * 0.2, rel=1e-4)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_coupled_joints_share_their_acceleration(timestep):
    scene = """<option gravity="0 0 0"/><worldbody>
      <body><joint name="a" type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>
      <body pos="0 1 0"><joint name="b" type="slide" axis="1 0 0"/><geom size=".1" mass="3"/></body>
      </worldbody><equality><joint joint1="a" joint2="b" polycoef="0 2 0 0 0"/></equality>
      <actuator><motor joint="b"/></actuator>"""
    engine, data = engine_of(scene, timestep)
    data.ctrl[0] = 7.0
    advance(engine, data, 1.0)
    # x_a = 2 x_b: 7 N move 3 kg + 2^2 * 1 kg, one metre per second squared.
    assert data.qvel[1] == pytest.approx(1.0, abs=2e-3)
    assert data.qpos[1] == pytest.approx(0.5, abs=2e-3)
    assert data.qpos[0] == pytest.approx(2.0 * data.qpos[1], abs=1e-5)


def test_a_tendon_limit_holds_the_load():
    scene = """<worldbody><site name="top" pos="0 0 2"/><body pos="0 0 1.2">
      <joint type="slide" axis="0 0 1"/><geom size=".05" mass="1"/><site name="load"/></body>
      </worldbody><tendon><spatial limited="true" range="0 1"><site site="top"/>
      <site site="load"/></spatial></tendon>"""
    engine, data = engine_of(scene, 2e-3)
    advance(engine, data, 3.0)
    # The load drops 0.2 m until the tendon is 1 m long, and hangs.
    assert data.qpos[0] == pytest.approx(-0.2, abs=1e-4)
    assert data.qfrc_constraint[0] == pytest.approx(9.81, rel=1e-9)


@pytest.mark.parametrize("timestep", [1e-3, 1e-2])
@pytest.mark.parametrize("restitution", [1.0, 0.8, 0.5, 0.1])
def test_rigid_material_bounces_with_its_restitution(restitution, timestep):
    scene = """<worldbody><geom type="plane" size="0 0 1"/><body pos="0 0 1.1"><freejoint/>
      <geom name="ball" type="sphere" size=".1" mass="1"/></body></worldbody>"""
    engine, data = engine_of(scene, timestep)
    engine.set_material("ball", dashpot.Material(restitution=restitution))
    while data.qvel[2] <= 0.0:
        engine.step(data)
    engine.step(data, 2)
    speed = np.sqrt(data.qvel[2] ** 2 + 2 * 9.81 * (data.qpos[2] - 0.1))
    # Gravity acts during the contact, which a rigid material makes half a millisecond long, and 1.5
    # at the longer step: g times that, relative to an impact at 4.43 m/s.
    longest = 0.5e-3 + 0.1 * timestep
    assert speed / np.sqrt(2 * 9.81) == pytest.approx(restitution, abs=9.81 * longest / 4.43)


COUPLED = """<option timestep="2e-3"/><worldbody>
  <body><joint name="a" type="slide" axis="0 0 1"/><geom size=".05" mass="1"/></body>
  <body pos="1 0 0"><freejoint/><geom size=".05" mass="1"/></body>
  <body pos="2 0 0"><joint name="b" type="slide" axis="0 0 1"/><geom size=".05" mass="2"/></body>
  <body pos="3 0 0"><joint name="c" type="slide" axis="0 0 1"/><geom size=".05" mass="3"/></body>
</worldbody><tendon><fixed name="sum" limited="true" range="{low} 10">
  <joint joint="a" coef="1"/><joint joint="b" coef="2"/><joint joint="c" coef="3"/>
</fixed></tendon>"""


def test_a_tendon_over_three_bodies_carries_them_all():
    engine, data = engine_of(COUPLED.format(low=-0.6), 2e-3)
    advance(engine, data, 5.0)
    slides = [0, 7, 8]
    # Weights m g against a tension T times 1, 2, 3: T = g holds all three, 0.1 m below the start
    # (1 z + 2 z + 3 z = -0.6); the body between them falls freely.
    np.testing.assert_allclose(data.qfrc_constraint[slides], 9.81 * np.array([1, 2, 3]), rtol=1e-9)
    assert data.qpos[[0, 8, 9]] @ [1, 2, 3] == pytest.approx(-0.6, abs=1e-4)
    # MuJoCo's semi-implicit update falls up to g h t / 2 ahead of the parabola.
    assert data.qpos[3] == pytest.approx(-0.5 * 9.81 * 5.0**2, abs=0.05)


def test_bodies_that_a_tendon_may_couple_fall_freely_while_it_is_slack():
    engine, data = engine_of(COUPLED.format(low=-1000), 2e-3)
    data.qvel[:] = start = np.array([0.1, 0.2, 0.3, 0.4, 1.0, 2.0, 3.0, 0.5, 0.6])
    advance(engine, data, 0.2)
    places, rates = [1, 2, 3, 0, 8, 9], [1, 2, 3, 0, 7, 8]  # in qpos and qvel, all but turns
    fall = 0.5 * 9.81 * 0.2**2 * np.array([0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    moved = start[rates] * 0.2 - fall
    found = (data.qpos - engine.model.qpos0)[places]
    np.testing.assert_allclose(found, moved, rtol=0, atol=1e-12)


def test_equalities_that_contradict_each_other_pull_a_body_between_them():
    """A ball tied to three places on a line and, three times, to one aside of it."""
    sites = "".join(f'<site name="s{i}" pos="{x} 0 1"/>' for i, x in enumerate((0, 0.02, 0.04)))
    ties = "".join(f'<connect site1="s{i}" site2="ball"/>' for i in (0, 1, 2, 1, 1))
    engine, data = engine_of(
        f"""<worldbody>{sites}<body pos=".3 0 1"><freejoint/><geom size=".05" mass="1"/>
          <site name="ball" pos="0 .05 0"/></body></worldbody><equality>{ties}</equality>""",
        2e-3,
    )
    speed = 0.0
    for _ in range(5000):
        engine.step(data)
        speed = max(speed, np.abs(data.qvel).max())
    place = data.site("ball").xpos
    # Alike in stiffness, the five springs balance near the middle one, a tenth of the way between
    # two of them off, for what each bore on the way there goes on; the weight sags them.
    np.testing.assert_allclose(place, [0.02, 0.0, 1.0], atol=2e-3)
    # Displacement recovers the 0.3 m: no more speed than a pendulum of that length gains.
    assert speed < np.sqrt(2 * 9.81 * 0.3) / 0.05


def test_joints_rest_on_their_limits_though_a_contact_lies_on_an_axis():
    """Caps of two capsules coincide on the hip's axis: nothing moves along their contact."""
    capsule = 'type="capsule" size=".08" solref=".02 1" solimp="0 .8 .01"'
    engine, data = engine_of(
        f"""<option gravity="0 0 0"/><worldbody><geom {capsule} fromto="0 0 0 .2 .2 0"/>
          <body pos=".2 .2 0"><joint name="hip" axis="0 0 1" range="-30 30" damping="1"/>
            <geom {capsule} fromto="0 0 0 .2 .2 0"/>
            <body pos=".2 .2 0"><joint axis="1 -1 0" range="-20 20" damping="1"/>
              <geom {capsule} fromto="0 0 0 .4 .4 0"/></body></body></worldbody>""",
        2e-3,
    )
    torque = np.array([7.5, -7.5])
    data.qfrc_applied[:] = torque
    advance(engine, data, 6.0)
    assert (engine.contacts(data).gap < -0.15).all()
    # Rigid limits give by the torque over their stiffness, some 1e-7 rad.
    np.testing.assert_allclose(data.qpos, np.radians([30, -20]), atol=1e-5)
    # At rest nothing but the limits carries the torques.
    np.testing.assert_allclose(data.qfrc_constraint, -torque, rtol=1e-9)


def test_a_soft_limit_of_a_ball_joint_holds_its_load_all_around():
    """A pendulum that precesses at its limit: J changes sign with the axis of the angle."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><compiler angle="radian"/>
      <option timestep="0.002" gravity="0 0 9.81"/><worldbody><body pos="0 0 1">
        <joint type="ball" limited="true" range="0 0.6" solreflimit="0.05 1"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.5" size=".02" mass="1" contype="0"
          conaffinity="0"/></body></worldbody></mujoco>""")
    engine = dashpot.Engine(model)
    data = engine.make_data()
    mujoco.mju_axisAngle2Quat(data.qpos, np.array([np.cos(1.2), np.sin(1.2), 0.0]), 0.6)
    engine.step(data, nstep=1000)
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, data.qpos)
    up = np.array([0.0, 0.0, 1.0])
    data.qvel[:] = 2.0 * (rotation.reshape(3, 3).T @ up - up)
    axial, across = model.body_inertia[1].min(), model.body_inertia[1].max() + 0.25**2
    torque, expected, sides = [], [], set()
    for _ in range(500):
        engine.step(data)
        torque.append(np.linalg.norm(data.qfrc_constraint))
        sides.add(np.sign(data.qpos[0] * data.qpos[1]))
        # Against the weight, and to turn the angular momentum with the axis, at 2 rad/s.
        mujoco.mju_quat2Mat(rotation, data.qpos)
        cosine = rotation[8]
        turning = 2.0**2 * (across * cosine + axial * (1.0 - cosine))
        expected.append(np.sqrt(1.0 - cosine**2) * (9.81 * 0.25 + turning))
    assert sides == {-1.0, 1.0}
    # The mean of a second, in which it sinks into the soft limit by 0.04 rad.
    assert np.mean(torque) == pytest.approx(np.mean(expected), rel=5e-3)
    # It dropped to a tenth in one step, and recovery took half a joule.
    assert np.abs(np.diff(torque)).max() < 0.02 * np.mean(torque)
    assert abs(engine.energy(data).dissipated_recovery) < 1e-6


def test_a_taut_string_holds_its_load_through_the_bottom():
    """A mass on two slides, on a soft string: J of its length changes sign at the bottom."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><option timestep="0.002"/><worldbody>
      <site name="post" pos="0 0 1"/><body pos="0 0 0.5">
        <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
        <geom size="0.02" mass="1"/><site name="bob"/></body></worldbody>
      <tendon><spatial limited="true" range="0 0.5" solreflimit="0.05 1"><site site="post"/>
        <site site="bob"/></spatial></tendon></mujoco>""")
    engine = dashpot.Engine(model)
    data = engine.make_data()
    engine.step(data, nstep=2000)
    data.qvel[0] = 0.5
    tension, expected, sides = [], [], set()
    for _ in range(2000):
        engine.step(data)
        tension.append(np.linalg.norm(data.qfrc_constraint))
        sides.add(np.sign(data.qpos[0]))
        # m (g cos(angle) + v^2 / L), with the string as long as it is.
        down = 0.5 - data.qpos[1]
        length = np.hypot(data.qpos[0], down)
        expected.append((9.81 * down + data.qvel @ data.qvel) / length)
    assert sides >= {-1.0, 1.0}
    assert np.mean(tension) == pytest.approx(np.mean(expected), rel=1e-3)
    # After the first second, when it no longer swings along the string.
    np.testing.assert_allclose(tension[500:], expected[500:], rtol=0.01)
    assert np.abs(np.diff(tension)).max() < 0.02 * np.mean(tension)
    # J is that of the middle: what it misses of the length, (omega H)^3 L / 24 = 1.7e-10 m a step
    # at up to 1 rad/s, under 10 N.
    assert abs(engine.energy(data).dissipated_recovery) < 4e-6
