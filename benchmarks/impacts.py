"""Shots at thin plates and bounces of spinning boxes, with steps cut at impacts.

usage: python benchmarks/impacts.py [-n 1000] [--only shots bounces rigid energy cost]

Shots: spheres, boxes and hulls of 5 to 50 mm at 10 to 300 m/s, spinning, up to 70 degrees from the
normal, at plates of 0.5 to 5 mm, time step 1 to 10 ms. Counts the bodies that end behind the plate,
for ``impact="none"`` and ``"cut"``. Bounces: error of linear and angular velocity after a bounce
of a box off a wall at 5 ms, against 1 us without cuts. Rigid bounces: the same against springs of
1e11 N/m with the same restitution and friction at 0.25 us, where springs of 1e10 N/m at 0.5 us
agree with them to 0.3 %: the limit of ever stiffer springs. Energy: the largest gain in a step of
an elastic box that bounces in a closed room. Cost: a step of cut bodies beside one that is not cut.
"""

from __future__ import annotations

import argparse
import itertools
import time
from dataclasses import dataclass, replace

import mujoco
import numpy as np

import dashpot
from piles import random_quat
from random_scenes import log_uniform

KINDS = ("sphere", "box", "hull")
# Large against the way that any shot slides: nothing gets around the plate.
PLATE_HALF_LENGTH = 20.0
CONVERGED = 3e-3  # relative change of a rigid reference from one stiffness to the next


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
        return relative_errors(self.after(timestep, impact), self.after(1e-6, "none"))

    def made_of(self, stiffness: float | None) -> Bounce:
        """Return the same bounce with another stiffness, None for rigid."""
        return replace(self, material=replace(self.material, stiffness=stiffness))

    def rigid_reference(self) -> tuple[np.ndarray, bool]:
        """Velocity (6,) in the limit of stiff springs, and whether the limit is reached."""
        exact = self.made_of(1e11).after(2.5e-7, "none")
        before = self.made_of(1e10).after(5e-7, "none")
        return exact, max(relative_errors(before, exact)) < CONVERGED


def relative_errors(got: np.ndarray, exact: np.ndarray) -> tuple[float, float]:
    """Return the relative errors of linear and angular velocity, each array (6,)."""
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


@dataclass(frozen=True)
class Room:
    """Bodies in a closed room, and their generalized velocities."""

    xml: str
    velocity: np.ndarray

    def enter(
        self, material: dashpot.Material, impact: str
    ) -> tuple[dashpot.Engine, mujoco.MjData]:
        """Return an engine in which everything is of one material, and data at the start."""
        model = mujoco.MjModel.from_xml_string(self.xml)
        engine = dashpot.Engine(model, impact=impact)
        engine.set_materials(dict.fromkeys(range(model.ngeom), material))
        data = engine.make_data()
        data.qvel[:] = self.velocity
        return engine, data


def bouncing_boxes(count: int, timestep: float, *, speed: float = 6.0, seed: int = 1) -> Room:
    """Return boxes of 40 to 120 mm that fly about in a closed room without gravity."""
    rng = np.random.default_rng(seed)
    side = int(np.ceil(count ** (1 / 3)))
    half = 0.11 * side + 0.1
    bodies = ""
    for index in range(count):
        cell = np.array(np.unravel_index(index, (side, side, side))) - 0.5 * (side - 1)
        size = rng.uniform(0.02, 0.06, 3)
        bodies += f"""<body pos="{" ".join(map(str, 0.22 * cell))}"
            quat="{" ".join(map(str, random_quat(rng)))}"><freejoint/>
            <geom type="box" size="{" ".join(map(str, size))}"/></body>"""
    walls = ""
    for axis in range(3):
        for sign in (-1, 1):
            place, size = np.zeros(3), np.full(3, half + 0.1)
            place[axis], size[axis] = sign * (half + 0.05), 0.05
            walls += f"""<geom type="box" pos="{" ".join(map(str, place))}"
                size="{" ".join(map(str, size))}"/>"""
    velocity = rng.normal(size=(count, 6)) * speed / np.sqrt(3.0)
    velocity[:, 3:] *= 5.0
    xml = f"""<mujoco><option gravity="0 0 0" timestep="{timestep}"/><size memory="50M"/>
        <worldbody>{walls}{bodies}</worldbody></mujoco>"""
    return Room(xml, velocity.ravel())


