"""What is moved by hand, by writing its positions, remembers no contact, limit or equality."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

import dashpot

G = 9.81
HALF = 0.1  # m, of every body here
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS
FREE = "<freejoint/>"
SLIDES = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
SCENE = """<mujoco><option timestep="{dt}"/><worldbody>
  <geom name="floor" type="plane" size="99 99 .1"/>
  <body pos="0 0 .1">{joints}<geom name="body" {shape} mass="1"/></body></worldbody></mujoco>"""
SHAPES = {"ball": 'type="sphere" size=".1"', "box": 'type="box" size=".1 .1 .1"'}


def falling(dt: float, shape: str, joints: str, stiffness: float | None) -> dashpot.Engine:
    scene = SCENE.format(dt=dt, shape=SHAPES[shape], joints=joints)
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(scene))
    if stiffness is not None:
        material = dashpot.Material(stiffness=stiffness, restitution=0.5)
        engine.set_pair_material("floor", "body", material)
    return engine


def copied(engine: dashpot.Engine, data: mujoco.MjData) -> mujoco.MjData:
    copy = mujoco.MjData(engine.model)
    mujoco.mj_copyData(copy, engine.model, data)
    return copy


def write(engine: dashpot.Engine, data: mujoco.MjData, qpos: np.ndarray) -> None:
    data.qpos[:] = qpos
    data.qvel[:] = 0.0


def set_full_physics(engine: dashpot.Engine, data: mujoco.MjData, qpos: np.ndarray) -> None:
    fresh = engine.make_data()
    fresh.qpos[:] = qpos
    state = np.empty(mujoco.mj_stateSize(engine.model, FULL))
    mujoco.mj_getState(engine.model, fresh, state, FULL)
    mujoco.mj_setState(engine.model, data, state, FULL)


def in_impact(engine: dashpot.Engine, speed: float, phase: float) -> mujoco.MjData:
    """Return data of the first step in which the body, about to land at `speed`, touches."""
    data = engine.make_data()
    height = 2 if engine.model.nq == 7 else 1
    data.qpos[height] += phase * speed * engine.model.opt.timestep
    data.qvel[height if engine.model.nq == 7 else 1] = -speed
    while not data.ncon or engine.contacts(data).compression.max() == 0.0:
        engine.step(data)
    return data


@pytest.mark.parametrize("put", [write, set_full_physics])
@pytest.mark.parametrize("away", [0.0, 2.0])
@pytest.mark.parametrize(
    ("dt", "shape", "joints", "stiffness"),
    [
        (0.002, "ball", FREE, None),
        (0.002, "box", FREE, None),
        (0.002, "box", SLIDES, 1e4),
        (0.005, "box", FREE, 1e5),
        (0.005, "ball", SLIDES, None),
    ],
)
def test_what_is_put_on_the_floor_in_mid_impact_lies_still(
    dt: float,
    shape: str,
    joints: str,
    stiffness: float | None,
    away: float,
    put: Callable[[dashpot.Engine, mujoco.MjData, np.ndarray], None],
) -> None:
    engine = falling(dt, shape, joints, stiffness)
    for phase in np.linspace(0.1, 0.9, 5):
        data = in_impact(engine, 5.0, phase)
        rest = engine.make_data().qpos.copy()
        rest[0] += away
        height = engine.model.nq - 5 if joints == FREE else 1
        for _ in range(3):
            placed = copied(engine, data)
            put(engine, placed, rest)
            for _ in range(20):
                engine.step(placed)
                assert placed.qpos[height] - rest[height] < 1e-4
            engine.step(data)


@pytest.mark.parametrize("solref", ["", 'solreflimit="-2000 -1"'])
def test_a_joint_that_is_put_off_its_limit_stays_there(solref: str) -> None:
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string(f"""<mujoco><compiler angle="radian"/>
        <option timestep="0.005" gravity="0 0 0"/><worldbody><body>
        <joint axis="0 1 0" range="-1 1" {solref}/>
        <geom type="capsule" size=".02" fromto="0 0 0 .5 0 0" mass="1"/></body></worldbody>
        </mujoco>""")
    )
    for start in np.linspace(0.91, 0.95, 5):
        data = engine.make_data()
        data.qpos[0], data.qvel[0] = start, 10.0
        while data.qvel[0] == 10.0:
            engine.step(data)
        write(engine, data, np.array([0.999]))
        engine.step(data, nstep=10)
        assert data.qpos[0] == pytest.approx(0.999, abs=1e-9)


def test_overlap_written_by_hand_is_no_compressed_spring() -> None:
    # As a spring of 1e6 N/m an overlap of 0.02 m would throw it up by 20 m.
    engine = falling(0.002, "box", FREE, 1e6)
    data = in_impact(engine, 5.0, 0.5)
    rest = engine.make_data().qpos.copy()
    rest[:3] += [1.0, 0.0, -0.02]
    write(engine, data, rest)
    for _ in range(300):
        engine.step(data)
        assert data.qpos[2] < HALF + 1e-3
    assert data.qpos[2] == pytest.approx(HALF, abs=1e-3)


@pytest.mark.parametrize("stiffness", [1e4, 1e5])
def test_velocities_written_alone_leave_compression(stiffness: float) -> None:
    # Let go at rest, a spring gives back what it holds.
    engine = falling(0.0005, "ball", SLIDES, None)
    engine.set_pair_material("floor", "body", dashpot.Material(stiffness=stiffness, damping=0.0))
    data = in_impact(engine, 2.0, 0.5)
    while data.qvel[1] < -1.0:
        engine.step(data)
    depth = -data.qpos[1]
    data.qvel[:] = 0.0
    while data.qpos[1] < 0.0:
        engine.step(data)
    energy = 0.5 * stiffness * depth**2 - G * depth
    assert 0.5 * data.qvel[1] ** 2 + G * data.qpos[1] == pytest.approx(energy, rel=0.02)


def test_what_was_not_moved_goes_on_bit_for_bit() -> None:
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string("""<mujoco><worldbody><geom type="plane" size="9 9 .1"
        euler="0 15 0"/><body pos="0 0 .1" euler="0 15 0"><freejoint/><geom type="box"
        size=".1 .1 .1"/></body><body pos="0 1 .1" euler="0 15 0"><freejoint/><geom type="box"
        size=".1 .1 .1"/></body></worldbody></mujoco>""")
    )
    data = engine.make_data()
    engine.step(data, nstep=50)
    other = copied(engine, data)
    other.qpos[1] -= 0.5
    engine.step(data, nstep=50)
    engine.step(other, nstep=50)
    assert np.array_equal(data.qpos[7:], other.qpos[7:])
    assert other.qpos[:3] == pytest.approx(data.qpos[:3] - [0.0, 0.5, 0.0], abs=1e-4)


def test_an_arm_moved_by_hand_leaves_the_feet_their_friction() -> None:
    # What a joint carries is moved, and not what carries the joint.
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string("""<mujoco><worldbody><geom type="plane" size="9 9 .1"
        euler="0 20 0"/><body pos="0 0 .1" euler="0 20 0"><freejoint/><geom name="foot" type="box"
        size=".1 .1 .1" mass="5"/><body pos="0 0 .2"><joint name="head" axis="0 0 1"/>
        <geom type="sphere" size=".05" mass=".01"/></body></body></worldbody></mujoco>""")
    )
    data = engine.make_data()
    engine.step(data, nstep=100)
    held = data.qpos[:3].copy()
    for i in range(500):
        data.qpos[7] = 0.5 * np.sin(0.01 * i)
        engine.step(data)
    assert data.qpos[:3] == pytest.approx(held, abs=1e-6)


@pytest.mark.parametrize("shape", ["ball", "box"])
def test_positions_written_and_put_back_change_nothing(shape: str) -> None:
    engine = falling(0.002, shape, FREE, 1e5)
    data = in_impact(engine, 5.0, 0.5)
    other = copied(engine, data)
    kept = other.qpos.copy()
    other.qpos[:] = 1.0
    mujoco.mj_kinematics(engine.model, other)
    other.qpos[:] = kept
    engine.step(data, nstep=20)
    engine.step(other, nstep=20)
    assert np.array_equal(data.qpos, other.qpos)


def test_a_cloth_lifted_as_it_lands_is_not_thrown() -> None:
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string("""<mujoco><option timestep="0.002"/><worldbody>
        <geom type="plane" size="9 9 .1"/><flexcomp name="cloth" type="grid" count="4 4 1"
        spacing=".05 .05 .05" pos="0 0 .3" radius=".01" mass=".2" dim="2">
        <edge equality="true"/></flexcomp></worldbody></mujoco>""")
    )
    data = engine.make_data()
    data.qvel[2::3] = -3.0
    while not data.ncon:
        engine.step(data)
    data.qpos[2::3] -= data.qpos[2::3].mean()
    data.qvel[:] = 0.0
    for _ in range(20):
        engine.step(data)
        assert data.qvel[2::3].max() < 0.01
