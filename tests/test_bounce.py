"""A ball that bounces on a Kelvin-Voigt floor follows the exact piecewise solution at any step."""

import functools
from itertools import product

import mujoco
import numpy as np
import pytest

import dashpot
from exact import BouncingBall, damping_ratio_of, restitution_of
from scenes import ball_drop
from simulate import make_engine

TIMESTEPS = (1e-3, 2e-3, 1e-2)
STIFFNESS, GRAVITY, RADIUS = 1e4, 9.81, 0.1


@functools.cache
def exact_solution(restitution: float) -> BouncingBall:
    damping = 2 * damping_ratio_of(restitution) * STIFFNESS**0.5
    return BouncingBall(1.0, STIFFNESS, damping, until=10.0)


@functools.cache
def first_apices(restitution: float) -> list[tuple[float, float]]:
    return exact_solution(restitution).apices(10)


def drop(restitution: float, timestep: float):
    scene = ball_drop(restitution=restitution, stiffness=STIFFNESS)
    engine = make_engine(scene, scene.model(timestep))
    return engine, engine.make_data()


def state_at(engine, data, step: int) -> tuple[float, float]:
    """Advance to the given step; gap and gap rate there."""
    done = round(data.time / engine.model.opt.timestep)
    if step > done:
        engine.step(data, nstep=step - done)
    return data.qpos[2] - RADIUS, data.qvel[2]


def test_the_reference_has_the_asked_restitution():
    for restitution in (0.9, 0.5):
        assert restitution_of(float(damping_ratio_of(restitution))) == pytest.approx(
            restitution, abs=1e-15
        )


@pytest.mark.parametrize(
    ("restitution", "timestep"), [*product((1.0, 0.9, 0.5), TIMESTEPS), (0.9, 1e-4)]
)
def test_first_ten_apices(restitution, timestep):
    engine, data = drop(restitution, timestep)
    apices = first_apices(restitution)
    assert len(apices) == 10
    compared = 0
    for time, height in apices:
        if height < 0:  # the last of the slow bounces are oscillations within the contact
            break
        gap, rate = state_at(engine, data, round(time / timestep))
        if gap < 0:  # the nearest step lies outside the flight
            continue
        # The step is exact, so 1e-9 m leaves room only for rounding over 1e5 steps.
        assert gap + rate**2 / (2 * GRAVITY) == pytest.approx(height, abs=1e-9)
        compared += 1
    assert compared == (4 if restitution == 0.5 else 10)


@pytest.mark.parametrize("timestep", TIMESTEPS)
@pytest.mark.parametrize("restitution", [1.0, 0.9, 0.5])
def test_state_matches_at_every_sampled_step_in_flight_and_contact(restitution, timestep):
    engine, data = drop(restitution, timestep)
    exact = exact_solution(restitution)
    rng = np.random.default_rng(1)
    impacts = [float(p.start) for p in exact.phases if p.contact][:10]
    # Random instants, and instants inside the first ten contacts (0.03 s long).
    times = np.concatenate([rng.uniform(0, 9.0, 40), np.array(impacts) + 0.012])
    for step in sorted({round(t / timestep) for t in times if t < 9.9}):
        gap, rate = state_at(engine, data, step)
        expected = exact.state(step * timestep)
        assert gap == pytest.approx(expected[0], abs=1e-9)
        assert rate == pytest.approx(expected[1], abs=1e-7)  # 100 rad/s times 1e-9 m


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_energy_is_conserved_without_damping(timestep):
    engine, data = drop(1.0, timestep)
    start = engine.energy(data)
    total = start.kinetic + start.potential + start.elastic
    exact = exact_solution(1.0)
    contacts = [float(p.start) + 0.012 for p in exact.phases if p.contact]
    for time in sorted([*np.linspace(0.3, 9.0, 20), *contacts]):
        state_at(engine, data, round(time / timestep))
        now = engine.energy(data)
        # Relative to the energy above the floor, 9.81 J.
        assert now.kinetic + now.potential + now.elastic - total == pytest.approx(
            0, abs=1e-9 * GRAVITY
        )


