"""The command line: every command does what its help says, and fails in one line."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot import cli, demo
from dashpot.calibrate import twin
from dashpot.cli import view
from dashpot.cli.problem_file import read_problem
from dashpot.cli.problem_format import FORMAT
from dashpot.data import CubeTosses, save_cube_tosses
from dashpot.data.cube_tosses import make_toss
from dashpot.versions import versions

BALL = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="ball" pos="0 0 0.3">
      <freejoint/>
      <geom name="ball" type="sphere" size=".1" mass="2"/>
    </body>
  </worldbody>
</mujoco>"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    file = tmp_path / "ball.xml"
    file.write_text(BALL)
    return file


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")


def fails(capsys, *words: str) -> str:
    """Run a command that has to fail with code 1 and one line; return the line."""
    assert cli.main(list(words)) == 1
    captured = capsys.readouterr().err
    lines = captured.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("dashpot: error: ")
    return lines[0]


@pytest.mark.parametrize(
    "words",
    [[], ["demo"], ["calibrate"], ["compare"], ["simulate"], ["view"], ["data"],
     ["data", "cube-tosses"]],
)  # fmt: skip
def test_every_command_has_help(capsys, words):
    with pytest.raises(SystemExit) as stopped:
        cli.main([*words, "--help"])
    assert stopped.value.code == 0
    assert capsys.readouterr().out.startswith("usage: dashpot")


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["nonsense"],
        ["compare"],
        ["simulate", "ball", "--duration", "-1"],
        ["simulate", "ball", "--duration", "nan"],
        ["simulate", "ball", "--threads", "0"],
        ["simulate", "ball", "--out", "states.csv"],
        ["simulate", "ball", "--save", "states.npz"],
        ["view", "ball", "--threads", "1.5"],
        ["calibrate", "p.toml", "--threads", "0"],
        ["calibrate", "p.toml", "--plot", "fit.txt"],
        ["demo", "--seed", "-1"],
        ["simulate", "ball", "--material", "ball"],
        ["simulate", "ball", "--material", "ball:stifness=1"],
        ["simulate", "ball", "--material", "ball:stiffness=-1"],
        ["simulate", "ball", "--material", "ball:stiffness=1,stiffness=2"],
    ],
)
def test_a_wrong_command_line_ends_with_code_2(capsys, words):
    with pytest.raises(SystemExit) as stopped:
        cli.main(words)
    assert stopped.value.code == 2
    assert "usage:" in capsys.readouterr().err


def test_the_module_runs_as_a_program():
    source = Path(dashpot.__file__).parents[1]
    environment = {**os.environ, "PYTHONPATH": f"{source}{os.pathsep}{Path.cwd()}"}
    result = subprocess.run(
        [sys.executable, "-m", "dashpot", "simulate", "missing.xml"],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    assert result.returncode == 1
    assert result.stderr.startswith("dashpot: error: no model file missing.xml")
    assert "Traceback" not in result.stderr


def test_simulate_writes_every_state(capsys, scene, tmp_path):
    out = tmp_path / "states.npz"
    words = ["simulate", str(scene), "--duration", "0.1", "--timestep", "0.001", "--out", str(out)]
    assert cli.main(words) == 0
    assert "100 steps of 1 ms" in capsys.readouterr().out
    with np.load(out) as states:
        assert states["qpos"].shape == (101, 7)
        assert states["qvel"].shape == (101, 6)
        np.testing.assert_allclose(states["time"], np.arange(101) * 1e-3, atol=1e-12)
        # Free fall: the height is the exact parabola and energy is constant.
        np.testing.assert_allclose(
            states["qpos"][:, 2], 0.3 - 9.81 * states["time"] ** 2 / 2, atol=1e-12
        )
        total = states["kinetic"] + states["potential"]
        np.testing.assert_allclose(total, total[0], rtol=1e-12)


def test_simulate_uses_the_materials_given(scene, tmp_path):
    """Rebound speed of a free impact is restitution times approach speed."""
    fields = "stiffness=1e6,restitution=0.5"
    for spec in (f"ball:{fields}", f"*:{fields},friction=0.5/0.005/0.0001"):
        words = ["simulate", str(scene), "--duration", "0.35", "--material", spec]
        assert cli.main(words) == 0
        with np.load("states.npz") as states:
            speed = states["qvel"][:, 2]
            impact = int(np.argmax(np.diff(speed) > 0.5))
            approach = np.sqrt(2 * 9.81 * 0.2)
            rebound = speed[impact + 3 :].max() + 9.81 * 0.002 * 3
            # Within the 2 ms during which the instant of release is not known: g dt and more.
            assert rebound / approach == pytest.approx(0.5, abs=0.03)


def test_simulate_tells_what_happens_and_writes_a_table(capsys, scene, tmp_path):
    """What it writes has the columns of a recording."""
    words = ["simulate", str(scene), "--seconds", "0.5", "--save", "motion.csv"]
    assert cli.main(words) == 0
    assert "wrote motion.csv\n" in capsys.readouterr().out
    assert not (tmp_path / "states.npz").exists()
    assert cli.main([*words, "--out", "states.npz"]) == 0
    printed = capsys.readouterr().out
    assert "wrote motion.csv and states.npz\n" in printed
    assert "What happens" in printed
    assert "dissipated" in printed
    table = np.genfromtxt(tmp_path / "motion.csv", delimiter=",", names=True)
    assert table.dtype.names == ("time", "x", "y", "z", "qw", "qx", "qy", "qz")
    with np.load("states.npz") as states:
        np.testing.assert_array_equal(table["time"], states["time"])
        for column, name in enumerate(table.dtype.names[1:]):
            np.testing.assert_array_equal(table[name], states["qpos"][:, column])


def test_compare_prints_and_stores(capsys, scene, tmp_path):
    words = ["compare", str(scene), "--duration", "0.3", "--settings", "dashpot, elliptic"]
    words += ["--out", str(tmp_path / "c"), "--report", "c.html"]
    assert cli.main(words) == 0
    assert "elliptic" in (tmp_path / "c.html").read_text()
    printed = capsys.readouterr().out
    assert "elliptic" in printed
    assert "ball: 0.3 s at 2 ms" in printed
    stored = json.loads((tmp_path / "c" / "comparison.json").read_text())
    assert [run["name"] for run in stored["runs"]] == ["dashpot", "elliptic"]
    assert stored["scene"] == "ball"
    assert (tmp_path / "c" / "comparison.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["compare", "nowhere.xml"], "no model file nowhere.xml"),
        (["compare", "ball", "--settings", "eliptic"], "did you mean 'elliptic'"),
        (["compare", "ball", "--material", "bal:stiffness=1"], "did you mean 'ball'"),
        (["simulate", "ball", "--duration", "1e-9"], "less than a time step"),
        (["calibrate", "nowhere.toml"], "no problem file nowhere.toml; paths are seen from /"),
        (["simulate", "ball", "--fit", "nowhere.json"], "no saved fit nowhere.json; paths are"),
        (["demo", "--data", "nowhere"], "dashpot data cube-tosses"),
        (["data", "cube-tosses", "--base-url", "http://127.0.0.1:9/", "--out", "d"], "download"),
    ],
)
def test_failures_say_why_in_one_line(capsys, words, message):
    assert message in fails(capsys, *words)


@pytest.mark.parametrize("command", ["simulate", "calibrate"])
def test_files_that_cannot_be_written_are_refused_at_once(capsys, tmp_path, command):
    for out, message in (
        (tmp_path, "is a folder, not a file"),
        (tmp_path / "a" / "b", "not exist"),
    ):
        with pytest.raises(SystemExit, match="2"):
            cli.main([command, "nowhere.xml", "--out", str(out)])  # before the scene is looked for
        assert message in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("command", [["demo"], ["compare", "nowhere.xml"]])
def test_folders_that_cannot_be_made_are_refused_at_once(capsys, tmp_path, command):
    file = tmp_path / "file"
    file.write_text("here")
    for out in (file, file / "below"):
        with pytest.raises(SystemExit, match="2"):
            cli.main([*command, "--out", str(out)])
        assert "is a file, not a folder" in capsys.readouterr().err


def test_view_without_a_display_says_so(capsys, monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert "no display" in fails(capsys, "view", "ball")


class FakeViewer:
    """Stands in for MuJoCo's viewer; keeps the simulated time of every picture."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.data = data
        self.times: list[float] = []
        FakeViewer.last = self

    def __enter__(self) -> FakeViewer:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def is_running(self) -> bool:
        return len(self.times) < 1000

    def lock(self) -> FakeViewer:
        return self

    def sync(self) -> None:
        self.times.append(self.data.time)


