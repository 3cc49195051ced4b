"""Twins of recordings that laboratories make: their truth is hidden, their noise known."""

from __future__ import annotations

from . import balls, carts, sounds
from .case import Case, Scene

KINDS: dict[str, Scene] = {
    "30 fps, 5 mm": balls.at_30_frames,
    "40 % of frames lost": balls.lost_frames,
    "5 % outliers": balls.outliers,
    "force 20 ms late": carts.late_force,
    "scale 15 % off": balls.wrong_scale,
    "noise ten times off": balls.unknown_noise,
    "load cell alone": carts.falling_weight,
    "apices alone": sounds.apices_alone,
    "impact times alone": sounds.impacts_alone,
    "three objects": balls.three_objects,
    "jittered stamps": balls.jittered,
    "slope of a track": carts.sloping_track,
}

__all__ = ["KINDS", "Case", "Scene"]
