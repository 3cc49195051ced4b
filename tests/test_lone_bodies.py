"""Bodies that nothing joins go through the micro-steps together, and move as each does alone."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

import dashpot

GEOMS = (
    'type="sphere" size=".1"',
    'type="sphere" size=".1" condim="1"',
    'type="sphere" size=".1" condim="6" friction="1 .01 .01"',
    'type="box" size=".1 .08 .06"',
    'type="capsule" size=".05 .1" euler="0 90 0"',
    'type="ellipsoid" size=".1 .08 .06" condim="4"',
)
COUNT = 18
STEPS = 250


def moved(indices: list[int], timestep: float) -> NDArray[np.float64]:
    """Return where the bodies of these numbers are after all steps (n, 13), thrown alike."""
    rng = np.random.default_rng(3)
    heights = rng.uniform(0.1, 0.3, COUNT)
    velocities = rng.normal(size=(COUNT, 6)) * ([0.5] * 3 + [2.0] * 3)
    bodies = "".join(
        f'<body pos="{2 * i} 0 {heights[i]}"><freejoint/><geom {GEOMS[i % len(GEOMS)]}/></body>'
        for i in indices
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}" cone="elliptic"/><worldbody>
        <geom type="plane" size="99 99 1"/>{bodies}</worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qvel[:] = velocities[indices].ravel()
    engine.step(data, nstep=STEPS)
    return np.hstack([data.qpos.reshape(-1, 7), data.qvel.reshape(-1, 6)])


@pytest.mark.parametrize("timestep", [0.001, 0.004])
def test_bodies_far_apart_move_as_each_does_alone(timestep: float) -> None:
    together = moved(list(range(COUNT)), timestep)
    alone = np.vstack([moved([i], timestep) for i in range(COUNT)])
    assert np.abs(together[:, 2] - together[:, 2].mean()).max() > 0.01  # not all alike
    # Rounding grows where they tumble over edges.
    np.testing.assert_allclose(together, alone, rtol=0.0, atol=1e-8)
    assert np.median(np.abs(together - alone)) < 1e-13