def test_two_balls_in_flight_exchange_velocities():
    """Equal masses, e = 1, head on, no gravity: velocities are exchanged, at any step."""
    import dashpot

    xml = """<mujoco><option gravity="0 0 0" timestep="0.005"/><worldbody>
      <body name="a" pos="-0.2 0 0"><freejoint/><geom name="a" type="sphere" size="0.1" mass="1"/>
      </body>
      <body name="b" pos="0.2 0 0"><freejoint/><geom name="b" type="sphere" size="0.1" mass="1"/>
      </body></worldbody></mujoco>"""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    engine.set_pair_material("a", "b", dashpot.Material(1e5, restitution=1.0))
    data = engine.make_data()
    data.qvel[0], data.qvel[6] = 2.0, -1.0
    engine.step(data, nstep=100)
    # One contact: exact up to rounding.
    assert data.qvel[0] == pytest.approx(-1.0, abs=1e-12)
    assert data.qvel[6] == pytest.approx(2.0, abs=1e-12)


BALL_ABOVE_FLOOR = """<mujoco><option timestep="0.01"/><worldbody>
  <geom type="plane" size="0 0 1"/>
  <body pos="0 0 1.1"><freejoint/><geom name="ball" type="sphere" size="0.1" mass="0.1"/></body>
  </worldbody></mujoco>"""
