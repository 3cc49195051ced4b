"""Units and axes that are others than the model's, told by gravity.

What is thrown falls a million times too slowly where times are in milliseconds, a thousand times
too fast where positions are in millimetres, and up where an axis points down. Flights are found
wherever they are, between impacts too, as stretches of frames that are on parabolas; a height alone
will do.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.smoothness import noise_of

Array = NDArray[np.float64]

# Frames of a stretch, and how many times their number is tried next.
_FEWEST, _LONGER = 5, 1.4
# A stretch is on a parabola to this many standard deviations.
_ON_PARABOLA = 2.0
# Frames that are looked at, and of how few the noise is not read off.
_MOST, _NOISE_KNOWN = 1000, 20
# An acceleration is that of gravity where it differs by less than this share of it; it is known
# where noise makes a standard error of less than a quarter of that.
_SAME = 0.15
# Share of the frames of stretches that move, as far as known, which have to fall so: what tumbles
# over a floor does so in the others.
_OFTEN = 1.0 / 3.0
# What moves by less than so many standard deviations is at rest, or than this share of a fall.
_AT_REST, _HARDLY = 5.0, 0.05
# Share of gravity that measured axes have to feel.
_FELT = 0.5
# Nothing falls freely for longer between frames: in five of them it falls 20 m.
_SLOW_FRAMES = 0.5  # s

TIMES = "times in"
_LENGTHS = {"": 1.0, "positions in cm": 1e2, "positions in inches": 39.37, "positions in mm": 1e3}
_TIMES = {"": 1.0, f"{TIMES} milliseconds": 1e-6, f"{TIMES} microseconds": 1e-12}
_WAYS = {"": 1.0, "an axis that points down": -1.0}


@dataclass(frozen=True, eq=False)
class Path:
    """How high something that can fall freely was seen.

    Attributes
    ----------
    time
        (n,) s.
    height
        (n,) along what was measured of the direction against gravity, m.
    gravity
        How fast it falls along that, m/s^2.
    sigma
        Stated standard deviation of heights, m, infinite where none is.
    """

    time: Array
    height: Array
    gravity: float
    sigma: float


def strange_units(paths: Sequence[Path], gravity: float) -> str:
    """Return what is strange about units or axes where flights say so, else nothing.

    Parameters
    ----------
    paths
        Of one trajectory.
    gravity
        Size of that of the model, m/s^2.
    """
    felt = [path for path in paths if path.gravity > _FELT * gravity > 0.0]
    return next(filter(None, map(_strange, felt)), "")


def _strange(path: Path) -> str:
    stretches = _stretches(path)
    spacing = float(np.median(np.diff(path.time))) if path.time.size > 1 else 0.0
    if not stretches or _falls_so(stretches, path.gravity, 1.0):
        return ""
    for length, time, way in itertools.product(_LENGTHS, _TIMES, _WAYS):
        factor = _LENGTHS[length] * _TIMES[time] * _WAYS[way]
        if factor == 1.0 or (_TIMES[time] != 1.0 and spacing < _SLOW_FRAMES):
            continue
        if _falls_so(stretches, path.gravity, factor):
            why = " and ".join(text for text in (length, time, way) if text)
            return f"it falls at {factor:.3g} times gravity, as with {why}"
    return ""


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Frames on a parabola.

    That is how many, in how many s, how far they go, in m and in standard deviations, how fast they
    fall, m/s^2, and the standard error of that.
    """

    frames: int
    span: float
    way: float
    way_in_sigma: float
    fall: float
    error: float


def _falls_so(stretches: Sequence[_Stretch], gravity: float, factor: float) -> bool:
    """Whether much of what moves has an acceleration that is known to be so many times gravity."""
    size = abs(factor) * gravity
    falling = moving = 0
    for stretch in stretches:
        known = stretch.error < _SAME / 4.0 * size
        if known and abs(stretch.fall - factor * gravity) < _SAME * size:
            falling += stretch.frames
        fall = 0.5 * size * stretch.span**2
        if known and stretch.way_in_sigma > _AT_REST and stretch.way > _HARDLY * fall:
            moving += stretch.frames
    return falling > _OFTEN * moving and falling > 0


def _stretches(path: Path) -> list[_Stretch]:
    """Return the stretches of frames on parabolas, from the first on, one after the other."""
    time, height = path.time[:_MOST], path.height[:_MOST]
    sigma = noise_of([height])
    if time.size < _NOISE_KNOWN and np.isfinite(path.sigma):
        sigma = max(path.sigma, sigma if np.isfinite(sigma) else 0.0)
    if not np.isfinite(sigma):
        return []
    found, begin = [], 0
    while begin + _FEWEST <= time.size:
        stretch = _longest(time[begin:], height[begin:], sigma)
        if stretch is not None:
            found.append(stretch)
        begin += 1 if stretch is None else stretch.frames
    return found


def _longest(time: Array, height: Array, sigma: float) -> _Stretch | None:
    """Return the longest stretch from the first frame on: tried ever longer, then in between."""
    longest, frames, too_many = None, _FEWEST, time.size + 1
    while frames < too_many:
        stretch = _on_parabola(time[:frames], height[:frames], sigma)
        if stretch is None:
            too_many = frames
        else:
            longest = stretch
        if longest is None:
            return None
        if too_many > time.size:
            following = min(int(np.ceil(_LONGER * frames)), time.size)
            frames = following if following > frames else too_many
        else:
            middle = (longest.frames + too_many) // 2
            frames = middle if middle > longest.frames else too_many
    return longest


def _on_parabola(time: Array, height: Array, sigma: float) -> _Stretch | None:
    """Return a stretch of frames, None where they are not on a parabola."""
    # Columns of one size, so that they are well conditioned.
    span = float(time[-1] - time[0])
    parabola = np.vander((time - time[0]) / span, 3)
    inverse = np.linalg.pinv(parabola)
    off = height - parabola @ (inverse @ height)
    if np.sqrt(np.mean(off**2)) > _ON_PARABOLA * sigma:
        return None
    to_fall = -2.0 / span**2 * inverse[0]
    way, error = float(np.ptp(height)), sigma * float(np.linalg.norm(to_fall))
    return _Stretch(time.size, span, way, way / sigma, float(to_fall @ height), error)
