"""Equalities on a model's own solref without damping are springs: they keep the energy."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dashpot import Engine

BODIES = """<mujoco><option gravity="0 0 0" timestep="{dt}" integrator="{integrator}"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody>
  <body name="a"><freejoint/><geom type="box" size=".1 .08 .05" mass="1"/></body>
  <body name="b" pos=".3 0 0"><freejoint/><geom type="box" size=".05 .1 .05" mass=".5"/></body>
</worldbody><equality>{equality}</equality></mujoco>"""
WELD = '<weld body1="a" body2="b" solref="-2000 0"/>'
CONNECT = '<connect body1="a" body2="b" anchor=".15 0 0" solref="-2000 0"/>'


@pytest.mark.parametrize("equality", [WELD, CONNECT], ids=["weld", "connect"])
def test_two_free_bodies_on_a_soft_equality_keep_their_energy(equality):
    # What rows and position differ by in a step has either sign; where the smaller of the two was
    # kept, 3 to 13 % of the energy went in 5 s. What is left is the change of the springs'
    # stiffness with load (solimp) and the second order in the turn of a step.
    for seed in range(3):
        engine = Engine(
            mujoco.MjModel.from_xml_string(
                BODIES.format(dt=0.001, integrator="Euler", equality=equality)
            )
        )
        data = engine.make_data()
        scale = np.tile([0.3, 0.3, 0.3, 2.0, 2.0, 2.0], 2)
        data.qvel[:] = scale * np.random.default_rng(seed).normal(size=12)
        engine.step(data)
        start = engine.energy(data)
        stored = 0.0
        for _ in range(10):
            engine.step(data, nstep=500)
            energy = engine.energy(data)
            stored = max(stored, energy.elastic)
            assert energy.kinetic + energy.elastic == pytest.approx(
                start.kinetic + start.elastic, rel=1e-2
            )
        # The spring takes a good part of it at times, and has not let them fly apart, by 0.5 m/s.
        assert stored > 0.05 * start.kinetic
        assert np.linalg.norm(data.qpos[7:10] - data.qpos[:3]) < 0.5


def test_a_slide_on_a_soft_equality_swings_on():
    # solimp of one value: the stiffness does not follow the load. m x'' = -k x.
    engine = Engine(
        mujoco.MjModel.from_xml_string("""<mujoco><option gravity="0 0 0" timestep="0.002"/>
        <worldbody><body><joint name="x" type="slide" axis="1 0 0"/>
          <geom size=".05" mass="2"/></body></worldbody>
        <equality><joint joint1="x" solref="-400 0" solimp=".5 .5 1"/></equality></mujoco>""")
    )
    data = engine.make_data()
    data.qpos[0] = 0.02
    engine.step(data)
    rate = np.sqrt(400.0 / (1.0 - 0.5))  # d^2 k / (1 - d) of solref.hpp: direct k is over d^2
    far = []
    for _ in range(5000):
        engine.step(data)
        far.append(data.qpos[0])
    assert np.max(far[-500:]) == pytest.approx(0.02, rel=2e-3)
    crossings = np.flatnonzero(np.diff(np.sign(far)) != 0)
    period = 2.0 * 0.002 * (crossings[-1] - crossings[0]) / (len(crossings) - 1)
    assert period == pytest.approx(2.0 * np.pi / rate, rel=2e-4)  # second order in rate H
