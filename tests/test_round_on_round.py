"""A ball slides off a round thing: the law of its normal force, and contact to where it leaves."""

import itertools

import mujoco
import numpy as np
import pytest

from dashpot import Engine

RADIUS, BALL = 0.1, 0.02  # m
MASS = 0.1
GRAVITY = 9.81
START = 0.1  # rad from the top
ARM = RADIUS + BALL
SUPPORTS = {
    "sphere": f'size="{RADIUS}"',
    "capsule": f'type="capsule" size="{RADIUS} 1" euler="90 0 0"',
    "cylinder": f'type="cylinder" size="{RADIUS} 1" euler="90 0 0"',
    "ellipsoid": f'type="ellipsoid" size="{RADIUS} {RADIUS} {RADIUS}"',
}
BALLS = {"sphere": f'size="{BALL}"', "ellipsoid": f'type="ellipsoid" size="{BALL} {BALL} {BALL}"'}


def ball_on(support, ball, timestep, impact):
    x, z = ARM * np.sin(START), ARM * np.cos(START)
    model = mujoco.MjModel.from_xml_string(f"""
<mujoco><option timestep="{timestep}"/><default><geom friction="0"/></default><worldbody>
  <geom {SUPPORTS[support]}/>
  <body pos="{x} 0 {z}"><freejoint/><geom {BALLS[ball]} mass="{MASS}"/></body>
</worldbody></mujoco>""")
    return Engine(model, impact=impact)


# The nearest points of an ellipsoid and a cylinder are searched for: within 1e-9 m of the distance,
# which leaves sqrt(1e-9 m / 2 cm) = 2e-4 rad of the normal open, more than a short step turns it.
PAIRS = [pair for pair in itertools.product(SUPPORTS, BALLS) if pair != ("cylinder", "ellipsoid")]


@pytest.mark.parametrize("timestep", [0.001, 0.005])
@pytest.mark.parametrize(("support", "ball"), PAIRS)
def test_ball_slides_off_under_the_force_that_its_path_needs(support, ball, timestep):
    engine = ball_on(support, ball, timestep, "none")
    data = engine.make_data()
    cosine, highest = np.cos(START), 0.0
    errors = []
    while cosine > 2.0 / 3.0 * np.cos(START) + 0.05:  # it leaves at 2/3
        engine.step(data)
        x, z = data.qpos[0], data.qpos[2]
        cosine = z / np.hypot(x, z)
        highest = max(highest, np.hypot(x, z) - ARM)
        # N = m (g cos - v^2 / s), v^2 = 2 g s (cos_0 - cos), at the end of the step.
        force = GRAVITY * (3.0 * cosine - 2.0 * np.cos(START))
        errors.append(engine.contacts(data).force[:, 0].sum() / MASS - force)
    # Forces are means over the step, in which they change by 3 g sin(theta) times its turn.
    turn = timestep * np.linalg.norm(data.qvel[[0, 2]]) / ARM
    assert np.abs(errors[3:]).max() < 1.6 * GRAVITY * turn
    # A step that missed the curve would lift the ball by v^2 H^2 / 2 s: 50 um at 5 ms.
    assert highest < 0.05 * turn**2 * ARM


@pytest.mark.parametrize("impact", ["none", "cut"])
def test_ball_leaves_a_sphere_with_the_speed_of_its_fall(impact):
    engine = ball_on("sphere", "sphere", 0.001, impact)
    data = engine.make_data()
    while data.qpos[2] > 0.5 * ARM:
        engine.step(data)
    cosine = 2.0 / 3.0 * np.cos(START)
    # First order in the part of a step between it and where the force ends: 1e-4.
    assert data.qvel[0] == pytest.approx(np.sqrt(GRAVITY * ARM * cosine) * cosine, rel=2e-4)
