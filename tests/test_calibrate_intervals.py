"""Calibration: intervals, and what the data identify."""

import json
import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy import stats

import dashpot
from ball_throws import FALL, IDENTITY, SIDEWAYS, ball_engine, ball_parameters, observe
from dashpot.calibrate import Parameter, Problem, Trajectory, fit
from dashpot.calibrate.inference.at_bounds import leaders
from dashpot.calibrate.inference.identifiability import Evidence, judge
from dashpot.calibrate.inference.intervals import covariance
from dashpot.calibrate.inference.misfit_report import ChannelReport


def test_covariance_of_a_straight_line_is_the_closed_form():
    rng = np.random.default_rng(2)
    x = rng.uniform(0.0, 3.0, 40)
    y = 1.0 + 2.0 * x + 0.1 * rng.normal(size=40)
    design = np.stack([np.ones(40), x], axis=1)
    estimate = np.linalg.lstsq(design, y, rcond=None)[0]
    residuals = design @ estimate - y
    result = covariance(design, residuals)
    s2 = residuals @ residuals / 38
    sxx = np.sum((x - x.mean()) ** 2)
    expected = np.sqrt([s2 * (1 / 40 + x.mean() ** 2 / sxx), s2 / sxx])
    np.testing.assert_allclose(result.standard_error, expected, rtol=1e-12)
    correlation = -x.mean() / np.sqrt(np.mean(x**2))
    assert result.correlation[0, 1] == pytest.approx(correlation, rel=1e-12)
    factor = stats.t.ppf(0.975, 38)
    np.testing.assert_allclose(result.half_width(0.95), factor * expected, rtol=1e-12)


def test_clustered_covariance_of_a_mean_is_that_of_cluster_means():
    """With equal clusters the standard error of a mean is that of the cluster means."""
    rng = np.random.default_rng(3)
    values = rng.normal(size=(12, 1)) + 0.1 * rng.normal(size=(12, 5))
    residuals = (values.mean() - values).ravel()
    offsets = 5 * np.arange(13)
    result = covariance(np.ones((60, 1)), residuals, offsets=offsets)
    expected = values.mean(axis=1).std(ddof=1) / np.sqrt(12)
    assert result.standard_error[0] == pytest.approx(expected, rel=1e-12)
    assert result.degrees_of_freedom == 11
    # Treating the residuals as independent would claim about sqrt(5) times too much.
    assert covariance(np.ones((60, 1)), residuals).standard_error[0] < 0.6 * expected


def test_undetermined_directions_have_infinite_variance():
    rng = np.random.default_rng(4)
    a, b = rng.normal(size=(2, 20))
    jacobian = np.stack([a, b, b, np.zeros(20)], axis=1)
    error = covariance(jacobian, rng.normal(size=20)).standard_error
    assert np.isfinite(error).tolist() == [True, False, False, False]


def test_interval_of_a_linear_problem_is_the_closed_form():
    """Sideways gravity: positions are linear in it, so the whole fit has a closed form."""
    model = mujoco.MjModel.from_xml_string(FALL)
    rng = np.random.default_rng(5)
    n, true, sigma = 50, 0.7, 1e-3
    k = np.arange(n)
    sensitivity = 0.01**2 * k * (k + 1) / 2  # semi-implicit Euler from rest
    position = np.zeros((n, 3))
    position[:, 0] = true * sensitivity
    position[:, 2] = 1.0 - 9.81 * sensitivity
    position += sigma * rng.normal(size=(n, 3))
    trajectory = Trajectory(
        "fall", 0.01 * k, position, np.tile(IDENTITY, (n, 1)), ("body",),
        initial_qpos=[0, 0, 1, *IDENTITY], initial_qvel=np.zeros(6),
    )  # fmt: skip

    def sideways(system, value):
        system.opt.gravity[0] = value

    parameter = Parameter(
        "gravity", start=-1.0, bounds=(-3.0, 3.0), transform="linear", apply=sideways
    )
    result = fit(Problem(model, [parameter], [trajectory], sigma, 1.0))
    a, x = sensitivity / sigma, position[:, 0] / sigma
    estimate = a @ x / (a @ a)
    residuals = np.concatenate(
        [a * estimate - x, position[:, 1] / sigma,
         (position[:, 2] - 1.0 + 9.81 * sensitivity) / sigma]
    )  # fmt: skip
    degrees = 3 * n - 1  # rotations are exact: they say nothing about the noise
    error = np.sqrt(residuals @ residuals / degrees / (a @ a))
    half = stats.t.ppf(0.975, degrees) * error
    # The problem is linear: only rounding and the optimiser's tolerance (1e-8) remain.
    assert result["gravity"].value == pytest.approx(estimate, rel=1e-7)
    assert result["gravity"].standard_error == pytest.approx(error, rel=1e-7)
    assert result["gravity"].upper - result["gravity"].value == pytest.approx(half, rel=1e-6)
    assert result["gravity"].identified
    assert result.cost == pytest.approx(0.5 * residuals @ residuals, rel=1e-9)


