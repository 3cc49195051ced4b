"""Bodies that land off-centre, with friction: rigid contacts do what ever stiffer springs do.

With restitution 0 the point that lands stays where it is.
"""

import mujoco
import numpy as np
import pytest

from dashpot import Engine, Material

# A body, its height, and its attitude; all of them come down at 1 m/s without turning.
LANDINGS = {
    "rod at 45 degrees": ('type="capsule" size="0.02 0.2"', 0.17, "0 45 0"),
    "rod at 30 degrees": ('type="capsule" size="0.02 0.2"', 0.2, "0 30 0"),
    "cube on its edge": ('type="box" size="0.1 0.1 0.1"', 0.13, "0 20 0"),
    "cube on its corner": ('type="box" size="0.1 0.1 0.1"', 0.17, "30 20 10"),
}


UP = np.array([0.0, 0.0, 1.0])


def angular_momentum(model, data):
    """Of the one body, of 1 kg, about the origin."""
    probe = mujoco.MjData(model)
    probe.qpos[:], probe.qvel[:] = data.qpos, data.qvel
    mujoco.mj_forward(model, probe)
    mujoco.mj_subtreeVel(model, probe)
    return probe.subtree_angmom[1] + np.cross(probe.subtree_com[1], probe.subtree_linvel[1])


def land(shape, *, timestep, material=None):
    """Return the twist (m/s, rad/s) after the hit and the part of the energy that is left."""
    geom, height, attitude = LANDINGS[shape]
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="{timestep}" gravity="0 0 0"/><worldbody>
        <geom name="floor" type="plane" size="5 5 1" friction="1"/>
        <body pos="0 0 {height}" euler="{attitude}"><freejoint/>
          <geom name="body" {geom} mass="1" friction="1"/></body>
      </worldbody></mujoco>""")
    engine = Engine(model)
    if material:
        engine.set_pair_material("floor", "body", material)
    data = engine.make_data()
    data.qvel[2] = -1.0
    before = engine.energy(data).kinetic
    start, place = angular_momentum(engine.model, data), None
    while data.time < 0.2:
        engine.step(data)
        contacts = engine.contacts(data)
        touches = bool((contacts.force[:, 0] > 0).any())
        if place is not None and not touches:
            break
        if place is None and touches:
            place = contacts.position.mean(axis=0)
    assert place is not None
    # Forces of a hit pass the point that lands, or the edge along y: about it nothing turns the
    # body. The point moves by a part of a millimetre while the hit lasts, of arms of 0.1 m.
    gained = angular_momentum(engine.model, data) - start - np.cross(place, data.qvel[:3] + UP)
    axes = slice(1, 2) if shape == "cube on its edge" else slice(0, 3)
    assert np.abs(gained[axes]).max() < 1e-3
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, data.qpos[3:7])
    twist = np.concatenate([data.qvel[:3], rotation.reshape(3, 3) @ data.qvel[3:]])
    return twist, engine.energy(data).kinetic / before


@pytest.fixture(scope="module")
def stiff_limits():
    """Return what a spring of 1e8 N/m does, at steps of 10 us."""
    return {
        shape: land(shape, timestep=1e-5, material=Material(stiffness=1e8)) for shape in LANDINGS
    }


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("shape", LANDINGS)
def test_rigid_landing_is_that_of_a_stiff_spring(shape, timestep, stiff_limits):
    """Rigid friction was damped at a tenth of the critical ratio: edges rebounded sideways."""
    twist, left = land(shape, timestep=timestep)
    limit, left_in_limit = stiff_limits[shape]
    # Rigid springs along the floor are softer than along its normal, by the apparent masses.
    assert left == pytest.approx(left_in_limit, abs=0.03)
    assert np.abs(twist[:3] - limit[:3]).max() < 0.06


ROD_LENGTH, ROD_RADIUS = 0.6, 0.01


@pytest.mark.parametrize("timestep", [1e-4, 0.001, 0.002])
@pytest.mark.parametrize("degrees", [20, 40, 60])
@pytest.mark.parametrize("heading", [0, 30])
def test_the_end_of_an_inelastic_rod_stays_where_it_lands(timestep, degrees, heading):
    """It slid back with 0.1 to 0.24 of the speed: friction was not over with the normal force.

    Friction as large as needed: the end stops, so that a rod of length l under the angle a turns
    with v cos(a) / (l / 2) / (1 + 1/3), about that end.
    """
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco>
      <option timestep="{timestep}" gravity="0 0 0"/><worldbody>
        <geom name="floor" type="plane" size="5 5 1" friction="5"/>
        <body pos="0 0 .4" euler="0 0 {heading}"><freejoint/>
          <inertial mass="1" pos="0 0 0" diaginertia="{{0}} {{0}} 1e-3"/>
          <geom name="end" type="sphere" size="{ROD_RADIUS}" pos="0 0 {-ROD_LENGTH / 2}"/></body>
      </worldbody></mujoco>""".replace("{0}", str(ROD_LENGTH**2 / 12))
    )
    engine = Engine(model)
    engine.set_material("end", Material(restitution=0.0))
    data = engine.make_data()
    turn = np.empty(4)
    mujoco.mju_axisAngle2Quat(turn, np.array([0.0, 1.0, 0.0]), np.radians(90 - degrees))
    mujoco.mju_mulQuat(data.qpos[3:7], data.qpos[3:7].copy(), turn)
    mujoco.mj_kinematics(model, data)
    data.qpos[2] -= data.geom_xpos[1, 2] - ROD_RADIUS - 1e-4
    data.qvel[2] = -1.0
    while not engine.step(data).touching:
        pass
    while engine.step(data).touching:
        pass
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    jacobian = np.empty((3, model.nv))
    mujoco.mj_jacGeom(model, data, jacobian, None, 1)
    left = jacobian @ data.qvel
    # A damping ratio of 3 leaves 0.03 of a central hit, and the coupling of the two rows up to
    # twice as much.
    assert 0.0 <= left[2] < 0.06
    assert np.linalg.norm(left[:2]) < 0.06
    expected = np.cos(np.radians(degrees)) / (ROD_LENGTH / 2) / (1 + 1 / 3)
    assert np.linalg.norm(data.qvel[3:]) == pytest.approx(expected, rel=0.08)
