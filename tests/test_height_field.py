"""Distances of height fields against closed forms and brute force over all prisms."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import dashpot
from dashpot.query import closest, distance, time_of_impact
from free_flight import launch
from height_field_scenes import (
    BASE,
    COLUMNS,
    ELEVATION,
    HALF_X,
    HALF_Y,
    ROWS,
    SIZE,
    convex_distance,
    core,
    make_model,
    place_on_hills,
    prisms,
    random_place,
    rough,
)
from query_geoms import CONVEX
from query_scenes import ROUNDING, support


def test_surface_is_that_of_mujocos_rays():
    """The heights that vertical rays hit are those at which small balls touch."""
    model, data = make_model(rough(), pose="")
    rng = np.random.default_rng(1)
    for _ in range(200):
        x, y = rng.uniform(-HALF_X, HALF_X), rng.uniform(-HALF_Y, HALF_Y)
        drop = mujoco.mj_rayHfield(
            model, data, 0, np.array((x, y, 1.0)), np.array((0.0, 0.0, -1.0)), None
        )
        surface = 1.0 - drop
        # The cone of slopes of the field bounds how far the nearest point is from below.
        for above in (0.0, 1e-3):
            place_on_hills(model, data, "sphere", (x, y, surface + above), np.eye(3))
            near = distance(model, data, "hills", "sphere").distance + SIZE["sphere"][0]
            # MuJoCo's rays compute in single precision here and there.
            assert near <= above + 1e-7
            assert near >= -1e-7 if above == 0.0 else near > 0.0


def test_flat_field_is_a_box():
    """Apart from it, and in shallow overlap through its top, a flat field is a box."""
    model, data = make_model(np.full((ROWS, COLUMNS), 0.5))
    top = 0.5 * ELEVATION
    rng = np.random.default_rng(2)
    for _ in range(200):
        point = rng.uniform(-1, 1, size=3)
        place_on_hills(model, data, "sphere", point, np.eye(3))
        outside = np.maximum(np.abs(point[:2]) - (HALF_X, HALF_Y), 0.0)
        above = max(point[2] - top, -BASE - point[2], 0.0)
        gap = np.hypot(np.linalg.norm(outside), above)
        if gap > 0.0:
            found = distance(model, data, "hills", "sphere")
            assert found.distance == pytest.approx(gap - SIZE["sphere"][0], abs=ROUNDING)
    for depth in (1e-9, 1e-4, 0.02):
        # Resting on a face: the deepest prisms are those wholly beneath it.
        place_on_hills(model, data, "box", (0.01, 0.02, top + 0.05 - depth), np.eye(3))
        found = distance(model, data, "hills", "box")
        assert found.distance == pytest.approx(-depth, abs=ROUNDING)
        up = data.geom("hills").xmat.reshape(3, 3)[:, 2]
        np.testing.assert_allclose(found.normal, up, atol=1e-9)


@pytest.mark.parametrize("kind", CONVEX)
def test_aligned_with_a_flat_field(kind, capfd):
    """Above corners, edges and diagonals of cells, just apart, touching and just overlapping."""
    model, data = make_model(np.full((ROWS, COLUMNS), 0.5), pose="")
    top = 0.5 * ELEVATION
    x, y = 2 * HALF_X / (COLUMNS - 1), 2 * HALF_Y / (ROWS - 1)
    turns = [Rotation.identity(), Rotation.from_euler("xyz", (90, 0, 45), degrees=True)]
    for turn, at in itertools.product(turns, ((0, 0), (0, 0.5 * y), (0.5 * x, 0), (x / 2, y / 2))):
        place_on_hills(model, data, kind, (*at, 0), turn.as_matrix())
        lowest = support(model, data, kind, np.array((0, 1e-300, -1.0)))[2]
        for gap in (1.0, 1e-3, 1e-9, 1e-15, 0.0, -1e-15, -1e-9, -1e-5, -1e-3):
            place_on_hills(model, data, kind, (*at, top + gap - lowest), turn.as_matrix())
            found = distance(model, data, "hills", kind)
            # Curved overlaps: to 1e-10 of the size of the pair.
            assert found.distance == pytest.approx(gap, abs=1e-10)
            if abs(gap) > 1e-5:
                np.testing.assert_allclose(found.normal, (0, 0, 1), atol=1e-4)
    captured = capfd.readouterr()
    assert (captured.out, captured.err) == ("", "")


@pytest.mark.parametrize("kind", ["sphere", "capsule", "box", "mesh"])
def test_polytopes_against_all_prisms(kind):
    """The least signed distance over every prism, each by least squares or Qhull."""
    model, data = make_model(rough())
    solids = prisms(model, data)
    rng = np.random.default_rng(CONVEX.index(kind))
    deep = 0
    for _ in range(15):
        random_place(model, data, rng, kind)
        corners, radius = core(model, data, kind)
        nearest = min(convex_distance((corners[:, None] - p[None]).reshape(-1, 3)) for p in solids)
        found = distance(model, data, "hills", kind)
        deep += nearest < 0.0
        # Least squares and Qhull leave 1e-9 of sizes below 1 m.
        assert found.distance == pytest.approx(nearest - radius, abs=1e-8)
        np.testing.assert_allclose(
            found.point2 - found.point1, found.distance * found.normal, atol=1e-9
        )
    assert deep > 2


@pytest.mark.parametrize("kind", CONVEX[1:])
def test_bounds_prove_the_distance(kind):
    """Points of both solids bound it from above, a separating direction per prism from below."""
    model, data = make_model(rough(3))
    solids = prisms(model, data)
    hills = data.geom("hills")
    frame = hills.xmat.reshape(3, 3)
    rng = np.random.default_rng([9, CONVEX.index(kind)])
    signs = set()
    for _ in range(40):
        random_place(model, data, rng, kind)
        found = distance(model, data, "hills", kind)
        signs.add(found.distance > 0)
        opposite = distance(model, data, kind, "hills")
        assert opposite.distance == found.distance
        np.testing.assert_array_equal(opposite.normal, -found.normal)
        # Along the normal, the gap to the prism that holds point1 is the distance.
        gaps = [
            found.normal @ support(model, data, kind, -found.normal) - (p @ found.normal).max()
            for p in solids
        ]
        # Curved overlaps: to 1e-10 of the size of the pair.
        assert min(abs(np.array(gaps) - found.distance)) < 1e-9
        if found.distance <= 0.0:
            continue
        local = frame.T @ (found.point1 - hills.xpos)
        assert (np.abs(local) <= (HALF_X + 1e-9, HALF_Y + 1e-9, ELEVATION + 1e-9)).all()
        # No point of the geom's surface is nearer to the field: sampled points.
        for direction in rng.normal(size=(40, 3)):
            point = support(model, data, kind, direction / np.linalg.norm(direction))
            place_on_hills(model, data, "sphere", frame.T @ (point - hills.xpos), np.eye(3))
            near = distance(model, data, "hills", "sphere").distance + SIZE["sphere"][0]
            assert near >= found.distance - 1e-9
    assert signs == {True, False}


def test_plane_under_a_height_field():
    """The lowest corner decides; the surface counts where the field is upside down."""
    heights = rough()
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><hfield name="hills" nrow="{ROWS}" ncol="{COLUMNS}"
        size="{HALF_X} {HALF_Y} {ELEVATION} {BASE}"/></asset>
        <worldbody><geom name="floor" type="plane" size="1 1 1"/>
        <body name="hills"><freejoint/><geom name="hills" type="hfield" hfield="hills"
        density="100"/></body></worldbody></mujoco>"""
    )
    model.hfield_data[:] = heights.ravel()
    data = mujoco.MjData(model)
    rng = np.random.default_rng(5)
    for _ in range(20):
        data.qpos[:3] = rng.normal(size=3)
        data.qpos[3:7] = Rotation.random(random_state=rng).as_quat()
        data.qvel[2] = -3.0
        mujoco.mj_forward(model, data)
        lowest = min(p[:, 2].min() for p in prisms(model, data))
        assert distance(model, data, "floor", "hills").distance == pytest.approx(
            lowest, abs=ROUNDING
        )
        found = time_of_impact(model, data, "floor", "hills", horizon=1.0)
        assert found.hit == (lowest < 3.0)
        if 0.0 < lowest < 3.0:
            assert found.time == pytest.approx(lowest / 3.0, abs=1e-9)


