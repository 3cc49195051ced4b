"""Contact queries between geoms: signed distances, time of impact, close pairs."""

from dashpot.query.arguments import Geom
from dashpot.query.closest import Closest, closest
from dashpot.query.distance import Distance, Distances, distance, distances
from dashpot.query.time_of_impact import (
    TimeOfImpact,
    TimesOfImpact,
    time_of_impact,
    times_of_impact,
)

__all__ = [
    "Closest",
    "Distance",
    "Distances",
    "Geom",
    "TimeOfImpact",
    "TimesOfImpact",
    "closest",
    "distance",
    "distances",
    "time_of_impact",
    "times_of_impact",
]
