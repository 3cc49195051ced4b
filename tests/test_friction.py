"""The return to the elliptic limit surface, against closed forms and its invariances."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dashpot import law

ROUNDING = 8 * np.finfo(float).eps  # up to five squares, a root, a quotient and a product


def surface(impulse, mu):
    """Return sqrt(sum (p_i / mu_i)^2), the normal impulse at which `impulse` is on the surface."""
    impulse, mu = np.asarray(impulse), np.asarray(mu)
    return math.hypot(*(impulse[mu > 0] / mu[mu > 0]))


@st.composite
def trials(draw, positive=False):
    """Trial impulse, coefficients and normal impulse, 1 to 5 directions, over 24 decades.

    Coefficients and normal impulse may be zero unless `positive`.
    """
    directions = draw(st.integers(1, 5))
    size = st.builds(lambda e: 10**e, st.floats(-6, 6))
    signs = st.sampled_from([-1.0, 0.0, 1.0])
    impulse = [draw(signs) * draw(size) for _ in range(directions)]
    limits = size if positive else st.one_of(st.just(0.0), size)
    return np.array(impulse), np.array([draw(limits) for _ in range(directions)]), draw(limits)


every_trial = settings(max_examples=40, deadline=None)


def test_sliding_alone_is_coulomb():
    # 3-4-5 triangle: |p| = 5, mu p_n = 0.5.
    np.testing.assert_allclose(
        law.radial_return([3.0, -4.0], [0.5, 0.5], 1.0), [0.3, -0.4], rtol=ROUNDING
    )


def test_ellipse_with_unequal_axes():
    # On the ray (2, 1) the ellipse of half axes 2 and 1 is met at sqrt(2)/2 of the point.
    np.testing.assert_allclose(
        law.radial_return([2.0, 1.0], [2.0, 1.0], 1.0),
        [2.0 / math.sqrt(2.0), 1.0 / math.sqrt(2.0)],
        rtol=ROUNDING,
    )


def test_five_directions_share_the_surface():
    mu = np.array([0.6, 0.6, 0.01, 1e-3, 1e-3])
    returned = law.radial_return(10.0 * mu, mu, 2.0)
    np.testing.assert_allclose(returned, mu * 2.0 / math.sqrt(5.0), rtol=ROUNDING)


def test_inside_is_unchanged_to_the_bit():
    impulse = np.array([0.1, -0.2, 1e-3])
    assert np.array_equal(law.radial_return(impulse, [1.0, 1.0, 1.0], 1.0), impulse)
    on_surface = law.radial_return([3.0, 4.0], [1.0, 1.0], 5.0)
    assert np.array_equal(on_surface, [3.0, 4.0])


def test_no_normal_impulse_carries_nothing():
    for impulse in ([1.0, 2.0], [1e-200, 1e-300]):
        assert np.array_equal(law.radial_return(impulse, [0.5, 0.5], 0.0), [0.0, 0.0])


def test_direction_without_friction_carries_nothing_and_does_not_limit_the_others():
    returned = law.radial_return([3.0, 4.0, 100.0], [1.0, 1.0, 0.0], 5.0)
    assert np.array_equal(returned, [3.0, 4.0, 0.0])


def test_sizes_whose_squares_leave_the_range_of_double():
    for size in (1e-200, 1e200):
        returned = law.radial_return([3 * size, 4 * size], [1.0, 1.0], size)
        np.testing.assert_allclose(returned, [0.6 * size, 0.8 * size], rtol=ROUNDING)


@every_trial
@given(trials())
def test_result_is_on_or_inside_the_surface(trial):
    impulse, mu, normal = trial
    returned = law.radial_return(impulse, mu, normal)
    assert surface(returned, mu) <= normal * (1 + ROUNDING)
    if surface(impulse, mu) > normal * (1 + ROUNDING):
        assert surface(returned, mu) == pytest.approx(normal, rel=ROUNDING)


@every_trial
@given(trials())
def test_result_lies_on_the_ray_of_the_trial(trial):
    impulse, mu, normal = trial
    returned = law.radial_return(impulse, mu, normal)
    carrying = (mu > 0) & (impulse != 0)
    assert np.all(returned[~carrying] == 0.0)
    assert np.all(np.abs(returned) <= np.abs(impulse))
    if np.any(carrying) and normal > 0:
        factors = returned[carrying] / impulse[carrying]
        np.testing.assert_allclose(factors, factors[0], rtol=ROUNDING)


@every_trial
@given(trials())
def test_return_is_idempotent(trial):
    impulse, mu, normal = trial
    once = law.radial_return(impulse, mu, normal)
    np.testing.assert_allclose(law.radial_return(once, mu, normal), once, rtol=ROUNDING)


@every_trial
@given(trials(), st.randoms(use_true_random=False))
def test_order_of_directions_does_not_matter(trial, random):
    impulse, mu, normal = trial
    order = list(range(len(mu)))
    random.shuffle(order)
    np.testing.assert_allclose(
        law.radial_return(impulse[order], mu[order], normal),
        law.radial_return(impulse, mu, normal)[order],
        rtol=ROUNDING,
    )


@every_trial
@given(trials(), st.floats(0.0, 2 * math.pi))
def test_turning_the_tangent_frame_turns_the_result(trial, angle):
    # Sliding friction is isotropic, so are the two rolling directions.
    impulse, mu, normal = trial
    assume(len(mu) >= 2)
    mu[1] = mu[0]
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])

    def turned(vector):
        return np.concatenate([turn @ vector[:2], vector[2:]])

    returned = law.radial_return(impulse, mu, normal)
    # A component near zero after the turn is only good to rounding of the vector.
    np.testing.assert_allclose(
        law.radial_return(turned(impulse), mu, normal),
        turned(returned),
        rtol=ROUNDING,
        atol=ROUNDING * np.linalg.norm(returned[:2]),
    )


@every_trial
@given(trials(), st.integers(-30, 30))
def test_return_is_homogeneous(trial, power):
    # Exact in floating point for powers of two, so every bit has to agree.
    impulse, mu, normal = trial
    factor = 2.0**power
    assert np.array_equal(
        law.radial_return(factor * impulse, mu, factor * normal),
        factor * law.radial_return(impulse, mu, normal),
    )


@every_trial
@given(trials(), st.floats(1.0, 100.0))
def test_more_normal_impulse_never_carries_less(trial, factor):
    impulse, mu, normal = trial
    less = np.abs(law.radial_return(impulse, mu, normal))
    more = np.abs(law.radial_return(impulse, mu, factor * normal))
    assert np.all(more >= less * (1 - ROUNDING))


# Newton stops within 1e-9 of the surface and the rest is radial. Of a component q_i = p_i / (mu_i
# p_n) on the surface it leaves an error e_i with q_i e_i <= 2e-9 and e_i <= q_i, of five at most.
NEWTON = 2e-9
COMPONENT = (5 * NEWTON) ** 0.5


def compliances(directions):
    """Return a strategy of impulses per unit of rate, over 6 decades."""
    return st.lists(
        st.builds(lambda e: 10**e, st.floats(-3, 3)), min_size=directions, max_size=directions
    )


@every_trial
@given(st.data())
def test_slip_is_normal_to_the_surface_and_opposes_friction(data):
    impulse, mu, normal = data.draw(trials(positive=True))
    response = np.array(data.draw(compliances(len(mu))))
    returned, sticks = law.return_to_limit(impulse, mu, response, normal)
    if sticks:
        assert np.array_equal(returned, impulse)
        return
    assert surface(returned, mu) == pytest.approx(normal, rel=ROUNDING)
    # The slip (t - p) / c is gamma times the surface's normal p / mu^2: bisection in log(gamma).
    compliance = response / mu**2
    low, high = -100.0, 100.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        outside = surface(impulse / (1 + np.exp(middle) * compliance), mu) > normal
        low, high = (middle, high) if outside else (low, middle)
    expected = impulse / (1 + np.exp(low) * compliance)
    np.testing.assert_allclose(returned / (mu * normal), expected / (mu * normal), atol=COMPONENT)
    assert np.all(returned * impulse >= 0)


@every_trial
@given(trials(), st.floats(1e-3, 1e3))
def test_equal_compliances_return_along_the_ray(trial, factor):
    impulse, mu, normal = trial
    returned, _ = law.return_to_limit(impulse, mu, factor * mu**2, normal)
    np.testing.assert_allclose(
        returned, law.radial_return(impulse, mu, normal), rtol=NEWTON, atol=0
    )


def test_sliding_opposes_the_velocity_whatever_the_apparent_masses():
    # A spring-damper answers a rate v with -c v; far outside the surface that is the trial.
    response, velocity = np.array([1.0, 40.0]), np.array([3.0, 4.0])
    returned, _ = law.return_to_limit(-1e6 * response * velocity, [0.5, 0.5], response, 2.0)
    np.testing.assert_allclose(returned, [-0.6, -0.8], rtol=1e-5)


def test_arrays_broadcast():
    impulse = np.random.default_rng(0).normal(size=(4, 3, 2))
    normal = np.linspace(0.0, 2.0, 3)
    returned = law.radial_return(impulse, [0.5, 0.7], normal)
    for i in range(4):
        for j in range(3):
            single = law.radial_return(impulse[i, j], [0.5, 0.7], normal[j])
            assert np.array_equal(returned[i, j], single)
    with pytest.raises(ValueError, match=r"do not broadcast: impulse \(4, 3, 2\), mu \(3,\)"):
        law.radial_return(impulse, [0.5, 0.7, 0.1], normal)
    with pytest.raises(ValueError, match=r"do not broadcast: .*response \(3,\)"):
        law.return_to_limit(impulse, [0.5, 0.7], [1.0, 1.0, 1.0], normal)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"impulse": [math.nan, 0.0]}, "impulse"),
        ({"impulse": 1.0}, "impulse"),
        ({"impulse": np.zeros(6), "mu": 1.0}, "impulse"),
        ({"mu": [-0.1, 0.5]}, "mu"),
        ({"mu": [math.inf, 0.5]}, "mu"),
        ({"normal_impulse": -1.0}, "normal_impulse"),
    ],
)
def test_bad_values_are_named(change, name):
    arguments = {"impulse": [0.1, 0.2], "mu": [0.5, 0.5], "normal_impulse": 1.0} | change
    with pytest.raises(ValueError, match=name):
        law.radial_return(**arguments)
    with pytest.raises(ValueError, match=name):
        law.return_to_limit(**arguments, response=1.0)


@pytest.mark.parametrize("response", [-1.0, math.nan, math.inf])
def test_bad_responses_are_named(response):
    with pytest.raises(ValueError, match="response"):
        law.return_to_limit([1.0, 2.0], 0.5, [1.0, response], 1.0)
