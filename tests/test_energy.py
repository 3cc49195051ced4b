"""The energy ledger: kinetic + potential + elastic + dissipated is constant in passive scenes."""

import mujoco
import numpy as np
import pytest

import dashpot
from scene import GRAVITY, free_body, mjcf
from scenes import slide
from simulate import make_engine


def total(energy) -> float:
    return (
        energy.kinetic
        + energy.potential
        + energy.elastic
        + energy.dissipated_normal
        + energy.dissipated_friction
        + energy.dissipated_recovery
    )


def scene(bodies, timestep, material):
    model = mujoco.MjModel.from_xml_string(mjcf(bodies))
    model.opt.timestep = timestep
    engine = dashpot.Engine(model)
    for geom in range(1, model.ngeom):
        engine.set_material(geom, material)
    return engine, engine.make_data()


@pytest.mark.parametrize("timestep", [0.0005, 0.002, 0.010])
def test_a_bouncing_ball_dissipates_what_it_loses(timestep):
    """One contact: the ledger is exact and all loss is in the dashpot."""
    ball = free_body("ball", 'type="sphere" size="0.1" mass="1" condim="1"', (0, 0, 1.1))
    engine, data = scene(ball, timestep, dashpot.Material(1e4, restitution=0.6))
    start = total(engine.energy(data))
    last = 0.0
    for _ in range(40):
        engine.step(data, nstep=max(1, round(0.05 / timestep)))
        energy = engine.energy(data)
        assert total(energy) == pytest.approx(start, abs=1e-9 * GRAVITY)
        assert energy.dissipated_normal >= last - 1e-12  # rounding: dashpots never give back
        assert energy.elastic >= 0
        last = energy.dissipated_normal
    assert last > 0.5 * GRAVITY
    assert engine.energy(data).dissipated_friction == 0


@pytest.mark.parametrize("timestep", [0.001, 0.005])
def test_a_tumbling_box_closes_the_ledger(timestep):
    box = 'type="box" size="0.05 0.08 0.03" mass="0.5" friction="0.4"'
    quat = np.array([0.8, 0.3, 0.4, 0.33]) / np.linalg.norm([0.8, 0.3, 0.4, 0.33])
    bodies = free_body("box", box, (0, 0, 0.5), quat=quat)
    engine, data = scene(bodies, timestep, dashpot.Material(2e4, damping_ratio=0.2))
    data.qvel[:] = [1, 0.5, 0, 5, -3, 2]
    energy = engine.energy(data)
    start, turned_over = total(energy), energy.kinetic + 0.5 * GRAVITY * 0.5
    for _ in range(30):
        engine.step(data, nstep=round(0.1 / timestep))
        energy = engine.energy(data)
        # 0.1 % of the energy turned over.
        assert total(energy) == pytest.approx(start, abs=1e-3 * turned_over)
    assert energy.dissipated_friction > 0
    assert energy.kinetic < 1e-6


@pytest.mark.parametrize("timestep", [0.001, 0.010])
def test_friction_takes_all_of_a_sliding_box(timestep):
    box = slide()
    engine = make_engine(box, box.model(timestep))
    data = engine.make_data()
    data.qvel[0] = 1.0
    engine.step(data, nstep=round(1.0 / timestep))
    energy = engine.energy(data)
    # Sags and friction springs turn over m g times 2 um: 1e-4 of 0.5 J and less.
    assert energy.dissipated_friction == pytest.approx(0.5, rel=1e-3)
    assert energy.kinetic < 1e-12


def test_static_elastic_energy():
    """A ball at rest on stiffness k stores (m g)^2 / 2 k."""
    ball = free_body("ball", 'type="sphere" size="0.1" mass="1"', (0, 0, 0.1))
    engine, data = scene(ball, 0.002, dashpot.Material(1e4))
    engine.step(data, nstep=1000)
    energy = engine.energy(data)
    assert energy.elastic == pytest.approx(GRAVITY**2 / 2e4, rel=1e-9)
    # Sinking freed (m g)^2 / k: the other half went to the dashpot.
    assert energy.dissipated_normal == pytest.approx(GRAVITY**2 / 2e4, rel=1e-6)