def channel(name="load", *, misfit=True, size=1.0, left_over=0.02):
    return ChannelReport(name, size, 400, 0.62, 9.0, misfit, left_over)


def statement(
    z, half_width, transform="log", correlation=(1.0, 0.0), standard_error=None, **options
):
    parameter = Parameter("k", start=10.0, bounds=(1.0, 1000.0), transform=transform)
    error = half_width / 1.96 if standard_error is None else standard_error
    return judge(
        Evidence(
            parameter=parameter,
            z=z,
            standard_error=error,
            interval=(z - half_width, z + half_width),
            correlation=np.array(correlation),
            names=("k", "d"),
            **{"confidence": 0.95, **options},
        )
    )


def test_statements():
    good = statement(math.log(30.0), 0.01)
    assert good.identified
    assert good.statement.startswith("identified: 95% interval 29.7 to 30.3")
    assert (good.lower, good.upper) == pytest.approx((30 * math.exp(-0.01), 30 * math.exp(0.01)))
    for estimate, reason in (
        (statement(math.log(30.0), 0.7), "more than a factor of 4"),
        (statement(math.log(30.0), 4.0), "covers 100% of the allowed range"),
        (statement(math.log(1.0), 0.01), "lies at its lower bound 1"),
        (statement(math.log(1000.0), 0.01), "lies at its upper bound 1000"),
        (statement(0.5, 0.3, transform="linear"), "covers 60% of the allowed range"),
        (statement(math.log(1.5), 0.5), "it is at most 2.473; its 95% interval reaches the lower"),
        (statement(math.log(900.0), 0.2), "at least 736.9; its 95% interval reaches the upper"),
        (statement(math.log(150.0), 3.0), "at least 7.468; its 95% interval reaches the upper"),
        (statement(1.0, math.inf, standard_error=math.inf), "does not depend on it"),
    ):
        assert not estimate.identified
        assert reason in estimate.statement
        assert 1.0 <= estimate.lower <= estimate.value <= estimate.upper <= 1000.0
    both = statement(math.log(30.0), 0.01, correlation=(1.0, -0.97))
    assert both.identified
    assert "correlated -0.97 with d" in both.statement


def test_an_interval_that_a_bound_ends_is_told_by_its_other_end():
    """Ends of the value times e^-0.5 and e^0.5, cut at 1 and 1000."""
    for value, told in ((1.5, "at most 2.473"), (900.0, "at least 545.9"), (30.0, "18.2 – 49.46")):
        assert statement(math.log(value), 0.5).interval == told
    unknown = statement(1.0, math.inf, standard_error=math.inf)
    assert unknown.at_bounds == (True, True)
    assert unknown.interval == "1 – 1000"


@pytest.mark.parametrize(
    ("value", "reason"),
    [(0.985, None), (0.9899, "upper bound 0.99"), (0.0101, "lower bound 0.01"), (0.02, None)],
)
def test_a_logit_parameter_is_at_its_bound_within_a_thousandth_of_the_range(value, reason):
    parameter = Parameter.material("ball", "restitution", start=0.5, bounds=(0.01, 0.99))
    z = parameter.coordinate.to_search(value)
    found = judge(
        Evidence(
            parameter=parameter,
            z=z,
            standard_error=5e-3,
            interval=(z - 0.01, z + 0.01),
            correlation=np.ones(1),
            names=("restitution",),
            confidence=0.95,
        )
    )
    assert found.identified == (reason is None)
    assert reason is None or f"the estimate lies at its {reason}" in found.statement


