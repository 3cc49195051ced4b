"""Times of rollouts beside `mujoco.rollout`: many short ones in a call, as controllers ask for.

    python benchmarks/rollouts.py --nthread 1

Robots as shipped, from the state after 50 steps, without controls. dashpot starts from
states with contact memory and returns those of full physics; MuJoCo keeps its data and threads, as
dashpot does. Least time of five calls, in turn.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import mujoco
import mujoco.rollout
import numpy as np

import dashpot
from grasps import package_file

MODELS = {
    "Shadow hand with its block": (
        "gymnasium_robotics",
        "envs/assets/hand/manipulate_block.xml",
    ),
    "Panda": ("robosuite", "models/assets/robots/panda/robot.xml"),
    "UR5e": ("robosuite", "models/assets/robots/ur5e/robot.xml"),
    "GR1": ("robosuite", "models/assets/robots/gr1/robot.xml"),
    **{
        name: ("gymnasium_robotics", f"envs/mujoco/assets/{name.lower()}.xml")
        for name in ("Ant", "Hopper", "Humanoid", "Swimmer", "Walker2d")
    },
}
BATCHES = ((16, 1), (16, 10), (64, 50))
REPEATS = 5


def state_of(model: mujoco.MjModel, data: mujoco.MjData, kind: mujoco.mjtState) -> np.ndarray:
    """Return a state vector."""
    state = np.empty(mujoco.mj_stateSize(model, int(kind)))
    mujoco.mj_getState(model, data, state, int(kind))
    return state


def least_times(ways: list[Callable[[], object]]) -> list[float]:
    """Return the least time (s) of each way, called in turn."""
    best = [np.inf] * len(ways)
    for _ in range(REPEATS):
        for i, call in enumerate(ways):
            before = time.perf_counter()
            call()
            best[i] = min(best[i], time.perf_counter() - before)
    return best


def main() -> None:
    """Print one line a model and batch."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nthread", type=int, default=1)
    nthread = parser.parse_args().nthread
    for name, (package, path) in MODELS.items():
        model = mujoco.MjModel.from_xml_path(package_file(package, path))
        engine = dashpot.Engine(model)
        data, plain = engine.make_data(), mujoco.MjData(model)
        engine.step(data, nstep=50)
        mujoco.mj_step(model, plain, 50)
        start = state_of(engine.model, data, mujoco.mjtState.mjSTATE_INTEGRATION)
        plain_start = state_of(model, plain, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        print(f"{name}: {len(start)} numbers in a state with memory, {len(plain_start)} without")
        for nbatch, nstep in BATCHES:
            states, plain_states = (np.tile(s, (nbatch, 1)) for s in (start, plain_start))
            with mujoco.rollout.Rollout(nthread=nthread) as pool:
                datas = [mujoco.MjData(model) for _ in range(nthread)]
                ours, theirs = least_times(
                    [
                        lambda s=states, n=nstep, e=engine: dashpot.rollout(
                            e, s, nstep=n, nthread=nthread, with_memory=False
                        ),
                        lambda s=plain_states, n=nstep, m=model, d=datas, p=pool: p.rollout(
                            m, d, s, nstep=n
                        ),
                    ]
                )
            print(
                f"  {nbatch} of {nstep} steps: {1e3 * ours:.2f} ms, mujoco.rollout "
                f"{1e3 * theirs:.2f} ms: {ours / theirs:.2f} times"
            )


if __name__ == "__main__":
    main()
