"""Materials: conversions, refusal of bad values, and friction left to the MJCF."""

from __future__ import annotations

import dataclasses
import itertools
import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mp, mpf

import kelvin_voigt_reference
from dashpot import Engine, _core, law
from dashpot.materials import CombinationRules, Material

every_material = settings(max_examples=100, deadline=None)

# --- restitution ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "zeta", [1e-9, 1e-3, 0.1, 0.7, 0.999, 1 - 1e-9, 1.0, 1 + 1e-9, 1.001, 1.5, 5.0, 20.0]
)
def test_restitution_is_that_of_the_released_contact(zeta):
    # Rebound speed of an unloaded contact of k = 1, m = 1 at 60 digits.
    end = kelvin_voigt_reference.flow(1.0, 2 * zeta, 1.0, 0.0, -1.0, 0.0, 1e3)
    assert abs(law.damping_ratio_to_restitution(zeta) / end.rate - 1) < 1e-14


def test_restitution_known_values():
    assert law.damping_ratio_to_restitution(0.0) == 1.0
    assert law.damping_ratio_to_restitution(1.0) == pytest.approx(math.exp(-2), rel=1e-15)
    # 1/(4 zeta^2) for large zeta; the next term is smaller by log(zeta)/zeta^2.
    assert law.damping_ratio_to_restitution(1e9) == pytest.approx(0.25e-18, rel=1e-15)
    assert law.restitution_to_damping_ratio(1.0) == 0.0
    assert law.restitution_to_damping_ratio(0.0) == math.inf


def test_restitution_falls_with_damping():
    zeta = np.concatenate([[0.0], np.logspace(-6, 6, 2001)])
    e = law.damping_ratio_to_restitution(zeta)
    assert np.all(np.diff(e) < 0.0)
    # Smooth through critical damping: second differences there are as small as around it.
    near = law.damping_ratio_to_restitution(1 + 1e-3 * np.arange(-3, 4))
    curvature = np.diff(near, 2)
    np.testing.assert_allclose(curvature, curvature[2], rtol=1e-2)


@every_material
@given(st.one_of(st.floats(1e-300, 1.0), st.floats(1e-3, 1.0), st.floats(0.13, 0.14)))
def test_restitution_inverts(e):
    zeta = law.restitution_to_damping_ratio(e)
    # One rounding of zeta moves e by 2 epsilon zeta/(1 + zeta) at most, plus the evaluation.
    assert law.damping_ratio_to_restitution(zeta) == pytest.approx(e, rel=2e-15)


@every_material
@given(st.builds(lambda x: 10**x, st.floats(-9, 9)))
def test_damping_ratio_inverts(zeta):
    # Near e = 1 the restitution keeps 1 - pi zeta to an absolute rounding only.
    e = law.damping_ratio_to_restitution(zeta)
    tolerance = 2e-15 * (1 + zeta) + 1.2e-16 / zeta * min(1.0, zeta)
    assert law.restitution_to_damping_ratio(e) == pytest.approx(zeta, rel=0, abs=tolerance)


def test_no_restitution_is_infinite_damping_and_back():
    assert law.restitution_to_damping_ratio(0.0) == math.inf
    assert law.damping_ratio_to_restitution(math.inf) == 0.0
    # The limit 1/(4 zeta^2) falls to it.
    assert law.damping_ratio_to_restitution(1e150) == pytest.approx(0.25e-300, rel=1e-12)


def test_inverse_against_high_precision_root():
    with mp.workdps(40):
        for e in (0.99, 0.5, 0.2, 0.1, 1e-3, 1e-8):

            def residual(zeta, e=e):
                angle = mp.acos(zeta)  # imaginary above 1, where the ratio stays real
                return mp.re(2 * zeta * angle / mp.sin(angle)) + mp.log(mpf(e))

            guess = law.restitution_to_damping_ratio(e)
            exact = mp.findroot(residual, (guess * 0.99, guess * 1.01))
            assert abs(guess / exact - 1) < 1e-15 * 3


@pytest.mark.parametrize("value", [-1e-9, 1.0 + 1e-9, math.nan, math.inf])
def test_bad_restitution_is_refused(value):
    with pytest.raises(ValueError, match="restitution"):
        law.restitution_to_damping_ratio(value)
    with pytest.raises(ValueError, match="restitution"):
        _core.restitution_to_damping_ratio(value)