def test_what_goes_along_with_a_parameter_at_a_bound_is_not_identified():
    """With both of two at bounds, of which each alone explains half of its variance."""
    names = "abcd"
    parameters = [Parameter(n, start=10.0, bounds=(1.0, 1000.0), transform="log") for n in names]
    point = np.log([30.0, 1.0, 1000.0, 50.0])
    half = 0.7
    correlation = np.array(
        [[1.0, half, -half, 0.1], [half, 1, 0, 0], [-half, 0, 1, 0.9], [0.1, 0, 0.9, 1]]
    )
    assert leaders(parameters, point, correlation) == ("b", None, None, None)
    assert leaders(parameters, np.log([30.0, 1.0, 100.0, 50.0]), correlation) == (None,) * 4
    led = statement(math.log(30.0), 0.01, leader="d")
    assert not led.identified
    assert led.statement == "not identified: it goes along with d, whose estimate lies at a bound"


@pytest.mark.parametrize(("end", "seed"), [(3.0, 2), (30.0, 1)])
def test_a_valley_that_ends_at_a_bound_identifies_nothing(end, seed):
    """Stiffness, damping and mass of a ball that drops: all larger by a factor move it alike."""
    engine = ball_engine()
    trajectory = observe(engine, np.zeros(6), frames=80, noise=np.random.default_rng(seed))
    # The search starts where the valley meets a bound of the mass; 1 kg is the truth.
    factor = end * (1.0 + 1e-6 if end == 3.0 else 1.0 - 1e-6)
    mass = Parameter.model("body_mass", "body", start=factor, bounds=(3.0, 30.0))
    starts = [replace(p, start=p.start * factor) for p in ball_parameters((1e4, 20.0, 0.3))[:2]]
    result = fit(Problem(engine, [*starts, mass], [trajectory], 1e-4, 1e-3), starts=0)
    assert result.noise_explains
    assert "lies at its" in result["body_mass"].statement
    for name, value in (("stiffness", 1e4), ("damping", 20.0), ("body_mass", 1.0)):
        assert not result[name].identified
        # As far as bounds allow, intervals reach over the valley.
        assert result[name].lower < 5.0 * value
        assert result[name].upper > 25.0 * value


@pytest.mark.parametrize(
    ("options", "also"),
    [
        ({"standard_error": math.inf}, None),
        ({"unfinished": "the search ended before it converged (why)"}, "ended before it converged"),
        ({"channels": (channel(left_over=0.4),)}, "are 40% of what it shows"),
    ],
)
def test_an_estimate_at_a_bound_always_names_it(options, also):
    found = statement(math.log(1000.0), 0.01, **options)
    assert not found.identified
    start = "not identified: the estimate lies at its upper bound 1000"
    assert found.statement.startswith(start)
    assert "does not depend" not in found.statement
    assert found.statement == start if also is None else also in found.statement


def test_statements_have_the_digits_that_they_need():
    good = statement(math.log(30.0), 1e-7)
    assert good.statement == "identified: 95% interval 29.999997 to 30.000003"
    narrow = statement(math.log(30.0), 3e-4).statement
    assert narrow == "identified: 95% interval 29.991 to 30.009"
    sure = statement(math.log(30.0), 0.01, standard_error=1e-3, confidence=0.999).statement
    assert sure.startswith("identified: 99.9% interval")
    exact = statement(math.log(30.0), 0.0).statement
    assert exact == "identified: 95% interval 30 to 30"


def test_estimates_in_the_table_have_the_digits_of_their_interval():
    engine = ball_engine()
    trajectory = observe(engine, SIDEWAYS, noise=np.random.default_rng(6))
    result = fit(Problem(engine, ball_parameters(), [trajectory], 1e-4, 1e-3))
    narrow = replace(result["stiffness"], value=0.24994, lower=0.249902, upper=0.249978)
    table = str(replace(result, estimates=(narrow, *result.estimates[1:])))
    assert "0.24994 " in table
    assert "0.249902 – 0.249978" in table


def test_a_misfit_widens_what_it_does_not_disown():
    """Unless residuals are more than a tenth of what a channel shows, and errors not clustered."""
    within = statement(math.log(30.0), 0.01, channels=(channel(),), widening=2.31)
    assert within.identified
    assert within.grade == "within misfit"
    assert within.widening == 2.31
    assert within.statement.startswith("identified within the misfit: 95% interval 29.7 to 30.3, ")
    assert "2.3 times as wide as noise alone" in within.statement
    assert "residuals of load (correlation 0.62) hang together in time" in within.statement
    lost = statement(math.log(30.0), 0.01, channels=(channel(left_over=0.3),))
    assert not lost.identified
    assert "residuals of load (correlation 0.62) are 30% of what it shows" in lost.statement
    clustered = statement(math.log(30.0), 0.01, channels=(channel(left_over=0.3),), clustered=True)
    assert clustered.grade == "within misfit"
    assert "of how trajectories differ" in clustered.statement


