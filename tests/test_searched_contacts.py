"""Contacts of shapes whose nearest points MuJoCo searches for: normals, flat ends, round sides."""

import itertools

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import dashpot
from dashpot import Engine

HALF = (0.03, 0.02, 0.04)  # of the box, m
RADIUS, HALF_LENGTH = 0.02, 0.03  # of the round ones
OVERLAP = 1e-5


def pebble():
    """Return the corners (60, 3) of a hull about a ball of 3 cm: small faces, blunt edges."""
    corners = np.random.default_rng(0).normal(size=(60, 3))
    return 0.03 * corners / np.linalg.norm(corners, axis=1)[:, None]


SHAPES = {
    "capsule": f'type="capsule" size="{RADIUS} {HALF_LENGTH}"',
    "cylinder": f'type="cylinder" size="{RADIUS} {HALF_LENGTH}"',
    "ellipsoid": 'type="ellipsoid" size="0.02 0.03 0.04"',
    "box": f'type="box" size="{HALF[0]} {HALF[1]} {HALF[2]}"',
    "pebble": 'type="mesh" mesh="pebble"',
}
ASSETS = f"""<asset><mesh name="pebble"
  vertex="{" ".join(map(str, pebble().round(6).ravel()))}"/></asset>"""


def two_shapes(first, second, option=""):
    return mujoco.MjModel.from_xml_string(f"""
<mujoco><option gravity="0 0 0" {option}/>{ASSETS}<worldbody>
  <geom name="first" {SHAPES[first]}/>
  <body><freejoint/><geom name="second" {SHAPES[second]}/></body></worldbody></mujoco>""")


def push_together(engine, data, rng):
    """Place the second shape so that it overlaps the first; return the distance of queries."""
    data.qpos[3:] = Rotation.random(random_state=rng).as_quat(scalar_first=True)
    along = rng.normal(size=3)
    along /= np.linalg.norm(along)
    data.qpos[:3] = 0.12 * along
    for _ in range(50):
        mujoco.mj_kinematics(engine.model, data)
        nearest = dashpot.distance(engine, data, "first", "second")
        if abs(nearest.distance + OVERLAP) < 1e-10:
            return nearest
        slope = max(0.05, abs(nearest.normal @ along))
        data.qpos[:3] -= along * (nearest.distance + OVERLAP) / slope
    return None


PAIRS = [
    pair
    for pair in itertools.combinations_with_replacement(SHAPES, 2)
    if pair not in (("capsule", "capsule"), ("capsule", "box"), ("box", "box"))
]


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_contacts_are_where_and_along_what_shapes_touch(first, second):
    # MuJoCo's normals are off by up to 0.8 rad, of a third of all touching capsules and pebbles by
    # more than 0.01; those of ellipsoids by 0.003.
    engine = Engine(two_shapes(first, second))
    data = engine.make_data()
    rng = np.random.default_rng(1)
    angles = []
    for _ in range(40):
        mujoco.mj_resetData(engine.model, data)
        nearest = push_together(engine, data, rng)
        if nearest is None:
            continue
        engine.step(data)
        deepest = data.contact.dist.argmin()
        # Faces stand for edges that lie on them up to a ten-thousandth of the radius.
        assert data.contact.dist[deepest] == pytest.approx(nearest.distance, abs=3e-6)
        normal = data.contact.frame[deepest, :3]
        angles.append(np.arccos(min(1.0, abs(normal @ nearest.normal))))
    assert len(angles) >= 35
    # The search ends within 1e-9 of the distance: of shapes curved by 2 cm that leaves some
    # sqrt(1e-9 / 0.02) = 2e-4. Faces within 0.02 of an edge that lies on them are those met.
    assert np.quantile(angles, 0.9) < 1e-3
    assert max(angles) < 0.021


def test_complementarity_free_law_keeps_mujocos_contacts():
    engine = Engine(two_shapes("capsule", "pebble"), law="comfree")
    data, own = engine.make_data(), engine.make_data()
    rng = np.random.default_rng(1)
    for _ in range(10):
        mujoco.mj_resetData(engine.model, data)
        push_together(engine, data, rng)
        own.qpos[:] = data.qpos
        mujoco.mj_forward(engine.model, own)
        engine.step(data)
        assert np.array_equal(data.contact.frame, own.contact.frame)
        assert np.array_equal(data.contact.dist, own.contact.dist)


