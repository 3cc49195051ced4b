"""Laws that the closed-form flow of one contact obeys, whatever the contact."""

from __future__ import annotations

import math
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kelvin_voigt_reference
from kelvin_voigt_errors import TOLERANCE, flow, natural_errors, scales

# Zero, or of either sign and of any size that matters beside 1.
signed = st.one_of(
    st.just(0.0),
    st.floats(-1.0, 1.0).filter(lambda x: abs(x) > 1e-3),
    st.builds(lambda sign, e: sign * 10**e, st.sampled_from([-1.0, 1.0]), st.floats(-17, 0)),
)


@st.composite
def contacts(draw_value):
    """Contacts with w k h^2 from 1e-12 to 1e8, damping ratio 0 to 20, any state and load.

    No ratio is so small that d would be a subnormal number, which no power of two scales exactly.
    """
    phase = 10 ** draw_value(st.floats(-6, 4))
    time = 10 ** draw_value(st.floats(-4, 1))
    w = 10 ** draw_value(st.floats(-3, 3))
    zeta = draw_value(
        st.one_of(
            st.sampled_from([0.0, 1.0 - 1e-9, 1.0, 1.0 + 1e-9, 20.0]), st.floats(1e-200, 20.0)
        )
    )
    omega = phase / time
    v = 10 ** draw_value(st.floats(-3, 1))
    length = v * draw_value(st.sampled_from([time, 1 / omega]))
    # Loads of the scale of the interval or of the contact, without too many bounces to reference.
    acceleration = v * draw_value(st.sampled_from([1 / time, min(omega, 100 / time)]))
    return (
        omega**2 / w,
        2 * zeta * omega / w,
        w,
        length * draw_value(signed),
        v * draw_value(signed),
        acceleration * draw_value(signed),
        time,
    )


every_contact = settings(max_examples=30, deadline=None)


@every_contact
@given(contacts())
def test_every_contact_matches_reference_or_its_conditioning(case):
    # Just at grazing the speed of onset varies as the square root of the gap, so that the inputs
    # themselves, 1 ulp apart, have results further apart than any tolerance.
    errors = natural_errors(case)
    if max(errors) > TOLERANCE:
        roundings = 10 + flow(*case).events  # every phase between events rounds its inputs anew
        spread = conditioning(case)
        assert all(e <= TOLERANCE + roundings * s for e, s in zip(errors, spread, strict=True)), (
            errors
        )


def conditioning(case):
    """Change of the exact result, in natural units, under rounding of every input.

    Stiffness, inverse mass and time set the phase, of which 1e4 rad are some 1e-12 rad uncertain.
    """
    centre = kelvin_voigt_reference.flow(*case)
    natural = scales(*case, held=centre.events == 0 and centre.force > 0)
    sizes = [abs(value) for value in case]
    sizes[3:5] = natural[2:4]
    spread = [0.0] * 5
    for index, size in enumerate(sizes):
        for sign in (-1.0, 1.0):
            moved_case = list(case)
            moved_case[index] += sign * 4e-16 * size
            moved = kelvin_voigt_reference.flow(*moved_case)
            for i in range(5):
                if natural[i] > 0.0:
                    change = float(abs(moved[i] - centre[i])) / natural[i]
                    spread[i] = max(spread[i], change)
    return spread


@every_contact
@given(contacts(), st.floats(0.0, 1.0))
def test_flow_over_two_parts_equals_flow_over_the_whole(case, fraction):
    *state, time = case
    whole = flow(*case)
    first = flow(*state, fraction * time)
    second = flow(*case[:3], float(first.gap), float(first.rate), case[5], (1 - fraction) * time)
    parts = [
        first.impulse + second.impulse,
        first.moment + first.impulse * (1 - fraction) * time + second.moment,
        second.gap,
        second.rate,
    ]
    errors = [
        abs(a - b) / s if s > 0.0 else 0.0
        for a, b, s in zip(parts, whole[:4], scales(*case), strict=False)
    ]
    if max(errors) > TOLERANCE:
        roundings = 10 + whole.events  # every phase between events rounds its inputs anew
        spread = conditioning(case)
        assert all(e <= TOLERANCE + roundings * s for e, s in zip(errors, spread, strict=False)), (
            errors
        )


