"""Which MJCF features of a model the engine honours, maps or refuses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["Feature", "Report"]


@dataclass(frozen=True)
class Feature:
    """One feature of a model and how the engine treats it."""

    name: str
    treatment: Literal["honoured", "mapped", "refused"]
    note: str


@dataclass(frozen=True)
class Report:
    """All features worth telling of a model; prints as one line each."""

    features: tuple[Feature, ...]

    def of(self, treatment: Literal["honoured", "mapped", "refused"]) -> tuple[Feature, ...]:
        """Features with one treatment."""
        return tuple(f for f in self.features if f.treatment == treatment)

    def __str__(self) -> str:
        return "\n".join(f"{f.treatment:<9} {f.name}: {f.note}" for f in self.features)
