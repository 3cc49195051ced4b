"""World-steps per second, overlap and creep of dashpot.warp beside MuJoCo Warp, in one run.

Every way takes the same model from the same state: a second to settle, then `--steps` steps that
are timed as one captured graph, the same for all. Overlaps are those of the first world at the end,
by MuJoCo's collision in double precision; creep is how far the free bodies that were at rest went
in the timed steps. MuJoCo Warp has the model's own settings, with Newton and with CG.

    python benchmarks/many_worlds.py --device cpu --worlds 1 4 --scenes humanoid hand bin-90
    python benchmarks/many_worlds.py --device cpu --drop
    python benchmarks/many_worlds.py --device cpu --piles

With `--drop` twenty mixed bodies fall into a walled square for two seconds, at four time steps;
mean and standard deviation of the overlap are over all contacts that overlap, a hundred times a
second. With `--piles` eight do, for two seconds at 1 ms, from ten seeds: mean and worst overlap at
the ends of all steps, beside the engine's.
"""

from __future__ import annotations

import argparse
import importlib.util
import time
from pathlib import Path
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

import dashpot
import dashpot.warp as dw
from piles import BINS, bin_of, heap
from scene import mjcf
from scenes import slope

WAYS = ("dashpot", "dashpot comfree", "MuJoCo Warp Newton", "MuJoCo Warp CG")
SETTLE = 1.0  # s
DROP_STEPS = (0.001, 0.002, 0.005, 0.01)  # s


def packaged(package: str, path: str) -> mujoco.MjModel:
    """Return a model that an installed package ships."""
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        raise FileNotFoundError(f"{package} is not installed")
    return mujoco.MjModel.from_xml_path(str(Path(spec.origin).parent / path))


def humanoids(count: int) -> mujoco.MjModel:
    """Return MuJoCo Warp's humanoid, alone or three beside each other."""
    if count == 1:
        return packaged("mujoco_warp", "test_data/humanoid/humanoid.xml")
    return packaged("mujoco_warp", "test_data/humanoid/n_humanoid.xml")


def model_of(name: str) -> mujoco.MjModel:
    """Return the model of a scene."""
    if name == "humanoid":
        return humanoids(1)
    if name == "three humanoids":
        return humanoids(3)
    if name == "aloha":
        return packaged("mujoco_warp", "test_data/aloha_pot/scene.xml")
    if name == "GR1":
        return packaged("robosuite", "models/assets/robots/gr1/robot.xml")
    if name == "hand":
        return packaged("gymnasium_robotics", "envs/assets/hand/manipulate_block.xml")
    if name == "slope":
        return slope().model(0.002)
    return bin_of(BINS[name]).model(0.002)


def contacts_of(name: str) -> int:
    """Return how many contacts a world may have."""
    sizes = {
        "bin-90": 200,
        "bin-350": 700,
        "bin-1400": 2400,
        "hand": 64,
        "three humanoids": 200,
        "slope": 8,
    }
    return sizes.get(name, 64)


def prepare(mjm: mujoco.MjModel, nconmax: int, way: str, nworld: int) -> tuple[Any, Any, Any]:
    """Return model, data and step of one way."""
    if way.startswith("dashpot"):
        m = dw.put_model(mjm, law="comfree" if way.endswith("comfree") else "kelvin_voigt")
        return m, dw.make_data(mjm, nworld, nconmax=nconmax), dw.step
    newton, cg = mujoco.mjtSolver.mjSOL_NEWTON, mujoco.mjtSolver.mjSOL_CG
    mjm.opt.solver = newton if way.endswith("Newton") else cg
    m = mjw.put_model(mjm)
    return m, mjw.make_data(mjm, nworld, nconmax=nconmax, njmax=4 * nconmax + mjm.nv), mjw.step


def overlaps(mjm: mujoco.MjModel, qpos: np.ndarray) -> list[float]:
    """Return the overlaps of contacts (m), in double precision."""
    data = mujoco.MjData(mjm)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(mjm, data)
    mujoco.mj_collision(mjm, data)
    return [-contact.dist for contact in data.contact if contact.dist < 0]


def drop(timestep: float, way: str) -> tuple[float, float]:
    """Return mean and standard deviation of the overlap of what falls (m)."""
    mjm = mujoco.MjModel.from_xml_string(mjcf(heap(20, size=0.05, half=0.2, seed=0)))
    mjm.opt.timestep = timestep
    m, d, step = prepare(mjm, 400, way, 1)
    step(m, d)
    with wp.ScopedCapture() as capture:
        step(m, d)
    found: list[float] = []
    for _ in range(200):
        for _ in range(round(0.01 / timestep)):
            wp.capture_launch(capture.graph)
        found += overlaps(mjm, d.qpos.numpy()[0])
    return float(np.mean(found)), float(np.std(found))


