"""Torsional and rolling friction: closed-form decay, and rest that lasts.

The limit surface is elliptic and slip is normal to it (friction.hpp), so directions that slip
together share the normal force in proportions that have closed forms too.
"""

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq

import dashpot
from scene import GRAVITY, free_body, mjcf

TIMESTEPS = (0.002, 0.005, 0.010)
RADIUS, MASS = 0.1, 1.0
SPHERE = f'type="sphere" size="{RADIUS}" mass="{MASS}"'
# A disc lies on four points of its rim.
DISC = f'type="cylinder" size="{RADIUS} 0.02" mass="{MASS}"'
TENTH_PERCENT = 1e-3


def engine_of(geom, friction, dimensions, timestep, height=RADIUS):
    surface = f'condim="{dimensions}" friction="{friction[0]} {friction[1]} {friction[2]}"'
    body = free_body("body", f"{geom} {surface}", (0, 0, height))
    model = mujoco.MjModel.from_xml_string(mjcf(body, floor=surface))
    model.opt.timestep = timestep
    engine = dashpot.Engine(model)
    return engine, engine.make_data()


def speeds(engine, data, duration, dof):
    steps = round(duration / engine.model.opt.timestep)
    recorded = np.empty(steps)
    for i in range(steps):
        engine.step(data)
        recorded[i] = data.qvel[dof]
    return np.arange(1, steps + 1) * engine.model.opt.timestep, recorded


def assert_stays_at_rest(engine, data, duration=60.0):
    """Check that nothing moves for a minute, once the friction springs have swung out."""
    engine.step(data, nstep=round(4.0 / engine.model.opt.timestep))
    settled = data.qpos.copy()
    engine.step(data, nstep=round(duration / engine.model.opt.timestep))
    # Less than 0.1 um or urad a minute, and no speed to leave it by: MuJoCo's contact points of a
    # disc may still jump about the rim, as its tilt of a nanoradian turns, and rigid stiffness with
    # their arms.
    assert np.abs(data.qpos - settled).max() < 1e-7
    assert np.abs(data.qvel).max() < 1e-11


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_torsional_friction_stops_a_spinning_sphere(timestep):
    torsional, rate = 0.005, 5.0
    engine, data = engine_of(SPHERE, (1.0, torsional, 0.0), 4, timestep)
    data.qvel[5] = rate
    deceleration = torsional * MASS * GRAVITY / (0.4 * MASS * RADIUS**2)
    time, spin = speeds(engine, data, 1.2 * rate / deceleration, 5)
    expected = np.maximum(0.0, rate - deceleration * time)
    assert np.abs(spin - expected).max() <= TENTH_PERCENT * rate
    assert_stays_at_rest(engine, data)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_disc_that_slides_as_it_spins_lies_flat(timestep):
    # By symmetry nothing tilts it. Friction that turns along with it did, where it was taken for a
    # change of load, at 1e-5 to 4e-5 rad/s.
    engine, data = engine_of(DISC, (0.3, 0.005, 0.0), 3, timestep, height=0.02)
    data.qvel[5] = 20.0
    for _ in range(round(0.1 / timestep)):
        engine.step(data)
        assert np.abs(data.qvel[3:5]).max() < 1e-6
    # It slips all the time, at its rim: mu r m g of its moment m r^2 / 2.
    slowed = 0.3 * GRAVITY / (0.5 * RADIUS) * 0.1
    assert data.qvel[5] == pytest.approx(20.0 - slowed, rel=TENTH_PERCENT)


@pytest.mark.parametrize("dimensions", [3, 4])
@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_friction_stops_a_spinning_disc(timestep, dimensions):
    """Sliding at the rim and torsion in the same points: half axes mu r and mu_t of one ellipse."""
    sliding, torsional, rate = 0.3, 0.02, 20.0
    engine, data = engine_of(DISC, (sliding, torsional, 0.0), dimensions, timestep, height=0.02)
    data.qvel[5] = rate
    lever = np.hypot(sliding * RADIUS, torsional if dimensions == 4 else 0.0)
    deceleration = lever * GRAVITY / (0.5 * RADIUS**2)
    time, spin = speeds(engine, data, 1.2 * rate / deceleration, 5)
    expected = np.maximum(0.0, rate - deceleration * time)
    assert np.abs(spin - expected).max() <= TENTH_PERCENT * rate
    # It spins on the spot.
    assert np.abs(data.qpos[:2]).max() < 1e-6
    assert_stays_at_rest(engine, data)


