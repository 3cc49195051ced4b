"""Shots at thin plates and bounces of spinning boxes, with steps cut at impacts.

usage: python benchmarks/impacts.py [-n 1000]

Shots: spheres, boxes and hulls of 5 to 50 mm at 10 to 300 m/s, spinning, up to 70 degrees from the
normal, at plates of 0.5 to 5 mm, time step 1 to 10 ms. Counts the bodies that end behind the plate,
for ``impact="none"`` and ``"cut"``. Bounces: error of linear and angular velocity after one bounce
of a box off a wall at 5 ms, against 1 us without cuts.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import mujoco
import numpy as np

import dashpot
from piles import random_quat
from random_scenes import log_uniform

KINDS = ("sphere", "box", "hull")
# Large against the way that any shot slides: nothing gets around the plate.
PLATE_HALF_LENGTH = 20.0


@dataclass(frozen=True)
class Shot:
    """One body about to hit a plate whose upper face is at z = 0."""

    xml: str
    timestep: float
    velocity: np.ndarray
    steps: int

    def fly(self, impact: str) -> tuple[bool, int]:
        """Whether the body ends behind the plate, and the number of cuts."""
        model = mujoco.MjModel.from_xml_string(self.xml)
        model.opt.timestep = self.timestep
        engine = dashpot.Engine(model, impact=impact)
        data = engine.make_data()
        data.qvel[:] = self.velocity
        cuts = engine.step(data, nstep=self.steps).cuts
        return not data.qpos[2] > 0.0, cuts


def random_shot(seed: int) -> Shot:
    """Return a shot that reaches the plate within 0.2 to 3 time steps, and two steps more."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    size = rng.uniform(0.005, 0.05)
    thickness = log_uniform(rng, 0.5e-3, 5e-3)
    timestep = log_uniform(rng, 1e-3, 1e-2)
    speed = log_uniform(rng, 10.0, 300.0)
    tilt, azimuth = np.radians(rng.uniform(0.0, 70.0)), rng.uniform(0.0, 2.0 * np.pi)
    direction = np.array(
        [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)]
    )
    flight = rng.uniform(0.2, 3.0)
    start = -direction * speed * timestep * flight
    start[2] += 2.0 * size  # no attitude reaches farther: clear of the plate
    angular = rng.normal(size=3)
    angular *= rng.uniform(0.0, 100.0) / np.linalg.norm(angular)
    asset = ""
    if kind == "sphere":
        geom = f'type="sphere" size="{size}"'
    elif kind == "box":
        geom = f'type="box" size="{size} {size * rng.uniform(0.3, 1)} {size * rng.uniform(0.3, 1)}"'
    else:
        points = rng.normal(size=(20, 3))
        points *= size * rng.uniform(0.4, 1, 3) / np.linalg.norm(points, axis=1, keepdims=True)
        vertices = " ".join(f"{x:.9g}" for x in points.ravel())
        asset = f'<asset><mesh name="hull" vertex="{vertices}"/></asset>'
        geom = 'type="mesh" mesh="hull"'
    xml = f"""<mujoco>{asset}<worldbody>
      <geom name="plate" type="box" pos="0 0 {-0.5 * thickness}"
            size="{PLATE_HALF_LENGTH} {PLATE_HALF_LENGTH} {0.5 * thickness}"/>
      <body pos="{" ".join(map(str, start))}" quat="{" ".join(map(str, random_quat(rng)))}">
        <freejoint/><geom name="shot" {geom} density="2000" friction="{rng.uniform(0, 1)}"/>
      </body></worldbody></mujoco>"""
    velocity = np.concatenate([speed * direction, angular])
    return Shot(xml, timestep, velocity, int(np.ceil(flight)) + 2)


@dataclass(frozen=True)
class Bounce:
    """A spinning box about to bounce off a wall whose face is at x = 0."""

    quat: str
    velocity: np.ndarray
    material: dashpot.Material

    def after(self, timestep: float, impact: str, duration: float = 0.02) -> np.ndarray:
        """Linear and angular velocity (6,) after `duration` (s)."""
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><option gravity="0 0 0" timestep="{timestep}"/><worldbody>
            <geom name="wall" type="box" size=".05 2 2" pos="-.05 0 0"/>
            <body pos="0.12 0 0" quat="{self.quat}"><freejoint/>
            <geom name="box" type="box" size=".05 .04 .03" mass=".3"/></body>
            </worldbody></mujoco>"""
        )
        engine = dashpot.Engine(model, impact=impact)
        engine.set_pair_material("wall", "box", self.material)
        data = engine.make_data()
        data.qvel[:] = self.velocity
        engine.step(data, nstep=round(duration / timestep))
        # Angular velocity of the body in the world; qvel has it in the turned frame.
        world = np.empty(3)
        mujoco.mju_rotVecQuat(world, data.qvel[3:], data.qpos[3:])
        return np.concatenate([data.qvel[:3], world])

    def errors(self, timestep: float, impact: str) -> tuple[float, float]:
        """Relative errors of linear and angular velocity against steps of 1 us."""
        exact = self.after(1e-6, "none")
        got = self.after(timestep, impact)
        return tuple(
            float(np.linalg.norm(got[part] - exact[part]) / np.linalg.norm(exact[part]))
            for part in (slice(0, 3), slice(3, 6))
        )


def random_bounce(seed: int) -> Bounce:
    """Return a box of 0.3 kg thrown at 5 to 15 m/s with up to 35 rad/s."""
    rng = np.random.default_rng(seed)
    velocity = np.array([-rng.uniform(5, 15), *rng.uniform(-3, 3, 2), *rng.uniform(-20, 20, 3)])
    stiffness = log_uniform(rng, 1e6, 1e8)
    material = dashpot.Material(
        stiffness=stiffness, restitution=rng.uniform(0.2, 0.95), friction=rng.uniform(0, 0.6)
    )
    return Bounce(" ".join(map(str, random_quat(rng))), velocity, material)


def main() -> None:
    """Print how many shots pass through, and the errors of the bounces."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=1000, help="number of shots; bounces: a tenth")
    count = parser.parse_args().n
    for impact in ("none", "cut"):
        through = {kind: 0 for kind in KINDS}
        cuts = []
        failed = []
        for seed in range(count):
            passed, number = random_shot(seed).fly(impact)
            through[KINDS[seed % len(KINDS)]] += passed
            cuts.append(number)
            if passed:
                failed.append(seed)
        print(
            f"impact={impact}: {count} shots, through the plate: {through}; "
            f"cuts mean {np.mean(cuts):.1f}, most {max(cuts)}; seeds {failed[:10]}"
        )
    bounces = [random_bounce(seed) for seed in range(count // 10)]
    for impact in ("none", "cut"):
        errors = np.array([bounce.errors(0.005, impact) for bounce in bounces])
        if not errors.size:
            continue
        median, most = np.median(errors, axis=0), np.quantile(errors, 0.9, axis=0)
        print(
            f"impact={impact}: {len(bounces)} bounces at 5 ms, relative errors of linear and "
            f"angular velocity: median {median.round(4)}, 90 % {most.round(4)}, "
            f"both within 1 %: {(errors < 0.01).all(axis=1).mean():.0%}"
        )


if __name__ == "__main__":
    main()
