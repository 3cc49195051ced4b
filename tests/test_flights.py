"""Bodies that fly past each other, or meet elsewhere than where they are nearest before."""

import math

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq

from dashpot import Engine, Material
from flybys import random_fly_by

RADIUS = 0.05
SPEED = 4.0
BALLS = """<mujoco><option timestep="{timestep}" gravity="0 0 0"/><worldbody>
  <body><freejoint/><geom name="still" size="{radius}" mass="1"/></body>
  <body pos="{x} {offset} 0"><freejoint/><geom name="fast" size="{radius}" mass="1"/></body>
  </worldbody></mujoco>"""


def throw(timestep, offset, start, *, material=None, impact="none"):
    """Return data after a ball thrown along x has passed or hit another one at the origin."""
    xml = BALLS.format(timestep=timestep, radius=RADIUS, x=start, offset=offset)
    engine = Engine(mujoco.MjModel.from_xml_string(xml), impact=impact)
    if material:
        engine.set_pair_material("still", "fast", material)
    data = engine.make_data()
    data.qvel[6] = SPEED
    engine.step(data, nstep=math.ceil(2 * abs(start) / SPEED / timestep))
    return data


@pytest.mark.parametrize("impact", ["none", "cut"])
@pytest.mark.parametrize("timestep", [1e-3, 1e-2])
@pytest.mark.parametrize("clearance", [2e-4, 1e-3, 5e-3])
def test_balls_that_pass_do_not_touch(clearance, timestep, impact):
    for start in np.linspace(-0.16, -0.2, 7):
        data = throw(timestep, 2 * RADIUS + clearance, start, impact=impact)
        assert data.qvel.tolist() == [0.0] * 6 + [SPEED] + [0.0] * 5


@pytest.mark.parametrize("timestep", [2e-3, 5e-3, 1e-2])
@pytest.mark.parametrize("offset", [0.3, 0.6, 0.9, 0.97])
def test_balls_part_along_the_line_of_their_centres(offset, timestep):
    # Frictionless and of equal mass: each takes (1 + e) / 2 of the approach along the normal, whose
    # sine is the offset over the sum of the radii.
    restitution = 0.6
    material = Material(1e6, restitution=restitution, friction=0.0)
    normal = np.array([-math.sqrt(1.0 - offset**2), offset, 0.0])
    change = -0.5 * (1.0 + restitution) * SPEED * normal[0] * normal
    for start in np.linspace(-0.16, -0.2, 7):
        data = throw(timestep, 2 * RADIUS * offset, start, material=material)
        # While they are compressed the line of their centres turns by up to 2 degrees; planes of
        # the start of the step are wrong by a quarter of the approach speed.
        assert data.qvel[:3] == pytest.approx(-change, abs=0.04 * SPEED)
        after = SPEED * np.array([1.0, 0.0, 0.0]) + change
        assert data.qvel[6:9] == pytest.approx(after, abs=0.04 * SPEED)


def test_a_ball_that_would_pass_is_pushed_into_the_other():
    """2 mm apart of the first, the second is hit by a third one within the same step."""
    engine = Engine(
        mujoco.MjModel.from_xml_string("""<mujoco><option timestep="0.01" gravity="0 0 0"/>
        <worldbody><body><freejoint/><geom size=".05" mass="1"/></body>
        <body pos="-.08 .102 0"><freejoint/><geom size=".05" mass="1"/></body>
        <body pos="-.08 .215 0"><freejoint/><geom size=".05" mass="1"/></body>
        </worldbody></mujoco>""")
    )
    data = engine.make_data()
    data.qvel[6:8] = 10.0, 0.0
    data.qvel[12:14] = 10.0, -6.0
    assert engine.step(data).touching == 2
    assert data.qvel[1] < -1.0
    momentum = data.qvel.reshape(3, 6)[:, :3].sum(axis=0)
    assert momentum == pytest.approx([20.0, -6.0, 0.0], abs=1e-12)


GRAZE = """<mujoco><option timestep="{timestep}" gravity="0 0 0"/><worldbody>
  <geom name="post" type="capsule" size="0.02 0.3"/>
  <body pos="{x} {y} 0"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1e-3 1e-3 1e-3"/>
    <geom name="bar" type="box" size="0.08 0.01 0.01"/></body></worldbody></mujoco>"""


