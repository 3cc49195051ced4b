"""Calibration: falls that tell units and axes other than the model's."""

import re

import mujoco
import numpy as np
import pytest

from ball_throws import BALL, FALL, IDENTITY, SIDEWAYS, ball_engine, make_trajectory, observe
from dashpot import Engine, Material
from dashpot.calibrate import Parameter, Problem, Trajectory, fit
from dashpot.calibrate.problem.data_warnings import strange_falls

UP = np.array([1.0, 1.0, -1.0])


def thrown(scale, noise, sigma, frames=40, gravity=9.81, xml=FALL, seed=0):
    """Return a problem of a throw whose coordinates are those in m times `scale`."""
    t = 0.01 * np.arange(frames)
    path = np.array([1.0, 0.3, 2.0]) * t[:, None] - np.array([0, 0, gravity / 2]) * t[:, None] ** 2
    path += noise * np.random.default_rng(seed).normal(size=path.shape)
    throw = make_trajectory(
        time=t,
        position=scale * path,
        quaternion=np.tile(IDENTITY, (frames, 1)),
        initial_qpos=[0, 0, 0, *IDENTITY],
    )
    mass = Parameter.model("body_mass", "body", start=2.0, bounds=(1.0, 9.0))
    return Problem(mujoco.MjModel.from_xml_string(xml), [mass], [throw], sigma, 1e-2)


def found(problem):
    said = list(strange_falls(problem).values())
    return [sum(unit in text for text in said) for unit in ("in mm", "points down")]


@pytest.mark.parametrize("seed", range(10))
def test_millimetres_and_axes_that_point_down_are_told_by_gravity(seed):
    assert found(thrown(1.0, 3e-4, 3e-4, seed=seed)) == [0, 0]
    assert found(thrown(1e3, 3e-4, 3e-4, seed=seed)) == [1, 0]  # sigma in m
    assert found(thrown(1e3, 3e-4, 0.3, seed=seed)) == [1, 0]  # and in mm
    assert found(thrown(UP, 3e-4, 3e-4, seed=seed)) == [0, 1]


@pytest.mark.parametrize("seed", range(10))
def test_other_accelerations_are_no_such_falls(seed):
    for gravity in (0.0, 5.0, -5.0, -15.0, 500.0):
        assert found(thrown(1.0, 3e-4, 3e-4, gravity=gravity, seed=seed)) == [0, 0]
    assert found(thrown(UP, 0.04, 0.04, seed=seed)) == [0, 0]  # noise hides it
    weightless = BALL.replace("<option", '<option gravity="0 0 0"')
    assert found(thrown(UP, 3e-4, 3e-4, xml=weightless, seed=seed)) == [0, 0]
    # Of a throw, a bounce and all that comes after.
    rng = np.random.default_rng(seed)
    mass = Parameter.model("body_mass", "body", start=2.0, bounds=(1.0, 9.0))
    for frames in (5, 20, 100):
        throw = observe(ball_engine(), SIDEWAYS, frames=frames, noise=rng)
        assert found(Problem(ball_engine(), [mass], [throw], 1e-4, 1e-3)) == [0, 0]


@pytest.mark.parametrize(
    ("scale", "message"),
    [
        (1e3, "1e\\+03 times gravity, as with positions in mm"),
        (UP, "-1 times gravity, as with an axis"),
    ],
)
def test_a_fit_warns_of_them(scale, message):
    with pytest.warns(UserWarning, match=f"'throw 7': it falls at {message}"):
        fit(thrown(scale, 3e-4, 3e-4), starts=0, max_evaluations=1)


BOUNCING = """<mujoco><worldbody><geom name="floor" type="plane" size="9 9 1"/>
  <body name="ball" pos="0 0 .6"><freejoint/><geom name="ball" size=".1" mass="1"/>
    <site name="mark"/></body>
  <body name="drop" pos="5 0 0"><joint name="z" type="slide" axis="0 0 1"/>
    <geom size=".1" mass="1"/></body>
  <body name="sprung" pos="9 0 0"><joint name="s" type="slide" axis="0 0 1" stiffness="100"/>
    <geom size=".1" mass="1"/></body></worldbody>
  <sensor><framepos name="mark" objtype="site" objname="mark"/><jointpos name="z" joint="z"/>
    <jointpos name="s" joint="s"/></sensor></mujoco>"""
