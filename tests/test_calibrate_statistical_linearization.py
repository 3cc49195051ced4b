"""Intervals where the cost is rough: linear models over the region of the interval."""

import math

import numpy as np
import pytest
from scipy import optimize

from dashpot.calibrate.inference.intervals import covariance
from dashpot.calibrate.inference.statistical_linearization import linearize, over_its_region
from dashpot.calibrate.residuals.arrow import ArrowMatrix


class Residuals:
    """A stand-in for the objective of a problem: residuals by a function, one trajectory."""

    def __init__(self, function, parameters, bound=np.inf):
        self.parameters, self.initial_size, self._function = parameters, 0, function
        self.free_states = np.arange(0)
        self.residual_count = function(np.zeros(parameters)).size
        self.offsets = np.array([0, self.residual_count])
        self._bound = bound

    def residuals(self, points):
        return np.array([self._function(point) for point in points])

    def bounds(self):
        return np.full(self.parameters, -self._bound), np.full(self.parameters, self._bound)

    def differences(self):
        return np.full(self.parameters, 1e-6)


def test_of_quadratic_residuals_the_jacobian_is_exact():
    """Pairs of opposite points take even terms out; what is left of them is in the centre."""
    rng = np.random.default_rng(0)
    a, q = rng.normal(size=(2, 30, 2))
    quadratic = Residuals(lambda x: 1.0 + a @ x + q @ x**2, 2)
    region = np.array([[0.04, 0.01], [0.01, 0.09]])
    model = linearize(quadratic, np.array([0.3, -0.2]), region[None], rng)
    exact = a + 2 * q * np.array([0.3, -0.2])
    np.testing.assert_allclose(model.jacobian.dense(), exact, rtol=1e-10, atol=1e-12)
    # The mean of twelve squares is the variance, with a standard deviation of 41 % of it.
    moved = model.center - quadratic.residuals(np.array([[0.3, -0.2]]))[0]
    coefficients = np.linalg.lstsq(q, moved, rcond=None)[0]
    np.testing.assert_allclose(coefficients, [0.04, 0.09], rtol=0.8)


