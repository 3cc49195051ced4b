"""Residuals that a function of the user's own computes, against closed forms."""

from __future__ import annotations

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.calibrate import Fit, Parameter, Problem, SimulatedRecording, Trajectory, fit
from dashpot.calibrate.residuals.candidates import SimulationError
from dashpot.calibrate.residuals.objective import Objective

G = 9.81
MASS = 0.2
RADIUS = 0.05
BALL = """
<mujoco>
  <option timestep="0.001"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="ball" pos="0 0 .05">
      <freejoint/>
      <geom name="ball" type="sphere" size="0.05" mass="0.2"/>
      <site name="mark" size="0.06"/>
    </body>
  </worldbody>
  <sensor>
    <touch name="load" site="mark"/>
    <framelinvel name="speed" objtype="body" objname="ball"/>
  </sensor>
</mujoco>
"""
STEP = 0.001


def ball(**material):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL))
    engine.set_pair_material("ball", "floor", dashpot.Material(**material))
    return engine


def drop(height, name="drop", length=0.5):
    """Return a ball that falls from rest, of which nothing is measured but what functions say."""
    return Trajectory(
        name, [0.0, length], np.full((2, 1, 3), 0.0), None, "ball",
        initial_qpos=[0, 0, RADIUS + height, 1, 0, 0, 0], initial_qvel=np.zeros(6),
    )  # fmt: skip


def kept_energy(simulated, trajectory):
    """Return how much of its energy a ball keeps at its first bounce, measured as 0.49 +- 0.001."""
    height = simulated.position["ball"][:, 2] - RADIUS
    energy = G * height + 0.5 * simulated.sensors["speed"][:, 2] ** 2
    touches = simulated.sensors["load"][1:, 0] > 0.0
    leaves = 1 + np.argmax(np.diff(touches.astype(int)) < 0)
    return (energy[leaves + 2] / energy[0] - 0.49) / 0.001


def contact_time(simulated, trajectory):
    """Return how far a contact is off 20 ms, and with which sigma.

    Its force is the same before and after its middle, which is read off the steps more finely than
    its ends.
    """
    load = simulated.sensors["load"][1:, 0]
    middle = float(load @ (simulated.time[1:] - 0.5 * STEP)) / float(load.sum())
    begin = math.sqrt(2.0 * (trajectory.initial_qpos[2] - RADIUS) / G)
    return [2.0 * (middle - begin) - 0.02], [1e-5]


RESTITUTION = Parameter.pair("ball", "floor", "restitution", start=0.5, bounds=(0.05, 0.99))
STIFFNESS = Parameter.pair("ball", "floor", "stiffness", start=3e3, bounds=(1e2, 1e5))


def bounces(function=kept_energy, heights=(0.3,), **fields):
    fields = {"residuals": {"kept": function}, **fields}
    drops = [drop(height, f"drop {i}") for i, height in enumerate(heights)]
    return Problem(ball(stiffness=1e6, restitution=0.5), [RESTITUTION], drops, **fields)


def presses(**fields):
    return Problem(
        ball(stiffness=3e3, restitution=1.0), [STIFFNESS], [drop(0.3, f"drop {i}") for i in (1, 2)],
        residuals=contact_time, **fields,
    )  # fmt: skip


def test_the_energy_that_a_bounce_leaves_tells_restitution():
    """It is the square of the restitution, of a hard ball, whose weight is no load."""
    result = fit(bounces(heights=(0.2, 0.3)), starts=0)
    assert result["restitution"].value == pytest.approx(0.7, abs=0.001)
    assert result["restitution"].identified
    # d(e^2) = 0.001 of two readings, so d(e) = 0.001 / (2 e sqrt(2)), scaled with the residuals.
    expected = 0.001 / (1.4 * math.sqrt(2.0)) * math.sqrt(result.residual_variance)
    assert result["restitution"].standard_error == pytest.approx(expected, rel=0.02)


def test_how_long_a_contact_lasts_tells_stiffness():
    """Half a swing about where its weight rests: w T = pi + 2 atan(g / (w v))."""
    result = fit(presses(), starts=0)
    rate, speed = math.pi / 0.02, math.sqrt(2.0 * G * 0.3)
    for _ in range(20):
        rate = (math.pi + 2.0 * math.atan(G / (rate * speed))) / 0.02
    assert result["stiffness"].value == pytest.approx(MASS * rate**2, rel=0.002)
    # A function without a name given has its own.
    assert [c.channel for c in result.channels if c.count] == ["contact_time"]