def pile(seed: int, way: str) -> tuple[float, float]:
    """Return mean and worst overlap (m) of a pile of eight, at the ends of 2,000 steps of 1 ms."""
    mjm = mujoco.MjModel.from_xml_string(mjcf(heap(8, size=0.05, half=0.2, seed=seed)))
    mjm.opt.timestep = 0.001
    found: list[float] = []
    if way == "engine":
        engine = dashpot.Engine(mjm)
        data = engine.make_data()
        for _ in range(2000):
            engine.step(data)
            found += overlaps(mjm, data.qpos)
    else:
        m, d, step = prepare(mjm, 64, way, 1)
        step(m, d)
        with wp.ScopedCapture() as capture:
            step(m, d)
        for _ in range(1999):
            found += overlaps(mjm, d.qpos.numpy()[0])
            wp.capture_launch(capture.graph)
    return float(np.mean(found)), float(np.max(found))


def measure(name: str, way: str, nworld: int, steps: int) -> dict[str, float]:
    """Settle, then time `steps` steps."""
    mjm = model_of(name)
    m, d, step = prepare(mjm, contacts_of(name), way, nworld)
    step(m, d)
    with wp.ScopedCapture() as capture:
        step(m, d)
    for _ in range(round(SETTLE / mjm.opt.timestep)):
        wp.capture_launch(capture.graph)
    before = d.qpos.numpy()[0].copy()
    wp.synchronize()
    start = time.perf_counter()
    for _ in range(steps):
        wp.capture_launch(capture.graph)
    wp.synchronize()
    taken = time.perf_counter() - start
    after = d.qpos.numpy()[0]
    free = np.flatnonzero(mjm.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    rows = (mjm.jnt_qposadr[free][:, None] + np.arange(3)).ravel()
    creep = float(np.median(np.abs(after - before)[rows])) if rows.size else 0.0
    return {
        "world-steps/s": nworld * steps / taken,
        "overlap": float(np.mean(overlaps(mjm, after) or [0.0])),
        "creep": creep,
        "finite": float(np.isfinite(after).all()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--device", default=None, help="Warp's name of it, cpu or cuda:0")
    parser.add_argument("--worlds", type=int, nargs="+", default=[1])
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--scenes", nargs="+", default=["humanoid", "hand", "bin-90"])
    parser.add_argument("--ways", nargs="+", default=list(WAYS), choices=WAYS)
    parser.add_argument("--drop", action="store_true", help="overlap of what falls instead")
    parser.add_argument("--piles", action="store_true", help="overlap of piles of eight instead")
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    if arguments.device:
        wp.set_device(arguments.device)
    if arguments.piles:
        print("| seed | dashpot.warp: mean, worst (um) | engine |")
        print("|---|---|---|")
        for seed in range(10):
            piles = [pile(seed, way) for way in ("dashpot", "engine")]
            cells = [f"{1e6 * mean:.2f}, {1e6 * worst:.0f}" for mean, worst in piles]
            print(f"| {seed} | " + " | ".join(cells) + " |", flush=True)
        return
    if arguments.drop:
        print("| way | " + " | ".join(f"{1e3 * t:g} ms (mm)" for t in DROP_STEPS) + " |")
        print("|---" * (1 + len(DROP_STEPS)) + "|")
        for way in arguments.ways:
            found = [drop(timestep, way) for timestep in DROP_STEPS]
            cells = [f"{1e3 * mean:.3f} +- {1e3 * spread:.3f}" for mean, spread in found]
            print(f"| {way} | " + " | ".join(cells) + " |", flush=True)
        return
    print(f"device {wp.get_device()}; GPU columns are measured on a GPU only")
    print("| scene | worlds | way | world-steps/s | mean overlap (um) | creep (um) |")
    print("|---|---|---|---|---|---|")
    for name in arguments.scenes:
        for nworld in arguments.worlds:
            for way in arguments.ways:
                found = measure(name, way, nworld, arguments.steps)
                lost = "" if found["finite"] else " (diverged)"
                print(
                    f"| {name} | {nworld} | {way}{lost} | {found['world-steps/s']:.0f} "
                    f"| {1e6 * found['overlap']:.2f} | {1e6 * found['creep']:.3f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
