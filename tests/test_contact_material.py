"""What Engine.contact_material says of a pair, against contacts that MuJoCo detects and bounces."""

import copy
import dataclasses
import math
import pickle

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot import CombinationRules, Engine, Material, law

PAIR = """<mujoco><worldbody><geom name="floor" type="plane" size="5 5 .1" {floor}/>
  <body name="b" pos="0 0 .0999"><freejoint/><geom name="ball" size=".1" mass="2" {ball}/></body>
</worldbody>{more}</mujoco>"""


def engine_of(floor="", ball="", more="", **options):
    xml = PAIR.format(floor=floor, ball=ball, more=more)
    return Engine(mujoco.MjModel.from_xml_string(xml), **options)


@pytest.mark.parametrize(
    ("floor", "ball", "more"),
    [
        ("", "", ""),
        ('friction=".3 .02 .003"', 'friction=".7 .01 .001" condim="4"', ""),
        ('solref=".03 .8" solmix="3"', 'solref=".01 1.2" solimp=".5 .8 .01 .4 3"', ""),
        ('solref=".03 .8" solmix="0"', 'solref=".01 1.2"', ""),
        ('solref=".04 .8" solmix="0"', 'solref=".01 1.2" solmix="0"', ""),
        ('solref="-900 -20"', 'solref="-400 -30"', ""),
        ('solref="-900 -20"', "", ""),
        ('priority="1" friction=".3" condim="1" solref=".1 .5"', 'friction=".7" condim="6"', ""),
        (
            'friction=".3"',
            "",
            '<contact><pair geom1="ball" geom2="floor" condim="6" solref=".04 .9" '
            'solimp=".1 .2 .3 .4 2" friction="1 2 .3 .4 .5"/></contact>',
        ),
    ],
)
def test_what_the_model_says_is_what_mujoco_gives_its_contacts(floor, ball, more):
    engine = engine_of(floor, ball, more)
    data = engine.make_data()
    mujoco.mj_forward(engine.model, data)
    (detected,) = data.contact
    found = engine.contact_material("floor", "ball")
    assert found == engine.contact_material(1, 0)
    assert found.condim == detected.dim
    assert found.friction == pytest.approx(detected.friction, rel=1e-14)
    assert found.solref == pytest.approx(detected.solref, rel=1e-14)
    assert found.solimp == pytest.approx(detected.solimp, rel=1e-14)
    assert found.stiffness is None
    own = "solref" in floor + ball + more
    assert found.source == ("solref" if own else "rigid")
    if own:
        k, d = law.solref_to_spring(found.solref, impedance_width=found.solimp[1])
        assert found.damping_ratio == pytest.approx(d / (2 * math.sqrt(k)), rel=1e-12)


def test_coefficients_are_no_less_than_mujoco_takes():
    found = engine_of('friction="0 0 0"', 'friction="0 0 0"').contact_material("floor", "ball")
    assert found.friction == (mujoco.mjMINMU,) * 5


def test_springs_in_series_and_overrides():
    engine = engine_of('friction=".4 .02 .003"', 'friction=".1 .01 .001"')
    engine.set_material("ball", Material(stiffness=3e4, damping_ratio=0.1, friction=0.2))
    soft = engine.contact_material("ball", "floor")
    assert (soft.source, soft.stiffness, soft.damping, soft.damping_ratio) == ("geoms", 3e4, 0, 0.1)
    assert soft.friction == (0.4, 0.4, 0.02, 0.003, 0.003)
    engine.set_material("floor", Material(stiffness=6e4, damping=50.0, friction=0.1))
    mixed = engine.contact_material("ball", "floor")
    assert mixed.stiffness == pytest.approx(2e4, rel=1e-14)
    # Shares of elastic energy: 2/3 of the ball's damping ratio, (1/3)^2 of the floor's dashpot.
    assert mixed.damping_ratio == pytest.approx(0.1 * 2 / 3, rel=1e-14)
    assert mixed.damping == pytest.approx(50.0 / 9, rel=1e-14)
    assert mixed.restitution is None
    assert mixed.friction == (0.2, 0.2, 0.02, 0.003, 0.003)
    own = Material(7e3, friction=(0.9, 0.1, 0.2), loaded_friction=0.6, friction_load=3.0)
    engine.set_pair_material("ball", "floor", own)
    pair = engine.contact_material("floor", "ball")
    assert (pair.source, pair.stiffness, pair.damping_ratio) == ("pair", 7e3, 1.0)
    assert pair.friction == (0.9, 0.9, 0.1, 0.2, 0.2)
    assert (pair.loaded_friction, pair.friction_load) == (0.6, 3.0)
    assert (mixed.loaded_friction, mixed.friction_load) == (1.0, 10.0)


