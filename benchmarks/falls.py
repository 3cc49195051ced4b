"""Robots thrown on the floor without control, at time steps from 1 to 10 ms.

    python benchmarks/falls.py    # needs gymnasium-robotics, robosuite and mujoco-warp

Every robot of robosuite, let go of its base, a humanoid and an ant fall from random attitudes,
turning at 2 rad/s about each axis or so, and lie for the rest of 1.5 s. Where light links (wrists,
hands, feet) meet the floor they are thrown to 100 rad/s and more. Counted are the falls that end in
a diverged state, under dashpot and under mj_step; times are those of falls that end well in both,
their median.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

import dashpot
from grasps import package_file
from no_arguments import takes_no_arguments

# Those that compile without what robosuite adds to them.
ROBOSUITE = "baxter gr1 iiwa jaco kinova3 panda sawyer spot tiago ur5e xarm7"
FILES = {
    **{name: ("robosuite", f"models/assets/robots/{name}/robot.xml") for name in ROBOSUITE.split()},
    "humanoid": ("mujoco_warp", "test_data/humanoid/humanoid.xml"),
    "Ant": ("gymnasium_robotics", "envs/mujoco/assets/ant.xml"),
}
TIMESTEPS = (0.001, 0.002, 0.005, 0.01)
SEEDS = range(8)
DURATION = 1.5
HEIGHT = 1.5
BAD_STATE = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


@dataclass
class Fall:
    """How one fall ended."""

    diverged: bool = False
    seconds: float = 0.0


def let_go(path: str) -> mujoco.MjModel:
    """Return a robot's model with a free base above a floor."""
    spec = mujoco.MjSpec.from_file(path)
    if not any(geom.type == mujoco.mjtGeom.mjGEOM_PLANE for geom in spec.worldbody.geoms):
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20, 20, 0.1])
    if not any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in spec.joints):
        spec.worldbody.bodies[0].add_freejoint()
    return spec.compile()


def throw(model: mujoco.MjModel, data: mujoco.MjData, seed: int) -> None:
    """Lift everything free above the floor, in a random attitude and turning."""
    rng = np.random.default_rng(seed)
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    for k, joint in enumerate(free):
        place, dof = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
        attitude = rng.normal(size=4)
        data.qpos[place + 2] = HEIGHT + k
        data.qpos[place + 3 : place + 7] = attitude / np.linalg.norm(attitude)
        data.qvel[dof + 3 : dof + 6] = 2.0 * rng.normal(size=3)


def fall(model: mujoco.MjModel, data: mujoco.MjData, step: Callable[[], object], seed: int) -> Fall:
    """Let a robot fall."""
    throw(model, data, seed)
    result = Fall()
    began = time.perf_counter()
    for _ in range(round(DURATION / model.opt.timestep)):
        try:
            step()
        except RuntimeError:
            result.diverged = True
            return result
        if any(data.warning[kind].number for kind in BAD_STATE):
            result.diverged = True
            return result
    result.seconds = time.perf_counter() - began
    return result


def main() -> None:
    """Print one row per robot."""
    takes_no_arguments(__doc__)
    mujoco.set_mju_user_warning(lambda message: None)
    head = ", ".join(f"{1e3 * dt:g}" for dt in TIMESTEPS)
    print(
        f"| robot | diverged of {len(SEEDS)}, dt {head} ms: dashpot | `mj_step` | times as long |"
    )
    print("|---|---|---|---|")
    for name, (package, path) in FILES.items():
        model = let_go(str(Path(package_file(package, path))))
        ours, theirs, ratios = [], [], []
        for timestep in TIMESTEPS:
            model.opt.timestep = timestep
            engine = dashpot.Engine(model)
            falls = []
            for seed in SEEDS:
                data, plain = engine.make_data(), mujoco.MjData(model)
                falls.append(
                    (
                        fall(engine.model, data, lambda d=data, e=engine: e.step(d), seed),
                        fall(model, plain, lambda m=model, p=plain: mujoco.mj_step(m, p), seed),
                    )
                )
            ours.append(sum(a.diverged for a, _ in falls))
            theirs.append(sum(b.diverged for _, b in falls))
            ratios += [a.seconds / b.seconds for a, b in falls if not (a.diverged or b.diverged)]
        print(
            f"| {name} | {ours} | {theirs} | {np.median(ratios):.2f} |".replace("[", "").replace(
                "]", ""
            )
        )


if __name__ == "__main__":
    main()
