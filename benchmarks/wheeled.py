"""Wheeled robots: a differential drive on a caster, and one that steers by skidding."""

from __future__ import annotations

import mujoco

RADIUS, HALF_WIDTH = 0.1, 0.025  # of a wheel, m
TRACK = 0.2  # m, from the middle of the robot to a wheel
WHEELBASE = 0.18  # m, from the middle of the skid steer to an axle
SIDES = {"left": 1, "right": -1}


def wheel(name: str, along: float, side: int) -> str:
    """Return the MJCF of a wheel on an axle along y."""
    return f"""<body name="{name}" pos="{along} {side * TRACK} 0">
      <joint name="{name}" axis="0 1 0" damping=".02" armature=".002"/>
      <geom type="cylinder" euler="90 0 0" size="{RADIUS} {HALF_WIDTH}" mass=".8" friction="1"/>
    </body>"""


def robot(wheels: dict[str, str], rest: str) -> mujoco.MjModel:
    """Return a body of 10 kg on a floor, with wheels turned by velocity servos."""
    servos = "".join(f'<velocity joint="{name}" kv="4"/>' for name in wheels)
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep=".002" integrator="implicitfast"/><worldbody>
        <geom type="plane" size="0 0 1" friction="1"/>
        <body name="robot" pos="0 0 {RADIUS}"><freejoint/>
          <geom type="box" size=".2 .15 .05" mass="10"/>{"".join(wheels.values())}{rest}
        </body></worldbody><actuator>{servos}</actuator></mujoco>""")


def differential_drive() -> mujoco.MjModel:
    """Return a robot on two wheels and a caster, a ball that slides almost without friction.

    Controls are the speeds (rad/s) of the left and of the right wheel.
    """
    radius = 0.04
    caster = f"""<geom type="sphere" size="{radius}" pos="-.17 0 {radius - RADIUS}" mass=".2"
      friction=".01" priority="1"/>"""
    return robot({name: wheel(name, 0.08, side) for name, side in SIDES.items()}, caster)


def skid_steer() -> mujoco.MjModel:
    """Return a robot on four wheels that do not steer: it turns by slipping.

    Controls are the speeds (rad/s) of the wheels, left ones first.
    """
    wheels = {
        f"{name} {end}": wheel(f"{name} {end}", along, side)
        for name, side in SIDES.items()
        for end, along in (("front", WHEELBASE), ("rear", -WHEELBASE))
    }
    return robot(wheels, "")
