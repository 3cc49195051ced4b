"""Motions with contact that mechanics textbooks solve in closed form."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import dashpot


def engine_of(xml, timestep):
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.timestep = timestep
    return dashpot.Engine(model)


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_ball_on_a_turntable_circles_at_two_sevenths_of_its_rate(timestep):
    """Rolling without slip on a disc at W, a solid ball circles at 2 W / 7 wherever it is."""
    rate, speed, radius, duration = 2.0, 0.3, 0.1, 10.0
    engine = engine_of(
        f"""<mujoco><worldbody>
        <body><joint axis="0 0 1"/><geom type="cylinder" size="3 .1" mass="1e6"/></body>
        <body pos="1 0 .2"><freejoint/><geom type="sphere" size="{radius}" mass="1"/></body>
        </worldbody></mujoco>""",
        timestep,
    )
    data = engine.make_data()
    data.qvel[0] = rate
    data.qvel[2] = speed
    # The point of contact of the ball has the velocity of the disc there, W at 1 m.
    data.qvel[4] = (rate - speed) / radius
    heading = []
    for _ in range(round(duration / timestep)):
        engine.step(data)
        heading.append(np.arctan2(data.qvel[2], data.qvel[1]))
    turned = np.unwrap(heading)
    assert turned[-1] - turned[0] == pytest.approx(2 / 7 * rate * (duration - timestep), rel=3e-4)
    assert np.hypot(*data.qvel[1:3]) == pytest.approx(speed, rel=1e-4)


@pytest.mark.parametrize("timestep", [0.001, 0.002])
def test_ladder_leaves_the_wall_at_two_thirds_of_its_height(timestep):
    """A rod that slides down a smooth wall and floor, from rest."""
    length, radius, start = 2.0, 0.02, np.deg2rad(70)
    x, z = length / 2 * np.cos(start) + radius, length / 2 * np.sin(start) + radius
    engine = engine_of(
        f"""<mujoco><worldbody><geom type="plane" size="9 9 1" friction="0"/>
        <geom name="wall" type="plane" size="9 9 1" zaxis="1 0 0" friction="0"/>
        <body pos="{x} 0 {z}" euler="0 {np.degrees(start) - 180} 0"><freejoint/>
          <geom type="capsule" size="{radius} {length / 2}" zaxis="1 0 0" mass="0" friction="0"/>
          <geom type="box" size="{length / 2} .001 .001" mass="1" contype="0" conaffinity="0"/>
        </body></worldbody></mujoco>""",
        timestep,
    )
    data = engine.make_data()
    wall = engine.geom_id("wall")
    left = None
    while left is None and data.time < 2.0:
        height = data.qpos[2] - radius
        engine.step(data)
        contacts = engine.contacts(data)
        if contacts.force[(contacts.geom == wall).any(axis=1), 0].sum() == 0.0:
            left = height
    # The force on the wall falls through zero; it is met to a step's way and the elastic gap.
    speed = 2.0
    assert left / (z - radius) == pytest.approx(2 / 3, abs=3 * speed * timestep / z)


@pytest.mark.parametrize("timestep", [0.001, 0.002])
@pytest.mark.parametrize(("ratio", "holds"), [(0.95, True), (1.05, False)])
def test_rope_over_a_beam_holds_as_the_capstan_equation_says(timestep, ratio, holds):
    """Friction on half a turn holds loads of up to exp(pi mu), also of a chain."""
    friction, radius, thick, link, links = 0.3, 0.1, 0.004, 0.02, 40
    light = 0.2
    heavy = light * ratio * np.exp(np.pi * friction)
    straight = (links * link - np.pi * (radius + thick)) / 2

    def place(way):
        if way < straight:
            return np.array([-radius - thick, way - straight])
        angle = (way - straight) / (radius + thick)
        if angle < np.pi:
            return (radius + thick) * np.array([-np.cos(angle), np.sin(angle)])
        return np.array([radius + thick, (np.pi - angle) * (radius + thick)])

    points = np.array([place(i * link) for i in range(links + 1)])
    angles = np.arctan2(*np.diff(points, axis=0).T[::-1])
    load = '<geom type="sphere" size=".02" contype="0" conaffinity="0"'
    chain = f'{load} pos="{link} 0 0" mass="{heavy}"/>'
    for i in reversed(range(links)):
        joint = '<joint axis="0 -1 0" damping="2e-4" armature="1e-6"/>'
        if i == 0:
            joint = f'<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>{joint}'
            joint += f'{load} mass="{light}"/>'
        chain = f"""<body pos="{link if i else 0} 0 0">{joint}
          <geom type="capsule" fromto="0 0 0 {link} 0 0" size="{thick}" mass=".002"
            contype="1" conaffinity="2" friction="{friction}"/>{chain}</body>"""
    engine = engine_of(
        f"""<mujoco><worldbody><geom type="cylinder" size="{radius} .1" zaxis="0 1 0" contype="2"
        conaffinity="1" friction="{friction}"/>{chain}</worldbody></mujoco>""",
        timestep,
    )
    data = engine.make_data()
    data.qpos[:2] = points[0]
    data.qpos[2] = angles[0]
    data.qpos[3:] = np.angle(np.exp(1j * np.diff(angles)))
    engine.step(data, nstep=round(0.25 / timestep))  # links settle on the beam
    height = data.qpos[1]
    engine.step(data, nstep=round(0.25 / timestep))
    risen = data.qpos[1] - height
    if holds:
        assert abs(risen) < 1e-5
    else:
        # Beyond the limit the excess of the heavy load accelerates both, against damped joints.
        assert risen > 0.004
