"""Materials and fitted values in MJCF: engines of the file move as those that were fitted."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

import dashpot
from ball_throws import BALL, SIDEWAYS, ball_engine, ball_parameters, observe
from dashpot import Material
from dashpot.calibrate import Fit, Parameter, Problem, Trajectory, fit
from dashpot.mjcf_materials import numerics_of

NAMES = ("floor", "a & b", "b", "a", "dashpot:geom:x", "left/finger", "")


def scene_of(names=NAMES, numerics="") -> str:
    geoms = "".join(
        f'<body pos="{i} 0 1"><freejoint/><geom {_named(name)} size=".1"/></body>'
        for i, name in enumerate(names)
    )
    return f"<mujoco><worldbody>{geoms}</worldbody><custom>{numerics}</custom></mujoco>"


def _named(name: str) -> str:
    return f'name="{name.replace("&", "&amp;")}"' if name else ""


@pytest.mark.parametrize(
    "material",
    [
        Material(),
        Material(1234.5678901234567, damping=1 / 3),
        Material(restitution=0.7, friction=0.3),
        Material(1e5, damping_ratio=0.0, friction=(0.5, 0.01, 1e-4), tangential_ratio=0.7),
        Material(1e5, loaded_friction=0.4, friction_load=3.0, tangential_damping_ratio=0.1),
    ],
)
def test_an_engine_reads_the_materials_that_were_written(material):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(scene_of()))
    for geom in (0, 1, 4, 6):
        engine.set_material(geom, material)
    for pair in ((0, 1), (1, 2), (2, 3), (5, 6)):
        engine.set_pair_material(*pair, material)
    spec = mujoco.MjSpec.from_string(scene_of())
    numerics = numerics_of(engine.model, engine.materials, engine.pair_materials)
    for name, data in numerics.items():
        spec.add_numeric(name=name, size=len(data), data=data)
    read = dashpot.Engine(spec.compile())
    assert read.materials == engine.materials
    assert read.pair_materials == engine.pair_materials


def test_materials_of_a_file_count_from_the_start():
    text = scene_of(
        numerics="""<numeric name="dashpot:geom:stiffness:a" data="2e4"/>
        <numeric name="dashpot:geom:friction:a" data="0.2"/>
        <numeric name="dashpot:pair:restitution:a & b &amp; b" data="0.5"/>
        <numeric name="gains" data="1 2 3"/>""".replace("a & b", "a &amp; b")
    )
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(text))
    assert engine.materials == {3: Material(2e4, friction=0.2)}
    assert engine.pair_materials == {(1, 2): Material(restitution=0.5)}
    assert engine.contact_material("a", "floor").stiffness == 2e4
    engine.set_material("a", None)
    assert engine.materials == {}
    # The other law has no materials, and none to read.
    dashpot.Engine(mujoco.MjModel.from_xml_string(text), law="comfree")


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("dashpot:geom:stiffness:ball", "1", "numeric 'dashpot:geom:stiffness:ball' is none of"),
        ("dashpot:geom:stifness:a", "1", "'dashpot:geom:stifness:a'"),
        ("dashpot:joint:stiffness:a", "1", "'dashpot:joint:stiffness:a'"),
        ("dashpot:pair:stiffness:a", "1", "'dashpot:pair:stiffness:a'"),
        ("dashpot:pair:stiffness:a &amp; a", "1", "'dashpot:pair:stiffness:a & a'"),
        ("dashpot:geom:stiffness:#77", "1", "'dashpot:geom:stiffness:#77'"),
        ("dashpot:", "1", "numeric 'dashpot:'"),
        ("dashpot:geom:stiffness:a", "-1", "numerics dashpot:... of a: Material: stiffness"),
        ("dashpot:geom:friction:a", "1 2", "of a: Material: friction"),
        ("dashpot:geom:damping:#6", "5", "of #6: Material: damping"),
    ],
)
def test_numerics_that_mean_nothing_are_named(name, data, message):
    text = scene_of(numerics=f'<numeric name="{name}" data="{data}"/>')
    with pytest.raises(ValueError, match=message):
        dashpot.Engine(mujoco.MjModel.from_xml_string(text))


def fitted_ball() -> Fit:
    parameters = [
        *ball_parameters(),
        Parameter.model("body_mass", "body", start=1.2, bounds=(0.5, 2.0)),
        Parameter.model("geom_size", "ball", index=0, start=0.09, bounds=(0.05, 0.15)),
    ]
    throw = observe(ball_engine(), SIDEWAYS)
    problem = Problem(ball_engine(), parameters, [throw], 1e-4, 1e-3)
    return fit(problem, starts=0, max_evaluations=40)


CART = """<mujoco><compiler angle="degree"/><option timestep="0.001"/>
  <default><geom friction="0.7 0.01 0.001"/></default><worldbody>
  <geom name="pad" type="box" size=".05 .2 .2" pos=".2 0 0" euler="0 0 10"/>
  <body name="cart"><joint name="rail" type="slide" axis="1 0 0"/>
    <geom name="cart" type="box" size=".1 .1 .1" mass=".5"/>
    <body name="arm" pos="0 0 .2"><joint name="hinge" axis="0 1 0" range="-20 30" stiffness=".1"/>
    <geom type="capsule" size=".02" fromto="0 0 0 0 0 .2"/></body></body>
  </worldbody><sensor><jointpos name="place" joint="rail"/></sensor></mujoco>"""


def fitted_cart() -> Fit:
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(CART))
    engine.set_pair_material("cart", "pad", Material(80.0, damping=1.0, friction=0.3))
    parameters = [
        Parameter.pair("cart", "pad", "stiffness", start=60.0, bounds=(10.0, 1e3)),
        Parameter.model("dof_damping", "rail", start=0.1, bounds=(1e-3, 1.0)),
        Parameter.model(
            "geom_pos", "pad", index=0, start=0.21, bounds=(0.18, 0.25), transform="linear"
        ),
    ]
    place = 0.4 * np.linspace(0, 0.3, 30)
    run = Trajectory.of_sensors(
        "run", 0.01 * np.arange(30), {"place": place}, initial_qvel=[0.4, 0.0]
    )
    problem = Problem(engine, parameters, [run], np.inf, np.inf, sensor_sigma={"place": 1e-2})
    return fit(problem, starts=0, max_evaluations=30)


@pytest.fixture(scope="module")
def fits():
    return {"ball": (fitted_ball(), BALL), "cart": (fitted_cart(), CART)}


def moved(engine: dashpot.Engine, steps: int = 300) -> np.ndarray:
    data = engine.make_data()
    data.qvel[0] = 0.5
    engine.step(data, steps)
    return data.qpos.copy()


@pytest.mark.parametrize("which", ["ball", "cart"])
def test_an_engine_of_the_file_moves_as_the_fitted_one(fits, which, tmp_path):
    found, text = fits[which]
    written = found.write_mjcf(tmp_path / "fitted.xml", scene=text)
    engine = dashpot.Engine(mujoco.MjModel.from_xml_path(str(written.path)))
    fitted = found.problem.build(found.values)
    assert engine.materials == fitted.materials
    assert engine.pair_materials == fitted.pair_materials
    np.testing.assert_array_equal(moved(engine), moved(fitted))
    for name in found.values:
        assert name in str(written)


@pytest.mark.parametrize("which", ["ball", "cart"])
def test_a_loaded_fit_writes_the_same_file(fits, which, tmp_path):
    found, text = fits[which]
    loaded = Fit.load(found.save(tmp_path / "fit.json"))
    files = [
        each.write_mjcf(tmp_path / name, scene=text).path
        for each, name in ((found, "own.xml"), (loaded, "loaded.xml"))
    ]
    assert files[0].read_bytes() == files[1].read_bytes()


def test_the_scene_is_found_where_it_was_compiled_last(fits, tmp_path):
    found, text = fits["cart"]
    mujoco.MjModel.from_xml_string(text)
    written = found.write_mjcf(tmp_path / "fitted.xml")
    engine = dashpot.Engine(mujoco.MjModel.from_xml_path(str(written.path)))
    np.testing.assert_array_equal(moved(engine), moved(found.problem.build(found.values)))
    mujoco.MjModel.from_xml_string(BALL)
    with pytest.raises(ValueError, match=r"say what the model was compiled from, as scene="):
        found.write_mjcf(tmp_path / "fitted.xml")


def test_a_fitted_file_is_fitted_again(fits, tmp_path):
    """Numerics that are there give way to those of the fit."""
    found, text = fits["ball"]
    first = found.write_mjcf(tmp_path / "first.xml", scene=text)
    again = Fit.load(found.save(tmp_path / "f.json")).write_mjcf(
        tmp_path / "again.xml", scene=first.path
    )
    names = [
        [model.numeric(i).name for i in range(model.nnumeric)]
        for model in (mujoco.MjModel.from_xml_path(str(w.path)) for w in (first, again))
    ]
    assert sorted(names[0]) == sorted(names[1])


def test_assets_are_found_from_another_folder(tmp_path):
    """Paths of meshes go from where the new file is."""
    corners = [[x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1)]
    faces = [[0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 4, 5], [0, 5, 1], [2, 3, 7],
             [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]  # fmt: skip
    (tmp_path / "scenes" / "meshes").mkdir(parents=True)
    (tmp_path / "out").mkdir()
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    (tmp_path / "scenes" / "meshes" / "cube.obj").write_text("\n".join(lines))
    scene = tmp_path / "scenes" / "scene.xml"
    scene.write_text(
        """<mujoco><compiler meshdir="meshes"/><asset><mesh file="cube.obj"/></asset><worldbody>
        <geom name="floor" type="plane" size="1 1 .1"/><body name="body" pos="0 0 .2"><freejoint/>
        <geom name="ball" type="mesh" mesh="cube" mass="1"/></body></worldbody></mujoco>"""
    )
    engine = dashpot.Engine(mujoco.MjModel.from_xml_path(str(scene)))
    engine.set_material("ball", Material(1e4, damping=20.0))
    stiffness = Parameter.material("ball", "stiffness", start=8e3, bounds=(1e3, 1e5))
    problem = Problem(engine, [stiffness], [observe(engine, np.zeros(6))], 1e-4, 1e-3)
    found = fit(problem, starts=0, max_evaluations=10)
    written = found.write_mjcf(tmp_path / "out" / "fitted.xml", scene=scene)
    read = dashpot.Engine(mujoco.MjModel.from_xml_path(str(written.path)))
    np.testing.assert_array_equal(moved(read), moved(problem.build(found.values)))
    assert str(tmp_path) not in written.path.read_text()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('mass="1"', 'mass="1" friction="0.1"'), "geom_friction differs"),
        (('pos="0 0 0.2"', 'pos="0 0 0.3"'), "body_pos differs"),
        (('name="ball"', 'name="bowl"'), "its geoms are floor, bowl, not floor, ball"),
        (("<worldbody>", '<option gravity="0 0 -1"/><worldbody>'), "opt.gravity differs"),
    ],
)
def test_another_scene_is_refused(fits, tmp_path, change, message):
    found, text = fits["ball"]
    with pytest.raises(ValueError, match=message):
        found.write_mjcf(tmp_path / "fitted.xml", scene=text.replace(*change))
    assert not (tmp_path / "fitted.xml").exists()


def test_what_the_file_does_not_say_is_noted(tmp_path):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL), microsteps=8)
    engine.set_material("ball", Material(1e4, damping=20.0))
    stiffness = Parameter.material("ball", "stiffness", start=8e3, bounds=(1e3, 1e5))
    problem = Problem(
        engine, [stiffness], [observe(ball_engine(), SIDEWAYS)], 1e-4, 1e-3, substeps=3
    )
    notes = str(
        fit(problem, starts=0, max_evaluations=10).write_mjcf(tmp_path / "f.xml", scene=BALL)
    )
    assert "Engine(model, microsteps=8)" in notes
    assert "time steps of 3.33333 ms; that of the file is 5 ms" in notes


@pytest.mark.parametrize(("geom", "points"), [('size="0.1"', 1), ('type="box" size=".1 .1 .1"', 4)])
@pytest.mark.parametrize(("stiffness", "mass"), [(3e3, 1.0), (1e5, 0.2)])
def test_solref_presses_in_at_rest_as_the_material_does(tmp_path, geom, points, stiffness, mass):
    """Under its weight a body sinks in by m g / (n k), in MuJoCo's own steps."""
    text = BALL.replace('size="0.1" mass="1"', f'{geom} mass="{mass}"')
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(text))
    engine.set_pair_material("ball", "floor", Material(stiffness, damping_ratio=0.5, friction=0.4))
    parameter = Parameter.pair(
        "ball", "floor", "stiffness", start=stiffness, bounds=(0.5 * stiffness, 2 * stiffness)
    )
    fall = observe(engine, np.zeros(6), frames=30)
    found = fit(Problem(engine, [parameter], [fall], 1e-4, 1e-3), starts=0, max_evaluations=10)
    written = found.write_mjcf(tmp_path / "f.xml", scene=text, materials="solref")
    assert "floor with ball" in str(written)
    model = mujoco.MjModel.from_xml_path(str(written.path))
    model.opt.timestep = 1e-3
    data = mujoco.MjData(model)
    data.qpos[2] = 0.1
    mujoco.mj_step(model, data, 3000)
    expected = mass * 9.81 / (points * found.values["stiffness"])
    assert 0.1 - data.qpos[2] == pytest.approx(expected, rel=1e-3)


