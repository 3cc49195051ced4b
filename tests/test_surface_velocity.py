"""Geoms whose surface moves by itself: conveyor belts and turntables."""

import mujoco
import numpy as np
import pytest

import dashpot

SCENE = """<mujoco><option timestep="{timestep}"/><worldbody>
  <geom name="belt" type="plane" size="9 9 .1" friction=".5" surfacevel="{surface}"/>
  <body pos="{position} .1"><freejoint/>
    <geom name="box" type="box" size=".1 .1 .1" mass="2" friction=".5"/></body>
</worldbody></mujoco>"""


def box_on(
    surface: str, timestep: float, position: str = "0 0", law: str = "kelvin_voigt"
) -> tuple[dashpot.Engine, mujoco.MjData]:
    xml = SCENE.format(surface=surface, timestep=timestep, position=position)
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml), law=law)
    return engine, engine.make_data()


@pytest.mark.parametrize("timestep", [1e-3, 5e-3])
def test_a_belt_accelerates_a_box_to_its_speed(timestep):
    engine, data = box_on("1 0 0 0 0 0", timestep)
    engine.step(data, round(0.1 / timestep))
    # Sliding, mu g, from the first contact on; the box settles by the elastic give within a step.
    assert data.qvel[0] == pytest.approx(0.5 * 9.81 * 0.1, rel=0.02)
    engine.step(data, round(2.9 / timestep))
    # It slides for v / (mu g) and then rides, v^2 / (2 mu g) behind the belt.
    assert data.qvel[0] == pytest.approx(1.0, abs=1e-9)
    assert data.qpos[0] == pytest.approx(3.0 - 1.0 / (2 * 0.5 * 9.81), abs=2e-3)
    contacts = engine.contacts(data)
    assert contacts.sticking.all()
    assert np.abs(contacts.velocity).max() < 1e-9


def test_the_ledger_books_what_the_belt_puts_in():
    engine, data = box_on("1 0 0 0 0 0", 1e-3)
    engine.step(data, 10)
    start = engine.energy(data).total
    engine.step(data, 1000)
    energy = engine.energy(data)
    # The belt works m v^2 on the box: half becomes motion, half heat.
    assert energy.kinetic == pytest.approx(1.0, rel=1e-3)
    assert energy.dissipated_friction == pytest.approx(1.0, rel=0.05)
    assert energy.total == pytest.approx(start, abs=1e-3)


def test_a_turntable_carries_a_box_around():
    """At 0.5 m and 1 rad/s, 0.5 m/s^2 of the 4.9 m/s^2 that friction can hold."""
    engine, data = box_on("0 0 0 0 0 1", 1e-3, position="0.5 0")
    data.qvel[:6] = 0.0, 0.5, 0.0, 0.0, 0.0, 1.0
    engine.step(data, round(2 * np.pi / 1e-3))
    # A turn ends where it began; it drifts outwards by the elastic lag of friction.
    np.testing.assert_allclose(data.qpos[:2], [0.5, 0.0], atol=2e-3)
    assert data.qvel[5] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("surface", ["0.3 0.2 0.1 0.4 0.5 0.6", "0 1 0 0 0 0"])
def test_velocity_is_that_of_mujocos_rows(surface):
    xml = f"""<mujoco><option cone="elliptic"/><worldbody>
      <geom type="plane" size="1 1 .1" surfacevel="{surface}" pos=".1 .2 0" euler="0 0 30"/>
      <body pos=".02 0 .0999"><freejoint/>
        <geom size=".1" condim="6" surfacevel="1 2 3 1 2 3" euler="10 20 30"/></body>
      </worldbody></mujoco>"""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    data = engine.make_data()
    data.qvel[:] = 0.1, 0.2, 0.3, 0.4, 0.5, 0.6
    reference_model = mujoco.MjModel.from_xml_string(xml)
    reference = mujoco.MjData(reference_model)
    reference.qvel[:] = data.qvel
    mujoco.mj_forward(reference_model, reference)
    engine.step(data)
    np.testing.assert_allclose(
        engine.contacts(data).velocity[0], reference.efc_vel[:3], rtol=1e-12, atol=1e-14
    )


def test_the_complementarity_free_law_knows_belts():
    engine, data = box_on("1 0 0 0 0 0", 1e-3, law="comfree")
    engine.step(data, 3000)
    assert data.qvel[0] == pytest.approx(1.0, rel=1e-2)
