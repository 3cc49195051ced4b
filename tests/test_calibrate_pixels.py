"""Points that cameras see, two numbers a frame: pinholes, pictures of planes, and fits to them."""

from __future__ import annotations

import dataclasses
import math
import warnings
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.calibrate import Fit, ImagePlane, Parameter, Problem, Trajectory, fit, predict
from dashpot.calibrate.problem.data_warnings import strange_falls

G = 9.81
STEP = 0.002
FOVY = 'fovy="50"'
SENSOR = 'focal="0.004 0.005" sensorsize="0.0064 0.0048"'
SCENE = """<mujoco><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="5 5 .1"/>
  <camera name="side" pos="0.1 -2 .5" xyaxes="1 .1 0 -.03 .3 1" resolution="640 480" {lens}/>
  <body name="cart" pos="0 -2.5 .3"><joint type="slide" axis="1 0 0"/>
    <joint type="hinge" axis="0 1 0"/><geom size=".1" contype="0" conaffinity="0"/>
    <camera name="aboard" pos="0 .2 .2" xyaxes="1 .1 0 -.05 .1 1" resolution="800 600" {lens}/>
  </body>
  <body name="ball" pos="0.1 0 .7"><freejoint/><geom name="ball" size=".05" mass=".1"/>
    <site name="mark" pos=".02 0 .03"/></body>
</worldbody><sensor>
  <camprojection name="side" site="mark" camera="side"/>
  <camprojection name="aboard" site="mark" camera="aboard"/>
</sensor></mujoco>"""
BALL = [Parameter.pair("ball", "floor", "restitution")]
STATE = [0.1, 0.05, 0.1, 0.0, 0.7, 1.0, 0.0, 0.0, 0.0]
MOVING = [0.4, -0.3, 0.3, 0.1, 1.0, 5.0, 2.0, -3.0]


def engine(lens=FOVY):
    made = dashpot.Engine(mujoco.MjModel.from_xml_string(SCENE.format(lens=lens)))
    made.set_pair_material("ball", "floor", dashpot.Material(2e4, restitution=0.7, friction=0.3))
    return made


def thrown(system, pixels, camera=None, *, frames=31, parameters=BALL, sigma=0.5, **fields):
    """Return a problem of a ball that flies and bounces, its start known."""
    fields = {"initial_qpos": STATE, "initial_qvel": MOVING, **fields}
    time = STEP * 10 * np.arange(frames)
    throw = Trajectory.of_sensors("throw", time, pixels=pixels, camera=camera, **fields)
    return Problem(system, parameters, [throw], sensor_sigma={"pixels": sigma})


def seen(system, point, camera, **options):
    """Return (n, 2) pixels of a point of the model, as predicted."""
    frames = options.get("frames", 31)
    problem = thrown(system, {point: np.zeros((frames, 2))}, camera, **options)
    (prediction,) = predict(problem, problem.start)
    (pixels,) = prediction.sensors.values()
    return pixels


def states(system, frames=31):
    """Yield data at the frames of the throw."""
    data = system.make_data()
    data.qpos[:], data.qvel[:] = STATE, MOVING
    system.model.opt.timestep = STEP
    for _ in range(frames):
        mujoco.mj_forward(system.model, data)
        yield data
        system.step(data, nstep=10)


@pytest.mark.parametrize("lens", [FOVY, SENSOR])
@pytest.mark.parametrize("camera", ["side", "aboard"])
def test_a_site_is_seen_where_mujoco_projects_it(lens, camera):
    """MuJoCo counts from the corner of the first pixel, OpenCV from its middle."""
    system = engine(lens)
    values = {"restitution": BALL[0].start}
    for p, v in values.items():
        system.set_pair_material("ball", "floor", dashpot.Material(2e4, **{p: v}, friction=0.3))
    expected = np.array([d.sensor(camera).data.copy() for d in states(system)]) - 0.5
    np.testing.assert_allclose(
        seen(engine(lens), "mark", camera), expected, atol=1e-5
    )  # a lens is of single precision