@pytest.mark.parametrize("value", [-1e-9, math.nan])
def test_bad_damping_ratio_is_refused(value):
    with pytest.raises(ValueError, match="damping_ratio"):
        law.damping_ratio_to_restitution(value)
    with pytest.raises(ValueError, match="damping_ratio"):
        _core.damping_ratio_to_restitution(value)


# --- damping and solref ---------------------------------------------------------------------------


def test_damping_of_each_form():
    k, w = 4e4, 0.25  # m = 4 kg, 2 sqrt(k m) = 800
    ratio = Material(k, damping_ratio=0.3)._to_core()
    absolute = Material(k, damping=12.0)._to_core()
    rebound = Material(k, restitution=0.5)._to_core()
    assert _core.damping_of(ratio, k, w) == pytest.approx(240.0, rel=1e-15)
    assert _core.damping_of(absolute, k, w) == 12.0
    zeta = law.restitution_to_damping_ratio(0.5)
    assert _core.damping_of(rebound, k, w) == pytest.approx(800.0 * zeta, rel=1e-15)
    assert _core.damping_of(Material(k)._to_core(), k, w) == pytest.approx(800.0, rel=1e-15)


@pytest.mark.parametrize("solref", [(0.02, 1.0), (0.05, 0.3), (-3000.0, -40.0), (-500.0, 0.0)])
@pytest.mark.parametrize("width", [0.95, 0.5])
def test_solref_agrees_with_mujoco(solref, width):
    # A sphere deep enough in the floor that the impedance is at d_width.
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="0.001"/><worldbody>
          <geom type="plane" size="1 1 1" solref="{solref[0]} {solref[1]}"
                solimp="0.1 {width} 0.001 0.5 2"/>
          <body pos="0 0 0.09"><freejoint/>
            <geom type="sphere" size="0.1" solref="{solref[0]} {solref[1]}"
                  solimp="0.1 {width} 0.001 0.5 2"/></body>
        </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    stiffness, damping = law.solref_to_spring(solref, impedance_width=width)
    assert data.efc_KBIP[0, 0] == pytest.approx(stiffness, rel=1e-14)
    assert data.efc_KBIP[0, 1] == pytest.approx(damping, rel=1e-14)


@pytest.mark.parametrize(
    ("solref", "width"),
    [
        ((0.02, -1.0), 0.9),
        ((-100.0, 1.0), 0.9),
        ((math.nan, 1.0), 0.9),
        ((0.02, 1.0, 3.0), 0.9),
        ((0.02, 1.0), 0.0),
        ((0.02, 1.0), 1.1),
    ],
)
def test_bad_solref_is_refused(solref, width):
    with pytest.raises(ValueError, match=r"solref|impedance_width"):
        law.solref_to_spring(solref, impedance_width=width)


# --- checks of values -----------------------------------------------------------------------------


def test_arrays_for_one_number_are_named():
    with pytest.raises(TypeError, match=r"^impedance_width must be one number, got \[0.9\]"):
        law.solref_to_spring((0.02, 1.0), impedance_width=[0.9])
    with pytest.raises(TypeError, match=r"^load must be one number, got \[1.0, 2.0\]"):
        law.solref_to_spring_at_rest((0.02, 1.0), load=[1.0, 2.0])


def test_defaults_are_rigid_and_critically_damped():
    core = Material()._to_core()
    assert (core.rigid, core.form, core.damping) == (True, _core.DampingForm.ratio, 1.0)
    assert not core.has_friction


def test_values_are_normalised():
    material = Material(np.float32(2.0), damping=1, friction=np.array([1, 0.5, 0]))
    assert material == Material(2.0, damping=1.0, friction=(1.0, 0.5, 0.0))
    assert all(type(x) is float for x in material.friction)
    assert hash(material) == hash(dataclasses.replace(material))


