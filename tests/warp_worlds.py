"""Worlds of dashpot.warp on Warp's CPU device, stepped as a captured graph."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import dashpot

wp = pytest.importorskip("warp")
pytest.importorskip("mujoco_warp")

wp.config.quiet = True
wp.config.log_level = wp.LOG_WARNING if hasattr(wp, "LOG_WARNING") else 30
wp.set_device("cpu")

import dashpot.warp as dw  # noqa: E402


class Worlds:
    """Worlds of one model; the graph of a step is launched again and again."""

    def __init__(self, model, *, start=None, nworld=1, nconmax=16, **options):
        self.model = model
        data = mujoco.MjData(model)
        if start:
            start(model, data)
        self.m = dw.put_model(model, **options)
        self.d = dw.put_data(model, data, nworld=nworld, nconmax=nconmax)
        self.capture()

    def capture(self):
        with wp.ScopedCapture(device="cpu") as capture:
            dw.step(self.m, self.d)
        self.graph = capture.graph

    def step(self, count=1):
        for _ in range(count):
            wp.capture_launch(self.graph)

    def positions(self, world=0):
        """With the rest that single precision does not hold."""
        rest = self.d.dashpot.memory.rest.numpy()[world]
        return self.d.qpos.numpy()[world].astype(float) + rest

    @property
    def qpos(self):
        return self.d.qpos.numpy()[0]

    @property
    def qvel(self):
        return self.d.qvel.numpy()[0]


def worlds_of(scene, timestep, **options):
    """Worlds of a benchmark scene."""
    return Worlds(
        scene.model(timestep),
        start=scene.start,
        materials=dict(scene.materials),
        pair_materials=dict(scene.pair_materials),
        **options,
    )


def engine_of(scene, timestep):
    """Return the C++ engine and data of a benchmark scene."""
    engine = dashpot.Engine(scene.model(timestep))
    engine.set_materials(scene.materials)
    for pair, material in scene.pair_materials.items():
        engine.set_pair_material(*pair, material)
    data = engine.make_data()
    if scene.start:
        scene.start(engine.model, data)
    return engine, data


def model_of(xml, timestep=0.002):
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.timestep = timestep
    return model


def energy(model, qpos, qvel):
    """Kinetic and potential energy in double precision, J."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(model, data)
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    return float(np.sum(data.energy))
