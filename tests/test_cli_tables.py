"""`dashpot calibrate ball.csv`: a table fitted by one command, without a problem file."""

import math
import re
import shlex
from pathlib import Path

import mujoco
import numpy as np
import pytest

from dashpot import Engine, Material
from dashpot.calibrate import Trajectory
from dashpot.calibrate.data.smoothness import position_noise, rotation_noise, sensor_noise
from dashpot.cli import main

RATE, NOISE = 120.0, 5e-4
SCENE = """<mujoco><option timestep="0.0042"/><worldbody>
  <geom name="floor" type="plane" size="9 9 1"/>
  <body name="ball" pos="0 0 .6"><freejoint/><geom name="ball" size=".1" mass="1"/></body>
  </worldbody><sensor><framepos name="mark" objtype="body" objname="ball"/></sensor></mujoco>"""
FIT = ["--fit", "pair:ball,floor:stiffness,restitution=0.3..0.99"]
COLUMNS = ["--columns", "time=t,z=height"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a scene and the height of a ball, 2e4 N/m and 0.8, in cm and ms."""
    engine = Engine(mujoco.MjModel.from_xml_string(SCENE))
    engine.set_pair_material("ball", "floor", Material(stiffness=2e4, restitution=0.8))
    engine.model.opt.timestep = 1 / RATE / 4
    data = engine.make_data()
    heights = [data.qpos[2]]
    for _ in range(99):
        engine.step(data, nstep=4)
        heights.append(data.qpos[2])
    heights += NOISE * np.random.default_rng(0).normal(size=100)
    rows = [f"{1e3 * k / RATE:.4f},{100 * z:.5f},a" for k, z in enumerate(heights)]
    path = tmp_path_factory.mktemp("tables")
    (path / "scene.xml").write_text(SCENE)
    (path / "ball.csv").write_text("\n".join(["t,height,run", *rows]))
    return path


def command(folder, *options):
    scene = ["--model", str(folder / "scene.xml")]
    return main(["calibrate", str(folder / "ball.csv"), *scene, *options])


def test_one_command_fits_a_table(folder, capsys):
    assert command(folder, *COLUMNS, "--unit", "t=ms,z=cm", *FIT) == 0
    printed = capsys.readouterr().out
    assert "stiffness: from 1e+04, between 10 and 1e+08\n" in printed
    assert "restitution: from 0.645, between 0.3 and 0.99\n" in printed
    assert "stiffness: identified" in printed
    assert "1 runs of 100 frames, noise of 0.0004" in printed
    line = next(row for row in printed.splitlines() if row.startswith("restitution: identified"))
    lower, upper = (float(word) for word in line.split("interval ")[1].split(" to "))
    assert lower < 0.8 < upper


def test_noise_is_estimated_where_it_is_asked_for(folder, capsys):
    """Stated ten times too large, it is found: the interval is as narrow as with the right one."""
    widths = []
    for noise in (f"position={NOISE}", f"position={10 * NOISE},estimate"):
        options = [*COLUMNS, "--unit", "t=ms,z=cm", *FIT, "--noise", noise]
        assert command(folder, *options) == 0
        printed = capsys.readouterr().out
        assert ("noise to be estimated, from" in printed) == noise.endswith("estimate")
        line = next(row for row in printed.splitlines() if row.startswith("restitution: ident"))
        lower, upper = (float(word) for word in line.split("interval ")[1].split(" to "))
        assert lower < 0.8 < upper
        widths.append(upper - lower)
    assert widths[1] == pytest.approx(widths[0], rel=0.3)


def test_lines_of_python_in_the_readme_do_the_same_as_its_command(folder, monkeypatch, capsys):
    readme = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")
    _, lines, *_ = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    (words,) = re.findall(r"```bash\ndashpot (calibrate .*?)```", readme, re.DOTALL)
    monkeypatch.chdir(folder)
    exec(compile(lines, "README.md", "exec"), {})
    assert main(shlex.split(words.replace("\\\n", " "))) == 0
    found = re.findall(r"│ (stiffness|restitution) +│ +([0-9.e+]+) │", capsys.readouterr().out)
    assert [name for name, _ in found] == 2 * ["stiffness", "restitution"]
    for name, value in found:
        assert float(value) == pytest.approx({"stiffness": 2e4, "restitution": 0.8}[name], rel=0.02)


def test_options_of_a_table_are_taken_together(folder, capsys):
    options = ["--columns", "time=t", "--columns", "sensor:mark.2=height,run=run", "--unit", "t=ms",
               "--unit", "sensor:mark.2=0.01", "--columns", "sensor:mark.0=height",
               "--columns", "sensor:mark.1=height"]  # fmt: skip
    with pytest.raises(SystemExit):
        command(folder, *options, "--fit", "model:body_mass:ball", "--window", "0.1..0.05")
    assert "'0.1..0.05' is not START..END in seconds" in capsys.readouterr().err
    again = [*COLUMNS, "--unit", "t=ms,height=0.01", "--window", "0.1..0.5", "--noise",
             "position=0.002", "--frames", "even", "--material", "ball:stiffness=2e4",
             "--fit", "model:body_mass:ball", "--fit", "material:ball:restitution"]  # fmt: skip
    assert command(folder, *again) == 0
    printed = capsys.readouterr().out
    assert "body_mass: from 1, between 0.1 and 10\n" in printed
    assert "1 runs of 49 frames, noise of 0.002 m\n" in printed


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "a table needs --fit"),
        (["--fit", "pair:ball:stiffness"], "a pair has two geoms, not 1"),
        (["--fit", "pair:ball,floor:stifness"], "unknown material quantity 'stifness'"),
        (["--fit", "ball:stiffness"], "is not pair:GEOM,GEOM:QUANTITY,..."),
        (["--fit", "pair:ball,floor:stiffness=a..b"], "--fit stiffness: 'a' is not a number"),
        (["--fit", "pair:ball,floor:stiffness=9..1"], "bounds must be finite and ascend"),
        (["--fit", "model:body_inertia:ball"], "no default bounds: say ball=LOWER..UPPER"),
        (["--fit", "pair:bal,floor:stiffness"], "'bal'"),
        ([*FIT, "--noise", "load=3"], "--noise: 'load' is none of position, rotation"),
        ([*FIT, "--columns", "y=nowhere"], "ball.csv: no column 'nowhere'; there are t, height"),
        ([*FIT, "--unit", "z=parsec"], "'parsec', no unit that is known"),
        ([*FIT, "--body", "cube"], "no body 'cube'"),
        (
            [*FIT, "--unit", "t=ms,z=cm", "--window", "5000..6000"],
            "0 frames are between 5000 and 6000 s",
        ),
    ],
)
def test_a_wrong_option_of_a_table_is_named(folder, capsys, options, message):
    assert command(folder, *COLUMNS, *options) != 0
    assert message in capsys.readouterr().err


def test_units_that_nobody_gave_are_asked_for(folder, capsys):
    assert command(folder, *COLUMNS, *FIT) != 0
    said = "ball.csv: trajectory 'ball': it falls at 0.0001 times gravity, as with positions in cm"
    assert said in capsys.readouterr().err


def test_options_of_tables_are_refused_beside_a_problem_file(folder, capsys):
    assert main(["calibrate", "p.toml", "--unit", "z=cm"]) != 0
    assert "--unit is for tables, .csv; p.toml says it itself" in capsys.readouterr().err


@pytest.mark.parametrize("noise", [1e-4, 3e-3])
@pytest.mark.parametrize("seed", range(5))
def test_noise_is_read_off_what_is_left_of_smooth_paths(noise, seed):
    """Of a path with corners and a turning body, 200 frames: to 15 %, as medians know it."""
    rng = np.random.default_rng(seed)
    t = np.arange(200) / 100
    height = np.abs(np.sin(5 * t))
    position = np.c_[t, 2 * t, height] + noise * rng.normal(size=(200, 3))
    turned = np.zeros((200, 4))
    for row, angle in zip(turned, 3.0 * t, strict=True):
        mujoco.mju_axisAngle2Quat(row, [0, 1, 0], angle)
        mujoco.mju_quatIntegrate(row, noise * rng.normal(size=3), 1.0)
    turned[100:] *= -1
    load = 40.0 * height + 7.0 * noise * rng.normal(size=200)
    load[::3] = np.nan
    whole = Trajectory("box", t, position, turned, "box", sensors={"load": load})
    assert position_noise([whole]) == pytest.approx(noise, rel=0.15)
    assert rotation_noise([whole]) == pytest.approx(noise, rel=0.25)
    slow = Trajectory.of_sensors("slow", t, {"load": t + 7.0 * noise * rng.normal(size=200)})
    assert sensor_noise([slow])["load"] == pytest.approx(7.0 * noise, rel=0.35)
    assert math.isinf(position_noise([slow]))
    assert math.isinf(rotation_noise([slow]))


def test_another_table_is_predicted(folder, capsys, tmp_path):
    """What was not fitted, from its first 0.3 s, before it bounces."""
    pytest.importorskip("jinja2")
    other = tmp_path / "other.csv"
    other.write_text((folder / "ball.csv").read_text())
    page = tmp_path / "page.html"
    options = [*COLUMNS, "--unit", "t=ms,z=cm", *FIT, "--report", str(page)]
    assert command(folder, *options, "--held-out", str(other), "--head", "0.3") == 0
    table = capsys.readouterr().out.split("Prediction")[1]
    row = next(line for line in table.splitlines() if "other" in line)
    assert float(row.split("│")[3]) < 2e3 * NOISE  # mm
    assert "other" in page.read_text()


@pytest.mark.parametrize("options", [["--held-out", "x.csv"], ["--head", "0.1"]])
def test_a_table_to_predict_needs_a_head(folder, capsys, options):
    assert command(folder, *COLUMNS, "--unit", "t=ms,z=cm", *FIT, *options) == 1
    assert "--held-out needs --head" in capsys.readouterr().err
