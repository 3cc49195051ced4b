"""Round meshes on flat ground: corners that land one by one neither drive nor throw them."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine

RADIUS = 0.035
PLANE = '<geom type="plane" size="9 9 1"/>'


def sphere_points(count):
    """Return points (count, 3) spread evenly over a ball."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    around = np.column_stack([np.cos(turn), np.sin(turn)])
    return RADIUS * np.column_stack([np.sqrt(1.0 - z**2)[:, None] * around, z])


def wheel_points(corners):
    """Return the corners (2 n, 3) of a wheel of n sides, its axis along y."""
    turn = 2.0 * np.pi * np.arange(corners) / corners
    rim = 0.1 * np.column_stack([np.cos(turn), np.sin(turn)])
    return np.array([[x, y, z] for x, z in rim for y in (-0.03, 0.03)])


def engine_of(points, height, *, timestep=0.002):
    vertices = " ".join(f"{value:.9g}" for value in points.ravel())
    return Engine(
        mujoco.MjModel.from_xml_string(
            f"""<mujoco><option timestep="{timestep}"/>
            <asset><mesh name="round" vertex="{vertices}"/></asset>
            <worldbody>{PLANE}<body pos="0 0 {height}"><freejoint/>
              <geom type="mesh" mesh="round" mass="0.15"/></body></worldbody></mujoco>"""
        )
    )


def test_a_ball_of_many_corners_slows_down():
    engine = engine_of(sphere_points(500), RADIUS)
    data = engine.make_data()
    engine.step(data, nstep=250)
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, data.qpos[3:])
    data.qvel[:] = [0.1, 0, 0, *(rotation.reshape(3, 3).T @ [0, 0.1 / RADIUS, 0])]
    engine.step(data, nstep=15000)
    assert np.linalg.norm(data.qvel[:2]) < 0.05
    # A thousandth of the weight over a tenth of a metre, each second.
    assert abs(engine.energy(data).dissipated_recovery) < 1e-3 * 0.15 * 9.81 * 0.1 * 30


@pytest.mark.parametrize(("corners", "speed", "timestep"), [(64, 3.0, 0.002), (64, 1.0, 0.005)])
def test_a_wheel_of_many_sides_slows_down_as_its_corners_land(corners, speed, timestep):
    # Each landing is inelastic. It turns by 0.6 and 0.5 of a side in a step; from a whole one on it
    # may gain.
    engine = engine_of(wheel_points(corners), 0.1, timestep=timestep)
    data = engine.make_data()
    data.qvel[:] = [speed, 0, 0, 0, speed / 0.1, 0]
    before = speed
    for _ in range(3):
        engine.step(data, nstep=round(1.0 / timestep))
        assert data.qvel[0] < before
        before = data.qvel[0]


def test_what_is_placed_too_deep_rises_without_a_hop():
    model = mujoco.MjModel.from_xml_string("""<mujoco><option timestep="0.002"/><worldbody>
      <geom type="plane" size="1 1 1"/><body pos="0 0 0.0499"><freejoint/>
        <geom type="box" size="0.05 0.05 0.05" mass="1"/></body></worldbody></mujoco>""")
    engine = Engine(model)
    data = engine.make_data()
    highest = fastest = 0.0
    for _ in range(500):
        engine.step(data)
        highest, fastest = max(highest, data.qpos[2]), max(fastest, np.abs(data.qvel).max())
    # It hopped by 0.75 mm, at 0.11 m/s. A tenth of a millimetre in 10 ms is 0.01 m/s.
    assert highest < 0.05 + 1e-5
    assert fastest < 0.015
    assert data.qpos[2] == pytest.approx(0.05, abs=1e-5)


@pytest.mark.parametrize("overlap", [1e-6, 1e-5, 2e-4])
def test_adhesion_holds_what_overlaps_at_the_start(overlap):
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody>
      <geom type="box" size="1 1 .1" pos="0 0 1"/>
      <body name="body" pos="0 0 {0.85 + overlap}"><freejoint/>
        <geom type="box" size=".05 .05 .05" mass="1"/></body></worldbody>
      <actuator><adhesion body="body" ctrlrange="0 1" gain="30"/></actuator></mujoco>""")
    engine = Engine(model)
    data = engine.make_data()
    data.ctrl[0] = 1.0
    engine.step(data, nstep=1000)
    assert data.qpos[2] == pytest.approx(0.85, abs=2e-5)
