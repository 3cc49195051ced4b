"""dashpot: closed-form contact dynamics for MuJoCo models."""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import TYPE_CHECKING

from dashpot._load import __version__  # first: it loads MuJoCo, then the extension
from dashpot.contact_material import ContactMaterial
from dashpot.contacts import Contacts, Energy
from dashpot.engine import DivergenceError, Engine, StepStats
from dashpot.features import Feature, Report
from dashpot.linearization import Linearization, linearize
from dashpot.materials import CombinationRules, Material
from dashpot.query import (
    Closest,
    Distance,
    Distances,
    TimeOfImpact,
    TimesOfImpact,
    closest,
    distance,
    distances,
    time_of_impact,
    times_of_impact,
)
from dashpot.rollout_states import RolloutStates
from dashpot.rollouts import DivergenceWarning, rollout

__all__ = [
    "Closest",
    "CombinationRules",
    "ContactMaterial",
    "Contacts",
    "Distance",
    "Distances",
    "DivergenceError",
    "DivergenceWarning",
    "Energy",
    "Engine",
    "Feature",
    "Linearization",
    "Material",
    "Report",
    "RolloutStates",
    "StepStats",
    "TimeOfImpact",
    "TimesOfImpact",
    "__version__",
    "calibrate",
    "closest",
    "compare",
    "data",
    "distance",
    "distances",
    "grinding",
    "gymnasium",
    "law",
    "linearize",
    "myosuite",
    "robosuite",
    "rollout",
    "time_of_impact",
    "times_of_impact",
]

if TYPE_CHECKING:
    from dashpot import (
        calibrate,
        compare,
        data,
        dm_control,  # noqa: F401
        grinding,
        gymnasium,
        law,
        myosuite,
        robosuite,
    )

# Imported on first use: some need scipy, matplotlib or another library. dashpot.dm_control cannot
# be imported without that library, so that `from dashpot import *` leaves it out.
_LAZY = (
    "calibrate",
    "compare",
    "data",
    "dm_control",
    "grinding",
    "gymnasium",
    "law",
    "myosuite",
    "robosuite",
)


def __getattr__(name: str) -> ModuleType:
    if name not in _LAZY:
        raise AttributeError(f"module 'dashpot' has no attribute {name!r}")
    try:
        return importlib.import_module(f"dashpot.{name}")
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("dashpot"):
            raise
        missing = f"dashpot.{name} needs {error.name}, which is not installed"
        raise AttributeError(missing) from error


def __dir__() -> list[str]:
    return sorted({*__all__, *_LAZY, *(name for name in globals() if name.startswith("__"))})
