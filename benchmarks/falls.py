"""Robots thrown on the floor without control, at time steps from 1 to 10 ms.

    python benchmarks/falls.py    # needs gymnasium-robotics, robosuite and mujoco-warp

Every robot of robosuite, let go of its base, a humanoid and an ant fall from random attitudes,
turning at 2 rad/s about each axis or so, and lie for the rest of 1.5 s. Where light links (wrists,
hands, feet) meet the floor they are thrown to 100 rad/s and more. Counted are the falls that end in
a diverged state, under dashpot and under mj_step; times are processor times of falls that end well
in both, the median of their ratios at each time step.
"""

from __future__ import annotations

import mujoco
import numpy as np

import dashpot
from grasps import package_file
from no_arguments import takes_no_arguments
from scene import Scene
from simulate import AS_SHIPPED, DASHPOT, Setting, record

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


def let_go(path: str) -> mujoco.MjModel:
    """Return a robot's model with a free base above a floor."""
    spec = mujoco.MjSpec.from_file(path)
    if not any(geom.type == mujoco.mjtGeom.mjGEOM_PLANE for geom in spec.worldbody.geoms):
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20, 20, 0.1])
    if not any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in spec.joints):
        spec.worldbody.bodies[0].add_freejoint()
    return spec.compile()


def falling(name: str, model: mujoco.MjModel, seed: int) -> Scene:
    """Throw everything free above the floor, in a random attitude and turning."""

    def throw(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        rng = np.random.default_rng(seed)
        free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        for k, joint in enumerate(free):
            place, dof = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
            attitude = rng.normal(size=4)
            data.qpos[place + 2] = HEIGHT + k
            data.qpos[place + 3 : place + 7] = attitude / np.linalg.norm(attitude)
            data.qvel[dof + 3 : dof + 6] = 2.0 * rng.normal(size=3)

    return Scene(
        name=name,
        title=f"{name} thrown on the floor",
        compiled=model,
        duration=DURATION,
        start=throw,
        measure=lambda run: {"diverged": float(run.diverged)},
        sample_interval=DURATION,
        timesteps=TIMESTEPS,
    )


def robots() -> dict[str, mujoco.MjModel]:
    """Return the models of all robots, let go of their bases."""
    return {name: let_go(package_file(*file)) for name, file in FILES.items()}


def fall(scene: Scene, setting: Setting, timestep: float) -> tuple[bool, float]:
    """Return whether a fall diverged, and the processor time (s) of its steps."""
    try:
        run = record(scene, setting, timestep)
    except (dashpot.DivergenceError, mujoco.FatalError):
        return True, np.nan
    return run.diverged, run.cpu


def main() -> None:
    """Print one row per robot."""
    takes_no_arguments(__doc__)
    mujoco.set_mju_user_warning(lambda message: None)
    head = ", ".join(f"{1e3 * dt:g}" for dt in TIMESTEPS)
    print(
        f"| robot | diverged of {len(SEEDS)}, dt {head} ms: dashpot | `mj_step` | "
        "times as long a step |"
    )
    print("|---|---|---|---|")
    for name, model in robots().items():
        counts: list[list[str]] = [[], []]
        ratios = []
        for timestep in TIMESTEPS:
            falls = [
                [fall(falling(name, model, seed), s, timestep) for s in (DASHPOT, AS_SHIPPED)]
                for seed in SEEDS
            ]
            for count, ends in zip(counts, zip(*falls, strict=True), strict=True):
                count.append(str(sum(diverged for diverged, _ in ends)))
            both = [ours[1] / own[1] for ours, own in falls if not (ours[0] or own[0])]
            ratios.append(f"{np.median(both):.1f}" if both else "-")
        cells = " | ".join(", ".join(count) for count in (*counts, ratios))
        print(f"| {name} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
