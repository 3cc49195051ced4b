"""A ball thrown on a floor: engine, observed poses, and the parameters that are unknown."""

import mujoco
import numpy as np

import dashpot
from dashpot.calibrate import Parameter, Trajectory

FALL = """
<mujoco>
  <option timestep="0.01" gravity="0 0 -9.81"/>
  <worldbody>
    <body name="body" pos="0 0 1"><freejoint/><geom name="ball" size="0.1" mass="1"/></body>
  </worldbody>
</mujoco>
"""
BALL = """
<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 0.1"/>
    <body name="body" pos="0 0 0.2"><freejoint/><geom name="ball" size="0.1" mass="1"/></body>
  </worldbody>
</mujoco>
"""
IDENTITY = [1.0, 0.0, 0.0, 0.0]


def make_trajectory(**changes):
    """Return a valid trajectory of five frames with some fields replaced."""
    fields = {
        "name": "throw 7",
        "time": 0.01 * np.arange(5),
        "position": np.zeros((5, 3)),
        "quaternion": np.tile(IDENTITY, (5, 1)),
        "bodies": ("body",),
        "initial_qvel": np.zeros(6),
    }
    return Trajectory(**{**fields, **changes})


def ball_engine(stiffness=1e4, damping=20.0, friction=0.3):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL))
    ball = dashpot.Material(stiffness, damping=damping, friction=friction)
    engine.set_materials({"ball": ball, "floor": dashpot.Material(friction=0.0)})
    return engine


def observe(engine, qvel, frames=40, noise=None, name="throw", spacing=0.01):
    """Poses of the body every 0.01 s, with the normal noise of `noise` (a Generator) or exact."""
    data = engine.make_data()
    data.qvel[:] = qvel
    first = data.qpos.copy()
    substeps = round(spacing / engine.model.opt.timestep)
    poses = [first]
    for _ in range(frames - 1):
        engine.step(data, substeps)
        poses.append(data.qpos.copy())
    poses = np.array(poses)
    if noise is not None:
        poses[:, :3] += 1e-4 * noise.normal(size=(frames, 3))
        for pose in poses:
            mujoco.mju_quatIntegrate(pose[3:], 1e-3 * noise.normal(size=3), 1.0)
    return Trajectory(
        name=name,
        time=spacing * np.arange(frames),
        position=poses[:, :3],
        quaternion=poses[:, 3:],
        bodies=("body",),
        initial_qpos=first,
        initial_qvel=qvel,
    )


def ball_parameters(start=(3e3, 60.0, 0.6)):
    bounds = ((1e2, 1e6), (0.1, 1e3), (0.01, 2.0))
    quantities = ("stiffness", "damping", "sliding_friction")
    return [
        Parameter.material("ball", quantity, start=s, bounds=b)
        for quantity, s, b in zip(quantities, start, bounds, strict=True)
    ]


SIDEWAYS = np.array([1.0, 0.2, -1.0, 0.0, 2.0, 0.0])