def test_view_steps_in_real_time(monkeypatch):
    import mujoco.viewer

    monkeypatch.setattr(mujoco.viewer, "launch_passive", FakeViewer)
    monkeypatch.setattr(view, "require_display", lambda: None)
    assert cli.main(["view", "ball", "--duration", "0.3"]) == 0
    times = FakeViewer.last.times
    # A loaded machine shows fewer pictures and may lag; it never runs ahead by more than a step.
    assert 2 <= len(times) < 1000
    # A picture shows at most a frame of simulated time, 8 steps of 2 ms, more than the last.
    assert all(0 <= step <= 0.016 + 1e-9 for step in np.diff(times))
    assert 0 < times[-1] <= 0.3 + 0.002


def test_help_and_version_load_no_numerics():
    """They are there at once: importing scipy takes longer than everything else together."""
    code = (
        "import sys; from dashpot import cli\n"
        "for words in (['--version'], ['calibrate', '--help'], ['--help']):\n"
        "    try: cli.main(words)\n"
        "    except SystemExit as end: assert end.code == 0\n"
        "print(sorted({'scipy', 'matplotlib', 'rich', 'cma'} & set(sys.modules)))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.splitlines()[-1] == "[]"


def test_an_interrupt_ends_with_code_130(capsys, monkeypatch):
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(demo, "run_demo", interrupt)
    assert cli.main(["demo"]) == 130
    assert capsys.readouterr().err == "dashpot: interrupted\n"


TRUTH = 2e4

PROBLEM = {
    "model": "ball.xml",
    "position_sigma": 1e-4,
    "rotation_sigma": 1e-3,
    "substeps": 1,
    "materials": {"ball": {"stiffness": 1e4, "damping": 20.0}},
    "parameters": [
        {
            "kind": "material",
            "geoms": ["ball"],
            "quantity": "stiffness",
            "start": 1e4,
            "bounds": [1e3, 1e5],
        }
    ],
    "fit": {"max_evaluations": 60, "starts": 4},
}


def drop(scene: Path) -> dict[str, np.ndarray]:
    """Simulate a ball that falls from rest and bounces, stiffness TRUTH, every 2 ms."""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_path(str(scene)))
    engine.set_material("ball", dashpot.Material(TRUTH, damping=20.0))
    data = engine.make_data()
    poses = [data.qpos.copy()]
    for _ in range(200):
        engine.step(data)
        poses.append(data.qpos.copy())
    states = np.array(poses)
    time = 0.002 * np.arange(len(states))
    return {"time": time, "position": states[:, :3], "quaternion": states[:, 3:]}