def test_functions_get_the_recording_at_every_step_and_what_recorders_read():
    seen = []

    def look(simulated, trajectory):
        seen.append((simulated, trajectory))
        return np.empty(0)

    delay = Parameter.delay("load", bounds=(-0.01, 0.03), start=0.02)
    cell = Trajectory(
        "cell", 1.0 + 0.01 * np.arange(30), np.zeros((30, 3)), None, "ball",
        initial_qpos=[0, 0, RADIUS + 0.1, 1, 0, 0, 0], initial_qvel=np.zeros(6),
        sensors={"load": np.zeros(30)}, events={"impact": [1.15]}, sampling={"load": "instant"},
    )  # fmt: skip
    problem = Problem(
        ball(stiffness=1e4, restitution=0.5), [RESTITUTION, delay], [cell], position_sigma=1e-3,
        sensor_sigma={"load": 1.0}, event_sigma={"impact": 1e-3}, residuals={"look": look},
    )  # fmt: skip
    objective = Objective(problem)
    (read,) = objective.observe(objective.start())
    simulated, trajectory = seen[0]
    assert isinstance(simulated, SimulatedRecording)
    assert trajectory is cell
    # It falls for sqrt(0.2 / g) = 0.143 s.
    falling = simulated.time <= 1.14
    height = RADIUS + 0.1 - 0.5 * G * (simulated.time[falling] - 1.0) ** 2
    np.testing.assert_allclose(simulated.position["ball"][falling, 2], height, atol=1e-12)
    np.testing.assert_allclose(np.diff(simulated.time), STEP)
    assert simulated.time[0] == 1.0
    assert set(simulated.sensors) == {"load", "speed"}
    assert np.isnan(simulated.sensors["load"][0]).all()
    assert set(simulated.times) == set(simulated.readings) == {"poses", "load", "impact"}
    np.testing.assert_array_equal(simulated.times["load"], cell.time)
    for name in simulated.times:
        np.testing.assert_allclose(simulated.readings[name], read[name], rtol=1e-12, atol=1e-15)
    assert simulated.readings["impact"][0, 0] == pytest.approx(math.sqrt(0.2 / G), abs=1e-6)
    with pytest.raises(ValueError, match="read-only"):
        simulated.position["ball"][0] = 0.0
    # No residuals, no channel.
    assert "look" not in read


@pytest.mark.parametrize(
    ("function", "error", "message"),
    [
        (lambda s, t: 1 / 0, SimulationError, r"'drop 0': residuals 'kept' failed: ZeroDivision"),
        (lambda s, t: [0.0, np.nan], SimulationError, r"not finite: \[1\] = nan"),
        (lambda s, t: np.zeros((2, 2)), ValueError, r"'drop 0': residuals 'kept' must be \(n,\)"),
        (lambda s, t: "much", TypeError, r"'drop 0': residuals 'kept'"),
        (lambda s, t: ([1.0], [0.0]), ValueError, r"sigmas of trajectory 'drop 0'.* must be > 0"),
        (lambda s, t: ([1.0], [1.0, 2.0]), ValueError, r"one or \(1,\)"),
        (lambda s, t: ([1.0], 1.0, 1.0), ValueError, "one array, or two, with sigmas; got 3"),
        (lambda s, t: [], ValueError, "'drop 0': nothing was measured of it"),
    ],
)
def test_what_a_function_returns_is_checked(function, error, message):
    with pytest.raises(error, match=message):
        fit(bounces(function), starts=0)


@pytest.mark.parametrize(
    ("residuals", "error", "message"),
    [
        ({"kept": 3}, TypeError, "residuals must be functions by name, got 'kept': 3"),
        (3, TypeError, "residuals must be functions by name, or one, got 3"),
        ({"load": kept_energy}, ValueError, "residuals 'load' need another name"),
        ({"rotation": kept_energy}, ValueError, "residuals 'rotation' need another name"),
    ],
)
def test_what_is_no_function_is_refused(residuals, error, message):
    with pytest.raises(error, match=message):
        bounces(residuals=residuals, sensor_sigma={"load": 1.0})


def test_as_many_residuals_are_wanted_for_all_values():
    def bouncing(simulated, trajectory):
        touches = simulated.sensors["load"][1:, 0] > 0.0
        return np.zeros(1 + np.count_nonzero(touches))

    with pytest.raises(ValueError, match=r"'drop 0': .* for all values .* at the start"):
        fit(bounces(bouncing), starts=0)


def test_candidates_without_residuals_count_as_failed():
    """Beyond a restitution of 0.6 the function finds nothing; the least is at 0.55."""

    def narrow(simulated, trajectory):
        kept = 0.49 + 0.001 * kept_energy(simulated, trajectory)
        return math.nan if kept > 0.36 else (kept - 0.3025) / 0.001

    result = fit(bounces(narrow, heights=(0.3, 0.2)), starts=7)
    assert result["restitution"].value == pytest.approx(0.55, abs=0.002)


def test_functions_have_no_recorder():
    problem = Objective(bounces()).problem
    late = Parameter.delay("kept", bounds=(-0.01, 0.01))
    with pytest.raises(ValueError, match="'kept' is a function's, and has no recorder"):
        dataclasses.replace(problem, parameters=[RESTITUTION, late])


