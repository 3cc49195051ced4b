"""Load that statics leaves open: contacts of two bodies are springs of one stiffness."""

import mujoco
import numpy as np
import pytest

import dashpot

GRAVITY = 9.81
MASS = 1.0
TIMESTEPS = [0.001, 0.002, 0.005]


def settled_loads(feet, *, timestep, load_at):
    """Return forces (N) on feet of a plank of 1 kg at given x, with 1 kg more at `load_at`."""
    balls = "".join(f'<geom size=".01" pos="{x} 0 0" mass="0"/>' for x in feet)
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{timestep}"/>
      <default><geom condim="1"/></default><worldbody>
      <geom type="plane" size="9 9 .1"/>
      <body pos="0 0 .01"><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>
        <geom type="box" size=".5 .02 .002" pos="0 0 .02" mass="{MASS}"/>
        <geom size=".001" pos="{load_at} 0 .02" mass="1"/>{balls}</body></worldbody></mujoco>""")
    engine = dashpot.Engine(model)
    data = engine.make_data()
    engine.step(data, nstep=round(1.0 / timestep))
    contacts = engine.contacts(data)
    order = np.argsort(contacts.position[:, 0])
    return contacts.force[order, 0]


def spring_loads(feet, load_at):
    """Return forces (N) of equal springs under a rigid plank: linear in x."""
    x = np.array(feet)
    weight = (MASS + 1.0) * GRAVITY
    basis = np.stack([np.ones_like(x), x])
    return basis.T @ np.linalg.solve(basis @ basis.T, [weight, GRAVITY * load_at])


@pytest.mark.parametrize("timestep", TIMESTEPS)
@pytest.mark.parametrize(
    ("feet", "load_at"),
    [
        ([-0.5, 0.0, 0.5], 0.0),
        ([-0.5, -0.1, 0.1, 0.5], 0.1),
        ([-0.5, -0.3, -0.1, 0.1, 0.3, 0.5], 0.0),
        ([-0.5, -0.4, 0.0, 0.5], -0.15),
    ],
)
def test_feet_of_one_plank_bear_what_equal_springs_do(feet, load_at, timestep):
    loads = settled_loads(feet, timestep=timestep, load_at=load_at)
    # By apparent masses of their own, three feet would read 3.3, 13.1 and 3.3 N of 6.5 each.
    assert loads == pytest.approx(spring_loads(feet, load_at), rel=2e-3)


DRIVE = """<mujoco><option timestep="{timestep}" integrator="implicitfast"/><worldbody>
  <geom name="floor" type="plane" size="50 50 .1" friction="1"/>
  <body pos="0 0 .05"><freejoint/>
    <geom type="cylinder" size=".15 .02" mass="4" contype="0" conaffinity="0" pos="-.03 0 0"/>
    <geom size=".02" pos="-.12 0 -.03" condim="1" priority="1" mass=".05"/>
    <body pos="0 {track} 0"><joint name="l" axis="0 1 0"/>
      <geom type="cylinder" size=".05 {half}" euler="90 0 0" mass=".3"/></body>
    <body pos="0 -{track} 0"><joint name="r" axis="0 1 0"/>
      <geom type="cylinder" size=".05 {half}" euler="90 0 0" mass=".3"/></body>
  </body></worldbody>
  <actuator><velocity joint="l" kv="1"/><velocity joint="r" kv="1"/></actuator></mujoco>"""


@pytest.mark.parametrize("timestep", [0.001, 0.005])
@pytest.mark.parametrize(("track", "half"), [(0.12, 0.015), (0.2, 0.02), (0.15, 0.03)])
def test_wheels_of_some_width_turn_about_their_outer_rims(track, half, timestep):
    """Both rims of a wheel bear alike, so the one that scrubs less grips: the outer ones.

    The yaw rate is the difference of the wheels' speeds over the distance of the outer rims.
    """
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string(DRIVE.format(track=track, half=half, timestep=timestep))
    )
    data = engine.make_data()

    def yaw():
        return 2.0 * np.arctan2(data.qpos[6], data.qpos[3])

    ramp = round(1.0 / timestep)
    for i in range(ramp):
        data.ctrl[:] = np.array([10.0, 6.0]) * min(1.0, 2.0 * i / ramp)
        engine.step(data)
    angles, turned = [yaw()], data.qpos[7:9].copy()
    for _ in range(20):
        engine.step(data, nstep=round(0.05 / timestep))
        angles.append(yaw())
    rolled = 0.05 * float((data.qpos[7] - turned[0]) - (data.qpos[8] - turned[1]))
    turn = np.unwrap(angles, period=4.0 * np.pi)
    # Inner rims would turn it by (track + half) / (track - half), 1.2 to 1.5 times as far.
    assert abs(turn[-1] - turn[0]) == pytest.approx(abs(rolled) / (2 * (track + half)), rel=5e-3)


@pytest.mark.parametrize("timestep", TIMESTEPS)
@pytest.mark.parametrize("feet", [(-0.5, 0.0, 0.5), (-0.4, -0.3, 0.0, 0.1, 0.6)])
def test_a_bar_on_many_feet_spins_down_by_the_arms_of_all(feet, timestep):
    """Each foot bears its share as a spring does, and friction acts on its own arm."""
    friction, rate = 0.3, 6.0
    balls = "".join(f'<geom size=".01" pos="{x} 0 0" mass="0"/>' for x in feet)
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{timestep}"/>
      <default><geom friction="{friction} 0 0"/></default><worldbody>
      <geom type="plane" size="9 9 .1"/><body pos="0 0 .01"><joint type="slide" axis="0 0 1"/>
      <joint axis="0 1 0" pos="0 0 0"/><joint name="spin" axis="0 0 1"/>
      <geom type="box" size=".6 .02 .002" pos="0 0 .011" mass="1" contype="0" conaffinity="0"/>
      {balls}</body></worldbody></mujoco>""")
    engine = dashpot.Engine(model)
    data = engine.make_data()
    engine.step(data, nstep=round(0.2 / timestep))
    data.qvel[2] = rate
    steps = round(0.2 / timestep)
    before = data.qvel[2]
    engine.step(data, nstep=steps)
    x = np.array(feet)
    basis = np.stack([np.ones_like(x), x])
    loads = basis.T @ np.linalg.solve(basis @ basis.T, [GRAVITY, 0.0])
    inertia = (0.6**2 + 0.02**2) / 3.0
    slowing = friction * float(loads @ np.abs(x)) / inertia
    assert before - data.qvel[2] == pytest.approx(slowing * steps * timestep, rel=0.01)
