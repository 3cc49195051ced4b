"""Mocap bodies move: what they push, carry, weld and pull goes with them."""

import math

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dashpot import Engine, Material, law

PLATE = """<mujoco><option timestep="0.002"/><worldbody>
  <body name="plate" mocap="true"><geom type="box" size="0.3 0.3 0.05"/></body>
  <body name="box" pos="0 0 0.15"><freejoint/>
    <geom type="box" size="0.1 0.1 0.1" mass="1"/></body>
</worldbody></mujoco>"""
WELD = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody>
  <body name="hand" mocap="true" pos="0 0 1"/>
  <body name="tool" pos="0 0 1"><freejoint/><geom size="0.1" mass="1"/></body>
</worldbody><equality><{kind} body1="hand" body2="tool" {more}/></equality></mujoco>"""


def make(xml, **options):
    """Return an engine and its data."""
    engine = Engine(mujoco.MjModel.from_xml_string(xml), **options)
    return engine, engine.make_data()


def drive(engine, data, command, *, seconds, every=1):
    """Step while `command(data, t)` sets the pose for the end of each (or every n-th) step."""
    dt = engine.model.opt.timestep
    engine.step(data)  # knows the first pose
    for k in range(round(seconds / dt)):
        if k % every == 0:
            command(data, (k + 1) * dt)
        engine.step(data)


def late(timeconst, timestep=0.002):
    """Return by how much (s) what holds something follows a ramp late, told in each step."""
    return 2 * timeconst - 0.5 * timestep


START = 0.1  # s


def ramp(speed, t):
    """Return where a hand is that speeds up to `speed` within some START."""
    return speed * (t - START * (1.0 - math.exp(-t / START)))


def follower(jump, t, timeconst):
    """Return where a critically damped follower is at t (s) after a jump."""
    return jump * (1.0 - (1.0 + t / timeconst) * np.exp(-t / timeconst))


@pytest.mark.parametrize("timeconst", [0.0, 0.02])
@pytest.mark.parametrize("speed", [0.05, 0.5, 2.0])
def test_lift_carries_a_box_at_its_speed(speed, timeconst):
    engine, data = make(PLATE, mocap_timeconst=timeconst)

    def command(d, t):
        d.mocap_pos[0, 2] = speed * t

    drive(engine, data, command, seconds=1.0)
    # What is left is the box's sag.
    assert data.qpos[2] - 0.15 == pytest.approx(speed, abs=1e-5)
    assert data.qvel[2] == pytest.approx(speed, rel=1e-6)


def test_lift_does_the_work_that_the_box_gains():
    engine, data = make(PLATE)  # MuJoCo counts the potential energy of the plate, too
    start = engine.energy(data)
    drive(engine, data, lambda d, t: d.mocap_pos.__setitem__((0, 2), 0.5 * t), seconds=0.5)
    end = engine.energy(data)
    assert data.qvel[2] == pytest.approx(0.5, rel=1e-6)  # the box goes along
    gained = end.kinetic + end.potential - start.kinetic - start.potential
    assert gained > 2.0
    assert end.work - start.work == pytest.approx(gained, rel=2e-3)
    assert end.total == pytest.approx(start.total, abs=1e-3 * gained)


@pytest.mark.parametrize("timeconst", [0.0, 0.02])
def test_work_lifts_and_tilts_a_plate_from_its_first_pose_on(timeconst):
    """The first pose is no motion: what it lifts the plate by is not in the work, as of a jump."""
    engine, data = make(PLATE, mocap_timeconst=timeconst)
    mass, first = engine.model.body_mass[1], 0.001
    before = engine.energy(data).total
    data.qpos[2] = 3.0  # the box falls by itself
    data.mocap_pos[0, 2] = first
    start = engine.energy(data).total
    falls = 9.81 * engine.model.body_mass[2] * (3.0 - 0.15)
    assert start - before - falls == pytest.approx(9.81 * mass * first, abs=1e-9)
    for k in range(100):
        angle = 0.001 * k
        data.mocap_pos[0] = [0.01 * np.sin(0.1 * k), 0.0, first * (k + 1)]
        data.mocap_quat[0] = [np.cos(angle), np.sin(angle), 0.0, 0.0]
        engine.step(data)
        # 36 kg, 360 J a metre: to rounding.
        assert engine.energy(data).total == pytest.approx(start, abs=1e-11)


def test_friction_carries_a_box_along_and_around():
    engine, data = make(PLATE)

    def command(d, t):
        d.mocap_pos[0, :2] = 0.1 * t, -0.05 * t
        d.mocap_quat[0] = math.cos(0.25 * t), 0.0, 0.0, math.sin(0.25 * t)

    drive(engine, data, command, seconds=1.0)
    # The plate turns at 0.5 rad/s and moves; the box, in its middle, does the same, but for what it
    # slips at the start, when that is a jump.
    assert data.qvel[:2] == pytest.approx([0.1, -0.05], abs=1e-3)
    assert data.qvel[5] == pytest.approx(0.5, abs=1e-3)
    assert data.qpos[:2] == pytest.approx([0.1, -0.05], abs=1e-3)
    assert 2 * math.atan2(data.qpos[6], data.qpos[3]) == pytest.approx(0.5, abs=5e-3)


def test_friction_gives_way_where_the_plate_accelerates_too_fast():
    xml = PLATE.replace('size="0.3', 'friction="0.1" size="3').replace(
        'mass="1"', 'mass="1" friction="0.1"'
    )
    engine, data = make(xml, mocap_timeconst=0.0)
    seconds, acceleration = 0.5, 4.0
    drive(
        engine,
        data,
        lambda d, t: d.mocap_pos.__setitem__((0, 0), 0.5 * acceleration * t * t),
        seconds=seconds,
    )
    assert data.qvel[0] == pytest.approx(0.1 * 9.81 * seconds, rel=2e-3)


@pytest.mark.parametrize("height", [0.27, 0.2733, 0.2741])
@pytest.mark.parametrize("kind", ['type="plane"', 'pos="0 0 -.1" type="box"'])
def test_a_ramp_that_tilts_up_meets_a_ball_far_from_its_axis(kind, height):
    engine, data = make(
        f"""<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody>
        <body name="ramp" mocap="true"><geom {kind} size="5 5 .1"/></body>
        <body pos="4 0 {height}"><freejoint/><geom size=".05" mass="1"/></body>
        </worldbody></mujoco>""",
        mocap_timeconst=0.0,
    )
    speed = 2.0  # rad/s: at the ball the ramp rises by 4 cm in a step
    deepest = 0.0
    for step in range(40):
        half = -0.5 * speed * 0.005 * (step + 1)
        data.mocap_quat[0] = math.cos(half), 0.0, math.sin(half), 0.0
        deepest = max(deepest, engine.step(data).max_penetration)
    # Nor does it sink in at all: rigid contacts throw the ball off within the step.
    assert deepest < 1e-6
    assert data.qvel[2] > 7.0  # m/s: by 2 rad/s, 4 m from the axis, along a normal that turns


def test_pusher_pushes_at_its_speed_without_going_in():
    engine, data = make("""<mujoco><option timestep="0.002"/><worldbody>
      <geom type="plane" size="5 5 1"/>
      <body name="pusher" mocap="true" pos="-0.2 0 0.1">
        <geom type="box" size="0.1 0.1 0.05"/></body>
      <body pos="0 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="1"/></body>
    </worldbody></mujoco>""")
    drive(
        engine,
        data,
        lambda d, t: d.mocap_pos.__setitem__((0, 0), -0.2 + ramp(0.5, t)),
        seconds=1.0,
    )
    assert data.qvel[0] == pytest.approx(0.5, rel=1e-3)
    # 9.81 N of friction on rigid contacts.
    assert data.contact.dist[: data.ncon].min() > -2e-5
    assert data.qpos[0] == pytest.approx(ramp(0.5, 1.0), abs=1e-4)


def test_pusher_of_a_model_in_millimetres_pushes_as_in_metres():
    # 500 mm/s are 1 mm in a step: far more than 0.1, the jump of a model in metres.
    engine, data = make("""<mujoco><option timestep="0.002" gravity="0 0 -9810"/><worldbody>
      <geom type="plane" size="5000 5000 1"/>
      <body name="pusher" mocap="true" pos="-200 0 100">
        <geom type="box" size="100 100 50"/></body>
      <body pos="0 0 100"><freejoint/><geom type="box" size="100 100 100" mass="1000"/></body>
    </worldbody></mujoco>""")
    drive(
        engine,
        data,
        lambda d, t: d.mocap_pos.__setitem__((0, 0), -200 + ramp(500, t)),
        seconds=1.0,
    )
    assert data.qvel[0] == pytest.approx(500, rel=1e-3)
    assert data.qpos[0] == pytest.approx(ramp(500, 1.0), abs=0.1)


FINGER = """<mujoco><option timestep="0.002"/><worldbody>
  <body name="hand" mocap="true" pos="0 0 1"><geom type="box" size="0.05 0.02 0.02"/>
    <body name="finger" pos="0.1 0 0"><joint type="hinge" axis="0 1 0" {joint}/>
      <geom name="tip" type="box" size="0.02 0.05 0.1" pos="0 0 -0.1" mass="0.2"/></body></body>
  {more}
