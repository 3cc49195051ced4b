"""Forces of a sliding tool: at coarse steps those of fine ones, and stiffness times compression."""

from __future__ import annotations

import numpy as np
import pytest

from dashpot import grinding
from dashpot.grinding.checks import mujoco_models
from dashpot.grinding.motion import Motion
from dashpot.grinding.simulation import Simulator
from grinding_scenes import CYLINDER, TABLE, TILT, cell, steady

FINE = 1e-4


def across(made, **options):
    return grinding.Path.on_surface(made, grinding.line((-0.2, 0.45), (0.18, 0.55)), **options)


def means(load, times):
    count = len(load) // times
    return load[: count * times].reshape(count, times).mean(axis=1)


@pytest.mark.parametrize(
    ("stiffness", "limits"), [(2e4, (0.05, 0.15, 0.5)), (2e5, (0.25, 0.6, 1.5))]
)
def test_coarse_steps_find_the_force_of_fine_ones(stiffness, limits):
    """With friction 0.3, an imbalance of 47 Hz and 1.7 N, and a feed from 0.1 to 0.2 m/s."""
    made = cell(stiffness=stiffness, tool=grinding.BallNose(0.02))
    path = across(made)
    motion = Motion(made, path)
    command = steady(path, force=50.0, stiffness=stiffness)
    fine = Simulator(motion, timestep=FINE).run([command])[0].total
    for timestep, limit in zip((1e-3, 2e-3, 5e-3), limits, strict=True):
        found = Simulator(motion, timestep=timestep).run([command])[0].total
        expected = means(fine, round(timestep / FINE))
        error = found[: len(expected)] - expected
        assert np.sqrt(np.mean(error**2)) < limit
        assert abs(error.mean()) < 1e-3 * expected.mean()


