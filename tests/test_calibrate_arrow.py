"""Block-arrow Jacobians: inverses, covariances and searches as of the same matrices in full."""

import numpy as np
import pytest
from scipy import optimize

from ball_throws import ball_engine, ball_parameters, observe
from dashpot.calibrate import Problem, fit
from dashpot.calibrate.inference.intervals import covariance
from dashpot.calibrate.residuals.arrow import ArrowInverse, ArrowMatrix
from dashpot.calibrate.residuals.losses import Loss
from dashpot.calibrate.residuals.objective import Objective
from dashpot.calibrate.search.trust_region import minimise

# Trajectories of different lengths, three parameters, two unknowns of each initial state.
OFFSETS = np.array([0, 7, 12, 30, 41])
COUNT, SIZE = 3, 2
# Units far apart, as of a stiffness in the log and a displacement.
UNITS = np.array([1.0, 1e3, 1e-2])


def arrow(seed=0):
    rng = np.random.default_rng(seed)
    shared = rng.normal(size=(OFFSETS[-1], COUNT)) * UNITS
    return ArrowMatrix(shared, rng.normal(size=(OFFSETS[-1], SIZE)) * [1.0, 1e4], OFFSETS)


def columns_of(trajectory):
    """Where the parameters and the state of a trajectory are among all unknowns."""
    own = COUNT + SIZE * trajectory
    return np.concatenate([np.arange(COUNT), np.arange(own, own + SIZE)])


def test_an_arrow_is_the_matrix_in_full():
    matrix = arrow()
    dense = matrix.dense()
    assert dense.shape == (41, matrix.size) == (41, 11)
    assert np.count_nonzero(dense) == 41 * (COUNT + SIZE)
    vectors = np.random.default_rng(1).normal(size=(4, 11))
    np.testing.assert_allclose(matrix.apply(vectors), vectors @ dense.T, rtol=1e-12)
    norms = np.linalg.norm(dense, axis=0)
    np.testing.assert_allclose(matrix.column_norms(), norms, rtol=1e-12)
    kept = np.arange(41) % 3 > 0
    np.testing.assert_array_equal(matrix.select(kept).dense()[kept], dense[kept])
    assert not matrix.select(kept).dense()[~kept].any()


def test_its_inverse_is_that_in_full():
    matrix = arrow()
    inverse = ArrowInverse(matrix, 1e-10)
    assert inverse.rank == 11
    assert inverse.determined.all()
    vectors = np.random.default_rng(1).normal(size=(5, 41))
    exact = np.linalg.lstsq(matrix.dense(), vectors.T, rcond=None)[0].T
    scale = matrix.column_norms()
    np.testing.assert_allclose(inverse.solve(vectors) * scale, exact * scale, atol=1e-12)


def test_what_an_initial_state_makes_up_for_is_undetermined():
    """Of each trajectory, or of a parameter in all of them."""
    matrix = arrow()
    matrix.own[matrix.rows(1), 1] = 3.0 * matrix.own[matrix.rows(1), 0]
    matrix.own[matrix.rows(2), 0] = 0.0
    inverse = ArrowInverse(matrix, 1e-10)
    unknown = [*columns_of(1)[COUNT:], columns_of(2)[COUNT]]
    assert np.flatnonzero(~inverse.determined).tolist() == unknown
    assert inverse.rank == np.linalg.matrix_rank(matrix.dense() / UNITS.mean()) == 9
    matrix = arrow()
    for t in range(4):
        rows = matrix.rows(t)
        matrix.shared[rows, 1] = (t + 1.0) * matrix.own[rows, 0]
    inverse = ArrowInverse(matrix, 1e-10)
    unknown = [1] + [columns_of(t)[COUNT] for t in range(4)]
    assert np.flatnonzero(~inverse.determined).tolist() == unknown
    assert inverse.rank == 10
    errors = covariance(matrix, np.ones(41)).standard_error
    assert np.flatnonzero(np.isinf(errors)).tolist() == unknown


