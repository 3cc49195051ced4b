"""A light body between heavy ones, on a model's own solref: damped as MuJoCo damps the heavy."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine, law

TIMECONST = 0.01  # s
# A ball of 0.2 kg on a plate, under a press that slides.
PRESS = """<mujoco><option timestep="{timestep}" gravity="0 0 0"/>
<default><geom solref="{timeconst} 1" solimp="{solimp}" condim="1"/></default><worldbody>
  <geom type="plane" size="1 1 1"/>
  <body pos="0 0 0.05"><joint type="slide" axis="0 0 1"/><geom size="0.05" mass="0.2"/></body>
  <body pos="0 0 0.15"><joint type="slide" axis="0 0 1"/>
    <geom type="box" size="0.2 0.2 0.05" mass="{mass}"/></body>
</worldbody></mujoco>"""


def press(*, mass, impedance, timestep=0.001):
    """Return the model of a press."""
    return mujoco.MjModel.from_xml_string(
        PRESS.format(
            timestep=timestep,
            timeconst=TIMECONST,
            solimp=f"{impedance} {impedance} 0.01",
            mass=mass,
        )
    )


def rebound(model, step):
    """Return the part of its speed that the press has after it hit the ball with 0.2 m/s."""
    data = mujoco.MjData(model)
    data.qvel[1] = -0.2
    for _ in range(round(1.0 / model.opt.timestep)):
        step(data)
        if data.qvel[1] > 0.0 and data.ncon == 0:
            break
    return data.qvel[1] / 0.2


@pytest.mark.parametrize("mass", [20.0, 100.0])
def test_heavy_press_rebounds_from_a_light_ball_as_mujocos_damper_lets_it(mass):
    impedance = 0.97
    model = press(mass=mass, impedance=impedance)
    engine = Engine(model)
    # Both rows of the ball have A = 1 / 0.2 kg, but for the press's own, R = (1 - d) A / d, the
    # spring d k / R and the damper b / R; one after the other they are half as stiff.
    k, b = law.solref_to_spring((TIMECONST, 1.0), impedance_width=impedance)
    regularisation = (1.0 - impedance) / impedance / 0.2
    stiffness, damping = 0.5 * impedance * k / regularisation, 0.5 * b / regularisation
    ratio = 0.5 * damping / np.sqrt(stiffness * mass)
    expected = law.damping_ratio_to_restitution(ratio)
    assert 0.2 < expected < 0.7
    # The inertia of 3 kg that the rows add in MuJoCo, and the ball's own, are left out.
    assert rebound(engine.model, engine.step) == pytest.approx(expected, abs=0.05)
    fine = press(mass=mass, impedance=impedance, timestep=1e-4)
    mujocos = rebound(fine, lambda data: mujoco.mj_step(fine, data))
    assert mujocos == pytest.approx(expected, abs=0.05)


# A light hand whose fingers have heavy motors, about balls of 0.2 kg in a row.
BALL = """<body name="ball{i}" pos="0 {y} 0"><joint type="slide" axis="0 1 0"/>
  <geom size="0.03" mass="0.2"/></body>"""
GRIPPER = """<mujoco><option timestep="{timestep}" gravity="0 0 0"/>
<default><geom solref="{timeconst} 1" solimp="{impedance} {impedance} 0.01" condim="1"/></default>
<worldbody>{balls}
  <body name="hand" pos="0 0 0.2"><joint type="slide" axis="0 1 0"/>
    <geom size="0.01" mass="0.3" contype="0" conaffinity="0"/>
    <body name="left" pos="0 -{reach} -0.2">
      <joint type="slide" axis="0 1 0" armature="{motor}"/>
      <geom type="box" size="0.02 0.01 0.02" mass="0.1"/></body>
    <body name="right" pos="0 {reach} -0.2">
      <joint type="slide" axis="0 -1 0" armature="{motor}"/>
      <geom type="box" size="0.02 0.01 0.02" mass="0.1"/></body>
  </body></worldbody></mujoco>"""


def opening(model, step):
    """Return the part of their speed at which fingers open that closed at 0.2 m/s each."""
    data = mujoco.MjData(model)
    data.qvel[-2:] = 0.2
    for _ in range(round(1.0 / model.opt.timestep)):
        step(data)
        if data.qvel[-1] < 0.0 and data.ncon == 0:
            break
    assert data.qpos[-3] == pytest.approx(0.0, abs=1e-4)  # the hand, to rounding: fingers are alike
    return -data.qvel[-1] / 0.2


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("motor", [20.0, 100.0])
def test_heavy_fingers_of_a_light_hand_open_as_mujocos_damper_lets_them(motor, count):
    impedance = 0.97

    def gripper(timestep):
        balls = "".join(BALL.format(i=i, y=0.06 * i - 0.03 * (count - 1)) for i in range(count))
        return mujoco.MjModel.from_xml_string(
            GRIPPER.format(
                timestep=timestep,
                timeconst=TIMECONST,
                impedance=impedance,
                motor=motor,
                balls=balls,
                reach=0.03 * count + 0.01,
            )
        )

    engine = Engine(gripper(0.001))
    k, b = law.solref_to_spring((TIMECONST, 1.0), impedance_width=impedance)
    weights = engine.model.body_invweight0[:, 0]
    ball, finger = (weights[engine.model.body(name).id] for name in ("ball0", "left"))
    # From a finger to the middle: its contact, and half of the one between two balls.
    inverse_mass = ball + finger + (count - 1) * 0.5 * (2.0 * ball)
    regularisation = (1.0 - impedance) / impedance * inverse_mass
    stiffness, damping = impedance * k / regularisation, b / regularisation
    # The hand stays where it is: what moves are the fingers.
    ratio = 0.5 * damping / np.sqrt(stiffness * (motor + 0.1))
    expected = law.damping_ratio_to_restitution(ratio)
    assert 0.1 < expected < 0.7
    # The inertia that rows add in MuJoCo is left out.
    assert opening(engine.model, engine.step) == pytest.approx(expected, abs=0.05)
    fine = gripper(1e-4)
    mujocos = opening(fine, lambda data: mujoco.mj_step(fine, data))
    assert mujocos == pytest.approx(expected, abs=0.05)
