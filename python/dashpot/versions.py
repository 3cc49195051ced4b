"""With what a result was made: versions, the hash of a model, the date."""

from __future__ import annotations

import datetime
import hashlib
import platform

import mujoco
import numpy as np
import scipy

from dashpot._load import __version__

__all__ = ["model_hash", "now", "versions"]


def versions() -> dict[str, str]:
    """Return versions by name: dashpot, mujoco, numpy, scipy, python."""
    return {
        "dashpot": __version__,
        "mujoco": str(mujoco.__version__),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": platform.python_version(),
    }


def now() -> str:
    """Return the present time, UTC, to the second, as ISO 8601 has it."""
    return datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds")


def model_hash(model: mujoco.MjModel) -> str:
    """Return the SHA-256 of a compiled model, in hexadecimal digits."""
    content = np.empty(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return hashlib.sha256(content.tobytes()).hexdigest()