TABLE = 0.2  # half of its sides, m
TABLES = {
    "box": f'<geom type="box" size="{TABLE} {TABLE} 0.1" pos="0 0 -0.1" gap="0.05"/>',
    "mesh": '<geom type="mesh" mesh="table" pos="0 0 -0.1" gap="0.05"/>',
    "cylinder": f'<geom type="cylinder" size="{TABLE} 0.1" pos="0 0 -0.1" gap="0.05"/>',
}
TABLE_MESH = " ".join(
    f"{x} {y} {z}" for x in (-TABLE, TABLE) for y in (-TABLE, TABLE) for z in (-0.1, 0.1)
)


def contacts_on(table, shape, rotation, position):
    """Return the contacts of a shape that floats or rests on a table whose top is at z = 0."""
    quat = " ".join(map(str, rotation.as_quat(scalar_first=True)))
    xml = f"""<mujoco><option gravity="0 0 0"/><asset><mesh name="table" vertex="{TABLE_MESH}"/>
      </asset><worldbody>{TABLES[table]}
      <body pos="{" ".join(map(str, position))}" quat="{quat}"><freejoint/>
        <geom {SHAPES[shape]}/></body></worldbody></mujoco>"""
    engine = Engine(mujoco.MjModel.from_xml_string(xml))
    data = engine.make_data()
    engine.step(data)
    return data.contact


def lean(tilt, towards):
    """Return a rotation that lowers what lies in a direction by `tilt` (rad)."""
    return Rotation.from_rotvec([-tilt * np.sin(towards), tilt * np.cos(towards), 0.0])


@pytest.mark.parametrize("tilt", [0.0, 1e-9, 1e-6, 1e-4])
@pytest.mark.parametrize("table", TABLES)
def test_flat_end_of_a_cylinder_stands_on_fixed_points_of_its_rim(table, tilt):
    rotation, centre = lean(tilt, 0.3), np.array([0.01, 0.02, HALF_LENGTH - 1e-6])
    contacts = contacts_on(table, "cylinder", rotation, centre)
    angle = np.arange(6) * np.pi / 3
    rim = np.column_stack(
        [RADIUS * np.cos(angle), RADIUS * np.sin(angle), np.full(6, -HALF_LENGTH)]
    )
    rim = rotation.apply(rim) + centre
    assert len(contacts.dist) == 6
    apart = np.linalg.norm(contacts.pos[:, None, :2] - rim[None, :, :2], axis=2)
    order = apart.argmin(axis=0)
    # Heights above the flatter of both faces: those of two ends tilted against each other differ by
    # the tilt's square. Corners of meshes are in single precision.
    assert contacts.dist[order] == pytest.approx(
        rim[:, 2], abs=2e-8 + TABLE * tilt**2 + tilt * 1e-6
    )
    assert contacts.pos[order, :2] == pytest.approx(rim[:, :2], abs=2e-8 + tilt * 1e-4)


@pytest.mark.parametrize("towards", [0.0, 0.2, 2.0, 4.5])
@pytest.mark.parametrize("tilt", [2e-3, 0.01, 0.1])
@pytest.mark.parametrize("table", ["box", "mesh"])
def test_tilted_end_of_a_cylinder_stands_on_the_lowest_point_of_its_rim(table, tilt, towards):
    position = (0.0, 0.0, HALF_LENGTH - 1e-6)
    contacts = contacts_on(table, "cylinder", lean(tilt, towards), position)
    lowest = position[2] - HALF_LENGTH * np.cos(tilt) - RADIUS * np.sin(tilt)
    deepest = contacts.dist.argmin()
    # Up to a ten-thousandth of the radius one of the fixed points stands for it.
    if contacts.dist[deepest] > lowest + 2e-8:
        assert contacts.dist[deepest] < lowest + 1e-4 * RADIUS
        return
    assert contacts.dist[deepest] == pytest.approx(lowest, abs=2e-8)
    at = RADIUS * np.cos(tilt) - HALF_LENGTH * np.sin(tilt)
    expected = at * np.array([np.cos(towards), np.sin(towards)])
    assert contacts.pos[deepest, :2] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("table", ["box", "mesh"])
