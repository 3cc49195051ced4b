"""Download the published cube tosses and convert them to SI units.

What is pinned. The files are fetched at a fixed commit of the authors' repository. Of 400 of
the 570 tosses, ``cube_tosses_sha256.json`` holds the SHA-256 of the *converted poses*
(:meth:`CubeToss.content_sha256`): what is written to disk is refused unless it is the data
this package was tested with, whatever container or mirror it came from. The other 170 have no
such pin; they are left out unless asked for, and then only their structure is checked (shape,
unit quaternions, empty control columns, velocities that are the differences of the positions).
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterable, Sequence
from importlib import resources
from pathlib import Path
from typing import Literal

import numpy as np

from .cube_tosses import (
    FILE_NAME,
    FRAME_RATE,
    HALF_WIDTH,
    CubeToss,
    CubeTosses,
    default_folder,
    make_toss,
    save_cube_tosses,
)
from .torch_file import read_tensor

PUBLISHED_TOSSES = 570
# Two commits that hold the same files; the second is asked where the first is gone.
REVISIONS = ("3357ba1300b91f27a7d7077d161b05ad54f10dec", "c3dc21c")
BASE_URLS = tuple(
    f"https://raw.githubusercontent.com/DAIRLab/contact-nets/{revision}/data/tosses_processed/"
    for revision in REVISIONS
)

# m/s. Published velocities are backward differences of the positions through a 3-sample median
# filter; recomputed from the published positions they differ by at most 0.044 m/s.
_VELOCITY_TOLERANCE = 0.1


def pinned_sha256() -> dict[int, str]:
    """Return the SHA-256 of the converted poses of each pinned toss, by published number."""
    text = resources.files(__package__).joinpath("cube_tosses_sha256.json").read_text()
    return {int(toss): digest for toss, digest in json.loads(text)["sha256"].items()}


def convert_toss(toss_id: int, file: str | os.PathLike[str]) -> CubeToss:
    """Convert one published ``.pt`` file to SI units and check it.

    The file holds a (1, F, 19) tensor: position in half widths, quaternion, velocity in half
    widths per second, angular velocity in the body frame, and six empty control columns.

    Raises
    ------
    ValueError
        If the file is damaged, holds anything but such a tensor, or if a pinned toss does not
        have the pinned content.
    """
    states = np.asarray(read_tensor(file), np.float64)
    if states.ndim != 3 or states.shape[0] != 1 or states.shape[2] != 19:
        raise ValueError(f"toss {toss_id}: shape {states.shape} is not (1, F, 19)")
    states = states[0]
    if np.any(states[:, 13:]):
        raise ValueError(f"toss {toss_id}: the control columns are not zero")
    toss = make_toss(
        toss_id,
        states[:, :3] * HALF_WIDTH,
        states[:, 3:7],
        states[:, 7:10] * HALF_WIDTH,
        states[:, 10:13],
    )
    _check_velocity(toss)
    expected = pinned_sha256().get(toss_id)
    if expected is not None and toss.content_sha256() != expected:
        raise ValueError(
            f"toss {toss_id}: the content has SHA-256 {toss.content_sha256()}, not the pinned "
            f"{expected}; the file was changed or damaged"
        )
    return toss


def _check_velocity(toss: CubeToss) -> None:
    rate = np.diff(toss.position, axis=0) * FRAME_RATE
    if len(rate) < 3:
        raise ValueError(f"toss {toss.id}: {len(toss)} frames are too few")
    filtered = np.median([rate[:-2], rate[1:-1], rate[2:]], axis=0)
    error = np.abs(toss.velocity[2:-1] - filtered).max(axis=1)
    if error.max() > _VELOCITY_TOLERANCE:
        raise ValueError(
            f"toss {toss.id}: velocity of frame {int(error.argmax()) + 2} differs by "
            f"{error.max():.3f} m/s from the differences of the positions"
        )


def download_cube_tosses(
    destination: str | os.PathLike[str] | None = None,
    *,
    base_url: str | None = None,
    tosses: Literal["pinned", "all"] | Iterable[int] = "pinned",
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Download the published cube tosses, check, convert and store them.

    Parameters
    ----------
    destination
        Folder for the converted file; None is the user's cache, where
        :func:`load_cube_tosses` finds it.
    base_url
        Folder of the published ``N.pt`` files, for a mirror; None is the authors' repository.
    tosses
        "pinned" for the 400 whose content is pinned, "all" for the 570 published (the other 170
        are checked for structure only), or some published numbers.
    progress
        Called with (done, total) after each toss.

    Returns
    -------
    Path
        The written file. It appears complete or not at all.

    Raises
    ------
    ValueError
        If a toss does not exist, a file is damaged, or its content is not the pinned one.
    ConnectionError
        If a file cannot be fetched.

    Examples
    --------
    >>> path = dashpot.data.download_cube_tosses("tosses")  # doctest: +SKIP
    """
    numbers = _numbers(tosses)
    folder = default_folder() if destination is None else Path(destination)
    converted = []
    with tempfile.TemporaryDirectory() as scratch:
        source = _source(BASE_URLS if base_url is None else (base_url,), numbers[0], Path(scratch))
        for done, toss_id in enumerate(numbers, start=1):
            file = _fetch(source, toss_id, Path(scratch))
            converted.append(convert_toss(toss_id, file))
            if progress is not None:
                progress(done, len(numbers))
    target = folder / FILE_NAME
    partial = target.with_suffix(".partial")
    save_cube_tosses(CubeTosses(tuple(converted)), partial)
    partial.replace(target)
    return target


def _numbers(tosses: Literal["pinned", "all"] | Iterable[int]) -> list[int]:
    if isinstance(tosses, str):
        if tosses == "pinned":
            return sorted(pinned_sha256())
        if tosses == "all":
            return list(range(PUBLISHED_TOSSES))
        raise ValueError(f"tosses = {tosses!r} is neither 'pinned' nor 'all' nor numbers")
    numbers = sorted({int(toss) for toss in tosses})
    if not numbers or numbers[0] < 0 or numbers[-1] >= PUBLISHED_TOSSES:
        raise ValueError(f"tosses {numbers} are not among 0 to {PUBLISHED_TOSSES - 1}")
    return numbers


def _source(base_urls: Sequence[str], toss_id: int, folder: Path) -> str:
    """Return the first folder that gives the toss, or the last."""
    for base_url in base_urls[:-1]:
        try:
            _fetch(base_url, toss_id, folder)
            return base_url
        except ConnectionError:
            continue
    return base_urls[-1]


def _fetch(base_url: str, toss_id: int, folder: Path) -> Path:
    import pooch
    import requests

    url = f"{base_url.rstrip('/')}/{toss_id}.pt"
    logger = pooch.get_logger()
    level = logger.level
    logger.setLevel("ERROR")
    try:
        # The file itself has no pin: its converted content does, and is checked by the caller.
        fetched = pooch.retrieve(url, known_hash=None, fname=f"{toss_id}.pt", path=folder)
    except (OSError, requests.RequestException) as error:
        raise ConnectionError(f"cannot download {url}: {error}") from error
    finally:
        logger.setLevel(level)
    return Path(fetched)
