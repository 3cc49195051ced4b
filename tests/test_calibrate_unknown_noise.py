"""Calibration with noise that is not known: standard deviations are estimated by channel."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.calibrate import Parameter, Problem, Trajectory, fit
from dashpot.calibrate.inference.noise_estimate import noise_factors
from dashpot.calibrate.residuals.losses import Loss
from dashpot.calibrate.residuals.objective import Objective
from dashpot.calibrate.search.budget import Budget
from dashpot.calibrate.search.search import Search

SPRING = """
<mujoco>
  <option timestep="0.005" gravity="0 0 0"/>
  <worldbody>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0" stiffness="40" damping="0.4"/>
      <geom name="cart" type="box" size=".1 .1 .1" mass="1"/>
    </body>
  </worldbody>
  <sensor>
    <jointpos name="place" joint="rail"/>
    <jointvel name="speed" joint="rail"/>
  </sensor>
</mujoco>
"""
TRUE = {"place": 2e-3, "speed": 3e-2}
UNKNOWN = [
    Parameter.model("jnt_stiffness", "rail", start=30.0, bounds=(5.0, 200.0), name="stiffness"),
    Parameter.model("dof_damping", "rail", start=0.6, bounds=(0.01, 5.0), name="damping"),
]


def swing(seed, stated, *, every=1, frames=120, unknown=UNKNOWN, push=0.0, **fields):
    """Return a problem of a mass on a spring, with TRUE noise where `stated` is another."""
    model = mujoco.MjModel.from_xml_string(SPRING)
    engine, rng = dashpot.Engine(model), np.random.default_rng(seed)
    data = engine.make_data()
    data.qpos[0] = 0.1
    data.qfrc_applied[0] = push
    readings = []
    for frame in range(frames):
        if frame:
            engine.step(data, nstep=2)
        readings.append([data.qpos[0], data.qvel[0]])
    clean = np.array(readings)
    sensors = {
        name: clean[:, i] + sigma * rng.normal(size=frames)
        for i, (name, sigma) in enumerate(TRUE.items())
    }
    sensors["speed"][np.arange(frames) % every != 0] = np.nan
    trajectory = Trajectory.of_sensors(
        "swing", 0.01 * np.arange(frames), sensors, initial_qpos=[0.1], initial_qvel=[0.0]
    )
    return Problem(
        dashpot.Engine(model), unknown, [trajectory],
        sensor_sigma=stated, initial_state="pose_and_velocity", **fields,
    )  # fmt: skip


@pytest.mark.parametrize("factors", [(10.0, 0.1)])
def test_sigmas_are_found_from_a_tenth_to_ten_times(factors):
    """The standard error of each is 1 / sqrt(2 n), 7 % of 120 readings."""
    stated = {name: f * TRUE[name] for name, f in zip(TRUE, factors, strict=True)}
    result = fit(swing(0, stated, noise="estimate"), starts=0)
    found = result.problem.deviations
    for name, sigma in TRUE.items():
        assert found[name][0] == pytest.approx(sigma, rel=3.0 / math.sqrt(240))
        # Where search and noise come to rest does not depend on where they began.
    right = fit(swing(0, TRUE, noise="estimate"), starts=0)
    for name in ("stiffness", "damping"):
        assert result[name].value == pytest.approx(right[name].value, rel=1e-3)
        assert result[name].standard_error == pytest.approx(right[name].standard_error, rel=0.05)
        assert result[name].grade == "identified"
    assert not result.misfits


def test_what_the_parameters_take_is_no_smaller_noise():
    """Of 24 readings that tell 4 unknowns the mean square is 20 / 24 of the variance."""
    squares, plain = [], []
    for seed in range(40):
        objective = Objective(swing(seed, TRUE, frames=12))
        search = Search(objective, Loss(), Budget(2000, lambda *_: None))
        residuals = objective.residuals(objective.start())[0]
        jacobian = objective.jacobian(objective.start()).dense()
        # At the minimum of the linear model: what is left has lost four directions.
        left = residuals - jacobian @ np.linalg.lstsq(jacobian, residuals, rcond=None)[0]
        search.best_residuals = left
        factors = noise_factors(search)
        squares.append([factors[name] ** 2 for name in TRUE])
        plain.append(left @ left / left.size)
    # Each has about 10 degrees of freedom, so the mean of 80 a deviation of sqrt(2 / 800).
    assert np.mean(squares) == pytest.approx(1.0, abs=3.0 * math.sqrt(2.0 / 800))
    assert np.mean(plain) == pytest.approx(20 / 24, abs=3.0 * math.sqrt(2.0 / 800))


def test_a_misfit_at_a_rate_of_its_own_is_named():
    """A constant push that the model does not know of, with speeds at 25 Hz of 100."""
    right = fit(swing(1, TRUE, every=4, noise="estimate"), starts=0)
    assert not right.misfits
    wrong = fit(swing(1, TRUE, every=4, push=0.6, noise="estimate"), starts=0)
    assert "place" in {misfit.channel for misfit in wrong.misfits}
    for estimate in wrong.estimates:
        assert estimate.grade != "identified"
        assert "place (correlation" in estimate.statement
    assert max(estimate.widening for estimate in wrong.estimates) > 1.3


@pytest.mark.parametrize("loss", ["huber"])
def test_intervals_of_a_misfit_are_those_of_correlated_noise(loss):
    """Noise of an autoregressive process of 0.8 makes errors sqrt(1.8 / 0.2) = 3 times as large.

    Of what varies slowly against it, as the decay of a swing over 1,200 frames does.
    """
    problem = swing(2, TRUE, frames=1200)
    (trajectory,) = problem.trajectories
    rng, noise = np.random.default_rng(7), np.zeros(1200)
    for k in range(1, 1200):
        noise[k] = 0.8 * noise[k - 1] + 0.6 * rng.normal()
    clean = Objective(problem).observe(Objective(problem).start())[0]
    coloured = Trajectory.of_sensors(
        "swing", trajectory.time,
        {"place": clean["place"][:, 0] + TRUE["place"] * noise},
        initial_qpos=[0.1], initial_qvel=[0.0],
    )  # fmt: skip
    problem = Problem(problem.system, UNKNOWN, [coloured], sensor_sigma={"place": TRUE["place"]})
    result = fit(problem, loss=loss, starts=0)
    assert [misfit.channel for misfit in result.misfits] == ["place"]
    assert result.misfits[0].correlation == pytest.approx(0.8, abs=0.05)
    # The swing itself turns by 0.063 a frame: sqrt of (1 - 0.8^2) / (1 - 1.6 cos + 0.64) is 2.8.
    expected = math.sqrt(0.36 / (1.0 - 1.6 * math.cos(0.01 * math.sqrt(40.0)) + 0.64))
    for estimate in result.estimates:
        assert estimate.widening == pytest.approx(expected, rel=0.25)


def test_noise_that_a_budget_leaves_unsettled_is_said():
    stated = {name: 10.0 * sigma for name, sigma in TRUE.items()}
    with pytest.warns(UserWarning, match="standard deviations are not those of the residuals yet"):
        fit(swing(0, stated, noise="estimate"), starts=0, max_evaluations=5)


@pytest.mark.parametrize("budget", [5, 10, 40])
@pytest.mark.filterwarnings("ignore:standard deviations")
def test_noise_that_is_estimated_overruns_no_budget_that_stated_noise_keeps(budget):
    stated = {name: 10.0 * sigma for name, sigma in TRUE.items()}
    spent = [
        fit(swing(0, stated, noise=noise), starts=0, max_evaluations=budget).evaluations
        for noise in ("stated", "estimate")
    ]
    assert spent[1] <= max(spent[0], budget)


def test_noise_is_stated_or_estimated():
    with pytest.raises(ValueError, match="noise must be 'stated' or 'estimate', got 'unknown'"):
        swing(0, TRUE, noise="unknown")
