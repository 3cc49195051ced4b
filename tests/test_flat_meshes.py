"""Meshes that lie flat on planes, boxes and each other: points of their faces, and rest."""

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from dashpot import Engine, Material

RADIUS, HALF = 0.04, 0.02  # of prisms, m
MASS = 0.1
GRAVITY = 9.81
# Rounding of vertices in single precision, of lengths of 0.1 m.
ROUNDING = 5e-8


def prism(sides):
    """Return the corners (2 * sides, 3) of an upright prism."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = RADIUS * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.array([[*corner, z] for corner in ring for z in (-HALF, HALF)])


def asset(name, corners):
    return f'<mesh name="{name}" vertex="{" ".join(f"{x:.9f}" for x in corners.ravel())}"/>'


def body(geom, position, rotation=None, name=""):
    quat = (rotation or Rotation.identity()).as_quat(scalar_first=True)
    return f"""<body name="{name}" pos="{" ".join(map(str, position))}"
      quat="{" ".join(map(str, quat))}"><freejoint/><geom {geom} mass="{MASS}"/></body>"""


def scene(assets, bodies, timestep=0.002, gravity=(0, 0, -GRAVITY), plane=True, option=""):
    floor = '<geom name="floor" type="plane" size="0 0 1"/>' if plane else ""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}" gravity="{gravity[0]} {gravity[1]} {gravity[2]}"
        {option}/><asset>{assets}</asset><worldbody>{floor}{bodies}</worldbody></mujoco>"""
    )


def stack(sides, timestep, count=4, seed=0):
    """Return a stack of prisms, each turned and shifted against the one below, 0.4 mm above it."""
    rng = np.random.default_rng(seed)
    bodies = "".join(
        body(
            'type="mesh" mesh="prism"',
            (*rng.normal(size=2) * 0.002, HALF + (2 * HALF + 4e-4) * i),
            Rotation.from_rotvec([0, 0, rng.normal() * 0.3]),
        )
        for i in range(count)
    )
    return scene(asset("prism", prism(sides)), bodies, timestep)


def found_by_dashpot(model):
    engine = Engine(model)
    data = engine.make_data()
    engine.step(data)
    return data.contact


def corners_of(hull_a, hull_b):
    """Return the corners (n, 2) of the intersection of two convex polygons, by brute force."""
    sides = []
    for polygon in (hull_a, hull_b):
        for k in range(len(polygon)):
            along = polygon[(k + 1) % len(polygon)] - polygon[k]
            normal = np.array([along[1], -along[0]]) / np.linalg.norm(along)
            sides.append((normal, normal @ polygon[k]))
    corners = []
    for i, (n1, b1) in enumerate(sides):
        for n2, b2 in sides[:i]:
            if abs(n1[0] * n2[1] - n1[1] * n2[0]) < 1e-6:
                continue
            point = np.linalg.solve([n1, n2], [b1, b2])
            if all(n @ point <= b + 1e-12 for n, b in sides):
                corners.append(point)
    return np.array(corners)