def test_flat_end_of_a_cylinder_stands_on_what_is_beneath_it(table):
    contacts = contacts_on(table, "cylinder", lean(0.0, 0.0), (TABLE, 0.0, HALF_LENGTH - 1e-6))
    x, y = contacts.pos[:, 0] - TABLE, contacts.pos[:, 1]
    assert (x <= 1e-7).all()
    # The chord along the edge, of six corners: it meets their sides at sin(60 deg) or above.
    chord = np.abs(y[x > -1e-7])
    assert len(chord) == 2
    assert (chord > RADIUS * np.sin(np.pi / 3) - 1e-7).all()


@pytest.mark.parametrize("tilt", [0.0, 1e-13, -1e-13, 1e-6, 1e-3, -0.01])
@pytest.mark.parametrize(
    ("shape", "table"),
    [
        ("cylinder", "box"),
        ("cylinder", "mesh"),
        ("capsule", "box"),
        ("capsule", "mesh"),
        ("capsule", "cylinder"),
    ],
)
def test_round_side_lies_on_a_face_with_both_its_ends(shape, table, tilt):
    along = Rotation.from_rotvec([0.0, np.pi / 2, 0.0])
    rotation = Rotation.from_rotvec([0.0, tilt, 0.0]) * along
    contacts = contacts_on(table, shape, rotation, (0.0, 0.0, RADIUS - 1e-6))
    ends = np.array([-1.0, 1.0]) * HALF_LENGTH
    radius = RADIUS * np.cos(tilt) if shape == "cylinder" else RADIUS
    order = contacts.pos[:, 0].argsort()
    assert contacts.dist[order] == pytest.approx(
        RADIUS - 1e-6 - ends * np.sin(tilt) - radius, abs=2e-8
    )
    assert contacts.pos[order, 0] == pytest.approx(ends, abs=HALF_LENGTH * abs(tilt) + 2e-8)


@pytest.mark.parametrize("yaw", [0.0, 0.3, 1.2])
def test_capsule_lands_on_a_narrower_box_without_a_spin(yaw):
    # MuJoCo finds one of its ends in half of all cases where it is parallel but for rounding.
    model = mujoco.MjModel.from_xml_string(f"""
<mujoco><worldbody><geom type="box" size="0.01 0.01 0.02" pos="0 0 -0.02"/>
  <body pos="0 0 0.014"><freejoint/>
    <geom type="capsule" size="0.004 0.03" euler="0 90 {np.degrees(yaw)}" mass="0.01"/>
  </body></worldbody></mujoco>""")
    engine = Engine(model)
    for tilt in np.random.default_rng(0).uniform(-1e-12, 1e-12, 10):
        data = engine.make_data()
        rotation = Rotation.from_rotvec(tilt * np.array([-np.sin(yaw), np.cos(yaw), 0.0]))
        data.qpos[3:] = rotation.as_quat(scalar_first=True)
        fastest = 0.0
        for _ in range(100):
            engine.step(data)
            fastest = max(fastest, np.abs(data.qvel[3:]).max())
        # Growth of the tilt by the hit itself: the sides of a rigid hit differ by it over the
        # distance at which 0.3 m/s compress, some 1e-8.
        assert fastest < 1e-6
        assert data.qpos[2] == pytest.approx(0.004, abs=1e-5)  # it has landed


def ellipsoids_that_touch(half, overlap, rng):
    """Return a model of two, the second free, and the normal along which they overlap."""
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    rotation = Rotation.random(2, random_state=rng)
    reach = []
    for axes, turned in zip(half, rotation, strict=True):
        local = turned.inv().apply(normal)
        reach.append(turned.apply(axes**2 * local) / np.linalg.norm(axes * local))
    quat = rotation.as_quat(scalar_first=True)
    place = sum(reach) - overlap * normal
    first, second = (" ".join(map(repr, map(float, axes))) for axes in half)
    return mujoco.MjModel.from_xml_string(f"""
<mujoco><option gravity="0 0 0"/><worldbody>
  <geom type="ellipsoid" size="{first}" quat="{" ".join(map(str, quat[0]))}"/>
  <body pos="{" ".join(map(str, place))}" quat="{" ".join(map(str, quat[1]))}"><freejoint/>
    <geom type="ellipsoid" size="{second}"/></body></worldbody></mujoco>"""), normal


