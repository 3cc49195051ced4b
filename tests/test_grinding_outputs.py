"""What a plan writes: set points, figures, a report, an animation; and the command that plans."""

from __future__ import annotations

import csv
import functools

import mujoco
import numpy as np
import pytest
from PIL import Image

from dashpot import grinding
from dashpot.cli import main
from dashpot.grinding import video
from grinding_scenes import PRESTON, ball_on_cylinder

CELL = """
depth = 30e-6
preston = 4.7e-10
max_force = 90
[contact]
stiffness = 2e4
[tool]
kind = "ball_nose"
radius = 0.02
spin = 47
[work]
kind = "box"
size = [0.3, 0.2, 0.05]
position = [0, 0.5, 0.1]
[path]
kind = "line"
start = [-0.05, 0.5]
end = [0.05, 0.5]
tilt = 0.35
[simulation]
timestep = 0.005
"""


@functools.cache
def planned():
    made, path = ball_on_cylinder(0.005, 0.5)
    return grinding.plan(made, path, 50e-6, preston=PRESTON, max_force=90.0)


def test_the_table_holds_angles_of_the_poses_that_it_names(tmp_path):
    plan = planned()
    file = plan.save(tmp_path / "pass.csv")
    with open(file, newline="") as stream:
        rows = list(csv.DictReader(stream))
    time = np.array([float(row["time"]) for row in rows])
    np.testing.assert_allclose(np.diff(time), plan.cell.control.period, atol=1e-9)
    assert time[-1] >= plan.duration
    parts = plan.cell.rigid
    data = mujoco.MjData(parts.model)
    row = rows[len(rows) // 2]
    data.qpos[:] = [float(row[name]) for name in parts.joint_names]
    mujoco.mj_kinematics(parts.model, data)
    place = [float(row[axis]) for axis in "xyz"]
    np.testing.assert_allclose(data.site_xpos[parts.tip], place, atol=1e-7)
    assert float(row["force"]) > 30
    assert f"{parts.joint_names[0]}.sent" in row


def test_a_report_needs_nothing_from_outside(tmp_path):
    plan = planned()
    checks = plan.check(timestep=1e-3)
    text = plan.report(tmp_path / "pass.html", checks=checks).read_text(encoding="utf-8")
    assert "MuJoCo, direct solref" in text
    assert text.count("data:image/svg+xml;base64") == 4
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert plan.plot(tmp_path / "depth.png") is not None
    assert Image.open(tmp_path / "depth.png").width > 500


@pytest.mark.parametrize("backend", [None, "glfw"])
def test_an_animation_is_drawn_where_no_gl_is(backend, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    if backend is not None:
        monkeypatch.setenv("MUJOCO_GL", backend)
    video._gl_is_there.cache_clear()
    image = Image.open(planned().video(tmp_path / "pass.gif", frames=4))
    assert image.n_frames >= 2
    with pytest.raises(ValueError, match=r"does not end in \.gif"):
        planned().video(tmp_path / "pass.mp4")


def test_the_command_plans_what_a_file_states(tmp_path, capsys):
    file = tmp_path / "cell.toml"
    file.write_text(CELL)
    out = tmp_path / "pass.csv"
    assert main(["grind", str(file), "--save", str(out), "--threads", "1"]) == 0
    said = capsys.readouterr().out
    assert "Plan(30 um in" in said
    assert out.is_file()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("stiffness = 2e4", "stifness = 2e4", "unknown key 'stifness'; did you mean 'stiffness'"),
        ('kind = "ball_nose"', 'kind = "burr"', "tool: kind is 'burr', none of ball_nose, disc"),
        ("max_force = 90", "", "'max_force' is missing"),
        ("end = [0.05, 0.5]", "end = [0.5, 0.5]", "path is off the part"),
        ("depth = 30e-6", "depth = -1", "plan: depth must be finite and > 0"),
    ],
)
def test_the_command_names_what_is_wrong(tmp_path, capsys, old, new, message):
    file = tmp_path / "cell.toml"
    file.write_text(CELL.replace(old, new))
    assert main(["grind", str(file)]) == 1
    assert message in capsys.readouterr().err


def test_the_format_is_a_cell_file(capsys, tmp_path):
    from dashpot.cli.cell_file import read_task

    assert main(["grind", "--format"]) == 0
    file = tmp_path / "cell.toml"
    file.write_text(capsys.readouterr().out)
    task = read_task(file)
    assert task.cell.stiffness == 2e4
    assert task.options["depth"] == 50e-6
    assert main(["grind"]) == 1


def test_the_command_fits_a_press_first(tmp_path, capsys):
    file = tmp_path / "cell.toml"
    file.write_text(CELL + '[press]\nfile = "press.csv"\npoint = [0, 0.5, 0]\nsampling = "mean"\n')
    from dashpot.cli.cell_file import read_task

    (tmp_path / "press.csv").write_text("time,force,position\n")
    with pytest.raises(ValueError, match="no column 'time' among nothing"):
        read_task(file)
    plain = tmp_path / "plain.toml"
    plain.write_text(CELL)
    stiff = read_task(plain).cell.with_changes(stiffness=2.4e4)
    log = grinding.record_press(stiff, (0, 0.5, 0), duration=0.3, timestep=2.5e-4)
    log.save(tmp_path / "press.csv")
    assert main(["grind", str(file), "--threads", "1"]) == 0
    assert "the load cell reads means" in capsys.readouterr().out