@pytest.mark.parametrize("upper", ["mesh", "box"])
def test_contacts_of_flat_meshes_are_all_corners_that_their_faces_share(upper):
    rng = np.random.default_rng(0)
    more_than_mujoco = 0
    for _ in range(60):
        sides, others = rng.integers(3, 9, size=2)
        if upper == "box":
            corners = np.array(np.meshgrid(*[(-RADIUS, RADIUS)] * 2, (-HALF, HALF))).reshape(3, 8).T
            corners = corners[[0, 1, 2, 3, 6, 7, 4, 5]]  # pairs, in order around
            geom = f'type="box" size="{RADIUS} {RADIUS} {HALF}"'
        else:
            corners, geom = prism(others), 'type="mesh" mesh="upper"'
        tilt = 10 ** rng.uniform(-5, -3)
        rotation = Rotation.from_rotvec(
            tilt * np.array([*np.linalg.qr(rng.normal(size=(2, 2)))[0][0], 0])
        ) * Rotation.from_rotvec([0, 0, rng.uniform(0.1, 1.0)])
        # Deep enough that all of the face overlaps, and MuJoCo finds the pair.
        place = np.array([*rng.uniform(-0.01, 0.01, 2), 2 * HALF - 2 * tilt * RADIUS])
        model = scene(
            asset("lower", prism(sides)) + asset("upper", corners),
            body('type="mesh" mesh="lower"', (0, 0, 0)) + body(geom, place, rotation),
            gravity=(0, 0, 0),
            plane=False,
        )
        world = rotation.apply(corners) + place
        bottom = np.array([p for p, c in zip(world, corners, strict=True) if c[2] < 0])
        expected = corners_of(prism(sides)[::2, :2], bottom[:, :2])
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        more_than_mujoco += len(data.contact.dist) < len(expected)
        contact = found_by_dashpot(model)
        assert len(contact.dist) == len(expected)
        normal = rotation.apply([0, 0, 1])
        if contact.geom[0, 0] != 0:
            normal = -normal
        assert contact.frame[:, :3] @ normal == pytest.approx(1.0, abs=tilt**2)
        for corner in expected:
            away = np.linalg.norm(contact.pos[:, :2] - corner, axis=1)
            # Sideways the planes of the two faces differ by the tilt times the overlap.
            assert away.min() < 10 * tilt * 4 * tilt * RADIUS + ROUNDING
            up = rotation.apply([0, 0, 1])
            level = (place - HALF * up) @ up
            height = (level - up[:2] @ corner) / up[2] - HALF
            assert contact.dist[away.argmin()] == pytest.approx(
                height, abs=10 * tilt**2 * RADIUS + ROUNDING
            )
    assert more_than_mujoco > 20


@pytest.mark.parametrize("sides", [3, 5, 6, 12])
def test_prism_stands_on_all_its_corners(sides):
    model = stack(sides, 0.002, count=1)
    engine = Engine(model)
    engine.set_material("floor", Material(stiffness=1e5, damping_ratio=1.0))
    data = engine.make_data()
    engine.step(data, nstep=1500)
    contacts = engine.contacts(data)
    force = contacts.force[:, 0]
    assert len(force) == sides
    # A regular prism loads its corners evenly.
    assert force == pytest.approx(np.full(sides, MASS * GRAVITY / sides), rel=1e-6)
    assert np.abs(data.qvel).max() < 1e-9
    # Each corner sags by its load over the stiffness of the floor, for the prism is rigid.
    assert data.qpos[2] - HALF == pytest.approx(-MASS * GRAVITY / sides / 1e5, abs=ROUNDING)


def rest_of(engine, data, time):
    """Return the speeds of the last 0.2 s, and what recovery put in then (J)."""
    timestep = engine.model.opt.timestep
    tail = round(0.2 / timestep)
    engine.step(data, nstep=round(time / timestep) - tail)
    before = engine.energy(data).dissipated_recovery
    fastest = 0.0
    for _ in range(tail):
        engine.step(data)
        fastest = max(fastest, np.abs(data.qvel).max())
    return fastest, before - engine.energy(data).dissipated_recovery


def rest(model, time, material=None):
    engine = Engine(model)
    if material:
        for geom in range(model.ngeom):
            engine.set_material(geom, material)
    data = engine.make_data()
    return (*rest_of(engine, data, time), engine, data)


@pytest.mark.parametrize(
    ("sides", "timestep", "material"),
    [
        (5, 0.001, None),
        *((sides, 0.005, None) for sides in (3, 4, 5, 6, 8, 16)),
        *((sides, 0.002, Material(1e6, damping_ratio=1.0)) for sides in (3, 5, 8)),
    ],
)
def test_stack_of_prisms_comes_to_rest_and_nothing_is_recovered_there(sides, timestep, material):
    fastest, recovered, engine, data = rest(stack(sides, timestep), 4.0, material)
    # The slowest modes, swaying, decay at some 10 1/s. Where points of faces come and go a stack
    # rocks at 0.3 rad/s instead, by recovery of some milliwatts.
    assert fastest < 1e-3
    assert abs(recovered) < 1e-9
    # Every interface carries what is above it.
    contacts = engine.contacts(data)
    for i in range(4):
        load = sum(
            force[0]
            for geom, force in zip(contacts.geom, contacts.force, strict=True)
            if sorted(geom) == [i, i + 1]
        )
        assert load == pytest.approx((4 - i) * MASS * GRAVITY, rel=1e-3)


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("order", [("box", "mesh"), ("mesh", "box")])
def test_boxes_and_mesh_cubes_rest_on_each_other(order, timestep):
    side = 0.03
    cube = np.array(np.meshgrid(*[(-side, side)] * 3)).reshape(3, 8).T
    kinds = {"box": f'type="box" size="{side} {side} {side}"', "mesh": 'type="mesh" mesh="cube"'}
    bodies = "".join(
        body(
            kinds[order[i % 2]],
            (0.001 * i, 0.0, side + (2 * side + 1e-4) * i),
            Rotation.from_rotvec([0, 0, 0.2 * i]),
        )
        for i in range(4)
    )
    fastest, recovered, *_ = rest(scene(asset("cube", cube), bodies, timestep), 4.0)
    assert fastest < 1e-3
    assert abs(recovered) < 1e-9


