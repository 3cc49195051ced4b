"""Calibration: what the data know of products of powers of parameters, and the figure of a fit."""

import json
import math

import numpy as np
import pytest

from ball_throws import SIDEWAYS, ball_engine, ball_parameters, observe
from dashpot.calibrate import Parameter, Problem, fit
from dashpot.calibrate.inference.combinations import combinations


@pytest.mark.parametrize("correlation", [0.9, -0.9])
def test_two_equal_errors_are_known_best_across_their_correlation(correlation):
    """Covariance s^2 [[1, c], [c, 1]]: l1 - l2 and l1 + l2 vary by 2 s^2 (1 - c), 2 s^2 (1 + c)."""
    best, worst = combinations(
        ("k", "d"), (8.0, 2.0), np.array([0.1, 0.1]), np.array([[1, correlation], [correlation, 1]])
    )
    powers = -math.copysign(1.0, correlation)
    assert best.exponents["k"] * best.exponents["d"] == pytest.approx(powers)
    assert worst.exponents["k"] * worst.exponents["d"] == pytest.approx(-powers)
    for found, variance in ((best, 1 - abs(correlation)), (worst, 1 + abs(correlation))):
        assert found.relative_error == pytest.approx(0.1 * math.sqrt(2 * variance))
        expected = 8.0 ** found.exponents["k"] * 2.0 ** found.exponents["d"]
        assert found.value == pytest.approx(expected)


def test_errors_of_the_estimates_come_back_from_the_combinations():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3))
    covariance = root @ root.T
    error = np.sqrt(np.diagonal(covariance))
    found = combinations("abc", (1.0, 2.0, 3.0), error, covariance / np.outer(error, error))
    exponents = np.array([[c.exponents[name] for name in "abc"] for c in found])
    assert np.abs(exponents).max(axis=1) == pytest.approx(1.0)
    # Uncorrelated, and each with its own variance.
    np.testing.assert_allclose(
        exponents @ covariance @ exponents.T,
        np.diag([c.relative_error**2 for c in found]),
        atol=1e-12 * covariance.max(),
    )
    unit = np.linalg.norm(exponents, axis=1)
    assert (np.diff([c.relative_error for c in found] / unit) > 0).all()


def test_no_parameter_has_no_combination():
    assert combinations((), (), np.empty(0), np.empty((0, 0))) == ()


@pytest.fixture(scope="module")
def bounces():
    """Fit to a ball that bounces upright; it touches for 3 ms, a third of a frame."""
    noise = np.random.default_rng(2)
    drop = observe(ball_engine(1e6, 200.0), np.zeros(6), frames=120, noise=noise)
    buoyancy = Parameter.model(
        "body_gravcomp", "body", start=0.01, bounds=(-0.1, 0.1), transform="linear", name="buoyancy"
    )
    problem = Problem(
        ball_engine(),
        [*ball_parameters((8e5, 220.0, 0.3))[:2], buoyancy],
        [drop],
        position_sigma=1e-4,
        rotation_sigma=math.inf,
    )
    return fit(problem, starts=0)


def test_bounces_tell_damping_over_the_root_of_stiffness(bounces):
    """Restitution is a function of d / sqrt(k m) alone; the time of contact is short."""
    best, other = bounces.combinations
    assert best.exponents["damping"] == 1.0
    assert best.exponents["stiffness"] == pytest.approx(-0.5, abs=0.02)
    truth = 200.0 * 1e6 ** best.exponents["stiffness"]
    assert best.value == pytest.approx(truth, rel=3 * best.relative_error)
    assert best.relative_error < 0.1 * other.relative_error
    assert str(best).startswith("damping · stiffness^-0.")
    assert str(best).endswith(" %")


def test_the_result_as_a_dictionary_has_the_combinations(bounces):
    written = json.loads(json.dumps(bounces.to_dict()))["combinations"]
    assert [set(c["exponents"]) for c in written] == [{"stiffness", "damping"}] * 2
    assert written[0]["relative_error"] == bounces.combinations[0].relative_error


def test_what_the_residuals_do_not_depend_on_is_in_no_combination():
    drop = observe(ball_engine(), np.zeros(6), frames=30, noise=np.random.default_rng(1))
    problem = Problem(
        ball_engine(),
        ball_parameters((8e3, 25.0, 0.3)),
        [drop],
        position_sigma=1e-4,
        rotation_sigma=math.inf,
    )
    result = fit(problem, starts=0, max_evaluations=100)
    assert not math.isfinite(result["sliding_friction"].standard_error)
    assert [set(c.exponents) for c in result.combinations] == [{"stiffness", "damping"}] * 2


def test_the_figure_shows_the_residuals_of_what_was_measured(bounces, tmp_path):
    file = tmp_path / "fit.png"
    figure = bounces.plot(file)
    assert file.stat().st_size > 1000
    over_time, distribution, correlation = figure.axes
    time, size = over_time.lines[0].get_data()
    np.testing.assert_array_equal(time, bounces.problem.trajectories[0].time)
    positions = bounces.residuals[0][:, 0, :3]
    np.testing.assert_allclose(size, np.sqrt((positions**2).mean(axis=1)))
    # A density: its bars hold all residuals.
    area = sum(bar.get_width() * bar.get_height() for bar in distribution.patches)
    assert area == pytest.approx(1.0)
    np.testing.assert_array_equal(correlation.images[0].get_array(), bounces.correlation)


def test_the_figure_has_a_line_for_each_trajectory_up_to_the_window():
    throws = [
        observe(ball_engine(), speed * np.asarray(SIDEWAYS), name=f"{speed}") for speed in (1, 0.5)
    ]
    problem = Problem(
        ball_engine(),
        ball_parameters((9e3, 22.0, 0.3)),
        throws,
        position_sigma=1e-4,
        rotation_sigma=1e-3,
        window=0.2,
    )
    result = fit(problem, starts=0, max_evaluations=20)
    lines = result.plot().axes[0].lines[:-1]
    assert len(lines) == 2
    for line in lines:
        assert line.get_xdata()[-1] == pytest.approx(0.2)
