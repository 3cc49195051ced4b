"""Flexes: contacts that reach many vertices, equalities of edges, vertices and strain."""

import copy

import mujoco
import numpy as np
import pytest

import dashpot

IS_4 = mujoco.mj_version() >= 4000000
INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION
WEIGHT = 9.81  # N, of a flex of 1 kg

SCENE = """<mujoco><option timestep="1e-3" gravity="{gravity}"/><worldbody>
  <geom name="floor" type="plane" size="2 2 .1" friction=".5"/>{more}
  <flexcomp name="soft" type="grid" {grid} radius=".005" mass="1" {attributes}>{inner}
    <contact condim="3" selfcollide="none" friction=".5"/></flexcomp>
</worldbody></mujoco>"""
BOX = 'count="4 4 4" spacing=".05 .05 .05" pos="0 0 .1" dim="3"'
CLOTH = 'count="6 6 1" spacing=".05 .05 .05" pos="0 0 {height}" dim="2"'
ELASTIC = '<elasticity young="2e4" poisson=".1" damping=".01"/>'


def engine_of(
    grid: str, inner: str, attributes: str = "", more: str = "", gravity: str = "0 0 -9.81"
) -> tuple[dashpot.Engine, mujoco.MjData]:
    xml = SCENE.format(grid=grid, inner=inner, attributes=attributes, more=more, gravity=gravity)
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    return engine, engine.make_data()


def total_force(contacts: dashpot.Contacts) -> np.ndarray:
    """Return the force on the second sides of all contacts, world."""
    return np.einsum("nij,ni->j", contacts.frame, contacts.force)


@pytest.mark.parametrize("inner", [ELASTIC, '<edge equality="strain"/>'])
def test_a_soft_box_rests_with_its_weight_on_the_floor(inner):
    engine, data = engine_of(BOX, inner, 'dof="trilinear"')
    engine.step(data, 3000)
    contacts = engine.contacts(data)
    assert len(contacts) == 16
    np.testing.assert_array_equal(contacts.geom, np.tile([0, -1], (16, 1)))
    np.testing.assert_array_equal(contacts.flex, np.tile([-1, 0], (16, 1)))
    # The floor is the first side, so the force acts on the flex. Damped to rest in 3 s.
    np.testing.assert_allclose(total_force(contacts), [0, 0, WEIGHT], atol=1e-6)
    assert contacts.compression.max() < 1e-6
    assert np.abs(data.qvel).max() < 1e-9


def test_a_soft_box_sticks_on_a_slope():
    """10 degrees, friction 0.5."""
    angle = np.deg2rad(10)
    gravity = f"{9.81 * np.sin(angle)} 0 {-9.81 * np.cos(angle)}"
    engine, data = engine_of(BOX, ELASTIC, 'dof="trilinear"', gravity=gravity)
    # Until 3.16 MuJoCo's boxes are too soft in shear, and come to rest later.
    engine.step(data, 3000 if mujoco.mj_version() >= 3016000 else 9000)
    start = data.qpos.copy()
    engine.step(data, 3000)
    # To rounding of 3,000 steps; a regularised cone would creep.
    np.testing.assert_allclose(data.qpos, start, atol=1e-10)
    force = total_force(engine.contacts(data))
    expected = [-WEIGHT * np.sin(angle), 0.0, WEIGHT * np.cos(angle)]
    np.testing.assert_allclose(force, expected, atol=1e-6)


@pytest.mark.parametrize(
    "edges",
    [
        "true",
        pytest.param(
            "vert",
            marks=pytest.mark.skipif(IS_4, reason="MuJoCo 4.0 removed flexvert equalities"),
        ),
    ],
)
def test_momentum_of_a_cloth_on_a_ball_changes_by_weight_and_contact_alone(edges):
    grid = CLOTH.format(height=0.3)
    ball = '<geom name="ball" size=".1" pos="0 0 .15" friction="1"/>'
    engine, data = engine_of(grid, f'<edge equality="{edges}"/>', more=ball)
    mass = engine.model.body_mass[1:]
    engine.step(data, 200)
    upward = touched = 0.0
    start = float(mass @ data.qvel[2::3])
    for _ in range(300):
        engine.step(data)
        contacts = engine.contacts(data)
        upward += float(total_force(contacts)[2]) * 1e-3
        touched = max(touched, len(contacts))
    assert touched > 0
    change = float(mass @ data.qvel[2::3]) - start
    # Edge rows push their two ends alike and opposite; both sides are sums of the same impulses.
    assert change == pytest.approx(upward - WEIGHT * 0.3, abs=1e-9)
    if edges == "true":  # the other kind keeps means about vertices
        np.testing.assert_allclose(data.flexedge_length, engine.model.flexedge_length0, rtol=0.01)


