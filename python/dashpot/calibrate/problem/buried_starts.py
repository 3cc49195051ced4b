"""Recordings whose first frames have a body deeper in a geom than its contact gives way."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.first_guess import free_bodies
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.sensing import SensingSetter
from dashpot.calibrate.problem.unseen_turns import unseen_turns
from dashpot.engine import Engine
from dashpot.object_ids import geom_label

Array = NDArray[np.float64]

# The overlap is the median of so many frames.
_FRAMES = 3
# Of noise, standard deviations that are no overlap.
_DEVIATIONS = 4.0
# A contact may be softer than where its search starts, by this factor.
_SOFTER = 4.0
# Along axes of which a normal has no more than this, it does not matter whether they were measured.
_ALONG = 1e-3


def buried_starts(problem: Problem) -> dict[str, str]:
    """Return by trajectory what lies how deep in what, where that is more than can be.

    That is more than noise, and than contact that is four times as soft as where the search starts
    gives way under the weight and the speed of the first frames. Scales of positions that are
    unknown may explain it.
    """
    scaled = any(
        isinstance(p.apply, SensingSetter) and p.apply.quantity == "scale"
        for p in problem.parameters
    )
    system = problem.build(problem.start)
    if scaled or not isinstance(system, Engine):
        return {}
    qpos, qvel = problem.initial_states(system.model)
    found = {}
    for trajectory, pose, rates in zip(problem.trajectories, qpos, qvel, strict=True):
        said = _buried(trajectory, system, problem.sigma, pose, rates)
        if said is not None:
            found[trajectory.name] = said
    return found


def _buried(
    trajectory: Trajectory, engine: Engine, sigma: Array, qpos: Array, qvel: Array
) -> str | None:
    model, data = engine.model, mujoco.MjData(engine.model)
    measured = trajectory.measured & np.isfinite(sigma)
    held = unseen_turns(trajectory, model, sigma)
    for i, joint in free_bodies(trajectory, model):
        frames = np.flatnonzero(measured[:_FRAMES, i, :3].any(axis=1))
        body = int(model.jnt_bodyid[joint])
        turns = not (measured[:_FRAMES, i, 3].all() or trajectory.bodies[i] in held)
        depths: dict[int, list[float]] = {}
        others: dict[int, int] = {}
        for frame in frames:
            data.qpos[:] = qpos
            _place(model, data, joint, trajectory, i, int(frame), measured)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_collision(model, data)
            for geom, other, depth in _overlaps(model, data, body, measured[frame, i, :3]):
                if turns and not _is_round(model, geom):
                    continue  # how deep it is depends on how it is turned
                depths.setdefault(geom, []).append(depth)
                others[geom] = other
        for geom, of_frames in depths.items():
            if len(of_frames) < len(frames):
                continue
            depth = float(np.median(of_frames))
            noise = float(np.max(sigma[:3], where=np.isfinite(sigma[:3]), initial=0.0))
            sag = _most_sag(engine, geom, others[geom], body, qvel[model.jnt_dofadr[joint] :][:3])
            if depth > _DEVIATIONS * noise + sag:
                return (
                    f"geom {geom_label(model, geom)} is {1e3 * depth:.3g} mm deep in geom "
                    f"{geom_label(model, others[geom])} in the first frames, of which noise and "
                    f"its contact explain {1e3 * (_DEVIATIONS * noise + sag):.2g} mm"
                )
    return None


def _place(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    joint: int,
    trajectory: Trajectory,
    i: int,
    frame: int,
    measured: NDArray[np.bool_],
) -> None:
    """Put a body where a frame has it."""
    q = int(model.jnt_qposadr[joint])
    known = measured[frame, i]
    position = data.qpos[q : q + 3]
    position[known[:3]] = trajectory.position[frame, i, known[:3]]
    if known[3]:
        data.qpos[q + 3 : q + 7] = trajectory.quaternion[frame, i]


def _overlaps(
    model: mujoco.MjModel, data: mujoco.MjData, body: int, known: NDArray[np.bool_]
) -> list[tuple[int, int, float]]:
    """Return a geom of the body, one of the world and their depth, m, once for each deepest."""
    found: dict[int, tuple[int, int, float]] = {}
    for contact in data.contact:
        pair = [int(geom) for geom in contact.geom]
        if min(pair) < 0:
            continue
        of_body = [int(model.body_rootid[model.geom_bodyid[geom]]) == body for geom in pair]
        fixed = [model.body_weldid[model.geom_bodyid[geom]] == 0 for geom in pair]
        if not (of_body[0] and fixed[1]) and not (of_body[1] and fixed[0]):
            continue
        geom, other = pair if of_body[0] else pair[::-1]
        unknown = np.abs(contact.frame[:3])[~known]
        if -contact.dist > found.get(geom, (0, 0, 0.0))[2] and not (unknown > _ALONG).any():
            found[geom] = geom, other, -float(contact.dist)
    return list(found.values())


def _is_round(model: mujoco.MjModel, geom: int) -> bool:
    return bool(
        model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE and not model.geom_pos[geom].any()
    )


def _most_sag(engine: Engine, geom: int, other: int, body: int, velocity: Array) -> float:
    """Return how deep a contact may be under the weight of a body that arrives at a speed, m."""
    contact = engine.contact_material(geom, other)
    if contact.source == "solref":
        return math.inf  # goes by the load
    if contact.stiffness is None:
        return 0.0
    model = engine.model
    mass, stiffness = float(model.body_subtreemass[body]), contact.stiffness / _SOFTER
    weight = mass * float(np.linalg.norm(model.opt.gravity))
    return 2.0 * weight / stiffness + float(np.linalg.norm(velocity)) * math.sqrt(mass / stiffness)
