"""Calibration: tables of laboratories, with columns, units and gaps of their own."""

import numpy as np
import pytest

from dashpot.calibrate import Trajectory

TIME = 0.01 * np.arange(6)
HEIGHT = 1.0 - 0.5 * 9.81 * TIME**2
BALL = {"columns": {"time": "t", "z": "height"}, "body": "ball"}


@pytest.fixture
def table(tmp_path):
    """Return a function that writes rows, and returns the path."""

    def write(*lines, name="ball.csv"):
        file = tmp_path / name
        file.write_text("\n".join(lines), encoding="utf-8")
        return file

    return write


def heights(time=TIME, height=HEIGHT, between=","):
    return [f"{t:.9g}{between}{z:.9g}" for t, z in zip(time, height, strict=True)]


def test_a_height_alone_leaves_the_rest_unmeasured(table):
    ball = Trajectory.from_csv(table("t,height,comment", *(f"{r},x" for r in heights())), **BALL)
    assert ball.name == "ball"
    np.testing.assert_allclose(ball.time, TIME)
    np.testing.assert_allclose(ball.position[:, 0, 2], HEIGHT)
    np.testing.assert_array_equal(ball.measured[:, 0], np.tile([0, 0, 1, 0, 0, 0], (6, 1)))


@pytest.mark.parametrize(
    ("length", "metres"),
    [("cm", 0.01), ("mm", 1e-3), ("in", 0.0254), ("m", 1.0), (-0.01, -0.01), ("µm", 1e-6)],
)
@pytest.mark.parametrize(("span", "seconds"), [("ms", 1e-3), ("us", 1e-6), ("s", 1.0), (60, 60.0)])
@pytest.mark.parametrize("named", ["key", "column"])
def test_units_of_a_file_become_those_of_si(table, length, metres, span, seconds, named):
    file = table("t,height", *heights(TIME / seconds, HEIGHT / metres))
    unit = {"time": span, "z": length} if named == "key" else {"t": span, "height": length}
    ball = Trajectory.from_csv(file, unit=unit, **BALL)
    np.testing.assert_allclose(ball.time, TIME, atol=1e-9)
    np.testing.assert_allclose(ball.position[:, 0, 2], HEIGHT, rtol=1e-8)


@pytest.mark.parametrize(
    "lines",
    [
        ["t;height", *(r.replace(".", ",") for r in heights(between=";"))],
        ["t\theight", *heights(between="\t")],
        ["# Tracker 6, mass A, 30 fps", "", "t,height", *heights()],
        ["# t,height", *heights()],
        ["\ufefft , height", *heights(), "", " "],
        ['"t";"height"', *heights(between=";")],
    ],
    ids=["decimal comma", "tabs", "comment", "commented header", "spreadsheet", "quoted"],
)
def test_files_of_spreadsheets_and_trackers_are_read(table, lines):
    ball = Trajectory.from_csv(table(*lines), **BALL)
    np.testing.assert_allclose(ball.time, TIME, atol=1e-9)
    np.testing.assert_allclose(ball.position[:, 0, 2], HEIGHT)


@pytest.mark.parametrize("missing", ["", " ", "nan", "NA", "N/A", "null", "-"])
def test_missing_cells_were_not_measured(table, missing):
    rows = heights()
    rows[2] = f"{TIME[2]},{missing}"
    ball = Trajectory.from_csv(table("t,height", *rows), **BALL)
    np.testing.assert_array_equal(np.isnan(ball.position[:, 0, 2]), np.arange(6) == 2)