def test_closest_and_distances():
    model, _ = make_model(rough())
    rng = np.random.default_rng(11)
    qpos = rng.normal(scale=0.3, size=(3, 5, model.nq))
    data = mujoco.MjData(model)
    data.qpos[:] = qpos[1, 2]
    mujoco.mj_forward(model, data)
    for kind in CONVEX:
        many = dashpot.distances(model, "hills", kind, qpos, nthread=1)
        assert many.distance[1, 2] == distance(model, data, "hills", kind).distance
        again = dashpot.distances(model, "hills", kind, qpos, nthread=3)
        assert many.point1.tobytes() == again.point1.tobytes()
    found = closest(model, data, radius=0.3)
    with_hills = {int(pair.max()) for pair in found.geom if 0 in pair}
    near = {i for i in range(1, model.ngeom) if distance(model, data, 0, i).distance <= 0.3}
    assert with_hills == near
    assert near


def test_heights_that_are_not_finite_are_named():
    heights = rough()
    model, data = make_model(heights, pose="")
    place_on_hills(model, data, "sphere", (0, 0, 0.5), np.eye(3))
    model.hfield_data[3 * COLUMNS + 2] = np.nan
    with pytest.raises(ValueError, match="geom 'hills': the height of row 3, column 2 is nan"):
        distance(model, data, "hills", "sphere")


