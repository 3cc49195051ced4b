"""Chains of ball joints that roll in contact: the axes of their joints turn with them."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dashpot import Engine

SLOPE = np.radians(20.0)


def chain(count, radius, half, damping, dt, joint):
    """Return a model of a straight chain of links along y that lies across a slope."""
    link = (
        f'<geom type="cylinder" zaxis="0 1 0" size="{radius} {half}" density="1000" friction=".8"/>'
    )
    inner = ""
    for _ in range(count - 1):
        axes = joint.format(half=-half, damping=damping)
        inner = f'<body pos="0 {2 * half} 0">{axes}{link}{inner}</body>'
    pull = f"{9.81 * np.sin(SLOPE)} 0 {-9.81 * np.cos(SLOPE)}"
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="{dt}" gravity="{pull}"/>
      <worldbody><geom type="plane" size="9 9 .1" friction=".8"/>
      <body pos="0 0 {radius}"><freejoint/>{link}{inner}</body></worldbody></mujoco>""")


BALL = '<joint type="ball" pos="0 {half} 0" damping="{damping}"/>'
CROSS = (
    '<joint pos="0 {half} 0" axis="1 0 0" damping="{damping}"/>'
    '<joint pos="0 {half} 0" axis="0 0 1" damping="{damping}"/>'
)


@pytest.mark.parametrize(
    ("count", "radius", "half", "damping", "dt", "joint", "turn"),
    [
        (20, 0.01, 0.015, 0.005, 0.002, BALL, 0.3),
        (12, 0.02, 0.02, 0.02, 0.004, BALL, 0.3),
        (10, 0.005, 0.02, 0.001, 0.002, BALL, 0.3),
        (12, 0.02, 0.02, 0.02, 0.004, CROSS, 0.3),
    ],
)
def test_chain_rolls_down_a_slope_straight(count, radius, half, damping, dt, joint, turn):
    engine = Engine(chain(count, radius, half, damping, dt, joint))
    data = engine.make_data()
    # Until it turns by `turn` (rad) in a step.
    steps = round(turn * radius / (9.81 * np.sin(SLOPE) / 1.5) / dt**2)
    engine.step(data, nstep=steps)
    links = data.xipos[1:]
    # A cylinder that rolls: two thirds of g sin(slope).
    way = 9.81 * np.sin(SLOPE) / 3.0 * (steps * dt) ** 2
    assert links[:, 0].mean() == pytest.approx(way, rel=0.01)
    assert np.ptp(links[:, 0]) < 0.2 * radius
    assert np.ptp(links[:, 2]) < 0.05 * radius
