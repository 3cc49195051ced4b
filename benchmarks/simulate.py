"""Step a scene with dashpot or with a named MuJoCo setting and record the motion."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np

import dashpot
from scene import Run, Scene

Advance = Callable[[int], None]
DIRECT_IMPEDANCE = 1e-4  # MuJoCo's smallest: its load-dependent part of the contact force
HARD_IMPEDANCE = 0.9999  # MuJoCo's largest
INTEGRATORS = {
    "Euler": mujoco.mjtIntegrator.mjINT_EULER,
    "RK4": mujoco.mjtIntegrator.mjINT_RK4,
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "discrete": mujoco.mjtIntegrator.mjINT_DISCRETE,
}
SOLREFS = ("geom_solref", "pair_solref", "eq_solref", "jnt_solref", "tendon_solref_lim")
SOLIMPS = ("geom_solimp", "pair_solimp", "eq_solimp", "jnt_solimp", "tendon_solimp_lim")
BAD_STATE = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


@dataclass(frozen=True)
class Setting:
    """A way to step: dashpot, or MuJoCo with options set on `model.opt`.

    `timeconst_steps`: contacts, limits and equalities have a time constant of as many time steps;
    0 leaves the model's own, 2 is the smallest that MuJoCo steps stably. `hard`: they have MuJoCo's
    largest impedance at any overlap. `direct`: contacts have the stiffness and damping that the
    scene states, times this; 0 leaves the model's own. `disable` adds to the model's flags of that
    name. `threads` share a step of dashpot's, and the islands of MuJoCo's, which has a pool of
    those beside the calling one.
    """

    name: str
    dashpot: bool = False
    direct: float = 0.0
    timeconst_steps: float = 0.0
    hard: bool = False
    option: Mapping[str, Any] = field(default_factory=dict)
    disable: int = 0
    threads: int = 1

    def on_threads(self, count: int) -> Setting:
        """Return the same setting with steps that `count` threads share."""
        return replace(self, name=f"{self.name} {count} threads", threads=count)

    def accepts(self, scene: Scene) -> bool:
        """Direct stiffness is defined for scenes that say what it is."""
        return not self.direct or scene.direct_solref is not None

    def apply(self, model: mujoco.MjModel) -> None:
        """Set what does not depend on the scene, but for its time step, which is set already."""
        for name, value in self.option.items():
            setattr(model.opt, name, value)
        model.opt.disableflags |= self.disable
        if self.timeconst_steps:
            for name in SOLREFS:
                getattr(model, name)[:] = self.timeconst_steps * model.opt.timestep, 1.0
        if self.hard:
            for name in SOLIMPS:
                getattr(model, name)[:, :2] = HARD_IMPEDANCE


DASHPOT = Setting("dashpot", dashpot=True)
IMPRATIO_100 = {
    "cone": mujoco.mjtCone.mjCONE_ELLIPTIC,
    "impratio": 100.0,
    "integrator": INTEGRATORS["implicitfast"],
}
MUJOCO = (
    Setting("mujoco default"),
    Setting("mujoco elliptic", option={"cone": mujoco.mjtCone.mjCONE_ELLIPTIC}),
    Setting("mujoco elliptic impratio 100", option=IMPRATIO_100),
    Setting("mujoco stiff", timeconst_steps=2.0, option=IMPRATIO_100),
    Setting(
        "mujoco elliptic noslip",
        option={"cone": mujoco.mjtCone.mjCONE_ELLIPTIC, "noslip_iterations": 20},
    ),
    Setting("mujoco direct", direct=1.0),
)
AS_SHIPPED = MUJOCO[0]
SETTINGS = {s.name: s for s in (DASHPOT, *MUJOCO)}


def prepare(
    scene: Scene, setting: Setting, timestep: float
) -> tuple[mujoco.MjModel, mujoco.MjData, Advance]:
    """Return model, data in the initial state, and a function that advances by n steps."""
    model = scene.model(timestep)
    setting.apply(model)
    if setting.direct:
        model.geom_solref[:] = setting.direct * np.asarray(scene.direct_solref)
        model.geom_solimp[:] = [DIRECT_IMPEDANCE, DIRECT_IMPEDANCE, 0.001, 0.5, 2]
    if setting.dashpot:
        engine = make_engine(scene, model, nthread=setting.threads)
        data = engine.make_data()
        model = engine.model

        def advance(steps: int) -> None:
            engine.step(data, nstep=steps)
    else:
        data = mujoco.MjData(model)
        if setting.threads > 1:
            mujoco.mju_threadpool(data, setting.threads - 1)

        def advance(steps: int) -> None:
            mujoco.mj_step(model, data, steps)

    if scene.start is not None:
        scene.start(model, data)
    return model, data, advance


def make_engine(scene: Scene, model: mujoco.MjModel, **options: Any) -> dashpot.Engine:
    """Return an engine with the scene's materials."""
    engine = dashpot.Engine(model, **options)
    engine.set_materials(scene.materials)
    for (first, second), material in scene.pair_materials.items():
        engine.set_pair_material(first, second, material)
    return engine