def test_damping_is_whole_where_one_geom_alone_has_a_material():
    """Beside a floor that nobody set half of the N s/m of a material were left."""
    engine = engine_of()
    engine.set_material("ball", Material(stiffness=1e5, damping=40.0))
    found = engine.contact_material("ball", "floor")
    assert (found.stiffness, found.damping, found.damping_ratio) == (1e5, 40.0, 0.0)
    # Two that are set are two dashpots in series.
    engine.set_material("floor", Material(stiffness=1e5, damping=40.0))
    assert engine.contact_material("ball", "floor").damping == 20.0


@pytest.mark.parametrize("damping", [5.0, 5000.0])
def test_a_damper_without_a_spring_says_nothing_of_a_bounce(damping):
    """What is returned goes by d / sqrt(k m), and k of a rigid contact by the time step.

    5 N s/m left 1 kg all of its speed, 5000 N s/m from 0.79 of it at 0.5 ms to 0.15 at 10 ms.
    """
    message = rf"^Material: damping = {damping:g} N s/m needs a stiffness\. .* restitution in place"
    with pytest.raises(ValueError, match=message):
        Material(damping=damping)
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(Material(1e4, damping=damping), stiffness=None)


def test_a_rigid_contact_of_no_damping_is_elastic():
    engine = engine_of()
    engine.model.opt.gravity[:] = 0.0
    engine.set_material("ball", Material(damping=0.0))
    data = engine.make_data()
    data.qpos[2], data.qvel[2] = 0.101, -1.0
    engine.step(data, 50)
    assert data.qvel[2] == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("stiffness", [1e5, None])
def test_restitution_is_that_of_the_bounce(stiffness):
    engine = engine_of()
    engine.model.opt.gravity[:] = 0.0
    engine.set_material("ball", Material(stiffness=stiffness, restitution=0.7))
    if stiffness is None:
        engine.set_material("floor", Material(restitution=0.7))
    found = engine.contact_material("ball", "floor")
    assert found.stiffness == stiffness
    assert found.damping_ratio == pytest.approx(law.restitution_to_damping_ratio(0.7), rel=1e-12)
    assert found.restitution == pytest.approx(0.7, rel=1e-12)
    data = engine.make_data()
    data.qpos[2], data.qvel[2] = 0.101, -1.0
    engine.step(data, 50)
    assert data.qvel[2] == pytest.approx(found.restitution, rel=1e-9)


def test_questions_without_an_answer_are_errors():
    engine = engine_of()
    engine.model.geom_solref[:] = -1.0, 2.0
    with pytest.raises(ValueError, match="contact of geom 'floor' and geom 'ball': solref"):
        engine.contact_material("ball", "floor")
    with pytest.raises(ValueError, match="same geom"):
        engine.contact_material("ball", 1)
    with pytest.raises(ValueError, match="same geom"):
        engine.pair_material("ball", 1)
    with pytest.raises(ValueError, match="did you mean 'ball'"):
        engine.contact_material("bal", "floor")
    with pytest.raises(ValueError, match="takes no materials"):
        engine_of(law="comfree").contact_material("ball", "floor")
    engine = engine_of(rules=CombinationRules(damping="min"))
    engine.set_material("ball", Material(stiffness=1e4, damping=1.0))
    engine.set_material("floor", Material(stiffness=1e4, damping_ratio=1.0))
    with pytest.raises(ValueError, match="same form"):
        engine.contact_material("ball", "floor")


def test_asking_leaves_the_motion_as_it_is():
    engine, other = engine_of(), engine_of()
    data, same = engine.make_data(), other.make_data()
    for _ in range(20):
        assert isinstance(engine.contact_material("ball", "floor"), dashpot.ContactMaterial)
        engine.step(data)
        other.step(same)
    assert np.array_equal(data.qpos, same.qpos)


