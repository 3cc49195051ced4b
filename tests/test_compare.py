"""Comparison: every run starts alike, is measured alike, and says what closed forms say."""

from __future__ import annotations

import json
from dataclasses import fields

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot import compare
from dashpot.compare.settings import direct_solref, mujoco_model

BALL = """
<mujoco>
  <option timestep="0.001"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="ball" pos="0 0 {height}">
      <freejoint/>
      <geom name="ball" type="sphere" size=".1" mass="2"/>
    </body>
  </worldbody>
</mujoco>"""
ALL = ("dashpot", *compare.SETTINGS)


def test_all_settings_start_alike_and_are_measured_alike():
    """1 mm of overlap and m g z of energy are the model's, whoever steps it."""
    comparison = compare.run(BALL.format(height=0.099), duration=0.002, settings=ALL)
    assert [run.name for run in comparison.runs] == list(ALL)
    for run in comparison.runs:
        assert run.penetration_max[0] == pytest.approx(1e-3, rel=1e-12)
        assert run.penetration_mean[0] == pytest.approx(1e-3, rel=1e-12)
        assert run.contacts[0] == 1
        assert run.kinetic[0] == 0
        assert run.potential[0] == pytest.approx(2 * 9.81 * 0.099, rel=1e-12)
        assert len(run.time) == 3


def test_margin_does_not_count_as_penetration():
    xml = BALL.format(height=0.101).replace('size=".1" mass', 'margin=".05" size=".1" mass')
    comparison = compare.run(xml, duration=0.001, settings=["mujoco-default"])
    assert comparison.runs[0].contacts[0] == 0
    assert comparison.runs[0].penetration_max[0] == 0


def test_free_fall_loses_nothing_and_has_no_penetration():
    comparison = compare.run(BALL.format(height=5), duration=0.2, settings=["dashpot"])
    assert list(comparison) == ["dashpot"]
    assert "elliptic" not in comparison
    with pytest.raises(ValueError, match="settled_after must be a time, got nan"):
        comparison["dashpot"].statistics(np.nan)
    run = comparison["dashpot"]
    # g t²/2 below and m v²/2 with v = g t: the exact parabola of the engine.
    assert run.kinetic[-1] == pytest.approx((9.81 * 0.2) ** 2, rel=1e-9)
    assert run.position[2] == pytest.approx(5 - 9.81 * 0.2**2 / 2, rel=1e-9)
    statistics = comparison.statistics()["dashpot"]
    assert statistics.energy_gained < 1e-9
    assert abs(statistics.energy_lost) < 1e-9
    assert np.isnan(statistics.penetration_falling_mean)


def test_elastic_ball_penetrates_by_the_closed_form():
    """Deepest point of an elastic bounce: k x²/2 = m v²/2 + load x.

    The load is m g; MuJoCo's impedance, 0.95 at this depth, takes all but 5 % of it away.
    """
    k, m, h = 1e4, 2.0, 0.1
    comparison = compare.run(
        BALL.format(height=0.1 + h),
        duration=0.25,
        settings=["dashpot", "solref-direct"],
        materials={"ball": dashpot.Material(k, damping=0.0)},
        timestep=1e-4,
    )

    def deepest(load: float) -> float:
        return (load + np.sqrt(load**2 + 2 * k * m * 9.81 * h)) / k

    # Sampled at 0.1 ms, a bounce with w = sqrt(k/m) = 71/s misses its deepest point by at most
    # (w dt/2)²/2 = 6e-6 of it; MuJoCo's Euler step is first order: w dt = 7e-3.
    dashpot_run, mujoco_run = comparison.runs
    assert dashpot_run.penetration_max.max() == pytest.approx(deepest(m * 9.81), rel=1e-5)
    assert mujoco_run.penetration_max.max() == pytest.approx(deepest(0.05 * m * 9.81), rel=7e-3)
    mechanical = comparison["dashpot"].energy + comparison["dashpot"].elastic
    np.testing.assert_allclose(mechanical, mechanical[0], rtol=1e-9)


