"""Reported forces of contacts and limits are those that moved jointed robots in the step."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np
import pytest

import dashpot
from legged_scenes import bob_above_foot

GRAVITY = 9.81
INTEGRATORS = ["Euler", "implicitfast", "implicit"]
FEET = range(4)


def leg(name: int, side: tuple[int, int]) -> str:
    return f"""<body pos="{0.25 * side[0]} {0.12 * side[1]} 0">
      <joint name="hip{name}" axis="1 0 0"/><geom size=".03" mass=".3"/>
      <body pos="0 {0.05 * side[1]} 0"><joint name="thigh{name}" axis="0 1 0"/>
        <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.2" mass=".6"/>
        <body pos="0 0 -.2"><joint name="knee{name}" axis="0 1 0"/>
          <geom type="capsule" size=".012" fromto="0 0 0 0 0 -.2" mass=".2"/>
          <body name="foot{name}" pos="0 0 -.2">
            <geom class="foot" size=".02" mass=".05"/><site name="foot{name}" size=".03"/></body>
        </body></body></body>"""


class Quadruped:
    """A trunk on four legs with position servos, whose spherical feet are just on the floor."""

    BEND = np.tile([0.0, 0.6, -1.2], 4)

    def __init__(self, timestep: float, integrator: str) -> None:
        names = [f"{joint}{i}" for i in FEET for joint in ("hip", "thigh", "knee")]
        servos = "".join(f'<position joint="{name}" kp="400" kv="2"/>' for name in names)
        sensors = "".join(f'<touch site="foot{i}"/><force site="foot{i}"/>' for i in FEET)
        legs = "".join(leg(i, side) for i, side in enumerate(itertools.product((1, -1), (1, -1))))
        model = mujoco.MjModel.from_xml_string(f"""<mujoco>
          <option timestep="{timestep}" integrator="{integrator}"/>
          <default><joint armature=".005" damping=".3"/><geom contype="0" conaffinity="0"/>
            <default class="foot"><geom contype="1" conaffinity="1" friction=".8"/></default>
          </default>
          <worldbody><geom class="foot" type="plane" size="9 9 .1"/>
            <body name="trunk" pos="0 0 {0.4 * np.cos(0.6) + 0.02}"><freejoint/><site name="trunk"/>
              <geom type="box" size=".25 .1 .06" mass="8"/>{legs}</body></worldbody>
          <actuator>{servos}</actuator>
          <sensor>{sensors}<accelerometer name="trunk" site="trunk"/></sensor></mujoco>""")
        self.engine = dashpot.Engine(model)
        self.model, self.timestep = self.engine.model, timestep
        self.data, self._copy = self.engine.make_data(), mujoco.MjData(self.model)
        self.data.qpos[7:] = self.data.ctrl[:] = self.BEND
        self.weight = GRAVITY * self.model.body_subtreemass[1]

    def momentum(self) -> tuple[np.ndarray, np.ndarray]:
        """Return that of all, and that of all but the feet."""
        model, copy = self.model, self._copy
        copy.qpos[:], copy.qvel[:] = self.data.qpos, self.data.qvel
        mujoco.mj_forward(model, copy)
        mujoco.mj_subtreeVel(model, copy)
        of_all = model.body_subtreemass[1] * copy.subtree_linvel[1]
        feet = [model.body(f"foot{i}").id for i in FEET]
        return of_all, of_all - model.body_mass[feet] @ copy.subtree_linvel[feet]

    def step(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean force on all but weight, and on all but the feet."""
        before = self.momentum()
        self.engine.step(self.data)
        after = self.momentum()
        masses = self.weight / GRAVITY * np.array([1.0, 1.0 - 0.2 * GRAVITY / self.weight])
        up = np.array([0.0, 0.0, GRAVITY])
        whole, rest = (
            (b - a) / self.timestep + m * up for a, b, m in zip(before, after, masses, strict=True)
        )
        return whole, rest

    def contact_force(self) -> np.ndarray:
        """Return the sum of the forces of `Engine.contacts` on the robot."""
        contacts = self.engine.contacts(self.data)
        first_is_floor = contacts.geom[:, 0] == 0
        forces = np.einsum("cij,ci->cj", contacts.frame, contacts.force)
        return np.where(first_is_floor, 1.0, -1.0) @ forces

    def feet_in_sensors(self) -> tuple[float, np.ndarray]:
        """Return the sums of what touch sensors read, and of what the feet exert on the legs."""
        readings = self.data.sensordata[:16].reshape(4, 4)
        turns = [self.data.site(f"foot{i}").xmat.reshape(3, 3) for i in FEET]
        on_legs = -sum(turn @ force for turn, force in zip(turns, readings[:, 1:], strict=True))
        return readings[:, 0].sum(), on_legs