@pytest.mark.parametrize("loss", ["linear", "soft_l1"])
@pytest.mark.parametrize("clustered", [False, True])
def test_covariances_are_those_in_full(loss, clustered):
    matrix, rng = arrow(), np.random.default_rng(2)
    residuals = rng.normal(size=41)
    live = rng.uniform(size=41) > 0.1
    options = {"loss": Loss(loss), "live": live, "offsets": OFFSETS if clustered else None}
    found = covariance(matrix, residuals, **options)
    full = covariance(matrix.dense(), residuals, **options)
    assert found.degrees_of_freedom == full.degrees_of_freedom
    assert found.residual_variance == pytest.approx(full.residual_variance)
    np.testing.assert_allclose(found.standard_error, full.standard_error, rtol=1e-9)
    for t, block in enumerate(found.blocks):
        columns = columns_of(t)
        exact = full.matrix[np.ix_(columns, columns)]
        scale = np.sqrt(np.diag(exact))
        np.testing.assert_allclose(block / scale / scale[:, None], exact / scale / scale[:, None],
                                   atol=1e-9)  # fmt: skip
    np.testing.assert_allclose(found.correlation, full.correlation[:COUNT, :COUNT], atol=1e-9)


@pytest.mark.parametrize("clustered", [False, True])
def test_states_known_beforehand_are_one_more_residual_each(clustered):
    """``H^-1 s^2`` or ``H^-1 B H^-1``, ``H = J^T J + diag(1 / hold^2)``; idle states stay so."""
    matrix, rng = arrow(), np.random.default_rng(2)
    matrix.own[matrix.rows(2), 1] = 0.0
    residuals, hold = rng.normal(size=41), np.array([0.3, 1e-4])
    options = {"offsets": OFFSETS if clustered else None}
    found = covariance(matrix, residuals, hold=hold, **options)
    assert found.residual_variance == covariance(matrix, residuals, **options).residual_variance
    dense = matrix.dense()
    pull = np.concatenate([np.zeros(COUNT), np.tile(1.0 / hold**2, 4)])
    idle = columns_of(2)[-1]
    pull[idle] = 1.0  # of any size: nothing else depends on it
    inverse = np.linalg.inv(dense.T @ dense + np.diag(pull))
    if clustered:
        moves = np.array([residuals[matrix.rows(t)] @ dense[matrix.rows(t)] for t in range(4)])
        full = 4 / 3 * inverse @ moves.T @ moves @ inverse
    else:
        full = found.residual_variance * inverse
    expected = np.sqrt(np.diag(full))
    expected[idle] = np.inf
    np.testing.assert_allclose(found.standard_error, expected, rtol=1e-8)


class Growth:
    """Curves ``b_t exp(-a time) + c_t + d sin(time)``: a and d shared, b and c of each curve."""

    def __init__(self, seed=0, outliers=0):
        rng = np.random.default_rng(seed)
        self.time = [np.linspace(0.0, 3.0, rng.integers(8, 20)) for _ in range(6)]
        self.offsets = np.concatenate([[0], np.cumsum([t.size for t in self.time])])
        truth = np.concatenate([[0.8, 0.5], rng.uniform(0.5, 1.5, size=12)])
        self.observed = np.zeros(self.offsets[-1])
        self.observed = self.residuals(truth) + 0.01 * rng.normal(size=self.offsets[-1])
        self.observed[:outliers] += 3.0

    def residuals(self, x):
        curves = [
            b * np.exp(-x[0] * t) + c + x[1] * np.sin(t)
            for t, (b, c) in zip(self.time, x[2:].reshape(-1, 2), strict=True)
        ]
        return np.concatenate(curves) - self.observed

    def jacobian(self, x):
        shared, own = [], []
        for t, (b, _) in zip(self.time, x[2:].reshape(-1, 2), strict=True):
            decay = np.exp(-x[0] * t)
            shared.append(np.stack([-b * t * decay, np.sin(t)], axis=1))
            own.append(np.stack([decay, np.ones_like(t)], axis=1))
        return ArrowMatrix(np.concatenate(shared), np.concatenate(own), self.offsets)


START = np.concatenate([[2.0, 0.0], np.ones(12)])
FREE = np.full(2, -np.inf), np.full(2, np.inf)


def search(problem, bounds=FREE, loss="linear", residuals=None, **changes):
    options = {
        "loss": Loss(loss, 0.05),
        "hold": 1e-6,
        "most_evaluations": 100,
        "cost_tolerance": 1e-12,
        "step_tolerance": 1e-12,
    }
    return minimise(
        residuals or problem.residuals, problem.jacobian, START, bounds, **{**options, **changes}
    )