def test_runs_of_a_file_are_a_list(table):
    """A load cell at 100 Hz beside a motion sensor at 25 Hz, as a cart against foam has them."""
    rows = [
        f"{run},{t},{-0.1 * run * i},{0.2 * i if i % 4 == 0 else ''}"
        for run in (1, 2, 10)
        for i, t in enumerate(0.01 * np.arange(9))
    ]
    file = table("run,time_s,force_N,position_m", *rows, name="pad.csv")
    columns = {"time": "time_s", "sensor:load": "force_N", "sensor:motion": "position_m"}
    runs = Trajectory.from_csv(file, columns=columns, run="run", initial_qvel=[1.0])
    assert [run.name for run in runs] == ["run 1", "run 2", "run 10"]
    for number, run in zip((1, 2, 10), runs, strict=True):
        assert run.bodies == ()
        np.testing.assert_allclose(run.sensors["load"][:, 0], -0.1 * number * np.arange(9))
        np.testing.assert_array_equal(np.isnan(run.sensors["motion"][:, 0]), np.arange(9) % 4 != 0)
        assert run.initial_qvel.tolist() == [1.0]
    named = Trajectory.from_csv(file, columns=columns, run="run", name="thin")
    assert named[2].name == "thin 10"


def test_poses_of_several_bodies_and_sensors_with_several_numbers(table):
    names = ["x", "y", "z", "qw", "qx", "qy", "qz"]
    header = ["time", *(f"left.{n}" for n in names), "right.z", "sensors.imu.0", "sensor:imu.1"]
    rows = np.c_[TIME, np.ones((6, 3)), np.tile([0, 1, 0, 0], (6, 1)), HEIGHT, TIME, -TIME]
    lines = [",".join(f"{x:.9g}" for x in row) for row in rows]
    pair = Trajectory.from_csv(table(",".join(header), *lines), body=["left", "right"])
    np.testing.assert_array_equal(pair.quaternion[:, 0], np.tile([0, 1, 0, 0], (6, 1)))
    np.testing.assert_array_equal(pair.measured[0, 1], [0, 0, 1, 0, 0, 0])
    np.testing.assert_allclose(pair.sensors["imu"], np.c_[TIME, -TIME])


@pytest.mark.parametrize("seed", range(3))
def test_stamps_of_a_file_may_jitter(table, seed):
    number = np.arange(60)
    stamp = np.maximum.accumulate(
        (number + 0.25 * np.random.default_rng(seed).normal(size=60)) / 120
    )
    height = 2.0 * number / 120 - 0.5 * 9.81 * (number / 120) ** 2
    file = table("t,height", *heights(stamp, height))
    np.testing.assert_array_equal(
        Trajectory.from_csv(file, frames="even", **BALL).frame_number, number
    )
    with pytest.raises(ValueError, match=r"ball.csv: trajectory 'ball': .* Say frames='even'$"):
        Trajectory.from_csv(file, **BALL)