@pytest.mark.parametrize("form", ["toml+npz", "json+csv"])
def test_calibrate_recovers_what_a_file_asks_for(capsys, scene, tmp_path, form):
    poses = drop(scene)
    if form == "json+csv":
        columns = np.column_stack([poses["time"], poses["position"], poses["quaternion"]])
        header = "time,x,y,z,qw,qx,qy,qz"
        np.savetxt(tmp_path / "drop.csv", columns, delimiter=",", header=header, comments="")
        with (tmp_path / "drop.csv").open("r+b") as file:  # as spreadsheets write it
            content = file.read()
            file.seek(0)
            file.write(b"\xef\xbb\xbf" + content + b"\r\n,,,,,,,\n")
        problem = {
            **PROBLEM,
            "initial_state": "pose_and_velocity",
            "fit": {"max_evaluations": 400, "starts": 8, "windows": [0.25]},
            "trajectories": [{"file": "drop.csv", "bodies": ["ball"]}],
        }
        file = tmp_path / "problem.json"
        file.write_text(json.dumps(problem))
    else:
        first = np.concatenate([poses["position"][0], poses["quaternion"][0]])
        np.savez(tmp_path / "drop.npz", initial_qpos=first, initial_qvel=np.zeros(6), **poses)
        file = tmp_path / "problem.toml"
        file.write_text(
            """
            model = "ball.xml"
            position_sigma = 1e-4
            rotation_sigma = 1e-3
            substeps = 1
            [materials.ball]
            stiffness = 1e4
            damping = 20.0
            [[parameters]]
            kind = "material"
            geoms = "ball"
            quantity = "stiffness"
            start = 1e4
            bounds = [1e3, 1e5]
            [[trajectories]]
            file = "drop.npz"
            bodies = "ball"
            name = "one drop"
            [fit]
            max_evaluations = 60
            starts = 4
            """
        )
    out, picture = str(tmp_path / "fit.json"), tmp_path / "fit.svg"
    assert cli.main(["calibrate", str(file), "--out", out, "--plot", str(picture)]) == 0
    printed = capsys.readouterr().out
    assert "<svg" in picture.read_text()
    assert "stiffness: identified" in printed
    estimate = json.loads((tmp_path / "fit.json").read_text())["estimates"][0]
    # The observations have no noise: only the search's own tolerance is left.
    assert estimate["value"] == pytest.approx(TRUTH, rel=1e-3)
    assert estimate["identified"] is True


