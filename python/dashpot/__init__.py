"""dashpot: closed-form contact dynamics for MuJoCo models."""

from dashpot.contacts import Contacts, Energy
from dashpot.engine import Engine, StepStats
from dashpot.features import Feature, Report
from dashpot.materials import CombinationRules, Material

__all__ = [
    "CombinationRules",
    "Contacts",
    "Energy",
    "Engine",
    "Feature",
    "Material",
    "Report",
    "StepStats",
]
