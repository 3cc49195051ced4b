"""Bad input raises an exception that names the culprit and leaves the data untouched."""

import copy
import pickle
import subprocess
import sys

import mujoco
import numpy as np
import pytest

import dashpot
from scene import free_body, mjcf

BALL = free_body("ball", 'type="sphere" size="0.1" mass="1"', (0, 0, 0.1))


# MuJoCo before 3.17 gives arrays that are not allocated the memory that happens to be there.
UNALLOCATED = ("efc_", "efm_", "island_", "map_", "dof_island", "tree_island", "i")
HIDDEN = ("_",) if mujoco.mj_version() >= 3017000 else ("_", *UNALLOCATED)


def snapshot(data: mujoco.MjData) -> dict[str, bytes]:
    """Every array of the data, and its time."""
    arrays = {"time": np.float64(data.time).tobytes()}
    for name in dir(data):
        if not name.startswith(HIDDEN):
            value = getattr(data, name)
            if isinstance(value, np.ndarray):
                arrays[name] = value.tobytes()
    return arrays


@pytest.fixture
def engine() -> dashpot.Engine:
    return dashpot.Engine(mujoco.MjModel.from_xml_string(mjcf(BALL)))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("field", ["qpos", "qvel", "qfrc_applied", "xfrc_applied"])
def test_state_that_is_not_finite(engine, field, bad):
    data = engine.make_data()
    engine.step(data, nstep=3)
    getattr(data, field).flat[2] = bad
    before = snapshot(data)
    with pytest.raises(ValueError, match=field):
        engine.step(data)
    assert snapshot(data) == before


def test_applied_force_that_is_not_finite_names_the_body(engine):
    data = engine.make_data()
    data.xfrc_applied[engine.model.body("ball").id, 2] = np.nan
    with pytest.raises(ValueError, match=r"^data\.xfrc_applied\[1, 2\] \(body 'ball'\) is nan"):
        engine.step(data)


@pytest.mark.parametrize("time", [np.nan, -np.inf])
def test_time_that_is_not_finite(engine, time):
    data = engine.make_data()
    data.time = time
    before = snapshot(data)
    with pytest.raises(ValueError, match=r"^data\.time is -?(nan|inf); it must be finite"):
        engine.step(data)
    assert snapshot(data) == before


