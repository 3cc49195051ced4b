"""Servos and controllers of trees that contacts and equalities hold neither gain nor lose energy.

Forces that follow from the motion but are held over each step act half a step late on it: undamped
oscillations of rate omega then grow at omega^2 H / 4 a second.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

import dashpot
from legged_scenes import Quadruped

STIFFNESS, MASS = 5000.0, 5.0  # N/m, kg
TIMESTEPS = (0.001, 0.002)


def size_of_swing(heights: list[float], last: int) -> float:
    return 0.5 * float(np.ptp(heights[-last:]))


def swing(
    model: mujoco.MjModel,
    start: tuple[float, ...],
    duration: float,
    control: Callable[[mujoco.MjData], None] = lambda data: None,
) -> tuple[list[float], dashpot.Engine, mujoco.MjData]:
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qpos[:] = start
    heights = []
    for _ in range(round(duration / model.opt.timestep)):
        control(data)
        engine.step(data)
        heights.append(float(data.qpos[0]))
    return heights, engine, data


def coupled_masses(timestep: float, actuator: str, *, joint: str = "") -> mujoco.MjModel:
    """Return a mass on a slide, which a joint equality couples to a light one."""
    geom = 'contype="0" conaffinity="0"'
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option gravity="0 0 0" timestep="{timestep}"/><worldbody>
        <body><joint name="z" type="slide" axis="0 0 1" {joint}/>
          <geom size=".1" mass="{MASS}" {geom}/></body>
        <body pos="1 0 0"><joint name="y" type="slide" axis="0 0 1"/>
          <geom size=".02" mass=".05" {geom}/></body></worldbody>
      <tendon><fixed name="t"><joint joint="z" coef="1"/></fixed></tendon>
      <equality><joint joint1="y" joint2="z"/></equality>
      <actuator>{actuator}</actuator></mujoco>""")


SERVOS = {
    "position": f'<position joint="z" kp="{STIFFNESS}"/>',
    "on a tendon": f'<position tendon="t" kp="{STIFFNESS}"/>',
    "affine gain": f"""<general joint="z" gaintype="affine" gainprm="0 -{STIFFNESS}" biastype="none"
        ctrlrange="0 1"/>""",
    "user's motor": '<motor joint="z"/>',
    "applied force": "",
}