def rolling_out(sliding, rolling, inertia):
    """Decelerations of the centre and of the turn, and v / omega while both directions slip.

    With friction F and rolling moment M = F / q on the ellipse, slip along its normal gives
    (v - omega r) / omega = q (mu_r / mu)^2, and m v' = -F, I omega' = F r - M make q a root of
    (r + q e^2) (1 - q r) = q I / m, e = mu_r / mu.
    """
    e = (rolling / sliding) ** 2
    a, b, c = -RADIUS * e, e - RADIUS**2 - inertia / MASS, RADIUS
    q = (-b - np.sqrt(b * b - 4 * a * c)) / (2 * a)
    moment = MASS * GRAVITY / np.hypot(q / sliding, 1 / rolling)
    return q * moment / MASS, moment * (1 - q * RADIUS) / inertia, RADIUS + q * e


def rolling_down(tangent, sliding, rolling, inertia):
    """Return the acceleration down a slope: as rolling_out, with m v' = m g tan - F."""

    def excess(q):
        moment = MASS * GRAVITY / np.hypot(q / sliding, 1 / rolling)
        turning = moment * (q * RADIUS - 1) / inertia
        lever = RADIUS + q * (rolling / sliding) ** 2
        return GRAVITY * tangent - q * moment / MASS - lever * turning

    q = brentq(excess, 0.0, 1 / rolling)
    return GRAVITY * tangent - q * MASS * GRAVITY / np.hypot(q / sliding, 1 / rolling) / MASS


@pytest.mark.parametrize("rolling", [1e-2])
@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_rolling_friction_stops_a_rolling_sphere(timestep, rolling):
    speed = 0.3
    engine, data = engine_of(SPHERE, (1.0, 0.005, rolling), 6, timestep)
    slowing, turning, lever = rolling_out(1.0, rolling, 0.4 * MASS * RADIUS**2)
    data.qvel[0], data.qvel[4] = speed, speed / lever
    time, forward = speeds(engine, data, 1.1 * speed / slowing, 0)
    expected = np.maximum(0.0, speed - slowing * time)
    # Coming to rest it rocks on its rolling spring, by as much as that holds, mu_r m g / k.
    assert np.abs(forward - expected).max() <= TENTH_PERCENT * speed
    assert np.abs(forward - expected)[expected > 0.1 * speed].max() <= 1e-5 * speed
    assert turning * lever == pytest.approx(slowing)
    # Without creep, q e^2 = 0, it would be the textbook's 5/7 mu_r g / r.
    assert slowing == pytest.approx(5 / 7 * rolling * GRAVITY / RADIUS, rel=10 * rolling)
    assert_stays_at_rest(engine, data)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_rolling_friction_holds_a_ball_on_a_slope(timestep):
    """A slope flatter than mu_r / r does not roll the ball, a steeper one does."""
    for tangent, rolls in ((0.04, False), (0.06, True)):
        engine, data = engine_of(SPHERE, (1.0, 0.005, 0.05 * RADIUS), 6, timestep)
        engine.model.opt.gravity[:] = GRAVITY * np.array([tangent, 0.0, -1.0])
        engine.step(data, nstep=round(3.0 / timestep))
        before, speed = data.qpos[0], data.qvel[0]
        engine.step(data, nstep=round(10.0 / timestep))
        if not rolls:
            assert abs(data.qpos[0] - before) < 1e-9
            continue
        gained = (data.qvel[0] - speed) / (round(10.0 / timestep) * timestep)
        expected = rolling_down(tangent, 1.0, 0.05 * RADIUS, 0.4 * MASS * RADIUS**2)
        assert gained == pytest.approx(expected, rel=1e-3)
        # Without creep it would be the textbook's 5/7 g (tan - mu_r / r).
        assert expected == pytest.approx(5 / 7 * GRAVITY * (tangent - 0.05), rel=0.01)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_long_box_slides_straight(timestep):
    """Its apparent masses differ from direction to direction; friction opposes the slip."""
    box = 'type="box" size="0.3 0.05 0.02" mass="1"'
    speed, friction = 1.0, 0.3
    engine, data = engine_of(box, (friction, 0.0, 0.0), 3, timestep, height=0.02)
    direction = np.array([np.cos(0.8), np.sin(0.8)])
    data.qvel[:2] = speed * direction
    engine.step(data, nstep=round(0.5 / timestep))
    # 0.05 mm of 170 mm: loading the contacts and their friction springs.
    np.testing.assert_allclose(
        data.qpos[:2], speed**2 / (2 * friction * GRAVITY) * direction, atol=5e-5
    )
    assert np.abs(data.qpos[4:7]).max() < 1e-4


