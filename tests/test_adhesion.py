"""Adhesion actuators: a force that pulls a body to what it touches, along the contact normals."""

import mujoco
import numpy as np
import pytest

import dashpot

TIMESTEPS = (1e-3, 2e-3, 5e-3)
WEIGHT = 9.81  # N, of 1 kg
RK4 = mujoco.mjtIntegrator.mjINT_RK4

CEILING = """<worldbody>
  <geom name="ceiling" type="box" size="1 1 .1" pos="0 0 .1"/>
  <body name="box" pos="0 0 -.1"><freejoint/>
    <geom name="box" type="box" size=".1 .1 .1" mass="1" gap=".001"/></body>
</worldbody><actuator><adhesion body="box" ctrlrange="0 1" gain="{gain}"/></actuator>"""

FLOOR = """<worldbody>
  <geom name="floor" type="plane" size="5 5 .1" friction="0.5"/>
  <body name="box" pos="0 0 .1"><freejoint/>
    <geom name="box" type="box" size=".1 .1 .1" mass="1" friction="0.5"/></body>
</worldbody><actuator><adhesion body="box" ctrlrange="0 1" gain="{gain}"/></actuator>"""


def engine_of(
    xml: str, timestep: float, integrator: int = mujoco.mjtIntegrator.mjINT_EULER
) -> tuple[dashpot.Engine, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{xml}</mujoco>")
    model.opt.timestep = timestep
    model.opt.integrator = integrator
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.ctrl[:] = 1.0
    return engine, data


def advance(engine: dashpot.Engine, data: mujoco.MjData, duration: float) -> None:
    engine.step(data, round(duration / engine.model.opt.timestep))


@pytest.mark.parametrize("integrator", [mujoco.mjtIntegrator.mjINT_EULER, RK4])
@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_body_hangs_from_a_ceiling_by_more_adhesion_than_its_weight(timestep, integrator):
    engine, data = engine_of(CEILING.format(gain=2 * WEIGHT), timestep, integrator)
    advance(engine, data, 5.0)
    assert data.qpos[2] == pytest.approx(-0.1, abs=1e-5)
    assert np.abs(data.qvel).max() < 1e-9
    # What is left of the adhesion presses on the ceiling.
    force = engine.contacts(data).force[:, 0].sum()
    assert force == pytest.approx(WEIGHT, rel=1e-6)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_body_falls_from_a_ceiling_with_less_adhesion_than_its_weight(timestep):
    engine, data = engine_of(CEILING.format(gain=0.5 * WEIGHT), timestep)
    advance(engine, data, 0.5)
    # Half the weight is held over the first millimetre, 0.02 s; then it falls freely.
    start = np.sqrt(2 * 0.001 / (0.5 * WEIGHT))
    speed = 0.5 * WEIGHT * start
    later = 0.5 - start
    expected = 0.001 + speed * later + 0.5 * WEIGHT * later**2
    # Contacts are taken at the start of a step: adhesion ends up to one step late.
    assert -0.1 - data.qpos[2] == pytest.approx(expected, abs=0.5 * WEIGHT * timestep * 0.5)


@pytest.mark.parametrize("adhesion", [0.0, 10.0, 30.0])
def test_adhesion_raises_the_limit_of_sliding_friction(adhesion):
    limit = 0.5 * (WEIGHT + adhesion)
    for push, slides in ((0.99 * limit, False), (1.01 * limit, True)):
        engine, data = engine_of(FLOOR.format(gain=max(adhesion, 1e-9)), 2e-3)
        advance(engine, data, 0.2)
        # Pushed low, so that it slides and does not tip.
        data.xfrc_applied[1, :5] = push, 0.0, 0.0, 0.0, -0.1 * push
        advance(engine, data, 1.0)
        if slides:
            assert data.qvel[0] == pytest.approx(0.01 * limit, rel=0.02)
        else:
            assert np.abs(data.qvel).max() < 1e-9


def test_moments_are_those_of_mujoco():
    """The mean of the normals of all contacts of the body, those inside the gap included."""
    xml = """<worldbody><geom type="plane" size="10 10 .001"/>
      <body name="body">
        <geom type="sphere" size=".1" pos=".1 0 0" margin=".01"/>
        <geom type="sphere" size=".1" pos="0 .1 0" gap=".01"/>
        <geom type="sphere" size=".1" pos=".1 .1 0" gap=".01"/>
        <joint type="slide" axis="0 0 1"/><joint type="hinge" axis="1 0 1"/></body></worldbody>
      <actuator><adhesion body="body" gain=".5" ctrlrange="0 1"/></actuator>"""
    engine, data = engine_of(xml, 2e-3)
    reference_model = mujoco.MjModel.from_xml_string(f"<mujoco>{xml}</mujoco>")
    reference = mujoco.MjData(reference_model)
    reference.ctrl[:] = 1.0
    for qpos in ((0.12, 0.0), (0.105, 0.0), (0.095, 0.02), (0.08, -0.05)):
        reference.qpos[:] = data.qpos[:] = qpos
        reference.qvel[:] = data.qvel[:] = 0.0
        mujoco.mj_forward(reference_model, reference)
        engine.step(data)
        np.testing.assert_allclose(data.qfrc_actuator, reference.qfrc_actuator, atol=1e-14)


@pytest.mark.parametrize("timestep", TIMESTEPS)
@pytest.mark.parametrize("where", ["geom", "pair"])
def test_a_body_hangs_by_the_adhesion_of_its_geom(timestep, where):
    """Four corners with 5 N each hold 9.81 N; adhesion is taken off what a contact reports."""
    on_geom = 'adhesion="5"' if where == "geom" else ""
    pair = (
        '<contact><pair geom1="ceiling" geom2="box" adhesion="5" gap=".001"/></contact>'
        if where == "pair"
        else ""
    )
    xml = f"""<worldbody><geom name="ceiling" type="box" size="1 1 .1" pos="0 0 .1"/>
      <body pos="0 0 -.1"><freejoint/>
        <geom name="box" type="box" size=".1 .1 .1" mass="1" gap=".001" {on_geom}/></body>
      </worldbody>{pair}"""
    engine, data = engine_of(xml, timestep)
    advance(engine, data, 5.0)
    assert data.qpos[2] == pytest.approx(-0.1, abs=1e-5)
    assert np.abs(data.qvel).max() < 1e-9
    assert data.qfrc_adhesion[2] == pytest.approx(20.0, rel=1e-12)
    # 10.19 N of pressure less 20 N of adhesion on the ceiling: it pulls the body up by its weight.
    # The normal points from the ceiling to the body below it.
    assert engine.contacts(data).force[:, 0].sum() == pytest.approx(-WEIGHT, rel=1e-6)


def test_a_geom_adheres_only_within_its_own_reach():
    """A wider reach finds a fast ball early; it is pulled and reported only within its gap."""
    xml = """<option gravity="0 0 0"/><worldbody><geom type="plane" size="1 1 .1"/>
      <body pos="0 0 .115"><freejoint/>
        <geom size=".1" mass="1" gap=".01" adhesion="5"/></body></worldbody>"""
    engine, data = engine_of(xml, 2e-3)
    data.qvel[2] = -4.0
    data.qvel[5] = 40.0  # a spin, for which detection reaches farther than the ball will go
    assert engine.step(data).contacts == 1
    assert data.qvel[2] == pytest.approx(-4.0, rel=1e-12)
    assert len(engine.contacts(data)) == 0
    engine.step(data)
    # Now it is 7 mm above the floor, inside the gap of 10 mm: 5 N act until it lands.
    assert data.qfrc_adhesion[2] == pytest.approx(-5.0, rel=1e-12)
