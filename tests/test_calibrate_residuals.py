"""Calibration: residuals and their Jacobian."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import dashpot
from ball_throws import (
    FALL,
    IDENTITY,
    SIDEWAYS,
    ball_engine,
    ball_parameters,
    make_trajectory,
    observe,
)
from dashpot.calibrate import Parameter, Problem, Trajectory, fit
from dashpot.calibrate.residuals.objective import Objective


def test_residuals_against_stepping_and_scipy_rotations():
    engine = ball_engine()
    rng = np.random.default_rng(0)
    trajectory = observe(engine, SIDEWAYS, frames=30, noise=rng)
    problem = Problem(engine, ball_parameters(), [trajectory], 2e-3, 3e-2)
    values = {"stiffness": 2e4, "damping": 10.0, "sliding_friction": 0.2}
    objective = Objective(problem)
    point = np.array(
        [c.to_search(values[n]) for c, n in zip(objective.coordinates, values, strict=True)]
    )
    residuals = objective.residuals(point)[0].reshape(30, 6)

    other = ball_engine(2e4, 10.0, (0.2, 0.005, 0.0001))
    data = other.make_data()
    data.qpos[:] = trajectory.initial_qpos
    data.qvel[:] = SIDEWAYS
    for frame in range(30):
        if frame:
            other.step(data, 2)
        position = (data.qpos[:3] - trajectory.position[frame, 0]) / 2e-3
        observed = Rotation.from_quat(trajectory.quaternion[frame, 0], scalar_first=True)
        simulated = Rotation.from_quat(data.qpos[3:], scalar_first=True)
        rotation = (observed.inv() * simulated).as_rotvec() / 3e-2
        # log and exp of the transform move parameters by a rounding, grown by three bounces.
        np.testing.assert_allclose(residuals[frame, :3], position, atol=1e-7)
        np.testing.assert_allclose(residuals[frame, 3:], rotation, atol=1e-7)


def test_controls_reach_the_simulation():
    model = mujoco.MjModel.from_xml_string(
        """
        <mujoco>
          <option timestep="0.01" gravity="0 0 0"/>
          <worldbody>
            <body name="cart"><joint name="x" type="slide" axis="1 0 0"/><geom size="1"/></body>
          </worldbody>
          <actuator><motor joint="x"/></actuator>
        </mujoco>
        """
    )
    control = np.array([[1.0], [-2.0], [0.5]])
    trajectory = Trajectory(
        "push", [0.0, 0.1, 0.2, 0.3], np.zeros((4, 3)), np.tile(IDENTITY, (4, 1)), ("cart",),
        initial_qvel=[0.0], control=control,
    )  # fmt: skip
    mass = Parameter.model("body_mass", "cart", start=2.0, bounds=(0.1, 10.0))
    objective = Objective(Problem(model, [mass], [trajectory], 1.0, 1.0))
    simulated = objective.residuals(np.log([4.0]))[0].reshape(4, 6)[:, 0]
    # Semi-implicit Euler, ten steps per frame, acceleration u / 4.
    x, v, expected = 0.0, 0.0, [0.0]
    for (u,) in control:
        for _ in range(10):
            v += 0.01 * u / 4.0
            x += 0.01 * v
        expected.append(x)
    np.testing.assert_allclose(simulated, expected, rtol=1e-12)


def test_residuals_do_not_depend_on_threads():
    engine = ball_engine()
    trajectories = [observe(engine, SIDEWAYS * s, name=f"throw {s}") for s in (0.5, 1.0, 1.5)]
    problem = Problem(engine, ball_parameters(), trajectories, 1e-3, 1e-2)
    points = np.log([[1e4 * 1.1**i, 20.0, 0.3] for i in range(5)])
    first, *others = (Objective(problem, nthread=n).residuals(points) for n in (1, 2, 8))
    for other in others:
        assert np.array_equal(first, other)


def test_a_run_of_mujoco_that_diverges_is_named():
    """Where MuJoCo would start over: a spring that no step of 10 ms resolves."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep="0.01"/><worldbody><body name="body" pos="0 0 1">
          <joint type="slide" stiffness="1e6"/><geom size=".1" mass="1"/></body>
        </worldbody></mujoco>"""
    )
    parameter = Parameter.model("body_mass", "body", start=1.0, bounds=(0.5, 2.0))
    trajectory = Trajectory(
        name="spring",
        time=0.1 * np.arange(20),
        position=np.tile([0.0, 0.0, 1.0], (20, 1)),
        quaternion=np.tile(IDENTITY, (20, 1)),
        bodies="body",
        initial_qpos=np.array([0.01]),
        initial_qvel=np.zeros(1),
    )
    problem = Problem(model, [parameter], [trajectory], 1e-3, 1e-2)
    with pytest.raises(ValueError, match=r"'spring'.*no longer finite"):
        Objective(problem).residuals(np.array([0.0]))


def test_a_trajectory_that_fails_is_named():
    trajectories = [
        make_trajectory(name="good", initial_qpos=[0, 0, 1, *IDENTITY]),
        make_trajectory(name="bad", initial_qpos=[1e200, 0, 0, 1, 0, 0, 0]),
    ]
    problem = Problem(ball_engine(), ball_parameters(), trajectories, 1e-3, 1e-2)
    with pytest.raises(
        ValueError, match=r"trajectory 'bad': step 0.*; with stiffness = 3000, damp"
    ):
        fit(problem)


def test_jacobian_of_initial_states_is_that_of_free_flight():
    """Before contact a position changes by t with velocity and by 1 with displacement."""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(FALL))
    trajectory = make_trajectory(initial_qpos=[0, 0, 1, *IDENTITY], initial_qvel=None)
    mass = Parameter.model("body_mass", "body", start=2.0, bounds=(0.1, 10.0))
    problem = Problem(engine, [mass], [trajectory], 1.0, 1.0, initial_state="pose_and_velocity")
    objective = Objective(problem)
    for base in (None, objective.residuals(objective.start())[0]):
        jacobian = objective.jacobian(objective.start(), base=base).dense().reshape(5, 6, 13)
        t = trajectory.time
        # Differences of 1e-5 of functions of size 1: rounding leaves 1e-10.
        for axis in range(3):
            np.testing.assert_allclose(jacobian[:, axis, 1 + axis], t, atol=1e-9)
            np.testing.assert_allclose(jacobian[:, axis, 7 + axis], 1.0, atol=1e-9)
        np.testing.assert_allclose(jacobian[:, :, 0], 0.0, atol=1e-12)  # all masses fall alike
