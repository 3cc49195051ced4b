"""Boxes that lie flat on each other, tilted by a hair: points of their faces, and rest."""

from itertools import combinations

import mujoco
import numpy as np
import pytest

from dashpot import Engine, Material
from scene import free_body, mjcf

LOWER, UPPER = np.array([0.15, 0.06, 0.03]), np.array([0.09, 0.11, 0.04])
MARGIN = 0.02  # wider than any height over a face below


def turned(tilt, direction, yaw):
    """Return the quaternion of a yaw and then a tilt about a horizontal direction."""
    turn = np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
    lean = np.array([1.0, tilt / 2 * np.cos(direction), tilt / 2 * np.sin(direction), 0.0])
    quat = np.empty(4)
    mujoco.mju_mulQuat(quat, lean / np.linalg.norm(lean), turn)
    return quat


def pair(quat, position):
    """Return a model of a box in no gravity and another one above it."""
    geoms = [
        f'type="box" size="{half[0]} {half[1]} {half[2]}" margin="{MARGIN}"'
        for half in (LOWER, UPPER)
    ]
    bodies = free_body("lower", geoms[0], (0, 0, 0)) + free_body(
        "upper", geoms[1], position, quat=quat
    )
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><option gravity='0 0 0'/><worldbody>{bodies}</worldbody></mujoco>"
    )


def found_by_mujoco(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data.contact


def found_by_dashpot(model):
    engine = Engine(model)
    data = engine.make_data()
    engine.step(data)
    return data.contact


def corners_of_both_faces(rotation, position):
    """Return the corners (n, 2) of what the lower top face and the upper bottom face share.

    From above, by brute force: crossings of any two of their eight sides that lie in both.
    """
    along, across = rotation[:2, 0], rotation[:2, 1]
    centre = (position - UPPER[2] * rotation[:, 2])[:2]
    rows = np.linalg.inv(np.column_stack([along * UPPER[0], across * UPPER[1]]))
    # Sides as n p <= 1.
    sides = [(s * np.eye(2)[i] / LOWER[i], 1.0) for i in range(2) for s in (-1, 1)]
    sides += [(s * rows[i], 1.0 + s * rows[i] @ centre) for i in range(2) for s in (-1, 1)]
    corners = []
    for (n1, b1), (n2, b2) in combinations(sides, 2):
        if abs(np.linalg.det([n1, n2])) < 1e-3 * np.linalg.norm(n1) * np.linalg.norm(n2):
            continue
        point = np.linalg.solve([n1, n2], [b1, b2])
        if all(n @ point <= b + 1e-9 for n, b in sides):
            corners.append(point)
    return np.array(corners)


def test_contacts_of_flat_boxes_are_the_corners_that_their_faces_share():
    rng = np.random.default_rng(0)
    crossings = 0
    for _ in range(200):
        tilt = 10 ** rng.uniform(-4, -2)
        quat = turned(tilt, rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 1.3))
        # Where one corner stands out it is below the other face, and the edges are nearest.
        lift = rng.uniform(-0.5, 0.5) * tilt * 0.1
        position = np.array([*rng.uniform(-0.05, 0.05, 2), LOWER[2] + UPPER[2] + lift])
        model = pair(quat, position)
        crossings += len(found_by_mujoco(model).dist) == 1
        contact = found_by_dashpot(model)
        flat = np.empty(9)
        mujoco.mju_quat2Mat(flat, quat)
        rotation = flat.reshape(3, 3)
        corners = corners_of_both_faces(rotation, position)
        assert len(contact.dist) == len(corners)
        # Either face may be the plane that distances are measured from: heights differ by the
        # square of the tilt, places by the tilt times the height over the sine of the sides' angle.
        bound = 2.0 / np.sin(0.2) * tilt * (np.abs(contact.dist).max() + abs(lift)) + 1e-9
        for corner in corners:
            away = np.linalg.norm(contact.pos[:, :2] - corner, axis=1)
            nearest = int(np.argmin(away))
            assert away[nearest] < bound
            # On the bottom of the upper box, above the top of the lower one.
            normal = rotation[:, 2]
            level = (position - UPPER[2] * normal) @ normal
            height = (level - normal[:2] @ corner) / normal[2] - LOWER[2]
            assert contact.dist[nearest] == pytest.approx(height, abs=2.0 * tilt * bound)
            assert contact.pos[nearest, 2] == pytest.approx(
                LOWER[2] + height / 2, abs=2.0 * tilt * bound + tilt**2 * 0.1
            )
        # From the lower box to the upper one, along the normal of a face.
        assert contact.frame[:, 0:3] @ normal == pytest.approx(1.0, abs=tilt**2)
    assert crossings > 50


