"""A spinning ball thrown on a floor, seen with noise: its engine, and what there is to find."""

import mujoco
import numpy as np

import dashpot
from dashpot.calibrate import Trajectory

BALL = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="ball" pos="0 0 .3"><freejoint/><geom name="ball" size=".05" mass=".3"/></body>
  </worldbody>
</mujoco>
"""
TRUTH = {"stiffness": 8e3, "restitution": 0.6, "sliding_friction": 0.25}
BOUNDS = {"stiffness": (1e2, 1e6), "restitution": (0.05, 0.99), "sliding_friction": (0.01, 2.0)}


def ball(values):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL))
    material = dashpot.Material(
        values["stiffness"], restitution=values["restitution"], friction=values["sliding_friction"]
    )
    engine.set_pair_material("ball", "floor", material)
    return engine


def observed(seed, *, frames, substeps, speed, spin, position_noise, rotation_noise):
    """Throw the ball at `speed` (m/s) with `spin` (rad/s), seen with noise (m, rad) by `seed`."""
    engine, rng = ball(TRUTH), np.random.default_rng(seed)
    data = engine.make_data()
    data.qvel[:] = [speed, 0.1, 0.0, 0.0, spin, 0.0]
    position, quaternion = np.empty((frames, 3)), np.empty((frames, 4))
    for k in range(frames):
        if k:
            engine.step(data, substeps)
        position[k] = data.qpos[:3] + position_noise * rng.normal(size=3)
        quaternion[k] = data.qpos[3:7]
        mujoco.mju_quatIntegrate(quaternion[k], rotation_noise * rng.normal(size=3), 1.0)
    time = round(1e3 * substeps * engine.model.opt.timestep) / 1e3 * np.arange(frames)
    return Trajectory("throw", time, position, quaternion, "ball")