def rope(
    count: int, *, pins: str = "", gravity: float = WEIGHT, timestep: float
) -> tuple[dashpot.Engine, mujoco.MjData]:
    """Return a rope of 1 kg along x whose edges, of 0.1 m, keep their lengths."""
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="{timestep}" gravity="0 0 {-gravity}"/><worldbody>
      <flexcomp name="rope" type="grid" dim="1" count="{count} 1 1" spacing=".1 .1 .1" mass="1"
        radius=".005"><edge equality="true"/><contact selfcollide="none"/>{pins}</flexcomp>
      </worldbody></mujoco>""")
    )
    return engine, engine.make_data()


@pytest.mark.parametrize("timestep", [0.0005, 0.001, 0.002])
def test_an_edge_whirls_about_its_middle(timestep):
    """Two ends at 1 m/s, 0.1 m apart: 20 rad/s for a second, in steps of 0.01 to 0.04 rad."""
    engine, data = rope(2, gravity=0.0, timestep=timestep)
    data.qvel[2], data.qvel[5] = -1.0, 1.0
    start = engine.energy(data)
    turned = 0.0
    edge = np.array([1.0, 0.0])
    for _ in range(round(1.0 / timestep)):
        engine.step(data)
        assert data.flexedge_length[0] == pytest.approx(0.1, abs=2e-6)
        now = np.array([0.1 + data.qpos[3] - data.qpos[0], data.qpos[5] - data.qpos[2]])
        turned += np.arctan2(edge[0] * now[1] - edge[1] * now[0], edge @ now)
        edge = now
    # Second order in the turn of a step.
    assert turned == pytest.approx(20.0, rel=0.2 * (20.0 * timestep) ** 2)
    # Velocities at the end of a step lack the second half of the trapezoidal rule.
    assert engine.energy(data).mechanical == pytest.approx(
        start.kinetic, rel=(20.0 * timestep) ** 2
    )


@pytest.mark.parametrize("timestep", [0.001, 0.002])
@pytest.mark.parametrize("count", [4, 7, 9])
def test_a_taut_rope_gains_no_energy(count, timestep):
    """Exactly straight between two pins, under its weight: it can only stretch."""
    engine, data = rope(count, pins=f'<pin id="0 {count - 1}"/>', timestep=timestep)
    start = engine.energy(data).mechanical
    for _ in range(round(1.5 / timestep)):
        engine.step(data)
        # A hundredth of the weight times an edge.
        assert engine.energy(data).mechanical - start <= 0.01 * WEIGHT * 0.1
        # It is taut still: a rope that falls gains nothing either.
        np.testing.assert_allclose(data.flexedge_length, 0.1, rtol=2e-3)


def test_a_box_comes_to_rest_on_a_cloth_pinned_at_its_corners():
    grid = 'count="7 7 1" spacing=".06 .06 .06" pos="0 0 .4" dim="2"'
    inner = '<pin id="0 6 42 48"/><edge equality="true"/>'
    box = '<body pos="0 0 .5"><freejoint/><geom type="box" size=".05 .05 .05" mass=".5"/></body>'
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string(
            SCENE.format(grid=grid, inner=inner, attributes="", more=box, gravity="0 0 -9.81")
            .replace('timestep="1e-3"', 'timestep="2e-3"')
            .replace('mass="1"', 'mass=".2"')
        )
    )
    data = engine.make_data()
    engine.step(data, 2000)
    swing, carried = [], []
    for _ in range(500):
        engine.step(data)
        swing.append(0.5 * 0.5 * data.qvel[:3] @ data.qvel[:3])
        on_box = engine.contacts(data, geom=1)
        assert (on_box.flex[:, 1] == 0).all()
        carried.append(total_force(on_box)[2])
    # Of the box, which falls with its weight over 45 mm. The net trembles on with 1 to 60 mJ: edges
    # without damping at this step do, those that bear 0.5 kg without contacts too, in each MuJoCo
    # alike. Which tremble it ends in depends on the start.
    assert np.mean(swing) < 1e-3 * 0.5 * 9.81 * 0.045
    # The box, the first side, presses on the cloth by its weight, in the mean of a second: but for
    # 15 mm/s that it may still swing by.
    assert np.mean(carried) == pytest.approx(-0.5 * 9.81, rel=3e-3)


def test_a_ball_on_a_cloth_on_the_floor_is_carried_by_the_cloth():
    ball = '<body pos="0 0 .08"><freejoint/><geom name="ball" size=".05" mass=".2"/></body>'
    engine, data = engine_of(CLOTH.format(height=0.01), '<edge equality="true"/>', more=ball)
    engine.step(data, 1200)
    on_ball = engine.contacts(data, geom="ball")
    assert (on_ball.flex[:, 1] == 0).all()
    # The ball is the first side: the cloth is pushed down by its weight, the floor carries both.
    assert total_force(on_ball)[2] == pytest.approx(-0.2 * 9.81, rel=1e-3)
    assert total_force(engine.contacts(data, geom="floor"))[2] == pytest.approx(
        1.2 * 9.81, rel=1e-3
    )


@pytest.mark.parametrize("side", [2, 4, 6])
def test_a_cloth_of_many_trees_rolls_out_copies_and_saves_as_it_steps(side, tmp_path):
    """Its vertices are a kinematic tree each in MuJoCo, and one in the engine."""
    edges = '<edge equality="true"/>'
    grid = f'count="{side} {side} 1" spacing=".05 .05 .05" pos="0 0 .005" dim="2"'
    engine, data = engine_of(grid, edges)
    assert engine.model.ntree == side**2
    state = np.zeros(mujoco.mj_stateSize(engine.model, INTEGRATION))
    mujoco.mj_getState(engine.model, data, state, INTEGRATION)
    rolled, _ = dashpot.rollout(engine, state, nstep=200, nthread=1, with_memory=True)
    other = copy.copy(engine)
    copied = other.make_data()
    other.step(copied, 200)
    engine.step(data, 200)
    assert len(engine.contacts(data)) > 0
    mujoco.mj_getState(engine.model, data, state, INTEGRATION)
    assert np.array_equal(rolled[0, -1], state)
    assert np.array_equal(copied.qpos, data.qpos)
    mujoco.mj_saveModel(engine.model, str(tmp_path / "cloth.mjb"))
    loaded = mujoco.MjModel.from_binary_path(str(tmp_path / "cloth.mjb"))
    assert loaded.nv == engine.model.nv


@pytest.mark.parametrize("count", [7, 15, 21])
def test_momentum_of_a_large_cloth_changes_by_weight_and_contact_alone(count):
    """Up to 1,323 degrees of freedom that contacts and edges couple; the cloth drapes a ball."""
    grid = f'count="{count} {count} 1" spacing=".05 .05 .05" pos="0 0 .26" dim="2"'
    ball = '<geom name="ball" size=".1" pos="0 0 .15" friction="1"/>'
    engine, data = engine_of(grid, '<edge equality="true"/>', more=ball)
    mass = engine.model.body_mass[1:]
    upward = touched = 0.0
    for _ in range(60):
        engine.step(data)
        contacts = engine.contacts(data)
        upward += float(total_force(contacts)[2]) * 1e-3
        touched = max(touched, len(contacts))
    assert touched > 0
    assert mass @ data.qvel[2::3] == pytest.approx(upward - WEIGHT * 0.06, abs=1e-3)


def test_free_flexes_of_any_size_fall_freely():
    """Nothing joins the vertices but rows, of which there are none in the air."""
    grid = 'count="15 15 1" spacing=".05 .05 .05" pos="0 0 1" dim="2"'
    engine, data = engine_of(grid, "")
    engine.step(data, 50)
    time = 50 * engine.model.opt.timestep
    fall = np.tile([0.0, 0.0, -0.5 * 9.81 * time**2], len(data.qpos) // 3)
    np.testing.assert_allclose(data.qpos, fall, rtol=0, atol=1e-12)