@pytest.mark.parametrize("own", ["1 .05 .01", "1 .005 .0001", "1 .0001 0", "1 0 0"])
@pytest.mark.parametrize("stiffness", [None, 1e5, 1e9])
def test_coefficients_of_a_material_stop_a_ball_whatever_the_models_are(own, stiffness):
    """The rows' stiffness went by the model's: a ball rocked on a soft spring for good."""
    torsional, rolling, spin, speed = 0.05, 0.01, 2.0, 0.5
    model = mujoco.MjModel.from_xml_string(
        mjcf(
            free_body("body", f'{SPHERE} condim="6" friction="{own}"', (0, 0, RADIUS)),
            floor=f'condim="6" friction="{own}"',
        )
    )
    model.opt.timestep = 0.002
    engine = dashpot.Engine(model)
    given = {} if stiffness is None else {"stiffness": stiffness, "damping_ratio": 1.0}
    engine.set_pair_material(
        "body", "floor", dashpot.Material(friction=(1.0, torsional, rolling), **given)
    )
    data = engine.make_data()
    data.qvel[0], data.qvel[4], data.qvel[5] = speed, speed / RADIUS, spin
    engine.step(data, nstep=round(2.0 / model.opt.timestep))
    # Each alone would stop it within 0.9 s.
    assert np.abs(data.qvel).max() < 1e-6


@pytest.mark.parametrize("stiffness", [None, 1e4, 1e6])
@pytest.mark.parametrize("off_axis", [0.0, 1e-6, 1e-4])
def test_torsional_friction_brakes_a_spindle_that_cannot_slide(stiffness, off_axis):
    """A given stiffness gave it none: its torsional rows were as stiff as it can slide."""
    torsional, rate, duration = 0.02, 20.0, 0.2
    geom = f'name="body" {SPHERE} condim="4" friction="1 {torsional} 0"'
    model = mujoco.MjModel.from_xml_string(
        mjcf(
            f"""<body pos="0 0 {RADIUS}"><joint type="slide" axis="0 0 1"/>
            <joint axis="0 0 1" pos="{off_axis} 0 0"/><geom {geom}/></body>""",
            floor=f'condim="4" friction="1 {torsional} 0"',
        )
    )
    model.opt.timestep = 0.001
    engine = dashpot.Engine(model)
    if stiffness is not None:
        material = dashpot.Material(stiffness=stiffness, damping_ratio=1.0)
        engine.set_pair_material("body", "floor", material)
    data = engine.make_data()
    data.qvel[1] = rate
    engine.step(data, nstep=round(duration / model.opt.timestep))
    taken = torsional * MASS * GRAVITY * duration / (0.4 * MASS * RADIUS**2)
    # Off the axis sliding friction shares the limit surface with it, to second order.
    assert data.qvel[1] == pytest.approx(rate - taken, rel=TENTH_PERCENT)