@pytest.mark.parametrize("stiffness", [2e4, 2e5])
@pytest.mark.parametrize("spin", [0.0, 47.0])
def test_force_over_compression_is_the_stiffness_while_it_slides(stiffness, spin):
    made = cell(
        TABLE,
        stiffness=stiffness,
        imbalance=0.0,
        damping=0.0,
        tool=grinding.BallNose(0.02, spin=spin),
    )
    path = grinding.Path.on_surface(made, grinding.line((-0.1, 0.5), (0.1, 0.5)), tilt=TILT)
    found = Simulator(Motion(made, path)).run([steady(path, force=50.0, stiffness=stiffness)])[0]
    # The place lies in the middle between the table's top, at 0.15 m, and the ball's lowest point.
    overlap = 2 * (0.15 - found.place[:, 0, 2])
    middle = slice(len(found.time) // 3, 2 * len(found.time) // 3)
    mean_overlap = 0.5 * (overlap[:-1] + overlap[1:])[middle]
    ratio = found.total[:-1][middle] / mean_overlap
    assert (found.slide[middle] > 0.09).all()
    np.testing.assert_allclose(ratio.mean(), stiffness, rtol=2e-3)
    np.testing.assert_allclose(found.friction[middle], 0.3 * found.force[middle], rtol=1e-6)


def test_mujoco_fitted_to_the_stiffness_at_rest_is_too_stiff_while_it_slides():
    """By friction times damping times sliding speed, some 60 N at the 2 m/s of a tool that spins.

    MuJoCo steps with its best settings and a fine step.
    """
    made = cell(TABLE, imbalance=0.0, tool=grinding.BallNose(0.02, spin=47.0))
    path = grinding.Path.on_surface(made, grinding.line((-0.1, 0.5), (0.1, 0.5)), tilt=TILT)
    motion = Motion(made, path)
    command = steady(path, force=50.0, stiffness=2e4)
    models = mujoco_models(made)
    assert set(models) == {"MuJoCo as shipped", "MuJoCo, direct solref", "MuJoCo, impedance 0.5"}
    model = models["MuJoCo, direct solref"]
    found = Simulator(motion, timestep=5e-4).run([command], mujoco_model=model)[0]
    middle = slice(len(found.time) // 3, 2 * len(found.time) // 3)
    overlap = 2 * (0.15 - found.place[middle, 0, 2])
    beyond = (found.total[middle] - 2e4 * overlap).mean()
    expected = 0.3 * made.damping * found.slide[middle].mean()
    assert beyond == pytest.approx(expected, rel=0.1)
    own = Simulator(motion, timestep=5e-4).run([command])[0]
    overlap = 2 * (0.15 - own.place[middle, 0, 2])
    np.testing.assert_allclose(own.total[middle].mean(), 2e4 * overlap.mean(), rtol=2e-3)


@pytest.mark.parametrize("kind", ["position", "impedance", "force"])
@pytest.mark.parametrize("spindle", [grinding.Spindle(2e4)])
def test_each_control_holds_the_force_that_it_is_told(kind, spindle):
    made = cell(
        imbalance=0.0,
        control=grinding.Control(kind),
        spindle=spindle,
        tool=grinding.BallNose(0.02),
    )
    path = across(made)
    series = 1.0 / (1 / made.stiffness + (0.0 if spindle is None else 1 / spindle.stiffness))
    command = steady(path, force=40.0, stiffness=series)
    found = Simulator(Motion(made, path)).run([command])[0]
    middle = slice(len(found.time) // 3, 2 * len(found.time) // 3)
    # The load that is fed forward leaves what the arm's inertia and its motion do.
    np.testing.assert_allclose(found.total[middle].mean(), 40.0, rtol=0.03)


def test_force_control_finds_the_force_on_a_contact_that_is_softer_than_thought():
    told = cell(imbalance=0.0, control=grinding.Control("force"), tool=grinding.BallNose(0.02))
    path = across(told)
    motion = Motion(told, path)
    command = steady(path, force=40.0, stiffness=2e4, feed=(0.1, 0.1))
    soft = told.with_changes(stiffness=1.2e4)
    errors = {}
    for kind in ("position", "force"):
        is_now = soft.with_changes(control=grinding.Control(kind))
        found = Simulator(motion, cell=is_now).run([command])[0]
        late = slice(len(found.time) // 2, 3 * len(found.time) // 4)
        errors[kind] = abs(found.total[late].mean() - 40.0)
    assert errors["force"] < 0.2 * errors["position"]


def test_an_imbalance_has_its_impulse_whatever_the_step():
    turning = grinding.Imbalance(47.0, 1e-3, 0.02)
    assert turning.force == pytest.approx(1e-3 * 0.02 * (2 * np.pi * 47) ** 2)
    for timestep in (1e-4, 5e-3):
        times = np.arange(0.0, 0.1 + 1e-9, timestep)
        impulse = timestep * turning.mean_forces(times).sum(axis=0)
        rate = 2 * np.pi * 47
        exact = turning.force / rate * np.array([np.sin(rate * 0.1), 1 - np.cos(rate * 0.1)])
        np.testing.assert_allclose(impulse, exact, atol=1e-12)


def test_a_longer_arm_of_servos_of_ones_own_follows_the_path_in_the_air():
    made = cell(CYLINDER, imbalance=0.0, control=grinding.Control(stiffness=4000.0, damping=100.0))
    path = across(made, tilt=TILT)
    command = steady(path, force=0.0, stiffness=2e4, hover=-0.0)
    raised = type(command)(command.law, np.full(len(command.offset), -0.002), None)
    motion = Motion(made, path)
    found = Simulator(motion).run([raised])[0]
    way, _, _ = raised.law.at(found.time)
    expected = motion.angles(way, np.full(len(way), -0.002))
    # Servos of 4000 N m/rad and set points that are held for 2 ms.
    np.testing.assert_allclose(found.angles[:-1], expected[1:], atol=5e-4)