def test_clearing_data_clears_the_ledger():
    ball = free_body("ball", 'type="sphere" size="0.1" mass="1"', (0, 0, 0.3))
    engine, data = scene(ball, 0.002, dashpot.Material(1e4))
    engine.step(data, nstep=500)
    assert engine.energy(data).dissipated_normal > 0
    mujoco.mj_resetData(engine.model, data)
    assert engine.energy(data).dissipated_normal == 0


@pytest.mark.parametrize("friction", [0.1, 0.4, 1.0])
@pytest.mark.parametrize("tangential_damping_ratio", [0.0, 0.1, 1.0])
@pytest.mark.parametrize(("slide", "spin"), [(0.1, 0), (0.5, 0), (2.0, 0), (0.5, 5), (0, 5)])
def test_friction_of_an_oblique_impact_takes_energy(
    slide, spin, friction, tangential_damping_ratio
):
    """An elastic ball thrown obliquely at the floor: whatever is lost, friction took it."""
    ball = free_body("ball", 'type="sphere" size="0.1" mass="1"', (0, 0, 0.1001))
    material = dashpot.Material(
        1e5,
        restitution=1.0,
        friction=friction,
        tangential_damping_ratio=tangential_damping_ratio,
    )
    engine, _ = scene(ball, 2e-4, material)
    engine.set_material("floor", dashpot.Material(friction=friction))
    engine.model.opt.gravity[:] = 0
    data = engine.make_data()
    data.qvel[:] = [slide, 0, -1, 0, spin, 0]
    before = engine.energy(data)
    for _ in range(100):
        engine.step(data)
        after = engine.energy(data)
        # Within a contact, what springs store is known to the square of the micro-step.
        assert after.dissipated_friction >= -1e-6 * before.kinetic
    assert data.qvel[2] > 0.99  # it has left
    assert before.kinetic - after.kinetic == pytest.approx(after.dissipated_friction, abs=1e-11)
    assert after.kinetic < before.kinetic


@pytest.mark.parametrize("stiffness", [1e3, 1e4])
@pytest.mark.parametrize(("first", "second"), [("box", "box"), ("capsule", "box")])
def test_what_meets_corner_by_corner_gains_no_energy(first, second, stiffness):
    """Two elastic bodies in a closed room; overlaps are a tenth of their size.

    Corners that come in deep beside one that is compressed inherited its compression too, and
    energies rose by up to 70 %.
    """
    shapes = {
        "box": 'type="box" size=".08 .05 .05"',
        "capsule": 'type="capsule" size=".04 .05"',
    }
    r = 0.3
    walls = "".join(
        f'<geom type="plane" size="1 1 1" zaxis="{-x} {-y} {-z}" pos="{x * r} {y * r} {z * r}"/>'
        for axis in np.eye(3)
        for x, y, z in (axis, -axis)
    )
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option gravity="0 0 0" timestep="0.0005"/><worldbody>{walls}
      <body pos="-.12 0 0"><freejoint/><geom {shapes[first]} mass="1"/></body>
      <body pos=".12 0 0"><freejoint/><geom {shapes[second]} mass="1"/></body>
      </worldbody></mujoco>""")
    for seed in range(2):
        engine = dashpot.Engine(model)
        elastic = dashpot.Material(stiffness=stiffness, restitution=1.0, friction=0.0)
        for geom in range(model.ngeom):
            engine.set_material(geom, elastic)
        data = engine.make_data()
        data.qvel[:] = np.random.default_rng(seed).normal(size=12) * np.tile(
            [2.0] * 3 + [6.0] * 3, 2
        )
        energy = engine.energy(data)
        start = least = energy.kinetic
        rise = most_stored = 0.0
        for _ in range(500):
            engine.step(data, nstep=10)
            energy = engine.energy(data)
            most_stored = max(most_stored, energy.elastic)
            least = min(least, energy.kinetic + energy.elastic)
            rise = max(rise, energy.kinetic + energy.elastic - least)
        # They met walls or each other, and are in the room still.
        assert most_stored > 0.05 * start
        assert np.abs(data.qpos.reshape(2, 7)[:, :3]).max() < r
        # Geometry is frozen over a step, and bodies turn by a hundredth of a radian in it.
        assert rise < 0.06 * start