def test_contacts_filtered_by_height_field():
    model, _ = make_model(np.full((ROWS, COLUMNS), 0.5), pose="")
    model.opt.gravity[2] = -9.81
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qpos[:] = model.qpos0
    launch(engine.model, data, "box", (0, 0, 0.1 + 0.05))
    engine.step(data, nstep=50)
    on_hills = engine.contacts(data, geom="hills")
    assert len(on_hills) > 0
    between = engine.contacts(data, pair=("hills", "box"))
    assert len(between) == len(on_hills)
    weight = engine.model.body_mass[engine.model.body("box").id] * 9.81
    # Forces point along normals that are all vertical on a flat field, and have settled.
    assert abs(between.force[:, 0].sum()) == pytest.approx(weight, rel=1e-3)


def test_a_soft_ball_that_slides_over_gentle_edges_that_stand_out_has_one_contact():
    """A hill of facets of 2 mm, at 0.07 degrees to each other; the ball is pressed in by 2.5 mm.

    Above an edge neither facet has the ball's lowest point along its own normal over itself.
    """
    x = np.linspace(-0.15, 0.15, 151)
    heights = 0.02 - 0.3 * np.broadcast_to(x**2, (151, 151))
    lowest, span = heights.min(), np.ptp(heights)
    spec = mujoco.MjSpec()
    spec.add_hfield(
        name="hill",
        nrow=151,
        ncol=151,
        size=[0.15, 0.15, span, 0.02],
        userdata=list(((heights - lowest) / span).ravel()),
    )
    field = mujoco.mjtGeom.mjGEOM_HFIELD
    spec.worldbody.add_geom(name="hill", type=field, hfieldname="hill", pos=[0, 0, lowest])
    body = spec.worldbody.add_body(pos=[-0.03, 0.0007, 0.0])
    for axis in ([1, 0, 0], [0, 0, 1]):
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    body.add_geom(name="ball", size=[0.02, 0, 0], mass=5)
    spec.option.timestep = 1e-3
    engine = dashpot.Engine(spec.compile())
    spring = dashpot.Material(2e4, damping=300.0, friction=0.0)
    engine.set_pair_material("ball", "hill", spring)
    data = engine.make_data()
    sag = 5 * 9.81 / 2e4
    data.qpos[1] = 0.02 - 0.3 * 0.03**2 + 0.02 - sag
    data.qvel[:] = 0.1, 0.3 * 2 * 0.03 * 0.1
    loads = []
    for _ in range(500):
        engine.step(data)
        loads.append(engine.contacts(data).force[:, 0])
    assert {len(load) for load in loads} == {1}
    # On its round way over the hill it weighs v^2 times the curvature less.
    expected = 5 * (9.81 - 0.6 * 0.1**2)
    np.testing.assert_allclose(np.concatenate(loads[100:]), expected, rtol=0.02)
