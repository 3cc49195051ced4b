"""Robots of dashpot.warp: near the converged motion at first, bounded after a thousand steps."""

import importlib.util
from pathlib import Path

import mujoco
import numpy as np
import pytest

import dashpot
from warp_worlds import Worlds


def packaged(package, path):
    spec = importlib.util.find_spec(package)
    if spec is None:
        pytest.skip(f"{package} is not installed")
    return mujoco.MjModel.from_xml_path(str(Path(spec.origin).parent / path))


# Where arms start that have no reference positions within their limits.
READY = {"panda": [0, np.pi / 16, 0, -5 * np.pi / 6, 0, np.pi - 0.2, np.pi / 4]}
ROBOTS = {
    "humanoid": ("mujoco_warp", "test_data/humanoid/humanoid.xml"),
    "panda": ("robosuite", "models/assets/robots/panda/robot.xml"),
    "hand with block": ("gymnasium_robotics", "envs/assets/hand/manipulate_block.xml"),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_is_as_near_to_the_converged_motion_as_in_the_engine(name):
    model = packaged(*ROBOTS[name])

    def start(_, data):
        if name in READY:
            data.qpos[:] = READY[name]

    worlds = Worlds(model, start=start, nconmax=64)
    engine, fine = dashpot.Engine(model), dashpot.Engine(model)
    fine.model.opt.timestep /= 16
    data, exact = engine.make_data(), fine.make_data()
    for each in (data, exact):
        start(None, each)
    rng = np.random.default_rng(0)
    low, high = model.actuator_ctrlrange.T
    limited = model.actuator_ctrllimited.astype(bool)
    low, high = np.where(limited, low, -1), np.where(limited, high, 1)
    for i in range(1000):
        if i % 20 == 0:
            ctrl = 0.3 * rng.uniform(low, high)
            worlds.d.ctrl.assign(ctrl[None].astype(np.float32))
        worlds.step()
        if i < round(0.1 / model.opt.timestep):
            data.ctrl[:] = exact.ctrl[:] = ctrl
            engine.step(data)
            fine.step(exact, 16)
            ours = np.abs(worlds.qpos - exact.qpos).max()
            theirs = np.abs(data.qpos - exact.qpos).max()
    # Both are of first order in what starts to touch and in dampers.
    assert ours < 1.5 * theirs + 1e-4
    assert np.isfinite(worlds.qpos).all()
    assert np.abs(worlds.qvel).max() < 100.0
    assert not worlds.d.dashpot.overflow.numpy().any()