def test_what_solref_cannot_say_is_refused(tmp_path):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL))
    engine.set_pair_material("ball", "floor", Material(1e4, loaded_friction=0.5, friction=0.3))
    stiffness = Parameter.pair("ball", "floor", "stiffness", start=8e3, bounds=(1e3, 1e5))
    throw = observe(engine, SIDEWAYS)
    found = fit(Problem(engine, [stiffness], [throw], 1e-4, 1e-3), starts=0, max_evaluations=10)
    with pytest.raises(ValueError, match="'floor' and 'ball' has friction that falls with load"):
        found.write_mjcf(tmp_path / "f.xml", scene=BALL, materials="solref")
    with pytest.raises(ValueError, match="materials must be 'numeric' or 'solref'"):
        found.write_mjcf(tmp_path / "f.xml", scene=BALL, materials="text")
    with pytest.raises(FileNotFoundError, match="no scene file"):
        found.write_mjcf(tmp_path / "f.xml", scene=Path("nowhere.xml"))


def test_models_tuned_for_mujoco_are_written_too(tmp_path):
    model = mujoco.MjModel.from_xml_string(BALL)
    friction = Parameter.model("geom_friction", "ball", index=0, start=0.5, bounds=(0.1, 2.0))
    throw = observe(ball_engine(), SIDEWAYS)
    found = fit(Problem(model, [friction], [throw], 1e-4, 1e-3), starts=0, max_evaluations=10)
    written = found.write_mjcf(tmp_path / "f.xml", scene=BALL)
    read = mujoco.MjModel.from_xml_path(str(written.path))
    assert read.geom_friction[1, 0] == found.values["geom_friction"]
    assert read.nnumeric == 0