def pile_of_prisms(seed, timestep):
    rng = np.random.default_rng(seed)
    bodies = "".join(
        body(
            'type="mesh" mesh="prism"',
            (*rng.uniform(-0.05, 0.05, 2), 0.06 + 0.09 * i),
            Rotation.random(random_state=int(rng.integers(1000))),
        )
        for i in range(8)
    )
    walls = "".join(
        f'<geom type="plane" pos="{x} {y} 0" zaxis="{-x} {-y} 0" size="1 1 .1"/>'
        for x, y in ((0.12, 0), (-0.12, 0), (0, 0.12), (0, -0.12))
    )
    # MuJoCo finds the crossing of two edges to a tolerance, 1e-6 m unless it is told.
    return scene(asset("prism", prism(6)), walls + bodies, timestep, option='ccd_tolerance="1e-9"')


def test_nothing_is_recovered_in_a_pile_of_prisms_that_has_settled():
    # A body that leans on two points may swing out of its balance for seconds, as it should: 4 of
    # 120 piles have one. Where points of faces and edges come and go, bodies rattle on a hundredth
    # of a milliwatt at least.
    rests = [rest(pile_of_prisms(seed, 0.005), 6.0)[:2] for seed in range(1, 5)]
    still = [fastest < 0.1 and abs(recovered) < 1e-7 for fastest, recovered in rests]
    assert sum(still) >= 3


@pytest.mark.parametrize("seed", range(4))
def test_hull_of_random_points_rests_on_a_facet(seed):
    points = np.random.default_rng(seed).normal(size=(20, 3))
    points *= RADIUS / np.linalg.norm(points, axis=1)[:, None]
    model = scene(asset("hull", points), body('type="mesh" mesh="hull"', (0, 0, 0.06)))
    fastest, recovered, engine, data = rest(model, 4.0)
    assert fastest < 1e-6
    assert abs(recovered) < 1e-9
    contacts = engine.contacts(data)
    # A facet of points in general position is a triangle, and holds the centre of mass.
    assert len(contacts.gap) == 3
    assert ConvexHull(np.vstack([contacts.position[:, :2], data.xipos[1, :2]])).vertices.size == 3
    assert contacts.force[:, 0].sum() == pytest.approx(MASS * GRAVITY, rel=1e-6)


def test_edge_that_lies_flat_on_a_face_touches_with_both_ends():
    # A prism of six sides on one of its long edges, across a beam whose sides it overhangs.
    beam = np.array(np.meshgrid((-0.1, 0.1), (-0.01, 0.01), (-0.02, 0.02))).reshape(3, 8).T
    on_edge = Rotation.from_euler("xy", [90, 30], degrees=True)
    lowest = on_edge.apply(prism(6))[:, 2].min()
    for tilt in np.linspace(-1e-3, 1e-3, 11):
        # Not to be lost in rounding which of the ends is lower: MuJoCo finds one of them, or both.
        rotation = Rotation.from_rotvec([tilt, 0, 0]) * on_edge
        model = scene(
            asset("prism", prism(6)) + asset("beam", beam),
            body('type="mesh" mesh="beam"', (0, 0, 0))
            + body('type="mesh" mesh="prism"', (0, 0, 0.02 - lowest - 5e-5), rotation),
            gravity=(0, 0, 0),
            plane=False,
        )
        contact = found_by_dashpot(model)
        assert len(contact.dist) == 2
        assert np.sort(contact.pos[:, 1]) == pytest.approx([-0.01, 0.01], abs=1e-6)
        expected = -5e-5 + tilt * np.sort(contact.pos[:, 1])
        assert contact.dist[np.argsort(contact.pos[:, 1])] == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("tilt", [0.0, 0.003, 0.03, 0.1])
