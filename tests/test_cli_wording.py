"""Messages at the command line name options that it has."""

from __future__ import annotations

import argparse
import re

import mujoco
import numpy as np
import pytest

from dashpot import Engine, Material
from dashpot.calibrate import Explanation
from dashpot.cli import main, parser
from dashpot.cli.problem_file import read_problem
from dashpot.cli.wording import _WORDS, in_words_of

SCENE = """<mujoco><worldbody><geom name="floor" type="plane" size="9 9 1"/>
  <body name="ball" pos="0 0 .4"><freejoint/><geom name="ball" size=".1" mass="1"/></body>
  </worldbody></mujoco>"""


def options_of_calibrate():
    (commands,) = (
        action for action in parser()._actions if isinstance(action, argparse._SubParsersAction)
    )
    return set(commands.choices["calibrate"]._option_string_actions)


def test_every_option_that_a_message_names_is_one_of_the_command():
    told = {word for _, table, _ in _WORDS for word in re.findall(r"--[a-z-]+", table)}
    assert len(told) > 8
    assert told <= options_of_calibrate()


@pytest.mark.parametrize(
    ("python", "table", "file"),
    [
        (
            "max_evaluations = 300 is spent; what would help: more evaluations (max_evaluations)",
            "--max-evaluations 300 is spent; what would help: more evaluations (--max-evaluations)",
            "max_evaluations = 300 in [fit] is spent; what would help: more evaluations "
            "(max_evaluations in [fit])",
        ),
        (
            "further starts (starts=16), or short windows first (windows=...)",
            "further starts (--starts 16), or short windows first (--windows SECONDS,...)",
            "further starts (starts = 16 in [fit]), or short windows first "
            "(windows = [SECONDS, ...] in [fit])",
        ),
        (
            'Parameter.delay("load")',
            "--fit delay:load=LOWER..UPPER",
            'parameters of kind = "delay", channel = "load"',
        ),
        ("Say frames='even'", "Say --frames even", 'Say frames = "even"'),
        ("stiffness is 3", "stiffness is 3", "stiffness is 3"),
    ],
)
def test_advice_is_said_as_where_it_is_read(python, table, file):
    assert in_words_of("ball.csv", python) == table
    assert in_words_of("ball.toml", python) == file


def test_remedies_of_misfits_are_put_in_as_they_are_said(tmp_path, monkeypatch):
    """What an explanation says is taken by ``--fit``, with numbers for its bounds."""
    from dashpot.cli.table_parameters import parameters_of

    monkeypatch.chdir(tmp_path)
    engine = Engine(mujoco.MjModel.from_xml_string(SCENE))
    for quantity in ("delay", "gain", "offset", "scale"):
        quoted = "" if quantity == "scale" else '"load"'
        remedy = f"Parameter.{quantity}({quoted})"
        told = Explanation("load", quantity, 0.1, 0.01, 0.9, True, "s", remedy)
        said = in_words_of("ball.csv", told.remedy).removeprefix("--fit ")
        spec = said.replace("LOWER", "0.5").replace("UPPER", "2")
        (parameter,) = parameters_of([spec], engine, None)
        assert parameter.bounds == (0.5, 2.0)
        assert parameter.name.startswith(quantity)
    with pytest.raises(ValueError, match="it needs bounds, as delay:load=LOWER"):
        parameters_of(["delay:load"], engine, None)


@pytest.fixture
def dropped(tmp_path, monkeypatch):
    """Return options that state a table of a ball that falls onto a floor of 2e4 N/m."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.xml").write_text(SCENE)
    engine = Engine(mujoco.MjModel.from_xml_string(SCENE))
    engine.set_pair_material("ball", "floor", Material(stiffness=2e4, restitution=0.6))
    data = engine.make_data()
    rows = []
    for _ in range(200):
        rows.append((data.time, float(data.qpos[2])))
        engine.step(data, 2)
    np.savetxt("ball.csv", rows, delimiter=",", header="time,z", comments="")
    return [
        *("calibrate", "ball.csv", "--model", "scene.xml", "--noise", "position=1e-4"),
        *("--columns", "time=time,z=z", "--fit", "pair:ball,floor:stiffness=100..1e6,restitution"),
    ]


def test_a_search_that_is_cut_short_says_so_by_the_commands_own_options(dropped, capsys):
    assert main([*dropped, "--max-evaluations", "30", "--starts", "2"]) == 0
    printed = capsys.readouterr().out
    assert "--max-evaluations 30 is spent" in printed
    assert "max_evaluations" not in printed
    assert "starts=" not in printed


def test_a_table_that_is_not_there_is_named_with_what_helps(dropped, capsys):
    for given, told in (
        ("bal.csv", "no table bal.csv; did you mean ball.csv?"),
        ("away/ball.csv", "no table away/ball.csv: there is no folder away"),
    ):
        assert main([dropped[0], given, *dropped[2:]]) == 1
        assert capsys.readouterr().err == f"dashpot: error: {told}\n"
    held_out = ("--held-out", "other.csv", "--head", "0.1")
    assert main([*dropped, *held_out]) == 1
    assert "no table other.csv; paths are seen from /" in capsys.readouterr().err


def test_a_scale_stands_in_a_problem_file(dropped, tmp_path):
    (tmp_path / "p.toml").write_text("""model = "scene.xml"
position_sigma = 1e-4
initial_state = "pose_and_velocity"
[[parameters]]
kind = "scale"
bounds = [0.9, 1.1]
[[trajectories]]
file = "ball.csv"
bodies = ["ball"]
""")
    problem, _ = read_problem(tmp_path / "p.toml")
    assert problem.names == ("scale of poses",)
    assert problem.parameters[0].bounds == (0.9, 1.1)
