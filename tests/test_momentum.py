"""Contact forces are internal forces: they come in opposite pairs."""

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq

import dashpot
from scene import free_body

STEP = 0.002
STIFFNESS = 1e5  # N/m
RELATIVE_SPEED = 3.5  # m/s, a towards b with the surfaces' spin
BODIES = (
    ("a", 'type="box" size="0.1 0.05 0.08" mass="1.5"', (-0.25, 0.02, 0.01)),
    ("b", 'type="capsule" size="0.05 0.1" mass="0.7"', (0.15, 0, 0)),
    ("c", 'type="sphere" size="0.07" mass="2"', (0.0, 0.3, 0.02)),
)
VELOCITY = np.array(
    [[2, 0.1, 0, 1, -2, 3], [-1, 0, 0.1, 0, 4, -1], [0.2, -1.5, 0, 0, 0, 5]], dtype=float
)


def collide(timestep=STEP):
    bodies = "".join(free_body(*body) for body in BODIES)
    xml = f'<mujoco><option gravity="0 0 0"/><worldbody>{bodies}</worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.timestep = timestep
    engine = dashpot.Engine(model)
    for name, *_ in BODIES:
        engine.set_material(name, dashpot.Material(STIFFNESS, restitution=0.7))
    data = engine.make_data()
    data.qvel[:] = VELOCITY.ravel()
    return engine, data


def momenta(model, data) -> tuple[np.ndarray, np.ndarray]:
    """Linear momentum of each free body, and angular one about its centre (bodies, 3)."""
    linear, spin = np.zeros((model.nbody - 1, 3)), np.zeros((model.nbody - 1, 3))
    for body in range(1, model.nbody):
        q, v = 7 * (body - 1), 6 * (body - 1)
        linear[body - 1] = model.body_mass[body] * data.qvel[v : v + 3]
        mujoco.mju_rotVecQuat(
            spin[body - 1],
            model.body_inertia[body] * data.qvel[v + 3 : v + 6],
            data.qpos[q + 3 : q + 7],
        )
    return linear, spin


def momentum(model, data) -> tuple[np.ndarray, np.ndarray]:
    """Linear and angular (about the world origin) momentum of free bodies."""
    linear, spin = momenta(model, data)
    place = data.qpos.reshape(-1, 7)[:, :3]
    return linear.sum(axis=0), (np.cross(place, linear) + spin).sum(axis=0)


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
    """Within a step contact points stand still, those of its middle, while bodies move.

    What bodies shift against each other up to the middle and after it, x, leaves couples x cross p
    that cancel but for what they speed up by, at u / t in a hit of t: to a H^2 / 8 of x. They meet
    nearly head on: an eighth of that is across p.
    """
    engine, data = collide(timestep)
    _, before = momentum(engine.model, data)
    start = data.qvel.reshape(3, 6)[:, :3].copy()
    engine.step(data, nstep=round(0.5 / timestep))
    _, after = momentum(engine.model, data)
    exchanged = np.abs(
        engine.model.body_mass[1:, None] * (data.qvel.reshape(3, 6)[:, :3] - start)
    ).sum()
    assert exchanged > 5.0  # kg m/s: they did collide
    duration = np.pi * np.sqrt(0.5 / STIFFNESS)  # s, of 1.5 kg and 0.7 kg
    shift = RELATIVE_SPEED / 8 / duration * timestep**2 / 8
    assert np.linalg.norm(after - before) <= shift * exchanged


def test_angular_momentum_error_falls_with_the_square_of_the_step():
    errors = []
    for timestep in (0.008, 0.001):
        engine, data = collide(timestep)
        _, before = momentum(engine.model, data)
        engine.step(data, nstep=round(0.4 / timestep))
        errors.append(np.linalg.norm(momentum(engine.model, data)[1] - before))
    assert errors[0] > 1e-6  # of 0.2 N m s: above rounding
    # A 64th; half of that is for where in a step hits begin.
    assert errors[1] <= errors[0] / 32


