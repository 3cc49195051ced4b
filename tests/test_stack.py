"""Stacks of boxes: exact sags, and heavy on light."""

import mujoco
import numpy as np
import pytest

import dashpot
from scenes import stack
from simulate import DASHPOT, measure

TIMESTEPS = (0.001, 0.002, 0.005, 0.010)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_ten_boxes_sag_exactly(timestep):
    numbers = measure(stack(duration=6.0), DASHPOT, timestep)
    assert numbers["bottom sag"] == pytest.approx(0.24525e-3, rel=5e-5)  # four digits
    # Every level carries the boxes above it: 4 k sag = n m g. The slowest mode decays at 3 1/s.
    assert numbers["sag error"] <= 5e-5
    assert numbers["tilt"] <= 1e-4


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_heavy_box_on_nine_light_rigid_ones_stands_and_does_not_sink(timestep):
    numbers = measure(
        stack(masses=(1.0,) * 9 + (100.0,), stiffness=None, duration=4.0), DASHPOT, timestep
    )
    assert numbers["tilt"] <= 5e-3  # of a box width of 0.1 m
    # Half a millimetre per box, 0.5 % of its width; MuJoCo's default loses 0.1 mm at the bottom.
    assert numbers["height loss"] <= 5e-3


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_inelastic_boxes_do_not_sink(timestep):
    """Of rigid contacts without restitution, which give way in stiffness to their damping."""
    half, count = 0.1, 5
    boxes = "".join(
        f'<body pos="0 0 {half + 2 * half * i}"><freejoint/>'
        f'<geom name="{i}" type="box" size="{half} {half} {half}" mass="1"/></body>'
        for i in range(count)
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{timestep}"/><worldbody><geom type="plane" size="0 0 1"/>'
        f"{boxes}</worldbody></mujoco>"
    )
    engine = dashpot.Engine(model)
    for i in range(count):
        engine.set_material(str(i), dashpot.Material(restitution=0.0))
    data = engine.make_data()
    engine.step(data, nstep=round(2.0 / timestep))
    sag = half + 2 * half * np.arange(count) - data.qpos.reshape(count, 7)[:, 2]
    # One weight presses a body in by 1e-4 of its radius at most, the bottom one bears five.
    assert 0.0 < sag[0] <= count * 1e-4 * np.sqrt(3.0) * half * (1.0 + 1e-6)
    assert np.abs(data.qvel).max() < 1e-9


@pytest.mark.parametrize("timestep", [0.0005, 0.001, 0.002])
@pytest.mark.parametrize("heavy", [5.0, 20.0, 100.0])
def test_an_inelastic_plate_does_not_sink_under_what_is_heavier(heavy, timestep):
    """The plate's own weight alone told how stiff the floor has to be: up to 3 mm at 2 ms."""
    half, thick, mass = 0.1, 0.01, 0.5
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}"/><worldbody>
        <geom name="floor" type="plane" size="0 0 1"/>
        <body pos="0 0 {thick}"><freejoint/>
          <geom name="plate" type="box" size="{half} {half} {thick}" mass="{mass}"/></body>
        <body pos="0 0 {2 * thick + half}"><freejoint/>
          <geom name="block" type="box" size="{half} {half} {half}" mass="{heavy}"/></body>
        </worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    for geom in ("floor", "plate", "block"):
        engine.set_material(geom, dashpot.Material(restitution=0.0))
    data = engine.make_data()
    engine.step(data, nstep=round(1.0 / timestep))
    # A weight presses a contact in by 1e-4 of its body's radius if it bears that alone. Here four
    # corners share it, with a seventh of the mass each: 7/4 of that, and some for the plate's own.
    radius = np.sqrt(2 * half**2 + thick**2)
    assert 0.0 < thick - data.qpos[2] <= 2.2e-4 * radius
    assert np.abs(data.qvel).max() < 1e-3  # it settles as what is heavy on light parts does


def test_micro_steps_go_by_the_load_that_a_contact_bears():
    """A block of 10 kg beside a ball of 10 g could weigh on it, but it is the ball that rests."""
    model = mujoco.MjModel.from_xml_string("""
<mujoco><option timestep="0.002" cone="elliptic"/><worldbody>
 <geom type="plane" size="1 1 .1"/>
 <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="10"/></body>
 <body pos="0 0 .25"><freejoint/><geom name="ball" size=".05" mass=".01" condim="4"/></body>
</worldbody></mujoco>""")
    engine = dashpot.Engine(model)
    data = engine.make_data()
    lands = max(engine.step(data).microsteps for _ in range(100))
    rests = engine.step(data, 200)
    (ball,) = np.flatnonzero(np.any(data.contact.geom == model.geom("ball").id, axis=1))
    assert lands > 2 * rests.microsteps
    assert -0.001 * 0.05 <= data.contact.dist[ball] <= 0.0  # a thousandth of its radius
    assert data.qvel == pytest.approx(np.zeros(12), abs=1e-9)


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("restitution", [None, 0.0])
def test_sheets_of_a_deck_do_not_lie_in_each_other(restitution, timestep):
    """Twenty sheets of 88 x 64 x 0.5 mm: what one may sag went by its radius, 54 mm.

    All of them lay in one another, 9 mm below where they belong, and trembled.
    """
    sheets, half = 20, 0.00025
    bodies = "".join(
        f"""<body pos="0 0 {half * (1 + 2 * k)}"><freejoint/>
        <geom type="box" size=".044 .032 {half}" mass="9e-4" friction=".2"/></body>"""
        for k in range(sheets)
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}"/><worldbody>
        <geom type="plane" size="2 2 1" friction=".2"/>{bodies}</worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    for geom in range(model.ngeom if restitution is not None else 0):
        engine.set_material(geom, dashpot.Material(restitution=restitution))
    data = engine.make_data()
    engine.step(data, nstep=round(0.5 / timestep))
    height = data.qpos.reshape(sheets, 7)[:, 2]
    # A weight presses a contact in by 1e-3 of three half-thicknesses, 0.75 um, where it bears it
    # alone; the lowest four corners bear twenty, and the step from where it fell leaves as much.
    thickness = np.diff(np.r_[-half, height])
    assert thickness.min() > 2 * half - 0.25 * 2 * half
    assert np.all(np.abs(data.qpos.reshape(sheets, 7)[:, :2]) < 1e-3)