@pytest.mark.parametrize("timestep", TIMESTEPS)
@pytest.mark.parametrize("kind", SERVOS)
def test_an_undamped_servo_in_an_equality_keeps_its_swing(kind: str, timestep: float) -> None:
    """It swung 3.4 times as far after 5 s at 1 ms, 11 times at 2 ms."""

    def control(data: mujoco.MjData) -> None:
        if kind == "affine gain":
            data.ctrl[0] = 1.0
        elif kind == "user's motor":
            data.ctrl[0] = -STIFFNESS * data.qpos[0]
        elif kind == "applied force":
            data.qfrc_applied[0] = -STIFFNESS * data.qpos[0]

    model = coupled_masses(timestep, SERVOS[kind])
    heights, _, data = swing(model, (0.01, 0.01), 5.0, control)
    assert data.qpos[1] == pytest.approx(data.qpos[0], abs=1e-5)  # the equality holds
    # The grid of the steps misses the turning points by (omega H)^2 / 8 at most, 5e-4.
    assert size_of_swing(heights, round(0.4 / timestep)) == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_servo_leg_in_stance_swings_as_one_on_a_spring(timestep: float) -> None:
    """The leg is in contact throughout; it swung 6 times as far after 5 s at 2 ms."""
    sag = MASS * 9.81 / STIFFNESS
    swings = []
    for joint, actuator in (
        ("", f'<actuator><position joint="l" kp="{STIFFNESS}"/></actuator>'),
        (f'stiffness="{STIFFNESS}"', ""),
    ):
        model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{timestep}"/>
          <worldbody><geom type="plane" size="5 5 .1"/>
            <body pos="0 0 1"><joint name="z" type="slide" axis="0 0 1"/>
              <geom type="box" size=".1 .1 .05" mass="{MASS}" contype="0" conaffinity="0"/>
              <body pos="0 0 -.5"><joint name="l" type="slide" axis="0 0 1" {joint}/>
                <geom size=".03" mass=".2" pos="0 0 .03"/></body></body></worldbody>
          {actuator}</mujoco>""")
        heights, _, _ = swing(model, (-0.5 - sag - 0.004, sag + 0.004), 5.0)
        swings.append(size_of_swing(heights, round(0.4 / timestep)))
    # At turning points a servo may be taken as held for a step.
    assert swings[0] == pytest.approx(swings[1], rel=2e-3)
    # It keeps its 4 mm, but for what the grid of the steps misses, (omega H)^2 / 8, and as much for
    # the contact, which gives way under each change of load (test_spring_legs).
    assert swings[0] == pytest.approx(0.004, rel=5e-3)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_fingers_that_an_equality_couples_come_to_rest_at_their_damping(timestep: float) -> None:
    """At 2 ms they went on for good: kv / (2 m) less kp H / (4 m)."""
    mass, gain, damping = 0.2, 1000.0, 2.0
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option gravity="0 0 0" timestep="{timestep}"/><worldbody>
        <body><joint name="a" type="slide" axis="1 0 0"/><geom size=".02" mass="{mass}"/></body>
        <body pos="1 0 0"><joint name="b" type="slide" axis="-1 0 0"/>
          <geom size=".02" mass="{mass}"/></body></worldbody>
      <equality><joint joint1="b" joint2="a"/></equality>
      <actuator><position joint="a" kp="{gain}" kv="{damping}"/></actuator></mujoco>""")
    heights, _, _ = swing(model, (0.01, 0.01), 1.0)
    rate = damping / (2 * 2 * mass)
    omega = np.sqrt(gain / (2 * mass) - rate**2)
    time = timestep * np.arange(1, len(heights) + 1)
    expected = 0.01 * np.exp(-rate * time)
    expected *= np.cos(omega * time) + rate / omega * np.sin(omega * time)
    # Phase lags by (omega H)^2 / 12 of a turn of 7 rad an e-fold; explicit damping is as far off.
    assert np.abs(heights - expected).max() < 0.02 * (omega * timestep) ** 2


def test_a_held_servo_does_the_work_that_the_ledger_has() -> None:
    """Commands that jump every 50 ms, and a limit of the force that they reach."""
    servo = f'<position joint="z" kp="{STIFFNESS}" kv="5" forcerange="-60 60"/>'
    engine = dashpot.Engine(coupled_masses(0.001, servo, joint='damping="1"'))
    data = engine.make_data()
    rng = np.random.default_rng(0)
    totals, turned_over = [engine.energy(data).total], 0.0
    for step in range(2000):
        if step % 50 == 0:
            data.ctrl[0] = rng.uniform(-0.02, 0.02)
        engine.step(data)
        energy = engine.energy(data)
        totals.append(energy.total)
        turned_over = max(turned_over, energy.kinetic + energy.dissipated_damping)
    # The present step lacks the second half of what its forces change by.
    assert np.ptp(totals) < 0.02 * turned_over
    assert abs(totals[-1] - totals[0]) < 0.01 * turned_over


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("gain", [10.0, 100.0])
def test_a_stiff_velocity_servo_turns_a_cam_with_the_torque_that_it_asks_for(
    gain: float, timestep: float
) -> None:
    """An eccentric disc lifts a flat follower; with a servo of 100 it was off by ten times at 5 ms.

    The torque is the load times e cos(th), with the weights and the spring of the follower.
    """
    rate, offset = 10.0, 0.01
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="{timestep}" integrator="implicitfast"/><worldbody>
        <body><joint axis="0 1 0" name="c"/><geom type="cylinder" euler="90 0 0" size=".03 .02"
          pos="{offset} 0 0" mass=".2" friction="1e-5"/></body>
        <body pos="0 0 .04"><joint type="slide" axis="0 0 1" stiffness="500" springref="-.05"/>
          <geom type="box" size=".06 .03 .01" mass=".3" friction="1e-5"/></body></worldbody>
      <actuator><velocity joint="c" kv="{gain}"/></actuator></mujoco>""")
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.ctrl[0] = data.qvel[0] = rate
    errors = []
    for step in range(round(4 * np.pi / rate / timestep)):
        angle = data.qpos[0]
        engine.step(data)
        # The disc turns down from the x axis: its height is -e sin(th).
        lift = -offset * np.sin(angle)
        load = 0.3 * (9.81 - rate**2 * lift) + 500 * (0.05 + lift)
        torque = -(load + 0.2 * 9.81) * offset * np.cos(angle)
        if step * timestep * rate > 2 * np.pi:
            errors.append(data.actuator_force[0] - torque)
    # Half a step of the turn: e N w H / 2, of which N is 27 N at most.
    assert np.sqrt(np.mean(np.square(errors))) < 27 * offset * rate * timestep / 2


@pytest.mark.parametrize("part", [0.4, 0.9, 1.3, 1.5, 1.9])
def test_explicit_damping_of_a_servo_in_an_equality_is_stable_up_to_twice_the_velocity(
    part: float,
) -> None:
    """Damping takes `part` of the velocity in a step: followed to second order it is stable to 1.

    A Robotiq 2F-85 at 2 ms, 1.6, chattered at 1 rad/s for good.
    """
    timestep, stiffness = 0.002, 100.0
    damping = part * 1.0 / timestep  # of 1 kg
    bodies = "".join(
        f"""<body pos="{i} 0 0"><joint name="{name}" type="slide" axis="0 0 1"/>
          <geom size=".1" mass="0.5" contype="0" conaffinity="0"/></body>"""
        for i, name in enumerate("zy")
    )
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option gravity="0 0 0" timestep="{timestep}"/>
      <worldbody>{bodies}</worldbody>
      <equality><joint joint1="z" joint2="y"/></equality>
      <actuator><general joint="z" biastype="affine" biasprm="0 -{stiffness} -{damping}"/>
      </actuator></mujoco>""")
    heights, _, _ = swing(model, (0.01, 0.01), 2.0)
    # The slower of the two rates of x'' + c x' + k x = 0; explicit steps are off by H k / c^2.
    rate = 0.5 * (damping - np.sqrt(damping**2 - 4.0 * stiffness))
    time = timestep * np.arange(1, len(heights) + 1)
    settled = time > 0.1
    expected = 0.01 * np.exp(-rate * time)
    assert np.asarray(heights)[settled] == pytest.approx(expected[settled], abs=2e-5)