@pytest.mark.parametrize(
    "half",
    [
        ((0.1, 0.1, 0.1), (0.02, 0.02, 0.02)),
        ((0.05, 0.05, 0.02), (0.04, 0.04, 0.03)),
        ((0.02, 0.03, 0.04), (0.03, 0.02, 0.025)),
    ],
)
def test_ellipsoids_touch_along_their_common_normal(half):
    # Points with opposite normals n, the overlap apart along n, are the nearest: those of smooth
    # convex bodies that overlap by less than their radii of curvature.
    rng = np.random.default_rng(2)
    for overlap in np.repeat([1e-4, 1e-5, 1e-6, 1e-7], 5):
        model, normal = ellipsoids_that_touch(np.array(half), overlap, rng)
        engine = Engine(model)
        data = engine.make_data()
        engine.step(data)
        assert data.ncon == 1
        # The position has the last bit of 0.1 m, 1e-17, over radii from 8 mm on.
        assert data.contact.dist[0] == pytest.approx(-overlap, abs=1e-15)
        assert data.contact.frame[0, :3] == pytest.approx(normal, abs=1e-13)


def test_round_side_lies_on_what_is_beneath_it():
    along = Rotation.from_rotvec([0.0, np.pi / 2, 0.0])
    contacts = contacts_on("box", "cylinder", along, (TABLE - 0.01, 0.0, RADIUS - 1e-6))
    assert np.sort(contacts.pos[:, 0]) == pytest.approx([TABLE - 0.01 - HALF_LENGTH, TABLE])


@pytest.mark.parametrize("timestep", [0.001, 0.002])
def test_ellipsoid_rolls_on_a_box_as_on_a_plane(timestep):
    # With MuJoCo's tolerance dashpots took 0.02 J of 0.4 that recovery had put in.
    energies = {}
    for floor in ('type="plane" size="9 9 1"', 'type="box" size="9 9 0.1" pos="0 0 -0.1"'):
        xml = f"""<mujoco><option timestep="{timestep}"/><worldbody><geom {floor}/>
          <body pos="0 0 0.04"><freejoint/>
            <geom type="ellipsoid" size="0.05 0.04 0.03" mass="1"/></body></worldbody></mujoco>"""
        engine = Engine(mujoco.MjModel.from_xml_string(xml))
        data = engine.make_data()
        data.qpos[3:7] = [0.955, 0.177, 0.236, 0.0]
        data.qvel[:] = [0.3, 0.1, 0, 2, -4, 1]
        engine.step(data, nstep=round(0.6 / timestep))
        start = engine.energy(data)
        engine.step(data, nstep=round(2.0 / timestep))
        end = engine.energy(data)
        energies[floor] = end.kinetic + end.potential
        assert 0.03 - 1e-4 < data.qpos[2] < 0.05  # it has not fallen through
        assert abs(end.dissipated_recovery - start.dissipated_recovery) < 1e-3
        assert energies[floor] == pytest.approx(start.kinetic + start.potential, rel=1e-3)


