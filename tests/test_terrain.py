"""Contacts with height fields: those of planes where they are flat, and rest."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dashpot import Engine
from dashpot.query import distance

GRAVITY = 9.81
CELLS = 40
HALF = 2.0  # m, of the field's sides
SHAPES = {
    "box": ('type="box" size="0.05 0.04 0.03"', 0.03),
    "capsule": ('type="capsule" size="0.03 0.05" quat="1 0 1 0"', 0.03),
    "cylinder": ('type="cylinder" size="0.04 0.03"', 0.03),
    "lying cylinder": ('type="cylinder" size="0.03 0.05" quat="1 0 1 0"', 0.03),
    "sphere": ('type="sphere" size="0.03"', 0.03),
    "ellipsoid": ('type="ellipsoid" size="0.05 0.04 0.03"', 0.03),
    "prism": ('type="mesh" mesh="prism"', 0.02),
}


def prism():
    angle = 2 * np.pi * np.arange(5) / 5
    ring = 0.04 * np.column_stack([np.cos(angle), np.sin(angle)])
    return " ".join(f"{x:.6f} {y:.6f} {z}" for x, y in ring for z in (-0.02, 0.02))


def scene(shape, position, *, floor="field", quat=(1, 0, 0, 0), timestep=0.002, gravity=True):
    ground = {
        "field": '<geom name="ground" type="hfield" hfield="field" friction="0.9"/>',
        "plane": '<geom name="ground" type="plane" size="9 9 1" friction="0.9"/>',
    }[floor]
    geom, _ = SHAPES[shape]
    return mujoco.MjModel.from_xml_string(f"""
<mujoco><option timestep="{timestep}" gravity="0 0 {-GRAVITY if gravity else 0}"/>
<asset><hfield name="field" nrow="{CELLS + 1}" ncol="{CELLS + 1}" size="{HALF} {HALF} 1 0.1"/>
  <mesh name="prism" vertex="{prism()}"/></asset>
