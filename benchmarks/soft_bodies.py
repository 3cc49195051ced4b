"""Time of a step of soft bodies under `discrete`, beside `mj_step`, and the energy that they gain.

    python benchmarks/soft_bodies.py [--seconds 0.5]

Processor time on one thread; both begin at the same state and go their own way, in turn, three
times, and the least counts. `gain` is the most by which kinetic, potential and elastic energy
exceed those of the start, in parts of these.
"""

from __future__ import annotations

import argparse
import functools
import time
from collections.abc import Callable

import mujoco

import dashpot

TIMESTEP = 0.002  # s
ROUNDS = 3
SOLID = '<elasticity young="5e4" poisson=".3" damping=".005"/>'
SHELL = """<elasticity young="1e5" poisson=".2" thickness=".004" damping=".01"
  elastic2d="both"/>"""
NET = '<edge equality="true" damping=".01"/>'
BALL = '<body pos="0 0 {height}"><freejoint/><geom size=".04" mass=".1"/></body>'
PLATE = """<body pos="0 0 .112"><joint type="slide" axis="0 0 1"/>
  <geom type="box" size=".1 .1 .01" mass=".5"/></body>"""


def grid(count: str, spacing: float, height: float, inner: str, name: str = "soft") -> str:
    dim = sum(int(number) > 1 for number in count.split())
    return f"""<flexcomp type="grid" count="{count}" spacing="{spacing} {spacing} {spacing}"
      pos="0 0 {height}" radius=".003" mass=".3" name="{name}" dim="{dim}">
      <contact condim="3" selfcollide="none"/>{inner}</flexcomp>"""


def cube(side: int, height: float, name: str = "soft") -> str:
    return grid(f"{side} {side} {side}", 0.09 / (side - 1), height, SOLID, name)


def held(count: int, inner: str) -> str:
    last = count - 1
    corners = f'<pin id="0 {last} {count * last} {count * count - 1}"/>'
    return grid(f"{count} {count} 1", 0.3 / last, 0.4, inner + corners) + BALL.format(height=0.5)


SCENES = {
    "cube of 4 under a plate": cube(4, 0.05) + PLATE,
    "cube of 6": cube(6, 0.1),
    "cube of 8": cube(8, 0.1),
    "cubes stacked": cube(4, 0.05, "low") + cube(4, 0.16, "high"),
    "shell on a ball": '<geom size=".1" pos="0 0 .15"/>' + grid("7 7 1", 0.04, 0.27, SHELL),
    "trampoline of 7": held(7, SHELL),
    "trampoline of 15": held(15, SHELL),
    "net of 7": held(7, NET),
    "net of 15": held(15, NET),
    "rope": grid("16 1 1", 0.03, 0.1, NET),
}


def model_of(bodies: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{TIMESTEP}" integrator="discrete"/><worldbody>
        <geom type="plane" size="2 2 .1"/>{bodies}</worldbody></mujoco>"""
    )


def time_of(step: Callable[[], object], steps: int) -> float:
    start = time.process_time()
    for _ in range(steps):
        step()
    return (time.process_time() - start) / steps


def gain_of(engine: dashpot.Engine, steps: int) -> float:
    data = engine.make_data()
    gain, start = 0.0, 0.0
    for i in range(steps + 1):
        energy = engine.energy(data)
        mechanical = energy.kinetic + energy.potential + energy.elastic
        start = mechanical if i == 0 else start
        gain = max(gain, mechanical / start - 1.0)
        engine.step(data)
    return gain


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=0.5)
    steps = round(parser.parse_args().seconds / TIMESTEP)
    print(f"{'scene':24s} {'dofs':>5s} {'mj_step':>8s} {'dashpot':>8s}  ms  ratio  gain")
    for name, bodies in SCENES.items():
        model = model_of(bodies)
        engine = dashpot.Engine(model)
        theirs = ours = float("inf")
        for _ in range(ROUNDS):
            data, own = mujoco.MjData(model), engine.make_data()
            theirs = min(theirs, time_of(functools.partial(mujoco.mj_step, model, data), steps))
            ours = min(ours, time_of(functools.partial(engine.step, own), steps))
        gain = gain_of(engine, steps)
        print(
            f"{name:24s} {model.nv:5d} {1e3 * theirs:8.3f} {1e3 * ours:8.3f}"
            f"     {ours / theirs:5.2f}  {gain:.0e}"
        )


if __name__ == "__main__":
    main()
