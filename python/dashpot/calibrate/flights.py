"""Initial states from what was recorded before the first contact.

A search that holds initial states, as CMA-ES does, and a prediction need them beforehand. Before
anything touches they do not depend on contact parameters, and all of a flight tells them better
than its first frames.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.prediction import fitted_states
from dashpot.calibrate.problem.angles import unwrapped
from dashpot.calibrate.problem.first_guess import free_bodies
from dashpot.calibrate.problem.joint_guess import joint_readings
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.setters import model_of
from dashpot.calibrate.residuals.losses import Loss
from dashpot.calibrate.residuals.objective import Objective
from dashpot.checks import number, thread_count

Array = NDArray[np.float64]

# Of a flight, to tell its rates at all.
_LEAST_FRAMES = 4
# Residuals count as outlying from so many times the median of their size on.
_OUTLYING = 3.0


def with_flights(
    problem: Problem,
    values: Mapping[str, float] | None = None,
    *,
    clearance: float = 0.003,
    nthread: int | None = None,
) -> Problem:
    """Return `problem` with the initial states that fit the flights of its trajectories best.

    A flight is what was recorded up to the first frame in which two geoms come nearer than
    `clearance`. What is returned has ``initial_state="given"``.

    Parameters
    ----------
    problem
        With ``initial_state="pose_and_velocity"``. Of every trajectory the poses of all bodies on
        free joints are observed. Joints that no ``jointpos`` sensor reads are held to be where the
        trajectory, or the model, has them.
    values
        Parameters by name, which are held. None: where they start. What acts in flight, as inertia
        or the friction of a joint, has to be about right.
    clearance
        m, > 0: what tracking is off by.
    nthread
        Number of threads, >= 1. None: one per core.

    Raises
    ------
    TypeError, ValueError
        Naming the trajectory, where too little of it is flight.

    Examples
    --------
    >>> from dashpot.calibrate import with_flights
    >>> ball = dashpot.Engine(mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
    ...   <geom name="floor" type="plane" size="5 5 .1"/>
    ...   <body name="ball" pos="0 0 .2"><freejoint/><geom name="ball" size=".1" mass="1"/></body>
    ... </worldbody></mujoco>'''))
    >>> seen = Trajectory("throw", time, position, poses[:, 3:], bodies="ball")
    >>> of_ball = Problem(ball, unknown, [seen], 1e-4, 0.01, initial_state="pose_and_velocity")
    >>> with_flights(of_ball).trajectories[0].initial_qvel[:3].round(1) + 0.0  # m/s
    array([0.5, 0. , 1. ])
    """
    if not isinstance(problem, Problem):
        raise TypeError(f"problem is {type(problem).__name__}; it must be a calibrate.Problem")
    if problem.initial_state != "pose_and_velocity":
        raise ValueError("flights need a problem with initial_state='pose_and_velocity'")
    if not number("clearance", clearance) > 0:
        raise ValueError(f"clearance must be > 0 m, got {clearance!r}")
    threads = thread_count(nthread)
    held = problem.start if values is None else dict(values)
    problem.check_values(held)
    heads = []
    first = problem.initial_states(model_of(problem.build(held)), held)
    for trajectory, qpos, qvel in zip(problem.trajectories, *first, strict=True):
        model = model_of(problem.build(held, trajectory.name))
        frames = flight_frames(trajectory, model, clearance)
        if frames < _LEAST_FRAMES:
            raise ValueError(
                f"trajectory '{trajectory.name}': {frames} frames come before the first contact, "
                f"{_LEAST_FRAMES} are needed"
            )
        last = trajectory.time[min(frames, trajectory.frames) - 1] - trajectory.time[0]
        # Joints that nothing reads would make up for whatever else is off.
        free = np.where(_observed(trajectory, model), np.inf, 0.0)
        heads.append(
            replace(
                trajectory.head(float(last)),
                initial_qpos=qpos,
                initial_qvel=qvel,
                initial_qpos_sigma=free,
                initial_qvel_sigma=free,
            )
        )
    # Functions of the user's own are of the whole.
    in_flight = replace(problem, trajectories=heads, window=None, residuals={})
    states = fitted_states(in_flight, held, Loss("linear", 1.0), threads)
    objective = Objective(in_flight, nthread=threads, held=held)
    # Frames in which a hand still holds what it lets go, or which are tracked badly, count less.
    off = np.abs(objective.residuals(states)[0])
    scale = _OUTLYING * float(np.median(off[objective.live(off)]))
    states = fitted_states(in_flight, held, Loss("cauchy", scale), threads, states)
    qpos, qvel = objective.initial_states(states)
    started = [
        replace(
            trajectory,
            initial_qpos=q,
            initial_qvel=v,
            initial_qpos_sigma=None,
            initial_qvel_sigma=None,
        )
        for trajectory, q, v in zip(problem.trajectories, qpos, qvel, strict=True)
    ]
    return replace(problem, trajectories=started, initial_state="given")


def _observed(trajectory: Trajectory, model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return (nv,) whether bodies or sensors that were observed tell a degree of freedom."""
    observed = np.zeros(model.nv, dtype=bool)
    for _, joint in free_bodies(trajectory, model):
        observed[model.jnt_dofadr[joint] : model.jnt_dofadr[joint] + 6] = True
    for joint in joint_readings(trajectory, model).values():
        observed[model.jnt_dofadr[joint]] = True
    return observed


def flight_frames(trajectory: Trajectory, model: mujoco.MjModel, clearance: float) -> int:
    """Return the number of frames before two geoms of a model come nearer than `clearance`, m.

    Frames in which a body was not measured count as the one before.
    """
    near = copy.copy(model)
    near.geom_margin[:] = np.maximum(near.geom_margin, clearance)
    near.body_margin[:] = np.maximum(near.body_margin, clearance)
    data = mujoco.MjData(near)
    for k, qpos in enumerate(recorded_positions(trajectory, near)):
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(near, data)
        if (data.contact.dist < clearance).any():
            return k
    return trajectory.frames


def recorded_positions(trajectory: Trajectory, model: mujoco.MjModel) -> Array:
    """Return the positions (n, nq) of a model in the frames of a trajectory, as observed.

    What is not observed is where the trajectory starts, or the model.
    """
    start = model.qpos0 if trajectory.initial_qpos is None else trajectory.initial_qpos
    result = np.tile(start, (trajectory.frames, 1))
    for i, joint in free_bodies(trajectory, model):
        q = int(model.jnt_qposadr[joint])
        for part, observed in (
            (slice(q, q + 3), trajectory.position[:, i]),
            (slice(q + 3, q + 7), trajectory.quaternion[:, i]),
        ):
            seen = ~np.isnan(observed).any(axis=1)
            if seen.any():
                last = np.maximum.accumulate(np.where(seen, np.arange(seen.size), 0))
                result[:, part] = observed[np.maximum(last, np.argmax(seen))]
    for name, joint in joint_readings(trajectory, model).items():
        reading = unwrapped(trajectory.sensors[name])[:, 0]
        seen = ~np.isnan(reading)
        if seen.any():
            time = trajectory.sensor_time(name)[seen]
            result[:, model.jnt_qposadr[joint]] = np.interp(trajectory.time, time, reading[seen])
    return result
