"""Followers on cams that throw them: where they leave, and how high they go."""

import mujoco
import numpy as np
import pytest

import dashpot

RADIUS, ECCENTRIC, SPEED = 0.03, 0.012, 30.0  # m, m, rad/s
GRAVITY = 9.81


def follower_on_a_cam(cam: str, timestep: float) -> dashpot.Engine:
    """Return an engine of an eccentric disc under a flat follower that slides up and down."""
    of_cam = 'mocap="true"' if cam == "mocap" else ""
    axle = "" if cam == "mocap" else '<joint axis="0 1 0" armature="500"/>'
    return dashpot.Engine(
        mujoco.MjModel.from_xml_string(
            f"""<mujoco><option timestep="{timestep}"/>
            <default><geom friction="1e-5"/></default><worldbody>
            <body {of_cam}>{axle}<geom type="cylinder" size="{RADIUS} .01" euler="90 0 0"
              pos="0 0 {-ECCENTRIC}" mass="3"/></body>
            <body pos="0 0 {RADIUS + 0.005 - ECCENTRIC}"><joint type="slide" axis="0 0 1"/>
              <geom type="box" size=".05 .02 .005" mass=".2"/></body>
            </worldbody></mujoco>"""
        ),
        mocap_timeconst=0.0,
    )


@pytest.mark.parametrize("cam", ["mocap", "hinge"])
@pytest.mark.parametrize("timestep", [0.0005, 0.001, 0.002, 0.005])
def test_a_follower_is_thrown_as_high_as_its_cam_lets_it_go(cam, timestep):
    """It leaves where e w^2 cos(w t) = -g, and rises by v^2 / 2 g from there.

    Its positions lead as it leaves, those of a mocap body never do: contacts saw the cam where it
    was half a step before, whose surface rises faster, and threw it by 0.08 mm/ms too high, of
    which the cam itself lifts it by all but 0.06 mm.
    """
    leaves = np.arccos(-GRAVITY / (ECCENTRIC * SPEED**2))
    speed = ECCENTRIC * SPEED * np.sin(leaves)
    height = ECCENTRIC * (1.0 - np.cos(leaves)) + speed**2 / (2.0 * GRAVITY)
    engine = follower_on_a_cam(cam, timestep)
    data = engine.make_data()
    if cam == "hinge":
        data.qvel[0] = SPEED
    highest = 0.0
    for step in range(round(0.12 / timestep)):
        if cam == "mocap":
            angle = SPEED * (step + 1) * timestep
            data.mocap_quat[0] = np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0
        engine.step(data)
        highest = max(highest, data.qpos[-1])
    # In a step positions lead by v H / 2, some e (w H)^2 / 8 near the top, where it is looked for.
    # The pose that the cam is told is that of the end of the step: 3e-4 of the height at 1 ms.
    assert highest == pytest.approx(height, abs=ECCENTRIC * (SPEED * timestep) ** 2 / 6.0 + 6e-6)
