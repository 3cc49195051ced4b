"""Delayed controls and sensors."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine, Material

SCENE = """<mujoco><option timestep="0.004" integrator="{integrator}"/>
<worldbody><geom name="floor" type="plane" size="5 5 .1"/>
  <body pos="0 0 2"><joint name="hinge" axis="0 1 0"/>
    <geom size=".05" pos=".3 0 0" contype="0" conaffinity="0"/></body>
  <body pos="2 0 .1"><freejoint/><geom name="ball" size=".01" mass="1"/></body></worldbody>
<actuator>
  <motor joint="hinge" nsample="4" delay=".012" interp="linear"/>
  <motor joint="hinge" nsample="3" delay=".008" interp="zoh"/></actuator>
<sensor>
  <clock nsample="4" delay=".012"/><clock nsample="3" interval=".012"/></sensor></mujoco>"""


@pytest.mark.parametrize("impact", ["none", "cut"])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_delays_are_those_of_mj_step_also_where_steps_are_cut(integrator, impact):
    model = mujoco.MjModel.from_xml_string(SCENE.format(integrator=integrator))
    engine = Engine(model, impact=impact)
    engine.set_pair_material("ball", "floor", Material(stiffness=1e6, restitution=1.0))
    data, theirs = engine.make_data(), mujoco.MjData(model)
    data.qvel[3] = -20.0
    cuts = 0
    for control in np.random.default_rng(0).uniform(-1.0, 1.0, (200, 2)):
        data.ctrl[:] = theirs.ctrl[:] = control
        cut = engine.step(data).cuts
        mujoco.mj_step(model, theirs)
        assert np.array_equal(data.actuator_force, theirs.actuator_force)
        if not cut:  # else sensors are those of the last part
            assert data.sensordata == pytest.approx(theirs.sensordata, abs=1e-12)
        cuts += cut
    assert (cuts > 10) == (impact == "cut")
