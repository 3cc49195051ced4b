"""Time of impact against closed forms and independent references, singly and for many states."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import dashpot
from dashpot.query import distance, time_of_impact
from free_flight import Motion, launch, throw_together
from query_geoms import CONVEX
from query_scenes import geom, place, scene


def test_ball_onto_plane():
    model, data = scene(geom("floor", "plane", "1 1 1"), geom("ball", "sphere", "0.1"))
    launch(model, data, "ball", (0, 0, 1.1), linear=(3, 0, -2), angular=(50, 20, 10))
    found = time_of_impact(model, data, "floor", "ball", horizon=1.0)
    assert found.hit
    assert found.time <= 0.5
    assert found.time == pytest.approx(0.5, rel=1e-9)
    np.testing.assert_allclose(found.normal, (0, 0, 1), atol=1e-15)
    np.testing.assert_allclose(found.point, (1.5, 0, 0), atol=1e-8)
    assert 0.0 < found.distance < 1e-9


@pytest.mark.parametrize("offset", [0.0, 0.1, 0.29, 0.299999, 0.300001, 0.31])
def test_two_balls_in_flight(offset):
    """Root of a quadratic: |r + v t| = r1 + r2; grazing and just missing included."""
    model, data = scene(geom("a", "sphere", "0.1"), geom("b", "sphere", "0.2"))
    launch(model, data, "a", (0, 0, 0), linear=(1, 0, 0), angular=(0, 0, 30))
    launch(model, data, "b", (3, offset, 0), linear=(-4, 0, 0))
    found = time_of_impact(model, data, "a", "b", horizon=2.0)
    assert found.hit == (offset < 0.3)
    if found.hit:
        exact = (3 - np.sqrt(0.09 - offset**2)) / 5
        assert found.time <= exact + 1e-15
        # The clearance at which contact counts, 3e-10 m, over the closing speed.
        closing = 5 * np.sqrt(0.09 - offset**2) / 0.3
        assert exact - found.time < 4e-10 / closing
    else:
        assert found.time == 2.0


def test_ball_at_100_m_per_s_against_a_thin_plate():
    model, data = scene(geom("ball", "sphere", "0.01"), geom("plate", "box", "0.5 0.5 0.0005"))
    rng = np.random.default_rng(4)
    for _ in range(200):
        aim = np.append(rng.uniform(-0.4, 0.4, size=2), 0.0)
        velocity = np.append(rng.normal(size=2) * 20, -100.0)
        start = aim - velocity * 0.004
        start[2] = 0.4 + 0.0005 + 0.01
        launch(model, data, "ball", start, linear=velocity, angular=rng.normal(size=3) * 100)
        found = time_of_impact(model, data, "ball", "plate", horizon=0.01)
        assert found.hit
        assert found.time <= 0.004
        assert found.time == pytest.approx(0.004, rel=1e-6)
        np.testing.assert_allclose(found.normal, (0, 0, -1), atol=1e-9)


def test_spinning_box_onto_the_ground():
    """First zero of the lowest corner's height, found by root bracketing of the exact motion."""
    half = np.array((0.2, 0.1, 0.05))
    corners = np.array(list(itertools.product((-1, 1), repeat=3))) * half
    model, data = scene(geom("floor", "plane", "1 1 1"), geom("box", "box", "0.2 0.1 0.05"))
    rng = np.random.default_rng(5)
    horizon = 0.2
    hits = 0
    for _ in range(40):
        turn = Rotation.random(random_state=rng)
        linear, angular = np.array((1.0, 0.5, rng.uniform(-6, 0))), rng.normal(size=3) * 20
        start = np.array((0, 0, rng.uniform(0.24, 0.8)))
        launch(model, data, "box", start, turn, linear, angular)

        def lowest(time, turn=turn, linear=linear, angular=angular, start=start):
            return (Rotation.from_rotvec(angular * time) * turn).apply(corners)[:, 2].min() + (
                start[2] + linear[2] * time
            )

        times = np.linspace(0, horizon, 4001)
        turns = Rotation.from_rotvec(times[:, None] * angular) * turn
        heights = (turns.as_matrix()[:, 2] @ corners.T).min(axis=1) + start[2] + linear[2] * times
        found = time_of_impact(model, data, "box", "floor", horizon=horizon)
        assert found.hit == bool((heights <= 0).any())
        if found.hit:
            hits += 1
            first = int(np.argmax(heights <= 0))
            exact = brentq(lowest, times[first - 1], times[first], xtol=1e-15)
            assert found.time <= exact + 1e-14
            assert exact - found.time < 1e-6 * exact
            np.testing.assert_allclose(found.normal, (0, 0, -1), atol=1e-15)
    assert 10 < hits < 40