@every_contact
@given(contacts(), st.floats(0.0, 1.0))
def test_contact_never_pulls(case, fraction):
    *state, time = case
    whole, part = flow(*case), flow(*state, fraction * time)
    assert whole.impulse >= 0.0
    assert whole.force >= 0.0
    # 0 <= r <= p t, and the impulse only grows: to rounding of the natural impulse.
    impulse, moment, *_ = scales(*case)
    assert 0.0 <= whole.moment <= whole.impulse * time + 1e-14 * moment
    assert whole.impulse >= part.impulse - 1e-13 * impulse
    if not whole.touched:
        assert (whole.impulse, whole.moment, whole.force, whole.events) == (0.0, 0.0, 0.0, 0)


@every_contact
@given(contacts())
def test_contact_creates_no_energy(case):
    k, _, w, g, u, b, _ = case
    result = flow(*case)

    def energy(gap, rate):
        return 0.5 * rate**2 / w + 0.5 * k * min(gap, 0.0) ** 2

    work = b / w * (result.gap - g)
    _, _, length, speed, _ = scales(*case)
    size = 0.5 * speed**2 / w + abs(b) / w * length
    gain = energy(result.gap, result.rate) - energy(g, u) - work
    # Rounding; the phase omega t contributes up to 1e-12 of a cycle at 1e4.
    assert gain <= TOLERANCE * size


@every_contact
@given(contacts())
def test_impulse_is_the_change_of_momentum(case):
    _, _, w, g, u, b, time = case
    result = flow(*case)
    _, _, length, speed, _ = scales(*case)
    assert result.rate == pytest.approx(u + b * time + w * result.impulse, abs=1e-13 * speed)
    moved = g + u * time + 0.5 * b * time**2 + w * result.moment
    assert result.gap == pytest.approx(moved, abs=1e-13 * length)


@every_contact
@given(contacts(), st.integers(-20, 20))
def test_flow_is_homogeneous_in_the_state(case, power):
    # Scaling by a power of two is exact in floating point, so that every bit has to agree, but for
    # subnormal numbers: what has decayed for as long as that is nothing.
    k, d, w, g, u, b, time = case
    factor = 2.0**power
    plain, scaled = flow(*case), flow(k, d, w, factor * g, factor * u, factor * b, time)
    nothing = 2.0**20 * sys.float_info.min
    assert all(
        s == factor * p or abs(p) < nothing for s, p in zip(scaled[:5], plain[:5], strict=True)
    )
    assert scaled.events == plain.events


@every_contact
@given(contacts(), st.integers(-20, 20))
def test_flow_scales_with_mass(case, power):
    k, d, w, *rest = case
    factor = 2.0**power
    plain, heavy = flow(*case), flow(k * factor, d * factor, w / factor, *rest)
    assert heavy.impulse == factor * plain.impulse
    assert heavy.force == factor * plain.force
    assert (heavy.gap, heavy.rate, heavy.events) == (plain.gap, plain.rate, plain.events)


@every_contact
@given(contacts())
def test_events_are_bounded(case):
    k, _, w, *_, time = case
    assert flow(*case).events <= 3 * (712 + 0.5 * math.sqrt(w * k) * time)


@given(contacts(), st.floats(0.0, 1.0))
@settings(max_examples=40, deadline=None)
def test_undamped_flow_runs_backwards(case, fraction):
    # Reversing time after an undamped flow returns to the start.
    k, _, w, g, u, b, time = case
    time *= fraction
    forth = flow(k, 0.0, w, g, u, b, time)
    back = flow(k, 0.0, w, float(forth.gap), -float(forth.rate), b, time)
    here = (k, 0.0, w, g, u, b, time)
    _, _, length, speed, _ = scales(*here)
    errors = [abs(back.gap - g) / max(length, 1e-300), abs(back.rate + u) / max(speed, 1e-300)]
    if max(errors) > 10 * TOLERANCE:
        # Many bounces amplify rounding; so they do in the exact flow.
        assert max(errors) <= 10 * TOLERANCE + 100 * max(conditioning(here))
