"""dashpot: closed-form contact dynamics for MuJoCo models."""

from dashpot.contacts import Contacts, Energy
from dashpot.engine import Engine, StepStats
from dashpot.features import Feature, Report
from dashpot.materials import CombinationRules, Material
from dashpot.query import Distance, TimeOfImpact, distance, time_of_impact

__all__ = [
    "CombinationRules",
    "Contacts",
    "Distance",
    "Energy",
    "Engine",
    "Feature",
    "Material",
    "Report",
    "StepStats",
    "TimeOfImpact",
    "distance",
    "time_of_impact",
]