def test_many_sided_disc_stands_on_its_lowest_corner(tilt):
    for yaw in np.linspace(0, 0.1, 7):
        rotation = Rotation.from_rotvec([tilt, 0, 0]) * Rotation.from_rotvec([0, 0, yaw])
        heights = rotation.apply(prism(64))[:, 2]
        model = scene(
            asset("disc", prism(64)),
            body('type="mesh" mesh="disc"', (0, 0, -heights.min() - 1e-5), rotation),
            gravity=(0, 0, 0),
        )
        contact = found_by_dashpot(model)
        # To what the vertices of one plane may be away from it.
        assert contact.dist.min() == pytest.approx(-1e-5, abs=1e-4 * RADIUS)
        assert len(contact.dist) <= 13


def test_rest_does_not_depend_on_where_down_is():
    upright = stack(6, 0.002)
    turn = Rotation.from_rotvec([0.7, -1.1, 0.4])
    shift = np.array([0.3, -0.2, 0.5])
    engine = Engine(upright)
    data = engine.make_data()
    engine.step(data, nstep=1500)
    bodies = "".join(
        body(
            'type="mesh" mesh="prism"',
            turn.apply(data.xpos[i]) + shift,
            turn * Rotation.from_quat(data.xquat[i], scalar_first=True),
        )
        for i in range(1, 5)
    )
    normal = turn.apply([0, 0, 1])
    floor = f"""<geom type="plane" size="0 0 1" pos="{" ".join(map(str, shift))}"
      zaxis="{" ".join(map(str, normal))}"/>"""
    turned = scene(asset("prism", prism(6)), floor + bodies, gravity=-GRAVITY * normal, plane=False)
    other = Engine(turned)
    there = other.make_data()
    other.step(there)
    engine.step(data)
    ours, theirs = data.contact, there.contact
    assert len(ours.dist) == len(theirs.dist)
    expected = turn.apply(ours.pos) + shift
    for point, distance in zip(expected, ours.dist, strict=True):
        away = np.linalg.norm(theirs.pos - point, axis=1)
        assert away.min() < 1e-9
        assert theirs.dist[away.argmin()] == pytest.approx(distance, abs=1e-12)


@pytest.mark.parametrize("timestep", [0.001, 0.005])
def test_prisms_that_fall_gain_no_energy(timestep):
    model = stack(6, timestep, count=5, seed=3)
    engine = Engine(model)
    data = engine.make_data()
    data.qvel[2::6] = -0.5
    data.qvel[3::6] = 2.0
    first = engine.energy(data)
    highest = first.kinetic + first.potential
    for _ in range(round(1.5 / timestep)):
        engine.step(data)
        energy = engine.energy(data)
        now = energy.kinetic + energy.potential + energy.elastic
        # What recovery lifts out of overlaps, at 0.1 m/s, is below the energy of a body at 0.1 m/s.
        assert now < highest + 0.5 * MASS * 0.1**2
        highest = min(highest, now)
    # They have fallen on the floor, and lie there.
    assert energy.kinetic < 0.1 * first.kinetic
    assert data.xpos[1:, 2].min() > 0.9 * HALF


def test_pairs_keep_their_contacts_together():
    model = stack(8, 0.002, count=3)
    engine = Engine(model)
    data = engine.make_data()
    engine.step(data, nstep=500)
    pairs = [tuple(geom) for geom in data.contact.geom]
    starts = [pair for i, pair in enumerate(pairs) if i == 0 or pairs[i - 1] != pair]
    assert len(starts) == len(set(starts)) == 3
    # More than MuJoCo keeps room for.
    assert max(pairs.count(pair) for pair in starts) > 4
    frames = data.contact.frame.reshape(-1, 3, 3)
    assert frames @ frames.transpose(0, 2, 1) == pytest.approx(
        np.broadcast_to(np.eye(3), frames.shape), abs=1e-12
    )
    assert np.linalg.det(frames) == pytest.approx(1.0)


def test_published_law_keeps_what_mujoco_finds():
    model = stack(6, 0.002, count=2)
    engine = Engine(model, law="comfree")
    data = engine.make_data()
    engine.step(data, nstep=200)
    pairs = [tuple(geom) for geom in data.contact.geom]
    assert max(pairs.count(pair) for pair in pairs) <= 4