@pytest.mark.parametrize("timestep", [0.004])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_forces_on_a_squatting_robot_are_the_change_of_its_momentum(integrator, timestep):
    robot = Quadruped(timestep, integrator)
    data = robot.data
    # Coriolis forces change within a step by some 1e-6 of the weight at 4 ms.
    tolerance = 1e-5 * robot.weight
    heaviest = 0.0
    while data.time < 0.8:
        bend = 0.1 * np.sin(2 * np.pi * data.time)
        data.ctrl[:] = robot.BEND + np.tile([0.0, bend, -2 * bend], 4)
        velocity, turn = data.qvel[:3].copy(), np.zeros(9)
        mujoco.mju_quat2Mat(turn, data.qpos[3:7])
        force, on_rest = robot.step()
        if data.time < 0.3:  # it settles on its servos
            continue
        np.testing.assert_allclose(robot.contact_force(), force, rtol=0, atol=tolerance)
        np.testing.assert_allclose(data.qfrc_constraint[:3], force, rtol=0, atol=tolerance)
        touch, on_legs = robot.feet_in_sensors()
        assert touch == pytest.approx(force[2], abs=tolerance)
        np.testing.assert_allclose(on_legs, on_rest, rtol=0, atol=tolerance)
        gained = (data.qvel[:3] - velocity) / timestep + [0, 0, GRAVITY]
        felt = turn.reshape(3, 3) @ data.sensor("trunk").data
        np.testing.assert_allclose(felt, gained, rtol=0, atol=1e-9)
        mujoco.mj_rnePostConstraint(robot.model, data)
        np.testing.assert_allclose(data.cfrc_ext[1:, 3:].sum(axis=0), force, rtol=0, atol=tolerance)
        heaviest = max(heaviest, force[2])
    assert heaviest > 1.03 * robot.weight


@pytest.mark.parametrize("timestep", [0.002])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_forces_of_a_landing_add_up_to_the_momentum_that_they_take(integrator, timestep):
    robot = Quadruped(timestep, integrator)
    data = robot.data
    data.qvel[2] = -2.0
    start = robot.momentum()[0]
    reported = np.zeros(3)
    while data.time < 0.3:
        robot.engine.step(data)
        reported += timestep * (robot.contact_force() - [0, 0, robot.weight])
        # Legs turn by 0.02 rad in the step of the impact, which sees them as they are at its start.
        gained = robot.momentum()[0] - start
        # What would pull a foot that leaves again, or hold one that slips, is in no report: up to
        # the weight in two of the few steps in which feet come and go.
        left_out = 2.4 * timestep * robot.weight
        np.testing.assert_allclose(reported, gained, rtol=0, atol=left_out)
        contacts = robot.engine.contacts(data)
        limit = (
            robot.engine.model.geom_friction[contacts.geom, 0].max(axis=1) * contacts.force[:, 0]
        )
        assert (np.linalg.norm(contacts.force[:, 1:3], axis=1) <= limit * (1 + 1e-9) + 1e-12).all()
    assert abs(data.qvel[2]) < 0.5


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.004])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_limit_bears_what_presses_and_accelerates_the_part_at_its_end(integrator, timestep):
    """A block is pushed to the end of its slide on a carriage that a servo shakes."""
    push, mass, frequency = 30.0, 0.5, 6.0
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="{timestep}" integrator="{integrator}"/><worldbody>
        <body><joint name="carriage" type="slide" axis="1 0 0"/><geom size=".1" mass="2"/>
          <body><joint name="block" type="slide" axis="1 0 0" range="-1 0" limited="true"/>
            <geom size=".05" mass="{mass}"/></body></body></worldbody>
      <actuator><position joint="carriage" kp="4000"/><motor joint="block"/></actuator>
      <sensor><jointlimitfrc joint="block"/></sensor></mujoco>""")
    )
    data = engine.make_data()
    forces = []
    while data.time < 0.5:
        data.ctrl[:] = 0.01 * np.sin(2 * np.pi * frequency * data.time), push
        before = data.qvel.sum()
        engine.step(data)
        if data.time < 0.1:  # the block swings at its end
            continue
        # The mean force of the step, to the rounding of what is settled at its end.
        force = mass * (data.qvel.sum() - before) / timestep - push
        assert data.qfrc_constraint[1] == pytest.approx(force, abs=1e-6)
        assert data.sensordata[0] == pytest.approx(-force, abs=1e-6)
        forces.append(force)
    assert max(forces) - min(forces) > 5.0


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_corners_of_a_sole_share_what_they_bear(integrator):
    """A bob swings above a foot, whose sole touches in four corners where three would do."""
    engine = dashpot.Engine(bob_above_foot(0.004, integrator))
    data = engine.make_data()
    engine.step(data, nstep=25)
    data.qpos += [-0.3 * np.sin(0.5), 0.3 * (1 - np.cos(0.5)), 0.5, -0.5]
    data.qvel[:] = 0.0
    spread = 0.0
    for i in range(500):
        before = data.qvel[1]
        engine.step(data)
        if i < 25:  # what was moved is pressed together
            continue
        # The foot stands, but for what it gives way, and the bob turns in the step: an error of
        # second order.
        force = 6.0 * GRAVITY + (data.qvel[1] - before) / 0.004
        assert data.qfrc_constraint[1] == pytest.approx(force, abs=0.08)
        contacts = engine.contacts(data)
        assert len(contacts.force) == 4
        order = np.lexsort((contacts.position[:, 1], contacts.position[:, 0]))
        normal = contacts.force[order, 0]
        assert normal.min() > 0.0
        # Left and right are mirror images.
        np.testing.assert_allclose(normal[::2], normal[1::2], rtol=1e-6)
        # Normals and friction bear the vertical and horizontal generalized forces.
        assert normal.sum() == pytest.approx(data.qfrc_constraint[1], rel=1e-9)
        spread = max(spread, np.ptp(normal))
    assert spread > 1.0
