"""Calibration with frames whose rate is not known exactly: how fast they run is estimated too."""

from __future__ import annotations

import dataclasses
import math

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.calibrate import Parameter, Problem, Trajectory, fit

RATE, STIFFNESS, MASS = 100.0, 40.0, 1.0
SPRING = f"""
<mujoco>
  <option timestep="0.01" gravity="0 0 0" integrator="RK4"/>
  <worldbody>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0" stiffness="{STIFFNESS}"/>
      <geom name="cart" type="box" size=".1 .1 .1" mass="{MASS}"/>
    </body>
  </worldbody>
  <sensor><jointpos name="place" joint="rail"/><jointpos name="encoder" joint="rail"/></sensor>
</mujoco>
"""
UNKNOWN = Parameter.model("jnt_stiffness", "rail", start=35.0, bounds=(5.0, 200.0), name="k")
SIGMA = 1e-3


def place(time):
    """Return where the cart is, let go at 0.1 m."""
    return 0.1 * np.cos(math.sqrt(STIFFNESS / MASS) * time)


def seen(slower, rate_sigma, seed=0, frames=120, **fields):
    """Return a problem of frames that are apart by so much more than they are said to be."""
    stated, rng = np.arange(frames) / RATE, np.random.default_rng(seed)
    read = {"place": place((1.0 + slower) * stated) + SIGMA * rng.normal(size=frames)}
    read |= fields.pop("sensors", {})
    initial_state = fields.pop("initial_state", "given")
    trajectory = Trajectory.of_sensors(
        "swing", stated, read, initial_qpos=[0.1], initial_qvel=[0.0], rate_sigma=rate_sigma,
        **fields,
    )  # fmt: skip
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(SPRING))
    sigma = dict.fromkeys(read, SIGMA)
    return Problem(engine, [UNKNOWN], [trajectory], sensor_sigma=sigma, initial_state=initial_state)


@pytest.mark.parametrize(("frames", "jitter"), [(60, 0.1), (150, 0.2), (400, 0.15)])
def test_stamps_tell_the_rate_of_frames_as_a_line_through_them_does(frames, jitter):
    """Its slope has a standard error of sqrt(12 / n^3) of their jitter."""
    rng = np.random.default_rng(frames)
    number = np.arange(frames)
    stamps = (number + jitter * rng.normal(size=frames)) / RATE
    still = np.zeros((frames, 3))
    even = Trajectory("still", stamps, still, None, "ball", frames="even")
    assert even.rate_sigma == pytest.approx(jitter * math.sqrt(12 / frames**3), rel=0.25)
    assert dataclasses.replace(even, name="copy").rate_sigma == even.rate_sigma
    assert even.between(even.time[10], even.time[40]).rate_sigma == even.rate_sigma
    known = Trajectory("still", stamps, still, None, "ball", frames="even", rate=RATE)
    assert known.rate_sigma == Trajectory("s", number, still, None, "ball").rate_sigma == 0.0


@pytest.mark.parametrize("rate_sigma", [0.01])
def test_of_a_swing_a_rate_that_is_not_known_is_an_error_of_twice_as_much_in_stiffness(rate_sigma):
    """Stiffness is mass times the square of the frequency."""
    exact, vague = (fit(seen(0.0, sigma), starts=0)["k"] for sigma in (0.0, rate_sigma))
    alone, together = (e.standard_error / e.value for e in (exact, vague))
    scale = together / math.hypot(alone, 2.0 * rate_sigma)
    assert scale == pytest.approx(1.0, rel=0.15)  # the noise that residuals have


@pytest.mark.parametrize("slower", [-0.01])
def test_a_camera_that_runs_wrong_is_told_by_an_encoder_that_runs_right(slower):
    """Without the encoder stiffness takes the error, (1 + slower)^2 of it."""
    time = 0.0013 + np.arange(100) / 90.0
    noise = SIGMA * np.random.default_rng(5).normal(size=100)
    beside = {
        "sensors": {"encoder": place(time) + noise},
        "sensor_times": {"encoder": time},
    }
    alone = fit(seen(slower, 0.0), starts=0)["k"]
    assert alone.value == pytest.approx(STIFFNESS * (1.0 + slower) ** 2, rel=1e-3)
    both = fit(seen(slower, 0.02, **beside), starts=0)
    assert both["k"].value == pytest.approx(STIFFNESS, rel=1e-3)
    assert both["k"].lower < STIFFNESS < both["k"].upper
    assert not both.misfits
    assert both.frame_pace == pytest.approx([1.0 + slower], abs=1e-3)
    wrong = fit(seen(slower, 0.0, **beside), starts=0)
    assert wrong.misfits


def test_predictions_run_as_stated_or_as_their_heads_say():
    result = fit(seen(0.004, 0.002, initial_state="velocity"), starts=0)
    trajectory = result.problem.trajectories[0]
    (own,) = result.predict()
    (others,) = result.predict([trajectory], head=0.5)
    for prediction in (own, others):
        assert np.abs(prediction.sensor_errors["place"]).max() < 5.0 * SIGMA
    (stated,) = result.predict([trajectory])
    assert stated.sensors["place"].shape == own.sensors["place"].shape


def test_a_checkpoint_is_of_one_knowledge_of_the_rate(tmp_path):
    vague, sharp = (seen(0.001, sigma, frames=60) for sigma in (0.01, 0.001))
    fit(vague, starts=0, checkpoint=tmp_path / "fit.npz")
    resumed = fit(sharp, starts=0, checkpoint=tmp_path / "fit.npz")
    assert resumed.values == fit(sharp, starts=0).values


@pytest.mark.parametrize("value", [-0.1, math.nan, "fast"])
def test_a_rate_has_a_standard_deviation_or_none(value):
    with pytest.raises((ValueError, TypeError), match="trajectory 'swing': rate_sigma must be"):
        seen(0.0, value)
