"""Adhesion actuators: a force that pulls a body to what it touches, along the contact normals."""

import mujoco
import numpy as np
import pytest

import dashpot

TIMESTEPS = (2e-3, 5e-3)
WEIGHT = 9.81  # N, of 1 kg

CEILING = """<worldbody>
  <geom name="ceiling" type="box" size="1 1 .1" pos="0 0 .1"/>
  <body name="box" pos="0 0 -.1"><freejoint/>
    <geom name="box" type="box" size=".1 .1 .1" mass="1" gap=".001"/></body>
</worldbody><actuator><adhesion body="box" ctrlrange="0 1" gain="{gain}"/></actuator>"""

# A cup that a hand holds, or that is fixed, on top of a box that hangs from it.
CUP = """<worldbody><body name="cup" pos="0 0 .5" mocap="{mocap}">
    <geom name="cup" type="cylinder" size=".02 .01" mass=".1" friction=".8" gap="{gap}"/></body>
  <body name="box" pos="{offset} 0 .44"><freejoint/>
    <geom name="box" type="box" size=".2 .1 .05" mass=".5" friction=".8"/></body>
</worldbody><actuator><adhesion body="cup" ctrlrange="0 1" gain="20"/></actuator>"""
CUP_RADIUS = 0.02  # m
CUP_PRESSURE = 20.0 - 0.5 * WEIGHT  # N, what of the pull the weight of the box leaves

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


def cup(
    timestep: float,
    gap: float = 0.0,
    offset: float = 0.0,
    mocap: bool = False,
    stiffness: float | None = None,
) -> tuple[dashpot.Engine, mujoco.MjData]:
    xml = CUP.format(gap=gap, offset=offset, mocap="true" if mocap else "false")
    engine, data = engine_of(xml, timestep)
    # Pressed on far enough to be pulled at all without a gap.
    data.qpos[2] += 2e-6
    if stiffness is not None:
        engine.set_pair_material("cup", "box", dashpot.Material(stiffness=stiffness))
    return engine, data


def advance(engine: dashpot.Engine, data: mujoco.MjData, duration: float) -> None:
    engine.step(data, round(duration / engine.model.opt.timestep))


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_body_hangs_from_a_ceiling_by_more_adhesion_than_its_weight(timestep):
    engine, data = engine_of(CEILING.format(gain=2 * WEIGHT), timestep)
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
@pytest.mark.parametrize(("gap", "stiffness"), [(0.0, 1e5), (0.001, None)])
@pytest.mark.parametrize("offset", [0.0, 0.003])
def test_what_hangs_from_a_round_cup_is_at_rest(timestep, gap, stiffness, offset):
    """The pull acts amid the points of the rim that bear it: it makes no torque about them."""
    engine, data = cup(timestep, gap=gap, offset=offset, stiffness=stiffness)
    advance(engine, data, 2.0)
    held = data.qpos.copy()
    for _ in range(100):
        engine.step(data)
        assert np.abs(data.qvel).max() < 1e-8  # rad/s and m/s; it was 0.005 to 0.03
        # About the centre of the box the pull has the arm by which the cup is off.
        assert data.qfrc_actuator[2] == pytest.approx(20.0, rel=1e-6)
        assert data.qfrc_actuator[4] == pytest.approx(20.0 * offset, abs=1e-6)
    advance(engine, data, 2.0)
    np.testing.assert_allclose(data.qpos, held, rtol=0.0, atol=1e-8)
    assert engine.contacts(data).force[:, 0].sum() == pytest.approx(CUP_PRESSURE, rel=1e-6)


@pytest.mark.parametrize("timestep", TIMESTEPS)
@pytest.mark.parametrize(("gap", "limit"), [(0.0, 0.5), (0.001, 1.0)])
def test_a_round_cup_peels_off_where_its_rim_opens(timestep, gap, limit):
    """A slowly growing moment M shifts the pressure N by M / N.

    Without a gap, points that open pull no more, and the others lose their load one by one. The
    pressure of six points with the mean square x^2 = R^2 / 2 is N (1 + x (M / N) / (R^2 / 2)) / 6:
    zero at x = -R where M / N = R / 2. Within the gap all points pull, and the cup tips over the
    farthest one, at R.
    """
    engine, data = cup(timestep, gap=gap)
    advance(engine, data, 0.2)
    steps = round(4.0 / timestep)
    for i in range(steps):
        shift = 1.2 * i / steps  # in radii of the cup
        data.xfrc_applied[2, 4] = shift * CUP_RADIUS * CUP_PRESSURE
        engine.step(data)
        if 2.0 * abs(data.qpos[5]) > 0.002:  # rad; rigid points give way a hundredth of that
            break
    # What tips takes its time while the moment grows.
    assert limit - 0.01 < shift < limit + 0.06


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_round_cup_holds_against_shear_up_to_the_friction_of_its_pressure(timestep):
    limit = 0.8 * CUP_PRESSURE
    for force, slides in ((0.99 * limit, False), (1.02 * limit, True)):
        engine, data = cup(timestep)
        advance(engine, data, 0.2)
        # In the plane of contact, 5 cm above the centre: it slides and does not tip.
        data.xfrc_applied[2, :5] = force, 0.0, 0.0, 0.0, 0.05 * force
        advance(engine, data, 0.1)
        if slides:
            assert data.qvel[0] == pytest.approx(0.1 * 0.02 * limit / 0.5, rel=0.1)
        else:
            advance(engine, data, 1.0)
            assert np.abs(data.qvel).max() < 1e-8


def test_a_hand_that_shakes_a_round_cup_keeps_what_it_holds():
    """At 1 to 2 m/s^2 in all directions the pressure stays on the whole rim and nothing slips."""
    engine, data = cup(2e-3, mocap=True)
    start = data.mocap_pos[0].copy()
    rate = 2 * np.pi * 3.0  # rad/s

    def shake(steps: int) -> np.ndarray:
        places = []
        for _ in range(steps):
            t = data.time + 2e-3
            swing = np.sin(rate * t), np.sin(1.3 * rate * t), 0.5 * np.sin(0.7 * rate * t)
            data.mocap_pos[0] = start + min(t, 1.0) / rate**2 * np.array(swing)
            before = data.qpos[:3].copy()
            engine.step(data)
            places.append(before - data.xpos[1])
        return np.array(places)

    shake(1000)
    places = shake(9000)
    # Rigid contacts give by some 0.1 um under the pressure, and by parts of it as it moves over
    # the rim.
    assert np.ptp(places, axis=0).max() < 1.5e-6


def test_adhesion_goes_by_positions_alone():
    """A spin left over in the data, at which the other side would come down, changes nothing."""
    xml = """<option gravity="0 0 0"/><worldbody>
      <geom type="box" size=".5 .5 .1" pos="0 0 -.1"/>
      <body name="body"><freejoint/>
        <geom type="cylinder" size=".05 .05" mass="1" gap=".06"/></body></worldbody>
      <actuator><adhesion body="body" gain="5" ctrlrange="0 1"/></actuator>"""
    forces = []
    for spin in (0.0, -350.0):
        engine, data = engine_of(xml, 2e-3)
        for now in (spin, 0.0):
            data.qpos[:] = 0.0, 0.0, 0.062, np.cos(0.1), 0.0, np.sin(0.1), 0.0
            data.qvel[:] = 0.0, 0.0, 0.0, 0.0, now, 0.0
            engine.step(data)
        forces.append(data.qfrc_actuator.copy())
    assert forces[0][2] == pytest.approx(-5.0, rel=1e-9)
    np.testing.assert_array_equal(forces[0], forces[1])


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
