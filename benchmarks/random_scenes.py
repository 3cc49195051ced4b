"""Seeded random scenes over the whole range of parameters that the engine must survive."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

import dashpot
from piles import random_quat
from scenes import GRAVITY, free_body, mjcf


@dataclass(frozen=True)
class RandomScene:
    """A scene and how to step it: `steps` steps of `timestep` (s)."""

    seed: int
    xml: str
    timestep: float
    steps: int
    velocity: np.ndarray
    materials: dict[str, dashpot.Material]

    def engine(self) -> dashpot.Engine:
        """Return an engine at the scene's time step with its materials."""
        model = mujoco.MjModel.from_xml_string(self.xml)
        model.opt.timestep = self.timestep
        engine = dashpot.Engine(model)
        for geom, material in self.materials.items():
            engine.set_material(geom, material)
        return engine


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform between those of `low` and `high`."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def random_scene(seed: int, *, steps: int = 400) -> RandomScene:
    """Return 1 to 8 free bodies thrown at a floor and at each other.

    Masses 1 g to 1 t, stiffness 1e3 to 1e9 N/m (one geom in five rigid), damping ratio 0 to 2,
    friction 0 to 2, time step 0.1 to 20 ms, speeds to 3 m/s and 20 rad/s. Nothing overlaps at the
    start, so what the bodies hold then bounds their energy for ever.
    """
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 9))
    bodies, materials, velocity = [], {}, []
    height = 0.0
    for i in range(count):
        size = rng.uniform(0.03, 0.12, 3)
        mass = log_uniform(rng, 1e-3, 1e3)
        kind = rng.choice(["sphere", "box", "capsule", "cylinder", "ellipsoid"])
        friction = rng.uniform(0, 2)
        shape = " ".join(str(x) for x in size[: 3 if kind in ("box", "ellipsoid") else 2])
        if kind == "sphere":
            shape = str(size[0])
        radius = float(np.linalg.norm(size))  # no attitude of any shape reaches farther
        height += radius
        offset = rng.uniform(-0.05, 0.05, 2)
        geom = f'type="{kind}" size="{shape}" mass="{mass}" friction="{friction}"'
        quat = random_quat(rng)
        bodies.append(free_body(f"body{i}", geom, (*offset, height), quat=quat))
        height += radius
        if rng.uniform() > 0.2:
            materials[f"body{i}"] = dashpot.Material(
                log_uniform(rng, 1e3, 1e9), damping_ratio=float(rng.uniform(0, 2))
            )
        velocity.append([*rng.uniform(-3, 3, 3), *rng.uniform(-20, 20, 3)])
    timestep = log_uniform(rng, 1e-4, 0.02)
    floor = f'friction="{rng.uniform(0, 2)}"'
    return RandomScene(
        seed, mjcf("".join(bodies), floor=floor), timestep, steps, np.array(velocity), materials
    )


def mechanical_energy(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Kinetic plus gravitational energy (J) above the floor of a scene of free bodies."""
    inertia = model.body_inertia[1:]
    linear = data.qvel.reshape(-1, 6)[:, :3]
    angular = data.qvel.reshape(-1, 6)[:, 3:]
    mass = model.body_mass[1:]
    height = data.qpos.reshape(-1, 7)[:, 2]
    kinetic = 0.5 * (mass @ (linear**2).sum(axis=1) + (inertia * angular**2).sum())
    return float(kinetic + GRAVITY * mass @ height)


def check(scene: RandomScene) -> list[str]:
    """Step a scene and return what is wrong: no entry means it passed."""
    engine = scene.engine()
    data = engine.make_data()
    data.qvel[:] = scene.velocity.ravel()
    start = mechanical_energy(engine.model, data)
    chunk = max(1, scene.steps // 20)
    for done in range(chunk, scene.steps + 1, chunk):
        engine.step(data, nstep=chunk)
        if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
            return [f"seed {scene.seed}: not finite after {done} steps"]
        energy = mechanical_energy(engine.model, data)
        if energy > 1.01 * start:
            return [f"seed {scene.seed}: energy {energy / start:.4f} of start after {done} steps"]
        contacts = engine.contacts(data)
        # A pair slides with the larger of its two frictions (the default rule).
        friction = engine.model.geom_friction[contacts.geom, 0].max(axis=1)
        sliding = np.linalg.norm(contacts.force[:, 1:], axis=1)
        limit = friction * contacts.force[:, 0]
        # Rounding of a mean over micro-steps.
        if (sliding > limit * (1 + 1e-9) + 1e-12).any() or (contacts.force[:, 0] < 0).any():
            return [f"seed {scene.seed}: force outside its cone after {done} steps"]
    return []


def main() -> None:
    """Check a range of seeds: `python benchmarks/random_scenes.py 0 10000`."""
    import sys

    first, last = (int(a) for a in sys.argv[1:3])
    failures = []
    for seed in range(first, last):
        failures += check(random_scene(seed))
    print("\n".join(failures) or "no failure")
    print(f"{last - first} scenes, {len(failures)} failures")


if __name__ == "__main__":
    main()