def test_direct_solref_is_stiffness_and_damping_over_mass():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL.format(height=1)))
    engine.set_material("ball", dashpot.Material(5e3, damping=30.0))
    stiffness, damping = direct_solref(engine.model, engine, 1, 1 / 2.0)
    assert stiffness == pytest.approx(-5e3 / 2)
    assert damping == pytest.approx(-30.0 / 2)
    engine.set_material("ball", dashpot.Material(5e3, damping_ratio=0.25))
    _, damping = direct_solref(engine.model, engine, 1, 1 / 2.0)
    assert damping == pytest.approx(-2 * 0.25 * np.sqrt(5e3 * 2) / 2)
    engine.set_material("ball", dashpot.Material())
    assert direct_solref(engine.model, engine, 1, 1 / 2.0) == (0.002, 1.0)


def test_two_springs_in_series_are_fitted_as_one():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL.format(height=1)))
    for geom in ("ball", "floor"):
        engine.set_material(geom, dashpot.Material(4e3, damping=10.0))
    stiffness, damping = direct_solref(engine.model, engine, 1, 1 / 2.0)
    assert stiffness == pytest.approx(-2e3 / 2)
    assert damping == pytest.approx(-5.0 / 2)


def test_settings_change_what_they_say():
    pristine = mujoco.MjModel.from_xml_string(BALL.format(height=1))
    pristine.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    engine = dashpot.Engine(pristine)
    models = {n: mujoco_model(s, pristine, engine) for n, s in compare.SETTINGS.items()}
    assert models["mujoco-default"].opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL
    assert models["elliptic"].opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert models["impratio"].opt.impratio == 10
    assert models["noslip"].opt.noslip_iterations == 10
    assert models["discrete"].opt.integrator == mujoco.mjtIntegrator.mjINT_DISCRETE
    assert pristine.opt.impratio == 1


def test_friction_of_a_material_reaches_mujoco():
    """A box started at 1 m/s on μ = 0.3 stops after v²/(2 μ g), in MuJoCo too."""
    xml = """
    <mujoco><option timestep="0.002"/><worldbody>
      <geom name="floor" type="plane" size="5 5 .1"/>
      <body pos="0 0 .1"><freejoint/><geom name="box" type="box" size=".2 .2 .1"/></body>
    </worldbody><keyframe><key qpos="0 0 .1 1 0 0 0" qvel="1 0 0 0 0 0"/></keyframe></mujoco>"""
    rigid = dashpot.Material(friction=0.3)
    comparison = compare.run(
        xml,
        duration=0.6,
        settings=["dashpot", "elliptic"],
        materials={"box": rigid, "floor": rigid},
    )
    distance = 1 / (2 * 0.3 * 9.81)
    # MuJoCo is off by some per cent (its contact is soft and slips when sticking); with its
    # default friction of 1 it would stop three times earlier.
    assert comparison["dashpot"].position[0] == pytest.approx(distance, rel=1e-3)
    assert comparison["elliptic"].position[0] == pytest.approx(distance, rel=0.1)


def test_friction_of_the_only_pair_of_a_geom_reaches_mujoco():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL.format(height=1)))
    engine.set_pair_material("ball", "floor", dashpot.Material(friction=(0.2, 0.01, 0.001)))
    model = mujoco_model(compare.SETTINGS["elliptic"], engine.model, engine)
    data = mujoco.MjData(model)
    data.qpos[2] = 0.0999
    mujoco.mj_forward(model, data)
    assert data.contact.friction[0] == pytest.approx([0.2, 0.2, 0.01, 0.001, 0.001])
    compare.run(engine, duration=0.01)


def test_friction_that_mujoco_cannot_say_is_refused():
    third = '<body pos="1 0 1"><freejoint/><geom size=".1"/></body></worldbody>'
    xml = BALL.format(height=1).replace("</worldbody>", third)
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    engine.set_pair_material("ball", "floor", dashpot.Material(friction=0.2))
    with pytest.raises(ValueError, match=r"pair 'floor', 'ball'"):
        compare.run(engine, duration=0.01)
    compare.run(engine, duration=0.01, settings="dashpot")
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string(BALL.format(height=1)),
        rules=dashpot.CombinationRules(friction="min"),
    )
    engine.set_material("ball", dashpot.Material(friction=0.2))
    with pytest.raises(ValueError, match="friction rule 'min'"):
        compare.run(engine, duration=0.01)