@pytest.mark.parametrize(
    ("rule", "named"), [("max", 1.0), ("min", 0.1), ("mean", 0.55), ("geometric_mean", 0.1**0.5)]
)
def test_a_friction_rule_acts_where_a_material_names_friction(rule, named):
    """As `CombinationRules` says; elsewhere friction is MuJoCo's, the larger."""
    xml = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1" friction="1"/>
      <body><freejoint/><geom name="box" type="box" size=".1 .1 .1" friction=".1"/></body>
      </worldbody></mujoco>"""
    engine = Engine(mujoco.MjModel.from_xml_string(xml), rules=CombinationRules(friction=rule))
    assert engine.contact_material("floor", "box").friction[0] == 1.0
    engine.set_material("box", Material(1e4))
    assert engine.contact_material("floor", "box").friction[0] == 1.0
    engine.set_material("box", Material(1e4, friction=0.1))
    assert engine.contact_material("floor", "box").friction[0] == pytest.approx(named, rel=1e-12)


def test_contact_materials_are_asked_for_without_making_all_of_them_again(monkeypatch):
    engine = engine_of()
    made = []
    to_core = Material._to_core
    monkeypatch.setattr(Material, "_to_core", lambda m: (made.append(m), to_core(m))[1])
    for stiffness in (1e4, 2e4):
        engine.set_material("ball", Material(stiffness))
        made.clear()
        for _ in range(3):
            assert engine.contact_material("floor", "ball").stiffness == stiffness
        assert len(made) == 2  # the ball's and the floor's, once
    engine.set_pair_material("floor", "ball", Material(3e4))
    assert engine.contact_material("floor", "ball").stiffness == 3e4


def test_copies_have_materials_of_their_own():
    engine = engine_of()
    engine.set_material("ball", Material(1e4))
    assert engine.contact_material("floor", "ball").stiffness == 1e4
    for other in (copy.copy(engine), pickle.loads(pickle.dumps(engine))):
        other.set_material("ball", Material(2e4))
        assert other.contact_material("floor", "ball").stiffness == 2e4
        assert engine.contact_material("floor", "ball").stiffness == 1e4


def test_edits_of_the_model_reach_contact_materials():
    engine = engine_of()
    assert engine.contact_material("floor", "ball").friction[0] == 1.0
    engine.model.geom_friction[:, 0] = 0.4
    assert engine.contact_material("floor", "ball").friction[0] == 0.4


def test_a_material_that_is_taken_away_leaves_what_the_model_says():
    """A ball that bounced on 1e4 N/m falls bit for bit as one that never had a material."""

    def fallen(engine):
        data = engine.make_data()
        engine.step(data, 50)
        return data.qpos.tobytes()

    engine, untouched = engine_of('solref=".05 1"'), engine_of('solref=".05 1"')
    soft = Material(1e4, restitution=0.5, friction=0.3)
    engine.set_material("ball", soft)
    engine.set_pair_material("floor", "ball", Material(2e4))
    assert fallen(engine) != fallen(untouched)
    engine.set_pair_material("ball", "floor", None)
    assert engine.contact_material("ball", "floor").source == "geoms"
    engine.set_material("ball", None)
    assert engine.contact_material("ball", "floor").source == "solref"
    assert (engine.materials, engine.pair_materials) == ({}, {})
    assert fallen(engine) == fallen(untouched)
    engine.set_material("ball", None)
    with pytest.raises(TypeError, match="it must be a Material or None"):
        engine.set_material("ball", 1e4)


def test_the_report_leaves_out_what_materials_take_the_place_of():
    """By `contact_material` the model's solref is then without effect."""
    soft = Material(1e4)
    pair = '<contact><pair name="p" geom1="ball" geom2="floor" solref=".04 .9"/></contact>'
    engine = engine_of('solref=".03 .8"', 'solref=".01 1.2"', pair)

    def mapped():
        names = (feature.name for feature in engine.report().of("mapped"))
        return [name.removesuffix(" solref/solimp") for name in names if "solref" in name]

    assert mapped() == ["geom 'floor'", "geom 'ball'", "pair 'p'"]
    engine.set_pair_material("ball", "floor", soft)
    assert mapped() == ["geom 'floor'", "geom 'ball'"]
    engine.set_pair_material("ball", "floor", None)
    engine.set_material("ball", soft)
    assert engine.contact_material("floor", "ball").source == "geoms"
    assert mapped() == ["geom 'floor'"]
    engine.set_material("ball", None)
    assert mapped() == ["geom 'floor'", "geom 'ball'", "pair 'p'"]
