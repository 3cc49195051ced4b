"""Instructions of one steady step of robots, dashpot's and `mj_step`'s, counted by callgrind.

Counts do not depend on what else a machine runs: they repeat within 0.1 %. They are those of one
build: a limit belongs to a compiler with its version and options, and to a version of MuJoCo.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

import dashpot
from dashpot import _core
from gate_figures.count_steps import STATE, STEPS
from gate_figures.figure import Figure
from robots import ROBOTS, Robot

MARGIN = 0.03
ON = 1.0  # s that both engines go on from where each came to rest
HERE = Path(__file__).parent


def build() -> str:
    """Return what counts go by."""
    return f"{_core.built_by()}, MuJoCo {mujoco.mj_versionString()}"


def state_of(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return all that a step starts from."""
    state = np.empty(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, state, STATE)
    return state


def save(folder: Path, name: str, robot: Robot) -> None:
    """Write a model, and states of it when dashpot and `mj_step` are steady."""
    model, engine = robot.model, dashpot.Engine(robot.model)
    data, plain = robot.settled(engine), robot.settled()
    for each in (data, plain):
        each.ctrl[:] = robot.motion(0.0) if robot.driving else robot.rest
    steps = round(ON / model.opt.timestep)
    engine.step(data, nstep=steps)
    mujoco.mj_step(model, plain, steps)
    mujoco.mj_saveModel(model, str(folder / f"{name}.mjb"))
    np.savez(
        folder / f"{name}.npz",
        dashpot=state_of(engine.model, data),
        mj_step=state_of(model, plain),
    )


def build_library(folder: Path) -> Path:
    """Compile what talks to callgrind."""
    library = folder / "client_requests.so"
    compiler = os.environ.get("CXX", "c++")
    source = HERE / "client_requests.cpp"
    command = [compiler, "-shared", "-fPIC", "-O1", "-o", str(library), str(source)]
    subprocess.run(command, check=True)
    return library


def count(folder: Path, library: Path) -> dict[str, int]:
    """Return the instructions of every call that `count_steps.py` counts, by its name."""
    paths = [str(Path(dashpot.__file__).parents[1]), str(HERE.parent)]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(paths),
        "PYTHONHASHSEED": "0",
        "OPENBLAS_NUM_THREADS": "1",
        "DASHPOT_INSTRUCTION_SET": "avx2",  # valgrind knows no AVX-512
    }
    command = ["valgrind", "--tool=callgrind", "--instr-atstart=no"]
    command += [f"--callgrind-out-file={folder}/counts", sys.executable]
    command += [str(HERE / "count_steps.py"), str(folder), str(library)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"counting failed:\n{done.stderr}")
    counts = {}
    for path in folder.glob("counts.*"):
        text = path.read_text()
        name = re.search(r"^desc: Trigger: Client Request: (.+)$", text, re.MULTILINE)
        total = re.search(r"^totals: (\d+)$", text, re.MULTILINE)
        if name and total:
            counts[name[1]] = int(total[1])
    return counts


def figures() -> Iterator[Figure]:
    """Count the steps of all robots; exits where valgrind or a package of models is missing."""
    if shutil.which("valgrind") is None:
        raise SystemExit("valgrind is not installed (apt-get install valgrind)")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for robot, make in ROBOTS.items():
            save(folder, robot, make())
        counts = count(folder, build_library(folder))
    for robot in ROBOTS:
        for engine in ("dashpot", "mj_step"):
            few, twice = (counts[f"{robot}:{engine}:{n}"] for n in (STEPS, 2 * STEPS))
            value = (twice - few) / STEPS
            yield Figure(robot, engine, round(value), MARGIN, limited=engine == "dashpot")
