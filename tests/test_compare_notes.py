"""A comparison says what has to be known to read it: work, starts that strain, softness, gains."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot import compare
from dashpot.compare.notes import softness_of_the_model, violations_at_start

BOTH = ("dashpot", "elliptic")
DROP = """<mujoco><option timestep=".001"/><worldbody>
  <geom name="floor" type="plane" size="1 1 .1"/>
  <body pos="0 0 .3"><freejoint/><geom name="ball" size=".1" mass="1" {ball}/></body>
</worldbody></mujoco>"""


def lift(*, actuator: str, key: str) -> str:
    return f"""<mujoco><option timestep=".001"/><worldbody>
      <body name="load"><joint name="lift" type="slide" axis="0 0 1"/><geom size=".1" mass="2"/>
      </body></worldbody><actuator>{actuator}</actuator><keyframe>{key}</keyframe></mujoco>"""


def test_the_work_of_a_motor_is_no_gain():
    """40 N on 2 kg: the load is lifted by (F/m - g) t²/2, and F times that is the work."""
    xml = lift(actuator='<motor joint="lift"/>', key='<key ctrl="40"/>')
    comparison = compare.run(xml, duration=0.5, settings=BOTH)
    work = 40 * (40 / 2 - 9.81) * 0.5**2 / 2
    for statistics in comparison.statistics().values():
        # Without contacts both take MuJoCo's Euler steps, of first order: dt / t = 2e-3.
        error = 2.1e-3
        assert statistics.work == pytest.approx(work, rel=error)
        assert abs(statistics.energy_lost) < error * work
        assert statistics.energy_gained < error * work
    assert comparison.gaining() == ()
    assert "work done [J]" in comparison.rows()[0]
    assert any("Actuators did work" in note for note in comparison.notes())


def test_the_work_of_a_servo_closes_the_balance_of_a_load_that_it_lifts():
    """What the joint's damper took is lost, and it is not negative though the load has risen."""
    xml = lift(actuator='<position joint="lift" kp="400" kv="20"/>', key='<key ctrl="1"/>').replace(
        'axis="0 0 1"', 'axis="0 0 1" damping="20"'
    )
    comparison = compare.run(xml, duration=3.0, settings=BOTH)
    for run in comparison.runs:
        height = run.position[0]
        assert height == pytest.approx(1 - 2 * 9.81 / 400, abs=1e-3)
        speed = np.sqrt(run.kinetic)  # m v²/2 with 2 kg
        taken = 20 * float(np.sum(0.5 * (speed[1:] ** 2 + speed[:-1] ** 2)) * 1e-3)
        lost = run.statistics(3.0).energy_lost
        assert lost == pytest.approx(taken, rel=5e-3)  # Euler's first order: dt over 0.1 s, twice


def test_the_work_of_gravity_compensation_is_no_gain():
    """A body without weight rises with its speed: v t high, and weight times that is the work."""
    xml = """<mujoco><option timestep=".001"/><worldbody><body gravcomp="1"><freejoint/>
      <geom size=".1" mass="3"/></body></worldbody>
      <keyframe><key qpos="0 0 0 1 0 0 0" qvel="0 0 2 0 0 0"/></keyframe></mujoco>"""
    for statistics in compare.run(xml, duration=0.5, settings=BOTH).statistics().values():
        assert statistics.work == pytest.approx(3 * 9.81 * 2 * 0.5, rel=1e-9)
        assert abs(statistics.energy_lost) < 1e-9


def test_passive_scenes_have_no_column_of_work():
    comparison = compare.run(DROP.format(ball=""), duration=0.1, settings=BOTH)
    assert "work done [J]" not in comparison.rows()[0]
    assert comparison.notes() == ()
    assert all(not run.work.any() for run in comparison.runs)


def test_a_start_that_violates_a_limit_is_named():
    """A slide that starts 0.2 m below its range is lifted by its limit: 2 kg by at least 0.2 m."""
    xml = lift(actuator="", key="").replace('axis="0 0 1"', 'axis="0 0 1" range=".2 1"')
    comparison = compare.run(xml, duration=4.0, settings=BOTH)
    assert comparison.violations == "the limit of joint lift by 0.2 m"
    gained = comparison["dashpot"].statistics(4.0)
    # Recovery takes 2 s at 0.1 m/s; the rest is the overlap of the limit's spring.
    assert gained.energy_gained == pytest.approx(2 * 9.81 * 0.2, rel=0.01)
    assert gained.energy_lost < 0.0
    header, rows = comparison.rows()
    lost = header.index("energy lost [J]")
    assert rows[0][0] == "dashpot (gains energy)"
    assert rows[0][lost] == "-"
    (note,) = comparison.notes()
    assert "The start violates the limit of joint lift by 0.2 m." in note
    assert f"dashpot {gained.energy_gained:.3g} J" in note


