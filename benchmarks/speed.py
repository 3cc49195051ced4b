"""Time per step in settled bins, dashpot beside every MuJoCo solver, in one run.

Every way of stepping starts from the same state (settled by dashpot), runs until it has settled
in its own equilibrium, and is then timed over the same 100 steps, three times; the least counts.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from itertools import product

import mujoco
import numpy as np

from piles import settled_bin
from simulate import DASHPOT, Advance, Setting, overlaps, prepare

TIMESTEP = 0.002
SOLVERS = {
    "Newton": mujoco.mjtSolver.mjSOL_NEWTON,
    "CG": mujoco.mjtSolver.mjSOL_CG,
    "PGS": mujoco.mjtSolver.mjSOL_PGS,
}
CONES = {
    "pyramidal": mujoco.mjtCone.mjCONE_PYRAMIDAL,
    "elliptic": mujoco.mjtCone.mjCONE_ELLIPTIC,
}
JACOBIANS = {
    "dense": mujoco.mjtJacobian.mjJAC_DENSE,
    "sparse": mujoco.mjtJacobian.mjJAC_SPARSE,
}


@dataclass(frozen=True)
class Timing:
    """Time per step of one setting in one bin; times in ms, overlaps in m, speed in m/s."""

    scene: str
    setting: str
    contacts: int
    step: float
    solve: float
    mean_overlap: float
    max_overlap: float
    mean_speed: float


def solver_settings(*, smoke: bool) -> list[Setting]:
    """Return every MuJoCo solver, cone and Jacobian; the usual three of them for a smoke run."""
    combinations = product(SOLVERS, CONES, JACOBIANS)
    if smoke:
        combinations = (
            ("Newton", "pyramidal", "sparse"),
            ("CG", "pyramidal", "sparse"),
            ("PGS", "pyramidal", "dense"),
        )
    return [
        Setting(
            f"mujoco {solver} {cone} {jacobian}",
            option={
                "solver": SOLVERS[solver],
                "cone": CONES[cone],
                "jacobian": JACOBIANS[jacobian],
            },
        )
        for solver, cone, jacobian in combinations
    ]


def time_per_step(
    model: mujoco.MjModel, data: mujoco.MjData, advance: Advance, *, budget: float
) -> float:
    """Return the time per step (s) over up to 100 steps, the least of three repeats.

    Every repeat does the same work: it starts from the same state, warm start included. Slow
    settings take as many steps as fit in a third of `budget` (s).
    """
    start = mujoco.MjData(model)
    mujoco.mj_copyData(start, model, data)
    before = time.perf_counter()
    advance(2)
    estimate = (time.perf_counter() - before) / 2
    steps = int(np.clip(budget / 3 / estimate, 2, 100))
    best = np.inf
    for _ in range(3):
        mujoco.mj_copyData(data, model, start)
        before = time.perf_counter()
        advance(steps)
        best = min(best, (time.perf_counter() - before) / steps)
    return best


def without_contact(model: mujoco.MjModel, data: mujoco.MjData, *, repeats: int = 10) -> float:
    """Time (s) of everything in a MuJoCo step but the constraints: smooth dynamics, collision."""
    flags = model.opt.disableflags
    scratch = mujoco.MjData(model)
    smooth = collision = np.inf
    for _ in range(repeats):
        mujoco.mj_copyData(scratch, model, data)
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        before = time.perf_counter()
        mujoco.mj_step(model, scratch)
        smooth = min(smooth, time.perf_counter() - before)
        model.opt.disableflags = flags
        before = time.perf_counter()
        mujoco.mj_collision(model, scratch)
        collision = min(collision, time.perf_counter() - before)
    return smooth + collision


def time_bin(name: str, *, smoke: bool = False, budget: float = 4.0) -> list[Timing]:
    """Time dashpot and MuJoCo's solvers in one bin; `budget` (s) for each."""
    scene = settled_bin(name)
    model, data, advance = prepare(scene, DASHPOT, TIMESTEP)
    advance(round(scene.duration / TIMESTEP))
    qpos, qvel = data.qpos.copy(), data.qvel.copy()
    timings = []
    for setting in (DASHPOT, *solver_settings(smoke=smoke)):
        model, data, advance = prepare(scene, setting, TIMESTEP)
        data.qpos[:], data.qvel[:] = qpos, qvel
        # Let it settle in its own equilibrium and warm its caches, in at most twice the budget.
        before, steps = time.perf_counter(), 0
        while steps < 250 and time.perf_counter() - before < 2 * budget:
            advance(5)
            steps += 5
        step = time_per_step(model, data, advance, budget=budget)
        rest = without_contact(model, data)
        _, total, deepest, touching = overlaps(model, data, mujoco.MjData(model))
        timings.append(
            Timing(
                name,
                setting.name,
                touching,
                1e3 * step,
                1e3 * (step - rest),
                total / max(1, touching),
                deepest,
                float(np.abs(data.qvel).mean()),
            )
        )
    return timings


def summary(timings: list[Timing]) -> dict[str, float]:
    """Return how many times faster dashpot is than the fastest MuJoCo setting."""
    ours, *theirs = timings
    fastest_step = min(theirs, key=lambda t: t.step)
    fastest_solve = min(theirs, key=lambda t: t.solve)
    return {
        "step ratio": fastest_step.step / ours.step,
        "solve ratio": fastest_solve.solve / ours.solve,
    }


def as_rows(timings: list[Timing]) -> list[dict[str, object]]:
    """Return the timings as plain dictionaries for JSON."""
    return [asdict(t) for t in timings]