UNITS = [
    (1.0, 1.0, ""),
    (100.0, 1.0, "falls at 100 times gravity, as with positions in cm"),
    (1000.0, 1.0, r"falls at 1e\+03 times gravity, as with positions in mm"),
    (-1.0, 1.0, "falls at -1 times gravity, as with an axis that points down"),
    (-100.0, 1.0, "falls at -100 times gravity, as with positions in cm and an axis"),
    (1 / 0.0254, 1.0, "as with positions in inches"),
    (1.0, 1e3, "falls at 1e-06 times gravity, as with times in milliseconds"),
    (100.0, 1e3, "falls at 0.0001 times gravity, as with positions in cm and times in mill"),
    (1.0, 1e6, "as with times in microseconds"),
]


def bouncing(seen, length, seconds, restitution, noise, seed):
    """Return a problem of a ball's height alone: it is at rest, let go, and bounces, at 120 Hz."""
    t = np.arange(240) / 120
    let_go = 0.2 + 0.01 * seed
    fall = np.maximum(t - let_go, 0.0)
    height = 0.5 - 0.5 * 9.81 * fall**2
    impact = np.sqrt(2 * 0.5 / 9.81)
    flight = 2 * impact
    while flight > 0.02:
        flight *= restitution
        since = fall - impact
        height = np.where(since >= 0, 0.5 * 9.81 * since * np.maximum(flight - since, 0), height)
        impact += flight
    rng = np.random.default_rng(seed)
    height = length * (height + 0.1 + noise * rng.normal(size=240))
    mass = Parameter.model("body_mass", "ball", start=2.0, bounds=(1.0, 9.0))
    sigma = {"mark": 1e-3, "z": 1e-3, "s": 1e-3}
    if seen == "pose":
        position = np.c_[np.full((240, 2), np.nan), height]
        path = Trajectory("bounce", seconds * t, position, None, "ball")
    else:
        lost = np.full(240, np.nan)
        readings = np.c_[lost, lost, height] if seen == "mark" else height
        path = Trajectory.of_sensors("bounce", seconds * t, {seen: readings})
    model = mujoco.MjModel.from_xml_string(BOUNCING)
    return Problem(
        model, [mass], [path], 1e-3, sensor_sigma=sigma, initial_state="pose_and_velocity"
    )


@pytest.mark.parametrize("seen", ["pose", "mark", "z"])
@pytest.mark.parametrize(("length", "seconds", "said"), UNITS)
@pytest.mark.parametrize(("restitution", "seed"), [(0.6, 0), (0.95, 2)])
def test_a_height_alone_tells_units(seen, length, seconds, said, restitution, seed):
    """Of arcs between impacts, while the ball is at rest before and perhaps after them."""
    found = strange_falls(bouncing(seen, length, seconds, restitution, 1e-3, seed))
    if not said:
        assert found == {}
    else:
        assert list(found) == ["bounce"]
        assert re.search(said, found["bounce"])


@pytest.mark.parametrize("seed", range(3))
def test_what_a_spring_holds_does_not_fall(seed):
    assert strange_falls(bouncing("s", 100.0, 1.0, 0.85, 1e-3, seed)) == {}


@pytest.mark.parametrize("seed", range(6))
def test_contacts_that_last_are_no_falls_of_other_units(seed):
    """A ball on soft foam is pushed up for half of the time, with up to several g."""
    rng = np.random.default_rng(seed)
    engine = Engine(mujoco.MjModel.from_xml_string(BOUNCING))
    engine.set_pair_material("ball", "floor", Material(stiffness=10.0 ** rng.uniform(2.5, 4)))
    data = engine.make_data()
    height = []
    for _ in range(300):
        engine.step(data, nstep=5)
        height.append(data.qpos[2] + 3e-4 * rng.normal())
    position = np.c_[np.full((300, 2), np.nan), height]
    path = Trajectory("bounce", 0.01 * np.arange(300), position, None, "ball")
    mass = Parameter.model("body_mass", "ball", start=2.0, bounds=(1.0, 9.0))
    problem = Problem(engine, [mass], [path], 1e-3, initial_state="pose_and_velocity")
    assert strange_falls(problem) == {}