def test_equalities_and_surfaces_that_a_start_violates_are_named():
    xml = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
      <body name="a" pos="0 0 .08"><freejoint/><geom name="ball" size=".1"/></body>
      <body name="b" pos="0 0 1"><joint name="turn" type="hinge"/><geom size=".1"/></body>
      <body name="c" pos="0 0 2"><joint name="other" type="hinge" range="10 20"/>
        <geom size=".1"/></body></worldbody>
      <equality><joint name="geared" joint1="turn" polycoef=".3 0 0 0 0"/></equality></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    told = violations_at_start(model, mujoco.MjData(model))
    assert told == (
        "equality geared by 0.3, the limit of joint other by 0.175 rad, "
        "the surfaces of floor and ball by 0.02 m"
    )
    clear = mujoco.MjModel.from_xml_string(DROP.format(ball=""))
    assert violations_at_start(clear, mujoco.MjData(clear)) == ""


def test_a_setting_that_gains_energy_says_so_wherever_it_is_shown(tmp_path):
    pytest.importorskip("jinja2")

    def push(model: mujoco.MjModel, engine: dashpot.Engine) -> None:
        model.dof_damping[:] = -2.0

    pushed = compare.Setting("pushed", "MuJoCo with dampers that push", push)
    comparison = compare.run(DROP.format(ball=""), duration=1.0, settings=["dashpot", pushed])
    assert comparison.gaining() == ("pushed",)
    assert comparison.label("pushed") == "pushed (gains energy)"
    assert [row[0] for row in comparison.rows()[1]] == ["dashpot", "pushed (gains energy)"]
    (note,) = comparison.notes()
    assert note.startswith("Energy out of nothing: pushed ")
    labels = [line.get_label() for axes in comparison.plot().axes for line in axes.lines]
    assert "pushed (gains energy)" in labels
    assert "pushed" not in labels
    page = comparison.report(tmp_path / "page.html").read_text(encoding="utf-8")
    shown = (str(comparison), comparison._repr_html_(), page)
    for text in shown:
        assert "(gains energy)" in text
        assert "Energy out of nothing" in text
        assert "dampers that push" in text
    assert comparison.to_dict()["notes"] == [note]


def test_what_a_models_own_solref_does_is_told():
    """Geoms of the model's own softness are named, unless a material takes its place."""
    soft = dashpot.Engine(DROP.format(ball='solref=".05 1"'))
    told = softness_of_the_model(soft)
    assert told.startswith("1 of 2 geoms have a solref or solimp of their own: ball. ")
    # And so it is: both sink alike, and by more than a rigid ball.
    comparison = compare.run(soft, duration=2.0, settings=BOTH)
    assert comparison.notes() == (told,)
    depths = [s.penetration_settled_mean for s in comparison.statistics().values()]
    assert depths[0] == pytest.approx(depths[1], rel=0.02)
    assert depths[0] > 5e-4
    soft.set_material("ball", dashpot.Material())
    assert softness_of_the_model(soft) == ""
    assert (
        compare.run(soft, duration=2.0, settings="dashpot")
        .statistics()["dashpot"]
        .penetration_settled_mean
        < 1e-5
    )
    assert softness_of_the_model(dashpot.Engine(DROP.format(ball=""))) == ""
    invisible = DROP.format(ball='solref=".05 1" contype="0" conaffinity="0"')
    assert softness_of_the_model(dashpot.Engine(invisible)) == ""


def test_settings_are_explained_by_name():
    comparison = compare.run(
        DROP.format(ball=""), duration=0.01, settings=("dashpot", *compare.SETTINGS)
    )
    lines = str(comparison).splitlines()
    assert "dashpot: dashpot's contact solver, law kelvin_voigt" in lines
    for name, setting in compare.SETTINGS.items():
        assert f"{name}: {setting.description}" in lines


def test_energies_that_are_rounding_are_zero():
    comparison = compare.run(DROP.format(ball=""), duration=0.05, settings="dashpot")
    header, (row,) = comparison.rows()
    assert row[header.index("energy gained [J]")] == "0"
    assert row[header.index("energy lost [J]")] == "0"
