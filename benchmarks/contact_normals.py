"""Normals of touching shapes: contacts of a step, and MuJoCo's own, against distance queries.

Random attitudes and directions of approach; the shapes overlap by 10 um. An angle is that between
the normal of the deepest contact and that of the query, which proves its distance.

    python benchmarks/contact_normals.py -n 200        # a minute
"""

from __future__ import annotations

import argparse
import itertools

import mujoco
import numpy as np

import dashpot

OVERLAP = 1e-5  # m
OFF = 0.01  # rad


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


def make_model(first: str, second: str) -> mujoco.MjModel:
    """Return two shapes without gravity, the second one free."""
    return mujoco.MjModel.from_xml_string(f"""
<mujoco><option gravity="0 0 0"/><asset><mesh name="pebble" vertex="{pebble()}"/></asset>
<worldbody><geom name="first" {SHAPES[first]}/>
  <body><freejoint/><geom name="second" {SHAPES[second]}/></body></worldbody></mujoco>""")


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


def measure(first: str, second: str, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the angles (rad) of dashpot's and of MuJoCo's normals."""
    engine = dashpot.Engine(make_model(first, second))
    data, own = engine.make_data(), mujoco.MjData(engine.model)
    rng = np.random.default_rng(1)
    angles = []
    for _ in range(count):
        mujoco.mj_resetData(engine.model, data)
        normal = push_together(engine, data, rng)
        if normal is None:
            continue
        own.qpos[:] = data.qpos
        mujoco.mj_forward(engine.model, own)
        engine.step(data)
        angles.append((angle_to(normal, data.contact), angle_to(normal, own.contact)))
    by_dashpot, by_mujoco = np.array(angles).T
    return by_dashpot, by_mujoco


def main() -> None:
    """Print a line for each pair of shapes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=200, help="placements of each pair")
    count = parser.parse_args().n
    print(f"| shapes | off by more than {OFF} rad: dashpot, MuJoCo | median | worst |")
    print("|---|---|---|---|")
    for first, second in itertools.combinations_with_replacement(SHAPES, 2):
        ours, own = measure(first, second, count)
        print(
            f"| {first}, {second} | {np.mean(ours > OFF):.1%}, {np.mean(own > OFF):.1%} "
            f"| {np.median(ours):.0e}, {np.median(own):.0e} | {ours.max():.1g}, {own.max():.1g} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
