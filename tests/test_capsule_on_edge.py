"""A capsule that touches the edge of a box with an end touches it in one point, with one spring."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine, Material

GRAVITY, MASS, RADIUS = 9.81, 0.5, 0.02
HALF, SLOPE = 0.05, np.pi / 6  # of the box, turned about the edge
EDGE = HALF * np.array([np.sin(SLOPE) - np.cos(SLOPE), 0, np.cos(SLOPE) + np.sin(SLOPE)])


def press(lean, turn, *, timestep=0.002, material=None):
    """Return engine and data: a capsule that leans from the vertical, on a guide along it."""
    x, z = EDGE[0], EDGE[2] + RADIUS
    way = 0.2 * np.array([np.sin(lean) * np.cos(turn), np.sin(lean) * np.sin(turn), np.cos(lean)])
    xml = f"""<mujoco><option timestep="{timestep}"/><worldbody>
      <geom name="box" type="box" size="{HALF} 0.2 {HALF}" euler="0 {np.degrees(SLOPE)} 0"/>
      <body pos="{x} 0 {z}"><joint type="slide" axis="0 0 1"/><geom name="capsule" type="capsule"
        size="{RADIUS}" fromto="0 0 0 {" ".join(map(str, way))}" mass="{MASS}"/></body>
      </worldbody></mujoco>"""
    engine = Engine(mujoco.MjModel.from_xml_string(xml))
    if material:
        engine.set_pair_material("box", "capsule", material)
    return engine, engine.make_data()


@pytest.mark.parametrize(("lean", "turn"), [(0.3, 0.0), (0.8, 0.0), (0.8, 0.5), (1.2, 0.5)])
def test_it_sags_by_its_weight_over_one_stiffness(lean, turn):
    # From some 0.5 rad on MuJoCo returns the point twice: two springs.
    stiffness = 1e5
    engine, data = press(lean, turn, material=Material(stiffness, damping_ratio=1.0))
    engine.step(data, nstep=1000)
    contacts = engine.contacts(data)
    assert len(contacts) == 1
    assert contacts.position[0] == pytest.approx(EDGE, abs=1e-4)
    assert -data.qpos[0] == pytest.approx(MASS * GRAVITY / stiffness, rel=1e-9)
    assert contacts.force[0, 0] == pytest.approx(MASS * GRAVITY, rel=1e-9)


@pytest.mark.parametrize("timestep", [0.001, 0.005])
def test_what_rests_there_needs_no_recovery(timestep):
    # The second of two points was new in every step: its overlap was recovered, and forgotten.
    engine, data = press(0.8, 0.5, timestep=timestep)
    data.qpos[0] = -1e-5
    engine.step(data, nstep=round(1.0 / timestep))
    before = engine.energy(data).dissipated_recovery
    engine.step(data, nstep=round(1.0 / timestep))
    assert abs(engine.energy(data).dissipated_recovery - before) < 1e-15
    assert np.abs(data.qvel).max() < 1e-12


def test_complementarity_free_law_keeps_what_mujoco_finds():
    engine, _ = press(0.8, 0.5)
    comfree = Engine(engine.model, law="comfree")
    data, plain = comfree.make_data(), mujoco.MjData(comfree.model)
    data.qpos[0] = plain.qpos[0] = -1e-4
    comfree.step(data)
    mujoco.mj_forward(comfree.model, plain)
    assert data.ncon == plain.ncon == 2
