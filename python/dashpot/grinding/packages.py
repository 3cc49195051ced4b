"""Packages of the extra ``dashpot[grinding]``, imported when they are used."""

from __future__ import annotations

import importlib
from typing import Any

__all__ = ["needed"]


def needed(module: str, what: str) -> Any:
    """Return a module of the extra; raise ImportError that names the extra where it is missing."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise ImportError(
            f"{what} needs the package {error.name}; install it with  "
            "pip install 'dashpot[grinding]'",
            name=error.name,
        ) from error
