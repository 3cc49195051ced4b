"""With what a fit was made."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from dashpot.versions import model_hash, now, versions


@dataclass(frozen=True)
class Provenance:
    """With what, of what and when a fit was made.

    Attributes
    ----------
    dashpot, mujoco, numpy, scipy, python
        Versions.
    model
        SHA-256 of the compiled model that was stepped, in hexadecimal digits.
    seed
        Of the fit.
    date
        UTC, to the second, as ISO 8601 has it.
    """

    dashpot: str
    mujoco: str
    numpy: str
    scipy: str
    python: str
    model: str
    seed: int
    date: str


def provenance(model: mujoco.MjModel, seed: int) -> Provenance:
    """Return with what a fit is made now."""
    return Provenance(**versions(), model=model_hash(model), seed=seed, date=now())
