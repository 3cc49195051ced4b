"""Geoms that the one joint between them holds apart are not collided until something moves."""

from __future__ import annotations

import mujoco
import pytest

import dashpot

# A turntable 0.1 mm above its base, or a sled above its rail.
SCENE = """<mujoco><option gravity="0 0 0" timestep="0.01" cone="elliptic"/><worldbody>
<body name="base" {mocap}><geom name="base" type="box" size=".2 .1 .1" {base}/></body>
<body name="link" pos="0 0 {height}"><joint {joint}/>
<geom type="box" size=".1 .1 .1" {link}/></body></worldbody></mujoco>"""
HINGE, SLIDE = 'axis="0 0 1"', 'type="slide" axis="1 0 0"'
JOINTS = pytest.mark.parametrize("joint", [HINGE, SLIDE])


def scene(
    joint: str, *, height: float = 0.2001, mocap: str = "", base: str = "", link: str = ""
) -> tuple[dashpot.Engine, mujoco.MjData]:
    xml = SCENE.format(joint=joint, height=height, mocap=mocap, base=base, link=link)
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    data = engine.make_data()
    data.qvel[0] = 0.5
    return engine, data


@JOINTS
def test_what_a_joint_holds_apart_is_not_collided(joint: str) -> None:
    engine, data = scene(joint)
    engine.step(data, nstep=20)
    assert data.maxuse_con == 0
    assert data.qpos[0] == pytest.approx(0.1, rel=1e-12)


@pytest.mark.parametrize("joint", ['axis="0 .01 1"', 'type="slide" axis="1 0 .01"'])
def test_a_joint_askew_brings_it_near(joint: str) -> None:
    engine, data = scene(joint)
    engine.step(data)
    assert data.maxuse_con > 0


@JOINTS
def test_what_overlaps_along_the_axis_is_collided(joint: str) -> None:
    engine, data = scene(joint, height=0.1999)
    engine.step(data)
    assert data.ncon >= 4


@JOINTS
@pytest.mark.parametrize("within", ['margin=".001"', 'gap=".001"'])
def test_contacts_within_the_margin_or_gap_are_reported(joint: str, within: str) -> None:
    engine, data = scene(joint, link=within)
    engine.step(data)
    mujoco.mj_collision(engine.model, data)
    expected = data.ncon
    engine, data = scene(joint, link=within)
    engine.step(data)
    assert data.ncon == expected == 4


@JOINTS
def test_an_edit_of_the_model_that_lets_them_meet_is_followed(joint: str) -> None:
    engine, data = scene(joint)
    engine.step(data)
    engine.model.body("link").pos[2] = 0.1999
    engine.step(data)
    assert data.ncon >= 4
    engine.model.body("link").pos[2] = 0.2001
    engine.step(data)
    assert data.ncon == 0


@JOINTS
def test_a_mocap_body_comes_along_the_axis(joint: str) -> None:
    engine, data = scene(joint, mocap='mocap="true"')
    engine.step(data)
    for i in range(20):
        data.mocap_pos[0, 2] = 1e-4 * i
        engine.step(data)
    assert data.ncon >= 4


def test_a_second_joint_between_them_may_close_the_gap() -> None:
    engine, data = scene(HINGE + '/><joint type="slide" axis="0 0 -1"')
    data.qvel[1] = 0.02
    engine.step(data, nstep=20)
    assert data.qpos[1] < 1.1e-4  # it would have come 4 mm
