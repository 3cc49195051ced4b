"""Parameters of several pairs, of several numbers, frozen ones and inertia in problem files."""

from __future__ import annotations

import json

import mujoco
import pytest

from dashpot import Engine, Material
from dashpot.cli.problem_file import read_problem
from dashpot.cli.table_parameters import parameters_of
from dashpot.cli.table_problem import described

SCENE = """<mujoco><worldbody>
  <geom name="left" type="plane" size="9 9 1"/><geom name="right" type="plane" size="9 9 1"/>
  <body name="ball" pos="0 0 .6" simple="false"><freejoint/><geom name="ball" size=".1" mass="1"/>
  </body></worldbody></mujoco>"""
ROWS = "time,x,y,z,qw,qx,qy,qz\n" + "\n".join(f"{0.1 * k},0,0,1,1,0,0,0" for k in range(3))


@pytest.fixture
def problem(tmp_path):
    (tmp_path / "scene.xml").write_text(SCENE)
    (tmp_path / "ball.csv").write_text(ROWS)

    def write(*parameters):
        file = tmp_path / "problem.json"
        file.write_text(
            json.dumps(
                {
                    "model": "scene.xml",
                    "position_sigma": 1e-3,
                    "rotation_sigma": 1e-3,
                    "initial_state": "pose_and_velocity",
                    "parameters": parameters,
                    "trajectories": [{"file": "ball.csv", "bodies": ["ball"]}],
                }
            )
        )
        return file

    return write


PAIRS = {
    "kind": "pair", "geoms": [["left", "ball"], ["right", "ball"]], "quantity": "stiffness",
    "start": 1e4, "bounds": [1e2, 1e6],
}  # fmt: skip


def test_several_pairs_and_a_frozen_vector_stand_in_a_problem_file(problem):
    friction = {
        **PAIRS, "quantity": "friction", "start": [0.5, 1e-3, 1e-4],
        "bounds": [[0.1, 1], [1e-5, 0.1], [1e-6, 0.01]], "frozen": [False, True, True],
    }  # fmt: skip
    read, _ = read_problem(problem(PAIRS, friction))
    assert [p.name for p in read.unknowns] == ["stiffness", "friction[0]"]
    assert read.held == {"friction[1]": 1e-3, "friction[2]": 1e-4}
    built = read.build({"stiffness": 2e4, "friction[0]": 0.7})
    for floor in ("left", "right"):
        material = built.pair_material(floor, "ball")
        assert material.stiffness == 2e4
        assert material.friction == (0.7, 1e-3, 1e-4)
    assert "friction[1]: held at 0.001" in described(read)


def test_inertia_stands_in_a_problem_file(problem):
    entry = {
        "kind": "inertia",
        "body": "ball",
        "mass": [0.5, 2.0],
        "shape": False,
        "per": "trajectory",
    }
    read, _ = read_problem(problem(entry))
    assert read.names == tuple(
        f"inertia of ball[ball][{name}]" for name in ("mass", "centre x", "centre y", "centre z")
    )


def test_what_a_recorder_does_may_be_frozen_or_by_trajectory_in_a_problem_file(problem):
    late = {"kind": "delay", "channel": ["poses"], "bounds": [0, 0.1], "per": "trajectory"}
    read, _ = read_problem(problem(PAIRS, {**late, "start": 0.02, "frozen": True}))
    assert read.held == {"delay of poses[ball]": 0.02}


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (
            {"kind": "inertia", "body": "ball", "mass": 1.0},
            r"parameters\[0\]: mass is 1.0, not of type",
        ),
        ({"kind": "inertia", "body": "ball", "mass": []}, "bounds must be"),
        ({"kind": "inertia", "body": "ball", "start": 1.0}, "start"),
        ({**PAIRS, "geoms": [["left", "ball"], "right"]}, "a pair is two geoms"),
        ({**PAIRS, "frozen": "yes"}, "frozen must be"),
        ({**PAIRS, "kind": "mass"}, "kind is 'mass', none of material, .*, image, .*, inertia"),
    ],
)
def test_wrong_entries_are_named(problem, entry, message):
    with pytest.raises(ValueError, match=message):
        read_problem(problem(entry))


def test_a_command_names_several_pairs_by_four_geoms():
    engine = Engine(mujoco.MjModel.from_xml_string(SCENE))
    engine.set_pair_material("left", "ball", Material(1e4))
    (parameter,) = parameters_of(["pair:left,ball,right,ball:stiffness"], engine, None)
    assert parameter.apply.pairs == (("left", "ball"), ("right", "ball"))
