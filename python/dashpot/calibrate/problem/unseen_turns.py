"""Rotations that nothing observes, of bodies that they would move: held as they start.

Where positions alone were measured, of a body whose centre of mass is off its origin, a rotation
moves what was measured in a way that displacements and velocities nearly make up for. Free, it goes
round and round to follow noise. A body whose origin is its centre of mass is left free: its spin
moves it by friction alone.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.first_guess import free_bodies

Array = NDArray[np.float64]

# A centre of mass is off where it is by more than this share of the body's reach.
_OFF = 1e-3


def unseen_turns(
    trajectory: Trajectory, model: mujoco.MjModel, sigma: Array
) -> dict[str, tuple[int, float]]:
    """Return by body the address of its rotation in velocities, and how far off its mass is, m.

    Parameters
    ----------
    trajectory
        What was observed. Where sensors or pixels were too, they may tell rotations.
    model
        The model.
    sigma
        (6,) standard deviations of coordinates and rotations; infinite: not measured.
    """
    if trajectory.sensors:
        return {}
    measured = trajectory.measured & np.isfinite(sigma)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    found = {}
    for i, joint in free_bodies(trajectory, model):
        body = int(model.jnt_bodyid[joint])
        off = float(np.linalg.norm(data.subtree_com[body] - data.xpos[body]))
        seen = measured[:, i]
        if seen[:, 3:].any() or not seen.any() or off <= _OFF * _reach(model, data, body):
            continue
        found[trajectory.bodies[i]] = (int(model.jnt_dofadr[joint]) + 3, off)
    return found


def turns_held(trajectory: Trajectory, model: mujoco.MjModel, sigma: Array) -> NDArray[np.bool_]:
    """Return (nv,) which velocities are of such rotations."""
    held = np.zeros(model.nv, dtype=bool)
    for first, _ in unseen_turns(trajectory, model, sigma).values():
        held[first : first + 3] = True
    return held


def _reach(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> float:
    """Return how far the geoms of a body reach from its origin, m."""
    geoms = model.geom_bodyid == body
    ways = np.linalg.norm(data.geom_xpos[geoms] - data.xpos[body], axis=1)
    return float((ways + model.geom_rbound[geoms]).max(initial=0.0))
