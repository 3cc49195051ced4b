"""A figure of the gate: smaller is better."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Figure:
    """What is measured (`name`), in which case (a time step in ms, an engine), and what came out.

    It may exceed what stands by the share `margin`. Up to `floor` it is rounding, and may be
    anything: the last digits go by the compiler. What is not `limited` only stands beside others.
    """

    name: str
    case: str
    value: float
    margin: float
    floor: float = 0.0
    limited: bool = True

    def limit(self, stands: float) -> float:
        """Return the largest value that passes, where `stands` is what stands."""
        return max(self.floor, (1.0 + self.margin) * stands)
