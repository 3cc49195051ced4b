"""Calibration where the start is known in part: held, or a reading like those of the motion."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import dashpot
from ball_throws import IDENTITY, ball_engine, ball_parameters, make_trajectory
from dashpot.calibrate import Parameter, Problem, Trajectory, fit, predict
from dashpot.calibrate.residuals.objective import Objective
from dashpot.cli.recordings import read_npz

STEP, FRAMES, NOISE = 0.01, 41, 1e-3  # s, m
FORCE, MASS = 6.0, 4.0
CART = f"""
<mujoco>
  <option timestep="{STEP}" gravity="0 0 0"/>
  <worldbody>
    <body name="cart"><joint name="x" type="slide" axis="1 0 0"/>
      <geom size="1" mass="{MASS}"/></body>
  </worldbody>
  <actuator><motor joint="x"/></actuator>
</mujoco>
"""
# Centres in a line, on a floor without friction; the second is at rest and nothing observes it.
BALLS = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1" friction="0"/>
    <body name="a" pos="0 0 .05"><freejoint/>
      <geom name="a" size=".05" mass=".3" friction="0"/></body>
    <body name="b" pos=".3 .01 .05"><freejoint/>
      <geom name="b" size=".05" mass=".2" friction="0"/></body>
  </worldbody>
</mujoco>
"""
RESTITUTION = 0.7


def cart_motion(position, velocity):
    """Return the matrix of x in (x0, v0, a) by Euler's semi-implicit steps, and noisy x."""
    k = np.arange(FRAMES)
    by_state = np.c_[np.ones(FRAMES), STEP * k, STEP**2 * k * (k + 1) / 2]
    noise = NOISE * np.random.default_rng(1).normal(size=FRAMES)
    return by_state, by_state @ [position, velocity, FORCE / MASS] + noise


@pytest.mark.parametrize(
    ("position_sigma", "velocity_sigma"),
    [(5e-4, 2e-3), (math.inf, 2e-3), (0.0, 2e-3), (5e-4, 0.0), (0.0, 0.0), (math.inf, math.inf)],
)
def test_what_is_known_of_a_start_is_weighed_with_what_was_seen(position_sigma, velocity_sigma):
    """Estimates are those of linear least squares, of which the given start is two more rows.

    What is known exactly leaves no unknown, what is not known at all no row.
    """
    given = np.array([0.001, 0.103])
    by_state, seen = cart_motion(0.0, 0.1)
    position = np.zeros((FRAMES, 3))
    position[:, 0] = seen
    trajectory = make_trajectory(
        time=STEP * np.arange(FRAMES), position=position, bodies="cart",
        quaternion=np.tile(IDENTITY, (FRAMES, 1)), control=np.full((FRAMES - 1, 1), FORCE),
        initial_qpos=given[:1], initial_qvel=given[1:],
        initial_qpos_sigma=position_sigma, initial_qvel_sigma=[velocity_sigma],
    )  # fmt: skip
    mass = Parameter.model("body_mass", "cart", start=3.0, bounds=(1.0, 10.0))
    problem = Problem(
        mujoco.MjModel.from_xml_string(CART), [mass], [trajectory],
        (NOISE, math.inf, math.inf), math.inf, initial_state="pose_and_velocity",
    )  # fmt: skip
    result = fit(problem, starts=0, errors="independent")

    sigma = np.array([position_sigma, velocity_sigma])
    free = np.array([*(sigma > 0.0), True])
    read = np.flatnonzero((sigma > 0.0) & np.isfinite(sigma))
    rows = np.concatenate([by_state / NOISE, np.eye(3)[read] / sigma[read, None]])
    values = np.concatenate([seen / NOISE, given[read] / sigma[read]])
    expected = np.array([*given, 0.0])
    values = values - rows[:, ~free] @ expected[~free]
    expected[free], (squares,), *_ = np.linalg.lstsq(rows[:, free], values, rcond=None)
    variance = squares / (len(values) - np.count_nonzero(free))
    error = math.sqrt(variance * np.linalg.inv(rows[:, free].T @ rows[:, free])[-1, -1])
    # To what the search leaves of its tolerance of the cost, far below a standard error.
    assert given[0] + result.initial_displacement[0, 0] == pytest.approx(expected[0], abs=1e-6)
    assert result.initial_velocity[0, 0] == pytest.approx(expected[1], abs=1e-5)
    found = result["body_mass"]
    assert found.value == pytest.approx(FORCE / expected[2], abs=0.02 * found.standard_error)
    assert result.residual_variance == pytest.approx(variance, rel=1e-4)
    # Over the region of the interval mass is not quite linear in 1 / a.
    assert found.standard_error / found.value == pytest.approx(error / expected[2], rel=0.02)
    assert (result.initial_displacement[0, 0] == 0.0) == (position_sigma == 0.0)
    assert (result.initial_velocity[0, 0] == given[1]) == (velocity_sigma == 0.0)
    assert result.metrics()["position_rms"] == pytest.approx(NOISE, rel=0.3)
    result.plot()


