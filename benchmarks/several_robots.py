"""Time per step of scenes with several robots on one and two threads, beside mj_step.

    python benchmarks/several_robots.py    # needs gymnasium

Robots of Gymnasium stand or lie side by side on one floor and do not reach each other. After 300
steps, the least time of chunks of 100, all ways in turn. MuJoCo's second thread is of a
pool of its data, which solves islands.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import mujoco
import numpy as np

import dashpot
from grasps import package_file
from no_arguments import takes_no_arguments

ROBOTS = (("Ant", 4), ("Ant", 16), ("Humanoid", 9))
SPACING = 3.0  # m
WARM_UP, CHUNK, REPEATS = 300, 100, 20


def least_times(ways: list[Callable[[int], object]]) -> list[float]:
    """Return the least time per step (s) of each way, measured in turn."""
    for advance in ways:
        advance(WARM_UP)
    best = [np.inf] * len(ways)
    for _ in range(REPEATS):
        for i, advance in enumerate(ways):
            before = time.perf_counter()
            advance(CHUNK)
            best[i] = min(best[i], (time.perf_counter() - before) / CHUNK)
    return best


def several(name: str, count: int) -> mujoco.MjModel:
    """Compile a robot's own scene with more of it beside, in rows of four."""
    path = package_file("gymnasium", f"envs/mujoco/assets/{name.lower()}.xml")
    scene, robot = mujoco.MjSpec.from_file(path), mujoco.MjSpec.from_file(path)
    for extra in (*robot.worldbody.geoms, *robot.worldbody.lights, *robot.worldbody.cameras):
        robot.delete(extra)
    for key in robot.keys:
        robot.delete(key)
    scene.copy_during_attach = True
    scene.memory = 200 << 20
    for i in range(1, count):
        frame = scene.worldbody.add_frame(pos=[SPACING * (i % 4), SPACING * (i // 4), 0])
        scene.attach(robot, prefix=f"{i}_", frame=frame)
    return scene.compile()


def main() -> None:
    """Print one line a scene."""
    takes_no_arguments(__doc__)
    for name, count in ROBOTS:
        model = several(name, count)
        ways = []
        for threads in (1, 2):
            engine = dashpot.Engine(model, nthread=threads)
            data = engine.make_data()
            ways.append(lambda n, engine=engine, data=data: engine.step(data, nstep=n))
        for threads in (1, 2):
            plain = mujoco.MjData(model)
            if threads > 1:
                mujoco.mju_threadpool(plain, threads - 1)
            ways.append(lambda n, plain=plain, model=model: mujoco.mj_step(model, plain, n))
        ours, ours_shared, theirs, theirs_shared = (1e6 * time for time in least_times(ways))
        print(
            f"{count} {name}: step {ours:.0f} us on one thread, {ours_shared:.0f} on two; mj_step "
            f"{theirs:.0f}, {theirs_shared:.0f}"
        )


if __name__ == "__main__":
    main()
