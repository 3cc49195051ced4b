"""Friction of a geom that no contact takes is said; what a contact takes says whether it does."""

import warnings

import mujoco
import numpy as np
import pytest

from dashpot import CombinationRules, Engine, Material
from dashpot.calibrate import Parameter, Problem, Trajectory, fit

SCENE = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="5 5 .1" {floor}/>
  <geom name="wall" type="box" pos="3 0 0" size=".1 1 1" friction=".01 .005 .0001"/>
  <body name="puck" pos="0 0 .05"><freejoint/>
    <geom name="disc" type="box" size=".1 .1 .05" mass="1" contype="{kind}" conaffinity="{kind}"
      {disc}/></body>
</worldbody>{more}</mujoco>"""


def model_of(floor="", disc="", more="", kind=1, wall=False):
    xml = SCENE.format(floor=floor, disc=disc, more=more, kind=kind)
    model = mujoco.MjModel.from_xml_string(xml)
    if not wall:
        model.geom_contype[1] = model.geom_conaffinity[1] = 0
    return model


def assert_names(text, *names):
    assert all(f"'{name}'" in text for name in names), text


def said_of(call):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    assert all(issubclass(w.category, UserWarning) and w.filename == __file__ for w in caught)
    return [str(w.message) for w in caught]


CASES = [
    # floor, disc, rule, friction of the disc, and of the floor's material
    ("", "", "max", 0.3, None),
    ('friction="1.4"', "", "max", 1.3, None),
    ("", "", "max", 0.3, 0.6),
    ("", "", "max", 0.6, 0.3),
    ('priority="1" friction=".2"', "", "max", 0.3, None),
    ('priority="1"', 'priority="2"', "max", 0.3, None),
    ("", "", "min", 0.3, 0.6),
    ("", "", "min", 1.3, None),
    ("", "", "mean", 0.3, None),
    ("", "", "geometric_mean", 0.3, 0.9),
    ('friction="0"', "", "max", 0.0, None),
    ("", 'condim="4"', "max", (1.2, 0.003, 0.0), None),
    ("", 'condim="4"', "max", (0.9, 0.02, 0.0), None),
    ('friction="1 .005 .01"', 'condim="6"', "max", (2.0, 0.02, 0.002), None),
]


@pytest.mark.parametrize(("floor", "disc", "rule", "friction", "other"), CASES)
def test_a_coefficient_is_said_to_be_idle_where_the_contact_does_not_change_with_it(
    floor, disc, rule, friction, other
):
    rules = CombinationRules(friction=rule)
    engine = Engine(model_of(floor, disc), rules=rules)
    if other is not None:
        said_of(lambda: engine.set_material("floor", Material(friction=other)))
    said = said_of(lambda: engine.set_material("disc", Material(friction=friction)))

    def taken(numbers):
        engine.set_material("disc", Material(friction=numbers))
        found = engine.contact_material("disc", "floor")
        return np.array(found.friction)[[0, 2, 3]][: {3: 1, 4: 2, 6: 3}[found.condim]]

    given = np.atleast_1d(friction)
    own = np.concatenate([given, engine.model.geom_friction[2, len(given) :]])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        base = taken(own)
        changes = np.array(
            [taken(own + 1e-3 * np.eye(3)[i])[: base.size] != base for i in range(3)]
        )
    acts = changes.diagonal()
    idle = [
        name
        for name, named, works in zip(("sliding", "torsional", "rolling"), given, acts)  # noqa: B905
        if not works
    ]
    if not idle:
        assert said == []
        return
    (text,) = said
    assert text.startswith(f"{idle[0]} friction")
    assert_names(text, "disc", "floor")


def test_friction_that_acts_on_one_of_several_is_no_fault():
    """The wall has 0.01: 0.3 acts there, though not on the floor."""
    engine = Engine(model_of(wall=True))
    assert said_of(lambda: engine.set_material("disc", Material(friction=0.3))) == []
    # Floor and wall never touch each other.
    (text,) = said_of(lambda: engine.set_material("wall", Material(friction=0.2)))
    assert_names(text, "wall", "disc")


def test_pairs_with_friction_of_their_own_are_left_out():
    engine = Engine(model_of())
    engine.set_pair_material("disc", "floor", Material(friction=0.2))
    assert said_of(lambda: engine.set_material("disc", Material(friction=0.3))) == []


def test_excluded_and_masked_geoms_are_no_partners():
    excluded = model_of(more='<contact><exclude body1="world" body2="puck"/></contact>')
    assert said_of(lambda: Engine(excluded).set_material("disc", Material(friction=0.3))) == []
    masked = Engine(model_of(kind=2))
    assert said_of(lambda: masked.set_material("disc", Material(friction=0.3))) == []
    listed = model_of(kind=2, more='<contact><pair geom1="disc" geom2="floor"/></contact>')
    (text,) = said_of(lambda: Engine(listed).set_material("disc", Material(friction=0.3)))
    assert "'floor'" in text


def test_friction_of_0_leaves_it_to_the_material_of_the_other():
    engine = Engine(model_of())
    given = {"disc": Material(friction=0.3), "floor": Material(friction=0.0)}
    assert said_of(lambda: engine.set_materials(given)) == []
    engine.set_material("disc", None)
    (text,) = said_of(lambda: engine.set_material("floor", Material(friction=0.0)))
    assert_names(text, "floor")


def test_materials_without_friction_say_nothing():
    engine = Engine(model_of())
    assert said_of(lambda: engine.set_material("disc", Material(2e4, restitution=0.3))) == []
    assert said_of(lambda: engine.set_material("disc", None)) == []


def test_both_geoms_are_set_in_one_call():
    engine = Engine(model_of())
    low = {"disc": Material(friction=0.3), "floor": Material(2e4, friction=0.3)}
    assert said_of(lambda: engine.set_materials(low)) == []
    assert engine.contact_material("disc", "floor").friction[0] == 0.3
    assert engine.materials == {2: low["disc"], 0: low["floor"]}
    engine.set_materials({"disc": None, 0: None})
    assert engine.materials == {}


@pytest.mark.parametrize("bad", [{"nothing": Material()}, {"floor": 0.3}])
def test_nothing_is_set_where_one_of_several_is_refused(bad):
    engine = Engine(model_of())
    with pytest.raises((TypeError, ValueError)):
        engine.set_materials({"disc": Material(friction=2.0), **bad})
    assert engine.materials == {}


def slide(friction=0.3, frames=12):
    """Return what is seen at 50 Hz of a puck that slides at 1 m/s and is slowed by friction."""
    time = 0.02 * np.arange(frames)
    position = np.zeros((frames, 1, 3))
    position[:, 0, 0] = time - 0.5 * friction * 9.81 * time**2
    position[:, 0, 2] = 0.05
    quaternion = np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1, 1))
    return Trajectory(
        "slide",
        time,
        position,
        quaternion,
        ("puck",),
        initial_qpos=[0, 0, 0.05, 1, 0, 0, 0],
        initial_qvel=[1, 0, 0, 0, 0, 0],
    )


def fit_says(engine, *parameters):
    problem = Problem(engine, parameters, [slide()], 1e-3, 1e-2)
    return said_of(lambda: fit(problem, starts=0, max_evaluations=4))


def of_geom(geoms, bounds, name="mu"):
    start = 0.5 * sum(bounds)
    return Parameter.material(geoms, "sliding_friction", start=start, bounds=bounds, name=name)


OWN = Parameter.model("geom_friction", "disc", index=0, start=0.3, bounds=(0.1, 0.9), name="mu")
TWO = of_geom("disc", (0.1, 0.9)), of_geom("floor", (0.92, 1.5), "floor_mu")


@pytest.mark.parametrize(
    ("make", "parameters"),
    [
        (Engine, (of_geom("disc", (0.1, 0.9)),)),
        (Engine, (of_geom("floor", (0.1, 0.9)),)),
        (Engine, TWO),
        (Engine, (OWN,)),
        (lambda model: model, (OWN,)),
    ],
)
def test_a_fit_names_friction_that_acts_nowhere_between_its_bounds(make, parameters):
    (text,) = fit_says(make(model_of()), *parameters)
    assert_names(text, "mu", "disc", "floor")


@pytest.mark.parametrize(
    "parameters",
    [
        (of_geom("disc", (0.1, 1.2)),),
        (of_geom(("disc", "floor"), (0.1, 0.9)),),
        (Parameter.pair("disc", "floor", "sliding_friction", start=0.4, bounds=(0.1, 0.9)),),
        (of_geom("disc", (0.1, 0.9)), of_geom("floor", (0.5, 1.5), "floor_mu")),
        (Parameter.model("body_mass", "puck", start=1.0, bounds=(0.5, 2.0)),),
    ],
)
def test_a_fit_says_nothing_of_friction_that_may_act(parameters):
    assert fit_says(Engine(model_of()), *parameters) == []
