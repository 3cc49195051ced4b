"""Bodies that sink through a geom, or fall past all, in the simulation with an estimate.

Least squares goes on from there as from anywhere else, and its end says nothing of the contact.
"""

from __future__ import annotations

import warnings

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.setters import System, model_of
from dashpot.calibrate.residuals.objective import Objective
from dashpot.engine import DivergenceError
from dashpot.object_ids import geom_label

Array = NDArray[np.float64]

# Of what called fit, which calls `warn_of_sunk_bodies`.
_STACK_LEVEL = 3
# Cosine of the slope below which a plane is level.
_LEVEL = 1.0 - 1e-12
# Trajectories that are looked at: those of the largest cost.
_MOST_TRAJECTORIES = 20


def warn_of_sunk_bodies(objective: Objective, point: Array, residuals: Array) -> None:
    """Warn where the centre of a body gets beyond the surface of a geom, or below all geoms.

    Parameters
    ----------
    objective
        The residuals.
    point, residuals
        (n,) and (m,) of the estimate.
    """
    problem, values = objective.problem, objective.values(point)
    system = problem.build(values)
    qpos, qvel = objective.initial_states(point)
    costs = np.add.reduceat(residuals**2, objective.offsets[:-1])
    found = []
    for t in sorted(np.argsort(-costs, kind="stable")[:_MOST_TRAJECTORIES]):
        said = _sinks(problem, system, int(t), qpos[t], qvel[t])
        if said is not None:
            found.append(f"trajectory '{problem.trajectories[t].name}': {said}")
    if found:
        listed = ", ".join(f"{name} = {value:.4g}" for name, value in values.items())
        others = f" (and so in {len(found) - 1} more trajectories)" if len(found) > 1 else ""
        warnings.warn(
            f"{found[0]} in the simulation with the estimate{others}: contact is too soft or the "
            f"step too long there ({listed}); bounds that leave such values out help, or "
            "Engine(impact='cut')",
            stacklevel=_STACK_LEVEL,
        )


def _sinks(problem: Problem, system: System, t: int, qpos: Array, qvel: Array) -> str | None:
    """Say which geom sinks through which in a trajectory, None where none does."""
    model, trajectory = model_of(system), problem.trajectories[t]
    substeps = problem.steps_per_frame(trajectory, model)
    frames = trajectory.frame_number
    if problem.window is not None:
        frames = trajectory.head(problem.window).frame_number
    compiled, model.opt.timestep = model.opt.timestep, trajectory.spacing / substeps
    try:
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = qpos, qvel
        for k, steps in enumerate(substeps * np.diff(frames)):
            if trajectory.control is not None:
                data.ctrl[:] = trajectory.control[k]
            if isinstance(system, mujoco.MjModel):
                mujoco.mj_step(model, data, nstep=int(steps))
            else:
                system.step(data, int(steps))
            said = _deep_contact(model, data) or _fallen(model, data, trajectory, k + 1)
            if said is not None:
                return f"{said} after {trajectory.time[k + 1] - trajectory.time[0]:.3g} s"
    except (DivergenceError, ValueError, mujoco.FatalError):
        return None  # what cannot be simulated is said elsewhere
    finally:
        model.opt.timestep = compiled
    return None


def _deep_contact(model: mujoco.MjModel, data: mujoco.MjData) -> str | None:
    """Say which geom, and the centre of its body, lies beyond the surface of which."""
    depth = -np.asarray(data.contact.dist)
    for i in np.flatnonzero(depth > 0.0):
        pair = [int(geom) for geom in data.contact.geom[i]]
        moving = [
            (_reach(model, data, int(model.geom_bodyid[geom])), geom)
            for geom in pair
            if geom >= 0 and model.body_weldid[model.geom_bodyid[geom]]
        ]
        if min(pair) < 0 or not moving:
            continue
        reach, geom = min(moving)
        if depth[i] > reach:
            other = geom_label(model, pair[0] + pair[1] - geom)
            return f"geom {geom_label(model, geom)} sinks {depth[i]:.3g} m into geom {other}"
    return None


def _reach(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> float:
    """Return how far the geoms of a body reach from its centre of mass, m."""
    geoms = model.geom_bodyid == body
    ways = np.linalg.norm(data.geom_xpos[geoms] - data.xipos[body], axis=1)
    return float((ways + model.geom_rbound[geoms]).max())


def _fallen(
    model: mujoco.MjModel, data: mujoco.MjData, trajectory: Trajectory, frame: int
) -> str | None:
    """Say which geom is below all of the world, but was not seen there."""
    lowest = _lowest(model, data)
    below = lowest - data.geom_xpos[:, 2] > model.geom_rbound
    for geom in np.flatnonzero(below & (model.body_weldid[model.geom_bodyid] != 0)):
        body = model.body(model.geom_bodyid[geom]).name
        seen = np.inf
        if body in trajectory.bodies:
            seen = trajectory.position[frame, trajectory.bodies.index(body), 2]
        if not seen < lowest:
            return f"geom {geom_label(model, int(geom))} falls past all geoms of the world"
    return None


def _lowest(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return the height (m) below which no geom of the world that can touch reaches, or -inf."""
    if not model.opt.gravity[2] < 0.0:
        return -np.inf
    lowest = np.inf
    for geom in np.flatnonzero(model.body_weldid[model.geom_bodyid] == 0):
        if model.geom_contype[geom] or model.geom_conaffinity[geom]:
            reach = 0.0  # of planes
            is_plane = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
            if is_plane and data.geom_xmat[geom, 8] < _LEVEL:
                return -np.inf  # a slope goes down without end
            if model.geom_rbound[geom] > 0.0:
                row, box = data.geom_xmat[geom, 6:], model.geom_aabb[geom]
                reach = float(row @ box[:3] - np.abs(row) @ box[3:])
            lowest = min(lowest, float(data.geom_xpos[geom, 2]) + reach)
    return lowest if np.isfinite(lowest) else -np.inf
