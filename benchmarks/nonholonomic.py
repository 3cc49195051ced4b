"""Scenes of rolling without slip whose motion mechanics knows.

Discs are flat ellipsoids, near the knife edges of theory. Friction is 1, none of spin or roll.
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt

import mujoco
import numpy as np

from bicycle import bicycle
from rattleback import rattleback
from scene import GRAVITY, Array, Run, Scene, mjcf, set_velocity

FLOOR = 'friction="1 0 0"'
EDGE = 1e-4  # half width of a disc, m
TIMESTEPS = (0.001, 0.002, 0.005)


def disc(radius: float, tilt: float) -> str:
    """Return a disc of 1 kg whose axis is tilted by `tilt` (rad) from z towards x."""
    across, along = radius**2 / 4, radius**2 / 2
    return f"""<body name="disc" pos="0 0 {radius * sin(tilt)}"
      quat="{cos(tilt / 2)} 0 {sin(tilt / 2)} 0"><freejoint/>
      <inertial pos="0 0 0" mass="1" diaginertia="{across} {across} {along}"/>
      <geom type="ellipsoid" size="{radius} {radius} {EDGE}" {FLOOR}/></body>"""


def axes(run: Run) -> Array:
    """Return the axis of the disc, a unit vector, at every sample, (T, 3)."""
    w, x, y, z = run.qpos[:, 3:7].T
    return np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)


def wobble(*, radius: float = 0.2, speed: float = 2.0, push: float = 0.05) -> Scene:
    """Push a disc that rolls upright; relative error of the period of its wobble, and its growth.

    Of small lean th: 5/4 th'' + (3 v^2 / r^2 - g / r) th = 0.
    """
    period = 2 * pi / sqrt((3 * (speed / radius) ** 2 - GRAVITY / radius) / 1.25)

    def measure(run: Run) -> dict[str, float]:
        lean, dt = axes(run)[:, 2], run.model.opt.timestep
        up = np.flatnonzero((lean[:-1] < 0) & (lean[1:] >= 0))
        passed = dt * (up - lean[up] / (lean[up + 1] - lean[up]))
        swing = [np.abs(part).max() for part in np.array_split(lean, 6)]
        return {
            "period error": abs(float(np.diff(passed).mean()) / period - 1),
            "growth": abs(float(swing[-1] / swing[0]) - 1),
        }

    # The axis points along x: the disc rolls along y, about -x, and is pushed about y.
    rolling = (radius * push, speed, 0.0, 0.0, push, -speed / radius)
    return Scene(
        name="wobble",
        title=f"disc rolling at {speed:g} m/s, period of its wobble",
        xml=mjcf(disc(radius, pi / 2), floor=FLOOR),
        duration=6.0,
        start=set_velocity("disc", rolling),
        measure=measure,
        targets={"period error": 1e-3, "growth": 2e-3},
        timesteps=TIMESTEPS,
    )


def tilted_disc(*, radius: float = 0.1, degrees: float = 30.0) -> Scene:
    """Let the contact of a tilted disc run round below its resting centre, as a settling coin's.

    Its rate is 2 sqrt(g / (r sin a)) at a tilt a from the floor. Relative error over five rounds,
    and the largest error of the tilt.
    """
    tilt = np.radians(degrees)
    rate = 2 * sqrt(GRAVITY / (radius * sin(tilt)))
    rounds = 5

    def measure(run: Run) -> dict[str, float]:
        axis = axes(run)
        turned = np.unwrap(np.arctan2(axis[:, 1], axis[:, 0]))
        return {
            "rate error": abs(float((turned[-1] - turned[0]) / (run.time[-1] * rate)) - 1),
            "tilt error": float(np.abs(np.arccos(axis[:, 2]) - tilt).max()),
        }

    return Scene(
        name="tilted-disc",
        title=f"disc running round at a tilt of {degrees:g} deg, rate",
        xml=mjcf(disc(radius, float(tilt)), floor=FLOOR),
        duration=rounds * 2 * pi / rate,
        # The disc turns about the line from its centre to the point of contact, its own x.
        start=set_velocity("disc", (0, 0, 0, -rate * sin(tilt), 0, 0)),
        measure=measure,
        targets={"rate error": 2e-3, "tilt error": 1e-3},
        units={"tilt error": "rad"},
        timesteps=TIMESTEPS,
    )


def turntable(*, rate: float = 3.0, speed: float = 0.2, radius: float = 0.05) -> Scene:
    """Roll a ball on a turntable: it circles at 2/7 of its rate; error in radii of its circle."""
    start = np.array([1.0, 0.0])  # of the ball; the table turns about the origin
    circling = 2 / 7 * rate
    centre = start - [speed / circling, 0.0]

    def measure(run: Run) -> dict[str, float]:
        angle = circling * run.time
        exact = centre + np.stack([np.cos(angle), np.sin(angle)], axis=1) * (start - centre)[0]
        error = np.linalg.norm(run.position("ball")[:, :2] - exact, axis=1)
        return {"error": float(error.max() / (speed / circling))}

    table = """<body pos="0 0 -.1"><joint name="table" axis="0 0 1"/>
      <geom type="cylinder" size="5 .1" mass="1e6" friction="1 0 0"/></body>"""
    ball = f"""<body name="ball" pos="1 0 {radius}"><freejoint/>
      <geom type="sphere" size="{radius}" mass=".1" friction="1 0 0"/></body>"""
    # Where they touch the ball has the velocity of the table.
    rolling = (0.0, speed, 0.0, (rate * start[0] - speed) / radius, 0.0, 0.0)

    def turn(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qvel[model.joint("table").dofadr[0]] = rate
        set_velocity("ball", rolling)(model, data)

    return Scene(
        name="turntable",
        title=f"ball on a turntable at {rate:g} rad/s, two rounds",
        xml=mjcf(ball + table, floor='contype="0" conaffinity="0"'),
        duration=2 * 2 * pi / circling,
        start=turn,
        measure=measure,
        targets={"error": 1e-3},
        timesteps=TIMESTEPS,
    )


def nonholonomic() -> list[Scene]:
    """Return the scenes of rolling without slip."""
    return [bicycle(), rattleback(), wobble(), tilted_disc(), turntable()]
