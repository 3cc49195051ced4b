"""Swing of what stands and of what is held, on springs and on servos, beside MuJoCo.

    python benchmarks/standing.py

A body of 5 kg swings by 4 mm on a leg of 5 kN/m that stands on the floor, a spring or an undamped
position servo, and a mass on such a servo, which an equality couples to a light one, by 10 mm.
Nothing takes energy from either, and nothing may put any in: printed is by how much less they swing
in the last 0.4 s of 5 s. Rigid contact; MuJoCo with its defaults and elliptic cones.
"""

from __future__ import annotations

import mujoco
import numpy as np

from no_arguments import takes_no_arguments
from scene import Run, Scene
from simulate import INTEGRATORS, Setting, measure

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


def swinging(name: str, mjcf: str, start: tuple[float, float], swing: float) -> Scene:
    """Let the first joint swing by `swing` (m); the error of that at the end."""

    def begin(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qpos[:] = start

    def measure(run: Run) -> dict[str, float]:
        last = run.qpos[run.time > DURATION - WINDOW, 0]
        return {"swing error": abs(0.5 * float(np.ptp(last)) - swing)}

    return Scene(
        name=name,
        title=f"{name.replace('-', ' ')}, error of a swing by {1e3 * swing:g} mm",
        xml=f"<mujoco>{mjcf}</mujoco>",
        duration=DURATION,
        start=begin,
        measure=measure,
        targets={"swing error": 1e-4},
        units={"swing error": "m"},
        timesteps=TIMESTEPS,
    )


def standing() -> list[Scene]:
    """Return what swings on a spring, on a servo, and on a servo through an equality."""
    sag = MASS * 9.81 / STIFFNESS
    start = (-0.5 - sag - SWING_OF_LEG, sag + SWING_OF_LEG)
    return [
        swinging("leg-on-spring", leg(servo=False), start, SWING_OF_LEG),
        swinging("leg-on-servo", leg(servo=True), start, SWING_OF_LEG),
        swinging("servo-in-equality", coupled(), (SWING_OF_MASS, SWING_OF_MASS), SWING_OF_MASS),
    ]


def last_swing(
    mjcf: str, start: tuple[float, float], timestep: float, integrator: str, *, peer: bool
) -> float:
    """Return half the way (m) that the first joint goes to and fro at the end."""
    setting = Setting(
        integrator,
        dashpot=not peer,
        option={"integrator": INTEGRATORS[integrator], "cone": mujoco.mjtCone.mjCONE_ELLIPTIC},
    )
    return measure(swinging("", mjcf, start, 0.0), setting, timestep)["swing error"]


def main() -> None:
    takes_no_arguments(__doc__)
    for scene in standing():
        for integrator in ("Euler", "RK4"):
            option = {"integrator": INTEGRATORS[integrator]}
            elliptic = {**option, "cone": mujoco.mjtCone.mjCONE_ELLIPTIC}
            ours = Setting("dashpot", dashpot=True, option=option)
            theirs = Setting("mujoco elliptic", option=elliptic)
            for timestep in TIMESTEPS:
                errors = [1e3 * measure(scene, s, timestep)["swing error"] for s in (ours, theirs)]
                print(
                    f"{scene.title}, after {DURATION:g} s, {integrator}, {1e3 * timestep:g} ms: "
                    f"dashpot {errors[0]:.2f} mm, MuJoCo {errors[1]:.2f}"
                )


if __name__ == "__main__":
    main()
