"""Calibration from starts where a parameter does not act: friction that always holds."""

import math

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.calibrate import Parameter, Problem, Trajectory, fit

SLED = """
<mujoco>
  <option timestep="0.001"/>
  <worldbody>
    <geom name="table" type="plane" size="2 2 .1"/>
    <body name="sled" pos="0 0 .05">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
      <geom name="sled" type="box" size=".05 .05 .05" mass="1"/></body>
  </worldbody>
  <actuator><motor joint="x"/></actuator>
  <sensor><jointpos name="x" joint="x"/></sensor>
</mujoco>
"""
RATE, NOISE, FRAMES = 4.0, 1e-4, 201  # N/s, m; a frame each 5 ms


def pulled(friction, seed):
    """Return the record of a sled that a rising force pulls loose: x = r (t - t0)^3 / 6 m."""
    time = 0.005 * np.arange(FRAMES)
    loose = np.maximum(time - friction * 9.81 / RATE, 0.0)
    noise = NOISE * np.random.default_rng(seed).normal(size=FRAMES)
    # Held at its mean between two frames.
    force = RATE * (time[:-1] + 0.0025)
    return Trajectory.of_sensors(
        "pull",
        time,
        {"x": RATE * loose**3 / 6.0 + noise},
        initial_qvel=np.zeros(2),
        control=force[:, None],
    )


def sled_problem(start):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(SLED))
    friction = Parameter.pair("sled", "table", "sliding_friction", start=start, bounds=(0.02, 2.0))
    return Problem(
        engine, [friction], [pulled(0.27, 1)], math.inf, math.inf, sensor_sigma={"x": NOISE}
    )


@pytest.mark.parametrize("start", [0.9])
def test_friction_is_found_from_a_start_that_never_slips(start):
    """The force rises to 4 N, which friction above 0.41 holds."""
    result = fit(sled_problem(start))
    estimate = result["sliding_friction"]
    assert result.noise_explains
    assert estimate.identified
    # In half a step of 1 ms the force rises by what 2e-4 of friction is; noise makes 5e-5.
    assert abs(estimate.value - 0.27) < 3e-4
    assert result.evaluations < 250


def test_a_search_without_further_starts_stays_where_nothing_acts():
    result = fit(sled_problem(0.9), starts=0)
    assert result["sliding_friction"].value == pytest.approx(0.9)
    assert "does not depend on it" in result["sliding_friction"].statement