def test_a_motor_without_a_control_brakes_like_the_servo_that_it_is() -> None:
    """A DC motor whose terminals are short-circuited brakes with K^2 / R, and has no control."""
    constant, resistance = 5.0, 2.0
    motions = []
    for actuator in (
        f'<dcmotor joint="crank" motorconst="{constant}" resistance="{resistance}" input="none"/>',
        f'<velocity joint="crank" kv="{constant**2 / resistance}"/>',
    ):
        model = mujoco.MjModel.from_xml_string(f"""<mujoco>
          <option timestep="0.005" integrator="implicitfast"/><worldbody>
            <body><joint name="crank" axis="0 1 0"/><geom size=".05" pos=".1 0 0" mass=".1"/></body>
            <body pos="0 0 1"><joint name="load" type="slide" axis="0 0 1"/>
              <geom size=".05" mass="1"/></body></worldbody>
          <equality><joint joint1="crank" joint2="load" polycoef="0 3 0 0 0"/></equality>
          <actuator>{actuator}</actuator></mujoco>""")
        engine = dashpot.Engine(model)
        data = engine.make_data()
        engine.step(data, nstep=100)
        motions.append([*data.qpos, *data.qvel, engine.energy(data).work])
    assert motions[0][4] < -0.1
    # Two ways to write one brake: equal to rounding.
    assert motions[0] == pytest.approx(motions[1], rel=1e-9)