def test_friction_that_falls_with_load_is_refused_beside_mujoco():
    falling = dashpot.Material(friction=0.4, loaded_friction=0.5)
    of_geom, of_pair = (
        dashpot.Engine(mujoco.MjModel.from_xml_string(BALL.format(height=0.11))) for _ in range(2)
    )
    of_geom.set_material("ball", falling)
    of_pair.set_pair_material("ball", "floor", falling)
    for engine, what in ((of_geom, "geom 'ball'"), (of_pair, "pair 'floor', 'ball'")):
        with pytest.raises(
            ValueError, match=f"loaded_friction 0.5 of the {what} has no counterpart"
        ):
            compare.run(engine, duration=0.01)
        assert compare.run(engine, duration=0.01, settings="dashpot").runs[0].unstable_at is None


def test_elastic_energy_that_mujoco_does_not_know_is_nan_from_the_start():
    comparison = compare.run(
        BALL.format(height=0.11), duration=0.01, settings=("dashpot", "elliptic")
    )
    assert np.isnan(comparison["elliptic"].elastic).all()
    assert comparison["dashpot"].elastic[0] == 0.0


@pytest.mark.parametrize("settings", [3, None])
def test_settings_are_a_sequence(settings):
    with pytest.raises(TypeError, match=f"settings must be a name, a Setting or .* got {settings}"):
        compare.run(BALL.format(height=0.11), duration=0.01, settings=settings)


def test_dashpot_diverging_spares_the_others():
    stiff = """<mujoco><option timestep=".02"/><worldbody><body>
      <joint type="slide" axis="0 0 1" stiffness="1e6"/><geom size=".1" mass=".1"/>
      </body></worldbody><keyframe><key qpos="1"/></keyframe></mujoco>"""
    settings = ("dashpot", "elliptic")
    comparison = compare.run(stiff, duration=1.0, settings=settings)
    for name in settings:
        diverged = comparison[name]
        assert diverged.unstable_at == diverged.time[-1] < 0.1
        assert np.isfinite(diverged.energy).all()
    (reason,) = comparison["dashpot"].warnings
    assert reason.startswith("smooth acceleration of degree of freedom 0 diverged")


def test_other_errors_of_dashpot_than_diverging_pass_through(monkeypatch):
    def fail(*_):
        raise RuntimeError("contacts exceed the memory")

    monkeypatch.setattr(dashpot.Engine, "step", fail)
    with pytest.raises(RuntimeError, match="contacts exceed the memory"):
        compare.run(BALL.format(height=0.11), duration=0.01, settings=("dashpot",))


def test_a_diverging_run_says_when_and_spares_the_others(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)

    def explode(model: mujoco.MjModel, engine: dashpot.Engine) -> None:
        model.opt.gravity[2] = -1e12

    comparison = compare.run(
        BALL.format(height=0.11),
        duration=20.0,
        timestep=0.02,
        settings=["dashpot", compare.Setting("explosive", "made to diverge", explode)],
    )
    diverged = comparison["explosive"]
    assert diverged.unstable_at is not None
    assert diverged.time[-1] <= diverged.unstable_at < 20.0
    assert np.isfinite(diverged.energy).all()
    assert comparison["dashpot"].unstable_at is None
    assert comparison["dashpot"].time[-1] == pytest.approx(20.0)
    assert "diverged" in comparison.rows()[1][1][0]
    # MuJoCo's warning is kept, not printed or written to a file.
    assert any("unstable" in warning for warning in diverged.warnings)
    assert capfd.readouterr().err == ""
    assert list(tmp_path.iterdir()) == []


def test_the_callers_engine_is_left_alone():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL.format(height=0.3)))
    compare.run(
        engine,
        duration=0.02,
        timestep=0.004,
        settings=["dashpot", "discrete"],
        materials={"ball": dashpot.Material(1e4)},
    )
    assert engine.model.opt.timestep == 0.001
    assert engine.material("ball") == dashpot.Material()


def test_a_run_starts_at_the_first_keyframe():
    xml = BALL.format(height=1).replace(
        "</mujoco>", '<keyframe><key qpos="0 0 3 1 0 0 0" qvel="0 0 -2 0 0 0"/></keyframe></mujoco>'
    )
    for run in compare.run(xml, duration=0.001, settings=["dashpot", "elliptic"]).runs:
        assert run.kinetic[0] == pytest.approx(0.5 * 2 * 2**2)
        assert run.potential[0] == pytest.approx(2 * 9.81 * 3)


