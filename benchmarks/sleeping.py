"""How much of a settled bin falls asleep with `<flag sleep="enable"/>`, and what a step takes then.

    python benchmarks/sleeping.py

The bins of `run.py` settle for 6 s under dashpot without sleep. From there they are stepped for
10 s with it, at MuJoCo's default `sleep_tolerance`: by dashpot, by MuJoCo's default cones, and by
the elliptic ones with an impratio of 100, which creep least, both with the solver that is fastest
in the largest bin (CG, sparse). Of the last 2 s the mean number of bodies that are awake is given,
and the mean time of a step, beside that of steps in which nothing may sleep.
"""

from __future__ import annotations

import time

import mujoco
import numpy as np

from no_arguments import takes_no_arguments
from piles import BINS, settled_bin
from scene import Array, Scene
from simulate import DASHPOT, IMPRATIO_100, Setting, prepare
from speed import TIMESTEP

SETTLED, STEPPED, LOOKED_AT = 3000, 5000, 1000  # steps
SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
FASTEST = {"solver": mujoco.mjtSolver.mjSOL_CG, "jacobian": mujoco.mjtJacobian.mjJAC_SPARSE}
WAYS = (
    DASHPOT,
    Setting("mujoco pyramidal", option=FASTEST),
    Setting("mujoco elliptic impratio 100", option={**IMPRATIO_100, **FASTEST}),
)


def awake_and_time(scene: Scene, way: Setting, position: Array, flags: int) -> tuple[float, float]:
    """Return how many bodies are awake at the end, and how long a step takes there (s)."""
    option = {**way.option, "enableflags": flags}
    asleep = Setting(way.name, dashpot=way.dashpot, option=option)
    _, data, advance = prepare(scene, asleep, TIMESTEP)
    data.qpos[:] = position
    advance(STEPPED - LOOKED_AT)
    awake, took = [], 0.0
    for _ in range(LOOKED_AT):
        start = time.perf_counter()
        advance(1)
        took += time.perf_counter() - start
        awake.append(data.ntree_awake)
    return float(np.mean(awake)), took / LOOKED_AT


def main() -> None:
    """Print one line a bin and way."""
    takes_no_arguments(__doc__)
    for name, count in BINS.items():
        scene = settled_bin(name)
        _, data, advance = prepare(scene, DASHPOT, TIMESTEP)
        advance(SETTLED)
        for way in WAYS:
            awake, asleep_step = awake_and_time(scene, way, data.qpos, SLEEP)
            _, step = awake_and_time(scene, way, data.qpos, 0)
            print(
                f"{name}, {way.name}: {awake:.0f} of {count} awake, step {1e3 * asleep_step:.3f} "
                f"ms, without sleep {1e3 * step:.3f} ms",
                flush=True,
            )


if __name__ == "__main__":
    main()