@pytest.mark.parametrize("field", ["qpos", "qvel"])
def test_a_state_that_mujoco_calls_bad_is_refused(engine, field):
    """Beyond mjMAXVAL mj_step resets the data; rollouts refused what steps took."""
    data = engine.make_data()
    getattr(data, field)[1] = -2e10
    before = snapshot(data)
    message = rf"data\.{field}\[1\] is -2e\+10; it must be at most 1e10 in size"
    with pytest.raises(ValueError, match=message):
        engine.step(data)
    assert snapshot(data) == before
    state = np.empty(mujoco.mj_stateSize(engine.model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(engine.model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    with pytest.raises(ValueError, match=message):
        dashpot.rollout(engine, state)


@pytest.mark.parametrize("friction", [np.nan, np.inf, -0.1])
def test_friction_of_the_model_that_is_none_names_the_geom(engine, friction):
    data, model = engine.make_data(), mujoco.MjModel.from_xml_string(mjcf(BALL))
    message = r"^model\.geom_friction of geom 'floor' holds "
    for edited in (engine.model, model):
        edited.geom("floor").friction[2] = friction
    before = snapshot(data)
    with pytest.raises(ValueError, match=message):
        engine.step(data)
    with pytest.raises(ValueError, match=message):
        dashpot.Engine(model)
    assert snapshot(data) == before


def test_friction_of_a_pair_that_is_none_names_the_pair():
    model = mujoco.MjModel.from_xml_string(
        mjcf(BALL, rest='<contact><pair name="p" geom1="floor" geom2="ball"/></contact>')
    )
    model.pair_friction[0, 4] = np.nan
    with pytest.raises(ValueError, match=r"^model\.pair_friction of pair 'p' holds nan"):
        dashpot.Engine(model)


@pytest.mark.parametrize("geom", ["ball", "floor"])
@pytest.mark.parametrize("field", ["geom_solref", "geom_solimp"])
def test_solref_that_is_not_finite_names_the_geom(engine, field, geom):
    data = engine.make_data()
    getattr(engine.model, field)[engine.model.geom(geom).id, -1] = np.nan
    before = snapshot(data)
    with pytest.raises(ValueError, match=rf"^model\.{field} of geom '{geom}' holds nan"):
        engine.step(data, 5)
    assert snapshot(data) == before


def test_control_that_is_not_finite():
    xml = """<mujoco><worldbody><body><joint name="j"/><geom size="0.1"/></body></worldbody>
      <actuator><motor joint="j"/></actuator></mujoco>"""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    data = engine.make_data()
    data.ctrl[0] = np.nan
    before = snapshot(data)
    with pytest.raises(ValueError, match="ctrl"):
        engine.step(data)
    assert snapshot(data) == before


def test_data_of_another_model(engine):
    other_model = mujoco.MjModel.from_xml_string(mjcf(BALL + BALL.replace("ball", "second")))
    for data in (
        mujoco.MjData(other_model),
        dashpot.Engine(other_model).make_data(),
        mujoco.MjData(mujoco.MjModel.from_xml_string(mjcf(BALL))),  # lacks room for the memory
    ):
        before = snapshot(data)
        with pytest.raises(ValueError, match=r"(?i)model|make_data"):
            engine.step(data)
        assert snapshot(data) == before


def test_pickled_data_have_to_agree_with_the_model_in_all_sizes(engine):
    """Pickling loses the signature by which MuJoCo tells models apart."""
    floor_alone = mujoco.MjModel.from_xml_string(mjcf(""))
    of_another = pickle.loads(pickle.dumps(dashpot.Engine(floor_alone).make_data()))
    data = engine.make_data()
    pickled = pickle.loads(pickle.dumps(data))
    assert pickled.signature == 0 != data.signature
    for other in (engine, pickle.loads(pickle.dumps(engine))):
        with pytest.raises(ValueError, match=r"^data was made from another model"):
            other.step(of_another)
        with pytest.raises(ValueError, match=r"^data was made from another model"):
            dashpot.closest(other, of_another, radius=1.0)
        other.step(pickled)
        assert len(other.contacts(pickled)) == 1
        gap = dashpot.distance(other, pickled, "ball", "floor").distance
        assert gap == pytest.approx(0.0, abs=1e-6)  # it sags under its weight
    assert pickled.time == pytest.approx(2 * engine.model.opt.timestep)


@pytest.mark.parametrize("count", [-1.0, 0.5, 1e8, 1e300, np.nan, np.inf])
def test_user_data_that_hold_no_contact_memory(engine, count):
    """The number of contacts remembered comes first in the user data of a model without its own."""
    data = engine.make_data()
    engine.step(data)
    data.userdata[0] = count
    before = snapshot(data)
    for ask in (engine.step, engine.contacts, engine.energy):
        with pytest.raises(ValueError, match=r"data\.userdata.*number of contacts"):
            ask(data)
    assert snapshot(data) == before
    state = np.zeros(mujoco.mj_stateSize(engine.model, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(engine.model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    if np.isfinite(count):
        with pytest.raises(ValueError, match=r"rollout 0, step 0: data\.userdata"):
            dashpot.rollout(engine, state)


def test_the_model_of_an_engine_stays_its_own(engine):
    with pytest.raises(AttributeError, match="model"):
        engine.model = mujoco.MjModel.from_xml_string("<mujoco/>")


@pytest.mark.parametrize("impact", ["none", "cut"])
@pytest.mark.parametrize("geom", [2e9, 0.5, -1.0, np.nan])
def test_user_data_that_remember_contacts_of_no_geom(geom, impact):
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
      <geom type="plane" size="1 1 1"/>
      <body pos="0 0 .1"><freejoint/><geom size=".1"/></body></worldbody></mujoco>""")
    engine = dashpot.Engine(model, impact=impact)
    data = engine.make_data()
    engine.step(data, nstep=50)
    second_geom, _sticking = np.flatnonzero(data.userdata == 1.0)[-2:]
    data.userdata[second_geom] = geom
    with pytest.raises(ValueError, match=r"geom 2 of its contact 0 is"):
        engine.step(data)


@pytest.mark.parametrize("data", [None, 3, "data", np.zeros(7)])
def test_data_of_the_wrong_type(engine, data):
    with pytest.raises(TypeError):
        engine.step(data)


@pytest.mark.parametrize(
    ("nstep", "error", "message"),
    [
        (-1, ValueError, "nstep must be >= 1, got -1"),
        (np.int64(0), ValueError, "nstep must be >= 1, got 0"),
        (1.5, TypeError, "nstep must be an integer, got 1.5"),
        ("2", TypeError, "nstep must be an integer, got '2'"),
        (None, TypeError, "nstep must be an integer, got None"),
        (True, TypeError, "nstep must be an integer, got True"),
    ],
)
def test_bad_number_of_steps(engine, nstep, error, message):
    data = engine.make_data()
    before = snapshot(data)
    with pytest.raises(error, match=message):
        engine.step(data, nstep=nstep)
    assert snapshot(data) == before


def test_counts_may_be_integers_of_numpy():
    model = mujoco.MjModel.from_xml_string(mjcf(BALL))
    engine = dashpot.Engine(model, microsteps=np.int32(5), max_microsteps=np.uint8(8))
    steps, one_by_one = engine.make_data(), engine.make_data()
    stats = engine.step(steps, np.int64(3))
    for _ in range(3):
        engine.step(one_by_one)
    assert stats.microsteps == 5
    assert steps.time == one_by_one.time == pytest.approx(3 * model.opt.timestep)
    assert steps.qpos.tobytes() == one_by_one.qpos.tobytes()


def test_numbers_beyond_the_integers_of_the_core_are_named(engine):
    data, state, beyond = engine.make_data(), np.zeros(14), 2**31
    with pytest.raises(ValueError, match=r"^nstep must be <= 2147483647"):
        engine.step(data, beyond)
    for name in ("nstep", "nthread"):
        with pytest.raises(ValueError, match=f"^{name} must be <= 2147483647"):
            dashpot.rollout(engine, state, **{name: beyond})
    with pytest.raises(ValueError, match=r"^max_microsteps must be <= 2147483647"):
        dashpot.Engine(engine.model, max_microsteps=beyond)
    assert data.time == 0.0


@pytest.mark.parametrize("timestep", [0.0, -0.001, np.nan, np.inf])
def test_bad_timestep(engine, timestep):
    data = engine.make_data()
    engine.model.opt.timestep = timestep
    before = snapshot(data)
    with pytest.raises(ValueError, match="timestep"):
        engine.step(data)
    assert snapshot(data) == before


def test_unknown_geom_names_near_matches(engine):
    unknown = "the model has no geom named"
    with pytest.raises(ValueError, match=f"^geom: {unknown} 'bal1'; did you mean 'ball'"):
        engine.set_material("bal1", dashpot.Material(1e4))
    with pytest.raises(ValueError, match=f"^geom2: {unknown} 'flor'; did you mean 'floor'"):
        engine.set_pair_material("ball", "flor", dashpot.Material(1e4))
    with pytest.raises(ValueError, match=f"^geom1: {unknown} 'xyz'$"):
        engine.pair_material("xyz", "floor")
    for geom in (-1, 2, 10**9):
        with pytest.raises(ValueError, match=f"^geom = {geom} is not a geom id of the model, 0 to"):
            engine.set_material(geom, dashpot.Material(1e4))
    for geom in (0.5, True, None):
        with pytest.raises(TypeError, match=r"^geom must be a geom name or id"):
            engine.geom_id(geom)
    assert engine.geom_id(np.int64(1)) == engine.geom_id(engine.model.geom(1).name) == 1
    with pytest.raises(TypeError):
        engine.set_material("ball", 1e4)


@pytest.mark.parametrize(
    ("arguments", "culprit"),
    [
        ({"stiffness": -1.0}, "stiffness"),
        ({"stiffness": 0.0}, "stiffness"),
        ({"stiffness": np.nan}, "stiffness"),
        ({"stiffness": np.inf}, "stiffness"),
        ({"stiffness": 1e4, "damping": -0.1}, "damping"),
        ({"stiffness": 1e4, "damping": np.nan}, "damping"),
        ({"stiffness": 1e4, "damping_ratio": -0.1}, "damping_ratio"),
        ({"stiffness": 1e4, "restitution": 1.01}, "restitution"),
        ({"stiffness": 1e4, "restitution": -0.01}, "restitution"),
        ({"stiffness": 1e4, "restitution": np.nan}, "restitution"),
        ({"stiffness": 1e4, "restitution": 0.5, "damping": 3.0}, "restitution"),
        ({"stiffness": 1e4, "damping_ratio": 0.5, "damping": 3.0}, "damping_ratio"),
        ({"friction": -0.1}, "friction"),
        ({"friction": np.nan}, "friction"),
        ({"friction": (0.5, 0.1)}, "friction"),
        ({"friction": (0.5, 0.1, -1e-4)}, "friction"),
        ({"tangential_ratio": 0.0}, "tangential_ratio"),
        ({"tangential_ratio": np.inf}, "tangential_ratio"),
        ({"tangential_damping_ratio": -1.0}, "tangential_damping_ratio"),
    ],
)
def test_bad_material(arguments, culprit):
    with pytest.raises(ValueError, match=culprit):
        dashpot.Material(**arguments)


@pytest.mark.parametrize("value", ["soft", [1e4], True])
def test_material_of_the_wrong_type(value):
    with pytest.raises(TypeError, match="stiffness"):
        dashpot.Material(value)


@pytest.mark.parametrize(
    "take",
    [
        lambda engine, name: engine.geom_id(name),
        lambda engine, name: engine.set_material(name, dashpot.Material(1e4)),
        lambda engine, name: engine.set_pair_material(name, "floor", dashpot.Material(1e4)),
        lambda engine, name: engine.contact_material(name, "floor"),
    ],
)
def test_a_name_ends_where_it_ends(engine, take):
    """MuJoCo would read it to the first NUL."""
    take(engine, "ball")
    with pytest.raises(ValueError, match=r"no geom named 'ball\\x00 or not'"):
        take(engine, "ball\0 or not")


def test_materials_do_not_change():
    material = dashpot.Material(1e4)
    with pytest.raises(AttributeError):
        material.stiffness = 2e4


@pytest.mark.parametrize(
    ("arguments", "culprit"),
    [
        ({"law": "hertz"}, "law"),
        ({"microsteps": 0}, "microsteps"),
        ({"microsteps": "many"}, "microsteps"),
        ({"microsteps": np.int64(9), "max_microsteps": 8}, "microsteps is 9, more than"),
        ({"max_microsteps": 0}, "max_microsteps"),
        ({"recovery_speed": -0.1}, "recovery_speed"),
        ({"recovery_speed": np.nan}, "recovery_speed"),
    ],
)
def test_bad_engine_option(arguments, culprit):
    model = mujoco.MjModel.from_xml_string(mjcf(BALL))
    with pytest.raises(ValueError, match=culprit):
        dashpot.Engine(model, **arguments)


@pytest.mark.parametrize("count", [2.0, None, True])
def test_numbers_of_microsteps_are_integers(count):
    model = mujoco.MjModel.from_xml_string(mjcf(BALL))
    with pytest.raises(TypeError, match=r'^microsteps other than "auto" must be an integer'):
        dashpot.Engine(model, microsteps=count)
    with pytest.raises(TypeError, match=r"^max_microsteps must be an integer"):
        dashpot.Engine(model, max_microsteps=count)


@pytest.mark.parametrize("speed", [None, True, "fast"])
def test_recovery_speed_is_a_number(speed):
    model = mujoco.MjModel.from_xml_string(mjcf(BALL))
    with pytest.raises(TypeError, match=r"^recovery_speed must be a number"):
        dashpot.Engine(model, recovery_speed=speed)
    dashpot.Engine(model, recovery_speed=np.float32(0.1))


@pytest.mark.parametrize("rules", [0, "", "max"])
def test_rules_are_combination_rules(rules):
    model = mujoco.MjModel.from_xml_string(mjcf(BALL))
    with pytest.raises(TypeError, match="it must be CombinationRules"):
        dashpot.Engine(model, rules=rules)


def test_bad_combination_rule():
    with pytest.raises(ValueError, match="friction"):
        dashpot.CombinationRules(friction="sum")


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_cuts_that_do_not_see_flexes_are_refused_when_the_engine_is_made(dim):
    counts = " ".join("3" if axis < dim else "1" for axis in range(3))
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><flexcomp name="c" type="grid" count="{counts}"
          spacing=".1 .1 .1" dim="{dim}"><edge equality="true"/></flexcomp></worldbody></mujoco>"""
    )
    dashpot.Engine(model)
    with pytest.raises(ValueError, match='impact "cut" does not see flexes'):
        dashpot.Engine(model, impact="cut")


def test_engine_of_something_else():
    with pytest.raises(TypeError, match="model is int; it must be"):
        dashpot.Engine(3)


def test_the_complementarity_free_law_in_the_metric_of_discrete():
    model = mujoco.MjModel.from_xml_string(mjcf(BALL, option='integrator="discrete"'))
    with pytest.raises(ValueError, match="integrator=discrete"):
        dashpot.Engine(model, law="comfree")


def test_integrator_changed_after_the_engine_was_made(engine):
    data = engine.make_data()
    engine.model.opt.integrator = 5  # MuJoCo has none of this number
    before = snapshot(data)
    with pytest.raises(ValueError, match="integrator=unknown"):
        engine.step(data)
    assert snapshot(data) == before


def test_a_flag_that_contact_memory_cannot_follow():
    rest = '<option><flag override="enable"/></option>'
    with pytest.raises(ValueError, match="override"):
        dashpot.Engine(mujoco.MjModel.from_xml_string(mjcf(BALL, rest=rest)))


@pytest.mark.skipif(
    mujoco.mj_version() < 4000000,
    reason="MuJoCo before 4.0 has neither speculative contacts nor plastic deformation",
)
def test_what_mujoco_4_does_within_mj_step_alone():
    rest = '<option><flag speculative="enable"/></option>'
    with pytest.raises(ValueError, match="flag speculative"):
        dashpot.Engine(mujoco.MjModel.from_xml_string(mjcf(BALL, rest=rest)))
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(mjcf(BALL)))
    engine.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_SPECULATIVE
    with pytest.raises(ValueError, match="flag speculative"):
        engine.step(engine.make_data())
    hinge = '<body><joint stiffness="1" springyield=".1"/><geom size=".1"/></body>'
    rod = """<flexcomp name="rod" type="grid" count="5 1 1" spacing=".1 .1 .1" dim="1"
      radius=".01" mass="1"><elasticity young="1e6"/></flexcomp>"""
    for plastic in (hinge, rod):
        with pytest.raises(ValueError, match=r"plastic deformation \(springyield, yield"):
            dashpot.Engine(mujoco.MjModel.from_xml_string(mjcf(plastic)))


def test_an_engine_says_what_it_is():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(mjcf(BALL)))
    engine.set_material(0, dashpot.Material(1e4))
    shown = repr(engine)
    assert shown.startswith("Engine(law='kelvin_voigt', timestep=")
    assert shown.endswith(f"geoms={engine.model.ngeom}, materials=1, pair_materials=0)")


OPTIONS = {
    "microsteps": 20,
    "max_microsteps": 40,
    "recovery_speed": 0.5,
    "mocap_timeconst": 0.01,
    "impact": "cut",
    "rules": dashpot.CombinationRules(friction="min"),
    "nthread": 2,
}


def test_an_engine_tells_its_options_and_keeps_them():
    model = mujoco.MjModel.from_xml_string(mjcf(BALL))
    engine = dashpot.Engine(model, **OPTIONS)
    assert {name: getattr(engine, name) for name in OPTIONS} == OPTIONS
    for copied in (copy.copy(engine), copy.deepcopy(engine), pickle.loads(pickle.dumps(engine))):
        assert repr(copied) == repr(engine)
    for name, value in OPTIONS.items():
        assert f"{name}={value!r}" in repr(engine)
        assert name not in repr(dashpot.Engine(model))
        with pytest.raises(AttributeError, match=name):
            setattr(engine, name, value)
    explicit = dashpot.Engine(model, law="comfree", comfree_damping=0.01)
    assert (explicit.comfree_stiffness, explicit.comfree_damping) == (0.2, 0.01)
    assert (engine.comfree_stiffness, engine.comfree_damping) == (None, None)
    assert repr(explicit).startswith("Engine(law='comfree', ")


class NamedEngine(dashpot.Engine):
    """An engine with something of its own."""

    label = "none"


@pytest.mark.parametrize(
    "duplicate", [copy.copy, copy.deepcopy, lambda engine: pickle.loads(pickle.dumps(engine))]
)
def test_copies_of_engines_of_a_subclass_keep_what_it_adds(duplicate):
    engine = NamedEngine(mujoco.MjModel.from_xml_string(mjcf(BALL)))
    engine.label = "mine"
    copied = duplicate(engine)
    assert type(copied) is NamedEngine
    assert copied.label == "mine"
    assert copied.model is not engine.model
    copied.step(copied.make_data())


def test_everything_can_be_imported_without_libraries_that_are_not_installed_with_dashpot():
    """A star import, or hasattr, failed where dm_control was missing."""
    script = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {"dm_control", "gymnasium", "robosuite", "myosuite"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
from dashpot import *
import dashpot
assert not hasattr(dashpot, "dm_control")
try:
    dashpot.dm_control
except AttributeError as error:
    assert str(error) == "dashpot.dm_control needs dm_control, which is not installed", error
else:
    raise AssertionError("dm_control was found")
"""
    subprocess.run([sys.executable, "-c", script], check=True)


@pytest.mark.parametrize("name", ["nthreads", "microstep", "timestep"])
def test_an_engine_takes_no_attributes_that_it_does_not_know(engine, name):
    """A misspelled option was stored, and did nothing."""
    with pytest.raises(AttributeError, match=name):
        setattr(engine, name, 4)


def test_an_engine_does_not_touch_the_models_original():
    model = mujoco.MjModel.from_xml_string(mjcf(BALL))
    margin, nuserdata = model.geom_margin.copy(), model.nuserdata
    engine = dashpot.Engine(model)
    engine.step(engine.make_data(), nstep=5)
    np.testing.assert_array_equal(model.geom_margin, margin)
    assert model.nuserdata == nuserdata
    # Detection is widened only while a step runs.
    np.testing.assert_array_equal(engine.model.geom_margin, margin)


def test_a_model_that_diverges_without_contact_is_an_error_that_keeps_the_state():
    # An explicit velocity gain whose time constant is a fiftieth of the step.
    model = mujoco.MjModel.from_xml_string("""<mujoco><option timestep="0.01"/><worldbody><body>
      <joint name="j" type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body></worldbody>
      <actuator><velocity joint="j" kv="5000"/></actuator></mujoco>""")
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qvel[0] = 1.0
    with pytest.raises(dashpot.DivergenceError, match="degree of freedom 0"):
        engine.step(data, 1000)
    assert np.isfinite(data.qpos).all()
    assert np.isfinite(data.qvel).all()


def test_a_report_prints_like_features_as_one():
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody>" + "".join(
        f'<geom name="{name}" size=".1" pos="{i} 0 0" solref=".003 1"/>'
        for i, name in enumerate(["pot", "lid", "it's", "jar", "cup"])
    ) + '<geom size=".1" pos="0 1 0" surfacevel="1 0 0 0 0 0"/></worldbody></mujoco>')  # fmt: skip
    report = dashpot.Engine(model).report()
    assert sum("solref" in feature.name for feature in report.features) == 5
    lines = str(report).splitlines()
    assert sum(line.startswith("mapped    geom 'pot', 'lid' and 3 more solref/") for line in lines)
    assert sum(line.startswith("honoured  geom #5 surfacevel: sliding") for line in lines)
    assert len(lines) == len(report.features) - 4


def test_a_friction_reference_of_its_own_is_reported_as_mapped():
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
      <geom name="floor" type="plane" size="1 1 1"/><body pos="0 0 1"><freejoint/>
      <geom name="ball" size=".1"/></body></worldbody><contact>
      <pair name="p" geom1="floor" geom2="ball" solreffriction="0.01 1"/></contact></mujoco>""")
    report = dashpot.Engine(model).report()
    with pytest.raises(ValueError, match="treatment must be one of honoured, mapped, refused"):
        report.of("honored")
    mapped = [feature.name for feature in report.of("mapped")]
    assert "pair 'p' solreffriction" in mapped


# A solref of mixed signs, which MuJoCo replaces by its default with a warning on stderr.
LIMITED = """<mujoco><option timestep="0.01"/><worldbody><body>
  <joint name="knee" axis="0 1 0" range="-1 1" limited="true" {joint}/>
  <geom type="capsule" size=".02" fromto="0 0 0 .5 0 0" mass="1"/><site name="tip" pos=".5 0 0"/>
  </body><site name="anchor" pos="0 0 1"/></worldbody>
  <tendon><spatial name="cord" range="0 1.2" limited="true" {tendon}>
    <site site="tip"/><site site="anchor"/></spatial></tendon>
  <equality><joint name="lock" joint1="knee" {equality}/></equality></mujoco>"""


@pytest.mark.parametrize(
    ("part", "attribute", "name"),
    [
        ("joint", 'solreflimit="-5000 50"', "jnt_solref of joint 'knee'"),
        ("joint", 'frictionloss=".1" solreffriction="0 1"', "dof_solref of joint 'knee'"),
        ("tendon", 'solreflimit="-5000 50"', "tendon_solref_lim of tendon 'cord'"),
        ("tendon", 'frictionloss=".1" solreffriction="1 0"', "tendon_solref_fri of tendon 'cord'"),
        ("equality", 'solref="5000 -50"', "eq_solref of equality 'lock'"),
    ],
)
def test_a_solref_without_a_meaning_names_what_has_it(part, attribute, name):
    parts = {"joint": "", "tendon": "", "equality": "active='false'", part: attribute}
    model = mujoco.MjModel.from_xml_string(LIMITED.format(**parts))
    with pytest.raises(ValueError, match=rf"model\.{name} is .* two positive numbers"):
        dashpot.Engine(model)
