"""Screws, racks and pinions: equalities between metres and radians hold what they carry."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dashpot import Engine

GRAVITY = 9.81
LEAD = 0.005 / (2.0 * np.pi)  # m/rad
NUT, LOAD = 1.0, 20.0  # kg
DURATION = 0.5  # s

# The nut rises by LEAD for each radian of the rotor, and carries a box that lies on it.
SCREW = f"""<mujoco><option integrator="implicitfast"/><worldbody>
  <body><joint name="turn" axis="0 0 1"/>
    <inertial pos="0 0 0" mass="1" diaginertia="{{inertia}} {{inertia}} {{inertia}}"/></body>
  <body pos=".2 0 0"><joint name="rise" type="slide" axis="0 0 1"/>
    <geom type="box" size=".1 .1 .02" mass="{NUT}"/></body>
  <body pos=".2 0 .07"><freejoint/><geom type="box" size=".05 .05 .05" mass="{LOAD}"/></body>
</worldbody>
<tendon><fixed name="way"><joint joint="rise" coef="1"/></fixed>
  <fixed name="angle"><joint joint="turn" coef="1"/></fixed></tendon>
<equality>{{thread}}</equality><actuator><motor joint="turn"/></actuator></mujoco>"""
THREADS = {
    "joint": f'<joint joint1="rise" joint2="turn" polycoef="0 {LEAD} 0 0 0"/>',
    "tendon": f'<tendon tendon1="way" tendon2="angle" polycoef="0 {LEAD} 0 0 0"/>',
}


def drive(thread: str, inertia: float, part: float, timestep: float) -> np.ndarray:
    """Return the angle and the height after driving with a part of the torque that holds."""
    xml = SCREW.format(inertia=inertia, thread=THREADS[thread])
    engine = Engine(mujoco.MjModel.from_xml_string(xml))
    engine.model.opt.timestep = timestep
    data = engine.make_data()
    data.ctrl[0] = part * (NUT + LOAD) * GRAVITY * LEAD
    engine.step(data, nstep=round(DURATION / timestep))
    return np.array(data.qpos[:2])


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("inertia", [2e-5, 2e-6])
@pytest.mark.parametrize("thread", THREADS)
def test_a_screw_holds_its_load(thread, inertia, timestep) -> None:
    """It gave way by 1 to 30 mm: MuJoCo's estimate of an inverse mass adds metres and radians.

    What is left is what rigid rows give way by, f w h^2 / (kappa h^2): of 206 N, w = 1.0 to 1.3
    per kg, micro-steps of at most 0.25 ms and a kappa h^2 of a third, as where a few rows are
    coupled, 0.05 mm, and as much again of the box on the nut.
    """
    angle, height = drive(thread, inertia, 1.0, timestep)
    assert abs(height) < 5e-5
    assert abs(height - LEAD * angle) < 1e-4


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("part", [0.8, 1.2])
def test_a_screw_lifts_its_load_as_far_as_torque_and_inertia_say(part, timestep) -> None:
    """The inertia that the torque feels is m p^2 + J."""
    inertia = 2e-5
    mass = NUT + LOAD
    torque = (part - 1.0) * mass * GRAVITY * LEAD
    way = LEAD * torque / (mass * LEAD**2 + inertia) * DURATION**2 / 2.0
    height = drive("joint", inertia, part, timestep)[1]
    assert height == pytest.approx(way, abs=5e-5)  # m, as above


PINION = 0.01  # m
# Two fingers on the racks of one pinion, and a cube between them.
GRIPPER = f"""<mujoco><option integrator="implicitfast" gravity="0 0 0"/><worldbody>
  <body><joint name="pinion" axis="0 0 1"/>
    <inertial pos="0 0 0" mass=".02" diaginertia="1e-6 1e-6 1e-6"/></body>
  <body pos="-.03 0 0"><joint name="left" type="slide" axis="1 0 0"/>
    <geom name="left" type="box" size=".005 .01 .02" mass=".05"/></body>
  <body pos=".03 0 0"><joint name="right" type="slide" axis="-1 0 0"/>
    <geom name="right" type="box" size=".005 .01 .02" mass=".05"/></body>
  <body><freejoint/><geom type="box" size=".02 .02 .02" mass=".2"/></body></worldbody>
<equality><joint joint1="left" joint2="pinion" polycoef="0 {PINION} 0 0 0"/>
  <joint joint1="right" joint2="pinion" polycoef="0 {PINION} 0 0 0"/></equality>
<actuator><motor joint="pinion"/></actuator></mujoco>"""


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_a_pinion_presses_with_its_torque(timestep) -> None:
    """Fingers were 1.5 to 17 mm off their racks, and pressed with 8 to 15 N for 10."""
    force = 10.0
    engine = Engine(mujoco.MjModel.from_xml_string(GRIPPER))
    engine.model.opt.timestep = timestep
    data = engine.make_data()
    data.ctrl[0] = 2.0 * force * PINION
    engine.step(data, nstep=round(0.5 / timestep))
    pressed = engine.contacts(data).force[:, 0].sum() / 2.0
    assert pressed == pytest.approx(force, rel=1e-6)
    # As above, with w = 120 / kg: 0.23 mm at 5 ms.
    assert np.abs(data.qpos[1:3] - PINION * data.qpos[0]).max() < 3e-4
