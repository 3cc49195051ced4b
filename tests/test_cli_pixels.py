"""`dashpot calibrate film.csv`: points in pixels, by one command or a problem file."""

import math
import re

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.calibrate import ImagePlane, Parameter, Problem, Trajectory, predict
from dashpot.cli import main
from dashpot.cli.problem_file import read_problem

SLOPE, RADIUS, SCALE = 15.0, 0.01, 900.0
SCENE = f"""<mujoco><option timestep="0.004" cone="elliptic"/><worldbody>
  <geom name="ramp" type="plane" size="1 1 .1" euler="0 {SLOPE} 0"/>
  <camera name="side" pos=".4 -1 0" xyaxes="1 0 0 0 0 1" fovy="60" resolution="1280 720"/>
  <body name="marble" pos="{RADIUS * math.sin(math.radians(SLOPE))} 0
    {RADIUS * math.cos(math.radians(SLOPE))}"><freejoint/>
    <geom name="marble" size="{RADIUS}" mass="0.033"/></body>
</worldbody></mujoco>"""
COLUMNS = ["--columns", "time=t,u=x_px,v=y_px"]
IMAGE = ["--image", "ruler=100/400/900/400/1.0,origin=60/90"]
FRAMES = 50


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a scene and films of a marble: of a plane, and by the camera."""
    path = tmp_path_factory.mktemp("films")
    (path / "scene.xml").write_text(SCENE)
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(SCENE))
    time = np.arange(FRAMES) / 60
    noise = 0.3 * np.random.default_rng(0).normal(size=(FRAMES, 2))
    for name, camera in (("plane", ImagePlane(scale=SCALE, origin=(60, 90))), ("side", "side")):
        film = Trajectory.of_sensors(
            "film",
            time,
            pixels={"marble": np.zeros((FRAMES, 2))},
            camera=camera,
            initial_qpos=system.model.qpos0,
            initial_qvel=np.zeros(6),
        )
        friction = Parameter.pair("marble", "ramp", "sliding_friction", start=0.5)
        problem = Problem(system, [friction], [film], sensor_sigma={"pixels": 1.0})
        (prediction,) = predict(problem, {"sliding_friction": 0.5})
        (pixels,) = prediction.sensors.values()
        table = np.column_stack([time, pixels + noise])
        np.savetxt(path / f"{name}.csv", table, "%.4f", ",", header="t,x_px,y_px", comments="")
    return path


def command(folder, table, *options):
    scene = ["--model", str(folder / "scene.xml")]
    return main(["calibrate", str(folder / table), *scene, *COLUMNS, *options])


def interval(printed, name):
    line = next(row for row in printed.splitlines() if row.startswith(f"{name}: identified"))
    lower, upper = (float(word) for word in line.split("interval ")[1].split(" to "))
    return lower, upper


@pytest.mark.parametrize("noise", [[], ["--noise", "pixels=3,estimate"]])
def test_one_command_fits_a_film_of_a_plane(folder, capsys, noise):
    """The ruler was read wrong by a ninth; the weight says so."""
    assert command(folder, "plane.csv", *IMAGE, "--fit", "image:scale,origin_v", *noise) == 0
    printed = capsys.readouterr().out
    assert "scale of image: from 800, between 266.7 and 2400\n" in printed
    assert "origin_v of image: from 90, between -10 and 190\n" in printed
    lower, upper = interval(printed, "scale of image")
    assert lower < SCALE < upper
    assert upper - lower < 0.02 * SCALE
    assert ("noise to be estimated" in printed) == bool(noise)


def test_one_command_fits_what_a_camera_of_the_model_saw(folder, capsys):
    fit = ["--fit", "image:tilt", "--camera", "side"]
    assert command(folder, "side.csv", *fit, "--noise", "pixels=0.3") == 0
    printed = capsys.readouterr().out
    lower, upper = interval(printed, "tilt of side")
    assert lower < 0.0 < upper
    assert "noise of side:marble 0.3" in printed


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--fit", "image:scale"], "say which camera saw them"),
        (["--fit", "image:scale", "--camera", "front"], "no camera named 'front'"),
        (["--fit", "image:scale", "--camera", "side", *IMAGE], "give one of them"),
        (["--fit", "image:focus", *IMAGE], "a picture has scale, tilt, origin_u, origin_v, no"),
        (["--fit", "pair:marble,ramp:stiffness"], "say which camera"),
        (["--fit", "image:scale", *IMAGE, "--noise", "height=1"], "or|position, rotation"),
    ],
)
def test_a_wrong_option_of_a_film_is_named(folder, capsys, options, message):
    assert command(folder, "plane.csv", *options) == 1
    assert re.search(message, capsys.readouterr().err)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        ("scale=8,ruler=1/1/2/2/1", "give scale, pixels per metre, or ruler"),
        ("origin=3/4", "give scale, pixels per metre, or ruler"),
        ("scale=8,origin=3", "origin is '3', not N/N"),
        ("scale=8,right=w", "could not convert|right is"),
        ("scale=8,right=x,down=x", "must be perpendicular"),
        ("scale=8,focus=2", "none of scale, ruler"),
        ("ruler=1/1/1/1/1", "two ends"),
    ],
)
def test_a_wrong_picture_is_named(folder, capsys, image, message):
    with pytest.raises(SystemExit):
        command(folder, "plane.csv", "--image", image)
    assert re.search(message, capsys.readouterr().err)


PROBLEM = """
model = "scene.xml"
noise = "estimate"
initial_state = "pose_and_velocity"
sensor_sigma = {{pixels = 1.0}}
[[parameters]]
kind = "image"
quantity = "scale"
bounds = [300, 3000]
[[parameters]]
kind = "delay"
channel = "image"
bounds = [-0.01, 0.01]
[[trajectories]]
bodies = ["marble"]
camera = {{scale = 800, origin = [60, 90]}}
{file}
"""


@pytest.mark.parametrize("form", ["csv", "npz"])
def test_a_problem_file_holds_a_film(folder, form):
    if form == "csv":
        file = 'file = "plane.csv"\ncolumns = {time = "t", u = "x_px", v = "y_px"}'
    else:
        time, *pixels = np.loadtxt(folder / "plane.csv", delimiter=",", skiprows=1).T
        np.savez(folder / "plane.npz", **{"time": time, "pixels.marble": np.transpose(pixels)})
        file = 'file = "plane.npz"'
    text = PROBLEM.format(file=file)
    if form == "npz":
        text = text.replace('bodies = ["marble"]\n', "")
    (folder / "film.toml").write_text(text)
    problem, _ = read_problem(folder / "film.toml")
    assert problem.names == ("scale of image", "delay of image")
    assert problem.noise == "estimate"
    assert problem.deviations["image:marble"] == (1.0,)
    assert problem.parameters[0].start == pytest.approx(math.sqrt(300 * 3000))
    assert problem.trajectories[0].sensors["image:marble"].shape == (FRAMES, 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("origin", "orign"), r"trajectories\[0\].camera: unknown key 'orign'"),
        (("scale = 800, ", ""), r"camera: 'scale' is missing"),
        (("{scale = 800, origin = [60, 90]}", "3"), r"camera is 3, not of type dict"),
        (('"scale"', '"focus"'), r"parameters\[0\]: quantity of a picture must be one of"),
        (('channel = "image"', ""), r"parameters\[1\]: 'channel' is missing"),
    ],
)
def test_what_is_wrong_in_a_problem_file_of_a_film_is_named(folder, change, message):
    file = 'file = "plane.csv"\ncolumns = {time = "t", u = "x_px", v = "y_px"}'
    (folder / "film.toml").write_text(PROBLEM.format(file=file).replace(*change))
    with pytest.raises(ValueError, match=message):
        read_problem(folder / "film.toml")
