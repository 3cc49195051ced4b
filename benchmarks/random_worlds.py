"""Random scenes of `random_scenes.py` stepped by dashpot.warp: worlds that lose their numbers.

Counts worlds that are not finite, that had more contacts than fit, and whose kinetic and potential
energy rose by more than 1 % above that of the start. Scenes whose links overlap at the start, or
with joints that turn by more than 0.2 rad in a step, are not asked for energy.

    python benchmarks/random_worlds.py 0 1000
    python benchmarks/random_worlds.py 0 1000 articulated
"""

from __future__ import annotations

import argparse

import mujoco
import numpy as np
import warp as wp

import dashpot.warp as dw
from random_scenes import RandomScene, random_articulated_scene, random_scene, turns_too_fast

NCONMAX = {"free": 64, "articulated": 48}
PARTS = 20


def energy(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return kinetic plus potential energy (J), in double precision."""
    mujoco.mj_forward(model, data)
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    return float(data.energy.sum())


def check(scene: RandomScene, nconmax: int) -> list[str]:
    """Step a scene and return what is wrong, by name."""
    model = mujoco.MjModel.from_xml_string(scene.xml)
    model.opt.timestep = scene.timestep
    data = mujoco.MjData(model)
    data.qvel[:] = scene.velocity.ravel()
    m = dw.put_model(model, materials=scene.materials)
    d = dw.put_data(model, data, nconmax=nconmax)
    with wp.ScopedCapture() as capture:
        dw.step(m, d)
    start = energy(model, data)
    is_asked = not (data.contact.dist < 0).any()
    found = set()
    for _ in range(PARTS):
        for _ in range(scene.steps // PARTS):
            wp.capture_launch(capture.graph)
        data.qpos[:], data.qvel[:] = d.qpos.numpy()[0], d.qvel.numpy()[0]
        if d.dashpot.overflow.numpy()[0]:
            found.add("overflow")
        if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
            return [*found, "not finite"]
        is_asked = is_asked and not turns_too_fast(model, data)
        if is_asked and energy(model, data) > start + 0.01 * abs(start):
            found.add("energy")
    return sorted(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("first", type=int, help="first seed")
    parser.add_argument("last", type=int, help="seed to end before")
    parser.add_argument("kind", nargs="?", choices=tuple(NCONMAX), default="free")
    parser.add_argument("--device", default="cpu", help="Warp's name of it, cpu or cuda:0")
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    wp.set_device(arguments.device)
    make = random_scene if arguments.kind == "free" else random_articulated_scene
    counts: dict[str, int] = {}
    for seed in range(arguments.first, arguments.last):
        for what in check(make(seed), NCONMAX[arguments.kind]):
            print(f"seed {seed}: {what}", flush=True)
            counts[what] = counts.get(what, 0) + 1
    done = ", ".join(f"{what} in {number}" for what, number in counts.items())
    print(f"{arguments.last - arguments.first} scenes: {done or 'nothing is wrong'}")


if __name__ == "__main__":
    main()
