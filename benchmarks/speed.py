"""Time per step in settled bins, dashpot beside every MuJoCo solver, in one run.

Every way of stepping starts from the same state (settled by dashpot), runs until it has settled
in its own equilibrium, and is then timed over the same 100 steps, all ways in turn for several
rounds, so that a busy machine slows all alike; the least time counts.

On one thread "solve" is the step without what is no contact solve: a MuJoCo step of the same state
with constraints disabled, and one collision pass. Two threads share collision too, so that there is
no such rest to subtract: only whole steps are compared, with the fastest of MuJoCo's on one thread
or on two. MuJoCo's two solve one island each, which pays where a bin falls into islands of like
size. They are tried with the solvers that are fastest on one thread: a solve that two share takes
half its time at best, too long with the others.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from itertools import product

import mujoco
import numpy as np

from piles import settled_bin
from scene import Scene
from simulate import DASHPOT, Setting, overlaps, prepare

TIMESTEP = 0.002
ROUNDS = 5
THREADS = 2
STATE = mujoco.mjtState.mjSTATE_INTEGRATION
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
    """Time per step of one setting in one bin; times in ms, overlaps in m, speed in m/s.

    There is a solve on one thread only.
    """

    scene: str
    setting: str
    threads: int
    contacts: int
    step: float
    solve: float | None
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


def gains_from_threads(setting: Setting) -> bool:
    """Whether MuJoCo might be fastest with the setting on two threads: it is nearly so on one."""
    sparse = setting.option["jacobian"] == JACOBIANS["sparse"]
    return sparse and setting.option["solver"] != SOLVERS["PGS"]


class Way:
    """One way of stepping a scene from a state, and its least time per step so far (s)."""

    def __init__(self, scene: Scene, setting: Setting, state: mujoco.MjData, budget: float) -> None:
        self.setting = setting
        self.model, self.data, self.advance = prepare(scene, setting, TIMESTEP)
        self.data.qpos[:], self.data.qvel[:] = state.qpos, state.qvel
        # Let it settle in its own equilibrium and warm its caches, in at most twice the budget.
        before, steps = time.perf_counter(), 0
        while steps < 250 and time.perf_counter() - before < 2 * budget:
            self.advance(5)
            steps += 5
        self.start = np.empty(mujoco.mj_stateSize(self.model, STATE))
        mujoco.mj_getState(self.model, self.data, self.start, STATE)
        self.step = np.inf

    def measure(self, budget: float) -> None:
        """Time up to 100 steps as often as fits in `budget` (s), at least once.

        Every repeat does the same work: it starts from the same state, warm start included. Slow
        ways take as many steps as fit.
        """
        self.restart()
        before = time.perf_counter()
        self.advance(2)
        estimate = (time.perf_counter() - before) / 2
        steps = int(np.clip(budget / estimate, 2, 100))
        for _ in range(int(np.clip(budget / (steps * estimate), 1, 10))):
            self.restart()
            before = time.perf_counter()
            self.advance(steps)
            self.step = min(self.step, (time.perf_counter() - before) / steps)

    def restart(self) -> None:
        """Go back to the state from which steps are timed; `mj_copyData` would lose the threads."""
        mujoco.mj_setState(self.model, self.data, self.start, STATE)

    def timing(self, scene: str) -> Timing:
        """Return the timing so far."""
        alone = self.setting.threads == 1
        rest = without_contact(self.model, self.data) if alone else None
        _, total, deepest, touching = overlaps(self.model, self.data, mujoco.MjData(self.model))
        return Timing(
            scene,
            self.setting.name,
            self.setting.threads,
            touching,
            1e3 * self.step,
            None if rest is None else 1e3 * (self.step - rest),
            total / max(1, touching),
            deepest,
            float(np.abs(self.data.qvel).mean()),
        )


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
    return time_scene(settled_bin(name), solver_settings(smoke=smoke), budget=budget)


def time_scene(scene: Scene, settings: list[Setting], *, budget: float) -> list[Timing]:
    """Settle a scene, then time dashpot and `settings` from there; `budget` (s) for each.

    dashpot, and what might be fastest of the settings, on two threads too.
    """
    _, state, advance = prepare(scene, DASHPOT, TIMESTEP)
    advance(round(scene.duration / TIMESTEP))
    shared = [s.on_threads(THREADS) for s in settings if gains_from_threads(s)]
    chosen = (DASHPOT, DASHPOT.on_threads(THREADS), *settings, *shared)
    ways = [Way(scene, setting, state, budget) for setting in chosen]
    for _ in range(ROUNDS):
        for way in ways:
            way.measure(budget / ROUNDS)
    return [way.timing(scene.name) for way in ways]


def summary(timings: list[Timing]) -> dict[str, float]:
    """Return how many times faster dashpot is than the fastest MuJoCo setting.

    On one thread both; a shared step is on two, where MuJoCo may take one.
    """
    ours, shared, *theirs = timings
    alone = [t for t in theirs if t.threads == 1]
    return {
        "step ratio": min(t.step for t in alone) / ours.step,
        "solve ratio": min(t.solve for t in alone) / ours.solve,
        "shared step ratio": min(t.step for t in theirs) / shared.step,
    }


def as_rows(timings: list[Timing]) -> list[dict[str, object]]:
    """Return the timings as plain dictionaries for JSON."""
    return [asdict(t) for t in timings]
