"""Contacts that start inside a step are among those found at its start.

usage: python benchmarks/reach.py [-n 1000]

Two to five fast bodies that fly about each other's middle, long spinning boxes among them, alone or
with a second geom off their centre, over a plane, and in half of the scenes a spinning pendulum of
two links; 1 to 20 ms, 3 to 30 m/s, up to 150 rad/s. What overlaps at one of fifty moments of their
motion without contact, and not at the start, has started in the step, unless one of the two has met
something at an earlier moment, which sends it elsewhere.
"""

from __future__ import annotations

import argparse
import copy

import mujoco
import numpy as np

import dashpot
from piles import random_quat
from random_scenes import log_uniform

MOMENTS = 50
RESOLVED = 1e-6  # m, overlap that counts
PENDULUM = """<body pos="{} 0 .2"><joint type="hinge" axis="{} 1 0"/>
  <geom type="box" size=".15 .02 .02" pos=".15 0 0"/><body pos=".3 0 0"><joint type="ball"/>
  <geom type="capsule" size=".01 .1" pos="0 0 .1"/></body></body>"""


def random_flight(seed: int) -> tuple[mujoco.MjModel, np.ndarray]:
    """Return a model, its time step included, and generalized velocities."""
    rng = np.random.default_rng(seed)
    bodies = ""
    for _ in range(rng.integers(2, 6)):
        size = log_uniform(rng, 0.01, 0.1)
        a, b = rng.uniform(0.05, 1.0, 2)
        geom = (
            f'type="box" size="{size} {size * a} {size * b}"',
            f'type="box" size="{size} {size * a} {size * a}"',
            f'type="capsule" size="{0.5 * size * a} {size}"',
            f'type="sphere" size="{size}"',
        )[rng.integers(4)]
        offset = rng.normal(size=3) * size * rng.integers(2)
        bodies += f"""<body pos="{" ".join(map(str, rng.normal(size=3) * 0.2))}"
            quat="{" ".join(map(str, random_quat(rng)))}"><freejoint/>
            <geom {geom} pos="{" ".join(map(str, offset))}"/>"""
        if rng.random() < 0.3:
            bodies += f'<geom type="box" size="{0.3 * size} .02 .01" pos="0 {size} 0"/>'
        bodies += "</body>"
    if rng.random() < 0.5:
        bodies += PENDULUM.format(0.2 * rng.normal(), rng.normal())
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{log_uniform(rng, 1e-3, 2e-2)}"/><worldbody>
        <geom type="plane" size="5 5 1" pos="0 0 -.4"/>{bodies}</worldbody>
        <sensor><user dim="1" needstage="pos"/></sensor></mujoco>"""
    )
    velocity = np.empty(model.nv)
    spin = log_uniform(rng, 1.0, 150.0)
    for joint in range(model.njnt):
        first = model.jnt_dofadr[joint]
        free = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE
        last = model.jnt_dofadr[joint + 1] if joint + 1 < model.njnt else model.nv
        if free:
            inwards = -model.body_pos[model.jnt_bodyid[joint]] / 0.2
            velocity[first : first + 3] = rng.uniform(3, 30) * (inwards + 0.3 * rng.normal(size=3))
        rotation = slice(first + 3 * free, last)
        velocity[rotation] = rng.normal(size=rotation.stop - rotation.start) * spin
    return model, velocity


def overlapping(model: mujoco.MjModel, data: mujoco.MjData) -> set[tuple[int, int]]:
    """Return the pairs of geoms that may collide and overlap."""
    pairs = set()
    for first in range(model.ngeom):
        for second in range(first + 1, model.ngeom):
            body, other = model.geom_bodyid[first], model.geom_bodyid[second]
            if body == other or (body and model.body_parentid[other] == body):
                continue
            if mujoco.mj_geomDistance(model, data, first, second, 0.01, None) < -RESOLVED:
                pairs.add((first, second))
    return pairs


def movers(model: mujoco.MjModel, pair: tuple[int, int]) -> set[int]:
    """Return the kinematic trees of two geoms, without the world."""
    trees = {int(model.body_treeid[model.geom_bodyid[geom]]) for geom in pair}
    return trees - {-1}


def found_ahead(engine: dashpot.Engine, data: mujoco.MjData) -> list[tuple[int, int]]:
    """Step; return the geoms of the contacts that are found at its start, also of those ahead.

    The model has a user sensor of the position stage: after the step data have those that touched.
    """
    found: list[tuple[int, int]] = []

    def look(_: mujoco.MjModel, d: mujoco.MjData, stage: int) -> None:
        if stage == mujoco.mjtStage.mjSTAGE_POS:
            found.extend(tuple(sorted(geoms)) for geoms in d.contact.geom.tolist())

    mujoco.set_mjcb_sensor(look)
    try:
        engine.step(data)
    finally:
        mujoco.set_mjcb_sensor(None)
    return found


def starts_and_misses(seed: int) -> tuple[set[tuple[int, int]], set[tuple[int, int]]]:
    """Return the pairs whose contact starts inside the step, and those of them not among rows."""
    model, velocity = random_flight(seed)
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qvel[:] = velocity
    found = set(found_ahead(engine, data))

    ghosts = copy.copy(model)  # the same bodies without contact
    ghosts.geom_contype[:] = ghosts.geom_conaffinity[:] = 0
    ghosts.opt.timestep /= MOMENTS
    flight = dashpot.Engine(ghosts)
    data = flight.make_data()
    data.qvel[:] = velocity
    mujoco.mj_kinematics(model, data)
    at_start = overlapping(model, data)
    started: set[tuple[int, int]] = set()
    deflected: set[int] = set()
    for _ in range(MOMENTS):
        flight.step(data)
        mujoco.mj_kinematics(flight.model, data)
        met = overlapping(model, data) - at_start - started
        started |= {pair for pair in met if not deflected & movers(model, pair)}
        for pair in met:
            deflected |= movers(model, pair)
    return started, started - found


def main() -> None:
    """Print how many contacts start inside a step, and how many of them were not found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=1000, help="number of scenes")
    count = parser.parse_args().n
    started, missed = 0, []
    for seed in range(count):
        starts, misses = starts_and_misses(seed)
        started += len(starts)
        if misses:
            missed.append((seed, sorted(misses)))
    print(f"{count} scenes: {started} contacts start inside a step, not found: {missed}")


if __name__ == "__main__":
    main()