def collision():
    """Return the path of a ball that runs into another, which stays out of sight."""
    engine = balls(RESTITUTION)
    data = engine.make_data()
    data.qvel[0] = 1.0
    position = np.empty((80, 3))
    for k in range(80):
        position[k] = data.qpos[:3]
        engine.step(data, 5)
    noise = 2e-4 * np.random.default_rng(1).normal(size=position.shape)
    return position + noise


def balls(restitution):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALLS))
    engine.set_pair_material("a", "b", dashpot.Material(2e4, restitution=restitution, friction=0.0))
    return engine


def test_a_ball_at_rest_out_of_sight_is_held_where_it_is_known_to_be():
    """Free, it was moved and turned to make up for the restitution, which was not identified."""
    sigma = np.repeat([math.inf, 0.0], [3, 9])
    engine = balls(0.4)
    trajectory = Trajectory(
        "hit", 0.01 * np.arange(80), collision(), np.full((80, 4), np.nan), "a",
        initial_qpos=engine.model.qpos0, initial_qvel=np.eye(12)[0],
        initial_qpos_sigma=sigma, initial_qvel_sigma=sigma,
    )  # fmt: skip
    unknown = Parameter.pair("a", "b", "restitution", start=0.4, bounds=(0.05, 0.99))
    result = fit(
        Problem(engine, [unknown], [trajectory], 2e-4, math.inf, initial_state="pose_and_velocity")
    )
    found = result["restitution"]
    assert found.identified, found.statement
    assert abs(found.value - RESTITUTION) < 3.0 * found.standard_error
    assert found.standard_error < 2e-3
    assert not result.initial_velocity[0, 3:].any()
    assert not result.initial_displacement[0, 3:].any()
    # A head tells the start of others in the same way.
    (prediction,) = predict(result.problem, result.values, [trajectory], head=0.2)
    assert not prediction.initial_qvel[3:].any()
    np.testing.assert_array_equal(prediction.initial_qpos[7:], engine.model.qpos0[7:])


def test_a_start_that_is_held_whole_is_a_given_one():
    trajectory = make_trajectory(
        initial_qpos=[0.1, 0, 0.3, *IDENTITY], initial_qvel=[1.0, 0, 0, 0, 2.0, 0],
        initial_qpos_sigma=0.0, initial_qvel_sigma=np.zeros(6),
    )  # fmt: skip
    held = Problem(
        ball_engine(), ball_parameters(), [trajectory], 1e-3, 1e-2,
        initial_state="pose_and_velocity",
    )  # fmt: skip
    given = Objective(replace(held, initial_state="given"))
    objective = Objective(held)
    assert objective.unknowns == given.unknowns == 3
    point = objective.start()
    point[3:] += 0.1  # no search would
    np.testing.assert_array_equal(objective.residuals(point), given.residuals(given.start()))
    jacobian = objective.jacobian(objective.start())
    assert not jacobian.own.any()
    np.testing.assert_array_equal(jacobian.shared, given.jacobian(given.start()).shared)


START = {"initial_qpos": [0.0, 0, 1, *IDENTITY], "initial_qvel": np.zeros(6)}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"initial_qpos_sigma": -1.0}, r"initial_qpos_sigma must be one number or one for each"),
        (
            {"initial_qvel_sigma": [0.0, math.nan]},
            r"initial_qvel_sigma must be .* got \[0.0, nan\]",
        ),
        ({"initial_qvel_sigma": np.ones((2, 3))}, r"initial_qvel_sigma must be one number or one"),
        (
            {"initial_qpos": None, "initial_qpos_sigma": 0.1},
            "initial_qpos_sigma says how well .*not given",
        ),
    ],
)
def test_what_cannot_be_known_of_a_start_is_named(changes, message):
    with pytest.raises(ValueError, match=rf"^trajectory 'throw 7': {message}"):
        make_trajectory(**{**START, **changes})


def test_a_start_is_known_in_as_many_numbers_as_the_model_has():
    trajectory = make_trajectory(**START, initial_qvel_sigma=np.zeros(7))
    message = r"^trajectory 'throw 7': initial_qvel_sigma must be \(6,\) or one number, got \(7,\)"
    with pytest.raises(ValueError, match=message):
        Problem(ball_engine(), ball_parameters(), [trajectory], 1e-3, 1e-2)
    make_trajectory(initial_qpos_sigma=math.inf)


def test_files_say_how_well_a_start_is_known(tmp_path):
    file = tmp_path / "throw.npz"
    kept = {name: getattr(make_trajectory(), name) for name in ("time", "position", "quaternion")}
    np.savez(file, **kept, **START, initial_qpos_sigma=0.0, initial_qvel_sigma=np.full(6, 0.1))
    trajectory = Trajectory("throw", bodies="body", **read_npz(file, ["body"], ball_engine().model))
    assert trajectory.initial_qpos_sigma == 0.0
    assert trajectory.initial_qvel_sigma.tolist() == [0.1] * 6