def test_a_sensor_of_mujoco_that_projects_is_a_channel_as_any_other():
    time = STEP * 10 * np.arange(31)
    throw = Trajectory.of_sensors(
        "throw", time, {"side": np.zeros((31, 2))}, initial_qpos=STATE, initial_qvel=MOVING
    )
    (prediction,) = predict(
        Problem(engine(), BALL, [throw], sensor_sigma={"side": 1.0}), {"restitution": 0.7}
    )
    own = seen(engine(), "mark", "side", parameters=[_restitution(0.7)])
    np.testing.assert_allclose(prediction.sensors["side"], own + 0.5, atol=1e-9)


def _restitution(value):
    return Parameter.pair("ball", "floor", "restitution", start=value, bounds=(0.1, 0.9))


@pytest.mark.parametrize(
    ("lens", "expected"),
    [
        # The middle of 640 x 480 pixels is at (319.5, 239.5); 2 m ahead, 0.3 m right, 0.2 m up.
        ('fovy="90"', (319.5 + 240 * 0.15, 239.5 - 240 * 0.1)),
        ('focalpixel="700 600" sensorsize=".0064 .0048"', (319.5 + 105.0, 239.5 - 60.0)),
        (
            'focalpixel="700 600" principalpixel="10 20" sensorsize=".0064 .0048"',
            (309.5 + 105.0, 219.5 - 60.0),
        ),
        ('projection="orthographic" fovy="2"', (319.5 + 240 * 0.3, 239.5 - 240 * 0.2)),
    ],
)
def test_lenses_in_closed_form(lens, expected):
    xml = f"""<mujoco><option gravity="0 0 0"/><worldbody><geom name="floor" size=".1"/>
      <camera name="side" pos="0 -2 .5" xyaxes="1 0 0 0 0 1" resolution="640 480" {lens}/>
      <body name="ball" pos="0.3 0 .7"><freejoint/><geom name="ball" size=".05"/></body>
      </worldbody></mujoco>"""
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    start = [0.3, 0, 0.7, 1, 0, 0, 0]
    pixels = seen(system, "ball", "side", frames=2, initial_qpos=start, initial_qvel=[0.0] * 6)
    np.testing.assert_allclose(pixels, [expected] * 2, rtol=1e-6)


@pytest.mark.parametrize("tilt", [0.0, 0.1, -0.4])
@pytest.mark.parametrize("down", [(0, 0, -1), (0, 0, 1)])
def test_pictures_of_planes_in_closed_form(tilt, down):
    """Where the picture is turned clockwise, what is to the right is seen lower."""
    plane = ImagePlane(scale=300, origin=(40, 500), right=(2, 0, 0), down=down, tilt=tilt)
    system = engine()
    system.set_pair_material("ball", "floor", dashpot.Material(2e4, restitution=BALL[0].start))
    place = np.array([d.body("ball").xpos.copy() for d in states(system)])
    u, v = 300 * place[:, 0], 300 * place[:, 2] * down[2]
    expected = np.stack(
        [
            40 + math.cos(tilt) * u - math.sin(tilt) * v,
            500 + math.sin(tilt) * u + math.cos(tilt) * v,
        ],
        axis=1,
    )
    found = seen(engine(), "ball", plane, parameters=BALL)
    flight = slice(0, 12)  # before the floor, whose friction is another
    np.testing.assert_allclose(found[flight], expected[flight], atol=1e-9)


def test_two_points_of_a_ruler_say_scale_tilt_and_origin():
    true = ImagePlane(scale=812, origin=(31, 470), right=(0, 1, 0), tilt=0.05)
    ends = np.array([[0.3, 0.1, 0.2], [-0.1, 0.6, 0.25]])
    flat = ends @ np.array([true.right, true.down]).T * true.scale
    c, s = math.cos(true.tilt), math.sin(true.tilt)
    pixels = flat @ np.array([[c, s], [-s, c]]) + true.origin
    found = ImagePlane.from_points(list(pixels), list(ends), right=(0, 1, 0))
    assert found.scale == pytest.approx(812)
    assert found.tilt == pytest.approx(0.05)
    assert found.origin == pytest.approx((31, 470))


