"""Calibration: falls that tell units and axes other than the model's."""

import mujoco
import numpy as np
import pytest

from ball_throws import BALL, FALL, IDENTITY, SIDEWAYS, ball_engine, make_trajectory, observe
from dashpot.calibrate import Parameter, Problem, fit
from dashpot.calibrate.data.clock import falls_up, in_millimetres
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
    return [len(strange_falls(problem, begins)) for begins in (in_millimetres, falls_up)]


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
    assert found(thrown(UP, 0.02, 0.02, seed=seed)) == [0, 0]  # noise hides it
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
    [(1e3, "a thousand times gravity, as with positions in mm"), (UP, "a fall against gravity")],
)
def test_a_fit_warns_of_them(scale, message):
    with pytest.warns(UserWarning, match=f"'throw 7': it begins in .*{message}"):
        fit(thrown(scale, 3e-4, 3e-4), starts=0, max_evaluations=1)