@pytest.mark.parametrize("held", [1, 20])
def test_the_ledger_closes_for_a_robot_whose_commands_jump(held: int) -> None:
    """Commands new in every step, or every 20 ms, in between which the legs swing and settle."""
    engine = dashpot.Engine(Quadruped().model(0.001))
    data = engine.make_data()
    rng = np.random.default_rng(1)
    start, most, off = engine.energy(data).total, 0.0, 0.0
    for step in range(2000):
        if step % held == 0:
            data.ctrl[:] = rng.uniform(-0.3, 0.3, 8)
        engine.step(data)
        energy = engine.energy(data)
        most, off = max(most, energy.kinetic), max(off, abs(energy.total - start))
    turned_over = most + energy.dissipated_normal + energy.dissipated_friction
    assert energy.dissipated_normal > 0.1  # feet come down
    turned_over += energy.dissipated_damping
    # Legs turn by up to 0.02 rad in a step, in which hits have no time.
    assert off < 3e-3 * turned_over


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_light_fingers_hold_a_heavy_block_as_damped_as_their_servos_are(timestep: float) -> None:
    """The block swings between two servos; a push of its own has brought it off its place.

    The servos' change within a step would throw the fingers about without the block.
    """
    gain, damping, block, finger = 2000.0, 4.0, 1.0, 0.05
    fingers = servos = ""
    for name, side in (("a", 1), ("b", -1)):
        fingers += f"""<body pos="{-0.035 * side} 0 .03" gravcomp="1">
          <joint name="{name}" type="slide" axis="{side} 0 0"/>
          <geom type="box" size=".005 .01 .01" mass="{finger}"/></body>"""
        servos += f'<position joint="{name}" kp="{gain}" kv="{damping}"/>'
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{timestep}"/><worldbody>
          <geom type="plane" size="0 0 1" friction="1e-4" priority="1"/>
          <body pos="0 0 .03"><freejoint/>
            <geom type="box" size=".03 .03 .03" mass="{block}"/></body>
          {fingers}</worldbody><actuator>{servos}</actuator></mujoco>""")
    )
    data = engine.make_data()
    data.ctrl[:] = 0.02  # pressed by 40 N
    places = []
    for step in range(round(1.3 / timestep)):
        data.qfrc_applied[0] = 8.0 if step * timestep < 0.5 else 0.0
        engine.step(data)
        places.append(data.qpos[0])
    first, last = (
        np.ptp(places[round(start / timestep) : round((start + 0.1) / timestep)])
        for start in (0.5, 1.2)
    )
    mass = block + 2 * finger
    # Changes are counted on where they last: less than all of it where a swing turns. At 5 ms it
    # has 21 steps, and grew at omega^2 H / 4 less the rate.
    rate = np.log(first / last) / 0.7
    assert rate == pytest.approx(2 * damping / (2 * mass), rel=0.2)


def leg_beside_a_ball(actuators: str, timestep: float) -> mujoco.MjModel:
    """Return a leg on a servo, p, and a ball joint with an actuator of three outputs, s."""
    spec = mujoco.MjSpec.from_string(f"""<mujoco><option timestep="{timestep}"/><worldbody>
      <geom type="plane" size="5 5 .1"/>
      <body pos="0 0 1"><joint type="slide" axis="0 0 1"/>
        <geom type="box" size=".1 .1 .05" mass="{MASS}" contype="0" conaffinity="0"/>
        <body pos="0 0 -.5"><joint name="leg" type="slide" axis="0 0 1"/>
          <geom size=".03" mass=".2" pos="0 0 .03"/></body></body>
      <body pos="1 0 1"><joint name="ball" type="ball"/>
        <geom size=".1" mass="1" contype="0" conaffinity="0"/></body></worldbody></mujoco>""")
    for name in actuators:
        actuator = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        if name == "p":
            actuator.target = "leg"
            actuator.set_to_position(kp=STIFFNESS)
        else:
            actuator.target = "ball"
            actuator.gaintype = mujoco.mjtGain.mjGAIN_SO3
            actuator.biastype = mujoco.mjtBias.mjBIAS_SO3
            actuator.gainprm[0] = 1.0
            actuator.biasprm[1] = -1.0
    return spec.compile()


@pytest.mark.parametrize("timestep", [0.002, 0.005])
def test_a_servo_leg_swings_whatever_the_order_of_actuators(timestep: float) -> None:
    """Actuators may have several controls and outputs: those after one are not where it is."""
    sag = MASS * 9.81 / STIFFNESS
    ends = []
    for actuators in ("p", "ps", "sp"):
        engine = dashpot.Engine(leg_beside_a_ball(actuators, timestep))
        data = engine.make_data()
        data.qpos[:2] = -0.5 - sag - 0.004, sag + 0.004
        engine.step(data, nstep=round(1.0 / timestep))
        ends.append(data.qpos[:2].copy())
    np.testing.assert_array_equal(ends, [ends[0]] * 3)
