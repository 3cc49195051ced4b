"""Normals of touching shapes: contacts of a step, and MuJoCo's own, against distance queries.

Random attitudes and directions of approach; the shapes overlap by 10 um. An angle is that between
the normal of the deepest contact and that of the query, which proves its distance.

    python benchmarks/contact_normals.py -n 200        # a minute
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Sequence

import mujoco
import numpy as np

import dashpot
from scene import Array, Scene
from simulate import AS_SHIPPED, DASHPOT, Setting, prepare

OVERLAP = 1e-5  # m
OFF = 0.01  # rad
TIMESTEP = 0.002  # s


def pebble() -> str:
    """Return the vertices of a hull of 60 corners about a ball of 3 cm."""
    corners = np.random.default_rng(0).normal(size=(60, 3))
    corners *= 0.03 / np.linalg.norm(corners, axis=1)[:, None]
    return " ".join(f"{x:.6f}" for x in corners.ravel())


SHAPES = {
    "capsule": 'type="capsule" size="0.02 0.03"',
    "ellipsoid": 'type="ellipsoid" size="0.02 0.03 0.04"',
    "cylinder": 'type="cylinder" size="0.02 0.04"',
    "box": 'type="box" size="0.03 0.02 0.04"',
    "pebble": 'type="mesh" mesh="pebble"',
}


def shapes(first: str, second: str) -> Scene:
    """Return two shapes without gravity, the second one free."""
    return Scene(
        name=f"{first}, {second}",
        title=f"{first} and {second} that touch",
        xml=f"""
<mujoco><option gravity="0 0 0"/><asset><mesh name="pebble" vertex="{pebble()}"/></asset>
<worldbody><geom name="first" {SHAPES[first]}/>
  <body><freejoint/><geom name="second" {SHAPES[second]}/></body></worldbody></mujoco>""",
        duration=0.0,
        measure=lambda run: {},
    )


def push_together(
    engine: dashpot.Engine, data: mujoco.MjData, rng: np.random.Generator
) -> np.ndarray | None:
    """Let the second shape overlap the first one; return the normal, None where they miss."""
    attitude, along = rng.normal(size=4), rng.normal(size=3)
    along /= np.linalg.norm(along)
    data.qpos[3:] = attitude / np.linalg.norm(attitude)
    data.qpos[:3] = 0.12 * along
    for _ in range(50):
        mujoco.mj_kinematics(engine.model, data)
        found = dashpot.distance(engine, data, "first", "second")
        if abs(found.distance + OVERLAP) < 1e-10:
            return found.normal
        data.qpos[:3] -= along * (found.distance + OVERLAP) / max(0.05, abs(found.normal @ along))
    return None


def angle_to(normal: np.ndarray, contact: mujoco.MjContact) -> float:
    """Return the angle (rad) between a normal and that of the deepest of some contacts."""
    return float(np.arccos(min(1.0, abs(contact.frame[contact.dist.argmin(), :3] @ normal))))


def measure(first: str, second: str, count: int, settings: Sequence[Setting]) -> Array:
    """Return the angles (rad) of the normals of each setting, (placements, settings).

    A setting that finds no contact is off by a right angle.
    """
    scene = shapes(first, second)
    engine = dashpot.Engine(scene.model(TIMESTEP))
    placed = engine.make_data()
    ways = [(s.dashpot, *prepare(scene, s, TIMESTEP)) for s in settings]
    rng = np.random.default_rng(1)
    angles = []
    for _ in range(count):
        mujoco.mj_resetData(engine.model, placed)
        normal = push_together(engine, placed, rng)
        if normal is None:
            continue
        row = []
        for ours, model, data, advance in ways:
            mujoco.mj_resetData(model, data)
            data.qpos[:] = placed.qpos
            if ours:
                advance(1)
            else:
                mujoco.mj_forward(model, data)
            row.append(angle_to(normal, data.contact) if data.ncon else np.pi / 2)
        angles.append(row)
    return np.array(angles)


def pairs() -> list[tuple[str, str]]:
    """Return the pairs of shapes."""
    return list(itertools.combinations_with_replacement(SHAPES, 2))


def worst_share(setting: Setting, count: int) -> float:
    """Return the share of normals that are off, of the pair of shapes with the most."""
    return max(float(np.mean(measure(*pair, count, [setting]) > OFF)) for pair in pairs())


def main() -> None:
    """Print a line for each pair of shapes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=200, help="placements of each pair")
    count = parser.parse_args().n
    print(f"| shapes | off by more than {OFF} rad: dashpot, MuJoCo | median | worst |")
    print("|---|---|---|---|")
    for first, second in pairs():
        ours, own = measure(first, second, count, [DASHPOT, AS_SHIPPED]).T
        print(
            f"| {first}, {second} | {np.mean(ours > OFF):.1%}, {np.mean(own > OFF):.1%} "
            f"| {np.median(ours):.0e}, {np.median(own):.0e} | {ours.max():.1g}, {own.max():.1g} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
