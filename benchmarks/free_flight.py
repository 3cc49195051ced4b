"""Bodies in free flight: thrown, and followed while they keep their velocities."""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation


def launch(model, data, name, position, rotation=None, linear=(0, 0, 0), angular=(0, 0, 0)):
    """Set the free body of a geom: pose, and velocities (m/s, rad/s) in the world."""
    rotation = Rotation.identity() if rotation is None else rotation
    joint = model.body_jntadr[model.geom(name).bodyid[0]]
    at, dof = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
    data.qpos[at : at + 3] = position
    data.qpos[at + 3 : at + 7] = np.roll(rotation.as_quat(), 1)
    data.qvel[dof : dof + 3] = linear
    data.qvel[dof + 3 : dof + 6] = rotation.inv().apply(angular)
    mujoco.mj_forward(model, data)


def throw_together(model, data, rng, names, *, side, spread):
    """Launch two tumbling bodies at each other, from about `side` m to either side of the middle.

    `spread` is the standard deviation of their positions, m.
    """
    for name, x in zip(names, (-side, side), strict=True):
        position = np.array((x, 0, 0)) + rng.normal(size=3) * spread
        linear = np.array((-20 * x, 0, 0)) + rng.normal(size=3)
        turn = Rotation.random(random_state=rng)
        launch(model, data, name, position, turn, linear, rng.normal(size=3) * 30)


class Motion:
    """Poses of a geom whose body keeps its velocities."""

    def __init__(self, model, data, name):
        geom = model.geom(name).id
        body = model.geom_bodyid[geom]
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, velocity, 0)
        self.angular, self.linear = velocity[:3], velocity[3:]
        self.centre = data.xipos[body].copy()
        self.position = data.geom_xpos[geom].copy()
        self.rotation = data.geom_xmat[geom].reshape(3, 3).copy()
        self.size = model.geom_size[geom].copy()

    def at(self, times):
        """Positions (..., 3) and rotations (..., 3, 3) at times (...), s."""
        turns = Rotation.from_rotvec(np.multiply.outer(times, self.angular)).as_matrix()
        moved = self.centre + np.multiply.outer(times, self.linear)
        return moved + turns @ (self.position - self.centre), turns @ self.rotation
