"""A first hour: models as files, results that print as tables, mistakes that are noticed."""

from __future__ import annotations

import copy
import pickle
import warnings

import mujoco
import numpy as np
import pytest

import typed_calls
from dashpot import Engine, Material, compare

WEIGHT = 9.81  # N, of the ball


def resting_ball() -> tuple[Engine, mujoco.MjData]:
    engine = Engine(typed_calls.SCENE)
    data = engine.make_data()
    engine.step(data, nstep=500)
    return engine, data


def test_a_model_is_given_compiled_as_specification_file_or_text(tmp_path):
    heights = set()
    for engine in typed_calls.engines(tmp_path):
        data = engine.make_data()
        engine.step(data, nstep=50)
        heights.add(float(data.qpos[2]))
    assert len(heights) == 1


def test_what_is_no_model_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no model file .*none\.xml"):
        Engine(tmp_path / "none.xml")
    (tmp_path / "broken.xml").write_text(
        "<mujoco><worldbody><geom type='no'/></worldbody></mujoco>"
    )
    with pytest.raises(ValueError, match=r"broken\.xml: .*no"):
        Engine(tmp_path / "broken.xml")
    with pytest.raises(ValueError, match="XML"):
        Engine("<mujoco><worldbody>")
    with pytest.raises(TypeError, match=r"model is int; it must be a mujoco\.MjModel, a mujoco"):
        Engine(3)
    with pytest.raises(FileNotFoundError, match=r"none\.xml; shipped scenes are ball, slope"):
        compare.run(tmp_path / "none.xml")


def test_a_specification_is_compared_too():
    spec = mujoco.MjSpec.from_string(typed_calls.SCENE)
    assert compare.run(spec, duration=0.01, settings="dashpot").scene == "model"


def test_calls_that_mypy_accepts_work():
    engine = Engine(typed_calls.SCENE)
    typed_calls.materials(engine)
    assert engine.contact_material("ball", "floor").stiffness == 2e4
    assert set(typed_calls.contacts(engine)) == {1}
    for parameter in typed_calls.parameters():
        assert all(low < high for low, high in np.reshape(parameter.bounds, (-1, 2)))
    assert typed_calls.picture().origin == (320.0, 420.0)


def test_contacts_print_names_and_units():
    engine, data = resting_ball()
    contacts = engine.contacts(data)
    assert contacts.names.tolist() == [["floor", "ball"]]
    text = str(contacts)
    assert text == repr(contacts)
    assert text.startswith("1 contact\n")
    for word in ("floor", "ball", "[m]", "[N]", "yes", f"{contacts.force[0, 0]:.4g}"):
        assert word in text.split()
    # A single one of them has a row too.
    assert repr(contacts[0]) == text
    html = contacts._repr_html_()
    assert html.startswith("<table")
    assert "normal force [N]" in html
    assert str(contacts[:0]).startswith("0 contacts")
    assert pickle.loads(pickle.dumps(contacts)).names[0, 1] == "ball"


def test_a_geom_or_flex_without_a_name_has_its_number():
    cloth = """<mujoco><option timestep=".001"/><worldbody><geom type="plane" size="1 1 1"/>
      <flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" pos="0 0 .02"
                radius=".02" mass=".1" dim="2"><edge equality="true"/></flexcomp>
      </worldbody></mujoco>"""
    engine = Engine(cloth)
    data = engine.make_data()
    engine.step(data, nstep=5)
    names = engine.contacts(data).names
    assert len(names) > 0
    assert set(names.ravel()) == {"geom 0", "cloth"}


def test_many_contacts_print_the_first_twenty():
    engine = Engine(compare.scene("pile").xml)
    data = engine.make_data()
    engine.step(data, nstep=300)
    contacts = engine.contacts(data)
    lines = str(contacts).splitlines()
    assert lines[-1] == f"and {len(contacts) - 20} more"
    assert len(lines) < 30
    assert max(map(len, lines)) <= 100
    assert not any("…" in line for line in lines)