@pytest.mark.parametrize("command", [["calibrate", "p.toml"], ["compare", "ball"]])
def test_a_report_without_its_package_is_refused_at_once(capsys, monkeypatch, command):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(SystemExit, match="2"):
        cli.main([*command, "--report", "x.html"])
    assert "dashpot[report]" in capsys.readouterr().err


def test_a_fit_goes_from_one_command_to_the_other(capsys, scene, tmp_path):
    """The saved fit, put into the scene, moves as the recording that it was fitted to."""
    poses = drop(scene)
    first = np.concatenate([poses["position"][0], poses["quaternion"][0]])
    np.savez(tmp_path / "drop.npz", initial_qpos=first, initial_qvel=np.zeros(6), **poses)
    problem = {**PROBLEM, "trajectories": [{"file": "drop.npz", "bodies": ["ball"]}]}
    (tmp_path / "problem.json").write_text(json.dumps(problem))
    words = ["calibrate", "problem.json", "--save", "ball.json", "--report", "ball.html"]
    assert cli.main(words) == 0
    assert "wrote ball.html" in capsys.readouterr().out
    assert "Calibration: problem.json" in (tmp_path / "ball.html").read_text()
    words = ["simulate", str(scene), "--fit", "ball.json", "--seconds", "0.4", "--save", "m.csv"]
    assert cli.main(words) == 0
    printed = capsys.readouterr().out
    assert "fitted: stiffness = 20000" in printed
    assert "steps as the fit did" not in printed
    moved = np.genfromtxt(tmp_path / "m.csv", delimiter=",", names=True)
    np.testing.assert_allclose(moved["z"], poses["position"][:, 2], atol=1e-6)
    assert cli.main([*words, "--timestep", "0.001"]) == 0
    told = "steps are 1 ms, those of the fit 2 ms: --timestep 0.002 steps as the fit did"
    assert told in " ".join(capsys.readouterr().out.split())
    (tmp_path / "ball.json").write_text("{}")
    assert "ball.json: it is no fit" in fails(capsys, *words)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"modle": "x"}, "unknown key 'modle'; did you mean 'model'"),
        ({"model": "nowhere.xml"}, r"model: no file .*nowhere\.xml; it is an MJCF, URDF or .mjb"),
        ({"model": "ball"}, r"model: no file .*ball; it is an MJCF, URDF or .mjb file"),
        ({"model": 3}, "model is 3, not of type str"),
        ({"parameters": None}, "parameters is None"),
        ({"parameters": [{"kind": "geom"}]}, r"parameters\[0\]: kind is 'geom'"),
        ({"parameters": [{"kind": "pair"}]}, r"parameters\[0\]: 'start' is missing"),
        (
            {"parameters": [{**PROBLEM["parameters"][0], "quantity": "stifness"}]},
            r"parameters\[0\]: unknown material quantity 'stifness'",
        ),
        ({"trajectories": [{"file": "no.npz", "bodies": ["ball"]}]}, r"no file .*no\.npz"),
        # Names that no file can have: too long, or of characters that end one.
        ({"model": 300 * "x" + ".xml"}, "model: no file .*xxx"),
        ({"model": 5000 * "x"}, "model: no file .*xxx"),
        ({"model": "a\0b.xml"}, "model: no file"),
        ({"trajectories": [{"file": 300 * "y", "bodies": ["ball"]}]}, "no file .*yyy"),
        ({"trajectories": [{"file": 2000 * "y/" + "z", "bodies": ["ball"]}]}, "no file .*y/z"),
        ({"trajectories": [{"file": "a\0.npz", "bodies": ["ball"]}]}, "no file"),
        ({"trajectories": [{"file": "bad.csv", "bodies": ["ball"]}]}, "no column 'qz'"),
        ({"trajectories": [{"file": "bad.npz", "bodies": ["ball"]}]}, "unknown key 'times'"),
        ({"trajectories": [{"file": "drop.npz", "bodies": ["bal"]}]}, "no body 'bal'"),
        ({"materials": {"bal": {"stiffness": 1.0}}}, r"materials\.bal: .*did you mean 'ball'"),
        ({"materials": {"ball": {"stiffness": -1.0}}}, r"materials\.ball: .*stiffness"),
        ({"materials": {"ball": 3}}, r"materials\.ball is 3, not of type dict"),
        ({"fit": {"start": 3}}, "fit: unknown key 'start'; did you mean 'starts'"),
        ({"position_sigma": -1.0}, "position_sigma"),
    ],
)
def test_a_wrong_problem_file_is_named(capsys, scene, tmp_path, change, message):
    np.savez(tmp_path / "drop.npz", initial_qvel=np.zeros(6), **drop(scene))
    np.savez(tmp_path / "bad.npz", times=np.zeros(3))
    (tmp_path / "bad.csv").write_text("time,x,y,z,qw,qx,qy\n0,0,0,0,1,0,0\n1,0,0,0,1,0,0\n")
    problem = {**PROBLEM, "trajectories": [{"file": "drop.npz", "bodies": ["ball"]}], **change}
    file = tmp_path / "problem.json"
    file.write_text(json.dumps(problem))
    line = fails(capsys, "calibrate", str(file))
    assert line.startswith(f"dashpot: error: {file}: ")
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        read_problem(file)
    assert "shipped scenes" not in line