def test_arrays_of_no_dimension_are_numbers():
    """As ``xarray`` and ``data[()]`` hand them on."""
    material = Material(np.array(2), restitution=np.array(0.5), friction=np.array(0.3))
    assert material == Material(2.0, restitution=0.5, friction=0.3)
    assert type(material.friction) is float
    for wrong in (np.array("2"), np.array(True), np.array(2j), np.array([2.0])):
        with pytest.raises(TypeError, match="Material: stiffness must be a number"):
            Material(wrong)
    with pytest.raises(TypeError, match="Material: friction"):
        Material(friction=np.array("0.3"))


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("stiffness", [0.0, -1e4, math.inf, math.nan]),
        ("damping", [-1.0, math.inf, math.nan]),
        ("damping_ratio", [-0.1, math.inf, math.nan]),
        ("restitution", [-0.1, 1.1, math.nan]),
        ("friction", [-0.1, math.inf, (0.5, -1.0, 0.0), (0.5, 0.1), (0.5, math.nan, 0.0)]),
        ("loaded_friction", [0.0, -0.1, 1.1, math.nan]),
        ("friction_load", [0.0, -1.0, math.inf]),
        ("tangential_ratio", [0.0, -1.0, math.inf]),
        ("tangential_damping_ratio", [-1.0, math.nan]),
    ],
)
def test_values_out_of_range_are_named(field, values):
    for value in values:
        with pytest.raises(ValueError, match=f"Material: {field}") as error:
            Material(**{field: value})
        culprit = value if not isinstance(value, tuple) else value[-1]
        assert isinstance(value, tuple) or repr(culprit) in str(error.value)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("stiffness", "hard"),
        ("damping", True),
        ("restitution", [0.5]),
        ("friction", "0.5"),
        ("friction", {"sliding": 0.5}),
        ("friction", (0.5, "low", 0.1)),
    ],
)
def test_wrong_types_are_refused(field, value):
    with pytest.raises(TypeError, match=f"Material: {field}"):
        Material(**{field: value})


@pytest.mark.parametrize(
    "fields_given", list(itertools.combinations(["damping", "damping_ratio", "restitution"], 2))
)
def test_only_one_form_of_damping(fields_given):
    with pytest.raises(ValueError, match="at most one") as error:
        Material(1e4, **dict.fromkeys(fields_given, 0.5))
    assert all(f"{field}=0.5" in str(error.value) for field in fields_given)


def test_material_is_frozen_and_its_options_are_keywords():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Material().stiffness = 1.0
    with pytest.raises(TypeError):
        Material(1e4, 0.5)


def test_unknown_rules_are_named_with_the_nearest():
    with pytest.raises(ValueError, match=r"friction must be .*did you mean 'geometric_mean'"):
        CombinationRules(friction="geometric mean")
    with pytest.raises(ValueError, match="stiffness must be one of series, min, max, mean"):
        CombinationRules(stiffness="harder")
    with pytest.raises(TypeError, match="damping"):
        CombinationRules(damping=1)


# --- friction that a material leaves to the MJCF --------------------------------------------------


def spin_after_a_while(override):
    """Return the spin of a ball on a floor after 0.1 s, its materials set by `override`."""
    model = mujoco.MjModel.from_xml_string("""
        <mujoco><worldbody>
          <geom name="floor" type="plane" size="1 1 1" condim="4" friction="1 0.01 0"/>
          <body pos="0 0 0.1"><freejoint/>
            <geom name="ball" type="sphere" size="0.1" condim="4" friction="1 0.01 0"/></body>
        </worldbody></mujoco>""")
    engine = Engine(model)
    override(engine)
    data = engine.make_data()
    data.qvel[5] = 10.0
    engine.step(data, nstep=50)
    return data.qvel[5]


def test_sliding_friction_alone_leaves_torsion_to_the_mjcf():
    def on_both(engine, **material):
        for geom in ("ball", "floor"):
            engine.set_material(geom, Material(1e5, **material))

    torsion = spin_after_a_while(lambda engine: on_both(engine, friction=(0.5, 0.01, 0.0)))
    # Torsional friction takes mu m g / I all the time; the first step loads the contact.
    assert torsion == pytest.approx(10.0 - 0.01 * 9.81 / (0.4 * 0.1**2) * 0.1, rel=1e-3)
    assert spin_after_a_while(lambda engine: on_both(engine, friction=0.5)) == torsion
    assert spin_after_a_while(on_both) == torsion

    def on_pair(engine, **material):
        engine.set_pair_material("ball", "floor", Material(5e4, **material))

    assert spin_after_a_while(lambda engine: on_pair(engine, friction=0.5)) == torsion


def test_a_number_beyond_all_floats_is_refused_by_name():
    with pytest.raises(ValueError, match="stiffness is too large for a float"):
        Material(10**400)