BOX_ON_FLOOR = """<mujoco><option timestep="{timestep}"/><worldbody>
  <geom type="plane" size="0 0 1"/><body pos="0 0 0.7" quat="{attitude}"><freejoint/>
    <geom type="box" size="0.1 0.1 0.1" mass="1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("restitution", [0.8, 0.5, 0.2])
@pytest.mark.parametrize("stiffness", [1e6, 1e8])
def test_stiffness_beyond_the_micro_steps_keeps_the_restitution(stiffness, restitution):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL_ABOVE_FLOOR))
    engine.set_material("ball", dashpot.Material(stiffness, restitution=restitution))
    data = engine.make_data()
    height = data.qpos[2] - RADIUS
    while data.qvel[2] <= 0.0:
        engine.step(data)
    engine.step(data)
    speed = np.sqrt(data.qvel[2] ** 2 + 2 * GRAVITY * (data.qpos[2] - RADIUS))
    # The contact, which 64 micro-steps resolve to a millisecond, feels gravity meanwhile.
    assert speed / np.sqrt(2 * GRAVITY * height) == pytest.approx(restitution, abs=3e-3)


@pytest.mark.parametrize("timestep", [1e-3, 2e-3, 1e-2])
@pytest.mark.parametrize("attitude", ["1 0 0 0", "0.924 0.383 0 0", "0.88 0.32 0.28 0.2"])
def test_rigid_box_hardly_rebounds(attitude, timestep):
    model = mujoco.MjModel.from_xml_string(
        BOX_ON_FLOOR.format(attitude=attitude, timestep=timestep)
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    rebound, fall = 0.0, 0.0
    for _ in range(round(1.0 / timestep)):
        engine.step(data)
        fall = max(fall, -data.qvel[2])
        rebound = max(rebound, data.qvel[2])
    # Critically damped each contact alone would rebound at exp(-2) = 0.14; four that land at once
    # are damped by less, at a ratio of 0.6.
    assert rebound <= 0.27 * fall
    # It has fallen by 0.5 m and more, and the floor carries it. On its edge it sways still.
    assert fall > 3.0
    weight = engine.contacts(data).force[:, 0].sum()
    assert weight == pytest.approx(GRAVITY, rel=0.02)


FAST_MEETING = """<mujoco><option timestep="{timestep}" gravity="0 0 0"/><worldbody>
  <geom name="still" {shape} zaxis="{still}"/><body pos="0 0 0.3"><freejoint/>
    <geom name="fast" {shape} zaxis="{fast}" mass="1"/></body></worldbody></mujoco>"""
SHAPES_AND_AXES = {
    "box on box": ('type="box" size="0.05 0.05 0.05"', "0 0 1", "0 0 1"),
    "capsule across capsule": ('type="capsule" size="0.05 0.1"', "1 0 0", "0 1 0"),
}


@pytest.mark.parametrize("timestep", [2e-3, 1e-2])
@pytest.mark.parametrize("stiffness", [1e5, None])
@pytest.mark.parametrize("meeting", SHAPES_AND_AXES)
def test_restitution_of_fast_extended_bodies(meeting, stiffness, timestep):
    # At 3 m/s they go 6 mm and more in a step: points that overlap at its end are those found at
    # its start. Second contacts there would damp twice, capsules to 0.42 or 0.34.
    shape, still, fast = SHAPES_AND_AXES[meeting]
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string(
            FAST_MEETING.format(timestep=timestep, shape=shape, still=still, fast=fast)
        )
    )
    for geom in ("still", "fast"):
        engine.set_material(geom, dashpot.Material(stiffness, restitution=0.5))
    data = engine.make_data()
    data.qvel[2] = -3.0
    engine.step(data, nstep=round(0.2 / timestep))
    # All contacts of a body that does not turn load alike, without gravity: exact up to rounding.
    assert data.qvel[2] == pytest.approx(1.5, abs=1e-9)


LANDING = """<mujoco><option timestep="{timestep}" gravity="0 0 0"/><worldbody>
  <geom name="floor" type="{floor}" size="0.5 0.5 0.1" pos="0 0 {below}"/>
  <body pos="0 0 {height}" {attitude}><freejoint/><geom name="falling" {shape} mass="1"/></body>
  </worldbody></mujoco>"""
LANDING_SHAPES = {
    "plate": ('type="box" size="0.05 0.05 0.005"', 0.005, 4),
    "post": ('type="box" size="0.02 0.02 0.2"', 0.2, 4),
    "disc": ('type="cylinder" size="0.05 0.01"', 0.01, 3),
    "can": ('type="cylinder" size="0.03 0.1"', 0.1, 3),
    "lying capsule": ('type="capsule" size="0.02 0.05" quat="1 0 1 0"', 0.02, 2),
}


def land(shape, height, material, timestep, *, floor="plane", attitude="", after=0.02):
    """Return engine and data `after` (s) a body that fell at 2 m/s without gravity has landed."""
    below = -0.5 if floor == "cylinder" else 0.0
    xml = LANDING.format(
        timestep=timestep,
        floor=floor,
        below=below,
        shape=shape,
        height=height + 0.0123,
        attitude=attitude,
    )
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    engine.set_pair_material("floor", "falling", material)
    data = engine.make_data()
    data.qvel[2] = -2.0
    while data.qvel[2] == -2.0:
        engine.step(data)
    engine.step(data, nstep=round(after / timestep))
    return engine, data


@pytest.mark.parametrize("timestep", [1e-3, 2e-3, 1e-2])
@pytest.mark.parametrize("shape", LANDING_SHAPES)
def test_flat_landing_rebounds_with_the_restitution(shape, timestep):
    # Each contact damped as if it were alone, the post rebounds at 0.30, the plate at 0.58.
    geom, height, _ = LANDING_SHAPES[shape]
    _, data = land(geom, height, dashpot.Material(1e5, restitution=0.5), timestep)
    # Micro-steps resolve the coupling of the contacts to some 1e-3.
    assert data.qvel[2] == pytest.approx(1.0, abs=4e-3)
    assert np.abs(data.qvel[3:]).max() < 1e-9


@pytest.mark.parametrize("shape", LANDING_SHAPES)
def test_damping_ratio_is_that_of_the_body_on_all_of_its_contacts(shape):
    geom, height, contacts = LANDING_SHAPES[shape]
    ratio = 0.2
    _, given = land(geom, height, dashpot.Material(1e5, damping_ratio=ratio), 2e-3)
    damping = 2.0 * ratio * np.sqrt(contacts * 1e5 * 1.0) / contacts  # of 1 kg on all springs
    _, exact = land(geom, height, dashpot.Material(1e5, damping=damping), 2e-3)
    assert given.qvel[2] == pytest.approx(exact.qvel[2], rel=1e-12)
    # Micro-steps resolve the coupling of the contacts to some 1e-3.
    assert given.qvel[2] == pytest.approx(2.0 * restitution_of(ratio), abs=4e-3)


@pytest.mark.parametrize("timestep", [2e-3, 1e-2])
@pytest.mark.parametrize("shape", ["disc", "can"])
def test_flat_cylinder_on_a_cylinder_rebounds_with_the_restitution(shape, timestep):
    # It rebounded at 0.44.
    geom, height, _ = LANDING_SHAPES[shape]
    material = dashpot.Material(1e5, restitution=0.5)
    _, data = land(geom, height, material, timestep, floor="cylinder")
    assert data.qvel[2] == pytest.approx(1.0, abs=4e-3)


@pytest.mark.parametrize("timestep", [2e-4, 1e-3])
def test_corner_of_a_plate_that_comes_first_is_alone(timestep):
    # Newton: the gap rate u turns into -e u, and the impulse is (1 + e) u / w.
    geom, height, _ = LANDING_SHAPES["plate"]
    half = 0.05
    tilt = np.array([0.98, 0.12, 0.16, 0.0])
    tilt /= np.linalg.norm(tilt)
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, tilt)
    rotation = rotation.reshape(3, 3)
    corners = np.array([[x, y, -height] for x in (-half, half) for y in (-half, half)])
    arm = min((rotation @ corner for corner in corners), key=lambda corner: corner[2])
    attitude = f'quat="{" ".join(map(str, tilt))}"'
    material = dashpot.Material(1e7, restitution=0.5, friction=0.0)
    engine, data = land(geom, -arm[2], material, timestep, attitude=attitude, after=1e-3)
    inertia = rotation @ np.diag(engine.model.body_inertia[1]) @ rotation.T
    turned = np.cross(arm, [0.0, 0.0, 1.0])
    inverse_mass = 1.0 + turned @ np.linalg.solve(inertia, turned)
    expected = -2.0 + 1.5 * 2.0 / inverse_mass
    # It turns by 10 mrad meanwhile. Damped like four together, it would leave 0.03 faster.
    assert data.qvel[2] == pytest.approx(expected, abs=3e-3)


@pytest.mark.parametrize("height", [1e-3, 6e-3, 1.1e-2])
def test_friction_on_a_spinning_ball_acts_at_its_surface(height):
    # Found ahead, a contact lies in the middle of the gap; a ball that slips throughout gains
    # mu (1 + e) u m along the floor, and loses that times its radius of spin.
    radius, mu, speed, restitution = 0.05, 0.1, 3.0, 0.5
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="0.01" gravity="0 0 0"/><worldbody>
      <geom name="floor" type="plane" size="1 1 1"/><body pos="0 0 {radius + height}"><freejoint/>
        <geom name="ball" size="{radius}" mass="1"/></body></worldbody></mujoco>""")
    engine = dashpot.Engine(model)
    material = dashpot.Material(1e7, restitution=restitution, friction=(mu, 0.0, 0.0))
    engine.set_pair_material("floor", "ball", material)
    data = engine.make_data()
    data.qvel[2], data.qvel[4] = -speed, 100.0
    engine.step(data)
    gained = mu * (1.0 + restitution) * speed
    assert data.qvel[2] == pytest.approx(restitution * speed, rel=1e-9)
    # Springs of friction take a part of a micro-step to reach the limit.
    assert data.qvel[0] == pytest.approx(gained, rel=1e-3)
    assert 100.0 - data.qvel[4] == pytest.approx(2.5 * gained / radius, rel=1e-3)