@pytest.mark.parametrize("option", [{"max_evaluations": "a"}, {"confidence": 2}, {"loss": "l3"}])
def test_a_wrong_option_of_the_fit_names_the_problem_file(capsys, scene, tmp_path, option):
    np.savez(tmp_path / "drop.npz", initial_qvel=np.zeros(6), **drop(scene))
    problem = {**PROBLEM, "trajectories": [{"file": "drop.npz", "bodies": ["ball"]}], "fit": option}
    file = tmp_path / "problem.json"
    file.write_text(json.dumps(problem))
    assert f"{file}: {next(iter(option))} must be" in fails(capsys, "calibrate", str(file))


@pytest.mark.parametrize(
    ("header", "row", "message"),
    [
        ("time,x,y,z,qw,qx,qy,qz", "1,0,oops,0,1,0,0,0", "line 3, column 'y': 'oops' is not a"),
        ("time,x,y,z,qw,qx,qy,qz,x", "1,0,0,0,1,0,0,0,0", "2 columns are named 'x'"),
        ("time,x,y,z,qw,qx,qy,qz,label", "1,0,0,0,1,0,0,0,kick", None),
    ],
)
def test_columns_of_a_table_that_are_wanted_are_read(scene, tmp_path, header, row, message):
    """What is in others does not matter."""
    first = row.replace("1", "0", 1).replace("oops", "0")
    (tmp_path / "drop.csv").write_text(f"{header}\n{first}\n{row}\n")
    problem = {
        **PROBLEM,
        "position_sigma": [1e-4, 1e-4, math.inf],
        "initial_state": "pose_and_velocity",
        "trajectories": [{"file": "drop.csv", "bodies": ["ball"]}],
    }
    file = tmp_path / "problem.json"
    file.write_text(json.dumps(problem))
    if message is None:
        read, _ = read_problem(file)
        assert read.trajectories[0].time.tolist() == [0.0, 1.0]
        assert read.position_sigma == (1e-4, 1e-4, math.inf)
    else:
        with pytest.raises(ValueError, match=rf"trajectories\[0\]: .*drop.csv: {message}"):
            read_problem(file)


