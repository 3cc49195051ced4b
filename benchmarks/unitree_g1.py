"""A Unitree G1 under dashpot.warp beside the engine, from the file that mjlab ships.

    pip install --no-deps mjlab
    python benchmarks/unitree_g1.py

It stands on a floor, on servos with the gains of mjlab: a natural frequency of 10 Hz with the
rotors' inertia, twice critically damped. Their targets jump every 20 steps within a share of the
joints' ranges about the pose of the start.

Over the first 0.1 s it prints the largest difference of a coordinate (m, rad) to the engine with 16
steps in one, and to the engine itself. Beside them is what a start in single precision changes of
the engine's motion. Over 1,000 steps it prints how much more energy there is than servos and
dampers explain, as a share of the range of the energy.
"""

from __future__ import annotations

import argparse
import re

import mujoco
import numpy as np
import warp as wp

import dashpot
import dashpot.warp as dw
from grasps import package_file
from scene import Array

FILE = ("mjlab", "asset_zoo/robots/unitree_g1/xmls/g1.xml")
# Joints by the end of their names: inertia of the rotor (kg m^2), largest torque (N m).
MOTORS = {
    "hip_pitch|hip_yaw|waist_yaw": (0.010178, 88.0),
    "hip_roll|knee": (0.025102, 139.0),
    "waist_(pitch|roll)|ankle_.*": (0.007219, 50.0),
    "elbow|shoulder_.*|wrist_roll": (0.003610, 25.0),
    "wrist_(pitch|yaw)": (0.004250, 5.0),
}
FREQUENCY, RATIO = 2.0 * np.pi * 10.0, 2.0  # rad/s, of servos; their damping ratio
HEIGHT = 0.783675  # m, of the pelvis
HOME = {
    "hip_pitch": -0.1,
    "knee": 0.3,
    "ankle_pitch": -0.2,
    "shoulder_pitch": 0.2,
    "elbow": 1.28,
    "left_shoulder_roll": 0.2,
    "right_shoulder_roll": -0.2,
}
FOOT = re.compile(r".*_foot\d_collision")
HELD = 20  # steps that targets are held


def g1(timestep: float = 0.002) -> tuple[mujoco.MjModel, Array]:
    """Return the model on a floor, with servos, and the positions of its start."""
    spec = mujoco.MjSpec.from_file(package_file(*FILE))
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5.0, 5.0, 0.1])
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for geom in spec.geoms:
        is_foot = FOOT.fullmatch(geom.name) is not None
        geom.condim = 3 if is_foot or geom.type == mujoco.mjtGeom.mjGEOM_PLANE else 1
        if is_foot:
            geom.priority, geom.friction[0] = 1, 0.6
    for joint in spec.joints:
        for names, (inertia, torque) in MOTORS.items():
            if re.fullmatch(f"(left_|right_)?({names})_joint", joint.name):
                joint.armature = inertia
                stiffness, damping = inertia * FREQUENCY**2, 2.0 * RATIO * inertia * FREQUENCY
                servo = spec.add_actuator(
                    name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
                )
                servo.set_to_position(kp=stiffness, kv=damping)
                servo.forcelimited, servo.forcerange = True, [-torque, torque]
    model = spec.compile()
    start = model.qpos0.copy()
    start[2] = HEIGHT
    for i in range(model.njnt):
        for name, angle in HOME.items():
            if model.joint(i).name.endswith(f"{name}_joint"):
                start[model.jnt_qposadr[i]] = angle
    data = mujoco.MjData(model)
    data.qpos[:] = start
    mujoco.mj_forward(model, data)
    start[2] -= data.contact.dist.min()  # mjlab's height has the soles 0.5 mm in the floor
    return model, start


