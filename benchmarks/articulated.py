"""Time per step of small articulated scenes beside mj_step, at the models' own time steps.

    python benchmarks/articulated.py    # needs gymnasium-robotics and robosuite

No controls; after 300 steps, the least processor time of chunks of 100 steps, the two in turn.
Shadow hand and block have 24 rows of dry friction, some 24 of limits and a few of contacts, Panda
next to none. The last five are Gymnasium's, with RK4: mj_step solves contacts in every stage.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import mujoco
import numpy as np

import dashpot
from grasps import package_file
from no_arguments import takes_no_arguments

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
WARM_UP, CHUNK, REPEATS = 300, 100, 20


def least_times(ways: list[Callable[[int], object]]) -> list[float]:
    """Return the least time per step (s) of each way, measured in turn."""
    for advance in ways:
        advance(WARM_UP)
    best = [np.inf] * len(ways)
    for _ in range(REPEATS):
        for i, advance in enumerate(ways):
            before = time.process_time()
            advance(CHUNK)
            best[i] = min(best[i], (time.process_time() - before) / CHUNK)
    return best


def main() -> None:
    """Print one line a model."""
    takes_no_arguments(__doc__)
    for name, (package, path) in MODELS.items():
        model = mujoco.MjModel.from_xml_path(package_file(package, path))
        engine = dashpot.Engine(model)
        data, plain = engine.make_data(), mujoco.MjData(model)
        ours, theirs = least_times(
            [
                lambda n, engine=engine, data=data: engine.step(data, nstep=n),
                lambda n, model=model, plain=plain: mujoco.mj_step(model, plain, n),
            ]
        )
        print(
            f"{name}: nv {model.nv}, {plain.nefc} rows, step {1e6 * ours:.1f} us, mj_step "
            f"{1e6 * theirs:.1f} us: {ours / theirs:.2f} times"
        )


if __name__ == "__main__":
    main()