def test_workers_and_files_come_to_the_same_bits(tmp_path):
    problem = bounces(heights=(0.3, 0.2))
    here = fit(problem, starts=0)
    with ThreadPoolExecutor(1) as pool:
        there = fit(problem, starts=0, executor=pool)
    kept = [fit(problem, starts=0, checkpoint=tmp_path / "fit.npz") for _ in range(2)]
    for other in (there, *kept):
        assert other["restitution"] == here["restitution"]
        assert other.evaluations == here.evaluations


def test_a_function_that_cannot_be_sent_is_named(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with (
        ThreadPoolExecutor(1) as pool,
        pytest.raises(TypeError, match=r"pickled: .*, residuals 'kept' have to be"),
    ):
        fit(bounces(lambda s, t: [0.0, 1.0]), starts=0, executor=pool)


@pytest.mark.parametrize("right", [True, False])
def test_they_are_a_channel_of_their_own(right):
    """Noise on the depth of a ball that rests on a spring; or a drift that no stiffness makes."""
    rng = np.random.default_rng(4)
    noise = rng.normal(size=100) + (0.0 if right else 0.03 * np.arange(100.0))

    def depth(simulated, trajectory):
        sunk = RADIUS - simulated.position["ball"][-100:, 2]
        return (sunk - MASS * G / 1e4) / 1e-6 + 5.0 * noise

    rest = Trajectory(
        "rest", [0.0, 0.5], np.zeros((2, 3)), None, "ball",
        initial_qpos=[0, 0, RADIUS - MASS * G / 1e4, 1, 0, 0, 0], initial_qvel=np.zeros(6),
    )  # fmt: skip
    problem = Problem(
        ball(stiffness=1e4, restitution=0.1), [STIFFNESS], [rest], residuals={"depth": depth},
        noise="estimate",
    )  # fmt: skip
    result = fit(problem, starts=0)
    assert [channel.channel for channel in result.misfits] == ([] if right else ["depth"])
    assert not result.explanations
    (sigma,) = result.problem.deviations["depth"]
    if right:
        assert sigma == pytest.approx(5.0 * np.std(noise, ddof=1), rel=0.02)
        assert result["stiffness"].identified


def test_predictions_reports_and_files_show_them(tmp_path):
    result = fit(bounces(heights=(0.3, 0.2)), starts=0)
    rms = float(np.sqrt(np.mean([np.square(r["kept"]) for r in result.channel_residuals])))
    assert result.metrics()["residuals.kept_rms"] == pytest.approx(rms)
    own = [prediction.residuals["kept"][0] for prediction in result.predict()]
    fitted = [residuals["kept"][0, 0] for residuals in result.channel_residuals]
    np.testing.assert_allclose(own, fitted, rtol=1e-9)
    (other,) = result.predict([drop(0.25, "other")])
    assert abs(other.residuals["kept"][0]) < 3.0
    assert "kept" in str(result.predict())
    assert "kept" in result.report(tmp_path / "fit.html", held_out=[drop(0.25, "o")]).read_text()
    loaded = Fit.load(result.save(tmp_path / "fit.json"))
    assert loaded.metrics() == result.metrics()
    np.testing.assert_array_equal(
        loaded.channel_residuals[0]["kept"], result.channel_residuals[0]["kept"]
    )


def test_they_are_of_the_whole():
    """In a window that is shorter they do not count, as scalars do not."""
    asked = []

    def note(simulated, trajectory):
        asked.append(simulated.time[-1])
        return kept_energy(simulated, trajectory)

    frames = Trajectory(
        "drop", 0.01 * np.arange(51), np.zeros((51, 3)), None, "ball",
        initial_qpos=[0, 0, RADIUS + 0.3, 1, 0, 0, 0], initial_qvel=np.zeros(6),
    )  # fmt: skip
    problem = Problem(
        ball(stiffness=1e6, restitution=0.5), [RESTITUTION], [frames], position_sigma=1.0,
        residuals={"kept": note},
    )  # fmt: skip
    assert Objective(problem.with_window(0.3)).residual_count == 31 * 6
    assert not asked
    assert Objective(problem).residual_count == 51 * 6 + 1
    assert asked == [pytest.approx(0.5)]


def test_beside_a_function_that_refuses_other_readings_misfits_are_tried_all_the_same():
    """It finds nothing where the speed is read late or with a gain, so that these are passed by."""

    def strict(simulated, trajectory):
        same = np.allclose(simulated.readings["speed"], simulated.sensors["speed"][::10])
        return 0.0 if same else math.nan

    time = 0.01 * np.arange(31)
    falling = Trajectory(
        "falling", time, np.zeros((31, 3)), None, "ball",
        initial_qpos=[0, 0, RADIUS + 0.1, 1, 0, 0, 0], initial_qvel=np.zeros(6),
        sensors={"speed": np.outer(np.sin(20.0 * time), np.ones(3))},
    )  # fmt: skip
    problem = Problem(
        ball(stiffness=1e4, restitution=0.5), [RESTITUTION], [falling],
        sensor_sigma={"speed": 0.01}, residuals={"strict": strict},
    )  # fmt: skip
    assert fit(problem, starts=0, max_evaluations=100).misfits