FALL = """<mujoco><option timestep="0.002" gravity="0 0 {g}"/><worldbody>
  <camera name="side" pos="0 -2 -.3" xyaxes="1 0 0 0 0 1" fovy="60" resolution="1280 1024"/>
  <body name="ball"><freejoint/><geom name="ball" size=".02" mass="0.1"/></body>
</worldbody></mujoco>"""


def falling(rng, camera, *, scale=700.0, sigma=0.5, frames=30, rate=60.0, turned=0.0):
    """Return pixels of a ball in free fall, thrown to the right at 1 m/s."""
    time = np.arange(frames) / rate
    x, z = 1.0 * time, 0.3 * time - 0.5 * G * time**2
    if camera == "side":
        focal = 512 / math.tan(math.radians(30))
        pixels = np.stack([639.5 + focal * x / 2, 511.5 - focal * (z + 0.3) / 2], axis=1)
    else:
        u, v = scale * x, -scale * z
        c, s = math.cos(turned), math.sin(turned)
        pixels = np.stack([50 + c * u - s * v, 80 + s * u + c * v], axis=1)
    return time, pixels + sigma * rng.normal(size=pixels.shape)


def gravity_of(system, value):
    system.model.opt.gravity[2] = -value


GRAVITY = Parameter("gravity", start=6.0, bounds=(1.0, 30.0), apply=gravity_of, changes_model=True)
SCALE = Parameter.image("scale", bounds=(200, 3000), start=500)
TILT = Parameter.image("tilt", bounds=(-0.5, 0.5))


@pytest.mark.parametrize(
    ("camera", "parameters", "truth", "noise"),
    [
        ("side", [GRAVITY], {"gravity": G}, "stated"),
        ("picture", [GRAVITY], {"gravity": G}, "estimate"),
        ("picture", [SCALE], {"scale of image": 700.0}, "estimate"),
        ("picture", [SCALE, TILT], {"scale of image": 700.0, "tilt of image": 0.06}, "stated"),
    ],
)
def test_a_fall_on_film_says_gravity_or_the_scale(camera, parameters, truth, noise):
    """Pixels a second squared are g times the scale: either is known from the other."""
    rng = np.random.default_rng(3)
    time, pixels = falling(rng, camera, turned=truth.get("tilt of image", 0.0))
    known = "side" if camera == "side" else ImagePlane(scale=700, origin=(50, 80))
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(FALL.format(g=-G)))
    # How far away it is one camera cannot tell.
    film = Trajectory.of_sensors(
        "fall",
        time,
        pixels={"ball": pixels},
        camera=known,
        initial_qpos=system.model.qpos0,
        initial_qpos_sigma=[np.inf, 0.0, np.inf, 0.0, 0.0, 0.0],
    )
    problem = Problem(
        system,
        parameters,
        [film],
        sensor_sigma={"pixels": 0.5 if noise == "stated" else 2.0},
        initial_state="pose_and_velocity",
        noise=noise,
    )
    result = fit(problem, starts=0)
    for name, value in truth.items():
        assert result[name].lower < value < result[name].upper, result
        assert result[name].identified
        assert result[name].upper - result[name].lower < 0.1 * max(abs(value), 0.1)


def test_intervals_of_films_cover():
    """Of five films, 95 % intervals contain the scale in at least four."""
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(FALL.format(g=-G)))
    covered = 0
    for seed in range(5):
        time, pixels = falling(np.random.default_rng(seed), "picture", frames=20)
        plane = ImagePlane(scale=500, origin=(50, 80))
        film = Trajectory.of_sensors("fall", time, pixels={"ball": pixels}, camera=plane)
        problem = Problem(
            system,
            [SCALE],
            [film],
            sensor_sigma={"pixels": 0.5},
            initial_state="pose_and_velocity",
        )
        scale = fit(problem, starts=0)["scale of image"]
        covered += scale.lower < 700 < scale.upper
    assert covered >= 4


def test_scale_and_gravity_together_are_not_identified():
    time, pixels = falling(np.random.default_rng(0), "picture")
    plane = ImagePlane(scale=700, origin=(50, 80))
    film = Trajectory.of_sensors("fall", time, pixels={"ball": pixels}, camera=plane)
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(FALL.format(g=-G)))
    problem = Problem(
        system,
        [SCALE, GRAVITY],
        [film],
        sensor_sigma={"pixels": 0.5},
        initial_state="pose_and_velocity",
    )
    result = fit(problem, starts=0)
    assert not result["gravity"].identified
    assert not result["scale of image"].identified


