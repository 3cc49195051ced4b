"""Bodies that land off-centre, with friction: rigid contacts do what ever stiffer springs do."""

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
    hit = False
    while data.time < 0.2:
        engine.step(data)
        touches = bool((engine.contacts(data).force[:, 0] > 0).any())
        if hit and not touches:
            break
        hit |= touches
    assert hit
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
