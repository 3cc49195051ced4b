"""Reference data: 400 real cube tosses, read from a file or downloaded from their publishers."""

from .cube_tosses import (
    CubeToss,
    CubeTosses,
    find_cube_tosses,
    load_cube_tosses,
    save_cube_tosses,
)
from .download import download_cube_tosses

__all__ = [
    "CubeToss",
    "CubeTosses",
    "download_cube_tosses",
    "find_cube_tosses",
    "load_cube_tosses",
    "save_cube_tosses",
]
