"""Steps of robots under callgrind; `instructions.py` starts it.

    valgrind --tool=callgrind --instr-atstart=no python count_steps.py FOLDER LIBRARY

The folder holds, by name, a compiled model (.mjb) and a state of dashpot's and of MuJoCo's (.npz).
All is loaded before anything is counted. Counted are calls of some steps and of twice as many from
one state, whose difference has nothing of the call; they are named "model:engine:steps".
"""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

import dashpot

STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
WARM_UP, STEPS = 2, 4

Advance = Callable[[int], object]


def load(folder: Path, name: str) -> dict[str, Advance]:
    """Return what takes n steps from the state of a robot, by engine."""
    model = mujoco.MjModel.from_binary_path(str(folder / f"{name}.mjb"))
    engine = dashpot.Engine(model)
    states = np.load(folder / f"{name}.npz")
    data, plain = engine.make_data(), mujoco.MjData(model)

    def ours(nstep: int) -> None:
        mujoco.mj_setState(engine.model, data, states["dashpot"], STATE)
        engine.step(data, nstep=nstep)

    def theirs(nstep: int) -> None:
        mujoco.mj_setState(model, plain, states["mj_step"], STATE)
        mujoco.mj_step(model, plain, nstep)

    return {"dashpot": ours, "mj_step": theirs}


def main() -> None:
    """Count all robots."""
    folder, library = Path(sys.argv[1]), ctypes.CDLL(sys.argv[2])
    robots = {path.stem: load(folder, path.stem) for path in sorted(folder.glob("*.mjb"))}
    gc.disable()
    for ways in robots.values():
        for advance in ways.values():
            advance(WARM_UP)
    for name, ways in robots.items():
        for engine, advance in ways.items():
            for steps in (STEPS, 2 * STEPS):
                library.begin()
                advance(steps)
                library.end(f"{name}:{engine}:{steps}".encode())


if __name__ == "__main__":
    main()
