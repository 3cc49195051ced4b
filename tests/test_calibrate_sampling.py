"""Calibration: the covariance of a fit, and parameters drawn as likely as it holds them."""

import numpy as np
import pytest
from scipy import special

import dashpot
from ball_throws import SIDEWAYS, ball_engine, ball_parameters, observe
from dashpot.calibrate import Parameter, Problem, fit
from dashpot.calibrate.inference.estimate import Estimate
from dashpot.calibrate.inference.sampling import draw

COUNT = 20_000
# Standard error of a share of COUNT draws is at most 0.0035, of a correlation 0.007: four of them.
SHARE, CORRELATION = 0.014, 0.028


def estimate(parameter, value, lower, upper, error=1.0):
    return Estimate(parameter.name, value, error, lower, upper, identified=True, statement="")


def parameter(name, transform, bounds):
    start = 0.5 * sum(bounds)
    return Parameter(name, start, bounds, transform)


STIFFNESS = parameter("k", "log", (1e2, 1e6))
OFFSET = parameter("x", "linear", (-1.0, 1.0))
SHARE_OF = parameter("e", "logit", (0.0, 1.0))


def drawn(parameters, estimates, correlation, confidence=0.9, seed=3):
    rng = np.random.default_rng(seed)
    return draw(parameters, estimates, np.asarray(correlation), confidence, COUNT, rng)


@pytest.mark.parametrize("confidence", [0.5, 0.95])
@pytest.mark.parametrize(
    ("kind", "value", "lower", "upper"),
    [
        (STIFFNESS, 1e4, 8e3, 2e4),
        (OFFSET, 0.1, 0.05, 0.11),
        (SHARE_OF, 0.9, 0.6, 0.95),
    ],
    ids=["log", "linear", "logit"],
)
def test_the_interval_holds_its_confidence_of_the_draws(kind, value, lower, upper, confidence):
    x = drawn([kind], [estimate(kind, value, lower, upper)], [[1.0]], confidence)[:, 0]
    assert np.mean(x < lower) == pytest.approx(0.5 - 0.5 * confidence, abs=SHARE)
    assert np.mean(x > upper) == pytest.approx(0.5 - 0.5 * confidence, abs=SHARE)
    assert np.mean(x < value) == pytest.approx(0.5, abs=SHARE)
    assert x.min() >= kind.bounds[0]
    assert x.max() <= kind.bounds[1]


def test_draws_hang_together_as_the_estimates_do():
    """Of equal intervals on either side the logarithms are normal: their correlation is exact."""
    damping = parameter("d", "log", (1.0, 1e4))
    estimates = [estimate(STIFFNESS, 1e4, 5e3, 2e4), estimate(damping, 100.0, 80.0, 125.0)]
    k, d = np.log(drawn([STIFFNESS, damping], estimates, [[1.0, -0.9], [-0.9, 1.0]])).T
    assert np.corrcoef(k, d)[0, 1] == pytest.approx(-0.9, abs=CORRELATION)
    width = np.log(2.0) / special.ndtri(0.95)
    assert np.std(k) == pytest.approx(width, rel=0.02)  # a standard error of it is 0.005


def test_what_the_data_say_nothing_of_is_spread_over_its_range():
    estimates = [
        estimate(STIFFNESS, 1e4, 9e3, 1.1e4),
        estimate(OFFSET, 0.9, -1.0, 1.0, error=np.inf),
    ]
    k, x = drawn([STIFFNESS, OFFSET], estimates, np.eye(2)).T
    for quarter in (-0.5, 0.0, 0.5):
        assert np.mean(x < quarter) == pytest.approx(0.5 * (quarter + 1.0), abs=SHARE)
    assert np.corrcoef(k, x)[0, 1] == pytest.approx(0.0, abs=CORRELATION)


def test_parameters_that_go_together_entirely_do_so_in_every_draw():
    """A correlation of 1 is a singular matrix, whose rounding may be negative."""
    other = parameter("m", "log", (1e2, 1e6))
    estimates = [estimate(STIFFNESS, 1e4, 5e3, 2e4), estimate(other, 1e3, 5e2, 2e3)]
    values = drawn([STIFFNESS, other], estimates, [[1.0, 1.0], [1.0, 1.0]])
    np.testing.assert_allclose(values[:, 0], 10.0 * values[:, 1], rtol=1e-6)


@pytest.fixture(scope="module")
def thrown():
    """Fit stiffness and damping of a ball, and what the motion does not depend on."""
    noise = np.random.default_rng(2)
    throw = observe(ball_engine(2e4, 20.0), SIDEWAYS, frames=120, noise=noise)
    nothing = Parameter("colour", 0.5, (0.1, 1.0), apply=lambda system, value: None)
    problem = Problem(
        ball_engine(),
        [*ball_parameters()[:2], nothing],
        [throw],
        position_sigma=1e-4,
        rotation_sigma=1e-3,
    )
    return fit(problem, starts=0)


def test_covariance_is_that_of_standard_errors_and_correlation(thrown):
    error = np.array([e.standard_error for e in thrown.estimates])
    known = np.isfinite(error)
    assert known.tolist() == [True, True, False]
    covariance = thrown.covariance
    expected = thrown.correlation[:2, :2] * np.outer(error[:2], error[:2])
    np.testing.assert_allclose(covariance[:2, :2], expected)
    assert np.isinf(covariance[2]).all()
    assert np.isinf(covariance[:, 2]).all()
    assert covariance[0, 1] != 0.0


def test_samples_are_engines_whose_rollouts_spread_as_far_as_the_fit_leaves_open(thrown):
    samples = thrown.sample(96, seed=1)
    assert samples == thrown.sample(96, seed=1) != thrown.sample(96, seed=2)
    assert {tuple(values) for values in samples} == {tuple(thrown.values)}
    engines = [thrown.problem.build(values) for values in samples]
    best = thrown.problem.build(thrown.values)
    data = best.make_data()
    state = np.r_[0.0, data.qpos, data.qvel]
    states, _ = dashpot.rollout(engines, state, nstep=300)
    (middle,), _ = dashpot.rollout(best, state, nstep=300)
    spread = np.mean((states[:, :, 3] - middle[:, 3]) ** 2)  # of the height, by time and sample
    # Of small errors it is that of the covariance, by the derivatives of the height.
    slopes = []
    for name in ("stiffness", "damping"):
        value = thrown.values[name]
        sides = [
            thrown.problem.build({**thrown.values, name: value * (1 + s)}) for s in (1e-4, -1e-4)
        ]
        (up, down), _ = dashpot.rollout(sides, state, nstep=300)
        slopes.append((up[:, 3] - down[:, 3]) / (2e-4 * value))
    expected = np.mean(np.einsum("it,ij,jt->t", slopes, thrown.covariance[:2, :2], slopes))
    # A sum of squares of 96 draws varies by 14 %: three times that.
    assert spread == pytest.approx(expected, rel=0.43)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"count": 0, "seed": 1}, ValueError, "count must be >= 1"),
        ({"count": 2.0, "seed": 1}, TypeError, "count must be an integer"),
        ({"count": 2, "seed": -1}, ValueError, "seed must be >= 0"),
    ],
)
def test_bad_numbers_of_draws_are_named(thrown, arguments, error, message):
    with pytest.raises(error, match=message):
        thrown.sample(arguments["count"], seed=arguments["seed"])