def test_energy_prints_every_account_with_its_unit():
    engine, data = resting_ball()
    energy = engine.energy(data)
    text = str(energy)
    for name in ("kinetic", "mechanical", "dissipated_normal", "dissipated", "work", "total"):
        (line,) = (line for line in text.splitlines() if line.split()[:1] == [name])
        assert float(line.split()[1]) == pytest.approx(getattr(energy, name), rel=1e-5, abs=1e-300)
    assert "[J]" in text
    assert energy._repr_html_().startswith("<table")


def test_mj_step_between_two_steps_is_noticed():
    engine, data = resting_ball()
    mujoco.mj_step(engine.model, data)
    with pytest.warns(UserWarning, match="mj_step moved these data since the last") as noticed:
        engine.step(data)
    assert noticed[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        engine.step(data)
        # A user who makes an error of it finds the data as they were.
        mujoco.mj_step(engine.model, data)
        time = data.time
        with pytest.raises(UserWarning, match="mj_step"):
            engine.step(data)
        assert data.time == time


def test_what_is_no_mistake_beside_engine_steps_passes_silently():
    """`mj_step1` for a controller, `mj_forward`, a reset, and MuJoCo before the first step."""
    engine = Engine(typed_calls.SCENE)
    data, others = engine.make_data(), engine.make_data()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mujoco.mj_step(engine.model, data, nstep=10)
        for _ in range(3):
            engine.step(data)
            mujoco.mj_step1(engine.model, data)
            engine.step(data)
            mujoco.mj_forward(engine.model, data)
            mujoco.mj_step(engine.model, others)
        mujoco.mj_resetData(engine.model, data)
        engine.step(data)
        mujoco.mj_step(engine.model, data)
        mujoco.mj_resetData(engine.model, data)
        engine.step(data)


def step_four_times(engine: Engine, data: mujoco.MjData) -> None:
    """Edits are looked for in the first step, the fourth, the sixteenth, and so on."""
    for _ in range(4):
        engine.step(data)


def test_an_edit_of_the_model_in_place_of_the_engines_is_noticed():
    model = mujoco.MjModel.from_xml_string(typed_calls.SCENE)
    engine = Engine(model)
    data = engine.make_data()
    engine.step(data)
    model.geom_friction[:, 0] = 0.1
    model.opt.timestep = 1e-3
    with pytest.warns(UserWarning, match=r"opt\.timestep and 1 more .* edit engine\.model\.opt"):
        step_four_times(engine, data)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # once is enough
        for _ in range(100):
            engine.step(data)


def test_edits_that_an_engine_has_pass_silently():
    """Of the engine's own model, and of a model that the next engine is made of."""
    model = mujoco.MjModel.from_xml_string(typed_calls.SCENE)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        engines = []
        for friction in (0.2, 0.4):
            model.geom_friction[:, 0] = friction
            engines.append(Engine(model))
        engines.append(Engine(engines[0].model))
        engines.append(copy.copy(engines[0]))
        engines[0].model.geom_friction[:, 0] = 0.8
        del model
        for engine in engines:
            data = engine.make_data()
            for _ in range(4):
                engine.step(data)


def test_solver_options_that_no_engine_reads_may_change():
    model = mujoco.MjModel.from_xml_string(typed_calls.SCENE)
    engine = Engine(model)
    model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    model.opt.iterations = 3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        engine.step(engine.make_data())


def test_materials_print_in_contacts_what_they_do():
    """The compression column times the stiffness is the normal force that stands beside it."""
    engine = Engine(typed_calls.SCENE)
    engine.set_pair_material("ball", "floor", Material(1e4, damping_ratio=1.0))
    data = engine.make_data()
    engine.step(data, nstep=1000)
    row = str(engine.contacts(data)).splitlines()[-1].split()
    compression, force = float(row[6]), float(row[7])
    assert force == pytest.approx(WEIGHT, rel=1e-3)
    assert 1e4 * compression == pytest.approx(force, rel=1e-2)  # three digits are printed