<worldbody>{ground}
  <body pos="{" ".join(map(str, position))}" quat="{" ".join(map(str, quat))}"><freejoint/>
    <geom {geom} mass="1" friction="0.9"/></body></worldbody></mujoco>""")


def place_heights(model, height):
    """Set the heights (m) of the field to height(x, y)."""
    at = np.linspace(-HALF, HALF, CELLS + 1)
    x, y = np.meshgrid(at, at)
    model.hfield_data[:] = height(x, y).ravel()


@pytest.mark.parametrize("shape", SHAPES)
def test_contacts_on_a_flat_field_are_those_on_a_plane(shape):
    rng = np.random.default_rng(0)
    for _ in range(20):
        turn = Rotation.from_rotvec([0, 0, rng.uniform(0, 6)]).as_quat(scalar_first=True)
        position = (*rng.uniform(-1, 1, size=2), SHAPES[shape][1] - 1e-5)
        found = []
        for floor in ("field", "plane"):
            engine = Engine(scene(shape, position, floor=floor, quat=turn, gravity=False))
            data = engine.make_data()
            engine.step(data)
            assert data.contact.frame[:, :3] == pytest.approx(
                np.tile([0.0, 0.0, 1.0], (data.ncon, 1)), abs=1e-9
            )
            assert data.contact.dist == pytest.approx(-1e-5, abs=2e-9)
            found.append(data.contact.pos[:, :2])
        on_field, on_plane = found
        if shape == "cylinder":  # other points of the rim, six of them
            assert np.linalg.norm(on_field - position[:2], axis=1) == pytest.approx(0.04)
            assert len(on_field) == 6
            continue
        assert len(on_field) == len(on_plane)
        apart = np.linalg.norm(on_field[:, None] - on_plane[None], axis=2)
        assert apart.min(axis=1).max() < 1e-6


@pytest.mark.parametrize("slope", [0.0, 0.3])
@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("shape", ["box", "cylinder", "prism"])
def test_what_lies_on_a_flat_field_rests(shape, timestep, slope):
    # With a point for every prism a box of 1 kg rattled on 0.4 W from recovery, at 0.1 m/s.
    normal = np.array([-slope, 0.0, 1.0]) / np.hypot(1.0, slope)
    height = SHAPES[shape][1] + 2e-3
    turn = Rotation.from_rotvec([0.0, -np.arctan(slope), 0.0]) * Rotation.from_rotvec([0, 0, 0.4])
    quat = turn.as_quat(scalar_first=True)
    model = scene(
        shape,
        np.array([0.03, 0.02, 0.03 * slope + 1.0]) + height * normal,
        quat=quat,
        timestep=timestep,
    )
    engine = Engine(model)
    place_heights(engine.model, lambda x, y: 1.0 + slope * x)
    data = engine.make_data()
    engine.step(data, nstep=round(1.0 / timestep))
    start, recovered = data.qpos.copy(), engine.energy(data).dissipated_recovery
    engine.step(data, nstep=round(1.0 / timestep))
    assert np.abs(data.qvel).max() < 1e-9
    # Heights are in single precision: of 1 m to 6e-8.
    assert data.qpos == pytest.approx(start, abs=1e-9)
    assert abs(engine.energy(data).dissipated_recovery - recovered) < 1e-9
    force = engine.contacts(data).force
    assert force[:, 0].sum() == pytest.approx(GRAVITY * normal[2], rel=1e-4)


@pytest.mark.parametrize("timestep", [0.001, 0.002])
@pytest.mark.parametrize("shape", ["ellipsoid", "sphere", "lying cylinder", "capsule"])
def test_what_rolls_on_a_flat_field_rolls_as_on_a_plane(shape, timestep):
    # A capsule had recovery put in, and dashpots take, three times its energy in 3 s.
    energies = []
    for floor in ("field", "plane"):
        engine = Engine(
            scene(shape, (-0.5, 0.03, SHAPES[shape][1]), floor=floor, timestep=timestep)
        )
        data = engine.make_data()
        # Capsules and cylinders lie along x and roll along y.
        is_round = shape in ("ellipsoid", "sphere")
        data.qvel[:] = [0.3, 0, 0, 0, 8, 0] if is_round else [0, 0.3, 0, -10, 0, 0]
        engine.step(data, nstep=round(2.0 / timestep))
        energy = engine.energy(data)
        energies.append(energy.kinetic + energy.potential)
        assert abs(energy.dissipated_recovery) < 1e-3
        assert 0.03 - 1e-4 < data.qpos[2] < 0.05  # it has not fallen through
        if shape == "sphere":  # slips until m v + I w / r are those of rolling
            assert data.qvel[0] == pytest.approx((0.3 + 0.4 * 0.03 * 8) / 1.4, rel=1e-4)
        elif not is_round:  # rolls from the start, at 10 rad/s on 3 cm
            assert data.qvel[1] == pytest.approx(0.3, rel=1e-4)
    assert energies[0] == pytest.approx(energies[1], rel=1e-3)


def test_capsule_rests_in_a_groove_on_both_its_sides():
    slope = 0.5
    radius = 0.03
    position = (0.0, 0.013, radius * np.hypot(1.0, slope))
    turn = Rotation.from_rotvec([0, 0, np.pi / 2]).as_quat(scalar_first=True)
    engine = Engine(scene("capsule", position, quat=turn))
    place_heights(engine.model, lambda x, y: slope * np.abs(x))
    data = engine.make_data()
    engine.step(data, nstep=1000)
    assert np.abs(data.qvel).max() < 1e-9
    contacts = engine.contacts(data)
    assert len(contacts.geom) == 4  # two ends on two sides, which hold its weight
    vertical = (contacts.frame[:, 0, 2] * contacts.force[:, 0]).sum()
    tangential = (contacts.frame[:, 1:, 2] * contacts.force[:, 1:3]).sum()
    assert vertical + tangential == pytest.approx(GRAVITY, rel=1e-6)


@pytest.mark.parametrize("shape", ["box", "capsule", "cylinder", "ellipsoid", "prism", "sphere"])
def test_nothing_sinks_into_rough_ground(shape):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        heights = 0.05 * rng.uniform(size=(CELLS + 1, CELLS + 1))
        quat = Rotation.random(random_state=rng).as_quat(scalar_first=True)
        engine = Engine(scene(shape, (0.02, 0.03, 0.15), quat=quat))
        place_heights(engine.model, lambda x, y, heights=heights: heights)
        data = engine.make_data()
        deepest = 0.0
        for _ in range(50):
            engine.step(data, nstep=20)
            mujoco.mj_kinematics(engine.model, data)
            deepest = min(deepest, distance(engine, data, "ground", 1).distance)
        # A part of the radius by which what faces and rims stand for may lie deeper, and the sag.
        assert deepest > -5e-4


def test_box_beneath_a_field_is_held_by_its_base():
    # The field is 0.1 m thick below its heights: a corner a hair in its base is not 0.1 m deep.
    engine = Engine(scene("box", (0.0, 0.0, -0.1 - 0.03 - 0.005)))
    engine.model.opt.gravity[2] = GRAVITY
    data = engine.make_data()
    engine.step(data, nstep=500)
    assert data.qpos[2] == pytest.approx(-0.1 - 0.03, abs=1e-4)


def test_box_beside_a_field_is_held_by_its_rim():
    # Not lifted to its top, 0.3 m above. Points on the sides of prisms are MuJoCo's: it drifts.
    engine = Engine(scene("box", (HALF + 0.05 + 0.005, 0.0, 0.2)))
    place_heights(engine.model, lambda x, y: 0.5 + 0.0 * x)
    engine.model.opt.gravity[:] = (-GRAVITY, 0.0, 0.0)
    data = engine.make_data()
    engine.step(data, nstep=500)
    assert data.qpos[0] == pytest.approx(HALF + 0.05, abs=1e-3)
    assert data.qpos[1:3] == pytest.approx([0.0, 0.2], abs=0.1)


def test_capsule_along_a_ridge_is_held_by_it():
    # Parallel to both slopes, it lies on neither of them.
    model = scene("capsule", (0.0, -0.1, 0.33), quat=(0.7071, 0, 0, 0.7071))
    model.geom_size[1, 1] = 0.15
    model.geom_rbound[1] = 0.18
    model.geom_aabb[1, 5] = 0.18
    engine = Engine(model)
    place_heights(engine.model, lambda x, y: 0.3 - np.where(y < 0, np.minimum(abs(x), 0.2), 0.0))
    data = engine.make_data()
    engine.step(data, nstep=150)
    assert data.qpos[2] == pytest.approx(0.33, abs=1e-5)


@pytest.mark.parametrize("timestep", [0.002, 0.005])
def test_box_that_slides_meets_a_rising_slope_in_time(timestep):
    # Without a contact ahead its corner went in by 2.8 mm, and recovery gave 0.13 J.
    engine = Engine(scene("box", (0.3, 0.0, 0.03), timestep=timestep))
    place_heights(engine.model, lambda x, y: np.maximum(x - 0.5, 0.0))
    data = engine.make_data()
    data.qvel[0] = 3.0
    deepest = 0.0
    for _ in range(round(0.1 / timestep)):
        engine.step(data)
        mujoco.mj_kinematics(engine.model, data)
        deepest = min(deepest, distance(engine, data, "ground", 1).distance)
    # On two planes it goes in by 0.74 mm, where the next corner comes down.
    assert deepest > -1e-3


def test_complementarity_free_law_keeps_mujocos_contacts():
    model = scene("box", (0.03, 0.02, 0.03 - 1e-5), gravity=False)
    engine = Engine(model, law="comfree")
    data, own = engine.make_data(), mujoco.MjData(engine.model)
    mujoco.mj_forward(engine.model, own)
    engine.step(data)
    assert np.array_equal(data.contact.pos, own.contact.pos)


def test_heights_that_are_not_finite_are_refused_by_name():
    model = scene("box", (0, 0, 1))
    model.hfield_data[2 * (CELLS + 1) + 3] = np.nan
    with pytest.raises(ValueError, match="hfield 'field' holds nan in row 2, column 3"):
        Engine(model)
