"""Penetration and energy decay of the same model stepped by dashpot and by MuJoCo."""

from dashpot.compare.result import Comparison, Run, Statistics
from dashpot.compare.runner import run
from dashpot.compare.scenes import SCENES, Scene, scene
from dashpot.compare.settings import DEFAULT_SETTINGS, SETTINGS, Setting

__all__ = [
    "DEFAULT_SETTINGS",
    "SCENES",
    "SETTINGS",
    "Comparison",
    "Run",
    "Scene",
    "Setting",
    "Statistics",
    "run",
    "scene",
]
