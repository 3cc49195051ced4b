"""Hands that hold an object by position control, with loops closed by equalities."""

import numpy as np
import pytest

import dashpot
from grasps import LINK, Grasp, linkage

TIMESTEPS = (0.002, 0.005)


def gripped(timestep: float, **options: float) -> tuple[Grasp, dashpot.Engine, object]:
    """Return a gripper one second after it closed."""
    grasp = linkage(timestep, **options)
    engine = dashpot.Engine(grasp.model)
    data = engine.make_data()
    grasp.start(data)
    data.ctrl[:] = grasp.control
    engine.step(data, nstep=round(1.0 / timestep))
    return grasp, engine, data


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_linkage_holds_an_object_still(timestep):
    grasp, engine, data = gripped(timestep)
    before, loops = grasp.relative(data), grasp.loop_error(data)
    engine.step(data, nstep=round(10.0 / timestep))
    # 0.01 mm in 10 s is the bound. It takes up to five of them to come to rest; then nothing moves.
    assert np.linalg.norm(grasp.relative(data) - before) <= 1e-6
    assert np.abs(data.qvel).max() < 1e-9
    before = grasp.relative(data)
    engine.step(data, nstep=round(2.0 / timestep))
    assert np.linalg.norm(grasp.relative(data) - before) <= 1e-12
    # Loops give elastically under 13 N on links of 10 g, and do not drift.
    assert grasp.loop_error(data) == pytest.approx(loops, abs=1e-8)
    assert loops < 20.0 * timestep**2 + 1e-4


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_fingers_press_with_what_the_actuator_gives(timestep):
    """Virtual work: both pads move by LINK cos(angle) as the drivers turn."""
    _, engine, data = gripped(timestep)
    contacts = engine.contacts(data)
    normal = contacts.force[:, 0].sum()
    lever = LINK * np.cos(data.joint("right_driver").qpos[0])
    torque = data.actuator_force[0]
    # 1 %: driver and follower are parallel up to the sag of the loops.
    assert normal * lever == pytest.approx(torque, rel=0.01)
    # Friction carries the weight.
    assert data.joint("lift").qfrc_constraint[0] == pytest.approx(-0.3 * 9.81, rel=1e-3)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_shaken_linkage_does_not_let_the_object_slip(timestep):
    grasp, engine, data = gripped(timestep)

    def shake(periods: int) -> np.ndarray:
        """Return the mean relative position over the last of some periods at 2 Hz, 3 cm."""
        positions = []
        for step in range(round(0.5 * periods / timestep)):
            data.ctrl[1] = 0.03 * np.sin(4 * np.pi * step * timestep)
            engine.step(data)
            positions.append(grasp.relative(data))
        return np.mean(positions[-round(0.5 / timestep) :], axis=0)

    before = shake(4)
    # 4.7 m/s^2 of shaking and 9.8 of weight on 0.3 kg are 4.4 N of 10 N of friction.
    assert np.linalg.norm(shake(8) - before) <= 2e-5


def most_that_friction_bears(engine: dashpot.Engine, data: object, held: int) -> float:
    """Return the force (N) at the centre of mass at which all points of the pads slip.

    Four points bear n each, z above and below the centre, which is a beside them: a quarter of the
    force F along z, and of its moment F a a part by forces F' along x, the other by torsion T, as
    they share the limit surface best: (F / 4)^2 + F'^2 = (mu n)^2 (1 - (T / mu' n)^2).
    """
    contacts = engine.contacts(data)
    normal = contacts.force[:, 0].mean()
    beside = data.xipos[held, 0] - contacts.position[:, 0].mean()
    height = 0.5 * np.ptp(contacts.position[:, 2])
    sliding, torsion = 0.8 * normal, 0.005 * normal
    moment = 0.25 * beside  # of a point, by N
    turning = moment**2 / ((height * sliding) ** 2 + torsion**2)
    return 1.0 / np.sqrt((0.25 / sliding) ** 2 + turning)


@pytest.mark.parametrize(("part", "holds"), [(0.96, True), (1.04, False)])
def test_what_pulls_more_than_friction_bears_slides_out(part, holds):
    grasp, engine, data = gripped(0.002)
    held = engine.model.body(grasp.held).id
    pull = part * most_that_friction_bears(engine, data, held) - 0.3 * 9.81
    before = grasp.relative(data)[2]
    for step in range(400):
        data.xfrc_applied[held, 2] = -pull * min(1.0, step / 200)
        engine.step(data)
    # Points that slip one by one leave others to bear what they do not: by less than 0.1 mm.
    fallen = before - grasp.relative(data)[2]
    assert fallen < 1e-4 if holds else fallen > 1e-2
