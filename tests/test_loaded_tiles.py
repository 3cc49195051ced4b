"""Tiles that are bodies themselves sink under what slides over them; the next does not catch it."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine, Material

FRICTION = 0.2
SPEED = 1.5
# Half sizes of a plank; they lie end to end along x, flush.
LENGTH, WIDTH, HEIGHT = 0.1, 0.15, 0.01


def planks_and_box(timestep, mass, *, count, dock=None, layers=1):
    """Return a model of a box of `mass` on the first of `count` free planks on a floor.

    `dock`: by how much a static block beyond the last plank is higher.
    """
    bodies = "".join(
        f"""<body name="plank{i}_{layer}" pos="{2 * LENGTH * i} 0 {HEIGHT * (2 * layer + 1)}">
        <freejoint/><geom name="plank{i}_{layer}" type="box" size="{LENGTH} {WIDTH} {HEIGHT}"
        mass="0.5"/></body>"""
        for i in range(count)
        for layer in range(layers)
    )
    tops = [f"plank{i}_{layers - 1}" for i in range(count)]
    if dock is not None:
        half = HEIGHT * layers + 0.5 * dock
        bodies += f"""<geom name="dock" type="box" size="0.3 {WIDTH} {half}"
        pos="{2 * LENGTH * count - LENGTH + 0.3} 0 {half}"/>"""
        tops.append("dock")
    pairs = "".join(
        f'<pair geom1="box" geom2="{top}" friction="{FRICTION} {FRICTION} 0 0 0"/>' for top in tops
    )
    return mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{timestep}"/><worldbody>
      <geom name="floor" type="plane" size="9 9 1"/>{bodies}
      <body name="box" pos="0 0 {2 * HEIGHT * layers + 0.04}"><freejoint/>
        <geom name="box" type="box" size=".04 .04 .04" mass="{mass}"/></body>
      </worldbody><contact>{pairs}</contact></mujoco>""")


def slide(engine, *, way):
    """Settle, throw the box along x; return the worst error of its speed (m/s), its way, data."""
    model, data = engine.model, engine.make_data()
    timestep = model.opt.timestep
    engine.step(data, nstep=round(0.3 / timestep))
    start = data.body("box").xpos[0]
    dof = model.body("box").dofadr[0]
    data.qvel[dof] = SPEED
    worst, time = 0.0, 0.0
    while time < 0.7 and data.body("box").xpos[0] - start < way:
        engine.step(data)
        time += timestep
        expected = max(0.0, SPEED - FRICTION * 9.81 * time)
        worst = max(worst, abs(data.qvel[dof] - expected))
    return worst, data.body("box").xpos[0] - start, data


@pytest.mark.parametrize("timestep", [0.002, 0.005])
@pytest.mark.parametrize(("layers", "mass"), [(1, 0.5), (1, 20.0), (3, 2.0)])
def test_a_box_slides_over_free_planks_as_over_a_floor(layers, mass, timestep):
    """A plank sinks by 5 to 50 um under the box: it caught at the next one, and shoved it."""
    engine = Engine(planks_and_box(timestep, mass, count=4, layers=layers))
    worst, _, data = slide(engine, way=0.55)
    # Down from plank to plank: at a slope of those 50 um over the length of the box, g sin(slope)
    # in 0.1 s, and as much from the turn.
    assert worst < 0.012
    for i in range(4):
        assert data.body(f"plank{i}_{layers - 1}").xpos[0] == pytest.approx(
            2 * LENGTH * i, abs=2e-4
        )


@pytest.mark.parametrize("timestep", [0.001, 0.005])
@pytest.mark.parametrize("stiffness", [1e5, 1e6])
def test_so_it_does_where_all_is_soft(stiffness, timestep):
    engine = Engine(planks_and_box(timestep, 2.0, count=4))
    for geom in range(engine.model.ngeom):
        engine.set_material(geom, Material(stiffness))
    for i in range(4):
        engine.set_pair_material("box", f"plank{i}_0", Material(stiffness, friction=FRICTION))
    worst, _, _ = slide(engine, way=0.55)
    assert worst < 0.012


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_from_a_plank_to_a_dock_there_is_no_seam_either(timestep):
    worst, _, _ = slide(Engine(planks_and_box(timestep, 2.0, count=1, dock=0.0)), way=0.4)
    assert worst < 0.012


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("dock", [1e-4, 1e-3])
def test_a_dock_that_is_higher_stops_it(dock, timestep):
    """By more than the plank sinks: the box hits its side, and may tip over its edge.

    A cube that turns about that edge is left with 3/8 of its speed, at most.
    """
    worst, _, _ = slide(Engine(planks_and_box(timestep, 2.0, count=1, dock=dock)), way=0.15)
    at_the_dock = np.sqrt(SPEED**2 - 2 * FRICTION * 9.81 * (LENGTH - 0.04))
    assert worst > 0.9 * (1 - 3 / 8) * at_the_dock


def test_each_layer_adds_its_sag():
    """Three layers under 20 kg sink by three times as much, and the next stack is passed."""
    engine = Engine(planks_and_box(0.002, 20.0, count=2, layers=3))
    data = engine.make_data()
    engine.step(data, nstep=200)
    tops = np.array([data.body(f"plank{i}_2").xpos[2] for i in range(2)])
    step = tops[1] - tops[0]
    contacts = engine.contacts(data)
    box = engine.geom_id("box")
    depth = -contacts.gap[(contacts.geom == box).any(axis=1)].min()
    # Without the sag of all layers the step would be one up for the box.
    assert step > 1.5 * depth
    worst, _, _ = slide(engine, way=0.25)
    # It goes down and up by some 0.2 mm over its length, and is turned by that.
    assert worst < 0.03
