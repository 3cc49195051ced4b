"""How dashpot's time per step grows with the number of contacts, from about 80 to 10,000.

    python benchmarks/growth.py [--largest BODIES] [--out growth.json]

Bins of mixed bodies settle, large ones longer, until at most one in a thousand bodies moves faster
than 1 cm/s. Then 40 steps are timed, five times, on one thread and on two in turn; the least
counts. The solve is the step on one thread without what `mj_step` takes with constraints disabled
and without collision. The exponents, for one thread, are slopes of straight lines through log time
over log contacts.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from piles import bin_of
from simulate import DASHPOT, prepare
from speed import STATE, THREADS, TIMESTEP, without_contact

MOVING = 0.01  # m/s
FEW = 1e-3  # part of the bodies
LONGEST = 60.0  # s
BODIES = (27, 60, 140, 380, 1000, 2800)


@dataclasses.dataclass(frozen=True)
class Growth:
    """Times of one bin, s."""

    bodies: int
    contacts: int
    step: float
    solve: float
    shared_step: float  # on THREADS


def settle(data: mujoco.MjData, advance: Callable[[int], object], steps: int) -> None:
    """Advance `steps`, and more until next to nothing moves, at most LONGEST."""
    advance(steps)
    while np.mean(np.linalg.norm(data.qvel.reshape(-1, 6)[:, :3], axis=1) > MOVING) > FEW:
        if data.time > LONGEST:
            raise RuntimeError(f"the bin has not settled after {LONGEST:g} s")
        advance(50)


def measure(bodies: int) -> Growth:
    """Settle a bin and time its steps."""
    scene = bin_of(bodies)
    model, data, advance = prepare(scene, DASHPOT, TIMESTEP)
    settle(data, advance, round(scene.duration / TIMESTEP))
    _, shared, advance_shared = prepare(scene, DASHPOT.on_threads(THREADS), TIMESTEP)
    state = np.empty(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, state, STATE)
    mujoco.mj_setState(model, shared, state, STATE)
    times = np.array([[seconds(advance), seconds(advance_shared)] for _ in range(5)])
    step, shared_step = times.min(axis=0)
    contacts = int((data.contact.dist < 0).sum())
    solve = step - without_contact(model, data, repeats=40)
    return Growth(bodies, contacts, step, solve, shared_step)


def seconds(advance: Callable[[int], object]) -> float:
    """Return the time of a step, over 40."""
    before = time.perf_counter()
    advance(40)
    return (time.perf_counter() - before) / 40


def exponent(contacts: np.ndarray, seconds: np.ndarray) -> float:
    """Return the slope of log time over log contacts."""
    return float(np.polyfit(np.log(contacts), np.log(seconds), 1)[0])


def main() -> None:
    """Parse the command line, run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=int, default=BODIES[-1], help="bodies in the largest bin")
    parser.add_argument("--out", type=Path, help="write results to this JSON file")
    arguments = parser.parse_args()
    results = []
    print(f"bodies contacts  step ms  solve ms  solve ns/contact  {THREADS} threads: step ms")
    for bodies in (n for n in BODIES if n <= arguments.largest):
        r = measure(bodies)
        results.append(r)
        per_contact = 1e9 * r.solve / r.contacts
        print(
            f"{r.bodies:6d} {r.contacts:8d} {1e3 * r.step:8.3f} {1e3 * r.solve:9.3f}"
            f" {per_contact:12.0f} {1e3 * r.shared_step:20.3f}",
            flush=True,
        )
    contacts = np.array([r.contacts for r in results])
    print(f"exponent of the solve {exponent(contacts, np.array([r.solve for r in results])):.3f}")
    print(f"exponent of the step  {exponent(contacts, np.array([r.step for r in results])):.3f}")
    if arguments.out:
        arguments.out.write_text(json.dumps([dataclasses.asdict(r) for r in results], indent=1))


if __name__ == "__main__":
    main()
