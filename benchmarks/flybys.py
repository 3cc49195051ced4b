"""Bodies that fly past each other closely are not deflected, and those that graze touch.

usage: python benchmarks/flybys.py [-n 500]

Two spheres, capsules, boxes or cylinders of 1 to 8 cm that fly past each other at 1 to 10 m/s,
seven of ten pairs spinning at up to 30 rad/s, without gravity. Their least distance, along motion
that nothing disturbs, is 0.05 to 3 mm (six of ten), or they overlap by as much. Counts the first
whose velocity changes, and the others whose velocity does not.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import mujoco
import numpy as np

import dashpot
from piles import random_quat
from random_scenes import log_uniform

TIMESTEPS = (1e-3, 2e-3, 5e-3, 1e-2)
RESOLVED = 2e-5  # m, to which the least distance asked for is found


def random_geom(rng: np.random.Generator) -> str:
    """Return the attributes of a geom."""
    size = log_uniform(rng, 0.01, 0.08)
    a, b = rng.uniform(0.3, 1.0, 2)
    return (
        f'type="sphere" size="{size}"',
        f'type="capsule" size="{0.5 * size * a} {size}"',
        f'type="box" size="{size} {size * a} {size * b}"',
        f'type="cylinder" size="{size * a} {size}"',
    )[rng.integers(4)]


def random_direction(rng: np.random.Generator) -> np.ndarray:
    """Return a unit vector."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


@dataclass
class FlyBy:
    """Two bodies, their motion, and when and how far from each other their centres pass."""

    xml: str
    velocity: np.ndarray  # (2, 3), m/s
    spin: np.ndarray  # (2, 3), rad/s, world; inertia is isotropic
    attitude: np.ndarray  # (2, 4)
    sideways: np.ndarray  # unit, normal to the relative velocity
    time: float  # s
    reach: float  # m, sum of the bounding radii
    offset: float = 0.0  # m, along `sideways`

    def __post_init__(self) -> None:
        self.engine = dashpot.Engine(mujoco.MjModel.from_xml_string(self.xml.format(0.001)))
        self.data = self.engine.make_data()

    def place(self, time: float) -> np.ndarray:
        """Return the generalized position of undisturbed flight."""
        poses = []
        for body in range(2):
            position = self.velocity[body] * time
            if body == 1:
                relative = self.velocity[1] - self.velocity[0]
                position = position + self.offset * self.sideways - relative * self.time
            quat = self.attitude[body].copy()
            mujoco.mju_quatIntegrate(quat, in_frame_of(self.attitude[body], self.spin[body]), time)
            poses.append([*position, *quat])
        return np.concatenate(poses)

    def distance(self, time: float) -> float:
        """Return the signed distance of the geoms, m."""
        self.data.qpos[:] = self.place(time)
        mujoco.mj_kinematics(self.engine.model, self.data)
        return dashpot.distance(self.engine, self.data, "first", "second").distance

    def clearance(self) -> float:
        """Return the least distance while they pass, m."""
        speed = float(np.linalg.norm(self.velocity[1] - self.velocity[0]))
        half = 1.1 * self.reach / speed
        low, high, least = self.time - half, self.time + half, np.inf
        for count in (41, 13, 13):
            times = np.linspace(low, high, count)
            distances = [self.distance(t) for t in times]
            k = int(np.argmin(distances))
            low, high = times[max(k - 1, 0)], times[min(k + 1, count - 1)]
            least = min(least, distances[k])
        return least

    def is_disturbed(self, timestep: float) -> bool:
        """Whether the velocity of the first body changes."""
        engine = dashpot.Engine(mujoco.MjModel.from_xml_string(self.xml.format(timestep)))
        data = engine.make_data()
        data.qpos[:] = self.place(0.0)
        for body in range(2):
            data.qvel[6 * body : 6 * body + 3] = self.velocity[body]
            data.qvel[6 * body + 3 : 6 * body + 6] = in_frame_of(
                self.attitude[body], self.spin[body]
            )
        start = data.qvel[:3].copy()
        engine.step(data, nstep=int(2.2 * self.time / timestep) + 2)
        return bool(np.linalg.norm(data.qvel[:3] - start) > 1e-9)


def in_frame_of(quat: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return a vector of the world in the frame of a body."""
    inverse, local = np.empty(4), np.empty(3)
    mujoco.mju_negQuat(inverse, quat)
    mujoco.mju_rotVecQuat(local, vector, inverse)
    return local


def random_fly_by(seed: int) -> tuple[FlyBy, float] | None:
    """Return a fly-by and its clearance (m); None where no offset gives the one drawn."""
    rng = np.random.default_rng(seed)
    bodies = "".join(
        f'<body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="{i} {i} {i}"/>'
        f'<geom name="{name}" {random_geom(rng)}/></body>'
        for name, i in (("first", 1e-3), ("second", 2e-3))
    )
    xml = f"""<mujoco><option timestep="{{}}" gravity="0 0 0"/>
        <worldbody>{bodies}</worldbody></mujoco>"""
    speed = log_uniform(rng, 1.0, 10.0)
    spin = rng.uniform(0.0, 30.0) * (rng.random() < 0.7)
    spins = np.array([random_direction(rng) * spin * rng.random() for _ in range(2)])
    along = random_direction(rng)
    first = -rng.uniform(0.0, 1.0) * speed * along
    sideways = np.cross(along, random_direction(rng))
    sideways /= np.linalg.norm(sideways)
    attitude = np.array([random_quat(rng) for _ in range(2)])
    reach = float(mujoco.MjModel.from_xml_string(xml.format(0.001)).geom_rbound.sum())
    time = (1.2 * reach + 0.02) / speed + rng.uniform(0.0, 0.02)
    velocity = np.array([first, first + speed * along])
    flight = FlyBy(xml, velocity, spins, attitude, sideways, time, reach)
    wanted = log_uniform(rng, 5e-5, 3e-3) * (1 if rng.random() < 0.6 else -1)
    low, high = 0.0, reach + 0.01
    for _ in range(40):
        flight.offset = 0.5 * (low + high)
        if flight.clearance() > wanted:
            high = flight.offset
        else:
            low = flight.offset
    clearance = flight.clearance()
    return (flight, clearance) if abs(clearance - wanted) < RESOLVED else None


def main() -> None:
    """Print how many are deflected without a touch, and how many touch without an effect."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=500, help="number of pairs drawn")
    flights = [f for seed in range(parser.parse_args().n) if (f := random_fly_by(seed))]
    passing = [flight for flight, clearance in flights if clearance > 0.0]
    grazing = [flight for flight, clearance in flights if clearance < 0.0]
    for timestep in TIMESTEPS:
        deflected = sum(flight.is_disturbed(timestep) for flight in passing)
        missed = sum(not flight.is_disturbed(timestep) for flight in grazing)
        print(
            f"{1e3 * timestep:g} ms: {deflected} of {len(passing)} that pass are deflected, "
            f"{missed} of {len(grazing)} that graze do not touch"
        )


if __name__ == "__main__":
    main()