def reported_by_contacts(engine, data):
    """Return contacts with a force (n): geoms, place (m) and force (N) on the second, world."""
    contacts = engine.contacts(data)
    return [(c.geom, c.position, c.frame.T @ c.force) for c in contacts if np.any(c.force)]


def reported_to_mujoco(engine, data):
    found = []
    for i, contact in enumerate(data.contact):
        local = np.zeros(6)
        mujoco.mj_contactForce(engine.model, data, i, local)
        if np.any(local):
            found.append((contact.geom, contact.pos, contact.frame.reshape(3, 3).T @ local[:3]))
    return found


REPORTS = pytest.mark.parametrize("reported", [reported_by_contacts, reported_to_mujoco])


@REPORTS
def test_reported_forces_make_the_change_of_momentum(reported):
    """Mean force over a step times the step is what each body's momentum changed by."""
    engine, data = collide()
    model, seen = engine.model, 0
    for _ in range(200):
        place = data.qpos.reshape(3, 7)[:, :3].copy()
        before, spin = momenta(model, data)
        engine.step(data)
        after, spin_after = momenta(model, data)
        impulse, turn = np.zeros((3, 3)), np.zeros((3, 3))
        forces = reported(engine, data)
        for geoms, point, force in forces:
            for geom, sign in zip(geoms, (-1.0, 1.0), strict=True):
                body = model.geom_bodyid[geom] - 1
                impulse[body] += sign * STEP * force
                turn[body] += np.cross(point - place[body], sign * STEP * force)
        np.testing.assert_allclose(impulse, after - before, atol=1e-12)
        # Points are those of the start of the step, forces act where they are in its middle.
        arm = 0.5 * STEP * RELATIVE_SPEED
        most = arm * max((STEP * np.linalg.norm(f) for *_, f in forces), default=0.0)
        np.testing.assert_allclose(turn, spin_after - spin, atol=most + 1e-12)
        seen += len(forces)
    assert seen > 3


@REPORTS
@pytest.mark.parametrize("timestep", [0.0005, 0.002, 0.010])
def test_reported_forces_are_those_of_a_spring_and_damper(reported, timestep):
    """Balls meet head on: a closed form, which lets go where its force is zero."""
    mass, radius, speed, restitution = (2.0, 0.7), 0.07, 2.0, 0.7
    onset = 2.3 * timestep
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}" gravity="0 0 0"/><worldbody>
        <body><freejoint/><geom name="a" size="{radius}" mass="{mass[0]}"/></body>
        <body pos="{2 * radius + speed * onset} 0 0"><freejoint/>
          <geom name="b" size="{radius}" mass="{mass[1]}"/></body></worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    engine.set_pair_material("a", "b", dashpot.Material(STIFFNESS, restitution=restitution))
    data = engine.make_data()
    data.qvel[0] = speed
    # Schwager and Poeschel, Granular Matter 9 (2007): e = exp(-2 z arccos(z) / sqrt(1 - z^2)).
    zeta = brentq(
        lambda z: np.log(restitution) + 2 * z * np.arccos(z) / np.sqrt(1 - z * z), 0, 0.99
    )
    reduced = 1.0 / (1.0 / mass[0] + 1.0 / mass[1])
    omega, sine = np.sqrt(STIFFNESS / reduced), np.sqrt(1 - zeta * zeta)
    duration = 2 * np.arccos(zeta) / (omega * sine)

    def closing(time):
        phase = omega * sine * np.clip(time - onset, 0.0, duration)
        return speed * np.exp(-zeta / sine * phase) * (np.cos(phase) - zeta / sine * np.sin(phase))

    pushed = 0
    for step in range(2 + round(duration / timestep) + 3):
        engine.step(data)
        expected = reduced / timestep * (closing(step * timestep) - closing((step + 1) * timestep))
        forces = reported(engine, data)
        assert len(forces) == (expected > 1e-9)
        for _, _, force in forces:
            # Rounding, of the place where the step begins in the hit too.
            np.testing.assert_allclose(force, [expected, 0.0, 0.0], rtol=1e-9, atol=1e-9)
            pushed += 1
    assert pushed > 0
    assert data.qvel[6] - data.qvel[0] == pytest.approx(restitution * speed, rel=1e-9)