def record(scene: Scene, setting: Setting = DASHPOT, timestep: float = 0.002) -> Run:
    """Step a scene from start to end and record it."""
    model, data, advance = prepare(scene, setting, timestep)
    scratch = mujoco.MjData(model)
    total = round(scene.duration / timestep)
    stride = 1 if scene.sample_interval is None else max(1, round(scene.sample_interval / timestep))
    kick = round(scene.kick_time / timestep) if scene.kick is not None else -1
    rows: list[tuple[float, np.ndarray, np.ndarray, tuple[float, float, float, int]]] = []
    done, spent = 0, 0.0

    def timed(steps: int) -> None:
        nonlocal spent
        before = time.process_time()
        advance(steps)
        spent += time.process_time() - before

    while True:
        if done == kick and scene.kick is not None:
            scene.kick(model, data)
        overlap = overlaps(model, data, scratch) if scene.penetration else (0.0, 0.0, 0.0, 0)
        rows.append((done * timestep, data.qpos.copy(), data.qvel.copy(), overlap))
        if done >= total:
            break
        steps = min(stride, total - done)
        if done < kick:
            steps = min(steps, kick - done)
        if scene.drive is None:
            timed(steps)
        else:
            for _ in range(steps):
                scene.drive(model, data)
                timed(1)
        done += steps
    times, qpos, qvel, overlap_rows = zip(*rows, strict=True)
    penetration = np.array(overlap_rows)
    return Run(
        model,
        np.array(times),
        np.array(qpos),
        np.array(qvel),
        penetration[:, :3] if scene.penetration else np.empty((0, 3)),
        penetration[:, 3] if scene.penetration else np.empty(0),
        diverged=any(data.warning[kind].number for kind in BAD_STATE),
        cpu=spent,
    )


def overlaps(
    model: mujoco.MjModel, data: mujoco.MjData, scratch: mujoco.MjData
) -> tuple[float, float, float, int]:
    """Geometric overlap at the present state: sum of squares, sum, largest (m), how many."""
    scratch.qpos[:] = data.qpos
    mujoco.mj_kinematics(model, scratch)
    mujoco.mj_comPos(model, scratch)
    mujoco.mj_collision(model, scratch)
    depth = -np.minimum(scratch.contact.dist, 0.0)
    if not depth.size:
        return 0.0, 0.0, 0.0, 0
    return float(depth @ depth), float(depth.sum()), float(depth.max()), int((depth > 0).sum())


def measure(scene: Scene, setting: Setting = DASHPOT, timestep: float = 0.002) -> dict[str, float]:
    """Return the scene's named numbers for one setting and time step (s)."""
    return scene.measure(record(scene, setting, timestep))
