"""Films beside what explains misfits and functions of the user's own, and frozen parameters."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.calibrate import ImagePlane, Parameter, Problem, Trajectory, fit, predict

SPRING = """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody>
  <body name="cart">
    <joint name="rail" type="slide" axis="1 0 0" stiffness="40" damping="0.4"/>
    <geom size=".1" mass="1"/><site name="mark" pos=".1 0 .1"/></body>
</worldbody><sensor><jointpos name="place" joint="rail"/></sensor></mujoco>"""
TIME = 0.01 * np.arange(120)
PLANE = ImagePlane(scale=800.0, origin=(320.0, 240.0))
STIFFNESS = Parameter.model(
    "jnt_stiffness", "rail", start=35.0, bounds=(20.0, 80.0), name="stiffness"
)


def swinging(parameters, readings=None, **options):
    """Return a problem of a cart on a spring, its encoder read and two points of it filmed."""
    if readings is None:
        readings = {name: np.zeros((TIME.size, 2)) for name in ("image:cart", "image:mark")}
        readings["place"] = np.zeros((TIME.size, 1))
    seen = {name: readings[f"image:{name}"] for name in ("cart", "mark")}
    film = Trajectory.of_sensors(
        "film", TIME, sensors={"place": readings["place"]}, pixels=seen, camera=PLANE,
        initial_qpos=[0.1], initial_qvel=[0.0],
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string(SPRING)
    sigma = {"place": 1e-3, "pixels": 0.5}
    return Problem(
        dashpot.Engine(model), parameters, [film], sensor_sigma=sigma, substeps=2, **options
    )


def recorded(late, seed=0):
    """Return readings with noise of a film that is so late beside the encoder."""
    delay = Parameter.delay("image", bounds=(-0.05, 0.05), start=late)
    problem = swinging([STIFFNESS, delay])
    (prediction,) = predict(problem, {"stiffness": 40.0, "delay of image": late})
    random = np.random.default_rng(seed)
    return {
        name: values + random.normal(0.0, 1e-3 if name == "place" else 0.5, values.shape)
        for name, values in prediction.sensors.items()
    }


def test_a_film_that_is_late_is_explained_by_a_delay_of_its_camera():
    result = fit(swinging([STIFFNESS], recorded(0.02)), starts=0)
    (said,) = result.explanations
    assert (said.channel, said.quantity) == ("image", "delay")
    assert said.value == pytest.approx(0.02, abs=4.0 * said.standard_error)
    assert 'Parameter.delay("image")' in str(said)
    assert said.white


def test_what_is_held_beside_the_unknowns_does_not_hinder_an_explanation():
    gain = Parameter.gain("place", bounds=(0.5, 2.0), frozen=True)
    offset = Parameter.offset(["place"], bounds=(-0.1, 0.1), frozen=True)
    result = fit(swinging([gain, STIFFNESS, offset], recorded(0.02)), starts=0)
    assert [(e.channel, e.quantity) for e in result.explanations] == [("image", "delay")]


def test_functions_of_the_users_own_read_sensors_and_pixels_of_a_film():
    seen = []

    def furthest(simulated, trajectory):
        place = simulated.sensors["place"][:, 0]
        u = simulated.readings["image:cart"][:, 0]
        seen.append(np.abs(u - (320.0 + 800.0 * place[:: place.size // u.size + 1])).max())
        return (np.array([place.max(), place.min()]) - [0.1, -0.09]) / 1e-3

    result = fit(swinging([STIFFNESS], recorded(0.0), residuals=furthest), starts=0)
    assert result["stiffness"].value == pytest.approx(40.0, abs=1.0)
    assert max(seen) < 1e-9


@pytest.mark.parametrize("slower", [0.01])
def test_how_fast_a_film_runs_is_told_by_an_encoder_and_functions_get_its_times(slower):
    clock = 0.0013 + np.arange(90) / 80.0

    def filmed(time, pixels, place, **options):
        film = Trajectory.of_sensors(
            "film", time, {"place": place}, pixels={"cart": pixels}, camera=PLANE,
            sensor_times={"place": clock}, initial_qpos=[0.1], initial_qvel=[0.0],
            rate_sigma=options.pop("rate_sigma", None),
        )  # fmt: skip
        engine = dashpot.Engine(mujoco.MjModel.from_xml_string(SPRING))
        sigma = {"place": 1e-3, "pixels": 0.5}
        return Problem(engine, [STIFFNESS], [film], sensor_sigma=sigma, substeps=2, **options)

    blank = np.zeros((TIME.size, 2)), np.zeros((clock.size, 1))
    (true,) = predict(filmed((1.0 + slower) * TIME, *blank), {"stiffness": 40.0})
    off = []

    def apart(simulated, trajectory):
        times, u = simulated.times["image:cart"], simulated.readings["image:cart"][:, 0]
        place = np.interp(times, simulated.time, simulated.sensors["place"][:, 0])
        off.append(np.abs(u - (320.0 + 800.0 * place)).max())
        return 0.0

    seen = [true.sensors["image:cart"], true.sensors["place"]]
    random = np.random.default_rng(3)
    noisy = [s + random.normal(0.0, d, s.shape) for s, d in zip(seen, (0.5, 1e-3), strict=True)]
    result = fit(filmed(TIME, *noisy, rate_sigma=0.02, residuals=apart), starts=0)
    assert result.frame_pace == pytest.approx([1.0 + slower], abs=3e-3)
    assert result["stiffness"].value == pytest.approx(40.0, rel=5e-3)
    assert max(off) < 0.1
    assert not result.misfits


CELL = SPRING.replace(
    "</sensor>", '<jointvel name="speed" joint="rail"/><force name="load" site="mark"/></sensor>'
)


@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        (Parameter.delay("place", bounds=(-0.05, 0.05)), 0.02),
        (Parameter.offset("place", bounds=(-0.05, 0.05)), 0.02),
        (Parameter.gain("place", bounds=(0.5, 2.0)), 1.1),
    ],
)
def test_an_encoder_from_which_a_joint_starts_is_called_wrong_where_it_is(parameter, value):
    """With a parameter that it reads by, the joint does not start from it any more."""
    time = 0.01 * np.arange(150)
    sigma = {"place": 1e-3, "speed": 5e-3, "load": 0.02}
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(CELL))

    def read(readings, *parameters, **start):
        swing = Trajectory.of_sensors("swing", time, readings, **start)
        return Problem(
            engine, [STIFFNESS, *parameters], [swing], sensor_sigma=sigma, substeps=2,
            initial_state="pose_and_velocity",
        )  # fmt: skip

    sizes = {"place": 1, "speed": 1, "load": 3}
    blank = {name: np.zeros((time.size, size)) for name, size in sizes.items()}
    true = read(blank, parameter, initial_qpos=[0.1], initial_qvel=[0.0])
    (prediction,) = predict(true, {"stiffness": 40.0, parameter.name: value})
    random = np.random.default_rng(0)
    noisy = {
        name: values + random.normal(0.0, sigma[name], values.shape)
        for name, values in prediction.sensors.items()
    }
    said = fit(read(noisy), starts=0).explanations[0]
    assert (said.channel, said.quantity) == ("place", parameter.name.split()[0])
    assert said.value == pytest.approx(value, abs=4.0 * said.standard_error)
    assert said.share > 0.95
