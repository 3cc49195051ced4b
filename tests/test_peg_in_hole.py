"""A peg that is pushed sideways in its hole tilts until it touches both walls, and jams."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine, Material

HALF_WIDTH, HALF_LENGTH, CLEARANCE, MASS = 0.01, 0.05, 2e-4, 0.2
FRICTION = 0.5
# A force at the top of the peg, as a force and a torque about its middle.
FORCE, TORQUE = 10.0, 10.0 * 0.04
START = 0.01  # height of its middle over the mouth of the hole, m

SHAPES = {
    "box": f'type="box" size="{HALF_WIDTH} {HALF_WIDTH} {HALF_LENGTH}"',
    "cylinder": f'type="cylinder" size="{HALF_WIDTH} {HALF_LENGTH}"',
}


def push_peg(shape, timestep, *, friction=FRICTION, wall=None, **options):
    """Return engine and data after 0.5 s under the force, and the heights of 1 s more."""
    at = HALF_WIDTH + CLEARANCE + 0.02
    walls = [(at, 0, 0.02, 0.06), (-at, 0, 0.02, 0.06)]
    walls += [(0, at, at - 0.02, 0.02), (0, -at, at - 0.02, 0.02)]
    hole = "".join(
        f'<geom type="box" pos="{x} {y} -0.03" size="{sx} {sy} 0.03" friction="{friction}"/>'
        for x, y, sx, sy in walls
    )
    xml = f"""<mujoco><option timestep="{timestep}"/><worldbody>{hole}
      <geom type="plane" size="1 1 0.1" pos="0 0 -0.06"/>
      <body name="peg" pos="0 0 {START}"><freejoint/>
        <geom {SHAPES[shape]} mass="{MASS}" friction="{friction}"/></body>
      </worldbody></mujoco>"""
    engine = Engine(mujoco.MjModel.from_xml_string(xml), **options)
    if wall:
        for geom in range(4):
            engine.set_material(geom, wall)
    data = engine.make_data()
    data.xfrc_applied[1] = [FORCE, 0, 0, 0, TORQUE, 0]
    engine.step(data, nstep=round(0.5 / timestep))
    heights = []
    for _ in range(round(1.0 / timestep)):
        engine.step(data)
        heights.append(data.qpos[2])
    return engine, data, np.array(heights)


def tilt_between_walls(height):
    """Angle at which it touches the mouth on one side and, with its lower end, the other wall."""
    return 2 * CLEARANCE / (HALF_LENGTH - height)


@pytest.mark.parametrize("timestep", [0.0005, 0.002, 0.005])
@pytest.mark.parametrize("shape", SHAPES)
def test_peg_jams_and_stays(shape, timestep):
    # Newton and Euler: 22.5 and 12.5 N on the walls, 40 mm apart, of whose friction of up to 17.5 N
    # its weight is 2 N. MuJoCo lets it slip by 0.5 mm/s.
    _, data, heights = push_peg(shape, timestep)
    assert heights[0] > START - 3e-4  # it jams where it is pushed, but for what tilting takes
    # A cylinder rocks to and fro across the force, where nothing holds it.
    assert np.ptp(heights) < 2e-6
    # Rigid contacts of a light peg give way, by tens of micrometres in steps of 5 ms.
    assert 0.99 * tilt_between_walls(heights[-1]) < 2 * data.qpos[5] < 0.018


@pytest.mark.parametrize("shape", SHAPES)
def test_more_microsteps_make_a_rigid_peg_stiffer(shape):
    _, data, heights = push_peg(shape, 0.002, microsteps=52)
    assert 2 * data.qpos[5] == pytest.approx(tilt_between_walls(heights[-1]), rel=0.03)


def test_stiffness_says_how_far_a_jammed_peg_gives_way():
    # A box touches the mouth in two corners, the other wall in two. Friction bears part of the
    # torque; what is left to the normal forces decides how far they sink in.
    stiffness = 1e6
    engine, data, heights = push_peg("box", 0.002, wall=Material(stiffness=stiffness))
    contacts = engine.contacts(data)
    force = contacts.force[:, 0] * -np.sign(contacts.frame[:, 0, 0])
    # Along x, but for what friction adds along normals that are tilted as the peg is.
    assert force.sum() == pytest.approx(FORCE, rel=0.01)
    expected = tilt_between_walls(heights[-1])
    expected += np.abs(force).sum() / 2 / stiffness / (HALF_LENGTH - heights[-1])
    assert 2 * data.qpos[5] == pytest.approx(expected, rel=5e-3)


def test_peg_without_friction_slides_in():
    _, data, _ = push_peg("box", 0.002, friction=1e-5)
    assert data.qpos[2] < -0.009  # down to the floor of the hole, 60 mm deep
