"""Combination of two materials."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dashpot import _core, law
from dashpot.materials import CombinationRules, Material

every_material = settings(max_examples=100, deadline=None)


FIELDS = [
    "rigid",
    "stiffness",
    "form",
    "damping",
    "added_damping",
    "has_friction",
    "friction",
    "loaded_friction",
    "friction_load",
    "tangential_ratio",
    "tangential_damping_ratio",
]


def combine(a, b, **rules):
    return _core.combine(a._to_core(), b._to_core(), CombinationRules(**rules)._to_core())


def fields(core):
    return [getattr(core, name) for name in FIELDS]


def quality(core, inverse_mass=0.5):
    """Return the damping in N s/m of a combined pair that is not rigid."""
    return _core.damping_of(core, core.stiffness, inverse_mass)


positive = st.builds(lambda x: 10**x, st.floats(-3, 9))
relative_dampings = st.one_of(
    st.builds(lambda x: {"damping_ratio": x}, st.floats(0, 20)),
    st.builds(lambda x: {"restitution": x}, st.floats(0, 1)),
    st.just({}),
)
dampings = st.one_of(st.builds(lambda x: {"damping": x}, st.floats(0, 1e4)), relative_dampings)
stiffnesses_and_dampings = st.one_of(
    st.builds(lambda d: {"stiffness": None, **d}, relative_dampings),
    st.builds(lambda k, d: {"stiffness": k, **d}, positive, dampings),
)
frictions = st.tuples(st.floats(0, 2), st.floats(0, 0.1), st.floats(0, 0.01))
materials = st.builds(
    lambda spring, f, s, load, t, z: Material(
        **spring,
        friction=f,
        loaded_friction=s,
        friction_load=load,
        tangential_ratio=t,
        tangential_damping_ratio=z,
    ),
    stiffnesses_and_dampings,
    frictions,
    st.floats(0.01, 1),
    st.floats(0.1, 100),
    st.floats(0.1, 2),
    st.floats(0, 5),
)
all_rules = st.builds(
    lambda s, d, f: {"stiffness": s, "damping": d, "friction": f},
    st.sampled_from(["series", "min", "max", "mean"]),
    st.sampled_from(["series", "mean"]),
    st.sampled_from(["max", "min", "mean", "geometric_mean"]),
)


@every_material
@given(materials, materials, all_rules)
def test_combination_is_symmetric(a, b, rules):
    assert fields(combine(a, b, **rules)) == fields(combine(b, a, **rules))


@every_material
@given(materials, all_rules)
def test_a_material_with_itself_keeps_its_ratios(a, rules):
    pair = combine(a, a, **rules)
    assert pair.rigid == (a.stiffness is None)
    if a.restitution is not None:
        assert pair.form == _core.DampingForm.ratio
        assert pair.damping == law.restitution_to_damping_ratio(a.restitution)
    elif a.damping is None:
        assert pair.damping == (1.0 if a.damping_ratio is None else a.damping_ratio)
    else:
        halved = rules["damping"] == "series"
        assert pair.damping == a.damping / (2 if halved else 1)
    if a.stiffness is not None:
        assert pair.stiffness == a.stiffness / (2 if rules["stiffness"] == "series" else 1)
    assert tuple(pair.friction) == a.friction
    assert pair.loaded_friction == a.loaded_friction
    assert pair.friction_load == a.friction_load
    assert pair.tangential_ratio == a.tangential_ratio
    assert pair.tangential_damping_ratio == a.tangential_damping_ratio
    assert pair.added_damping == 0.0


@every_material
@given(materials, materials)
def test_softer_than_both_and_within_both_damping_ratios(a, b):
    pair = combine(a, b)
    stiffnesses = [m.stiffness for m in (a, b) if m.stiffness is not None]
    assert pair.rigid == (not stiffnesses)
    if stiffnesses:
        assert 0.5 * min(stiffnesses) * (1 - 1e-15) <= pair.stiffness <= min(stiffnesses)
    if a.damping is None and b.damping is None:
        alone = [m.restitution for m in (a, b)]
        ratios = [
            law.restitution_to_damping_ratio(e)
            if e is not None
            else (1.0 if m.damping_ratio is None else m.damping_ratio)
            for m, e in zip((a, b), alone, strict=True)
        ]
        assert min(ratios) * (1 - 1e-15) <= pair.damping <= max(ratios) * (1 + 1e-15)


def test_springs_in_series():
    pair = combine(Material(3e4), Material(6e4))
    assert pair.stiffness == pytest.approx(2e4, rel=1e-15)


@pytest.mark.parametrize(("rule", "expected"), [("min", 3e4), ("max", 6e4), ("mean", 4.5e4)])
def test_other_stiffness_rules(rule, expected):
    assert combine(Material(3e4), Material(6e4), stiffness=rule).stiffness == expected


def test_dashpots_in_series():
    pair = combine(Material(1e4, damping=3.0), Material(5e5, damping=6.0))
    assert quality(pair) == pytest.approx(2.0, rel=1e-15)
    assert quality(combine(Material(1e4, damping=3.0), Material(1e4, damping=0.0))) == 0.0
    assert quality(combine(Material(1e4, damping=0.0), Material(1e4, damping=0.0))) == 0.0


@pytest.mark.parametrize(("rule", "expected"), [("min", 3.0), ("max", 6.0), ("mean", 4.5)])
def test_other_damping_rules(rule, expected):
    soft, hard = Material(1e4, damping=3.0), Material(5e5, damping=6.0)
    assert combine(soft, hard, damping=rule).damping == expected
    soft, hard = Material(1e4, damping_ratio=3.0), Material(5e5, damping_ratio=6.0)
    assert combine(soft, hard, damping=rule).damping == expected


def test_damping_ratios_are_weighted_by_elastic_energy():
    # Two springs in series carry the same force: their energies are as 1/k.
    pair = combine(Material(1e4, damping_ratio=0.1), Material(3e4, damping_ratio=0.5))
    assert pair.damping == pytest.approx((3 * 0.1 + 0.5) / 4, rel=1e-15)


def test_equal_restitution_is_kept_exactly():
    for e in (1.0, 0.83, 0.5, 0.05):
        pair = combine(Material(1e4, restitution=e), Material(7e5, restitution=e))
        assert pair.damping == law.restitution_to_damping_ratio(e)
        # and the contact rebounds with it
        w = 0.3
        rebound = law.flow_contact(
            0.0, -1.0, 0.0, 10.0, stiffness=pair.stiffness, damping=quality(pair, w), inverse_mass=w
        )
        assert rebound.rate == pytest.approx(e, rel=1e-13)


def test_perfectly_plastic_pair():
    assert combine(Material(1e4, restitution=0.0), Material(1e5, restitution=0.0)).damping == (
        math.inf
    )
    assert combine(Material(1e4, restitution=0.5), Material(1e5, restitution=0.0)).damping == (
        math.inf
    )


@pytest.mark.parametrize("rule", ["series", "min", "max", "mean"])
@pytest.mark.parametrize(
    "given", [{"damping": 40.0}, {"damping_ratio": 0.2}, {"restitution": 0.7}, {}]
)
def test_rigid_side_leaves_the_soft_side_whole(rule, given):
    soft = Material(2e4, **given)
    pair = combine(soft, Material(), damping=rule)
    assert not pair.rigid
    assert pair.stiffness == 2e4
    assert quality(pair) == pytest.approx(_core.damping_of(soft._to_core(), 2e4, 0.5), rel=1e-15)


def test_rule_that_makes_the_pair_rigid_takes_the_rigid_side():
    for rule in ("max", "mean"):
        pair = combine(
            Material(2e4, damping_ratio=0.2), Material(damping_ratio=3.0), stiffness=rule
        )
        assert pair.rigid
        assert pair.damping == 3.0


def test_rigid_on_rigid_is_rigid():
    pair = combine(Material(), Material(damping_ratio=0.5))
    assert pair.rigid
    assert pair.damping == 0.75


def test_ratio_with_absolute_damping_adds_both_shares():
    # Energy shares 3/4 and 1/4; a dashpot that takes 1/4 of the rate gives 1/16 of its damping.
    pair = combine(Material(1e4, damping_ratio=0.4), Material(3e4, damping=160.0))
    assert pair.form == _core.DampingForm.ratio
    assert pair.damping == pytest.approx(0.3, rel=1e-15)
    assert pair.added_damping == pytest.approx(10.0, rel=1e-15)
    k, w = 7.5e3, 0.5
    expected = 2 * 0.3 * math.sqrt(k / w) + 10.0
    assert quality(pair, w) == pytest.approx(expected, rel=1e-15)
    for rule in ("min", "max"):
        with pytest.raises(ValueError, match=f"damping='min' or 'max'.*{160}"):
            combine(Material(1e4, damping_ratio=0.4), Material(3e4, damping=160.0), damping=rule)


def test_mixed_damping_is_continuous_towards_a_rigid_side():
    # A side that stiffens without end leaves the other's damping, whichever form each has.
    soft = Material(1e4, damping=50.0)
    almost = combine(soft, Material(1e16, damping_ratio=1.0))
    assert quality(almost) == pytest.approx(50.0, rel=1e-8)
    soft = Material(1e4, damping_ratio=0.5)
    almost = combine(soft, Material(1e16, damping=1e3))
    assert quality(almost) == pytest.approx(quality(combine(soft, Material())), rel=1e-8)


def test_tangential_springs_combine_in_series():
    a = Material(1e4, tangential_ratio=0.5, tangential_damping_ratio=0.2)
    b = Material(3e4, tangential_ratio=1.0, tangential_damping_ratio=1.0)
    pair = combine(a, b)
    tangential = 1 / (1 / 5e3 + 1 / 3e4)
    assert pair.tangential_ratio * pair.stiffness == pytest.approx(tangential, rel=1e-14)
    share = tangential / 5e3
    assert pair.tangential_damping_ratio == pytest.approx(0.2 * share + 1 - share, rel=1e-14)
    against_rigid = combine(a, Material())
    assert against_rigid.tangential_ratio == pytest.approx(0.5, rel=1e-15)
    assert against_rigid.tangential_damping_ratio == 0.2


@pytest.mark.parametrize(
    ("rule", "expected"),
    [
        ("max", (0.9, 0.02, 4e-4)),
        ("min", (0.4, 0.005, 1e-4)),
        ("mean", (0.65, 0.0125, 2.5e-4)),
        ("geometric_mean", (0.6, 0.01, 2e-4)),
    ],
)
def test_friction_rules_act_element_by_element(rule, expected):
    a = Material(friction=(0.4, 0.02, 1e-4))
    b = Material(friction=(0.9, 0.005, 4e-4))
    np.testing.assert_allclose(combine(a, b, friction=rule).friction, expected, rtol=1e-15)


def test_friction_left_to_the_mjcf():
    assert not combine(Material(), Material()).has_friction
    pair = combine(Material(friction=0.3), Material(friction=(0.2, 0.01, 1e-3)))
    assert pair.has_friction
    assert list(pair.friction) == [0.3, 0.01, 1e-3]
    both = combine(Material(friction=0.3), Material(friction=0.5))
    assert both.friction[0] == 0.5
    assert all(math.isnan(value) for value in both.friction[1:])
