"""Balls that a camera sees from the side: places along and up, of throws and drops.

A hard ball of 1e8 N/m touches for some 0.1 ms, in which it goes a tenth of the noise: no recording
here tells its stiffness. A ball that is dropped straight down tells no friction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

import dashpot
from dashpot.calibrate import Parameter, Problem, Trajectory

from .case import Case, draw, on_lines, simulate

Array = NDArray[np.float64]

RADIUS, MASS, STEP = 0.04, 0.2, 1 / 60
GRAVITY = np.array([0.0, 0.0, -9.81])
HARD = 1e8  # N/m
XML = f"""
<mujoco>
  <option timestep="{STEP:.5f}"/>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 .1"/>
    <body name="ball" pos="0 0 1">
      <freejoint/><geom name="ball" type="sphere" size="{RADIUS}" mass="{MASS}"/>
    </body>
  </worldbody>
</mujoco>
"""
RESTITUTION = Parameter.pair("ball", "floor", "restitution", start=0.6, bounds=(0.05, 0.98))
FRICTION = Parameter.pair("ball", "floor", "sliding_friction", start=0.2, bounds=(0.01, 2.0))
STIFFNESS = Parameter.pair("ball", "floor", "stiffness", start=1e6, bounds=(1e4, 1e9))
SOFT = Parameter.pair("ball", "floor", "stiffness", start=3e3, bounds=(3e2, 1e5))
# Thrown by hand without spin, or dropped, in the plane that the camera sees.
IN_PLANE = [np.inf, 0.0, np.inf, 0.0, 0.0, 0.0]


def engine(
    stiffness: float = HARD, restitution: float = 0.6, friction: float = 0.2
) -> dashpot.Engine:
    """Return an engine with the ball's material."""
    made = dashpot.Engine(mujoco.MjModel.from_xml_string(XML))
    material = dashpot.Material(stiffness=stiffness, restitution=restitution, friction=friction)
    made.set_pair_material("ball", "floor", material)
    return made


def steps_of(spacing: float) -> float:
    """Return the step that a problem takes between frames of a spacing."""
    return spacing / np.ceil(spacing / STEP - 1e-3)


def path(
    values: Mapping[str, float], rng: np.random.Generator, rate: float, frames: int, *, thrown: bool
) -> Array:
    """Return where a ball is (frames, 3), thrown at 2.7 to 3.5 m/s or dropped from 0.5 to 0.7 m."""
    system = engine(
        values.get("stiffness", HARD), values["restitution"], values["sliding_friction"]
    )
    qpos, qvel = np.array([0, 0, rng.uniform(0.4, 0.5), 1, 0, 0, 0.0]), np.zeros(6)
    if thrown:
        qvel[0] = rng.uniform(2.7, 3.5)
    else:
        qpos[2] = rng.uniform(0.5, 0.7)
    step = steps_of(1.0 / rate)
    count = round((frames - 1) / rate / step)
    states, _ = simulate(system, qpos, qvel, step, count)
    return on_lines(states[:, :3], np.arange(frames) / rate, step)


def noisy(place: Array, sigma: float, rng: np.random.Generator) -> Array:
    """Return places (n, 3) as the camera sees them, y not at all."""
    seen = place + sigma * rng.normal(size=place.shape)
    seen[:, 1] = np.nan
    return seen


def recording(name: str, time: Array, position: Array, **fields: object) -> Trajectory:
    """Return a trajectory whose start is guessed from its first frames, as a laboratory does."""
    first = time[:6] - time[0]
    level = np.nan_to_num(position[:6]) - 0.5 * GRAVITY * first[:, None] ** 2
    # A median of differences: of outliers there are some among the first frames too.
    pairs = np.triu_indices(len(first), 2)
    slopes = (level[pairs[1]] - level[pairs[0]]) / (first[pairs[1]] - first[pairs[0]])[:, None]
    velocity = np.median(slopes, axis=0)
    start = np.median(level - velocity * first[:, None], axis=0)
    return Trajectory(
        name, time, position, None, "ball",
        initial_qpos=[*start, 1, 0, 0, 0], initial_qvel=[*velocity, 0, 0, 0],
        initial_qpos_sigma=IN_PLANE, initial_qvel_sigma=IN_PLANE, **fields,
    )  # fmt: skip


def problem(
    trajectories: Sequence[Trajectory], unknown: Sequence[Parameter], sigma: float, **fields: object
) -> Problem:
    """Return a problem of positions with unknown starts."""
    return Problem(
        engine(), unknown, trajectories, sigma, initial_state="pose_and_velocity", **fields
    )


def material(rng: np.random.Generator) -> dict[str, float]:
    """Return a hidden restitution and a friction that slides."""
    return {"restitution": draw(rng, 0.5, 0.85), "sliding_friction": draw(rng, 0.04, 0.1)}


def at_30_frames(rng: np.random.Generator) -> list[Case]:
    """Two throws of a hard ball at 30 frames a second, with 5 mm of noise."""
    truth, time = material(rng), np.arange(34) / 30
    seen = [
        recording(f"throw {i}", time, noisy(path(truth, rng, 30, 34, thrown=True), 5e-3, rng))
        for i in range(2)
    ]
    return [Case(problem(seen, [RESTITUTION, FRICTION, STIFFNESS], 5e-3), truth, ("stiffness",))]


