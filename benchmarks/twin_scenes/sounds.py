"""Balls that bounce straight up and down, of which heights of apices or times of impacts are told.

Heights and intervals are those of restitution: e^2 of the height before, e times the interval. A
hard ball touches for 3 ms whatever its stiffness is within reason, and slides nowhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate import Parameter, Problem, Trajectory

from . import balls
from .case import Case, draw, simulate

Array = NDArray[np.float64]

STEP = 0.02
G = 9.81
FALL = [np.inf if i == 2 else 0.0 for i in range(6)]


def bounces(rng: np.random.Generator, restitution: float, height: float) -> tuple[Array, Array]:
    """Return heights (m) of four apices and times (s) of five impacts of a drop, in fine steps."""
    system = balls.engine(balls.HARD, restitution, 0.3)
    qpos = np.array([0, 0, balls.RADIUS + height, 1, 0, 0, 0])
    fall = np.sqrt(2 * height / G)
    end = fall * (1 + 2 * sum(restitution**k for k in range(1, 6)))
    path, _ = simulate(system, qpos, np.zeros(6), STEP, int(end / STEP))
    z = path[:, 2]
    gap = z - balls.RADIUS
    apices, impacts = [], []
    first = 0  # step of the present flight
    for k in range(2, len(gap) - 2):
        # In flight heights at the ends of steps lie on a parabola.
        if k - 2 >= first and len(impacts) < 5:
            curve = gap[k] - 2 * gap[k - 1] + gap[k - 2]
            slope = gap[k] - gap[k - 1] + 0.5 * curve
            if gap[k] + slope + 0.5 * curve <= 0:
                root = np.sqrt(slope**2 - 2 * curve * gap[k])
                impacts.append(STEP * (k - (slope + root) / curve))
                first = k + 1
        if impacts and z[k - 1] < z[k] >= z[k + 1] and len(apices) < 4:
            curve = z[k + 1] - 2 * z[k] + z[k - 1]
            apices.append(z[k] - (z[k + 1] - z[k - 1]) ** 2 / (8 * curve))
    return np.array(apices), np.array(impacts)


def apices_alone(rng: np.random.Generator) -> list[Case]:
    """Heights of four apices of two drops, read off a ruler to 2 mm."""
    restitution, seen = draw(rng, 0.6, 0.9), []
    for i in range(2):
        height = rng.uniform(0.4, 0.7)
        heights, times = bounces(rng, restitution, height)
        noisy = heights + 2e-3 * rng.normal(size=heights.size)
        seen.append(
            Trajectory.of_events(
                f"drop {i}", scalars={"apex_height": noisy}, bodies="ball", end=times[-1],
                initial_qpos=[0, 0, balls.RADIUS + height + 2e-3 * rng.normal(), 1, 0, 0, 0],
                initial_qvel=[0.0] * 6, initial_qvel_sigma=0.0,
                initial_qpos_sigma=[0, 0, 2e-3, 0, 0, 0],
            )
        )  # fmt: skip
    return [_case(seen, restitution, scalar_sigma={"apex_height": 2e-3})]


def impacts_alone(rng: np.random.Generator) -> list[Case]:
    """Hear five impacts of two drops to 1 ms, from heights that are not known."""
    restitution, seen, lead = draw(rng, 0.6, 0.9), [], 0.05
    for i in range(2):
        height = rng.uniform(0.4, 0.7)
        _, times = bounces(rng, restitution, height)
        heard = times - times[0] + lead + 1e-3 * rng.normal(size=times.size)
        # Speed before the first, of the interval after it and a restitution of 0.75.
        speed = 0.5 * G * (heard[1] - heard[0]) / 0.75
        seen.append(
            Trajectory.of_events(
                f"drop {i}", {"impact": heard}, bodies="ball",
                initial_qpos=[0, 0, balls.RADIUS + lead * speed - 0.5 * G * lead**2, 1, 0, 0, 0],
                initial_qvel=[0, 0, G * lead - speed, 0, 0, 0],
                initial_qpos_sigma=FALL, initial_qvel_sigma=FALL,
            )
        )  # fmt: skip
    return [_case(seen, restitution, event_sigma={"impact": 1e-3})]


def _case(seen: list[Trajectory], restitution: float, **sigma: dict[str, float]) -> Case:
    unknown: list[Parameter] = [balls.RESTITUTION, balls.FRICTION]
    made = Problem(balls.engine(), unknown, seen, initial_state="pose_and_velocity", **sigma)
    return Case(made, {"restitution": restitution}, ("sliding_friction",))
