"""Calibration: what fitted or any parameter values predict of trajectories."""

import pickle
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ball_throws import FALL, IDENTITY, SIDEWAYS, ball_engine, ball_parameters, observe
from dashpot.calibrate import Parameter, Problem, Trajectory, fit, predict

TRUTH = {"stiffness": 1e4, "damping": 20.0, "sliding_friction": 0.3}
OTHER = np.array([0.7, -0.3, -0.5, 1.0, -2.0, 0.5])
FLIGHT = 0.1  # s; the ball of `OTHER` touches down after 0.1006 s


def unknown_start(trajectory):
    return replace(trajectory, initial_qpos=None, initial_qvel=None)


def problem_of(trajectories, **changes):
    fields = {
        "system": ball_engine(),
        "parameters": ball_parameters((8e3, 25.0, 0.25)),
        "trajectories": trajectories,
        "position_sigma": 1e-4,
        "rotation_sigma": 1e-3,
    }
    return Problem(**{**fields, **changes})


def test_a_prediction_is_what_stepping_gives_and_errors_are_those_of_scipy():
    noise = np.random.default_rng(0)
    trajectory = observe(ball_engine(), SIDEWAYS, frames=30, noise=noise)
    values = {"stiffness": 2e4, "damping": 10.0, "sliding_friction": 0.2}
    (prediction,) = predict(problem_of([trajectory]), values)
    other = observe(ball_engine(2e4, 10.0, (0.2, 0.005, 0.0001)), SIDEWAYS, frames=30)
    # Rounding, grown by the bounces.
    np.testing.assert_allclose(prediction.position, other.position, atol=1e-11)
    np.testing.assert_allclose(prediction.quaternion, other.quaternion, atol=1e-11)
    np.testing.assert_array_equal(
        prediction.position_error, prediction.position - trajectory.position
    )
    observed, simulated = (
        Rotation.from_quat(t.quaternion[:, 0], scalar_first=True) for t in (trajectory, prediction)
    )
    np.testing.assert_allclose(
        prediction.rotation_error[:, 0], (observed.inv() * simulated).as_rotvec(), atol=1e-12
    )
    np.testing.assert_array_equal(prediction.initial_qpos, trajectory.initial_qpos)
    np.testing.assert_array_equal(prediction.initial_qvel, SIDEWAYS)


@pytest.mark.parametrize("initial_state", ["given", "velocity", "pose_and_velocity"])
def test_errors_of_what_was_fitted_are_the_residuals(initial_state):
    noise = np.random.default_rng(1)
    throws = [observe(ball_engine(), v, 30, noise, str(v[0])) for v in (SIDEWAYS, OTHER)]
    problem = problem_of(throws, initial_state=initial_state, window=0.2)
    result = fit(problem, starts=0)
    for prediction, residuals in zip(result.predict(), result.residuals, strict=True):
        assert prediction.position.shape == (30, 1, 3)  # to the end, whatever the window
        errors = np.concatenate(
            [prediction.position_error / 1e-4, prediction.rotation_error / 1e-3], axis=2
        )[: len(residuals)]
        np.testing.assert_allclose(errors, residuals, atol=1e-9)


def test_a_fit_predicts_an_unseen_throw_from_its_flight():
    """The errors are those of noise: of the frames, and of a start that the flight tells."""
    noise = np.random.default_rng(2)
    fitted = [observe(ball_engine(), v, 40, noise, str(v[0])) for v in (SIDEWAYS, -SIDEWAYS / 2)]
    result = fit(problem_of([unknown_start(t) for t in fitted], initial_state="pose_and_velocity"))
    seen = observe(ball_engine(), OTHER, 30, noise, "unseen")
    (prediction,) = result.predict([unknown_start(seen)], head=FLIGHT)
    # 11 frames 10 ms apart tell a velocity to sigma / (0.01 sqrt(110)): 1 mm/s at 0.1 mm, 10 mrad/s
    # at 1 mrad. Three standard errors, which contact may double:
    off = np.abs(prediction.initial_qvel - OTHER)
    assert (off[:3] < 3e-3).all()
    assert (off[3:] < 3e-2).all()
    assert np.abs(prediction.initial_qpos[:3] - seen.initial_qpos[:3]).max() < 3e-4
    exact = observe(ball_engine(), OTHER, 30)
    assert np.abs(prediction.position - exact.position).max() < 2 * 3e-3 * 0.3
    # With another contact the same flight leads elsewhere, from the same start.
    (worse,) = predict(
        result.problem,
        {**TRUTH, "damping": 100.0},
        [unknown_start(seen)],
        head=FLIGHT,
    )
    assert np.abs(worse.position - exact.position).max() > 10 * 2 * 3e-3 * 0.3
    np.testing.assert_allclose(worse.initial_qvel, prediction.initial_qvel, atol=1e-9)


