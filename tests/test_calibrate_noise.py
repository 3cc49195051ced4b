"""Calibration: which residuals tell how large the noise is, and what robust losses make of them."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy import integrate, optimize, stats

import dashpot
from ball_throws import FALL, IDENTITY, SIDEWAYS, ball_engine, ball_parameters, observe
from dashpot.calibrate import Parameter, Problem, Trajectory, fit
from dashpot.calibrate.inference.intervals import covariance, residual_variance
from dashpot.calibrate.inference.stated_noise import noise_explains
from dashpot.calibrate.residuals.losses import Loss
from dashpot.calibrate.residuals.objective import Objective
from dashpot.calibrate.search.budget import Budget
from dashpot.calibrate.search.search import Search

ROBUST = ("soft_l1", "huber", "cauchy", "arctan")
LOSSES = ("linear", *ROBUST)


@pytest.mark.parametrize("name", LOSSES)
@pytest.mark.parametrize("scale", [0.7, 2.0])
def test_scores_and_slopes_are_the_derivatives_of_the_loss(name, scale):
    loss = Loss(name, scale)
    r = np.linspace(-4.0, 4.0, 41) + 0.013  # no kink of huber within a difference
    h = 1e-5
    # Central differences: truncation of h^2 and rounding of 1e-16 * 16 / h.
    score = (loss.values(r + h) - loss.values(r - h)) / (4.0 * h)
    np.testing.assert_allclose(loss.scores(r), score, atol=1e-8)
    slope = (loss.scores(r + h) - loss.scores(r - h)) / (2.0 * h)
    np.testing.assert_allclose(loss.slopes(r), slope, atol=1e-8)


@pytest.mark.parametrize("name", LOSSES)
def test_losses_are_those_of_scipy(name):
    residuals = np.array([0.1, -0.8, 3.0, -20.0])
    theirs = optimize.least_squares(
        lambda x: residuals + 0.0 * x, [0.0], loss=name, f_scale=1.5, max_nfev=1
    ).cost
    assert Loss(name, 1.5).values(residuals).sum() / 2 == pytest.approx(theirs, rel=1e-14)


@pytest.mark.parametrize("name", LOSSES)
def test_moments_under_normal_noise_are_the_integrals(name):
    loss = Loss(name, 0.9)

    def expectation(function):
        return (
            2.0
            * integrate.quad(
                lambda r: function(loss.values(np.array(r))) * stats.norm.pdf(r),
                0,
                12,
                points=[0.9],
            )[0]
        )

    mean = expectation(lambda v: v)
    variance = expectation(lambda v: (v - mean) ** 2)
    # The kink of huber's loss leaves Gauss-Hermite quadrature a thousandth.
    assert loss.normal_moments() == pytest.approx((mean, variance), rel=2e-3)


# Derivatives of the losses by the squared residual.
WEIGHTS = {
    "linear": np.ones_like,
    "soft_l1": lambda square: (1.0 + square) ** -0.5,
    "huber": lambda square: np.maximum(square, 1.0) ** -0.5,
    "cauchy": lambda square: 1.0 / (1.0 + square),
    "arctan": lambda square: 1.0 / (1.0 + square**2),
}


@pytest.mark.parametrize("name", LOSSES)
def test_intervals_of_a_location_cover_it_as_often_as_they_say(name):
    """The mean of normal samples by each loss, 400 times: Huber's errors are its deviations."""
    loss, count, size = Loss(name), 400, 100
    samples = np.random.default_rng(0).normal(size=(count, size))
    places = np.zeros((count, 1))
    for _ in range(100):  # means, weighted anew
        weights = WEIGHTS[name]((places - samples) ** 2)
        places = np.sum(weights * samples, axis=1, keepdims=True) / weights.sum(1, keepdims=True)
    deviations = np.empty(count)
    covered = 0
    for i, (place, residuals) in enumerate(zip(places[:, 0], places - samples, strict=True)):
        estimated = covariance(np.ones((size, 1)), residuals, loss=loss)
        deviations[i] = place / estimated.standard_error[0]
        covered += abs(place) < estimated.half_width(0.95)[0]
    # Binomial: 380 of 400 with a deviation of 4.4; the deviation itself is known to 3.5 %.
    assert abs(covered - 380) < 3.3 * 4.4
    assert deviations.std() == pytest.approx(1.0, abs=3.3 * 0.036)


