"""Capsules and cylinders that lie nearly side by side, or along an edge, touch along a line."""

import itertools

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dashpot import Engine

RADIUS, HALF_LENGTH = 0.02, 0.025
SAG = 1e-3 * RADIUS  # what rigid contacts may sag by, along which two capsules touch


def bar(*, position, axis, shape="capsule", attributes=""):
    ends = [np.array(position) + s * HALF_LENGTH * np.array(axis) for s in (-1.0, 1.0)]
    fromto = " ".join(map(str, np.concatenate(ends)))
    return f'<geom type="{shape}" size="{RADIUS}" fromto="{fromto}" {attributes}/>'


def find_contacts(*, angle, tilt, gap, law="kelvin_voigt"):
    """Contacts of a capsule along x with one above, turned by `angle` about z, then tilted."""
    axis = [np.cos(angle) * np.cos(tilt), np.sin(angle) * np.cos(tilt), np.sin(tilt)]
    below = bar(position=(0, 0, 0), axis=(1, 0, 0), attributes='gap="1e-3"')
    above = bar(position=(0, 0, 2 * RADIUS + gap), axis=axis, attributes='gap="1e-3"')
    xml = f"""<mujoco><option gravity="0 0 0"/><worldbody>{below}
      <body><freejoint/>{above}</body></worldbody></mujoco>"""
    engine = Engine(mujoco.MjModel.from_xml_string(xml), law=law)
    data = engine.make_data()
    engine.step(data)
    return data.contact


def distance(x, *, angle, tilt, gap):
    """Gap between the capsule below at x along it and the axis line of the one above."""
    axis = np.array([np.cos(angle) * np.cos(tilt), np.sin(angle) * np.cos(tilt), np.sin(tilt)])
    away = np.array([x, 0.0, -2 * RADIUS - gap])
    return np.linalg.norm(away - (away @ axis) * axis) - 2 * RADIUS


@pytest.mark.parametrize("gap", [-2e-5, 0.0, 1e-5])
@pytest.mark.parametrize("angle", [0.03, 0.1, 0.25, -0.1])
def test_crossing_capsules_touch_as_far_as_they_may_sag(angle, gap):
    contacts = find_contacts(angle=angle, tilt=0.0, gap=gap)
    x = np.sort(contacts.pos[:, 0])
    # The gap grows by x^2 angle^2 / (2 d), d the distance between the axes.
    reach = min(HALF_LENGTH, np.sqrt(2 * (2 * RADIUS + gap) * SAG) / np.sin(abs(angle)))
    # `along` the mean of the axes, x is shorter by 1 - cos(angle / 2), at most 1 %.
    assert x == pytest.approx([-reach, reach], rel=0.02)
    assert contacts.dist == pytest.approx([gap, gap], abs=1e-12)


@pytest.mark.parametrize("angle", [0.0, 0.01])
@pytest.mark.parametrize("tilt", [2e-4, -2e-3])
def test_tilted_capsules_touch_in_both_ends(angle, tilt):
    gap = abs(tilt) * HALF_LENGTH
    contacts = find_contacts(angle=angle, tilt=tilt, gap=gap)
    x = contacts.pos[:, 0]
    assert np.sort(x) == pytest.approx([-HALF_LENGTH, HALF_LENGTH], rel=1e-3)
    # Up to what crossing at the angle adds, within the tolerance.
    expected = [distance(at, angle=angle, tilt=tilt, gap=gap) for at in x]
    assert contacts.dist == pytest.approx(expected, abs=SAG)
    assert contacts.dist.max() - contacts.dist.min() == pytest.approx(
        2 * HALF_LENGTH * abs(tilt), abs=1e-8 + (2 * HALF_LENGTH * angle) ** 2 / (4 * RADIUS)
    )


@pytest.mark.parametrize("angle", [0.5, 1.2])
def test_capsules_that_cross_steeply_touch_in_one_point(angle):
    contacts = find_contacts(angle=angle, tilt=0.0, gap=-1e-5)
    assert contacts.pos == pytest.approx(np.array([[0, 0, RADIUS - 5e-6]]), abs=1e-9)


def test_complementarity_free_law_keeps_mujocos_contacts():
    assert len(find_contacts(angle=0.1, tilt=0.0, gap=-1e-5, law="comfree").dist) == 1