def lost_frames(rng: np.random.Generator) -> list[Case]:
    """Two drops of a soft ball at 60 frames a second, of which 40 % are lost."""
    truth = {"restitution": draw(rng, 0.5, 0.85), "stiffness": draw(rng, 1e3, 4e3)}
    seen = []
    for i in range(2):
        place = path({**truth, "sliding_friction": 0.3}, rng, 60, 70, thrown=False)
        kept = np.sort(rng.choice(np.arange(1, 70), 41, replace=False))
        kept = np.concatenate([[0], kept])
        seen.append(recording(f"drop {i}", kept / 60, noisy(place, 2e-3, rng)[kept]))
    return [Case(problem(seen, [RESTITUTION, SOFT, FRICTION], 2e-3), truth, ("sliding_friction",))]


def outliers(rng: np.random.Generator) -> list[Case]:
    """Two throws at 60 frames a second, one frame in twenty 0.1 to 0.5 m off."""
    truth, seen = material(rng), []
    for i in range(2):
        place = noisy(path(truth, rng, 60, 56, thrown=True), 2e-3, rng)
        off = rng.random(56) < 0.05
        angle = rng.uniform(0, 2 * np.pi, off.sum())
        away = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
        place[off] += rng.uniform(0.1, 0.5, (off.sum(), 1)) * away
        seen.append(recording(f"throw {i}", np.arange(56) / 60, place))
    made = problem(seen, [RESTITUTION, FRICTION, STIFFNESS], 2e-3)
    return [Case(made, truth, ("stiffness",), {"loss": "soft_l1"})]


def wrong_scale(rng: np.random.Generator) -> list[Case]:
    """Two throws with positions 15 % too long or too short."""
    truth, seen = material(rng), []
    scale = float(rng.choice([0.85, 1.15]) * (1 + 0.01 * rng.normal()))
    for i in range(2):
        place = noisy(scale * path(truth, rng, 60, 56, thrown=True), 2e-3, rng)
        seen.append(recording(f"throw {i}", np.arange(56) / 60, place))
    unknown = [RESTITUTION, FRICTION, STIFFNESS, Parameter.scale(bounds=(0.5, 2.0), name="scale")]
    return [Case(problem(seen, unknown, 2e-3), {**truth, "scale": scale}, ("stiffness",))]


def unknown_noise(rng: np.random.Generator) -> list[Case]:
    """Two throws whose noise is stated ten times too large or too small."""
    truth, seen = material(rng), []
    for i in range(2):
        place = noisy(path(truth, rng, 60, 56, thrown=True), 3e-3, rng)
        seen.append(recording(f"throw {i}", np.arange(56) / 60, place))
    stated = 3e-3 * 10.0 ** rng.choice([-1, 1])
    made = problem(seen, [RESTITUTION, FRICTION, STIFFNESS], stated, noise="estimate")
    return [Case(made, truth, ("stiffness",))]


def three_objects(rng: np.random.Generator) -> list[Case]:
    """Three balls of one restitution on three floors, the last of which is met straight down."""
    restitution = draw(rng, 0.5, 0.85)
    groups: dict[str, list[str]] = {}
    truth, seen = {"restitution": restitution}, []
    for ball in ("red", "green", "blue"):
        friction, thrown = draw(rng, 0.04, 0.1), ball != "blue"
        groups[ball] = [f"{ball} {i}" for i in range(1)]
        if thrown:
            truth[f"sliding_friction[{ball}]"] = friction
        values = {"restitution": restitution, "sliding_friction": friction}
        for name in groups[ball]:
            place = noisy(path(values, rng, 60, 54, thrown=thrown), 2e-3, rng)
            seen.append(recording(name, np.arange(54) / 60, place))
    unknown = [RESTITUTION, replace(FRICTION, per=groups)]
    return [Case(problem(seen, unknown, 2e-3), truth, ("sliding_friction[blue]",))]


def jittered(rng: np.random.Generator) -> list[Case]:
    """Two drops of a soft ball, with stamps that jitter by 0.2 of their spacing.

    Once with the camera's rate, once without.
    """
    truth = {"restitution": draw(rng, 0.6, 0.85), "stiffness": draw(rng, 1e3, 4e3)}
    stamps, places = [], []
    for _ in range(2):
        place = path({**truth, "sliding_friction": 0.3}, rng, 100, 100, thrown=False)
        places.append(noisy(place, 1e-3, rng))
        stamps.append(np.sort((np.arange(100) + 0.2 * rng.normal(size=100)) / 100))
    cases = []
    for rate in (100.0, None):
        seen = [
            recording(f"drop {i}", stamp, place, frames="even", rate=rate)
            for i, (stamp, place) in enumerate(zip(stamps, places, strict=True))
        ]
        made = problem(seen, [RESTITUTION, SOFT, FRICTION], 1e-3)
        cases.append(Case(made, truth, ("sliding_friction",)))
    return cases
