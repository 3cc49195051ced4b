"""Hold an object for a million steps: memory of the process, drift, contact.

    python benchmarks/endurance.py shadow            # needs gymnasium-robotics
    python benchmarks/endurance.py linkage --steps 100000

Settles until nothing moves; the passive fingertips of the Shadow hand, damped by 0.1 N m s, take
some minutes and push the block so long. Then prints at every tenth of the steps the memory of the
process, how far the object has moved in the frame of the hand since, the largest speed, the number
of touching contacts and the sum of their normal forces. Fails when the object moved by more than
0.01 mm, contact was lost or memory grew by more than 1 MB after the first tenth.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import mujoco
import numpy as np

import dashpot
from grasps import GRASPS

DRIFT = 1e-5  # m
GROWTH = 1.0  # MB
CHUNK = 1000  # steps between two looks at the contacts
SETTLED = 1e-4  # m/s and rad/s
LONGEST = 600.0  # s, to settle


def resident_memory() -> float:
    """Return the resident memory of this process, MB (Linux)."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return float(line.split()[1]) / 1024
    raise RuntimeError("/proc/self/status has no VmRSS")


def settle(engine: dashpot.Engine, data: mujoco.MjData) -> None:
    """Step until nothing moves faster than SETTLED."""
    while np.abs(data.qvel).max() > SETTLED or data.time < 2.0:
        if data.time > LONGEST:
            raise RuntimeError(f"something still moves after {LONGEST:g} s")
        engine.step(data, nstep=CHUNK)


def hold(name: str, steps: int, timestep: float) -> list[str]:
    """Run one grasp and return what went wrong."""
    grasp = GRASPS[name](timestep)
    engine = dashpot.Engine(grasp.model)
    data = engine.make_data()
    grasp.start(data)
    data.ctrl[:] = grasp.control
    settle(engine, data)
    print(f"settled after {data.time:.0f} s")
    start, began = grasp.relative(data), time.perf_counter()
    drift, fewest, memory = 0.0, sys.maxsize, []
    print(f"{name}, dt {1e3 * timestep:g} ms, {steps} steps")
    print(" part   RSS MB   moved m   speed    touching  force N   us/step")
    for tenth in range(1, 11):
        for _ in range(steps // 10 // CHUNK):
            stats = engine.step(data, nstep=CHUNK)
            drift = max(drift, float(np.linalg.norm(grasp.relative(data) - start)))
            fewest = min(fewest, stats.touching)
        memory.append(resident_memory())
        rate = (time.perf_counter() - began) / (tenth * (steps // 10 // CHUNK) * CHUNK)
        force = engine.contacts(data, body=grasp.held).force[:, 0].sum()
        print(
            f"{10 * tenth:4d} % {memory[-1]:8.2f} {drift:9.1e} {np.abs(data.qvel).max():9.1e}"
            f" {stats.touching:6d} {force:11.4f} {1e6 * rate:8.0f}",
            flush=True,
        )
    failures = []
    if drift > DRIFT:
        failures.append(f"the object moved by {drift:.1e} m")
    if fewest == 0:
        failures.append("contact was lost")
    if memory[-1] - memory[0] > GROWTH:
        failures.append(f"memory grew by {memory[-1] - memory[0]:.2f} MB")
    return failures


def main() -> None:
    """Parse the command line and run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("grasp", choices=list(GRASPS))
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--timestep", type=float, default=0.002, help="s")
    arguments = parser.parse_args()
    if arguments.steps < 10 * CHUNK:
        parser.error(f"--steps must be at least {10 * CHUNK}")
    failures = hold(arguments.grasp, arguments.steps, arguments.timestep)
    print("held" if not failures else "; ".join(failures))
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
