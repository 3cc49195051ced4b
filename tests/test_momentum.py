"""Contact forces are internal forces: they come in opposite pairs."""

import mujoco
import numpy as np
import pytest

import dashpot
from scene import free_body

STEP = 0.002
BODIES = (
    ("a", 'type="box" size="0.1 0.05 0.08" mass="1.5"', (-0.25, 0.02, 0.01)),
    ("b", 'type="capsule" size="0.05 0.1" mass="0.7"', (0.15, 0, 0)),
    ("c", 'type="sphere" size="0.07" mass="2"', (0.0, 0.3, 0.02)),
)
VELOCITY = np.array(
    [[2, 0.1, 0, 1, -2, 3], [-1, 0, 0.1, 0, 4, -1], [0.2, -1.5, 0, 0, 0, 5]], dtype=float
)


def collide(timestep=STEP, material=None):
    bodies = "".join(free_body(*body) for body in BODIES)
    xml = f'<mujoco><option gravity="0 0 0"/><worldbody>{bodies}</worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.timestep = timestep
    engine = dashpot.Engine(model)
    for name, *_ in BODIES:
        engine.set_material(name, material or dashpot.Material(1e5, restitution=0.7))
    data = engine.make_data()
    data.qvel[:] = VELOCITY.ravel()
    return engine, data


def momentum(model, data) -> tuple[np.ndarray, np.ndarray]:
    """Linear and angular (about the world origin) momentum of free bodies."""
    linear, angular = np.zeros(3), np.zeros(3)
    for body in range(1, model.nbody):
        q, v = 7 * (body - 1), 6 * (body - 1)
        p = model.body_mass[body] * data.qvel[v : v + 3]
        spin = np.zeros(3)
        mujoco.mju_rotVecQuat(
            spin, model.body_inertia[body] * data.qvel[v + 3 : v + 6], data.qpos[q + 3 : q + 7]
        )
        linear += p
        angular += np.cross(data.qpos[q : q + 3], p) + spin
    return linear, angular


@pytest.mark.parametrize("timestep", [0.0005, 0.002, 0.010])
def test_linear_momentum_is_kept(timestep):
    engine, data = collide(timestep)
    before, _ = momentum(engine.model, data)
    velocity = data.qvel.copy()
    engine.step(data, nstep=round(0.5 / timestep))
    after, _ = momentum(engine.model, data)
    assert np.abs(data.qvel - velocity)[:3].max() > 0.5  # they did collide
    np.testing.assert_allclose(after, before, atol=1e-12 * 6)  # rounding of 6 kg m/s


@pytest.mark.parametrize("timestep", [0.0005, 0.002, 0.010])
def test_angular_momentum_is_kept(timestep):
    """Within a step contact points stand still while bodies move.

    An impulse p that acts while the bodies have shifted by x relative to each other since the
    step's start leaves the couple x cross p. It is at most h |u| |p| per step, u the relative
    velocity: summed over an impact h |u| (momentum exchanged).
    """
    engine, data = collide(timestep)
    _, before = momentum(engine.model, data)
    start = data.qvel.reshape(3, 6)[:, :3].copy()
    engine.step(data, nstep=round(0.5 / timestep))
    _, after = momentum(engine.model, data)
    exchanged = np.abs(
        engine.model.body_mass[1:, None] * (data.qvel.reshape(3, 6)[:, :3] - start)
    ).sum()
    relative_speed = 3.5  # m/s, a towards b with the surfaces' spin
    assert np.linalg.norm(after - before) <= timestep * relative_speed * exchanged


def test_angular_momentum_error_falls_with_the_step():
    errors = []
    for timestep in (0.008, 0.001):
        engine, data = collide(timestep)
        _, before = momentum(engine.model, data)
        engine.step(data, nstep=round(0.4 / timestep))
        errors.append(np.linalg.norm(momentum(engine.model, data)[1] - before))
    assert errors[1] <= 0.5 * errors[0] or errors[1] <= 1e-12  # rounding


def test_reported_forces_make_the_change_of_momentum():
    """Mean force over a step times the step is what each body's momentum changed by."""
    engine, data = collide()
    model = engine.model
    seen = 0
    for _ in range(200):
        before = data.qvel.reshape(3, 6)[:, :3].copy()
        engine.step(data)
        change = model.body_mass[1:, None] * (data.qvel.reshape(3, 6)[:, :3] - before)
        force = np.zeros((model.nbody, 3))
        for i, contact in enumerate(data.contact):
            local = np.zeros(6)
            mujoco.mj_contactForce(model, data, i, local)
            world = contact.frame.reshape(3, 3).T @ local[:3]
            force[model.geom_bodyid[contact.geom[0]]] -= world
            force[model.geom_bodyid[contact.geom[1]]] += world
        seen += np.abs(force).max() > 0
        np.testing.assert_allclose(force[1:] * STEP, change, atol=1e-11)
    assert seen > 3


def test_contacts_and_mujoco_report_the_same_forces():
    engine, data = collide()
    compared = 0
    for _ in range(200):
        engine.step(data)
        contacts = engine.contacts(data)
        mujoco_forces = []
        for i in range(data.ncon):
            local = np.zeros(6)
            mujoco.mj_contactForce(engine.model, data, i, local)
            if local[0] > 0:
                mujoco_forces.append((*data.contact[i].geom, *local[:3]))
        ours = [
            (*geom, *force)
            for geom, force in zip(contacts.geom, contacts.force, strict=True)
            if force[0] > 0
        ]
        np.testing.assert_allclose(np.array(ours), np.array(mujoco_forces), rtol=1e-12, atol=1e-12)
        compared += len(ours)
    assert compared > 3
