"""Accuracy in the situations of the README's table, and in flight.

Scenes and their durations are those of the other benchmarks; their targets name the figures. Piles
are not among them: which light body is deepest below heavy ones changes with rounding.
"""

from __future__ import annotations

from collections.abc import Iterator

from carried import OBJECTS, carrying
from flight import TIMESTEPS, TREES, conserved, flights
from gate_figures.figure import Figure
from nonholonomic import nonholonomic
from rolling import tumblers
from scene import Scene
from scenes import few_body
from simulate import measure
from smooth_drift import mechanisms
from standing import standing

MARGIN = 0.2
# Errors of doubles, which thousands of steps add up: 1e-16 of lengths of 1 to 100 m, of sags of
# 0.2 mm, of speeds of 1 m/s, of what a body has that has spun for 60,000 steps.
FLOORS = {
    "apex error": 1e-12,  # m
    "creep": 1e-12,  # m
    "rise": 1e-11,  # m
    "speed": 1e-12,  # m/s
    "tilt": 1e-12,  # m
    "sag error": 1e-11,
    "energy error": 1e-10,
    "momentum error": 1e-10,
}


def scenes() -> list[Scene]:
    """Return all scenes, what is carried for a shorter time than elsewhere."""
    return [
        *few_body(),
        *nonholonomic(),
        *standing(),
        *mechanisms(),
        *tumblers(),
        *(carrying(shape, duration=5.0) for shape in OBJECTS),
        *flights(),
    ]


def figure(scene: str, quantity: str, timestep: float, value: float) -> Figure:
    """Return a quantity of a scene at a time step (s)."""
    name = f"{scene}, {quantity}"
    return Figure(name, f"{1e3 * timestep:g}", value, MARGIN, FLOORS.get(quantity, 0.0))


def figures() -> Iterator[Figure]:
    """Measure everything; what takes part is in `scenes`."""
    for scene in scenes():
        for timestep in scene.timesteps:
            numbers = measure(scene, timestep=timestep)
            for quantity in scene.targets:
                yield figure(scene.name, quantity, timestep, float(numbers[quantity]))
    for tree in TREES:
        for timestep in TIMESTEPS:
            for quantity, value in conserved(tree, timestep).items():
                yield figure(f"flight-{tree}-limp", quantity, timestep, value)