def test_clustered_errors_of_a_robust_loss_have_its_slope():
    """Equal clusters of one residual each: the sandwich is that of independent residuals."""
    rng = np.random.default_rng(3)
    residuals, loss = rng.normal(size=200), Loss("cauchy")
    result = covariance(np.ones((200, 1)), residuals, loss=loss, offsets=np.arange(201))
    psi, slope = loss.scores(residuals), loss.slopes(residuals).mean()
    expected = math.sqrt(200 / 199 * (psi @ psi)) / (200 * slope)
    assert result.standard_error[0] == pytest.approx(expected, rel=1e-12)


def test_where_the_cost_does_not_rise_nothing_is_determined():
    """Residuals of two scales lie where the score of the cauchy loss falls: slopes are -0.12."""
    result = covariance(np.ones((50, 1)), np.full(50, 2.0), loss=Loss("cauchy"))
    assert result.standard_error[0] == math.inf


def test_residuals_without_noise_are_no_degrees_of_freedom():
    rng = np.random.default_rng(5)
    slope = np.concatenate([np.ones(30), np.zeros(90)])[:, None]
    residuals = np.concatenate([rng.normal(size=30), np.zeros(90)])
    residuals[:30] -= residuals[:30].mean()
    result = covariance(slope, residuals, live=residuals != 0.0)
    assert result.degrees_of_freedom == 29
    assert result.standard_error[0] == pytest.approx(residuals[:30].std(ddof=1) / math.sqrt(30))


def test_unknowns_that_only_exact_residuals_see_take_no_degree_of_freedom():
    rng = np.random.default_rng(6)
    jacobian = np.zeros((40, 2))
    jacobian[:30, 0] = jacobian[30:, 1] = 1.0
    residuals = np.concatenate([rng.normal(size=30), np.zeros(10)])
    result = covariance(jacobian, residuals, live=np.arange(40) < 30)
    assert result.degrees_of_freedom == 29


@pytest.mark.parametrize("share", [0.0, 0.05, 0.1])
def test_a_tenth_of_outliers_leaves_the_noise_explained(share):
    rng = np.random.default_rng(7)
    residuals = rng.normal(size=20_000)
    residuals[: int(share * 20_000)] *= 1e3
    variance = residual_variance(residuals, 0, Loss("huber"))
    # The quantile of what outliers leave, to 3.3 deviations of the root of 3.6 / count, grown by
    # the share as the density falls off.
    quantile = stats.norm.ppf(0.5 + 0.35 / (1.0 - share)) / stats.norm.ppf(0.85)
    assert variance == pytest.approx(quantile**2, abs=3.3 * 2 * math.sqrt(3.6 / 20_000))
    assert noise_explains(variance, 20_000, robust=True)
    assert not noise_explains(residual_variance(residuals, 0, Loss()), 20_000) or share == 0.0


def test_a_misfit_of_half_the_residuals_is_not_explained_by_any_loss():
    residuals = np.random.default_rng(8).normal(size=2000)
    residuals[:1000] += 10.0
    for name in ROBUST:
        assert not noise_explains(residual_variance(residuals, 0, Loss(name)), 2000, robust=True)


@pytest.mark.parametrize("name", LOSSES)
def test_searches_take_normal_noise_for_explained_and_twice_of_it_not(name):
    problem = Problem(
        ball_engine(), ball_parameters(), [observe(ball_engine(), SIDEWAYS)], 1e-4, 1e-3
    )
    objective = Objective(problem)
    search = Search(objective, Loss(name), Budget(10, lambda *_: None))
    noise = np.random.default_rng(9).normal(size=objective.residual_count)
    assert search.explained(noise, 3.0)
    assert not search.explained(2.0 * noise, 3.0)
    # A quarter of them exact: the others are to be explained by their own number.
    noise.reshape(-1, 6)[:, 3] = 0.0
    assert not search.explained(1.2 * noise, 3.0)