def largest_gain(
    room: Room, material: dashpot.Material, steps: int, impact: str = "cut"
) -> tuple[float, float]:
    """Largest gain of kinetic and elastic energy in a step, and what is left at the end.

    Both are parts of the energy at the start.
    """
    engine, data = room.enter(material, impact)

    def energy() -> float:
        now = engine.energy(data)
        return now.kinetic + now.elastic

    start = last = energy()
    gain = 0.0
    for _ in range(steps):
        engine.step(data)
        now = energy()
        gain, last = max(gain, now - last), now
    return gain / start, last / start


def print_shots(count: int) -> None:
    """Print how many shots pass through."""
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


def print_errors(title: str, errors: list[tuple[float, float]]) -> None:
    """Print medians and how many errors are within 1 %."""
    median, most, worst = np.quantile(errors, (0.5, 0.9, 1.0), axis=0)
    within = (np.max(errors, axis=1) < 0.01).mean()
    print(
        f"{title}: {len(errors)} bounces at 5 ms, relative errors of linear and angular velocity: "
        f"median {median.round(5)}, 90 % {most.round(5)}, worst {worst.round(5)}, "
        f"both within 1 %: {within:.1%}"
    )


def print_bounces(count: int) -> None:
    """Print the errors of bounces off springs."""
    bounces = [random_bounce(seed) for seed in range(count)]
    exact = [bounce.after(1e-6, "none") for bounce in bounces]
    for impact in ("none", "cut"):
        got = [bounce.after(0.005, impact) for bounce in bounces]
        print_errors(f"impact={impact}", list(map(relative_errors, got, exact)))


def print_rigid_bounces(count: int) -> None:
    """Print the errors of rigid bounces where the limit of stiff springs is reached."""
    errors = {"none": [], "cut": []}
    for seed in range(count):
        bounce = random_bounce(seed)
        exact, converged = bounce.rigid_reference()
        if not converged:
            continue
        for impact, found in errors.items():
            got = bounce.made_of(None).after(0.005, impact)
            found.append(relative_errors(got, exact))
    for impact, found in errors.items():
        print_errors(f"rigid, impact={impact}", found)


def print_energy(count: int) -> None:
    """Print the largest gain of elastic boxes in a step."""
    for impact, stiffness, timestep in itertools.product(
        ("none", "cut"), (1e6, 1e8, None), (0.001, 0.002, 0.01)
    ):
        material = dashpot.Material(stiffness=stiffness, restitution=1.0, friction=0.0)
        results = [
            largest_gain(
                bouncing_boxes(1, timestep, seed=seed), material, round(1 / timestep), impact
            )
            for seed in range(1, count + 1)
        ]
        print(
            f"elastic boxes, impact={impact}, stiffness {stiffness}, dt {timestep}: largest gain "
            f"in a step {max(gain for gain, _ in results):.1e}, left after 1 s "
            f"{min(left for _, left in results):.4f} to {max(left for _, left in results):.4f}"
        )


def print_cost() -> None:
    """Print the time of a step with and without cuts."""
    material = dashpot.Material(restitution=0.95, friction=0.3)
    for count in (1, 8, 27):
        for timestep in (0.002, 0.01):
            room = bouncing_boxes(count, timestep)
            for impact in ("none", "cut"):
                engine, data = room.enter(material, impact)
                start = time.process_time()
                steps = round(0.5 / timestep)
                cuts = engine.step(data, nstep=steps).cuts
                used = (time.process_time() - start) / steps
                print(
                    f"{count} rigid boxes, dt {timestep}, impact={impact}: {1e6 * used:.0f} us and "
                    f"{cuts / steps:.1f} cuts a step"
                )


def main() -> None:
    """Print the results of every part, or of some."""
    parts = ("shots", "bounces", "rigid", "energy", "cost")
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=1000, help="shots; bounces: a tenth")
    parser.add_argument("--only", nargs="+", choices=parts, default=parts)
    arguments = parser.parse_args()
    run = {
        "shots": lambda: print_shots(arguments.n),
        "bounces": lambda: print_bounces(max(1, arguments.n // 10)),
        "rigid": lambda: print_rigid_bounces(max(1, arguments.n // 10)),
        "energy": lambda: print_energy(5),
        "cost": print_cost,
    }
    for part in arguments.only:
        run[part]()


if __name__ == "__main__":
    main()