SLOPE, RADIUS = math.radians(20.0), 0.01
RAMP = f"""<mujoco><option timestep="0.004" cone="elliptic"/><worldbody>
  <geom name="ramp" type="plane" size="1 1 .1" euler="0 {math.degrees(SLOPE)} 0"/>
  <body name="marble" pos="{RADIUS * math.sin(SLOPE)} 0 {RADIUS * math.cos(SLOPE)}"><freejoint/>
    <geom name="marble" size="{RADIUS}" mass="0.033"/></body>
</worldbody></mujoco>"""
# Rolling: two sevenths of the weight along the ramp are friction's.
ROLLING = 5.0 / 7.0 * G * math.sin(SLOPE)
SLIDING = G * (math.sin(SLOPE) - 0.05 * math.cos(SLOPE))


def marble(acceleration, rng, scale=900.0):
    """Return time and pixels of a marble on a ramp that goes from rest, in a level picture."""
    time = np.arange(50) / 60
    way = 0.5 * acceleration * time**2
    x = RADIUS * math.sin(SLOPE) + way * math.cos(SLOPE)
    z = RADIUS * math.cos(SLOPE) - way * math.sin(SLOPE)
    pixels = np.stack([60 + scale * x, 90 - scale * z], axis=1)
    return time, pixels + 0.3 * rng.normal(size=pixels.shape)


@pytest.mark.parametrize(
    ("acceleration", "parameter", "name", "value"),
    [
        (ROLLING, SCALE, "scale of image", 900.0),
        (
            SLIDING,
            Parameter.pair("marble", "ramp", "sliding_friction", start=0.02, bounds=(1e-3, 1.0)),
            "sliding_friction",
            0.05,
        ),
    ],
)
def test_a_marble_on_a_ramp_says_the_scale_or_its_friction(acceleration, parameter, name, value):
    time, pixels = marble(acceleration, np.random.default_rng(1))
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(RAMP))
    system.set_pair_material("marble", "ramp", dashpot.Material(1e4, friction=(0.3, 0, 0)))
    film = Trajectory.of_sensors(
        "roll",
        time,
        pixels={"marble": pixels},
        camera=ImagePlane(scale=900, origin=(60, 90)),
        initial_qpos=system.model.qpos0,
        initial_qvel=np.zeros(6),
    )
    problem = Problem(system, [parameter], [film], sensor_sigma={"pixels": 0.3})
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a slope goes down without end: nothing falls past it
        result = fit(problem, starts=0)
    # At rest it first presses itself into the ramp.
    assert result[name].value == pytest.approx(value, rel=2e-3)
    assert result[name].upper - result[name].lower < 0.05 * value
    assert result.noise_explains


@pytest.mark.parametrize("way", ["channel", "camera"])
def test_a_film_that_is_late_is_found_late(way):
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(FALL.format(g=-G)))
    time, pixels = falling(np.random.default_rng(0), "picture", sigma=0.0)
    late = 0.02
    x, z = time - late, 0.3 * (time - late) - 0.5 * G * (time - late) ** 2
    pixels = np.stack([50 + 700 * x, 80 - 700 * z], axis=1)
    film = Trajectory.of_sensors(
        "fall",
        time,
        pixels={"ball": pixels},
        camera=ImagePlane(scale=700, origin=(50, 80)),
        initial_qpos=system.model.qpos0,
        initial_qvel=[1.0, 0, 0.3, 0, 0, 0],
    )
    channel = "image:ball" if way == "channel" else "image"
    delay = Parameter.delay(channel, bounds=(-0.01, 0.05))
    result = fit(Problem(system, [delay], [film], sensor_sigma={"pixels": 0.5}), starts=0)
    # Steps of 2 ms of a path with 9.81 m/s^2.
    assert result[f"delay of {channel}"].value == pytest.approx(late, abs=2e-3)