@pytest.mark.parametrize("timestep", [0.001, 0.002])
@pytest.mark.parametrize("lean_angle", [0.1, 0.8])
def test_coin_rolls_on_a_box_as_on_a_plane(lean_angle, timestep):
    # Where its rim would touch next counted as another contact: it lost 16 % in 2 s at 2 ms.
    energies = []
    for floor in ('type="plane" size="9 9 1"', 'type="box" size="9 9 0.1" pos="0 0 -0.1"'):
        height = 0.04 * np.cos(lean_angle) + 0.02 * np.sin(lean_angle)
        xml = f"""<mujoco><option timestep="{timestep}"/>
          <worldbody><geom {floor} friction="0.9"/><body pos="0 0 {height}"><freejoint/>
            <geom type="cylinder" size="0.04 0.02" mass="1" friction="0.9"/></body>
          </worldbody></mujoco>"""
        engine = Engine(mujoco.MjModel.from_xml_string(xml))
        data = engine.make_data()
        data.qpos[3:5] = [np.cos(np.pi / 4 - lean_angle / 2), np.sin(np.pi / 4 - lean_angle / 2)]
        data.qvel[:] = [0.6, 0, 0, 0, 2, -15]
        engine.step(data, nstep=round(0.5 / timestep))
        start = engine.energy(data).mechanical
        engine.step(data, nstep=round(1.5 / timestep))
        energies.append(engine.energy(data).mechanical)
        # What rolls without slip keeps its energy, once friction has it.
        assert energies[-1] == pytest.approx(start, rel=1e-4)
        assert data.qpos[2] == pytest.approx(height, abs=5e-3)  # it has not fallen through
    assert energies[1] == pytest.approx(energies[0], rel=1e-3)


@pytest.mark.parametrize("turn", [0.4, 1.0])  # in a step, rad
@pytest.mark.parametrize("shape", ["cylinder", "capsule"])
def test_round_side_rolls_fast_on_a_box(shape, turn):
    # Half a radius further on there was another contact: three quarters were lost in 2 s. Shorter
    # cylinders, of half-lengths below 0.75 radii, begin to wobble from 0.93 rad a step on.
    radius, timestep = 0.03, 0.005
    speed = turn * radius / timestep
    xml = f"""<mujoco><option timestep="{timestep}"/><worldbody>
      <geom type="box" size="50 50 0.1" pos="0 0 -0.1"/><body pos="0 0 {radius}"><freejoint/>
        <geom type="{shape}" size="{radius} 0.025" mass="1"/></body></worldbody></mujoco>"""
    engine = Engine(mujoco.MjModel.from_xml_string(xml))
    data = engine.make_data()
    data.qpos[3:5] = np.sqrt(0.5)
    data.qvel[:] = [speed, 0, 0, 0, 0, -speed / radius]
    engine.step(data, nstep=round(2.0 / timestep))
    # Friction takes some of it while the weight comes on.
    assert data.qpos[0] == pytest.approx(2.0 * speed, rel=1e-4)
    assert data.qvel[0] == pytest.approx(speed, rel=1e-4)
    assert data.qpos[2] == pytest.approx(radius, abs=1e-4)


def test_what_adheres_keeps_the_points_that_mujoco_finds():
    corners = " ".join(f"{x} {y} {z}" for x, y, z in itertools.product((-0.05, 0.05), repeat=3))
    xml = f"""<mujoco><asset><mesh name="block" vertex="{corners}"/></asset><worldbody>
      <geom type="box" size="1 1 0.1" pos="0 0 -0.1"/>
      <body pos="0 0 0.05"><freejoint/><geom type="mesh" mesh="block" adhesion="1"/></body>
      </worldbody></mujoco>"""
    engine = Engine(mujoco.MjModel.from_xml_string(xml))
    data = engine.make_data()
    engine.step(data, nstep=600)
    assert data.ncon == 4
    assert np.abs(data.qvel).max() < 1e-9


@pytest.mark.parametrize(
    ("law", "treatment"), [("kelvin_voigt", "mapped"), ("comfree", "honoured")]
)
def test_report_says_whether_searches_are_mujocos(law, treatment):
    report = repr(Engine(two_shapes("cylinder", "box"), law=law).report())
    assert f"{treatment:<10}option ccd_tolerance, flag multiccd" in report


def test_contacts_do_not_depend_on_what_the_report_calls_mapped():
    found = []
    for option in ('ccd_tolerance="1e-6"', 'ccd_tolerance="1e-4"'):
        for flag in ("enable", "disable"):
            model = two_shapes("cylinder", "box", option)
            if flag == "disable":
                model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MULTICCD
            engine = Engine(model)
            data = engine.make_data()
            push_together(engine, data, np.random.default_rng(1))
            engine.step(data)
            found.append((data.contact.frame.copy(), data.contact.dist.copy()))
    for frame, gap in found[1:]:
        assert np.array_equal(frame, found[0][0])
        assert np.array_equal(gap, found[0][1])