def fall(seed, sigma):
    """Return the fall of a ball of which the height alone is measured, gravity unknown."""
    model = mujoco.MjModel.from_xml_string(FALL)
    k = np.arange(50)
    position = np.full((50, 3), 7.0)  # x and y are not where the ball is
    noise = sigma * np.random.default_rng(seed).normal(size=50)
    position[:, 2] = 1.0 - 9.81 * 0.01**2 * k * (k + 1) / 2 + noise
    trajectory = Trajectory(
        "fall", 0.01 * k, position, np.tile(IDENTITY, (50, 1)), ("body",), initial_qvel=np.zeros(6),
        initial_qpos=[0, 0, 1, *IDENTITY],
    )  # fmt: skip

    def downwards(system, value):
        system.opt.gravity[2] = -value

    gravity = Parameter("gravity", start=5.0, bounds=(1.0, 20.0), apply=downwards)
    return Problem(model, [gravity], [trajectory], (math.inf, math.inf, sigma), math.inf)


def test_what_is_not_measured_does_not_count():
    result = fit(fall(1, 1e-3))
    errors = result.residuals[0][:, 0]
    assert not errors[:, [0, 1, 3, 4, 5]].any()
    assert result.live_residuals == 50
    assert result.residual_variance == pytest.approx(errors[:, 2] @ errors[:, 2] / 49, rel=1e-12)
    assert result.metrics()["position_rms"] == pytest.approx(1e-3 * np.sqrt(np.mean(errors**2) * 6))
    assert "rotation_rms" not in result.metrics()


def test_intervals_of_what_one_coordinate_tells_cover_the_truth():
    covered = sum(
        estimate.lower <= 9.81 <= estimate.upper
        for estimate in (fit(fall(seed, 1e-3))["gravity"] for seed in range(20))
    )
    # Binomial: fewer than 16 of 20 once in 400; six times the degrees of freedom would give 12.
    assert covered >= 16


def test_a_state_that_is_not_measured_starts_as_the_model_has_it():
    problem = fall(1, 1e-3)
    trajectory = replace(problem.trajectories[0], initial_qpos=None, initial_qvel=None)
    problem = replace(problem, trajectories=[trajectory], initial_state="pose_and_velocity")
    qpos, qvel = problem.initial_states(problem.system)
    np.testing.assert_array_equal(qpos[0, [0, 1, 3, 4, 5, 6]], [0, 0, *IDENTITY])
    assert qpos[0, 2] == trajectory.position[0, 0, 2]
    assert not qvel[0, [0, 1, 3, 4, 5]].any()


@pytest.mark.parametrize(
    ("sigma", "message"),
    [
        ((math.inf, math.inf), "position_sigma and rotation_sigma are all infinite"),
        (((1e-3, 0.0, 1e-3), 1.0), r"position_sigma\[1\] must be > 0, or inf .*, got 0.0"),
        (((1e-3, 1e-3), 1.0), r"position_sigma must be one number or three"),
        ((-math.inf, 1.0), "position_sigma must be > 0"),
        ((1.0, math.nan), "rotation_sigma must be > 0"),
    ],
)
def test_a_bad_standard_deviation_is_named(sigma, message):
    problem = fall(1, 1e-3)
    with pytest.raises(ValueError, match=message):
        replace(problem, position_sigma=sigma[0], rotation_sigma=sigma[1])


def test_data_without_noise_count_as_a_whole():
    trajectory = observe(dashpot.Engine(mujoco.MjModel.from_xml_string(FALL)), np.zeros(6))
    problem = replace(fall(1, 1e-3), trajectories=[trajectory], rotation_sigma=1.0)
    objective = Objective(problem)
    live = objective.live(np.zeros(objective.residual_count)).reshape(-1, 6)
    assert (live == [False, False, True, True, True, True]).all()