def test_what_was_not_seen_does_not_count():
    time, pixels = falling(np.random.default_rng(0), "picture")
    pixels[5:9], pixels[20, 1] = np.nan, np.nan
    film = Trajectory.of_sensors(
        "fall", time, pixels={"ball": pixels}, camera=ImagePlane(scale=700, origin=(50, 80))
    )
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(FALL.format(g=-G)))
    problem = Problem(
        system, [GRAVITY], [film], sensor_sigma={"pixels": 0.5}, initial_state="pose_and_velocity"
    )
    result = fit(problem, starts=0)
    assert result["gravity"].lower < G < result["gravity"].upper


@pytest.mark.parametrize("attribute", ["cam_fovy", "cam_pos"])
def test_where_a_camera_stands_and_how_wide_it_sees_can_be_estimated(attribute):
    """A fall says how far away it is, in focal lengths."""
    time, pixels = falling(np.random.default_rng(2), "side")
    film = Trajectory.of_sensors("fall", time, pixels={"ball": pixels}, camera="side")
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(FALL.format(g=-G)))
    if attribute == "cam_fovy":
        unknown = Parameter.model(attribute, "side", start=45.0, bounds=(10.0, 120.0))
        value = 60.0
    else:
        unknown = Parameter.model(
            attribute, "side", index=1, start=-3.0, bounds=(-9.0, -1.0), transform="linear"
        )
        value = -2.0
    held = [np.inf, 0.0, np.inf, 0.0, 0.0, 0.0]
    film = Trajectory.of_sensors(
        "fall",
        time,
        pixels={"side:ball": pixels},
        initial_qpos=system.model.qpos0,
        initial_qvel=np.zeros(6),
        initial_qpos_sigma=held,
        initial_qvel_sigma=held,
    )
    problem = Problem(
        system, [unknown], [film], sensor_sigma={"pixels": 0.5}, initial_state="pose_and_velocity"
    )
    found = fit(problem, starts=0)[attribute]
    assert found.lower < value < found.upper
    assert found.upper - found.lower < 0.1 * abs(value)


def test_a_fit_of_a_film_is_saved_reported_and_predicts(tmp_path, undrawn):
    pytest.importorskip("jinja2")
    time, pixels = falling(np.random.default_rng(0), "picture")
    plane = ImagePlane(scale=700, origin=(50, 80))
    film = Trajectory.of_sensors("fall", time, pixels={"ball": pixels}, camera=plane)
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(FALL.format(g=-G)))
    problem = Problem(
        system, [SCALE], [film], sensor_sigma={"pixels": 0.5}, initial_state="pose_and_velocity"
    )
    result = fit(problem, starts=0)
    page = result.report(tmp_path / "fall.html").read_text(encoding="utf-8")
    assert "image:ball u" in page
    assert "0.5 px" in page
    assert "px/m" in page
    loaded = Fit.load(result.save(tmp_path / "fall.json"))
    assert loaded.values == result.values
    (prediction,) = result.predict([film], head=0.2)
    error = prediction.sensor_errors["image:ball"]
    assert np.sqrt(np.mean(error**2)) < 2.0
    other = Trajectory("poses", time, np.zeros((30, 3)), None, "ball", initial_qvel=np.zeros(6))
    both = dataclasses.replace(problem, parameters=[GRAVITY], position_sigma=0.01)
    assert predict(both, {"gravity": G}, [other])[0].position.shape == (30, 1, 3)