def test_a_head_gives_the_straight_line_of_least_squares():
    """Free flight without gravity: the initial state is that of a regression on the head alone."""
    model = mujoco.MjModel.from_xml_string(FALL.replace("-9.81", "0"))
    rng = np.random.default_rng(3)
    time = 0.01 * np.arange(20)
    position = rng.normal(size=(20, 3))
    trajectory = Trajectory("drift", time, position, np.tile(IDENTITY, (20, 1)), "body")
    mass = Parameter.model("body_mass", "body", start=2.0, bounds=(0.1, 10.0))
    problem = Problem(model, [mass], [trajectory], 1.0, 1.0, initial_state="pose_and_velocity")
    (prediction,) = predict(problem, {"body_mass": 3.0}, head=0.07)
    line = np.polynomial.polynomial.polyfit(time[:8], position[:8], 1)
    # The search's weight of 1e-4 on its start, squared, against velocities told to 10.
    np.testing.assert_allclose(prediction.initial_qpos[:3], line[0], atol=1e-5)
    np.testing.assert_allclose(prediction.initial_qvel[:3], line[1], atol=1e-4)
    np.testing.assert_allclose(
        prediction.position[:, 0], line[0] + time[:, None] * line[1], atol=1e-4
    )


def test_a_start_that_nothing_tells_is_refused():
    throw = observe(ball_engine(), SIDEWAYS, name="throw 7")
    problem = problem_of([unknown_start(throw)], initial_state="pose_and_velocity")
    with pytest.raises(ValueError, match="'throw 7' has no initial_qvel; give it, or a head"):
        predict(problem, TRUTH)
    with pytest.warns(UserWarning, match="'throw 7': no initial_qpos"):
        predict(problem, TRUTH, [replace(throw, initial_qpos=None)])
    with pytest.raises(ValueError, match="head needs a problem that estimates initial states"):
        predict(problem_of([throw]), TRUTH, head=0.1)
    with pytest.raises(ValueError, match="12 residuals cannot determine 12 unknowns"):
        predict(problem, TRUTH, head=0.01)
    with pytest.raises(ValueError, match=r"head is 9 s; it leaves nothing to predict of .*'throw"):
        predict(problem, TRUTH, head=9)
    with pytest.raises(ValueError, match="head must be finite and > 0, got 0"):
        predict(problem, TRUTH, head=0)


def test_bad_values_and_starts_of_others_are_named():
    throw = observe(ball_engine(), SIDEWAYS, name="throw 7")
    problem = problem_of([throw])
    with pytest.raises(ValueError, match="values must be given for exactly stiffness, damping"):
        predict(problem, {"stiffness": 1e4})
    unknown = problem_of([unknown_start(throw)], initial_state="pose_and_velocity")
    with pytest.raises(ValueError, match="values must be given for exactly stiffness, damping"):
        predict(unknown, {"stiffness": 1e4})
    with pytest.raises(TypeError, match="values must be a mapping from names to values, got 3"):
        predict(problem, 3)
    with pytest.raises(TypeError, match="parameter 'damping' must be a number, got 'soft'"):
        predict(problem, {**TRUTH, "damping": "soft"})
    with pytest.raises(ValueError, match="parameter 'damping' = -1"):
        predict(problem, {**TRUTH, "damping": -1.0})
    bad = replace(throw, name="bad", initial_qpos=[1e200, 0, 0, 1, 0, 0, 0])
    with pytest.raises(ValueError, match=r"trajectory 'bad': step 0.*; with stiffness = 10000"):
        predict(problem, TRUTH, [throw, bad])
    with pytest.raises(ValueError, match="head is for other trajectories"):
        fit(problem, starts=0).predict(head=0.1)
    started = problem_of([throw], start_states=lambda _: (throw.initial_qpos[None], SIDEWAYS[None]))
    assert predict(started, TRUTH)[0].position.shape == (40, 1, 3)
    with pytest.raises(ValueError, match="start_states gives the initial states"):
        predict(started, TRUTH, [throw])


def test_a_pickled_fit_predicts_the_same():
    engine = ball_engine()
    throw = observe(engine, SIDEWAYS, 30, np.random.default_rng(4))
    result = fit(Problem(engine, ball_parameters(), [throw], 1e-4, 1e-3), max_evaluations=20)
    kept = pickle.loads(pickle.dumps(result))
    assert kept.estimates == result.estimates
    np.testing.assert_array_equal(kept.predict()[0].position, result.predict()[0].position)