def targets(model: mujoco.MjModel, start: Array, share: float, steps: int) -> Array:
    """Return (steps, nu) targets that jump by a share of their joints' ranges."""
    joints = model.actuator_trnid[:, 0]
    low, high = model.jnt_range[joints].T
    rest = start[model.jnt_qposadr[joints]]
    rng = np.random.default_rng(0)
    jumps = rng.uniform(-share, share, (-(-steps // HELD), model.nu)) * (high - low)
    return np.clip(rest + jumps, low, high).repeat(HELD, axis=0)[:steps].astype(np.float32)


def first_differences(share: float, timestep: float) -> list[tuple[str, float]]:
    """Return the largest differences over 0.1 s, by name."""
    model, start = g1(timestep)
    engines = {name: dashpot.Engine(model) for name in ("engine", "single", "converged")}
    engines["converged"].model.opt.timestep /= 16
    states = {name: engine.make_data() for name, engine in engines.items()}
    for data in states.values():
        data.qpos[:] = start
    states["single"].qpos[:] += 6e-8 * np.random.default_rng(1).normal(size=model.nq)
    d, graph = worlds(model, start)
    worst: dict[str, float] = {}
    steps = round(0.1 / timestep)
    for target in targets(model, start, share, steps):
        d.ctrl.assign(target[None])
        wp.capture_launch(graph)
        for name, data in states.items():
            data.ctrl[:] = target
            engines[name].step(data, 16 if name == "converged" else 1)
        motions = {name: data.qpos for name, data in states.items()}
        motions["warp"] = d.qpos.numpy()[0]
        for first, second in (
            ("warp", "converged"),
            ("engine", "converged"),
            ("warp", "engine"),
            ("single", "engine"),
        ):
            key = f"{first} to {second}"
            gap = float(np.abs(motions[first] - motions[second]).max())
            worst[key] = max(worst.get(key, 0.0), gap)
    return list(worst.items())


def worlds(model: mujoco.MjModel, start: Array) -> tuple[dw.Data, wp.Graph]:
    """Return data of one world, and a step of it as a graph."""
    data = mujoco.MjData(model)
    data.qpos[:] = start
    m = dw.put_model(model)
    d = dw.put_data(model, data, nconmax=96)
    with wp.ScopedCapture() as capture:
        dw.step(m, d)
    return d, capture.graph


def gained(share: float, timestep: float, steps: int = 1000) -> tuple[float, float, bool]:
    """Energy beyond what was given, of its range; least height of the pelvis; whether all fit."""
    model, start = g1(timestep)
    d, graph = worlds(model, start)
    data = mujoco.MjData(model)

    def energy() -> float:
        data.qpos[:] = d.qpos.numpy()[0]
        data.qvel[:] = d.qvel.numpy()[0]
        mujoco.mj_forward(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        return float(data.energy.sum())

    before, way = start.copy(), np.zeros(model.nv)
    work, held, given, height = 0.0, [energy()], [0.0], np.inf
    for i, target in enumerate(targets(model, start, share, steps)):
        d.ctrl.assign(target[None])
        wp.capture_launch(graph)
        after = d.qpos.numpy()[0].astype(float)
        mujoco.mj_differentiatePos(model, way, 1.0, before, after)
        work += float(way @ d.qfrc_actuator.numpy()[0])
        before, height = after, min(height, after[2])
        if i % 50 == 49:
            held.append(energy())
            given.append(work)
    more = (np.array(held) - held[0]) - np.array(given)
    fits = not d.dashpot.overflow.numpy().any()
    return float(np.max(np.diff(more))) / float(np.ptp(held)), height, fits


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shares", nargs="+", type=float, default=[0.0, 0.05, 0.2])
    parser.add_argument("--timesteps", nargs="+", type=float, default=[0.002])
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    wp.set_device("cpu")
    for timestep in arguments.timesteps:
        for share in arguments.shares:
            found = first_differences(share, timestep)
            text = ", ".join(f"{name} {gap:.2g}" for name, gap in found)
            print(f"targets jump by {share:g}, {1e3 * timestep:g} ms: {text}", flush=True)
            more, height, fits = gained(share, timestep)
            print(
                f"    1,000 steps: energy beyond what was given {more:.2g} of its range, "
                f"pelvis down to {height:.3f} m" + ("" if fits else ", contacts left out"),
                flush=True,
            )


if __name__ == "__main__":
    main()