def clearance_of_bar(y, speed, spin, time):
    """Least distance (m) of the bar, which turns at `spin` while it passes at y, from the post."""
    t = np.linspace(0.0, 2 * time, 20001)
    x, angle = speed * (t - time), spin * t
    # The post's axis in the frame of the bar.
    along = np.abs(np.cos(angle) * -x + np.sin(angle) * -y) - 0.08
    across = np.abs(-np.sin(angle) * -x + np.cos(angle) * -y) - 0.01
    return np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0)).min() - 0.02


@pytest.mark.parametrize("timestep", [1e-3, 2e-3, 5e-3, 1e-2])
@pytest.mark.parametrize(("clearance", "touches"), [(-5e-4, True), (5e-4, False)])
def test_a_spinning_bar_touches_the_post_that_it_grazes(clearance, touches, timestep):
    """It points at the post about when it passes; in a step of 10 ms it turns by 0.2 rad."""
    spin, speed = 20.0, 3.0
    time = math.pi / 2 / spin
    y = brentq(lambda y: clearance_of_bar(y, speed, spin, time) - clearance, -0.2, -0.06)
    model = mujoco.MjModel.from_xml_string(GRAZE.format(timestep=timestep, x=-speed * time, y=y))
    engine = Engine(model)
    data = engine.make_data()
    data.qvel[0], data.qvel[5] = speed, spin
    start = data.qvel.copy()
    engine.step(data, nstep=math.ceil(2 * time / timestep))
    assert (np.abs(data.qvel - start).max() > 1e-3) == touches


@pytest.mark.parametrize("timestep", [2e-3, 1e-2])
@pytest.mark.parametrize("seed", range(6))
def test_bodies_of_any_shape_touch_where_they_meet_and_only_there(seed, timestep):
    flight, clearance = random_fly_by(seed)
    assert flight.is_disturbed(timestep) == (clearance < 0.0)


GRAVITY = 9.81
HALF_WIDTH = 0.02
FALLING = {
    "box": f'type="box" size="{HALF_WIDTH} {HALF_WIDTH} 0.04"',
    "cylinder": f'type="cylinder" size="{HALF_WIDTH} 0.04"',
}


def walls_apart(clearances):
    """Return an engine's world: walls along x, below z = 0, as far from a body at the origin."""
    return "".join(
        f'<geom type="box" size="0.03 0.1 0.05" pos="{side * (HALF_WIDTH + c + 0.03)} 0 -0.05"/>'
        for side, c in clearances.items()
    )


def change_beside_gravity(engine, height, speed, steps):
    """Largest change (m/s, rad/s) of the velocity of a body thrown down, but for its fall."""
    data = engine.make_data()
    data.qpos[2] = 0.04 + height
    data.qvel[2] = -speed
    largest = 0.0
    for _ in range(steps):
        engine.step(data)
        fall = [0.0, 0.0, -speed - GRAVITY * data.time, 0.0, 0.0, 0.0]
        largest = max(largest, np.abs(data.qvel - fall).max())
    return largest


def engine_of_fall(shape, clearances, timestep, impact="none"):
    xml = f"""<mujoco><option timestep="{timestep}" gravity="0 0 {-GRAVITY}"/><worldbody>
      {walls_apart(clearances)}
      <body><freejoint/><geom {FALLING[shape]} mass="0.1"/></body></worldbody></mujoco>"""
    return Engine(mujoco.MjModel.from_xml_string(xml), impact=impact)


@pytest.mark.parametrize("impact", ["none", "cut"])
@pytest.mark.parametrize("timestep", [2e-3, 5e-3])
@pytest.mark.parametrize("shape", FALLING)
def test_body_falls_past_an_edge_that_it_clears(shape, timestep, impact):
    # In steps of a few percent of its half-width gravity adds enough for the plane across the edge
    # that is nearest at their start to be crossed.
    for clearance in (5e-5, 2e-4, 5e-4, 1e-3):
        engine = engine_of_fall(shape, {1: clearance}, timestep, impact)
        for way in (5e-4, 1e-3, 1.9e-3, 4e-3):
            for height in np.linspace(0.3, 1.5, 13) * way:
                assert change_beside_gravity(engine, height, way / timestep, 4) < 1e-9


@pytest.mark.parametrize("timestep", [1e-3, 2e-3, 5e-3])
@pytest.mark.parametrize("shape", FALLING)
def test_body_released_over_a_slot_falls_into_it(shape, timestep):
    engine = engine_of_fall(shape, {1: 5e-4, -1: 1.5e-3}, timestep)
    for height in np.linspace(0.0005, 0.005, 40):
        assert change_beside_gravity(engine, height, 0.0, round(0.08 / timestep)) < 1e-9