@pytest.mark.parametrize(
    ("pixels", "camera", "options", "message"),
    [
        ({"ball": (10, 2)}, None, {}, "of no camera"),
        ({"ball": (10, 3)}, "side", {}, r"must be \(n, 2\)"),
        ({"bal": (10, 2)}, "side", {}, "no body or site 'bal'"),
        ({"ball": (10, 2)}, "sid", {}, "no camera 'sid'"),
        ({"ball": (10, 2)}, "plain", {}, "has no resolution"),
        ({"ball": (10, 2)}, "follows", {}, "follows a body"),
        ({"ball": (10, 2)}, "side", {"sigma": None}, "has no sensor_sigma; 'pixels' is that of"),
        ({"ball": 1300}, "side", {}, r"beyond the 1280 x 1024 .* u counts from the left"),
        (None, "side", {}, "camera is given, but no pixels"),
        ({"ball": (10, 2)}, 3, {}, "name of one of the model or an ImagePlane"),
    ],
)
def test_what_cannot_be_seen_is_named(pixels, camera, options, message):
    xml = FALL.format(g=-G).replace(
        "<worldbody>",
        '<worldbody><camera name="plain"/><camera name="follows" mode="targetbody" target="ball"'
        ' resolution="64 48"/>',
    )
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    given = pixels and {
        name: np.full((10, 2), float(shape)) if isinstance(shape, int) else np.zeros(shape)
        for name, shape in pixels.items()
    }
    sigma = options.get("sigma", 0.5)
    with pytest.raises((ValueError, TypeError), match=message):
        Problem(
            system,
            [GRAVITY],
            [
                Trajectory.of_sensors(
                    "fall",
                    np.arange(10) / 50,
                    pixels=given,
                    camera=camera,
                    initial_qpos=system.model.qpos0,
                    initial_qvel=np.zeros(6),
                )
            ],
            position_sigma=1.0,
            sensor_sigma={} if sigma is None else {"pixels": sigma},
        )


@pytest.mark.parametrize(
    ("parameter", "message"),
    [
        (Parameter.image("scale", "other", bounds=(1, 9)), "no trajectory has a channel 'other'"),
        (Parameter.gain("image", bounds=(0.5, 2)), "camera 'image' has no gain"),
        (Parameter.image("tilt", "image:ball", bounds=(-1, 1)), "is no camera, and has no tilt"),
    ],
)
def test_parameters_of_pictures_that_are_not_there_are_named(parameter, message):
    system = engine()
    plane = ImagePlane(scale=100)
    with pytest.raises(ValueError, match=message):
        thrown(system, {"ball": np.zeros((31, 2))}, plane, parameters=[parameter])


def test_a_quantity_that_pictures_have_not_is_named():
    with pytest.raises(ValueError, match="must be one of scale, tilt, origin_u, origin_v"):
        Parameter.image("focus", bounds=(1, 2))


def test_a_point_behind_the_camera_is_an_error_that_says_so():
    system = engine()
    start = [*STATE[:2], 0.1, -4.0, *STATE[4:]]
    problem = thrown(system, {"ball": np.full((31, 2), 99.0)}, "side", initial_qpos=start)
    with pytest.raises(ValueError, match=r"'side:ball' reads nan; it is behind the camera"):
        fit(problem, starts=0)
    (prediction,) = predict(problem, problem.start)
    assert np.isnan(prediction.sensors["side:ball"]).all()


@pytest.fixture(name="table")
def _table(tmp_path):
    """Return a table of a marble that rolls from rest, as a tracker of films writes it."""
    time, pixels = marble(ROLLING, np.random.default_rng(1))
    rows = [f"{t:.4f};{u:.2f};{v:.2f}" for t, (u, v) in zip(time, pixels, strict=True)]
    rows[7] = f"{time[7]:.4f};;"
    file = tmp_path / "marble.csv"
    file.write_text("\n".join(["t;x_px;y_px", *rows]))
    (tmp_path / "ramp.xml").write_text(RAMP)
    return file


COLUMNS = {"time": "t", "u": "x_px", "v": "y_px"}


def test_columns_of_a_table_are_pixels(table):
    plane = ImagePlane(scale=900, origin=(60, 90))
    film = Trajectory.from_csv(table, columns=COLUMNS, body="marble", camera=plane)
    _, pixels = marble(ROLLING, np.random.default_rng(1))
    pixels[7] = np.nan
    np.testing.assert_allclose(film.sensors["image:marble"], pixels, atol=0.006)
    assert film.bodies == ()
    assert film.views["image:marble"].plane == plane
    by_camera = Trajectory.from_csv(table, columns=COLUMNS, body="marble", camera="side")
    assert list(by_camera.sensors) == ["side:marble"]
    assert dataclasses.replace(film, name="other").views == film.views
    assert film.between(0.2, 0.4).views == film.views


