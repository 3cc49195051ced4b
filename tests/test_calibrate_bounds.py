"""Calibration: estimates that end at a bound."""

import math

import numpy as np
import pytest

import dashpot
from ball_throws import SIDEWAYS, ball_engine, observe
from dashpot.calibrate import Parameter, Problem, fit
from dashpot.calibrate.problem.transforms import Transform


def restitution_engine(restitution):
    engine = ball_engine()
    engine.set_material("ball", dashpot.Material(1e4, restitution=restitution, friction=0.3))
    return engine


@pytest.mark.parametrize("bounds", [(0.0, 1.0), (0.01, 0.69)])
def test_a_logit_reaches_its_bounds_where_it_still_moves(bounds):
    transform = Transform("logit", *bounds)
    ends = transform.search_bounds
    assert ends == pytest.approx((-math.log(10001.0), math.log(10001.0)), rel=1e-12)
    for z, bound, inwards in zip(ends, bounds, (1e-3, -1e-3), strict=True):
        assert transform.to_value(z) == bound
        inside = transform.to_value(z + inwards)
        moved = (bounds[1] - bounds[0]) * 1e-4 * 1e-3
        # The slope changes by a thousandth over the step.
        assert abs(inside - bound) == pytest.approx(moved, rel=2e-3)
        assert transform.slope(z) == pytest.approx(1e3 * moved, rel=2e-3)


@pytest.mark.parametrize(("seed", "initial_state"), [(0, "given"), (1, "pose_and_velocity")])
def test_a_restitution_beyond_its_bound_ends_there(seed, initial_state):
    engine = restitution_engine(0.7)
    rng = np.random.default_rng(seed)
    throws = [observe(engine, SIDEWAYS, noise=rng, name=f"throw {i}") for i in range(2)]
    unknown = Parameter.material("ball", "restitution", start=0.5, bounds=(0.01, 0.69))
    # Noise is said to be larger than it is, so that it explains what the bound leaves.
    problem = Problem(engine, [unknown], throws, 3e-3, 3e-2, initial_state=initial_state)
    found = fit(problem)["restitution"]
    assert found.value == pytest.approx(0.69, abs=1e-4)
    assert found.upper == 0.69
    assert not found.identified
    assert found.statement == "not identified: the estimate lies at its upper bound 0.69"
