"""Rows of the table that compares with tuned MuJoCo: scenes, and the one number that each has."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, isfinite

import mujoco
import numpy as np

import contact_normals
import falls
import trots
from carried import OBJECTS, carrying
from nonholonomic import nonholonomic
from piles import balls_666, pile
from rolling import tumblers
from scene import Scene
from scenes import ball_drop, gripper, rise, roll, slide, slope, spin, stack, wall_press
from simulate import Setting, record
from smooth_drift import mechanisms
from standing import standing


@dataclass(frozen=True)
class Outcome:
    """The number of a row, smaller is better, and the processor time a simulated second (s)."""

    error: float
    cost: float = inf


FAILED = Outcome(inf)
Measure = Callable[[Setting, float], Outcome]


@dataclass(frozen=True)
class Row:
    """A row: `measure` gives its outcome with a setting at a time step, `screen` a shorter one.

    The search tries settings by `screen` at `screen_timesteps`, or at all of the row's. `total`
    puts the numbers of all time steps together: the worst, unless it says else. `direct`: the scene
    states a stiffness that MuJoCo's direct solref can have.
    """

    name: str
    title: str
    unit: str
    timesteps: tuple[float, ...]
    measure: Measure
    screen: Measure
    total: Callable[[Sequence[float]], float] = max
    direct: bool = False
    screen_timesteps: tuple[float, ...] = ()

    def screened(self, setting: Setting) -> float:
        """Return the number by which the search compares settings."""
        numbers = []
        for timestep in self.screen_timesteps or self.timesteps:
            numbers.append(self.screen(setting, timestep).error)
            if numbers[-1] == inf:
                return inf
        return self.total(numbers)


def outcome(scene: Scene, quantity: str, setting: Setting, timestep: float) -> Outcome:
    """Return what one scene gives, `FAILED` where it diverges or its setting is refused."""
    try:
        run = record(scene, setting, timestep)
        error = scene.measure(run)[quantity]
    except (ValueError, IndexError, RuntimeError, mujoco.FatalError, np.linalg.LinAlgError):
        return FAILED
    if run.diverged or not isfinite(error):
        return FAILED
    return Outcome(float(error), run.cpu / scene.duration)


def worst_of(scenes: Sequence[Scene], quantity: str) -> Measure:
    """Return the measure of several scenes: the worst number, the mean cost."""

    def measure(setting: Setting, timestep: float) -> Outcome:
        outcomes = []
        for scene in scenes:
            outcomes.append(outcome(scene, quantity, setting, timestep))
            if outcomes[-1] is FAILED:
                return FAILED
        return Outcome(
            max(o.error for o in outcomes), sum(o.cost for o in outcomes) / len(outcomes)
        )

    return measure


def row_of(
    scenes: Sequence[Scene],
    *,
    quantity: str | None = None,
    name: str | None = None,
    title: str | None = None,
    short: Sequence[Scene] | None = None,
    screen_timesteps: tuple[float, ...] = (),
) -> Row:
    """Return the row of one or several scenes; the first of their targets is its number."""
    first = scenes[0]
    quantity = quantity or next(iter(first.targets))
    measure = worst_of(scenes, quantity)
    return Row(
        name or first.name,
        title or first.title,
        first.units.get(quantity, ""),
        first.timesteps,
        measure,
        measure if short is None else worst_of(short, quantity),
        direct=first.direct_solref is not None,
        screen_timesteps=screen_timesteps,
    )


def falls_row() -> Row:
    """Return how many of the thrown robots diverge; the screen throws each once."""
    models = falls.robots()

    def measured(seeds: Sequence[int]) -> Measure:
        def measure(setting: Setting, timestep: float) -> Outcome:
            ends = [
                falls.fall(falls.falling(name, model, seed), setting, timestep)
                for name, model in models.items()
                for seed in seeds
            ]
            spent = [seconds for diverged, seconds in ends if not diverged]
            cost = float(np.mean(spent)) / falls.DURATION if spent else inf
            return Outcome(float(sum(diverged for diverged, _ in ends)), cost)

        return measure

    title = f"{len(models)} robots thrown on the floor {len(falls.SEEDS)} times each, diverged"
    every, few = measured(falls.SEEDS), measured(falls.SEEDS[:1])
    return Row(
        "falls", title, "", falls.TIMESTEPS, every, few, total=sum, screen_timesteps=(0.002, 0.01)
    )


def trots_row() -> Row:
    """Return the mean error of the way that quadrupeds trot; the screen takes every other one."""
    models = {name: trots.load(name) for name in trots.ROBOTS.split()}
    converged = {name: trots.converged(model) for name, model in models.items()}

    def measured(names: Sequence[str]) -> Measure:
        def measure(setting: Setting, timestep: float) -> Outcome:
            ways = {
                n: outcome(trots.trotting(n, models[n]), "way", setting, timestep) for n in names
            }
            if FAILED in ways.values():
                return FAILED
            errors = [abs(way.error - converged[name]) for name, way in ways.items()]
            cost = float(np.mean([way.cost for way in ways.values()]))
            return Outcome(float(np.mean(errors)), cost)

        return measure

    title = f"{len(models)} quadrupeds trotting, mean error of their way"
    every, few = measured(list(models)), measured(list(models)[::2])
    return Row("trots", title, "m", (trots.TIMESTEP,), every, few)


def normals_row() -> Row:
    """Return the share of normals of touching shapes that are off."""

    def measured(count: int) -> Measure:
        def measure(setting: Setting, timestep: float) -> Outcome:
            return Outcome(contact_normals.worst_share(setting, count), 0.0)

        return measure

    title = f"normals of touching shapes, share off by {contact_normals.OFF:g} rad, worst pair"
    return Row("normals", title, "", (0.002,), measured(100), measured(20))


def rows() -> dict[str, Callable[[], Row]]:
    """Return what makes each row, by name; rows of robots read their models from packages."""
    drift, short_drift = (
        {s.name: s for s in mechanisms(duration=duration)} for duration in (12.0, 3.0)
    )
    crank, short_crank = drift.pop("slider-crank"), short_drift.pop("slider-crank")
    heavy = {"masses": (1.0,) * 9 + (100.0,), "stiffness": None}
    short_pile = [dataclasses.replace(pile(count=15), duration=2.5)]
    found = [
        row_of(
            [ball_drop(restitution=e) for e in (1.0, 0.9, 0.5)],
            name="ball",
            title="Kelvin-Voigt ball, e = 1, 0.9, 0.5, apex error",
            screen_timesteps=(0.001, 0.005, 0.01),
        ),
        row_of([slope()], short=[slope(duration=3.0)]),
        row_of([slide()]),
        row_of([rise()]),
        row_of([wall_press()], short=[wall_press(duration=1.0)]),
        row_of([gripper()], short=[gripper(duration=4.0)]),
        row_of([roll()]),
        row_of([stack()], short=[stack(duration=2.0)]),
        row_of([stack(**heavy)], short=[stack(**heavy, duration=2.5)]),
        *(
            row_of(
                [spin()],
                quantity=f"{kind} error",
                name=f"spin-{kind}",
                short=[spin(duration=10.0)],
            )
            for kind in ("energy", "momentum")
        ),
        *(
            row_of([scene], quantity="growth" if scene.name == "wobble" else None)
            for scene in nonholonomic()
        ),
        *(
            row_of(
                [pile()],
                quantity=f"{kind} mean",
                name=f"pile-{kind}",
                title=f"40-body pile, mean overlap {kind}",
                short=short_pile,
            )
            for kind in ("falling", "settled")
        ),
        row_of([balls_666()], short=[balls_666(side=4, duration=2.0)]),
        row_of(
            list(drift.values()),
            name="drift",
            title="mechanisms, change of energy in 12 s",
            short=list(short_drift.values()),
        ),
        row_of([crank], short=[short_crank]),
        row_of(
            tumblers(),
            name="tumbler",
            title="tumblers, change of energy in 20 s",
            short=tumblers(duration=5.0),
        ),
        row_of(standing(), name="standing", title="body on a leg, error of its swing after 5 s"),
        row_of(
            [carrying(shape) for shape in OBJECTS],
            name="carried",
            title="objects in the gripper of an arm, slip in 20 s",
            short=[carrying(shape, duration=4.0) for shape in ("box", "sphere")],
        ),
    ]
    made: dict[str, Callable[[], Row]] = {row.name: lambda row=row: row for row in found}
    return made | {"falls": falls_row, "trots": trots_row, "normals": normals_row}