def spun_by_a_soft_floor(floor: str, timestep: float) -> np.ndarray:
    """Return velocity and spin of a soft ball after it has bounced off a floor with friction."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{timestep}"/><worldbody>
      <geom name="floor" {floor}/><body pos="0 0 .4"><freejoint/>
        <geom name="ball" size=".1"/></body></worldbody></mujoco>""")
    engine = dashpot.Engine(model)
    soft = dashpot.Material(stiffness=2e4, restitution=0.6, friction=(0.5, 0.005, 1e-4))
    for geom in ("floor", "ball"):
        engine.set_material(geom, soft)
    data = engine.make_data()
    data.qvel[:] = 1.0, 0.3, 0.0, 2.0, 1.0, -1.0
    engine.step(data, nstep=round(0.6 / timestep))
    return np.concatenate([data.qvel[:2], np.linalg.norm(data.qvel[3:], keepdims=True)])


def test_the_arm_of_a_soft_ball_changes_within_a_step_on_any_floor():
    """On a plane friction kept the arm of the start: 0.55 % of the spin at 2 ms, of first order."""
    exact = spun_by_a_soft_floor('type="plane" size="9 9 1"', 1e-4)
    for floor in ('type="plane" size="9 9 1"', 'type="box" size="9 9 .5" pos="0 0 -.5"'):
        for timestep in (0.001, 0.002):
            # It goes in by a fifth of its radius, in some 10 steps at 2 ms.
            spun = spun_by_a_soft_floor(floor, timestep)
            np.testing.assert_allclose(spun, exact, rtol=1e-3 * (timestep / 0.002))