@pytest.mark.parametrize(
    ("lines", "options", "message"),
    [
        (["t,heigth", "0,1", "1,2"], {}, "no column 'height'; did you mean 'heigth'"),
        (["t,height", "0,1", "1,2,3"], {}, "line 3 has 3 values, the header 2"),
        (["#", "t,height", "0,1", "1,up"], {}, "line 4, column 'height': 'up' is not a number"),
        (["t,height", "0,1", ",2"], {}, "line 3, column 't': '' is not a number"),
        (["t,height", "0,1", "1,2_0"], {}, "line 3, column 'height': '2_0' is not a number"),
        (["t,height", "0,1", "nan,2"], {}, "line 3, column 't': nan is not a finite number"),
        (["t,height", "0,1", "1,1e999"], {}, "line 3, column 'height': 1e999 is not a finite"),
        (["t,height", "0,1"], {}, "a header and at least two rows are needed"),
        ([""], {}, "it is empty"),
        (["t,height,t", "0,1,0", "1,2,0"], {}, "2 columns are named 't'"),
        (["t,height", "0,1", "0,2"], {}, r"trajectory 'ball': time must increase strictly"),
        (["t,height", "0,1", "1,2"], {"unit": {"z": "cn"}}, "'cn', no unit that is known; give"),
        (["t,height", "0,1", "1,2"], {"unit": {"y": "cm"}}, "unit: 'y' is none of time, ball.z"),
        (["t,height", "0,1", "1,2"], {"unit": {"z": 0.0}}, r"unit\['z'\] must be a unit, or a"),
        (["t,height", "0,1", "1,2"], {"columns": {"time": "t", "hight": "height"}},
         "columns: 'hight' is nothing that a trajectory holds"),
        (["t,height", "0,1", "1,2"], {"columns": {"z": "height"}}, "no column 'time'"),
        (["t,height", "0,1", "1,2"], {"body": ()}, "column 'z' is of a pose: say of which body"),
        (["t,height", "0,1", "1,2"], {"columns": {"time": "t", "qw": "height"}},
         "no column 'qx' of the quaternion of body 'ball'"),
        (["t,height", "0,1", "1,2"], {"body": ["ball", "box"]}, "column .z. is of a pose"),
        (["t,height", "0,1", "1,2", "0,3"], {}, "time goes back, from 1 to 0 s; where a file has"),
        (["t,height,r", "0,1,a", "1,2,a", "0,1,b"], {"run": "r"}, "two rows of run 'b' are needed"),
        (["t,height,r", "0,1,a", "1,2,"], {"run": "r"}, "line 3, column 'r': no name of a run"),
        (["t,height", "0,1", "1,2"], {"frames": "odd"}, "frames must be 'stamped' or 'even'"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_named(table, lines, options, message):
    with pytest.raises(ValueError, match=rf"ball\.csv: .*{message}"):
        Trajectory.from_csv(table(*lines), **{**BALL, **options})


def test_columns_of_old_programs_have_umlauts(tmp_path):
    file = tmp_path / "ball.csv"
    file.write_bytes("\n".join(["t;H\u00f6he (cm)", *heights(between=";")]).encode("latin-1"))
    columns = {"time": "t", "z": "H\u00f6he (cm)"}
    ball = Trajectory.from_csv(file, columns=columns, body="ball", unit={"z": "cm"})
    np.testing.assert_allclose(ball.position[:, 0, 2], HEIGHT / 100)


def test_a_file_of_bytes_is_no_table(tmp_path):
    file = tmp_path / "ball.csv"
    file.write_bytes(b"t,height\n0,\xff\xfe\n")
    with pytest.raises(
        ValueError, match=r"ball\.csv: line 2, column 'height': '.*' is not a number"
    ):
        Trajectory.from_csv(file, **BALL)
    file.write_bytes("t,height\n0,1\n1,2\n".encode("utf-16"))
    with pytest.raises(ValueError, match=r"ball\.csv: no column 't'"):
        Trajectory.from_csv(file, **BALL)


@pytest.mark.parametrize("seed", range(3))
def test_damaged_tables_are_refused_by_name(table, seed):
    """Or read, where what is left is still a table: `benchmarks/mutated_files.py` does many."""
    rng = np.random.default_rng(seed)
    whole = "\n".join(
        ["t;height;r", *(f"{r};{i // 3}" for i, r in enumerate(heights(between=";")))]
    )
    said, read = [], 0
    file = table(whole)
    for _ in range(300):
        text = list(whole)
        for _ in range(rng.integers(1, 4)):
            text[rng.integers(len(text))] = chr(
                rng.choice([48 + rng.integers(10), rng.integers(256)])
            )
        file.write_text("".join(text), encoding="utf-8")
        try:
            Trajectory.from_csv(file, run="r", **BALL)
            read += 1
        except ValueError as error:
            said.append(str(error))
    assert read > 10
    assert all(message.startswith(f"{file}: ") for message in said)


def test_many_runs_are_bounded(table):
    rows = [f"{i},0,{i // 2}" for i in range(20_010)]
    with pytest.raises(ValueError, match=r"line 20002: more than 10000 runs in 'r'"):
        Trajectory.from_csv(table("t,height,r", *rows), run="r", **BALL)