def test_the_problem_format_shown_in_the_help_can_be_read(scene, tmp_path):
    """The example of the help text, word for word, with the files that it names."""
    _, example = FORMAT.split("\n\n", 1)
    (tmp_path / "scene.xml").write_text(BALL)
    np.savez(tmp_path / "throw.npz", initial_qvel=np.zeros(6), **drop(scene))
    (tmp_path / "problem.toml").write_text(example)
    problem, options = read_problem(tmp_path / "problem.toml")
    assert problem.names == ("stiffness",)
    assert problem.window == 0.5
    assert options == {"method": "least_squares", "starts": 16}


def falling_cubes(count: int) -> CubeTosses:
    """Tosses of a turning cube that falls and stays: enough for the demo to have data."""
    made = []
    for index in range(count):
        time = np.arange(60) / 148
        height = 0.15 + 0.002 * index - 9.81 * time**2 / 2
        position = np.zeros((60, 3))
        position[:, 0] = 0.3 * time
        position[:, 2] = np.maximum(height, 0.0524)
        # One turn a second about another edge each time, in flight.
        turn = np.pi * np.minimum(time, 0.1)
        quaternion = np.zeros((60, 4))
        quaternion[:, 0], quaternion[:, 1 + index % 3] = np.cos(turn), np.sin(turn)
        velocity = np.gradient(position, time, axis=0)
        made.append(make_toss(index, position, quaternion, velocity, np.zeros((60, 3))))
    return CubeTosses(tuple(made))


@pytest.fixture
def _small_demo(monkeypatch):
    monkeypatch.setattr(twin, "THROWS", 1)
    monkeypatch.setattr(demo, "FITTED_TOSSES", 3)
    monkeypatch.setattr(demo, "TOSS_EVALUATIONS", {"dashpot": 8, "MuJoCo": 8})
    monkeypatch.setattr(demo, "PILE_SETTINGS", ("dashpot", "elliptic"))


@pytest.mark.usefixtures("_small_demo")
def test_demo_writes_its_report_with_data(capsys, tmp_path):
    file = tmp_path / "data" / "cube_tosses_public.npz"
    save_cube_tosses(falling_cubes(5), file)
    assert cli.main(["demo", "--out", "report", "--data", str(file.parent)]) == 0
    report = Path("report/report.html").read_text(encoding="utf-8")
    for name in ("twin", "tosses", "pile"):
        assert Path(f"report/{name}.png").read_bytes().startswith(b"\x89PNG")
    for expected in ("stiffness", "unseen", "elliptic", "Pile"):
        assert expected in report
    footer = report[report.index("<footer>") :]
    for name, version in versions().items():
        assert f"{name} {version}" in footer
    assert re.search(r"on \d{4}-\d\d-\d\dT", footer)
    assert "report.html" in capsys.readouterr().out


@pytest.mark.usefixtures("_small_demo")
def test_demo_goes_on_without_data(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("DASHPOT_DATA", str(tmp_path))
    monkeypatch.setattr(demo, "_twin_section", lambda *_: demo.Section("Twin", []))
    monkeypatch.setattr(demo, "PILE_SETTINGS", ("dashpot",))
    assert cli.main(["demo", "--out", "report"]) == 0
    report = Path("report/report.html").read_text(encoding="utf-8")
    assert "dashpot data cube-tosses" in report
    assert not Path("report/tosses.png").exists()
    assert Path("report/pile.png").exists()