def test_points_that_meet_a_bound_keep_the_jacobian_exact():
    rng = np.random.default_rng(1)
    a = rng.normal(size=(20, 2))
    linear = Residuals(lambda x: a @ x, 2, bound=0.5)
    model = linearize(linear, np.array([0.45, 0.0]), 0.1 * np.eye(2)[None], rng)
    np.testing.assert_allclose(model.jacobian.dense(), a, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(model.center, a @ [0.45, 0.0], atol=1e-12)
    np.testing.assert_allclose(model.scatter, 0.0, atol=1e-12)


@pytest.mark.parametrize("place", [0.5, -0.5])
def test_what_moves_together_does_so_at_a_bound(place):
    """Residuals depend on the difference of two alone, not linearly."""
    rng = np.random.default_rng(3)
    a, q = rng.normal(size=(2, 30))
    valley = Residuals(lambda x: a * (x[0] - x[1]) + q * (x[0] - x[1]) ** 2, 2, bound=0.5)
    region = 0.04 * np.ones((2, 2)) + 1e-6 * np.eye(2)
    point = np.array([place, place])
    model = linearize(valley, point, region[None], rng)
    # Draws off the valley have a standard deviation of 0.0014.
    jacobian = model.jacobian.dense()
    np.testing.assert_allclose(jacobian, np.stack([a, -a], axis=1), atol=1e-9)


def test_unknowns_outside_the_region_stay():
    rng = np.random.default_rng(2)
    seen = []
    residuals = Residuals(lambda x: (seen.append(x[1]), np.arange(5.0) * x[0])[1], 2)
    model = linearize(residuals, np.array([0.0, 7.0]), np.diag([0.01, 0.0])[None], rng)
    assert set(seen[1:]) == {7.0}
    np.testing.assert_allclose(
        model.jacobian.dense(), np.stack([np.arange(5.0), np.zeros(5)], axis=1)
    )


# A straight line through the origin with noise of 1, and waves whose slope is three times the
# line's own but which move the residuals by less than a sixth of the noise, as impacts do.
SLOPE = np.linspace(0.5, 1.5, 50)
WAVE = 0.15


def rough(observed, x):
    return (
        SLOPE * x[0] + WAVE * np.sin(3.0 * SLOPE * x[0] / WAVE + 7.0 * np.arange(50.0)) - observed
    )


def local_jacobian(x):
    phase = 3.0 * SLOPE * x[0] / WAVE + 7.0 * np.arange(50.0)
    return (SLOPE * (1.0 + 3.0 * np.cos(phase)))[:, None]


def estimate(seed):
    """Return the least of all valleys, and the residuals there, of data with the truth 0.4."""
    rng = np.random.default_rng(seed)
    observed = rough(np.zeros(50), [0.4]) + rng.normal(size=50)
    starts = np.linspace(-0.1, 0.9, 401)
    costs = np.sum(rough(observed, starts[None, :, None]) ** 2, axis=-1)
    start = starts[[np.argmin(costs)]]
    best = optimize.least_squares(lambda x: rough(observed, x), start, jac=local_jacobian)
    return best.x, best.fun, observed


def test_intervals_of_a_rough_cost_cover_the_truth():
    """Local derivatives give intervals a third as wide; those over the region cover."""
    covered = {"local": 0, "region": 0}
    widths = []
    count = 60
    for seed in range(count):
        x, residuals, observed = estimate(seed)
        objective = Residuals(lambda x, observed=observed: rough(observed, x), 1)
        local = covariance(local_jacobian(x), residuals)
        region, departure = over_its_region(
            objective,
            x,
            ArrowMatrix.of_dense(local_jacobian(x)),
            lambda j, hold, r=residuals: covariance(j, r, hold=hold),
            None,
            seed,
        )
        assert departure[0] >= 0.0
        for name, estimated in (("local", local), ("region", region)):
            covered[name] += abs(x[0] - 0.4) < estimated.half_width(0.95)[0]
        widths.append(region.standard_error[0])
    # Binomial: a correct interval covers fewer than 51 of 60 once in 2,000.
    assert covered["region"] >= 51
    assert covered["local"] < 42
    # And they are no wider than need be: noise over the line's slope, a third for the waves.
    assert np.median(widths) < 1.5 / math.sqrt(SLOPE @ SLOPE)


def test_of_linear_residuals_the_covariance_is_the_local_one():
    rng = np.random.default_rng(5)
    a = rng.normal(size=(40, 3))
    observed = rng.normal(size=40)
    x = np.linalg.lstsq(a, observed, rcond=None)[0]
    linear = Residuals(lambda x: a @ x - observed, 3)
    residuals = a @ x - observed
    local = covariance(a, residuals)
    region, departure = over_its_region(
        linear, x, ArrowMatrix.of_dense(a), lambda j, hold: covariance(j, residuals), None, 0
    )
    np.testing.assert_allclose(region.matrix, local.matrix, rtol=1e-9)
    np.testing.assert_allclose(departure, 0.0, atol=1e-6)


def test_what_data_hardly_determine_of_a_start_stays_near():
    """Of two velocities the sum is known, the difference to a million standard deviations.

    Far off nothing depends on the parameter.
    """
    rng = np.random.default_rng(7)
    a, b, c = rng.normal(size=(3, 40))

    class Start(Residuals):
        def __init__(self):
            super().__init__(lambda _: np.zeros(40), 1)
            self.initial_size, self.free_states = 2, np.arange(2)

        def residuals(self, points):
            p, u, v = points.T
            near = np.exp(-0.01 * (u**2 + v**2))
            return (
                (near * p)[:, None] * a + (u + v)[:, None] * b + 1e-6 * (u - v)[:, None] * c
            ) / 0.1 + noise

        def bounds(self):
            return np.full(3, -np.inf), np.full(3, np.inf)

        def differences(self):
            return np.full(3, 1e-6)

    columns = np.stack([a, b + 1e-6 * c, b - 1e-6 * c], axis=1) / 0.1
    noise = rng.normal(size=40)
    noise -= columns @ np.linalg.lstsq(columns, noise, rcond=None)[0]
    jacobian = ArrowMatrix(columns[:, :1], columns[:, 1:], np.array([0, 40]))

    local = covariance(jacobian, noise)
    assert local.standard_error[1] > 1e3
    region, _ = over_its_region(
        Start(), np.zeros(3), jacobian, lambda j, hold: covariance(j, noise, hold=hold), None, 0
    )
    assert region.standard_error[0] == pytest.approx(local.standard_error[0], rel=0.1)


def test_a_region_in_which_simulations_fail_is_narrowed():
    a = np.linspace(1.0, 2.0, 30)

    def residuals(x):
        if abs(x[0]) > 0.01:
            raise ValueError("too far")
        return a * x[0]

    noise = np.random.default_rng(6).normal(size=30)
    noise -= a * (a @ noise) / (a @ a)
    local = covariance(a[:, None], noise)
    region, _ = over_its_region(
        Residuals(residuals, 1),
        np.zeros(1),
        ArrowMatrix.of_dense(a[:, None]),
        lambda j, hold: covariance(j, noise),
        None,
        0,
    )
    np.testing.assert_allclose(region.matrix, local.matrix, rtol=1e-9)


def test_a_failure_at_the_point_itself_is_raised():
    def residuals(x):
        if x[0] != 0.0:
            raise ValueError("nothing works")
        return np.ones(9)

    with pytest.raises(ValueError, match="nothing works"):
        over_its_region(
            Residuals(residuals, 1), np.zeros(1), ArrowMatrix.of_dense(np.arange(9.0)[:, None]),
            lambda j, hold: covariance(j, np.ones(9)), None, 0,
        )  # fmt: skip