def by_scipy(problem, bounds=FREE, loss="linear"):
    lower, upper = (
        np.append(b, np.full(12, sign * np.inf)) for b, sign in zip(bounds, (-1, 1), strict=True)
    )
    start = np.clip(START, lower + 1e-3, upper - 1e-3)
    return optimize.least_squares(
        problem.residuals, start, lambda x: problem.jacobian(x).dense(), (lower, upper),
        loss=loss, f_scale=0.05, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14,
    )  # fmt: skip


@pytest.mark.parametrize("loss", ["linear", "soft_l1", "cauchy"])
def test_a_minimum_is_the_one_of_the_problem_in_full(loss):
    """Which scipy finds with dense matrices, outliers or not."""
    problem = Growth(outliers=0 if loss == "linear" else 4)
    end = search(problem, loss=loss)
    assert end.converged
    np.testing.assert_allclose(end.point, by_scipy(problem, loss=loss).x, atol=1e-6)
    np.testing.assert_array_equal(end.residuals, problem.residuals(end.point))


@pytest.mark.parametrize(
    "bounds",
    [([1.0, -1.0], [3.0, 1.0]), ([0.1, -1.0], [3.0, 0.3]), ([1.0, -1.0], [3.0, 0.2])],
)
def test_a_minimum_at_a_bound_is_that_of_the_others_there(bounds):
    bounds = np.array(bounds)
    seen = []
    problem = Growth()

    def residuals(x):
        seen.append(x[:2].copy())
        return problem.residuals(x)

    end = search(problem, bounds, residuals=residuals)
    assert end.converged
    assert ((np.array(seen) >= bounds[0]) & (np.array(seen) <= bounds[1])).all()
    assert (end.point[:2] == bounds).any()
    exact = by_scipy(problem, bounds)
    # scipy's method stops short of bounds.
    np.testing.assert_allclose(end.point, exact.x, atol=1e-4)
    assert 0.5 * np.sum(end.residuals**2) <= exact.cost * (1.0 + 1e-9)


@pytest.mark.parametrize(("each", "most"), [(1e-3, 10), (1e-2, 100)])
def test_a_search_that_creeps_on_rough_ground_ends(each, most):
    """Every step lowers the cost by two thirds of what its model says, and the next says as much.

    That of 1e-3 makes less than 0.02 in eight; that of 1e-2 goes on to the last evaluation.
    """
    count = 0

    def residuals(x):
        nonlocal count
        count += 1
        return np.array([np.sqrt(3.0 * each), np.sqrt(2.0 * (30.0 - each * count)), *np.zeros(40)])

    def minimum(level_tolerance):
        nonlocal count
        count = 0
        return minimise(
            residuals, lambda _: ArrowMatrix.of_dense(np.eye(42, 1)), np.zeros(1), ([-99], [99]),
            loss=Loss(), hold=1e-6, most_evaluations=100, cost_tolerance=1e-7,
            step_tolerance=1e-8, level_tolerance=level_tolerance,
        )  # fmt: skip

    assert not minimum(0.0).converged
    assert count == 100
    assert minimum(0.02).converged == (most < 100)
    assert count <= most


VALLEY = np.array([[1.0, 2.0], [0.01, 0.0]])  # along (2, -1), with its minimum at (10, -5)


def valley_end(bound, **options):
    seen = []

    def residuals(x):
        seen.append(x.copy())
        return VALLEY @ x - [0.0, 0.1]

    end = minimise(
        residuals, lambda _: ArrowMatrix.of_dense(VALLEY), np.zeros(2),
        (np.full(2, -bound), np.full(2, bound)), loss=Loss(), hold=1e-9, most_evaluations=100,
        cost_tolerance=1e-12, step_tolerance=1e-12, **options,
    )  # fmt: skip
    return end, np.array(seen)


@pytest.mark.parametrize("bound", [0.5, 1.0, 3.0])
def test_bounds_that_turn_a_long_step_uphill_end_no_search(bound):
    """The full step (10, -5) is beyond both bounds, and their corner is off the valley."""
    end, _ = valley_end(bound)
    assert end.converged
    np.testing.assert_allclose(end.point, [bound, -0.5 * bound], atol=1e-3 * bound)


