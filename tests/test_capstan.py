"""Loaded chains on a fixed drum, and dampers beside springs that swing within a step.

Rows act in micro-steps. A joint damper whose force is held over the step acts half a step late on
what they swing: from omega H = pi to 2 pi it drives. Links that friction holds on a drum swing so.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import dashpot

RADIUS, LENGTH, THICKNESS = 0.1, 0.02, 0.005  # m: of the drum, and of a link
FRICTION = 0.2
LOAD = 1.0  # kg, the lighter one


def chain_on_drum(timestep: float, ratio: float, *, links: int = 24) -> mujoco.MjModel:
    """Return a chain over half of a drum, with `ratio` times LOAD at its first end."""
    reach = RADIUS + THICKNESS + 2e-4  # from the middle of the drum, of the joints
    turn = 2 * np.arcsin(LENGTH / (2 * reach))
    hanging = (links - round(np.pi / turn)) // 2
    headings = [np.pi / 2] * hanging
    for _ in range(links - hanging):
        last = headings[-1]
        first_on_drum = len(headings) == hanging
        headings.append(max(last - turn * (0.5 if first_on_drum else 1.0), -np.pi / 2))
    bodies, before = "", 0.0
    for i, heading in enumerate(headings):
        place = f"{-reach} 0 {-hanging * LENGTH}" if i == 0 else f"{LENGTH} 0 0"
        joint = "<freejoint/>" if i == 0 else '<joint axis="0 -1 0" damping="1e-3"/>'
        bodies += f"""<body pos="{place}" euler="0 {before - heading} 0">{joint}
          <geom type="capsule" fromto="0 0 0 {LENGTH} 0 0" size="{THICKNESS}" mass=".02"/>"""
        before = heading
        if i in (0, links - 1):
            mass, end = (ratio * LOAD, -LENGTH) if i == 0 else (LOAD, 2 * LENGTH)
            bodies += f"""<geom type="box" size=".02 .02 .02" pos="{end} 0 0" mass="{mass}"
              contype="0" conaffinity="0"/>"""
    return mujoco.MjModel.from_xml_string(f"""<mujoco><compiler angle="radian"/>
      <option timestep="{timestep}" cone="elliptic"/>
      <default><geom friction="{FRICTION}"/></default>
      <worldbody><geom type="cylinder" euler="{np.pi / 2} 0 0" size="{RADIUS} .05"/>
        {bodies}{"</body>" * links}</worldbody></mujoco>""")


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.004])
def test_a_chain_that_a_drum_holds_does_not_tremble(timestep: float) -> None:
    engine = dashpot.Engine(chain_on_drum(timestep, 1.5))
    data = engine.make_data()
    engine.step(data, nstep=round(1.5 / timestep))
    height, start, rates = data.qpos[2], engine.energy(data), []
    for _ in range(round(0.2 / timestep)):
        engine.step(data)
        rates.append(data.qvel[6:].copy())
    # What turns round in every step; the loads go on swinging, at less than 30 rad/s.
    tremor = np.abs(np.diff(rates, n=2, axis=0)).max() / 4
    assert tremor < 0.01
    assert abs(data.qpos[2] - height) < 1e-5
    energy = engine.energy(data)
    assert energy.dissipated_normal - start.dissipated_normal > -1e-7


@pytest.mark.parametrize("timestep", [0.002, 0.004])
def test_what_hangs_on_a_chain_comes_to_rest(timestep: float) -> None:
    """Its first joint stands on the drum by all links between, which turn though those do not."""
    engine = dashpot.Engine(chain_on_drum(timestep, 1.5, links=60))
    data = engine.make_data()
    engine.step(data, nstep=round(2.8 / timestep))
    recovered, fastest = engine.energy(data).dissipated_recovery, 0.0
    for _ in range(round(0.2 / timestep)):
        engine.step(data)
        fastest = max(fastest, np.abs(data.qvel).max())
    # The swing that the start gave the lower ends has 0.04 to 0.05 rad/s left, in mj_step too.
    assert fastest < 0.1
    # Weights turn over 0.1 J in the first swing; nothing pays for more of it.
    assert engine.energy(data).dissipated_recovery - recovered > -2e-6


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit"])
@pytest.mark.parametrize("turn", [1.0, 2.5, 3.0, 4.5, 6.0])
def test_a_damper_beside_a_spring_that_swings_within_a_step(turn: float, integrator: str) -> None:
    """A mass stands on an undamped spring and swings by `turn` (rad) in a step.

    What it has above its energy at rest falls as e^(-D t / m), all of it taken by the damper.
    """
    timestep, damping, steps = 0.01, 5.0, 40
    stiffness = (turn / timestep) ** 2
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="{timestep}" integrator="{integrator}"/><worldbody>
        <geom type="plane" size="0 0 1"/>
        <body pos="0 0 .1"><joint type="slide" axis="0 0 1" damping="{damping}"/>
          <geom size=".1" mass="1"/></body></worldbody></mujoco>""")
    engine = dashpot.Engine(model)
    for geom in range(2):
        engine.set_material(geom, dashpot.Material(2 * stiffness, damping=0.0))
    data = engine.make_data()
    sag = 9.81 / stiffness
    data.qpos[0] = -0.5 * sag
    engine.step(data)

    def excess() -> float:
        return 0.5 * (data.qvel[0] ** 2 + stiffness * (data.qpos[0] + sag) ** 2)

    start, at_start = excess(), engine.energy(data)
    assert start < 0.9 * 0.5 * stiffness * sag**2  # it does not come off
    engine.step(data, nstep=steps)
    taken, energy = start - excess(), engine.energy(data)
    # Energy falls unevenly within a swing by 2 D / (m omega); H D / m is 0.05.
    rate = -np.log(excess() / start) / (steps * timestep)
    assert rate == pytest.approx(damping, rel=0.05)
    damped = energy.dissipated_damping - at_start.dissipated_damping
    assert damped == pytest.approx(taken, rel=0.02)
    assert energy.dissipated_normal - at_start.dissipated_normal == pytest.approx(
        0.0, abs=0.02 * taken
    )