</worldbody></mujoco>"""
BALL = """<body name="ball" pos="0.3 0 0.9"><freejoint/><geom size="0.04" mass="0.1"/></body>"""


@pytest.mark.parametrize("impact", ["none", "cut"])
@pytest.mark.parametrize("speed", [0.1, 0.5, 2.0])
def test_finger_on_a_moving_hand_pushes_at_its_speed(speed, impact):
    # It would pass through the ball if its contacts saw the joint's velocity alone.
    xml = FINGER.format(joint='stiffness="20" damping="0.5"', more=BALL)
    engine, data = make(xml.replace("<option", '<option gravity="0 0 0"'), impact=impact)
    depth = 0.0
    rates = []  # of the gap, where the contact pushes
    for k in range(round(0.6 / speed / 0.002)):
        data.mocap_pos[0, 0] = speed * k * 0.002
        depth = max(depth, engine.step(data).max_penetration)
        contacts = engine.contacts(data)
        rates += list(contacts.velocity[contacts.force[:, 0] > 0.0, 0])
    # The springy finger may throw the ball ahead, never leave it behind.
    assert data.qvel[1] > 0.95 * speed
    # Sags of the rigid contact, and what it gives way by in an impact at this speed.
    assert depth < 1e-4 * max(1.0, speed)
    assert rates
    assert abs(rates[-1]) < 0.1 * speed


def test_finger_against_a_stop_on_its_hand_does_not_feel_the_hand_move():
    # Tip and stop go as one: what carries them along leaves their contact alone.
    stop = '<geom name="stop" type="box" size="0.02 0.02 0.02" pos="0.06 0 -0.15"/>'
    xml = FINGER.replace('<body name="finger"', stop + '<body name="finger"')
    # A pair, since parent and child do not collide otherwise.
    pair = '<contact><pair geom1="stop" geom2="tip"/></contact>'
    xml = xml.format(joint='springref="45" stiffness="0.3"', more="")
    xml = xml.replace("</worldbody>", "</worldbody>" + pair)
    forces = []
    for speed in (0.0, 1.0):
        engine, data = make(xml)
        for k in range(500):
            data.mocap_pos[0, 0] = speed * k * 0.002
            engine.step(data)
        contacts = engine.contacts(data)
        forces.append(contacts.force[:, 0].sum())
        # Differences of velocities of 1 m/s.
        assert np.abs(contacts.velocity).max() < 1e-12
    assert forces[0] > 0.5
    # Collision knows boxes a metre away to about 1e-8 of their size.
    assert forces[1] == pytest.approx(forces[0], rel=1e-6)


def test_carrying_a_pendulum_does_the_work_that_its_weight_asks_for():
    engine, data = make(FINGER.format(joint="", more=""))
    data.qpos[0] = 0.3
    start = engine.energy(data)
    for k in range(500):
        angle = 0.5 * min(k * 0.002, 0.6)
        data.mocap_pos[0, 2] = 1.0 + min(k * 0.001, 0.3)
        data.mocap_quat[0] = [np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0]
        engine.step(data)
    end = engine.energy(data)
    # Hand (0.16 kg) and finger (0.2 kg) went up 0.3 m; the finger's pivot was also turned down.
    assert end.work == pytest.approx((0.36 * 0.3 - 0.2 * 0.1 * np.sin(0.3)) * 9.81, rel=0.1)
    # Of first order: swing and turn of one step.
    assert end.total == pytest.approx(start.total, abs=1e-4)


@pytest.mark.parametrize("impact", ["none", "cut"])
@pytest.mark.parametrize("speed", [1.0, 20.0])
def test_bat_hits_a_ball_with_its_restitution(speed, impact):
    # A bat of 2 cm that goes 4 cm in a step at the higher speed.
    engine, data = make(
        """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody>
        <body name="bat" mocap="true" pos="-1 0 0"><geom name="bat" type="box" size=".01 .2 .2"/>
        </body><body><freejoint/><geom name="ball" size="0.02" mass="0.1"/></body>
        </worldbody></mujoco>""",
        mocap_timeconst=0.0,
        impact=impact,
    )
    engine.set_pair_material("bat", "ball", Material(1e6, restitution=0.8))
    drive(
        engine,
        data,
        lambda d, t: d.mocap_pos.__setitem__((0, 0), -1.0 + speed * t),
        seconds=1.2 / speed,
    )
    # A bat that nothing slows: v (1 + e). A single contact flows in closed form.
    assert data.qvel[0] == pytest.approx(1.8 * speed, rel=1e-9)


@pytest.mark.parametrize("kind", ["weld", "connect"])
def test_tool_follows_a_jump_through_the_spring_of_its_solref_and_as_in_mujoco(kind):
    more = 'anchor="0 0 0"' if kind == "connect" else ""
    engine, data = make(WELD.format(kind=kind, more=more))
    plain = mujoco.MjData(engine.model)
    assert "equality #0 solref/solimp" in str(engine.report())
    engine.step(data)  # knows the first pose
    jump, timeconst = 0.05, 0.02
    data.mocap_pos[0, 0] = plain.mocap_pos[0, 0] = jump
    stiffness, damping = law.solref_to_spring_at_rest((0.02, 1.0))

    def motion(t, y):
        hand, hand_rate = (
            follower(jump, t, timeconst),
            jump * t / timeconst**2 * math.exp(-t / timeconst),
        )
        return [y[1], stiffness * (hand - y[0]) + damping * (hand_rate - y[1])]

    times = engine.model.opt.timestep * np.arange(1, 101)
    exact = solve_ivp(motion, (0, times[-1]), [0, 0], t_eval=times, rtol=1e-9, atol=1e-12).y[0]
    for expected in exact:
        engine.step(data)
        mujoco.mj_step(engine.model, plain)
        # The hand's velocity is constant during a step.
        assert data.qpos[0] == pytest.approx(expected, abs=1e-4)
        # MuJoCo integrates its row to first order, and has no spring behind the follower.
        assert data.qpos[0] == pytest.approx(plain.qpos[0], abs=4e-3)


def test_welded_tool_turns_with_the_hand():
    engine, data = make(WELD.format(kind="weld", more=""))

    def command(d, t):
        d.mocap_quat[0] = math.cos(0.5 * t), 0.0, math.sin(0.5 * t), 0.0

    drive(engine, data, command, seconds=1.0)
    assert data.qvel[3:] == pytest.approx([0.0, 1.0, 0.0], abs=1e-4)
    assert 2 * math.atan2(data.qpos[5], data.qpos[3]) == pytest.approx(1.0 - late(0.02), abs=1e-4)


def test_hand_without_a_time_constant_arrives_at_the_end_of_each_step():
    engine, data = make(WELD.format(kind="weld", more=""), mocap_timeconst=0.0)
    engine.step(data)  # knows the first pose
    for k in range(1, 200):
        data.mocap_pos[0, 0] = 0.1 * math.sin(0.01 * k)
        engine.step(data)
        # After the start at 0.5 m/s the weld's spring, 5e4 1/s^2, gives way by 2.5 m/s^2 over it.
        if k > 50:
            assert data.qpos[0] == pytest.approx(data.mocap_pos[0, 0], abs=1e-4)


def test_arm_welded_to_a_hand_follows_it():
    engine, data = make(
        """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody>
      <body name="hand" mocap="true" pos="0.6 0 0"/>
      <body><joint type="hinge" axis="0 1 0" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0.2" size="0.02"/>
        <body pos="0.3 0 0.2"><joint type="hinge" axis="0 1 0" damping="0.1"/>
          <geom type="capsule" fromto="0 0 0 0.3 0 -0.2" size="0.02"/>
          <site name="tip" pos="0.3 0 -0.2"/></body></body>
      </worldbody><equality><connect site1="hand_site" site2="tip"/></equality></mujoco>""".replace(
            'pos="0.6 0 0"/>', 'pos="0.6 0 0"><site name="hand_site"/></body>'
        )
    )

    def command(d, t):
        d.mocap_pos[0, 2] = 0.1 * math.sin(4 * t)

    drive(engine, data, command, seconds=2.0)
    mujoco.mj_kinematics(engine.model, data)
    # The follower of a sine of 4 rad/s, after its start: gain and phase of 1 / (1 + 0.08 i)^2.
    response = 1.0 / (1.0 + 4j * 0.02) ** 2
    expected = 0.1 * (response * np.exp(8j)).imag
    # The spring of the connect, 5e4 1/s^2, gives way by the arm's weight over it.
    assert data.site("tip").xpos[2] == pytest.approx(expected, abs=2e-4)


def test_rope_to_a_hand_pulls():
    engine, data = make("""<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody>
      <body name="hand" mocap="true"><site name="a"/></body>
      <body pos="-0.5 0 0"><freejoint/><geom size="0.05" mass="1"/><site name="b"/></body>
      </worldbody>
      <tendon><spatial limited="true" range="0 0.5"><site site="a"/><site site="b"/></spatial>
      </tendon>
      </mujoco>""")
    drive(engine, data, lambda d, t: d.mocap_pos.__setitem__((0, 0), ramp(0.5, t)), seconds=1.0)
    assert data.qvel[0] == pytest.approx(0.5, rel=1e-3)
    assert data.qpos[0] + 0.5 == pytest.approx(ramp(0.5, 1.0), abs=1e-3)


def test_far_jumps_are_no_motion():
    engine, data = make(PLATE)
    engine.step(data, nstep=50)
    data.mocap_pos[0, 2] = -1.0
    engine.step(data)
    data.mocap_pos[0, 2] = 0.02  # 20 mm inside the box, from a metre away
    engine.step(data, nstep=5)
    # The box is pushed out by the recovery speed, not hit, until it stands on the plate.
    assert data.qvel[2] == pytest.approx(0.1, rel=1e-6)
    engine.step(data, nstep=200)
    assert data.qpos[2] == pytest.approx(0.17, abs=1e-5)


def test_press_stops_at_what_cannot_give_way():
    # Pressed 20 mm into a box on the floor, rigid contacts hold: no tremor, no divergence.
    engine, data = make("""<mujoco><option timestep="0.002"/><worldbody>
      <geom type="plane" size="5 5 1"/>
      <body name="press" mocap="true" pos="0 0 0.25"><geom type="box" size="0.3 0.3 0.05"/></body>
      <body pos="0 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="1"/></body>
    </worldbody></mujoco>""")

    def command(d, t):
        d.mocap_pos[0, 2] = max(0.23, 0.25 - 0.2 * t)

    drive(engine, data, command, seconds=1.0)
    assert data.qpos[2] == pytest.approx(0.09, abs=1e-3)  # half of it above, half below
    assert abs(data.qvel).max() < 1e-6


def test_report_says_how_mocap_bodies_move():
    assert "mapped    body 'plate' mocap" in str(make(PLATE)[0].report())
    assert "honoured  body 'plate' mocap" in str(make(PLATE, law="comfree")[0].report())


def test_commands_are_left_as_they_were_set():
    engine, data = make(PLATE)
    data.mocap_quat[0] = 2.0, 0.0, 0.0, 0.0
    engine.step(data)
    data.mocap_pos[0] = 0.01, 0.02, 0.003
    data.mocap_quat[0] = 3.0, 0.0, 0.0, 0.1
    engine.step(data, nstep=3)
    assert data.mocap_pos[0].tolist() == [0.01, 0.02, 0.003]
    assert data.mocap_quat[0].tolist() == [3.0, 0.0, 0.0, 0.1]
    # On the way, which takes it the time constant of 20 ms, at the start of the third step.
    assert data.body("plate").xpos[0] == pytest.approx(0.01 * 0.004 / 0.02, rel=1e-9)


def test_control_callbacks_may_set_poses():
    engine, data = make(PLATE)

    def command(_, d):
        d.mocap_pos[0, 2] = 0.5 * (d.time + 0.002)

    mujoco.set_mjcb_control(command)
    try:
        engine.step(data, nstep=500)
    finally:
        mujoco.set_mjcb_control(None)
    assert data.mocap_pos[0, 2] == pytest.approx(0.5)
    assert data.qvel[2] == pytest.approx(0.5, rel=1e-6)


# A link that a large torque turns far cuts the step into parts.
HAND_AND_LINK = """<mujoco><option timestep="0.01" gravity="0 0 0"/><worldbody>
  <body mocap="true" pos="0 0 1"><geom size="0.05"/></body>
  <body pos="0 5 0"><joint name="link" axis="0 0 1"/>
    <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.01" mass="0.1"/></body></worldbody>
  <actuator><motor joint="link"/></actuator></mujoco>"""
TORQUES = [0.0, 20.0]  # N m
COMMAND = [0.05, 0.0, 1.0]


@pytest.mark.parametrize("torque", TORQUES)
def test_poses_that_a_callback_sets_outlast_the_parts_of_a_step(torque):
    engine, data = make(HAND_AND_LINK)
    engine.step(data)
    data.ctrl[0] = torque

    def command(_, d):
        d.mocap_pos[0] = COMMAND

    mujoco.set_mjcb_control(command)
    try:
        parts = engine.step(data).parts
    finally:
        mujoco.set_mjcb_control(None)
    assert (parts > 1) == (torque > 0.0)
    assert data.mocap_pos[0].tolist() == COMMAND


@pytest.mark.parametrize("torque", TORQUES)
def test_commands_outlast_a_step_that_fails(torque):
    engine, data = make(HAND_AND_LINK)
    engine.step(data)
    data.mocap_pos[0] = COMMAND
    data.ctrl[0] = torque
    time, angle = data.time, data.qpos[0]

    def fail(_, d):
        if d.time > time or torque == 0.0:
            raise RuntimeError("on the way")

    mujoco.set_mjcb_passive(fail)
    try:
        with pytest.raises(RuntimeError, match="on the way"):
            engine.step(data)
    finally:
        mujoco.set_mjcb_passive(None)
    assert (data.time, data.qpos[0]) == (time, angle)
    assert data.mocap_pos[0].tolist() == COMMAND


@pytest.mark.parametrize("impact", ["none", "cut"])
def test_motion_goes_on_from_a_saved_state_bit_for_bit(impact):
    engine, data = make(PLATE, impact=impact)
    engine.step(data)
    data.mocap_pos[0] = 0.02, 0.0, 0.05
    engine.step(data, nstep=7)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(engine.model, kind))
    mujoco.mj_getState(engine.model, data, state, kind)
    other = engine.make_data()
    mujoco.mj_setState(engine.model, other, state, kind)
    engine.step(data, nstep=30)
    for _ in range(30):
        engine.step(other)
    assert np.array_equal(data.qpos, other.qpos)
    assert np.array_equal(data.qvel, other.qvel)
    assert data.qpos[2] > 0.19


def test_hands_at_rest_change_nothing():
    engine, data = make(PLATE)
    fixed, plain = make(PLATE.replace(' mocap="true"', ""))
    for d in (data, plain):
        d.qvel[:3] = 0.3, 0.0, 0.5
    engine.step(data, nstep=300)
    fixed.step(plain, nstep=300)
    assert np.array_equal(data.qpos, plain.qpos)


@pytest.mark.parametrize("impact", ["none", "cut"])
def test_hands_that_arrive_stay_where_they_are(impact):
    # At once, in the midst of a step that other impacts cut too, where cuts are asked for.
    engine, data = make(PLATE, impact=impact, mocap_timeconst=0.0)
    engine.step(data)
    data.mocap_pos[0] = 0.01, 0.02, 0.005
    data.qvel[2] = -5.0
    cuts = sum(engine.step(data).cuts for _ in range(5))
    assert (cuts > 0) == (impact == "cut")
    assert data.body("plate").xpos.tolist() == [0.01, 0.02, 0.005]
    assert data.mocap_pos[0].tolist() == [0.01, 0.02, 0.005]


@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf])
def test_bad_time_constants_are_named(value):
    with pytest.raises(ValueError, match="mocap_timeconst"):
        make(PLATE, mocap_timeconst=value)
    with pytest.raises(TypeError, match="mocap_timeconst"):
        make(PLATE, mocap_timeconst="fast")


def fingers(kp, ratio, timestep):
    """Return an engine of a hand welded to a mocap body, with two fingers of 30 g on servos."""
    damping = 2.0 * ratio * math.sqrt(kp * 0.03)
    body = "".join(
        f"""<body pos="{0.04 * side} 0 -.06">
          <joint name="f{side}" type="slide" axis="{-side} 0 0" damping="{damping}"/>
          <geom type="box" size=".005 .01 .02" mass="0.03"/></body>"""
        for side in (1, -1)
    )
    servos = "".join(f'<position joint="f{side}" kp="{kp}"/>' for side in (1, -1))
    return make(f"""<mujoco><option timestep="{timestep}"/><worldbody>
        <body name="m" mocap="true" pos="0 0 .3"/>
        <body name="hand" pos="0 0 .3" gravcomp="1"><freejoint/>
          <geom type="box" size=".05 .02 .02" mass="0.3"/>{body}</body></worldbody>
      <equality><weld body1="m" body2="hand"/></equality>
      <actuator>{servos}</actuator></mujoco>""")


@pytest.mark.parametrize(
    ("kp", "ratio", "timestep"),
    [(300.0, 0.02, 0.002), (1000.0, 0.1, 0.005), (3000.0, 0.1, 0.002), (3000.0, 0.3, 0.005)],
)
def test_servos_of_a_hand_that_moves_come_to_rest(kp, ratio, timestep):
    """Where the mocap body moved the second half of steps was left out: fingers reached 10 m/s."""
    engine, data = fingers(kp, ratio, timestep)
    data.ctrl[:] = 0.01

    def command(d, t):
        d.mocap_pos[0, :3] = 0.05 * math.sin(2.0 * t), 0.0, 0.3 + 0.02 * math.sin(3.0 * t)

    drive(engine, data, command, seconds=2.5)
    # A finger on a spring of w follows the acceleration 0.2 m/s^2 of the hand by 0.2 / w^2, at most
    # 2e-5 m and 2 rad/s; of its own swing at 100 rad/s exp(-0.02 100 2.5) = 0.7 % of 1 m/s is left.
    assert np.abs(data.qvel[6:8]).max() < 1e-2
    # They are where their servos want them, but for those 2e-5 m and 0.7 % of the way there.
    assert data.qpos[7:9] == pytest.approx(0.01, abs=1e-4)


def test_a_chain_on_a_hook_that_goes_round_closes_the_ledger():
    """Forces held from the start of a step put 0.029 J of 0.45 into it at 2 ms."""
    link = '<geom type="capsule" size=".01" fromto="0 0 0 0 0 -.1" mass=".05"/>'
    chain = f'<body pos="0 0 -.1"><joint type="ball"/>{link}</body>'
    engine, data = make(
        f"""<mujoco><option timestep="0.002"/>
      <default><geom contype="0" conaffinity="0"/></default><worldbody>
        <body name="hook" mocap="true" pos=".05 0 0"/>
        <body name="first" pos=".05 0 0"><joint type="slide" axis="1 0 0"/>
          <joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
          <joint type="ball"/>{link}{chain}</body></worldbody>
      <equality><connect body1="hook" body2="first" anchor="0 0 0"/></equality></mujoco>""",
        mocap_timeconst=0.0,
    )

    def command(d, t):
        d.mocap_pos[0, :2] = 0.05 * math.cos(10.0 * t), 0.05 * math.sin(10.0 * t)

    engine.step(data)
    start = engine.energy(data).total
    drive(engine, data, command, seconds=1.0)
    energy = engine.energy(data)
    assert energy.total - start == pytest.approx(0.0, abs=2e-3 * energy.kinetic)
