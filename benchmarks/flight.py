"""Trees of joints in flight, where rows are possible: errors of positions, energy, momentum.

A double pendulum, a serial arm with a ball joint and a box with two limbs start with random
velocities, limp, on springs, with armature, dampers, servos or gravity compensation. Positions
after 0.4 s are compared with those of MuJoCo's RK4 in steps of 0.2 ms, whose error is some 1e-10 of
the motion. The floor, 90 m below, makes rows possible: without, MuJoCo integrates.
"""

from __future__ import annotations

from functools import cache

import mujoco
import numpy as np

import dashpot
from ends_of_steps import finish_velocity
from scene import Array, Run, Scene

FLOOR = '<geom type="plane" size="5 5 1" pos="0 0 -90" contype="1"/>'
ROD = '<geom type="capsule" fromto="0 0 0 {} 0 0" size=".02"/>'
FIXED = f"""<body><joint name="a" axis="0 1 0" {{joint}}/>{ROD.format(0.4)}
  <body pos=".4 0 0" {{body}}><joint name="b" axis="0 1 0" {{joint}}/>{ROD.format(0.3)}
  </body></body>"""
SERIAL = f"""<body><joint name="a" axis="0 0 1" {{joint}}/>{ROD.format(0.3)}
  <body pos=".3 0 0" {{body}}><joint name="b" axis="0 1 0" {{joint}}/>{ROD.format(0.3)}
  <body pos=".3 0 0"><joint type="ball"/>{ROD.format(0.2)}</body></body></body>"""
FLOATING = f"""<body><freejoint/><geom type="box" size=".1 .07 .05"/>
  <body pos=".15 0 0" {{body}}><joint name="a" axis="0 1 0" {{joint}}/>{ROD.format(0.3)}</body>
  <body pos="-.15 0 0"><joint name="b" axis="0 0 1" {{joint}}/>{ROD.format(-0.3)}</body></body>"""
TREES = {"fixed": FIXED, "serial": SERIAL, "floating": FLOATING}
SERVOS = """<actuator><position joint="a" kp="20" kv=".5"/><position joint="b" kp="10" kv=".2"/>
  </actuator>"""
DRIVEN = {
    "limp": ("", "", ""),
    "springs": ('stiffness="2"', "", ""),
    "armature": ('armature=".02"', "", ""),
    "dampers": ('damping=".1"', "", ""),
    "servos": ('armature=".01"', "", SERVOS),
    "weightless": ("", 'gravcomp="1"', ""),
}
TIMESTEPS = (0.001, 0.002, 0.005)
DURATION, REFERENCE_STEP = 0.4, 2e-4  # s


def flying(tree: str, drive: str) -> str:
    """Return the MJCF of a tree and what drives it."""
    joint, body, rest = DRIVEN[drive]
    return f"""<mujoco><default><geom contype="0"/></default><worldbody>
      {FLOOR}{TREES[tree].format(joint=joint, body=body)}</worldbody>{rest}</mujoco>"""


def throw(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Give every degree of freedom a random velocity."""
    data.qvel[:] = np.random.default_rng(3).normal(size=model.nv)


@cache
def exact_end(tree: str, drive: str) -> Array:
    """Return the positions (nq,) at the end of a flight."""
    model = mujoco.MjModel.from_xml_string(flying(tree, drive))
    model.opt.timestep = REFERENCE_STEP
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    throw(model, data)
    mujoco.mj_step(model, data, round(DURATION / REFERENCE_STEP))
    return data.qpos.copy()


def flight(tree: str, drive: str) -> Scene:
    """Let a tree fly; largest error of its positions at the end, m or rad."""

    def measure(run: Run) -> dict[str, float]:
        change = np.zeros(run.model.nv)
        mujoco.mj_differentiatePos(run.model, change, 1.0, exact_end(tree, drive), run.qpos[-1])
        return {"position error": float(np.abs(change).max())}

    return Scene(
        name=f"flight-{tree}-{drive}",
        title=f"{tree} tree in flight, {drive}, error after {DURATION:g} s",
        xml=flying(tree, drive),
        duration=DURATION,
        start=throw,
        measure=measure,
        targets={"position error": 1e-3},
        units={"position error": "m or rad"},
        sample_interval=DURATION,
        timesteps=TIMESTEPS,
    )


def flights() -> list[Scene]:
    """Return every tree with everything that drives it."""
    return [flight(tree, drive) for tree in TREES for drive in DRIVEN]


def conserved(tree: str, timestep: float) -> dict[str, float]:
    """Return the largest drifts of what a limp tree keeps.

    `energy drift`, in parts of the largest kinetic energy, over 1 s, before the motion of what
    hangs on a base is chaotic. A floating tree flies for 5 s without weight, and has a `momentum
    drift`, linear and angular, in parts of the largest component.
    """
    model = mujoco.MjModel.from_xml_string(flying(tree, "limp"))
    model.opt.timestep = timestep
    floating = tree == "floating"
    if floating:
        model.opt.gravity[:] = 0.0
    engine = dashpot.Engine(model)
    data, probe = engine.make_data(), mujoco.MjData(model)
    throw(model, data)

    def kept() -> tuple[float, float, Array]:
        finish_velocity(model, data, probe)
        mujoco.mj_subtreeVel(model, probe)
        mujoco.mj_energyPos(model, probe)
        mujoco.mj_energyVel(model, probe)
        linear = probe.subtree_linvel[1] * model.body_subtreemass[1]
        momentum = np.concatenate([linear, probe.subtree_angmom[1]])
        return probe.energy.sum(), probe.energy[1], momentum

    engine.step(data)
    samples = [kept()]
    for _ in range(round((5.0 if floating else 1.0) / timestep) // 10):
        engine.step(data, nstep=10)
        samples.append(kept())
    energy, kinetic, momentum = (np.array(values) for values in zip(*samples, strict=True))
    drifts = {"energy drift": float(np.abs(energy - energy[0]).max() / kinetic.max())}
    if floating:
        drift = np.abs(momentum - momentum[0]).max() / np.abs(momentum[0]).max()
        drifts["momentum drift"] = float(drift)
    return drifts
