"""Time of impact with height fields, and impacts that are cut at them."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import dashpot
from dashpot.query import distance, time_of_impact, times_of_impact
from free_flight import Motion, launch
from height_field_scenes import (
    COLUMNS,
    ELEVATION,
    HALF_X,
    HALF_Y,
    ROWS,
    SIZE,
    make_model,
    rough,
)
from query_geoms import CONVEX
from query_scenes import place


@pytest.mark.parametrize("speed", [0.5, 100.0])
def test_ball_onto_a_slope(speed):
    """Heights on a plane z = a x + b: the ball meets it where its centre is a radius away."""
    slope = np.linspace(0.0, 1.0, COLUMNS) * np.ones((ROWS, 1))
    model, data = make_model(slope, pose="")
    tangent = ELEVATION / (2 * HALF_X)
    normal = np.array((-tangent, 0, 1)) / np.hypot(tangent, 1)
    radius = SIZE["sphere"][0]
    rng = np.random.default_rng(6)
    horizon = 1.0 / speed
    for _ in range(50):
        x, y = rng.uniform(-0.2, 0.2), rng.uniform(-0.4, 0.4)
        foot = np.array((x, y, ELEVATION * (x + HALF_X) / (2 * HALF_X)))
        velocity = np.array((*rng.normal(size=2) * 0.2, -1.0)) * speed
        time = rng.uniform(0.1, 0.9) * horizon
        start = foot + radius * normal - velocity * time
        launch(model, data, "sphere", start, None, velocity, rng.normal(size=3) * 50)
        found = time_of_impact(model, data, "hills", "sphere", horizon=horizon)
        # Heights in single precision: 1e-8 m, at a closing speed above half the speed.
        assert found.hit
        assert found.time == pytest.approx(time, abs=4e-8 / speed)
        np.testing.assert_allclose(found.normal, normal, atol=1e-6)
        receding = time_of_impact(model, data, "sphere", "hills", horizon=0.5 * time)
        assert (receding.hit, receding.time) == (False, 0.5 * time)
        assert receding.distance > 0.0


@pytest.mark.parametrize("kind", CONVEX)
@pytest.mark.parametrize("moving", [False, True])
def test_tumbling_bodies_onto_hills(kind, moving):
    """Against the distance along the motion: positive before, zero at the time of impact."""
    model, data = make_model(rough(4), moving=moving)
    moved = mujoco.MjData(model)
    rng = np.random.default_rng([8, CONVEX.index(kind), moving])
    horizon = 0.1
    hits = 0
    for _ in range(8):
        turn = Rotation.random(random_state=rng)
        centre = np.array((0.1, -0.2, 0.3)) * (not moving)
        aim = centre + np.append(rng.uniform(-0.25, 0.25, size=2), 0.5)
        linear = np.append(rng.normal(size=2), rng.uniform(-9, -4))
        launch(model, data, kind, aim, turn, linear, rng.normal(size=3) * 30)
        bodies = [kind]
        if moving:
            bodies.append("hills")
            tilt = Rotation.from_rotvec(rng.normal(size=3) * 0.3)
            spin = rng.normal(size=3) * 2
            launch(model, data, "hills", (0, 0, 0), tilt, rng.normal(size=3) * 0.5, spin)
        motions = {name: Motion(model, data, name) for name in bodies}

        def gap(time, motions=motions):
            moved.geom_xpos[:], moved.geom_xmat[:] = data.geom_xpos, data.geom_xmat
            for name, motion in motions.items():
                place(model, moved, name, *motion.at(time))
            return distance(model, moved, "hills", kind).distance

        found = time_of_impact(model, data, "hills", kind, horizon=horizon)
        before = [gap(t) for t in np.linspace(0, found.time, 60)]
        assert min(before[:-1]) > 0.0  # never late
        if found.hit:
            hits += 1
            assert gap(found.time) < 1e-8  # never early by more than the clearance
            assert found.distance == pytest.approx(gap(found.time), abs=1e-9)
        else:
            assert found.time == horizon
            assert found.distance == pytest.approx(before[-1], abs=1e-12)
    assert hits >= 4


def test_flight_over_and_past_the_field_does_not_hit():
    model, data = make_model(rough(), pose="")
    launch(model, data, "box", (-5, 0, ELEVATION + 0.2), None, (100, 0, 0), (0, 0, 50))
    assert not time_of_impact(model, data, "hills", "box", horizon=1.0).hit
    launch(model, data, "box", (-5, 2 * HALF_Y, 0), None, (100, 0, 0))
    away = time_of_impact(model, data, "hills", "box", horizon=1e4)
    assert (away.hit, away.time) == (False, 1e4)
    launch(model, data, "box", (0, 0, 1))
    rest = time_of_impact(model, data, "hills", "box", horizon=1.0)
    assert (rest.hit, rest.distance) == (False, distance(model, data, "hills", "box").distance)
    launch(model, data, "box", (0, 0, 0), None, (0, 0, 9))
    overlapping = time_of_impact(model, data, "hills", "box", horizon=1.0)
    assert (overlapping.hit, overlapping.time) == (True, 0.0)
    assert overlapping.distance == distance(model, data, "hills", "box").distance


def test_a_spin_too_long_to_follow_is_an_error_that_names_the_geoms():
    """A box spins above a pit, within the bounds of the field: 1e12 radians without an impact."""
    heights = np.ones((ROWS, COLUMNS))
    heights[2:5, 1:4] = 0.0
    model, data = make_model(heights, pose="")
    launch(model, data, "box", (0, 0, 0.12), None, (0, 0, 0), (0, 0, 1e6))
    assert not time_of_impact(model, data, "hills", "box", horizon=1e-3).hit
    with pytest.raises(RuntimeError, match=r"geom 'hills' and geom 'box': .* no decision"):
        time_of_impact(model, data, "hills", "box", horizon=1e6)
    with pytest.raises(RuntimeError, match=r"geom 'box' and geom 'hills': .* no decision"):
        times_of_impact(model, "box", "hills", data.qpos, data.qvel, horizon=1e6)


def test_fast_ball_does_not_pass_a_thin_height_field():
    """`impact="cut"` looks at height fields too."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option gravity="0 0 0" timestep="0.005"/><asset>
        <hfield name="sheet" nrow="5" ncol="5" size="1 1 0.01 0.002"/></asset><worldbody>
        <geom name="sheet" type="hfield" hfield="sheet"/>
        <body><freejoint/><geom name="ball" size="0.01"/></body></worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model, impact="cut")
    rng = np.random.default_rng(12)
    for _ in range(20):
        data = engine.make_data()
        data.qpos[:3] = *rng.uniform(-0.5, 0.5, size=2), rng.uniform(0.1, 0.5)
        data.qvel[:3] = *rng.normal(size=2) * 10, -rng.uniform(20, 200)
        engine.step(data, nstep=10)
        assert data.qpos[2] > 0.0
        assert data.qvel[2] >= -1e-6