def test_parameters_move_by_no_more_than_the_longest_step():
    end, seen = valley_end(99.0, longest=1.0)
    assert np.abs(np.diff(seen, axis=0)).max() <= 1.0 + 1e-12
    np.testing.assert_allclose(end.point, [10.0, -5.0], atol=1e-6)


def test_steps_that_fail_are_no_level_ground():
    problem, way = Growth(), 1e-6

    def residuals(x):
        near = abs(x[0] - START[0]) < way
        return problem.residuals(x) if near else np.full(problem.offsets[-1], np.inf)

    end = search(problem, residuals=residuals, level_tolerance=0.02)
    assert abs(end.point[0] - START[0]) > 0.5 * way


def test_steps_to_where_nothing_can_be_simulated_are_taken_back():
    """Here nothing can beyond a short way from the last point: the first full step is 1.2 long."""
    problem, reached, failures = Growth(), [START[0]], []

    def residuals(x):
        if abs(x[0] - reached[-1]) > 0.3:
            failures.append(x[0])
            return np.full(problem.offsets[-1], np.inf)
        reached.append(x[0])
        return problem.residuals(x)

    end = search(problem, residuals=residuals)
    assert failures
    assert end.converged
    np.testing.assert_allclose(end.point, by_scipy(problem).x, atol=1e-6)


def test_what_nothing_depends_on_stays():
    """The weight of the distance from the start holds it, and the rest is found."""
    problem = Growth()

    def jacobian(x):
        matrix = problem.jacobian(x)
        return ArrowMatrix(np.column_stack([matrix.shared, np.zeros(len(matrix.shared))]),
                           matrix.own, matrix.offsets)  # fmt: skip

    def drop(x):
        return np.delete(x, 2)

    end = minimise(
        lambda x: problem.residuals(drop(x)), lambda x: jacobian(drop(x)),
        np.insert(START, 2, 5.0), (np.full(3, -np.inf), np.full(3, np.inf)), loss=Loss(),
        hold=1e-6, most_evaluations=100, cost_tolerance=1e-12, step_tolerance=1e-12,
    )  # fmt: skip
    assert end.point[2] == 5.0
    np.testing.assert_allclose(drop(end.point), by_scipy(problem).x, atol=1e-6)


def test_a_search_ends_with_its_evaluations():
    end = search(Growth(), most_evaluations=3)
    assert not end.converged
    start = search(Growth(), most_evaluations=1)
    np.testing.assert_array_equal(start.point, START)
    assert np.sum(end.residuals**2) < np.sum(start.residuals**2)


def throws(number):
    engine, rng = ball_engine(), np.random.default_rng(3)
    trajectories = []
    for i in range(number):
        velocity = rng.normal(size=6) * [0.7, 0.7, 0.3, 2.0, 2.0, 2.0] - [0, 0, 0.8, 0, 0, 0]
        trajectories.append(observe(engine, velocity, 20, rng, f"throw {i}"))
    parameters = ball_parameters((8e3, 25.0, 0.35))
    return Problem(engine, parameters, trajectories, 1e-4, 1e-3, initial_state="pose_and_velocity")


def test_no_more_is_stored_than_a_trajectory_needs():
    """Of 30 throws the derivatives in full would be 24 times as large."""
    problem = throws(30)
    objective = Objective(problem)
    jacobian = objective.jacobian(objective.start())
    assert jacobian.size == 3 + 30 * 12
    stored = jacobian.shared.size + jacobian.own.size
    assert stored == objective.residual_count * 15
    assert jacobian.dense().size == 24.2 * stored


def test_many_throws_of_unknown_initial_states_recover_the_truth():
    result = fit(throws(20), starts=0)
    assert result.converged
    assert result.noise_explains
    assert result.errors == "clustered"
    for name, value in (("stiffness", 1e4), ("damping", 20.0), ("sliding_friction", 0.3)):
        # 4.5 standard errors: a correct fit fails one of three once in 50,000.
        assert abs(result[name].value - value) < 4.5 * result[name].standard_error
        assert result[name].identified
