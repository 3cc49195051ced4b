"""What swings above a foot that stands: the root of its tree moves, its contacts stay in place.

The rows of such a foot have the joints of all that moves above it, whose axes turn within a step.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipk

import dashpot
from legged_scenes import BOB_LENGTH as LENGTH
from legged_scenes import bob_above_foot

ANGLE, GRAVITY = 0.5, 9.81  # rad, m/s^2


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_a_pendulum_on_a_foot_keeps_its_swing(timestep: float, integrator: str) -> None:
    engine = dashpot.Engine(bob_above_foot(timestep, integrator))
    data = engine.make_data()
    engine.step(data, nstep=round(0.1 / timestep))
    drop = LENGTH * (1 - np.cos(ANGLE))
    data.qpos += [-LENGTH * np.sin(ANGLE), drop, ANGLE, -ANGLE]
    data.qvel[:] = 0.0
    start, angles = engine.energy(data), []
    for _ in range(round(10.0 / timestep)):
        engine.step(data)
        angles.append(data.qpos[2])
    last = np.abs(angles[-round(2.0 / timestep) :]).max()
    # The middle of a step is off by the third power of the turn in it: 0.015 rad at 5 ms.
    assert last == pytest.approx(ANGLE, rel=2e-3 * max(1.0, (timestep / 0.002) ** 2))
    sign = np.sign(angles)
    rising = timestep * np.flatnonzero((sign[1:] > 0) & (sign[:-1] < 0))
    period = 4 * np.sqrt(LENGTH / GRAVITY) * ellipk(np.sin(ANGLE / 2) ** 2)
    assert np.diff(rising).mean() == pytest.approx(period, rel=2e-3)
    given = start.dissipated_recovery - engine.energy(data).dissipated_recovery
    assert abs(given) < 0.02 * GRAVITY * drop