def press_by_slab(below, above, timestep, *, assets=""):
    """Return engine and data at rest: a light bar on a fixed one, a heavy slab on both, tipped."""
    mass, load = 0.1, 5.0
    wall = f'<geom type="box" size="0.1 0.01 0.1" pos="0 {{}} {2 * RADIUS + 0.1}" friction="0"/>'
    xml = f"""<mujoco><option timestep="{timestep}"/>{assets}<worldbody>{below}
      {wall.format(RADIUS + 0.01)} {wall.format(-RADIUS - 0.01)}
      <body pos="0 0 {2 * RADIUS}"><freejoint/>{above.format(f'mass="{mass}"')}</body>
      <body pos="0 0 {3 * RADIUS + 0.05}"><joint type="slide" axis="0 0 1"/>
        <geom name="slab" type="box" size="0.1 0.005 0.05" mass="{load}"/></body>
      </worldbody></mujoco>"""
    engine = Engine(mujoco.MjModel.from_xml_string(xml))
    data = engine.make_data()
    data.qvel[4] = 0.5
    engine.step(data, nstep=round(2.0 / timestep))
    return engine, data, load * 9.81


def check_rest(engine, data, load):
    recovered = engine.energy(data).dissipated_recovery
    fastest = 0.0
    for _ in range(100):
        engine.step(data)
        fastest = max(fastest, np.abs(data.qvel).max())
    # At rest: a ten-thousandth of what the slab falls by gravity in a step. It sags by some 1e-3 of
    # the radius at each contact, and recovery of overlap has nothing left to do.
    assert fastest < 1e-6
    assert data.qpos[2] == pytest.approx(2 * RADIUS, abs=1e-4)
    assert abs(engine.energy(data).dissipated_recovery - recovered) < 1e-9
    contacts = engine.contacts(data)
    slab = (contacts.geom == engine.model.geom("slab").id).any(axis=1)
    assert contacts.force[slab, 0].sum() == pytest.approx(load, rel=1e-3)


@pytest.mark.parametrize("timestep", [0.002, 0.005])
@pytest.mark.parametrize("angle", [0.0, 0.06, 0.2])
@pytest.mark.parametrize(
    "shapes", [("capsule", "capsule"), ("cylinder", "cylinder"), ("capsule", "cylinder")]
)
def test_light_bar_rests_across_another_under_a_heavy_slab(shapes, angle, timestep):
    # With one contact, at the nearest points, a tilt of 1e-3 rad takes it from end to end at 0.03:
    # the bar rocked until it was pressed through the other one.
    below = bar(position=(0, 0, 0), axis=(np.cos(angle), np.sin(angle), 0), shape=shapes[0])
    above = bar(position=(0, 0, 0), axis=(1, 0, 0), shape=shapes[1], attributes="{}")
    check_rest(*press_by_slab(below, above, timestep))


@pytest.mark.parametrize("timestep", [0.002, 0.005])
@pytest.mark.parametrize("angle", [0.0, 0.12])
@pytest.mark.parametrize("shape", ["capsule", "cylinder"])
@pytest.mark.parametrize("kind", ["box", "mesh"])
def test_light_bar_rests_along_an_edge_under_a_heavy_slab(kind, shape, angle, timestep):
    # It rocked at up to 4 m/s.
    half = RADIUS / np.sqrt(2)
    corners = itertools.product((-HALF_LENGTH, HALF_LENGTH), (-half, half), (-half, half))
    assets = f"""<asset><mesh name="mesh"
      vertex="{" ".join(str(x) for corner in corners for x in corner)}"/></asset>"""
    size = f'size="{HALF_LENGTH} {half} {half}"' if kind == "box" else 'mesh="mesh"'
    turned = Rotation.from_rotvec([0, 0, angle]) * Rotation.from_rotvec([np.pi / 4, 0, 0])
    quat = " ".join(map(str, turned.as_quat(scalar_first=True)))
    below = f'<geom type="{kind}" {size} quat="{quat}"/>'
    above = bar(position=(0, 0, 0), axis=(1, 0, 0), shape=shape, attributes="{}")
    check_rest(*press_by_slab(below, above, timestep, assets=assets))