def test_mocap_bodies_are_measured_where_the_run_has_them():
    """A plate that the keyframe lifts to the ball, and turns to face it with its thin side."""
    plate = """<body name="plate" mocap="true" pos="0 0 -3">
      <geom type="box" size=".01 .2 .2"/></body></worldbody>"""
    half = np.sqrt(0.5)
    # A quarter turn about y: the half-thickness of 10 mm is along z, its top 1 mm in the ball.
    key = f'<key qpos="0 0 3 1 0 0 0" mpos="0 0 2.891" mquat="{half} 0 {half} 0"/>'
    xml = BALL.format(height=1).replace("</worldbody>", plate)
    xml = xml.replace("</mujoco>", f"<keyframe>{key}</keyframe></mujoco>")
    for run in compare.run(xml, duration=0.001, settings=["dashpot", "elliptic"]).runs:
        assert run.penetration_max[0] == pytest.approx(1e-3, rel=1e-9)
        assert run.contacts[-1] > 0


def made_run() -> compare.Run:
    """Five instants; 1 and 2 contacts before 0.3 s, 4 and 0 after."""
    return compare.Run(
        "made",
        "by hand",
        time=np.arange(5) * 0.1,
        penetration_sum=np.array([0.0, 1.0, 5.0, 8.0, 0.0]),
        penetration_max=np.array([0.0, 1.0, 4.0, 2.5, 0.0]),
        contacts=np.array([0, 1, 2, 4, 0]),
        kinetic=np.array([0.0, 3.0, 4.5, 2.0, 0.5]),
        potential=np.array([6.0, 3.0, 2.5, 2.0, 2.0]),
        elastic=np.full(5, np.nan),
        work=np.zeros(5),
        position=np.zeros(1),
        wall_time=0.2,
    )


def test_statistics_pool_contacts_over_instants():
    s = made_run().statistics(0.3)
    assert s.penetration_falling_mean == pytest.approx(6 / 3)
    assert s.penetration_falling_max == 4.0
    assert s.penetration_settled_mean == pytest.approx(8 / 4)
    assert s.penetration_settled_max == 2.5
    assert s.energy_lost == pytest.approx(6 - 2.5)
    assert s.energy_gained == pytest.approx(1.0)
    assert s.contacts_settled_mean == pytest.approx(2.0)
    assert s.realtime_factor == pytest.approx(0.4 / 0.2)


