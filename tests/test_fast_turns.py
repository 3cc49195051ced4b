"""Bodies that turn fast do not go in with points that are not the nearest."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine

TIMESTEP = 0.002
SHAPES = {
    "box": 'type="box" size="0.05 0.048 0.045"',
    "cylinder": 'type="cylinder" size="0.05 0.04"',
    "mesh": 'type="mesh" mesh="hull"',
}
THROWN = """<mujoco><option timestep="{timestep}"/>
  <asset><mesh name="hull" vertex="{hull}"/></asset>
  <worldbody><body><geom {shape} mass="1"/></body>
    <body pos="{x} 0 0.2"><freejoint/><geom {shape} mass="0.8"/></body></worldbody></mujoco>"""


def hull() -> str:
    points = np.random.default_rng(1).normal(size=(12, 3))
    points *= 0.06 / np.linalg.norm(points, axis=1)[:, None]
    return " ".join(f"{x:.4f}" for x in points.ravel())


def depths_of_a_throw(shape: str, rng: np.random.Generator) -> tuple[float, float]:
    """Return how deep a body goes into another one of its shape (m), and what frozen rows allow.

    Depths are MuJoCo's. It spins at some 20 rad/s about each axis: edges go up to 6 mm in a step.
    Rows that are frozen in a step H see a point at r from the centre go straight: (w H)^2 r / 2.
    """
    xml = THROWN.format(
        timestep=TIMESTEP, hull=hull(), shape=SHAPES[shape], x=rng.uniform(-0.09, 0.09)
    )
    engine = Engine(mujoco.MjModel.from_xml_string(xml))
    model, data = engine.model, engine.make_data()
    data.qpos[3:7] += rng.normal(scale=0.3, size=4)
    data.qpos[3:7] /= np.linalg.norm(data.qpos[3:7])
    data.qvel[2] = -1.0
    data.qvel[3:6] = rng.normal(scale=20.0, size=3)
    deepest, fastest = 0.0, 0.0
    for _ in range(75):
        fastest = max(fastest, np.linalg.norm(data.qvel[3:6]))
        engine.step(data)
        if np.linalg.norm(data.qpos[:3]) < 2 * model.geom_rbound[0]:
            mujoco.mj_kinematics(model, data)
            deepest = max(deepest, -mujoco.mj_geomDistance(model, data, 0, 1, 0.01, None))
    return deepest, (fastest * TIMESTEP) ** 2 * model.geom_rbound[0] / 2


@pytest.mark.parametrize("shape", SHAPES)
def test_what_turns_fast_goes_in_no_deeper_than_a_hit_but_for_corners_that_overtake(shape):
    """Detection ahead follows the nearest points: in 6 of 450 throws another corner comes first."""
    rng = np.random.default_rng(5)
    deepest, allowed = np.transpose([depths_of_a_throw(shape, rng) for _ in range(80)])
    assert (deepest > 1e-5).mean() > 0.2  # they hit
    # A critically damped spring with 1 / omega = 0.15 ms, as that of a rigid hit, gives way by
    # u / (e omega), 0.3 mm at 5 m/s.
    assert (deepest - allowed < 0.3e-3).mean() > 0.97
    assert np.max(deepest - allowed) < 3e-3  # 0.9, 2.5 and 0.8 mm
