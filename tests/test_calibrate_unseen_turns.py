"""Positions alone of a body whose centre of mass is off its origin: how it turned is not seen."""

import math
import warnings
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.calibrate import Parameter, Problem, Trajectory, fit

SLED = """<mujoco><worldbody><geom name="floor" type="plane" size="5 5 .1" friction=".3"/>
  <body name="sled"><freejoint/><geom name="sled" type="box" pos="{x} 0 .03" size=".05 .05 .03"
    mass=".5" friction=".3"/></body></worldbody></mujoco>"""
FRICTION, NOISE, FRAMES, RATE = 0.3, 5e-4, 60, 100.0  # m, Hz


def recording():
    """Return positions of a corner of a sled that starts at 1 m/s: x = v t - mu g t^2 / 2."""
    time = np.arange(FRAMES) / RATE
    until = np.minimum(time, 1.0 / (FRICTION * 9.81))
    position = np.zeros((FRAMES, 3))
    position[:, 0] = until - FRICTION * 9.81 * until**2 / 2
    position += NOISE * np.random.default_rng(0).normal(size=position.shape)
    return Trajectory("run", time, position, None, "sled")


def problem(trajectory, x=0.05, **options):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(SLED.format(x=x)))
    unknown = Parameter.pair("sled", "floor", "sliding_friction", bounds=(0.05, 1.0))
    options = {"initial_state": "pose_and_velocity", **options}
    return Problem(engine, [unknown], [trajectory], NOISE, math.inf, **options)


def held(problem):
    return [bool(row.any()) for row in (problem.start_sigma == 0.0).reshape(2, 2, 3).swapaxes(0, 1)]


def test_friction_of_a_sled_is_found_from_positions_alone():
    """It slides straight. Free, its rotations went round by tens of radians to follow noise."""
    with pytest.warns(UserWarning, match=r"rotations of body 'sled' .* 58.3 mm off its origin"):
        result = fit(problem(recording()))
    friction = result["sliding_friction"]
    assert result.converged
    assert result.noise_explains
    assert friction.identified, friction.statement
    # Three standard errors, of a percent.
    assert abs(friction.value - FRICTION) < 3.0 * friction.standard_error < 0.03 * FRICTION
    for states in (result.initial_velocity, result.initial_displacement):
        assert not states[0, 3:].any()
        assert states[0, :3].any()


def test_only_what_nothing_tells_is_held():
    run = recording()
    assert held(problem(run)) == [False, True]
    free = replace(run, initial_qpos_sigma=math.inf, initial_qvel_sigma=math.inf)
    assert held(problem(free)) == [False, False]
    turned = replace(run, quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (FRAMES, 1, 1)))
    assert held(problem(turned)) == [False, True]  # with an infinite standard deviation
    told = Problem(
        problem(run).system, problem(run).parameters, [turned], NOISE, 0.01,
        initial_state="pose_and_velocity",
    )  # fmt: skip
    assert held(told) == [False, False]
    centred = SLED.replace('pos="{x} 0 .03"', "").replace(
        'name="sled">', 'name="sled" pos="0 0 .03">'
    )
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(centred))
    own = Problem(engine, told.parameters, [run], NOISE, math.inf, initial_state="velocity")
    assert not (own.start_sigma == 0.0).any()


def test_who_says_how_well_the_start_is_known_is_not_warned():
    free = replace(recording(), initial_qpos_sigma=math.inf, initial_qvel_sigma=math.inf)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fit(problem(free), max_evaluations=30, starts=0)