@pytest.mark.parametrize(
    ("kind1", "kind2"), [("box", "box"), ("mesh", "capsule"), ("cylinder", "ellipsoid")]
)
def test_two_tumbling_bodies(zoo, kind1, kind2):
    """Against the first zero of the distance along the motion, from dense sampling."""
    data, moved = mujoco.MjData(zoo), mujoco.MjData(zoo)
    rng = np.random.default_rng([6, CONVEX.index(kind1), CONVEX.index(kind2)])
    names = (kind1 + "1", kind2 + "2")
    horizon = 0.05
    hits = 0
    for _ in range(12):
        throw_together(zoo, data, rng, names, side=0.2, spread=0.02)
        motions = {name: Motion(zoo, data, name) for name in names}

        def gap(time, motions=motions):
            for name, motion in motions.items():
                place(zoo, moved, name, *motion.at(time))
            return distance(zoo, moved, *names).distance

        found = time_of_impact(zoo, data, *names, horizon=horizon)
        samples = np.linspace(0, found.time, 60)
        assert min(gap(t) for t in samples) > 0.0  # never late
        if found.hit:
            hits += 1
            assert gap(found.time) < 1e-8  # never early by more than the clearance
            assert gap(found.time + 1e-7) < 1e-7
        else:
            assert found.time == horizon
    assert hits >= 6


def test_ball_that_hovers_at_a_turning_face():
    """A face slides past and tilts at 3e-10 to 1e-8 m from the ball, and parts or touches.

    Along a fixed direction the far corners of the face would soon be in the way, and there would be
    no decision in thousands of advances.
    """
    half = np.array((0.09, 0.05, 0.07))
    model, data = scene(geom("ball", "sphere", "0.08"), geom("box", "box", "0.09 0.05 0.07"))
    rng = np.random.default_rng(13)
    horizon = 0.05
    hits = 0
    for _ in range(60):
        gap = 10.0 ** rng.uniform(-9.5, -8)
        start = np.array((0, 0, 0.15 + gap))
        linear, angular = np.append(rng.normal(size=2) * 5, 0.0), rng.normal(size=3) * 10
        launch(model, data, "ball", (0, 0, 0))
        launch(model, data, "box", start, None, linear, angular)
        found = time_of_impact(model, data, "ball", "box", horizon=horizon)
        times = np.linspace(0, found.time, 2001)
        turns = Rotation.from_rotvec(times[:, None] * angular)
        local = turns.inv().apply(-start - times[:, None] * linear)
        outside = np.linalg.norm(np.maximum(np.abs(local) - half, 0.0), axis=1)
        gaps = outside - 0.08
        assert gaps.min() > 0.0  # never late
        if found.hit:
            hits += 1
            assert gaps[-1] < 1e-9 * 0.3  # of the size of the pair
        else:
            assert found.time == horizon
    assert 10 < hits < 50


def test_parallel_motion_and_receding_do_not_hit():
    model, data = scene(geom("floor", "plane", "1 1 1"), geom("box", "box", "0.1 0.1 0.1"))
    launch(model, data, "box", (0, 0, 0.1 + 1e-6), linear=(100, 0, 0))
    assert not time_of_impact(model, data, "floor", "box", horizon=1.0).hit
    launch(model, data, "box", (0, 0, 0.2), linear=(1, 0, 5), angular=(0, 0, 40))
    away = time_of_impact(model, data, "floor", "box", horizon=1.0)
    assert (away.hit, away.time) == (False, 1.0)
    assert away.distance == pytest.approx(5.1, abs=1e-12)


