"""What slides in balance with friction stops at its limit, and stays there."""

import mujoco
import numpy as np
import pytest

import dashpot
from scene import GRAVITY

TIMESTEPS = (0.002, 0.005, 0.010)
# Springs pull a ball over a plane, so damped that its inertia does not count. Oblique slides of
# different inertia couple its normal and both tangents, which springs and dampers of friction feel
# in different proportions.
PULLED = """
<mujoco><option timestep="{}"/><worldbody><geom type="plane" size="1 1 .1"/>
 <body pos="0 0 .02">
  <joint type="slide" axis="1 .3 .2" armature=".1" stiffness="300" damping="300"/>
  <joint type="slide" axis="0 1 .1" armature="3" stiffness="500" damping="900"/>
  <joint type="slide" axis="0 0 1"/>
  <geom type="sphere" size=".02" mass="1" friction="1"/>
 </body>
</worldbody></mujoco>"""


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_ball_that_springs_pull_ever_slower_stops_at_the_limit_of_friction(timestep):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(PULLED.format(timestep)))
    data = engine.make_data()
    data.qpos[:] = 0.1, 0.05, -0.2 / np.sqrt(1.13) * 0.1 - 0.1 / np.sqrt(1.01) * 0.05
    engine.step(data, nstep=round(40.0 / timestep))
    stopped = data.qpos.copy()
    force = engine.contacts(data).force[0]
    assert force[0] == pytest.approx(GRAVITY, rel=1e-9)
    # The slower of two exponentials falls by e in 1.5 s: to 1e-12 of where it began.
    assert np.hypot(force[1], force[2]) == pytest.approx(force[0], rel=1e-9)
    engine.step(data, nstep=round(20.0 / timestep))
    assert np.abs(data.qpos - stopped).max() < 1e-12
    assert np.abs(data.qvel).max() < 1e-13