def test_poses_of_one_body_and_pixels_of_another_are_in_one_table(tmp_path):
    file = tmp_path / "two.csv"
    file.write_text("time,a.x,a.z,b.u,b.v\n0,1,2,3,4\n0.1,2,3,4,5\n")
    both = Trajectory.from_csv(file, body=("a", "b"), camera="side")
    assert both.bodies == ("a",)
    np.testing.assert_array_equal(both.sensors["side:b"], [[3, 4], [4, 5]])
    alone = Trajectory.from_csv(file, body="a")  # columns of its own, as no camera is given
    assert not alone.views


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"columns": COLUMNS, "body": "marble"}, "'u' is in pixels: say which camera"),
        ({"columns": COLUMNS, "camera": "side"}, "'u' is in pixels: say of which body"),
        (
            {"columns": {"time": "t", "x": "x_px"}, "body": "marble", "camera": "side"},
            "no column 'u' or 'v'",
        ),
    ],
)
def test_columns_in_pixels_that_are_of_nothing_are_named(table, fields, message):
    with pytest.raises(ValueError, match=message):
        Trajectory.from_csv(table, **fields)


JOINTS = {
    "free": "<freejoint/>",
    "planar": '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
    '<joint type="hinge" axis="0 1 0"/>',
    "pendulum": '<joint type="hinge" axis="0 1 0" pos="-.5 0 .2"/>',
}


@pytest.mark.parametrize("joints", [*JOINTS])
@pytest.mark.parametrize("camera", ["picture", "side"])
def test_the_search_starts_where_the_film_does(joints, camera):
    """Within noise, as fast as in the first frames; the model has it elsewhere, at rest."""
    xml = f"""<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody>
      <camera name="side" pos="0 -2 0" xyaxes="1 0 0 0 0 1" fovy="60" resolution="1280 1024"/>
      <body name="ball">{JOINTS[joints]}<geom size=".05" mass="1"/>
      <site name="mark" pos=".1 0 .05"/></body></worldbody></mujoco>"""
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    start, speed = system.model.qpos0.copy(), np.zeros(system.model.nv)
    if joints == "pendulum":
        start[0], speed[0] = 0.4, -0.8
    else:
        start[[0, 1 if joints == "planar" else 2]] += 0.3, -0.2
        speed[[0, 1 if joints == "planar" else 2]] = 0.5, -0.4
    seen_by = ImagePlane(scale=700, origin=(200, 300)) if camera == "picture" else "side"
    fields = {"initial_qpos": start, "initial_qvel": speed}
    unknown = [Parameter.model("body_mass", "ball", start=1.0, bounds=(0.5, 2.0))]
    point = "ball" if joints == "planar" else "mark"
    blank = thrown(
        system, {point: np.zeros((8, 2))}, seen_by, frames=8, parameters=unknown, **fields
    )
    (prediction,) = predict(blank, {"body_mass": 1.0})
    film = Trajectory.of_sensors(
        "film",
        blank.trajectories[0].time,
        pixels={point: next(iter(prediction.sensors.values()))},
        camera=seen_by,
    )
    problem = Problem(
        system, unknown, [film], sensor_sigma={"pixels": 0.5}, initial_state="pose_and_velocity"
    )
    qpos, qvel = problem.initial_states(system.model)
    np.testing.assert_allclose(qpos[0], start, atol=0.02)
    np.testing.assert_allclose(qvel[0], speed, atol=0.06)
    still = dataclasses.replace(problem, initial_state="velocity").initial_states(system.model)
    np.testing.assert_array_equal(still[0][0], system.model.qpos0)


def test_a_marble_that_is_seen_from_the_middle_of_its_way_on():
    """Scale and tilt are found from a start that is off by an eighth."""
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(RAMP))
    system.set_pair_material("marble", "ramp", dashpot.Material(1e4, friction=(0.3, 0, 0)))
    time = np.arange(40) / 60
    way = 0.25 + 0.15 * time + 0.5 * ROLLING * time**2
    x = RADIUS * math.sin(SLOPE) + way * math.cos(SLOPE)
    z = RADIUS * math.cos(SLOPE) - way * math.sin(SLOPE)
    pixels = np.stack([100 + 800 * x, 60 - 800 * z], axis=1)
    pixels += 0.3 * np.random.default_rng(0).normal(size=pixels.shape)
    film = Trajectory.of_sensors(
        "roll", time, pixels={"marble": pixels}, camera=ImagePlane(scale=700, origin=(100, 60))
    )
    problem = Problem(
        system, [SCALE, TILT], [film], sensor_sigma={"pixels": 0.3},
        initial_state="pose_and_velocity",
    )  # fmt: skip
    result = fit(problem, starts=0)
    assert result["scale of image"].lower < 800 < result["scale of image"].upper
    assert result["tilt of image"].lower < 0 < result["tilt of image"].upper
    assert result.evaluations < 1500