def test_noise_of_another_size_is_said_by_how_much():
    same = [channel(misfit=False, size=3.0), channel("place", misfit=False, size=3.0)]
    found = statement(math.log(30.0), 0.01, channels=same, size=3.0)
    assert found.grade == "identified"
    assert found.statement.endswith("noise is not as stated, but 3 times as large")
    apart = [channel(misfit=False, size=3.0), channel("place", misfit=False, size=0.5)]
    found = statement(math.log(30.0), 0.01, channels=apart, size=2.2)
    assert found.statement.endswith("3 times as large of load, 0.5 times as large of place")


def test_a_rough_interval_says_so():
    smooth = statement(math.log(30.0), 0.01, nonlinearity=0.2)
    rough = statement(math.log(30.0), 0.01, nonlinearity=1.7)
    assert "rough" not in smooth.statement
    assert "the roughness of the cost" in rough.statement
    assert (smooth.nonlinearity, rough.nonlinearity) == (0.2, 1.7)


def test_an_inert_parameter_is_not_identified():
    """Torsional friction of a sphere with condim 3 has no effect on anything."""
    engine = ball_engine()
    trajectory = observe(engine, SIDEWAYS, noise=np.random.default_rng(6))
    inert = Parameter.material("ball", "torsional_friction", start=0.01, bounds=(1e-4, 1.0))
    result = fit(Problem(engine, [*ball_parameters(), inert], [trajectory], 1e-4, 1e-3))
    assert not result["torsional_friction"].identified
    assert "does not depend on it" in result["torsional_friction"].statement
    assert (result["torsional_friction"].lower, result["torsional_friction"].upper) == (1e-4, 1.0)
    for name in ("stiffness", "damping", "sliding_friction"):
        assert result[name].identified


def test_two_parameters_of_one_effect_are_not_identified():
    """Two springs in series: only the sum of the compliances is seen."""
    engine = ball_engine(2e4)
    engine.set_material("floor", dashpot.Material(2e4, damping=0.0, friction=0.0))
    rules = [("ball", "ball stiffness"), ("floor", "floor stiffness")]
    parameters = [
        Parameter.material(geom, "stiffness", start=1e4, bounds=(1e3, 1e6), name=name)
        for geom, name in rules
    ]
    for geom in ("ball", "floor"):
        engine.set_material(geom, replace(engine.material(geom), damping=None, restitution=0.8))
    trajectory = observe(engine, SIDEWAYS, noise=np.random.default_rng(7))
    result = fit(Problem(engine, parameters, [trajectory], 1e-4, 1e-3))
    assert not any(estimate.identified for estimate in result.estimates)


@pytest.mark.parametrize("method", ["least_squares", "cma", "cma+least_squares"])
def test_a_window_before_the_first_contact_identifies_nothing(method):
    engine = ball_engine()
    trajectory = observe(engine, SIDEWAYS, noise=np.random.default_rng(6))
    # 0.1 m above the floor at 1 m/s: contact comes after 0.07 s.
    problem = Problem(engine, ball_parameters(), [trajectory], 1e-4, 1e-3, window=0.03)
    result = fit(problem, method=method)
    for estimate, parameter in zip(result.estimates, problem.parameters, strict=True):
        assert not estimate.identified
        assert "does not depend on it" in estimate.statement
        assert (estimate.lower, estimate.upper) == parameter.bounds
        assert estimate.standard_error == math.inf
        if method == "least_squares":
            assert estimate.value == pytest.approx(parameter.start, rel=1e-12)
    assert result.noise_explains
    stored = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert stored["estimates"][0]["standard_error"] is None


@pytest.mark.parametrize("method", ["least_squares", "cma"])
def test_a_search_that_has_not_converged_identifies_nothing(method):
    engine = ball_engine()
    trajectory = observe(engine, SIDEWAYS, noise=np.random.default_rng(6))
    problem = Problem(engine, ball_parameters(), [trajectory], 1e-4, 1e-3)
    assert all(estimate.identified for estimate in fit(problem).estimates)
    result = fit(problem, method=method, max_evaluations=30)
    assert not result.converged
    # Small budgets stay small: no points are drawn around an end that is no minimum (42 would be).
    assert result.evaluations <= 30 + 6
    for estimate in result.estimates:
        assert estimate.nonlinearity == 0.0
        assert not estimate.identified
        assert "it converged (max_evaluations = 30 is spent; what would" in estimate.statement
    assert "not converged: max_evaluations = 30 is spent" in str(result.table().caption)
