"""What rolls or slides over the edge of a table falls from where its centre passes it."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine

GRAVITY = 9.81
PHASES = 8  # of the step within which the centre passes the edge
SHAPES = {
    "sphere": 'type="sphere" size="{radius}"',
    "cylinder": 'type="cylinder" size="{radius} 0.05" euler="90 0 0"',
}


def excess_of_fall(shape, speed, radius, friction, timestep, way, *, metre=1.0):
    """Return the speed of the fall that is missing 10 ms after the edge, way (m) before.

    The model is written in units of which a metre has so many.
    """
    speed, radius, way, gravity = (metre * x for x in (speed, radius, way, GRAVITY))
    geom = SHAPES[shape].format(radius=radius)
    engine = Engine(
        mujoco.MjModel.from_xml_string(f"""
<mujoco><option timestep="{timestep}" gravity="0 0 {-gravity}"/>
<default><geom friction="{friction}"/></default><worldbody>
  <geom type="box" size="{5 * metre} {0.3 * metre} {0.05 * metre}"
    pos="{-5 * metre} 0 {-0.05 * metre}"/>
  <body pos="{-way} 0 {radius}"><freejoint/><geom {geom} mass="0.2"/></body>
</worldbody></mujoco>""")
    )
    data = engine.make_data()
    data.qvel[0] = speed
    if friction > 0.0:
        data.qvel[4] = speed / radius
    at_edge = way / speed
    while data.time < at_edge + 0.01 + 3.0 * timestep:
        engine.step(data)
    return (data.qvel[2] + gravity * (data.time - at_edge)) / metre


# Where v^2 > g r the edge does not hold what rolls over it. In a step it goes on by 0.025 to 0.5
# radii.
@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005, 0.010])
@pytest.mark.parametrize("speed", [0.5, 1.0])
@pytest.mark.parametrize(
    ("shape", "friction"), [("sphere", 1.0), ("sphere", 0.0), ("cylinder", 1.0)]
)
def test_fall_begins_where_the_centre_passes_the_edge(shape, friction, speed, timestep):
    radius = 0.02
    ways = (20.0 + np.arange(PHASES) / PHASES) * speed * timestep
    late = [
        excess_of_fall(shape, speed, radius, friction, timestep, way) / (GRAVITY * timestep)
        for way in ways
    ]
    # A step is carried or not: half of it is the best that one geometry for all of it gives.
    assert np.abs(late).max() < 0.51
    # Past the edge the rows of the middle open with v^2 / r there, 1.3 g at 0.5 m/s, from 0 at the
    # edge on: the nearer this is to g, the more of the step is carried.
    # Were it late evenly by 0 to half a step, never early, the mean would be a quarter.
    assert np.abs(np.mean(late)) < 0.25


@pytest.mark.parametrize("metre", [1000.0, 0.0625])
@pytest.mark.parametrize("timestep", [0.005, 0.010])
def test_the_fall_knows_no_unit_of_length(timestep, metre):
    # Whether it runs along the table was told by 5 cm/s, in any unit: falls in millimetres began up
    # to a step late.
    late = [
        excess_of_fall("sphere", 0.5, 0.02, 1.0, timestep, way, metre=metre) / (GRAVITY * timestep)
        for way in (20.0 + np.arange(PHASES) / PHASES) * 0.5 * timestep
    ]
    assert np.abs(late).max() < 0.51
    assert np.abs(np.mean(late)) < 0.25