def test_edges_that_cross_at_a_tilt_stay_one_contact():
    rng = np.random.default_rng(1)
    crossings = 0
    for _ in range(300):
        quat = turned(rng.uniform(0.2, 0.7), rng.uniform(0, 2 * np.pi), rng.uniform(0, np.pi))
        flat = np.empty(9)
        mujoco.mju_quat2Mat(flat, quat)
        reach = np.abs(flat[6:]) @ UPPER
        position = np.array([*rng.uniform(-0.15, 0.15, 2), LOWER[2] + 0.9 * reach])
        model = pair(quat, position)
        theirs = found_by_mujoco(model)
        if len(theirs.dist) != 1:
            continue
        normal = theirs.frame[0, :3]
        steepest = max(np.abs(normal).max(), np.abs(normal @ flat.reshape(3, 3)).max())
        if steepest > 0.98:  # along a face, or nearly so
            continue
        crossings += 1
        ours = found_by_dashpot(model)
        assert np.array_equal(theirs.dist, ours.dist)
        assert np.array_equal(theirs.frame, ours.frame)
        assert np.array_equal(theirs.pos, ours.pos)
    assert crossings > 20


def settle(bodies, timestep, material, time):
    """Return the speeds of the last 0.2 s and what recovery put in then (J)."""
    model = mujoco.MjModel.from_xml_string(mjcf(bodies))
    model.opt.timestep = timestep
    engine = Engine(model)
    if material:
        for geom in range(model.ngeom):
            engine.set_material(model.geom(geom).name, material)
    data = engine.make_data()
    tail = round(0.2 / timestep)
    engine.step(data, nstep=round(time / timestep) - tail)
    before = engine.energy(data).dissipated_recovery
    fastest = 0.0
    for _ in range(tail):
        engine.step(data)
        fastest = max(fastest, np.abs(data.qvel).max())
    return fastest, before - engine.energy(data).dissipated_recovery


def crossed_planks(tilt):
    half = np.array([0.2, 0.04, 0.015])
    rng = np.random.default_rng(2)
    bodies, height = "", 0.0
    for layer in range(4):
        height += half[2] + 0.2 * tilt
        for side in (-0.12, 0.12):
            place = (0.0, side) if layer % 2 == 0 else (side, 0.0)
            quat = turned(tilt, rng.uniform(0, 2 * np.pi), layer * np.pi / 2 + 0.01 * side)
            geom = f'type="box" size="{half[0]} {half[1]} {half[2]}" density="600"'
            bodies += free_body(f"{layer} {side}", geom, (*place, height), quat=quat)
        height += half[2]
    return bodies


def twisted_tower(tilt):
    rng = np.random.default_rng(3)
    half = np.array([0.08, 0.06, 0.01])
    bodies, height = "", 0.0
    for i in range(6):
        height += half[2] + 0.1 * tilt
        quat = turned(tilt, rng.uniform(0, 2 * np.pi), 0.6 * i)
        geom = f'type="box" size="{half[0]} {half[1]} {half[2]}" density="1000"'
        bodies += free_body(str(i), geom, (0.003 * (i % 2), 0, height), quat=quat)
        height += half[2]
    return bodies


@pytest.mark.parametrize("material", [None, Material(1e6, damping_ratio=1.0)], ids=["rigid", "SI"])
@pytest.mark.parametrize(
    ("tilt", "timestep"), [(1e-4, 0.010), (1e-3, 0.001), (1e-2, 0.002), (1e-2, 0.010)]
)
@pytest.mark.parametrize("pile", [crossed_planks, twisted_tower])
def test_flat_boxes_come_to_rest_and_nothing_is_recovered_there(pile, tilt, timestep, material):
    fastest, recovered = settle(pile(tilt), timestep, material, 2.0)
    # The slowest modes, swaying, decay at some 10 1/s. A tower that stands on the crossing of two
    # edges in some steps rattles at m/s instead, by recovery of some watts.
    assert fastest < 1e-4
    assert abs(recovered) < 1e-9