def test_comparison_can_be_shown_and_stored(tmp_path):
    from rich.console import Console

    # Resting long enough for depths of 1e-4 mm and energies of 1e-16 J, and the longest name.
    settings = ["dashpot", "mujoco-default", "solref-direct", "discrete"]
    comparison = compare.run("ball", duration=0.6, settings=settings)
    for width in (80, 200):
        with (tmp_path / "t.txt").open("w") as file:
            Console(width=width, file=file, force_terminal=False).print(comparison.table())
        shown = (tmp_path / "t.txt").read_text()
        assert "…" not in shown  # nothing is cut off, not in 80 columns either
        _, cells = comparison.rows()
        for row in cells:
            for cell in row:
                assert cell in shown.split()  # and no name is broken
    for heading in ("settled", "max", "[mm]"):
        assert heading in shown.split()
    comparison.plot(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
    stored = json.loads(json.dumps(comparison.to_dict(), allow_nan=False))
    assert stored["runs"][0]["statistics"]["energy_gained"] < 1e-9
    assert len(stored["runs"][1]["time"]) == len(comparison.runs[1].time)
    for kept, run in zip(stored["runs"], comparison.runs, strict=True):
        assert {f.name for f in fields(run)} <= {*kept, *kept["statistics"]}
        assert kept["position"] == run.position.tolist()
        assert kept["penetration_sum"] == run.penetration_sum.tolist()
    with pytest.raises(KeyError, match="elliptic"):
        comparison["elliptic"]
    for heading in ("mujoco-default", "settled", "[mm]"):
        assert heading in str(comparison).split()
    assert repr(comparison).startswith("Comparison('ball', 0.6 s at ")
    for line in (repr(comparison), repr(comparison.runs[0])):
        assert len(line) < 200


@pytest.mark.parametrize("name", list(compare.SCENES))
def test_shipped_scenes_start_clear_of_each_other_and_run(name):
    comparison = compare.run(name, duration=0.02, settings=["dashpot", "mujoco-default"])
    for run in comparison.runs:
        # Stacked and resting bodies touch; nothing starts inside anything else.
        assert run.penetration_max[0] < 1e-9
        assert np.isfinite(run.energy).all()


def test_the_pile_holds_the_number_of_bodies_asked_for():
    model = mujoco.MjModel.from_xml_string(compare.SCENES["pile"](bodies=40).xml)
    assert model.nbody == 41
    assert len({int(t) for t in model.geom_type}) == 6


def test_files_are_read_and_named(tmp_path):
    file = tmp_path / "drop.xml"
    file.write_text(BALL.format(height=0.2))
    assert compare.run(file, duration=0.01, settings="dashpot").scene == "drop"
    file.write_text("<mujoco><worldbody><geom type='nonsense'/></worldbody></mujoco>")
    with pytest.raises(ValueError, match=r"drop\.xml"):
        compare.run(file, duration=0.01)
    for name in ("none.xml", 300 * "none" + "none.xml"):
        with pytest.raises(FileNotFoundError, match=r"none\.xml"):
            compare.run(tmp_path / name)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"duration": 0.0}, "duration"),
        ({"duration": np.nan}, "duration"),
        (
            {"duration": 1e-5},
            "duration is 1e-05 s; it must be 1 to 100000000 time steps",
        ),
        ({"duration": 1e300}, "must be 1 to 100000000 time steps"),
        ({"timestep": 1e-300}, "must be 1 to 100000000 time steps of 1e-300 s"),
        ({"timestep": 5e-324}, "must be 1 to 100000000 time steps"),
        ({"timestep": -1e-3}, "timestep"),
        ({"settings": ["eliptic"]}, "did you mean 'elliptic'"),
        ({"settings": []}, "empty"),
        ({"settings": ["dashpot", "dashpot"]}, "twice"),
        ({"settled_after": 3.0}, "settled_after"),
        ({"materials": {"bal": dashpot.Material()}}, "did you mean 'ball'"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        compare.run(BALL.format(height=1), **{"duration": 0.01, **arguments})


def test_an_unknown_kind_of_scene_is_refused():
    with pytest.raises(TypeError, match=r"^materials is list; it must map geoms"):
        compare.run("ball", materials=[dashpot.Material()])
    with pytest.raises(TypeError, match="a setting is 3"):
        compare.run("ball", duration=0.01, settings=[3])
    with pytest.raises(TypeError, match="int"):
        compare.run(3)
    for argument in ("duration", "timestep", "settled_after"):
        for value in ("a", True):
            with pytest.raises(TypeError, match=f"^{argument} must be a number, got {value!r}"):
                compare.run(BALL.format(height=1), **{"duration": 0.01, argument: value})
    for argument, value, kind in (("name", np.nan, "a string"), ("progress", 3, "a function")):
        with pytest.raises(TypeError, match=f"^{argument} must be {kind}, got {value}"):
            compare.run("ball", **{"duration": 0.01, argument: value})
    with pytest.raises(ValueError, match="did you mean 'stack'"):
        compare.scene("stac")
    with pytest.raises(TypeError, match=r"^scene must be a name, got 3"):
        compare.scene(3)


@pytest.mark.parametrize(
    ("name", "argument", "value", "error"),
    [
        ("ball", "restitution", None, TypeError),
        ("ball", "stiffness", -1.0, ValueError),
        ("slope", "angle", "x", TypeError),
        ("slope", "angle", 90.0, ValueError),
        ("slope", "friction", -0.1, ValueError),
        ("stack", "boxes", -1, ValueError),
        ("stack", "timestep", 0.0, ValueError),
        ("pile", "bodies", 0, ValueError),
        ("pile", "seed", 0.5, TypeError),
    ],
)
def test_what_varies_a_shipped_scene_is_checked(name, argument, value, error):
    with pytest.raises(error, match=f"^{argument} must be "):
        compare.SCENES[name](**{argument: value})
