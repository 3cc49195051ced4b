"""Balls hit by what turns: bats on hinges with steps cut at impacts, and flat faces."""

import mujoco
import numpy as np
import pytest

import dashpot

PHASES = np.linspace(0.0, 5.0, 6, endpoint=False)  # ms or 12 mrad by which hits differ within steps
FINE = 5e-5  # s, short steps that give the reference
BALL, ARM, RESTITUTION = 0.145, 0.7, 0.5  # kg; m from the hinge to where the ball is hit
TORQUE, PUSHED = {False: 100.0, True: 150.0}, 0.06  # N m, for 60 ms or all the way


def angle_of(velocity):
    """Return the direction (deg) of a horizontal velocity from the y axis, to the left."""
    return np.degrees(np.arctan2(-velocity[0], velocity[1]))


def inertia_of_bat(model):
    """Return that about its hinge."""
    return model.body_inertia[1].max() + model.body_mass[1] * model.body_ipos[1, 0] ** 2


def bat_and_ball(timestep):
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0" timestep="{timestep}"/><worldbody>
          <body><joint name="hinge" axis="0 0 1"/>
            <geom name="bat" type="capsule" size=".033" fromto=".2 0 0 .85 0 0" mass="1"/></body>
          <body><freejoint/><geom name="ball" size=".037" mass="{BALL}"/></body></worldbody>
        <actuator><motor joint="hinge"/></actuator></mujoco>"""
    )


def batted(timestep, phase, *, driven, ball_speed, impact):
    """Return velocity (m/s) of a ball after a bat that torque has set in motion has met it.

    The bat starts at rest, about 1 rad away from where it is to meet the ball, with its axis along
    x. Torque drives it for 60 ms, or all the way.
    """
    model = bat_and_ball(timestep)
    engine = dashpot.Engine(model, impact=impact)
    material = dashpot.Material(stiffness=1e6, restitution=RESTITUTION, friction=0.3)
    engine.set_pair_material("bat", "ball", material)
    data = engine.make_data()
    start, torque = 1.0 + 0.012 * phase, TORQUE[driven]
    acceleration = torque / inertia_of_bat(model)
    meeting = (
        np.sqrt(2.0 * start / acceleration)
        if driven
        else 0.5 * PUSHED + start / (acceleration * PUSHED)
    )
    data.qpos[0] = -start
    data.qpos[1:4] = ARM, 0.07 - ball_speed * meeting, 0.0
    data.qvel[2] = ball_speed
    for step in range(int(np.ceil((meeting + 0.01) / timestep))):
        data.ctrl[0] = torque if driven or (step + 0.5) * timestep < PUSHED else 0.0
        engine.step(data)
    return data.qvel[1:3].copy()


def speed_by_impulse(*, driven, ball_speed):
    """Return the speed of the ball, in phase 0, after an impulse along the normal in no time."""
    inertia = inertia_of_bat(bat_and_ball(FINE))
    acceleration = TORQUE[driven] / inertia
    bat_rate = np.sqrt(2.0 * acceleration) if driven else acceleration * PUSHED
    closing = ARM * bat_rate - ball_speed
    return ball_speed + (1.0 + RESTITUTION) * closing / BALL / (1.0 / BALL + ARM**2 / inertia)


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize(("driven", "ball_speed"), [(False, -25.0), (True, -25.0), (True, 0.0)])
def test_a_bat_on_a_hinge_hits_a_ball_in_time_where_impacts_cut_steps(driven, ball_speed, timestep):
    """Whatever parts cuts make of a step, the bat is where its torque has taken it."""

    def hits(dt, phases, impact):
        return np.array(
            [
                batted(dt, phase, driven=driven, ball_speed=ball_speed, impact=impact)
                for phase in phases
            ]
        )

    # The bat is faster the longer it was driven, as the root of its way, which over 6 % of that is
    # a straight line to 1e-4.
    exact = np.array(
        [np.interp(PHASES, PHASES[::5], of) for of in hits(FINE, PHASES[::5], "none").T]
    )
    cut = hits(timestep, PHASES, "cut").T
    # Torque is held over each step, of which the rest after the hit pushes on: second order in
    # omega H = 0.15 at 5 ms, 0.02, of which a seventh of the speed and a fifth of a radian is left.
    speed = np.linalg.norm(exact, axis=0)
    # A torque that goes on for the 1.2 ms of the hit turns the bat by 3 % faster, of which the ball
    # has a third.
    by_impulse = speed_by_impulse(driven=driven, ball_speed=ball_speed)
    assert speed[0] == pytest.approx(by_impulse, rel=0.012 if driven else 1e-4)
    assert np.linalg.norm(cut, axis=0) == pytest.approx(speed, rel=3e-3)
    assert angle_of(cut) == pytest.approx(angle_of(exact), abs=0.25)


def paddled(timestep, phase, half):
    """Return the direction (deg) of a ball off a box that turns, `half` of it (m) thick."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0" timestep="{timestep}"/><worldbody>
          <body mocap="true">
            <geom name="paddle" type="box" size=".3 {half} .08" pos=".5 0 0"/></body>
          <body><freejoint/><geom name="ball" size=".02" mass=".0027"/></body>
        </worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model, mocap_timeconst=0.0)
    material = dashpot.Material(stiffness=3e4, restitution=0.8, friction=0.3)
    engine.set_pair_material("paddle", "ball", material)
    data = engine.make_data()
    turn, level = 5.0, 0.05 + 1e-3 * phase
    data.qpos[:3] = 0.5, 0.03 + 2.0 * level, 0.0
    data.qvel[1] = -2.0

    def pose(time):
        half_turn = 0.5 * turn * (time - level)
        return np.cos(half_turn), 0.0, 0.0, np.sin(half_turn)

    data.mocap_quat[0] = pose(0.0)
    for step in range(round(0.09 / timestep)):
        data.mocap_quat[0] = pose((step + 1) * timestep)
        engine.step(data)
    return angle_of(data.qvel[:2])


@pytest.mark.parametrize("timestep", [0.002, 0.005])
@pytest.mark.parametrize("half", [0.01, 0.06])
def test_a_flat_face_that_turns_throws_a_ball_back_along_the_normal_that_it_meets(half, timestep):
    """Not along that of the start of the step, off by up to 5 rad/s times the step: 1.4 deg."""
    exact = paddled(FINE, 0.0, half)
    # Back where it came from, but for the turn of the face where they meet, some degrees.
    assert abs(exact) < 5.0
    angles = [paddled(timestep, phase, half) for phase in PHASES]
    # The face turns on by 0.13 deg in half of the hit, pi / 2 sqrt(m / k) = 0.47 ms, which throws
    # the ball about twice as far aside; off by half a step it would be 0.3 and 0.7 times two.
    assert np.abs(angles - exact).max() < 0.3