def test_each_film_has_a_picture_and_a_scale_of_its_own():
    """Two cameras at other distances, whose problem goes to its worker pickled."""
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(FALL.format(g=-G)))
    films = []
    for name, scale in (("near", 900.0), ("far", 400.0)):
        time, pixels = falling(np.random.default_rng(4), "picture", scale=scale)
        plane = ImagePlane(scale=scale + 100, origin=(50, 80))
        films.append(Trajectory.of_sensors(name, time, pixels={"ball": pixels}, camera=plane))
    problem = Problem(
        system,
        [Parameter.image("scale", bounds=(200, 3000), start=500, per="trajectory")],
        films,
        sensor_sigma={"pixels": 0.5},
        initial_state="pose_and_velocity",
    )
    with ThreadPoolExecutor(1) as pool:
        result = fit(problem, starts=0, executor=pool)
    for name, scale in (("near", 900.0), ("far", 400.0)):
        estimate = result[f"scale of image[{name}]"]
        assert estimate.lower < scale < estimate.upper


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda uv: uv, None),
        (lambda uv: uv * [1, -1] + [0, 900], "falls at -1 times gravity, as with an axis"),
        (lambda uv: 50 + 100 * (uv - 50), "falls at 100 times gravity, as with positions in cm"),
    ],
)
@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_rows_that_count_from_below_are_told_by_a_fall(change, said, tilt):
    time, pixels = falling(np.random.default_rng(0), "picture", turned=tilt)
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(FALL.format(g=-G)))
    down = ImagePlane(scale=700, origin=(50, 80), tilt=tilt if said is None else -tilt)
    if said is not None and "100" in said:
        down = dataclasses.replace(down, tilt=tilt)
    film = Trajectory.of_sensors("fall", time, pixels={"ball": change(pixels)}, camera=down)
    problem = Problem(
        system, [SCALE], [film], sensor_sigma={"pixels": 0.5}, initial_state="pose_and_velocity"
    )
    found = strange_falls(problem)
    assert (said is None and not found) or said in found["fall"]


def test_of_a_marble_that_rolls_friction_is_not_identified():
    """Any from two sevenths of the slope on will do; it must not end where all of it slides."""
    time, pixels = marble(ROLLING, np.random.default_rng(1))
    system = dashpot.Engine(mujoco.MjModel.from_xml_string(RAMP))
    system.set_pair_material("marble", "ramp", dashpot.Material(1e4, friction=(0.3, 0, 0)))
    film = Trajectory.of_sensors(
        "roll", time, pixels={"marble": pixels}, camera=ImagePlane(scale=900, origin=(60, 90))
    )
    friction = Parameter.pair("marble", "ramp", "sliding_friction", start=0.02, bounds=(0.01, 1.0))
    problem = Problem(
        system,
        [friction],
        [film],
        sensor_sigma={"pixels": 0.3},
        initial_state="pose_and_velocity",
    )
    found = fit(problem)["sliding_friction"]
    assert not found.identified
    assert found.lower < 0.3 < found.upper


@pytest.mark.parametrize("name", ["impact", "peak", "poses", "sensor"])
def test_cameras_have_any_name(name):
    """Events and scalars are named like channels of pixels."""
    xml = SCENE.format(lens=FOVY).replace('"side"', f'"{name}"')
    pixels = seen(dashpot.Engine(mujoco.MjModel.from_xml_string(xml)), "mark", name)
    np.testing.assert_array_equal(pixels, seen(_plain(), "mark", "side"))


def _plain():
    return dashpot.Engine(mujoco.MjModel.from_xml_string(SCENE.format(lens=FOVY)))
