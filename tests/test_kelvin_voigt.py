"""The closed-form flow of one contact against 60-digit references and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpmath import mp, mpf

import kelvin_voigt_reference
from dashpot import law
from kelvin_voigt_errors import TOLERANCE, flow, natural_errors, scales

# --- every regime against the reference -------------------------------------------------------

DAMPING = {
    "undamped": lambda rng: 0.0,
    "light": lambda rng: 10 ** rng.uniform(-3, -0.5),
    "half": lambda rng: rng.uniform(0.3, 0.99),
    "below critical": lambda rng: 1.0 - 1e-9,
    "critical": lambda rng: 1.0,
    "above critical": lambda rng: 1.0 + 1e-9,
    "mild over": lambda rng: rng.uniform(1.01, 1.5),
    "strong over": lambda rng: rng.uniform(1.5, 20.0),
    "twenty": lambda rng: 20.0,
}


def resting(rng, omega, w, zeta, time, v):
    b = -v / time
    return b / omega**2, 0.0, b


def about_rest(rng, omega, w, zeta, time, v):
    """Oscillates in contact over the whole interval: phase errors would add up."""
    b = -v * omega
    return b / omega**2 * rng.uniform(0.3, 1.7), 0.0, b


def pulled(rng, omega, w, zeta, time, v):
    return -v / omega * rng.uniform(), v * rng.uniform(-1, 1), v / time * rng.uniform(0, 4)


def pressed(rng, omega, w, zeta, time, v):
    """Compressed, moving either way: includes releases, flights and bounces."""
    return -v / omega * rng.uniform(), v * rng.uniform(-1, 1), -v / time * rng.uniform(0, 20)


def onset(rng, omega, w, zeta, time, v):
    """Arrives anywhere in the interval, both ends included closely."""
    at = time * rng.choice([rng.uniform(), 1e-9, 1.0 - 1e-9])
    b = v / time * rng.uniform(-3, 0.9)
    return v * at - 0.5 * b * at**2, -v, b


def bounce(rng, omega, w, zeta, time, v):
    return v * time * rng.uniform(0, 0.2), -v, -v / time * rng.uniform(1, 30)


def touching(rng, omega, w, zeta, time, v):
    """At zero gap exactly: arriving, or let go under a load."""
    return 0.0, rng.choice([0.0, -v]), -v / time * rng.uniform(0, 4)


def released_overlap(rng, omega, w, zeta, time, v):
    """In penetration, leaving too fast for a spring-damper of zeta > 0.1 to push."""
    gap = -v / omega * rng.uniform()
    rate = -gap * omega / max(2 * zeta, 0.2) * rng.uniform(1.001, 3)
    return gap, rate, rng.choice([-1.0, 1.0]) * rng.uniform(0, 30) * rate / min(time, 1 / omega)


SITUATIONS = [resting, about_rest, pulled, pressed, onset, bounce, touching, released_overlap]


def draw(damping, situation, count):
    """Yield cases with w k h^2 log-uniform from 1e-12 to 1e8, its ends included."""
    rng = np.random.default_rng([list(DAMPING).index(damping), SITUATIONS.index(situation)])
    for i in range(count):
        zeta = DAMPING[damping](rng)
        # Powers of two make k = omega^2 / w and d = 2 omega / w exact, and critical damping too.
        omega = 2.0 ** rng.integers(-4, 14)
        w = 4.0 ** rng.integers(-5, 4)
        exponent = {0: -6.0, 1: 4.0}.get(i, rng.uniform(-6, 4))
        time = 10**exponent / omega
        v = 10 ** rng.uniform(-3, 1)
        g, u, b = situation(rng, omega, w, zeta, time, v)
        yield omega**2 / w, 2 * zeta * omega / w, w, float(g), float(u), float(b), time


@pytest.mark.parametrize("situation", SITUATIONS, ids=lambda s: s.__name__)
@pytest.mark.parametrize("damping", DAMPING)
def test_flow_matches_reference(damping, situation):
    # Rounding of the phase omega t alone may cost omega t * 1e-16 = 1e-12 at w k h^2 = 1e8.
    for case in draw(damping, situation, 5):
        errors = natural_errors(case)
        assert max(errors) <= TOLERANCE, (case, errors)


@pytest.mark.parametrize("zeta", [0.0, 0.3, 1.0, 20.0])
@pytest.mark.parametrize("fraction", [1e-5, 0.5, 1.0 - 1e-13])
def test_release_anywhere_in_the_interval(zeta, fraction):
    omega, w, v = 512.0, 0.25, 1.3
    if zeta < 1.0:
        angle = math.acos(zeta)
        contact = 2 * angle / math.sin(angle) / omega
    elif zeta == 1.0:
        contact = 2 / omega
    else:
        contact = 2 * math.acosh(zeta) / math.sinh(math.acosh(zeta)) / omega
    for sign in (-1.0, 0.0, 1.0):
        load = sign * 1e-3 * v / contact
        case = (omega**2 / w, 2 * zeta * omega / w, w, 0.0, -v, load, contact / fraction)
        errors = natural_errors(case)
        assert max(errors) <= TOLERANCE, (case, errors)


@pytest.mark.parametrize("damping", DAMPING)
def test_sustained_contact_is_accurate_relative_to_the_result(damping):
    # Nothing cancels while the contact is pressed and near rest: the results themselves, not only
    # their scale, are good to 1e-13 and what rounding costs the phase omega t, up to 1e4.
    rng = np.random.default_rng(7)
    for exponent in np.linspace(-6, 4, 41):
        zeta, w, time = DAMPING[damping](rng), 10 ** rng.uniform(-3, 3), 10 ** rng.uniform(-4, 1)
        omega, b = 10**exponent / time, -(10 ** rng.uniform(-2, 2))
        case = (omega**2 / w, 2 * zeta * omega / w, w, b / omega**2 * 0.8, 0.0, b, time)
        result, exact = flow(*case), kelvin_voigt_reference.flow(*case)
        assert result.events == exact.events == 0
        tolerance = 1e-13 + 4e-16 * omega * time
        for i in (0, 1, 2, 4):
            assert abs(float(result[i]) / exact[i] - 1) <= tolerance, (case, i)


def reference_propagator(k, d, w, time):
    """E0..E4 from the exponentials and the recurrence in n, at enough digits for both."""
    with mp.workdps(160):
        k, d, w, t = mpf(k), mpf(d), mpf(w), mpf(time)
        half = w * d / 2
        root = mp.sqrt(mp.mpc(half**2 - w * k))
        if root == 0:
            e1, e0 = t * mp.exp(-half * t), (1 - half * t) * mp.exp(-half * t)
        else:
            e1 = mp.re(mp.exp(-half * t) * mp.sinh(root * t) / root)
            e0 = mp.re(mp.exp(-half * t) * mp.cosh(root * t)) - half * e1
        e = [e0, e1]
        for n in (2, 3, 4):
            e.append((t ** (n - 2) / mp.factorial(n - 2) - e[n - 2] - w * d * e[n - 1]) / (w * k))
        return e


@pytest.mark.parametrize("damping", DAMPING)
def test_propagator_matches_reference(damping):
    # 1e-13 plus the rounding of the phase, relative to the size without damping for the two that
    # change sign (E0 <= 1, E1 <= min(t, 1/omega)) or touch zero (E2 <= min(t^2/2, 2/omega^2)).
    rng = np.random.default_rng(3)
    for exponent in np.linspace(-6, 4, 81):
        zeta = DAMPING[damping](rng)
        omega, w = 2.0 ** rng.integers(-4, 14), 4.0 ** rng.integers(-5, 4)
        time = 10**exponent / omega
        k, d = omega**2 / w, 2 * zeta * omega / w
        got = law.propagate(time, stiffness=k, damping=d, inverse_mass=w)
        exact = reference_propagator(k, d, w, time)
        tolerance = 1e-13 + 4e-16 * omega * time
        sizes = [1.0, min(time, 1 / omega), exact[2], exact[3], exact[4]]
        if zeta < 0.1:
            sizes[2] = min(0.5 * time**2, 2 / omega**2)
        for n in range(5):
            error = float(abs(mpf(float(got[n])) - exact[n]) / sizes[n])
            assert error <= tolerance, (n, zeta, exponent, error)


def test_propagator_without_spring_or_damper():
    time = np.array([0.0, 1e-3, 2.0])
    free = law.propagate(time, stiffness=0.0, damping=0.0, inverse_mass=2.0)
    for n in range(5):
        np.testing.assert_allclose(free[n], time**n / math.factorial(n), rtol=4e-16)
    # A damper alone: y'' + c y' = 1 from rest.
    rate = 3.0
    damper = law.propagate(5.0, stiffness=0.0, damping=1.5, inverse_mass=2.0)
    assert damper.e1 == pytest.approx(-math.expm1(-15.0) / rate, rel=1e-15)
    assert damper.e2 == pytest.approx((5.0 + math.expm1(-15.0) / rate) / rate, rel=1e-14)


def test_spring_matches_reference():
    rng = np.random.default_rng(5)
    for damping in DAMPING:
        for k, d, w, g, u, b, time in draw(damping, pulled, 10):
            sign = rng.choice([-1.0, 1.0])
            got = law.flow_spring(sign * g, u, b, time, stiffness=k, damping=d, inverse_mass=w)
            with mp.workdps(60):
                phase = kelvin_voigt_reference._Phase(*(mpf(x) for x in (k, d, w, b, sign * g, u)))
                end_gap, end_rate = phase.state(mpf(time))
                exact = [
                    (end_rate - u - mpf(b) * time) / w,
                    (end_gap - sign * g - mpf(u) * time - mpf(b) * mpf(time) ** 2 / 2) / w,
                    end_gap,
                    end_rate,
                    phase.force(mpf(time)),
                ]
            natural = scales(k, d, w, -abs(g), u, b, time, held=True)
            for value, reference, scale in zip(got[:5], exact, natural, strict=True):
                assert abs(float(mpf(float(value)) - reference)) <= TOLERANCE * scale


# --- closed forms ---------------------------------------------------------------------------------


def test_undamped_impact_reverses_the_speed_in_half_a_period():
    k, w, v = 1e4, 0.5, 2.0
    contact = math.pi / math.sqrt(w * k)
    result = flow(k, 0.0, w, 0.0, -v, 0.0, 2 * contact)
    assert result.impulse == pytest.approx(2 * v / w, rel=1e-14)
    assert result.gap == pytest.approx(v * contact, rel=1e-13)
    # p has its centre of time at half the contact.
    assert result.moment == pytest.approx(2 * v / w * 1.5 * contact, rel=1e-14)
    assert (result.touched, result.force, result.events) == (True, 0.0, 1)


def test_resting_contact_carries_exactly_its_load():
    k, d, w, g = 1e5, 30.0, 2.0, 9.81
    result = flow(k, d, w, -g / (w * k), 0.0, -g, 0.01)
    assert result.impulse == pytest.approx(g * 0.01 / w, rel=1e-15)
    assert result.force == pytest.approx(g / w, rel=1e-15)
    assert result.gap == pytest.approx(-g / (w * k), rel=1e-14)
    assert abs(result.rate) <= 2.3e-16 * g * 0.01  # one rounding of the load's own change


def test_damper_without_spring_never_lets_go():
    d, w, v, time = 2.0, 0.5, 1.0, 3.0
    result = flow(0.0, d, w, 0.0, -v, 0.0, time)
    assert result.rate == pytest.approx(-v * math.exp(-w * d * time), rel=1e-14)
    assert result.impulse == pytest.approx(-math.expm1(-w * d * time) * v / w, rel=1e-14)
    assert result.events == 0


def test_rebound_without_load_has_the_restitution():
    for zeta in [0.0, 0.01, 0.3, 0.999, 1.0, 1.001, 1.5, 4.0, 20.0]:
        omega, w = 300.0, 0.7
        result = flow(omega**2 / w, 2 * zeta * omega / w, w, 0.0, -3.0, 0.0, 100 / omega)
        e = law.damping_ratio_to_restitution(zeta)
        # A strongly damped rebound is a small remainder of the approach.
        assert result.rate / 3.0 == pytest.approx(e, abs=1e-15, rel=1e-13)


def test_start_at_zero_gap():
    base = dict(stiffness=1e3, damping=5.0, inverse_mass=1.0)
    assert law.flow_contact(0.0, -1.0, 0.0, 1e-3, **base).touched
    assert law.flow_contact(0.0, 0.0, -1.0, 1e-3, **base).touched
    assert not law.flow_contact(0.0, 0.0, 0.0, 1e-3, **base).touched
    assert not law.flow_contact(0.0, 1.0, 5.0, 1e-3, **base).touched
    assert not law.flow_contact(0.0, 0.0, 1.0, 1e-3, **base).touched


def test_grazing_flight_does_not_touch():
    # Turned back by the load exactly at the surface, and a hair above it.
    for gap in (0.5, 0.5 + 1e-15):
        result = flow(1e4, 10.0, 1.0, gap, -1.0, 1.0, 3.0)
        assert not result.touched
        assert result.impulse == 0.0
    assert flow(1e4, 10.0, 1.0, 0.5 - 1e-15, -1.0, 1.0, 3.0).touched


def test_empty_interval_changes_nothing():
    for gap, rate in [(1.0, -1.0), (0.0, -1.0), (-1e-3, 0.5), (-1e-3, 500.0)]:
        result = flow(1e4, 10.0, 1.0, gap, rate, -9.81, 0.0)
        assert (result.impulse, result.moment, result.gap, result.rate) == (0.0, 0.0, gap, rate)
        assert result.force == (max(0.0, -1e4 * gap - 10.0 * rate) if gap <= 0.0 else 0.0)


def test_thousands_of_bounces_conserve_energy():
    # 1 m drop on an undamped 1e6 N/m spring for an hour of bouncing, in one interval.
    g, k = 9.81, 1e6
    result = flow(k, 0.0, 1.0, 1.0, 0.0, -g, 3600.0)
    bounces = 3600.0 / (2 * math.sqrt(2 / g) + math.pi / math.sqrt(k))
    assert result.events // 2 == pytest.approx(bounces, rel=1e-2)
    end = 0.5 * result.rate**2 + g * result.gap + 0.5 * k * min(result.gap, 0.0) ** 2
    assert end == pytest.approx(g, rel=1e-11)  # 4,000 events of rounding 1e-15


def test_bouncing_to_rest_ends():
    # Damping 0.3: a geometric series of bounces, then rest under the load.
    g, k, w = 9.81, 1e6, 1.0
    result = flow(k, 0.6e3, w, 0.1, 0.0, -g, 10.0)
    assert result.events < 20
    assert result.gap == pytest.approx(-g / k, rel=1e-11)
    assert result.force == pytest.approx(g, rel=1e-11)


# --- arrays and bad input -------------------------------------------------------------------------


def test_arguments_broadcast():
    damping = np.array([[0.0], [10.0], [400.0]])
    gap = np.array([-1e-3, 0.0, 1e-3, 1.0])
    result = law.flow_contact(
        gap, -1.0, -9.81, 0.01, stiffness=1e4, damping=damping, inverse_mass=1
    )
    assert result.impulse.shape == (3, 4)
    for i in range(3):
        for j in range(4):
            single = flow(1e4, damping[i, 0], 1.0, gap[j], -1.0, -9.81, 0.01)
            assert all(a[i, j] == s for a, s in zip(result, single, strict=True))
    with pytest.raises(ValueError, match=r"do not broadcast: .*gap \(4,\), rate \(3,\), load \(\)"):
        law.flow_contact(gap, gap[:3], 0.0, 1.0, stiffness=1.0, damping=0.0, inverse_mass=1.0)
    empty = law.flow_contact([], 0.0, 0.0, 1.0, stiffness=1.0, damping=0.0, inverse_mass=1.0)
    assert empty.impulse.shape == (0,)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("stiffness", -1.0),
        ("stiffness", math.inf),
        ("damping", -1e-9),
        ("inverse_mass", 0.0),
        ("inverse_mass", math.nan),
        ("gap", math.nan),
        ("rate", [0.0, math.inf]),
        ("load", math.nan),
        ("time", -1e-3),
    ],
)
def test_bad_values_are_named(name, value):
    arguments = dict(gap=0.0, rate=0.0, load=0.0, time=1.0, stiffness=1.0, damping=1.0)
    arguments |= {"inverse_mass": 1.0, name: value}
    with pytest.raises(ValueError, match=name):
        law.flow_contact(**arguments)


def test_wrong_types_are_refused():
    with pytest.raises(TypeError, match="gap"):
        law.flow_contact("deep", 0.0, 0.0, 1.0, stiffness=1.0, damping=1.0, inverse_mass=1.0)
    with pytest.raises(TypeError, match="time"):
        law.propagate(1j, stiffness=1.0, damping=1.0, inverse_mass=1.0)
