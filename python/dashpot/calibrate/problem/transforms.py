"""Search coordinates of bounded parameters.

The search works in z, the parameter in x:

    log       z = log x                       bounds > 0; natural for stiffness, damping, mass
    linear    z = (x - lower) / (upper - lower)
    logit     z = log((s + e) / (1 - s + e)),  s = (x - lower) / (upper - lower),  e = 1e-4

With e the logit reaches its bounds at z = -9.2 and 9.2, where the parameter still moves with z. A
logit without it runs off to where nothing does, if an estimate lies at a bound.

A difference of z is a relative change (log) or a fraction of the allowed range (linear; logit in
the middle of the range counts a quarter).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

TransformName = Literal["log", "linear", "logit"]

# Of the logit, e above.
_EDGE = 1e-4


@dataclass(frozen=True)
class Transform:
    """One of the maps above with its bounds."""

    kind: TransformName
    lower: float
    upper: float

    def to_search(self, x: float) -> float:
        """Map a parameter value to its search coordinate."""
        if self.kind == "log":
            return math.log(x)
        if self.kind == "linear":
            return (x - self.lower) / (self.upper - self.lower)
        share = min(max((x - self.lower) / (self.upper - self.lower), 0.0), 1.0)
        return math.log((share + _EDGE) / (1.0 - share + _EDGE))

    def to_value(self, z: float) -> float:
        """Map a search coordinate to the parameter, clipped to the bounds against rounding."""
        low, high = self.search_bounds
        if z <= low or z >= high:
            return self.lower if z <= low else self.upper
        if self.kind == "log":
            x = math.exp(z)
        elif self.kind == "linear":
            x = self.lower + z * (self.upper - self.lower)
        else:
            share = (1.0 + 2.0 * _EDGE) / (1.0 + math.exp(-z)) - _EDGE
            x = self.lower + share * (self.upper - self.lower)
        return min(max(x, self.lower), self.upper)

    def slope(self, z: float) -> float:
        """Return dx/dz."""
        if self.kind == "log":
            return self.to_value(z)
        if self.kind == "linear":
            return self.upper - self.lower
        z = min(max(z, self.search_bounds[0]), self.search_bounds[1])
        share = 1.0 / (1.0 + math.exp(-z))
        return (1.0 + 2.0 * _EDGE) * share * (1.0 - share) * (self.upper - self.lower)

    @property
    def search_bounds(self) -> tuple[float, float]:
        """Bounds of the search coordinate, finite."""
        return self.to_search(self.lower), self.to_search(self.upper)

    @property
    def sampling_bounds(self) -> tuple[float, float]:
        """Finite bounds for spreading starts: for logit, 1 % to 99 % of the range."""
        if self.kind == "logit":
            return -math.log(99.0), math.log(99.0)
        return self.search_bounds
