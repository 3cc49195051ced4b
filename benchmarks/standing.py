"""Swing of what stands and of what is held, on springs and on servos, beside MuJoCo.

    python benchmarks/standing.py

A body of 5 kg swings by 4 mm on a leg of 5 kN/m that stands on the floor, a spring or an undamped
position servo, and a mass on such a servo, which an equality couples to a light one, by 10 mm.
Nothing takes energy from either, and nothing may put any in: printed is how far they swing in the
last 0.4 s of 5 s. Rigid contact; MuJoCo with its defaults and elliptic cones.
"""

from __future__ import annotations

import mujoco
import numpy as np

import dashpot
from no_arguments import takes_no_arguments

STIFFNESS, MASS = 5000.0, 5.0
TIMESTEPS = (0.001, 0.002, 0.005)
DURATION, WINDOW = 5.0, 0.4
SWING_OF_LEG, SWING_OF_MASS = 0.004, 0.01
SPRING = f'stiffness="{STIFFNESS}"'
SERVO = f'<actuator><position joint="swings" kp="{STIFFNESS}"/></actuator>'
GHOST = 'contype="0" conaffinity="0"'


def leg(*, servo: bool) -> str:
    """Return the MJCF of a body on a leg that stands on the floor."""
    spring = "" if servo else SPRING
    return f"""<worldbody><geom type="plane" size="5 5 .1"/>
      <body pos="0 0 1"><joint type="slide" axis="0 0 1"/>
        <geom type="box" size=".1 .1 .05" mass="{MASS}" {GHOST}/>
        <body pos="0 0 -.5"><joint name="swings" type="slide" axis="0 0 1" {spring}/>
          <geom size=".03" mass=".2" pos="0 0 .03"/></body></body></worldbody>
      {SERVO if servo else ""}"""


def coupled() -> str:
    """Return the MJCF of a mass on a servo, coupled to a light one."""
    return f"""<worldbody>
      <body><joint name="swings" type="slide" axis="1 0 0"/>
        <geom size=".1" mass="{MASS}" {GHOST}/></body>
      <body pos="0 1 0"><joint name="light" type="slide" axis="1 0 0"/>
        <geom size=".02" mass=".05" {GHOST}/></body></worldbody>
      <equality><joint joint1="light" joint2="swings"/></equality>{SERVO}"""


def last_swing(
    mjcf: str, start: tuple[float, float], timestep: float, integrator: str, *, peer: bool
) -> float:
    """Return half the way (m) that the first joint goes to and fro at the end."""
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{timestep}" integrator="{integrator}" cone="elliptic"/>'
        f"{mjcf}</mujoco>"
    )
    engine = None if peer else dashpot.Engine(model)
    data = mujoco.MjData(model) if engine is None else engine.make_data()
    data.qpos[:] = start
    positions = []
    for _ in range(round(DURATION / timestep)):
        if engine is None:
            mujoco.mj_step(model, data)
        else:
            engine.step(data)
        positions.append(float(data.qpos[0]))
    return 0.5 * float(np.ptp(positions[-round(WINDOW / timestep) :]))


def main() -> None:
    takes_no_arguments(__doc__)
    sag = MASS * 9.81 / STIFFNESS
    standing = (-0.5 - sag - SWING_OF_LEG, sag + SWING_OF_LEG)
    scenes = {
        "leg on a spring": (leg(servo=False), standing, SWING_OF_LEG),
        "leg on a servo": (leg(servo=True), standing, SWING_OF_LEG),
        "servo in an equality": (coupled(), (SWING_OF_MASS, SWING_OF_MASS), SWING_OF_MASS),
    }
    for name, (mjcf, start, swing) in scenes.items():
        for integrator in ("Euler", "RK4"):
            for timestep in TIMESTEPS:
                ours, theirs = (
                    1e3 * last_swing(mjcf, start, timestep, integrator, peer=peer)
                    for peer in (False, True)
                )
                print(
                    f"{name}, {integrator}, {1e3 * timestep:g} ms: swings by {ours:.2f} of "
                    f"{1e3 * swing:g} mm after {DURATION:g} s; MuJoCo {theirs:.2f}"
                )


if __name__ == "__main__":
    main()
