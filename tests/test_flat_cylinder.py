"""Cylinders that stand flat on a plane: contact distances, and rest."""

import math

import mujoco
import numpy as np
import pytest

from dashpot import Engine

RADIUS = 0.1
DISC = f"""<mujoco><option timestep="0.01"/><worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 0.02"><freejoint/><geom type="cylinder" size="{RADIUS} 0.02" mass="1"/></body>
</worldbody></mujoco>"""


def tilted(tilt, direction, spin):
    """Return the orientation of a disc after a spin and a tilt about a horizontal direction."""
    turn = np.array([math.cos(spin / 2), 0.0, 0.0, math.sin(spin / 2)])
    lean = np.array([1.0, tilt / 2 * math.cos(direction), tilt / 2 * math.sin(direction), 0.0])
    quat = np.empty(4)
    mujoco.mju_mulQuat(quat, lean / np.linalg.norm(lean), turn)
    return quat


@pytest.mark.parametrize("tilt", [0.0, 1e-15, 1e-13, 1e-12, 1e-10, 1e-8, 9e-7, 2e-6, 1e-3])
def test_rim_is_as_far_from_the_plane_as_its_tilt_says(tilt):
    engine = Engine(mujoco.MjModel.from_xml_string(DISC))
    rng = np.random.default_rng(1)
    for _ in range(20):
        data = engine.make_data()
        data.qpos[3:] = tilted(tilt, *rng.uniform(0, 2 * math.pi, 2))
        engine.step(data)
        lowest = -RADIUS * math.sin(tilt) + 0.02 * (1.0 - math.cos(tilt))
        assert data.ncon >= 3
        # Flat, three fixed points stand for the rim: the lowest of them lies between it and half as
        # deep. Orientations round to 1e-16; MuJoCo's own points, beyond 1e-6 rad, to 1e-9 radii.
        rounding = 1e-15 if tilt < 1e-6 else 1e-10
        assert lowest - rounding <= data.contact.dist.min() <= 0.49 * lowest + rounding
        assert np.abs(data.contact.dist).max() <= 2.1 * RADIUS * tilt + rounding
        # They lie on the rim, half of the distance from the plane.
        assert np.linalg.norm(data.contact.pos[:, :2], axis=1) == pytest.approx(RADIUS, abs=1e-4)
        assert data.contact.pos[:, 2] == pytest.approx(data.contact.dist / 2, abs=1e-15)


def test_other_collisions_stay_as_they_are():
    model = mujoco.MjModel.from_xml_string(DISC)
    before, after = mujoco.MjData(model), mujoco.MjData(model)
    for data in (before, after):
        data.qpos[3:] = tilted(1e-9, 0.3, 0.2)
    mujoco.mj_forward(model, before)
    engine = Engine(model)
    engine.step(engine.make_data())
    mujoco.mj_forward(model, after)
    assert np.array_equal(before.contact.dist, after.contact.dist)
    assert np.array_equal(before.contact.pos, after.contact.pos)


@pytest.mark.parametrize("rate", [19.98, 19.99, 20.0, 20.01, 20.02])
def test_spun_disc_comes_to_rest_and_stays_so(rate):
    engine = Engine(mujoco.MjModel.from_xml_string(DISC))
    data = engine.make_data()
    data.qvel[5] = rate
    engine.step(data, nstep=300)
    settled = data.qpos.copy()
    engine.step(data, nstep=1000)
    # Points that are fixed to the disc remember where they stick: nothing but rounding moves it.
    assert np.abs(data.qpos - settled).max() < 1e-12
    assert np.abs(data.qvel).max() < 1e-12
