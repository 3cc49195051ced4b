"""A box on a slope: stiction below the friction angle, exact acceleration above it."""

from math import cos, radians, sin

import mujoco
import numpy as np
import pytest

import dashpot
from scene import GRAVITY
from scenes import slope, wall_press
from simulate import make_engine, measure, record

TIMESTEPS = (0.001, 0.002, 0.005, 0.010)
ANGLE = radians(20)


def total_contact_force(model, data) -> np.ndarray:
    """Sum of the contact forces on the second geom of each contact, world frame."""
    total = np.zeros(3)
    for i in range(data.ncon):
        force = np.zeros(6)
        mujoco.mj_contactForce(model, data, i, force)
        total += data.contact[i].frame.reshape(3, 3).T @ force[:3]
    return total


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_no_creep_below_the_friction_angle(timestep):
    # 1e-6 mm is the bound for 60 s; true stiction leaves only rounding.
    assert measure(slope(duration=10.0), timestep=timestep)["creep"] <= 1e-9


@pytest.mark.parametrize("timestep", [0.001, 0.010])
def test_contact_forces_carry_the_weight(timestep):
    scene = slope()
    engine = make_engine(scene, scene.model(timestep))
    data = engine.make_data()
    engine.step(data, nstep=round(2 / timestep))
    # Settled to rounding: transients decay at tens of 1/s.
    np.testing.assert_allclose(
        total_contact_force(engine.model, data), [0, 0, GRAVITY], atol=1e-7 * GRAVITY
    )
    contacts = engine.contacts(data)
    assert contacts.sticking.all()


@pytest.mark.parametrize("timestep", [0.001, 0.010])
def test_elastic_sag_along_and_into_the_slope(timestep):
    """Four linear springs per direction: shift, tilt and normal sag are closed forms."""
    stiffness, half = 1e5, 0.05
    # Friction 1: at 0.5 the unloaded uphill corners would be beyond their limit and slip.
    scene = slope(
        friction=1.0, materials={"box": dashpot.Material(stiffness)}, settle=0.0, duration=3.0
    )
    run = record(scene, timestep=timestep)
    moved = run.qpos[-1, :3] - run.qpos[0, :3]
    along = moved @ [cos(ANGLE), 0, -sin(ANGLE)]
    into = -moved @ [sin(ANGLE), 0, cos(ANGLE)]
    shear = GRAVITY * sin(ANGLE) / (4 * stiffness)
    # Friction at the base turns the box: moment m g sin c against 4 k a^2 tilt, a = c.
    tilt = GRAVITY * sin(ANGLE) * half / (4 * stiffness * half**2)
    # Relative 1e-3: the corner levers change by tilt and sag, about 2e-4 of their length.
    assert along == pytest.approx(shear + half * tilt, rel=1e-3)
    assert into == pytest.approx(GRAVITY * cos(ANGLE) / (4 * stiffness), rel=1e-3)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_acceleration_above_the_friction_angle(timestep):
    degrees, friction = 30.0, 0.4
    angle = radians(degrees)
    run = record(slope(degrees=degrees, friction=friction, duration=1.0), timestep=timestep)
    down = np.array([cos(angle), 0.0, -sin(angle)])
    first, last = run.at(1.0), run.at(2.0)
    gained = (run.velocity("box")[last] - run.velocity("box")[first]) @ down
    expected = GRAVITY * (sin(angle) - friction * cos(angle))
    # Steady sliding: the limit surface is met exactly in every micro-step.
    assert gained / (run.time[last] - run.time[first]) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("timestep", [0.002, 0.010])
def test_box_pressed_to_a_wall_stays(timestep):
    numbers = measure(wall_press(duration=3.0), timestep=timestep)
    assert numbers["drop"] <= 1e-4
    assert numbers["speed"] <= 1e-9  # at rest to rounding


@pytest.mark.parametrize("timestep", [0.001, 0.010])
def test_elastic_sag_at_a_wall(timestep):
    stiffness, depth, half = 1e5, 0.02, 0.05
    scene = wall_press(depth=depth, duration=3.0, materials={"cube": dashpot.Material(stiffness)})
    drop = measure(scene, timestep=timestep)["drop"]
    shear = GRAVITY / (4 * stiffness)
    tilt = GRAVITY * depth / (4 * stiffness * half**2)
    # Relative 2e-3: the wall's compression, 0.05 mm, is 2.5e-3 of the lever of the small term.
    assert drop == pytest.approx(shear + depth * tilt, rel=2e-3)
