"""Models of what stands on feet."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

BOB_LENGTH = 0.3  # m


def bob_above_foot(timestep: float, integrator: str) -> mujoco.MjModel:
    """Return a bob, the root of the tree, that swings below the hinge of a foot on the floor."""
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="{timestep}" integrator="{integrator}"/><worldbody>
        <geom type="plane" size="0 0 1"/>
        <body pos="0 0 .3"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
          <joint axis="0 1 0"/>
          <inertial pos="0 0 0" mass="1" diaginertia="1e-6 1e-6 1e-6"/>
          <body pos="0 0 {BOB_LENGTH}"><joint axis="0 1 0"/>
            <geom type="box" size=".2 .1 .02" pos="0 0 -.58" mass="5"/></body></body>
      </worldbody></mujoco>""")


@dataclass(frozen=True)
class Quadruped:
    """Masses (kg), a radius and the height (m) of a robot, its servos (N m/rad, N m s/rad)."""

    trunk: float = 6.0
    thigh: float = 0.3
    shank: float = 0.1
    shank_radius: float = 0.015
    height: float = 0.43
    damping: float = 0.1
    kp: float = 60.0
    kv: float = 1.0

    def model(self, timestep: float) -> mujoco.MjModel:
        """Return it above a floor, each leg a hip and a knee that turn about y."""
        legs = servos = ""
        for i, (x, y) in enumerate(((0.2, 0.15), (0.2, -0.15), (-0.2, 0.15), (-0.2, -0.15))):
            legs += f"""<body pos="{x} {y} 0">
              <joint name="h{i}" axis="0 1 0" damping="{self.damping}"/>
              <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass="{self.thigh}"/>
              <body pos="0 0 -.2"><joint name="k{i}" axis="0 1 0" damping="{self.damping}"/>
                <geom type="capsule" fromto="0 0 0 0 0 -.2" size="{self.shank_radius}"
                  mass="{self.shank}"/></body></body>"""
            for joint in (f"h{i}", f"k{i}"):
                servos += f'<position joint="{joint}" kp="{self.kp}" kv="{self.kv}"/>'
        return mujoco.MjModel.from_xml_string(f"""<mujoco>
          <option timestep="{timestep}" integrator="implicitfast"/><worldbody>
            <geom type="plane" size="5 5 .1"/><body pos="0 0 {self.height}"><freejoint/>
              <geom type="box" size=".25 .1 .04" mass="{self.trunk}"/>{legs}</body></worldbody>
          <actuator>{servos}</actuator></mujoco>""")
