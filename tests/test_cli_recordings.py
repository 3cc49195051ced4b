"""`dashpot calibrate`: recordings of poses and sensors in archives and tables."""

import json
import math

import numpy as np
import pytest

from dashpot.cli import main
from dashpot.cli.problem_file import read_problem

BALL = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="ball" pos="0 0 1"><joint name="z" type="slide" axis="0 0 1"/>
      <geom name="ball" size=".1" mass="1"/><site name="imu"/></body>
  </worldbody>
  <sensor>
    <jointpos name="height" joint="z"/>
    <accelerometer name="imu" site="imu"/>
  </sensor>
</mujoco>
"""
GRAVITY = 9.81


@pytest.fixture
def problem(tmp_path):
    """Return a function that writes a problem with a recording, and the path of the problem."""
    (tmp_path / "ball.xml").write_text(BALL)

    def write(trajectory, **changes):
        parameter = {
            "kind": "model", "attribute": "body_gravcomp", "elements": "ball",
            "transform": "linear", "start": 0.5, "bounds": [-1.0, 1.0],
        }  # fmt: skip
        content = {
            "model": "ball.xml", "position_sigma": math.inf, "rotation_sigma": math.inf,
            "sensor_sigma": {"height": 1e-3, "imu": [0.1, 0.1, 0.1]},
            "initial_state": "velocity", "parameters": [parameter], "trajectories": [trajectory],
            **changes,
        }  # fmt: skip
        file = tmp_path / "problem.json"
        file.write_text(json.dumps(content))
        return file

    return write


def fall(frames=21):
    """Return times, heights and accelerations of a fall with a tenth of its weight taken off."""
    time = 0.01 * np.arange(frames)
    noise = np.random.default_rng(0).normal(size=(frames, 4))
    height = -0.5 * 0.9 * GRAVITY * time**2 + 1e-3 * noise[:, 0]
    # What carries a tenth of the weight is felt.
    return time, height, [0.0, 0.0, 0.1 * GRAVITY] + 0.1 * noise[:, 1:]


def write_table(file, columns, rows):
    lines = [",".join(columns), *(",".join(f"{x:.9g}" for x in row) for row in rows)]
    file.write_text("\n".join(lines))


@pytest.mark.parametrize("form", ["csv", "npz"])
def test_sensors_alone_are_fitted(problem, tmp_path, capsys, form):
    time, height, force = fall()
    if form == "csv":
        names = ["time", "sensors.height", *(f"sensors.imu.{i}" for i in range(3))]
        write_table(tmp_path / "fall.csv", names, np.c_[time, height, force])
    else:
        arrays = {"sensors.height": height, "sensors.imu": force}
        np.savez(tmp_path / "fall.npz", time=time, **arrays)
    out = tmp_path / "fit.json"
    assert main(["calibrate", str(problem({"file": f"fall.{form}"})), "--out", str(out)]) == 0
    (estimate,) = json.loads(out.read_text())["estimates"]
    assert estimate["identified"]
    assert abs(estimate["value"] - 0.1) < 3.0 * estimate["standard_error"]
    printed = capsys.readouterr().out
    assert "residuals: height 0.00" in printed
    assert ", imu 0.1" in printed


def test_empty_cells_of_a_table_were_not_measured(problem, tmp_path):
    rows = [
        "time,x,y,z,qw,qx,qy,qz,sensors.height",
        "0,0,0,1,1,0,0,0,0",
        "1,,,,1,0,0,0,",
        "2,nan,0,0,,,,,0",
    ]
    (tmp_path / "drop.csv").write_text("\n".join(rows))
    file = problem({"file": "drop.csv", "bodies": ["ball"]}, position_sigma=1.0)
    (trajectory,) = read_problem(file)[0].trajectories
    measured = [[1, 1, 1, 1, 1, 1], [0, 0, 0, 1, 1, 1], [0, 1, 1, 0, 0, 0]]
    np.testing.assert_array_equal(trajectory.measured[:, 0], measured)
    np.testing.assert_array_equal(np.isnan(trajectory.sensors["height"][:, 0]), [0, 1, 0])


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (["time", "sensors.imu.0", "sensors.imu.2"], "columns of sensor 'imu' must be .*imu.1"),
        (["time", "sensors.height", "sensors.height"], "2 columns are named 'sensors.height'"),
        (["time", "sensors.far"], "no sensor 'far'"),
        (["time"], "bodies must be one or more"),
        (["sensors.height"], "no column 'time'"),
    ],
)
def test_a_bad_table_of_sensors_is_named(problem, tmp_path, columns, message):
    write_table(tmp_path / "bad.csv", columns, np.arange(3)[:, None] * np.ones(len(columns)))
    with pytest.raises(ValueError, match=message):
        read_problem(problem({"file": "bad.csv"}))
