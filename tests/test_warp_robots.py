"""Robots of dashpot.warp beside the engine: the first 0.1 s, and energy over 500 steps."""

import importlib.util
from pathlib import Path

import mujoco
import numpy as np
import pytest

import dashpot
import unitree_g1
from warp_worlds import Worlds, energy


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
    "limp GR1": ("robosuite", "models/assets/robots/gr1/robot.xml"),
}
DAMPING = 2.0  # N m s/rad, added where motors do not hold


def robot(name):
    """Return a robot's model and its start."""
    model = packaged(*ROBOTS[name])
    if name.startswith("limp"):
        model.dof_damping[6:] += DAMPING

    def start(_, data):
        if name in READY:
            data.qpos[:] = READY[name]

    return model, start


def controls(model, share):
    """Yield controls that change every 20 steps by a share of their range."""
    rng = np.random.default_rng(0)
    limited = model.actuator_ctrllimited.astype(bool)
    low, high = np.where(limited, model.actuator_ctrlrange.T, [[-1.0], [1.0]])
    for i in range(500):
        if i % 20 == 0:
            ctrl = (share * rng.uniform(low, high)).astype(np.float32)
        yield ctrl


def engine_of(model, start, parts=1):
    engine = dashpot.Engine(model)
    engine.model.opt.timestep /= parts
    data = engine.make_data()
    start(model, data)
    return engine, data


@pytest.mark.parametrize(("share", "tolerance"), [(0.0, 1e-6), (0.3, 1e-5)])
def test_an_arm_in_flight_moves_as_in_the_engine(share, tolerance):
    """Both are of second order; at first what differs is some ulp of 2.6 rad (2.4e-7)."""
    model, start = robot("panda")
    worlds = Worlds(model, start=start, nconmax=64)
    engine, data = engine_of(model, start)
    for _, ctrl in zip(range(50), controls(model, share), strict=False):
        worlds.d.ctrl.assign(ctrl[None])
        data.ctrl[:] = ctrl
        worlds.step()
        engine.step(data)
        np.testing.assert_allclose(worlds.positions(), data.qpos, rtol=0, atol=tolerance)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_is_as_near_to_the_converged_motion_as_in_the_engine(name):
    """And 500 steps on it has no more energy than its actuators gave."""
    model, start = robot(name)
    worlds = Worlds(model, start=start, nconmax=64)
    (engine, data), (fine, exact) = (engine_of(model, start, parts) for parts in (1, 16))
    before = np.array(data.qpos)
    given, way = [energy(model, before, data.qvel)], np.zeros(model.nv)
    held = [given[0]]
    ours, theirs, work = [], [], given[0]
    for i, ctrl in enumerate(controls(model, 0.0 if name.startswith("limp") else 0.3)):
        worlds.d.ctrl.assign(ctrl[None])
        worlds.step()
        if i < round(0.1 / model.opt.timestep):
            data.ctrl[:] = exact.ctrl[:] = ctrl
            engine.step(data)
            fine.step(exact, 16)
            ours.append(np.abs(worlds.qpos - exact.qpos).max())
            theirs.append(np.abs(data.qpos - exact.qpos).max())
        after = worlds.positions()
        mujoco.mj_differentiatePos(model, way, 1.0, before, after)
        work += way @ worlds.d.qfrc_actuator.numpy()[0]
        before = after
        if i % 50 == 49:
            given.append(work)
            held.append(energy(model, after, worlds.qvel))
    # Both are of first order in what starts to touch, limits and dry friction.
    assert max(ours) < 1.5 * max(theirs) + 1e-5
    gained = np.diff(held) - np.diff(given)
    assert np.max(gained) < 1e-3 * np.ptp(held)
    assert not worlds.d.dashpot.overflow.numpy().any()


@pytest.mark.skipif(importlib.util.find_spec("mjlab") is None, reason="mjlab is not installed")
def test_a_g1_on_servos_is_nearer_to_the_converged_motion_than_in_the_engine():
    found = dict(unitree_g1.first_differences(share=0.05, timestep=0.002))
    assert found["warp to converged"] < found["engine to converged"]
    more, height, fits = unitree_g1.gained(share=0.05, timestep=0.002)
    assert more < 1e-3
    assert height > 0.05  # it lies on the floor
    assert fits