def test_rolling_close_to_the_ground_does_not_hit():
    """A spinning body of revolution at rest sweeps nothing."""
    model, data = scene(geom("floor", "plane", "1 1 1"), geom("wheel", "cylinder", "0.1 0.05"))
    lying = Rotation.from_euler("x", 90, degrees=True)
    launch(model, data, "wheel", (0, 0, 0.1 + 1e-7), lying, linear=(1, 0, 0), angular=(0, 10, 0))
    assert not time_of_impact(model, data, "floor", "wheel", horizon=0.1).hit


def test_touching_bodies_have_time_zero():
    model, data = scene(geom("floor", "plane", "1 1 1"), geom("box", "box", "0.1 0.1 0.1"))
    for height in (0.1, 0.05):
        launch(model, data, "box", (0, 0, height), linear=(0, 0, 3))
        found = time_of_impact(model, data, "floor", "box", horizon=1.0)
        assert (found.hit, found.time) == (True, 0.0)
        assert found.distance == pytest.approx(height - 0.1, abs=1e-15)


def test_impact_beyond_the_horizon():
    model, data = scene(geom("floor", "plane", "1 1 1"), geom("ball", "sphere", "0.1"))
    launch(model, data, "ball", (0, 0, 1.1), linear=(0, 0, -1))
    found = time_of_impact(model, data, "floor", "ball", horizon=0.25)
    assert (found.hit, found.time) == (False, 0.25)
    assert found.distance == pytest.approx(0.75, abs=1e-14)


def test_times_of_impact_equal_single_ones_for_any_number_of_threads(zoo):
    rng = np.random.default_rng(4)
    qpos = rng.normal(scale=0.3, size=(4, 15, zoo.nq))
    qvel = rng.normal(scale=10.0, size=(4, 15, zoo.nv))
    data = mujoco.MjData(zoo)
    names = ("hit", "time", "point", "normal", "distance")
    hits = 0
    for first, second in (("box1", "mesh2"), ("plane", "cylinder1"), ("capsule2", "ellipsoid1")):
        many = dashpot.times_of_impact(zoo, first, second, qpos, qvel, horizon=0.05, nthread=1)
        hits += many.hit.sum()
        for threads in (2, 3, None):
            again = dashpot.times_of_impact(
                zoo, first, second, qpos, qvel, horizon=0.05, nthread=threads
            )
            for name in names:
                assert getattr(many, name).tobytes() == getattr(again, name).tobytes()
        assert many.point.shape == (4, 15, 3)
        for index in itertools.product(range(4), range(15)):
            data.qpos[:], data.qvel[:] = qpos[index], qvel[index]
            mujoco.mj_forward(zoo, data)
            single = time_of_impact(zoo, data, first, second, horizon=0.05)
            for name in names:
                one = np.asarray(getattr(single, name))
                assert getattr(many, name)[index].tobytes() == one.tobytes()
    assert 20 < hits < 160
    assert dashpot.times_of_impact(zoo, 0, 1, qpos[:0], qvel[:0], horizon=1.0).time.shape == (0, 15)


def test_times_of_impact_refuses_by_name(zoo):
    qpos, qvel = np.tile(zoo.qpos0, (3, 1)), np.zeros((3, zoo.nv))
    with pytest.raises(ValueError, match=r"qvel must be \(\.\.\., nv\)"):
        dashpot.times_of_impact(zoo, 0, 1, qpos, qpos, horizon=1.0)
    with pytest.raises(ValueError, match="same states"):
        dashpot.times_of_impact(zoo, 0, 1, qpos, qvel[:2], horizon=1.0)
    with pytest.raises(TypeError, match=r"^horizon must be a number, got 'a'"):
        dashpot.times_of_impact(zoo, 0, 1, qpos, qvel, horizon="a")
    with pytest.raises(ValueError, match="horizon"):
        dashpot.times_of_impact(zoo, 0, 1, qpos, qvel, horizon=0.0)
    with pytest.raises(ValueError, match="nthread"):
        dashpot.times_of_impact(zoo, 0, 1, qpos, qvel, horizon=1.0, nthread=-1)
    qvel[1, 2] = np.inf
    with pytest.raises(ValueError, match=r"qvel\[1, 2\] is inf"):
        dashpot.times_of_impact(zoo, 0, 1, qpos, qvel, horizon=1.0)
