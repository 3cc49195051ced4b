"""A wheel that spins looks the same, however far it turns in a step."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine

GRAVITY, FRICTION, RADIUS = 9.81, 0.5, 0.1
JOINTS = {
    "free": "<freejoint/>",
    "axle": """<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
      <joint axis="0 1 0" armature="1"/>""",
}
WHEEL = """<mujoco><option timestep="{timestep}" gravity="0 0 -{gravity}"/><worldbody>
  <geom type="plane" size="50 5 .1" friction="{friction}"/>
  <body pos="0 0 {height}">{joints}<geom euler="90 0 0" type="cylinder" size="{radius} .03" mass="1"
    friction="{friction}"/></body></worldbody></mujoco>"""


def wheel(timestep: float, joints: str, height: float = RADIUS):
    engine = Engine(
        mujoco.MjModel.from_xml_string(
            WHEEL.format(
                timestep=timestep,
                gravity=GRAVITY,
                friction=FRICTION,
                radius=RADIUS,
                height=height,
                joints=JOINTS[joints],
            )
        )
    )
    return engine, engine.make_data()


@pytest.mark.parametrize("turn", [0.5, 1.9, 2.5])  # rad a step
@pytest.mark.parametrize("timestep", [0.002, 0.010])
@pytest.mark.parametrize("joints", JOINTS)
def test_a_wheel_that_slips_drives_by_friction_and_stays_down(joints, timestep, turn):
    """To v = mu g t while it slips. From 1.8 rad a step on it was shot off the floor."""
    engine, data = wheel(timestep, joints)
    data.qvel[4 if joints == "free" else 2] = turn / timestep
    # Short: steps of more than a radian do not resolve the nutation of what is free to tilt.
    engine.step(data, nstep=20)
    # As the step resolves the first sag of the spring.
    assert data.qvel[0] == pytest.approx(FRICTION * GRAVITY * data.time, rel=1e-3)
    height = data.qpos[2] - RADIUS if joints == "free" else data.qpos[1]
    assert abs(height) < 1e-5  # a rigid contact's sag


@pytest.mark.parametrize("turn", [0.5, 2.0])
def test_a_wheel_dropped_as_it_spins_lands_once(turn):
    """Impulses of friction are mu times those of the floor: v = mu g t also over the impact."""
    engine, data = wheel(0.005, "free", height=0.3)
    data.qvel[4] = turn / 0.005
    engine.step(data, nstep=60)
    assert data.qvel[0] == pytest.approx(FRICTION * GRAVITY * data.time, rel=1e-3)
    assert abs(data.qpos[2] - RADIUS) < 1e-5


@pytest.mark.parametrize("turn", [0.5, 1.8])
def test_a_wheel_that_rolls_fast_goes_straight_on(turn):
    """Its line of contact is where it was on the shape, not on the material, in mid-step."""
    engine, data = wheel(0.005, "free")
    speed = RADIUS * turn / 0.005
    data.qvel[[0, 4]] = speed, turn / 0.005
    engine.step(data, nstep=40)
    velocity = np.asarray(data.qvel[:3])
    # With contacts left at the start of the step it swerves by 1 %. What remains is its nutation,
    # which such steps do not resolve.
    np.testing.assert_allclose(velocity, [speed, 0.0, 0.0], atol=1e-3 * speed)
