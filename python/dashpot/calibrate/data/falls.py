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
# An acceleration is that of gravity where it differs by less than this share of it, along and
# across; it is known where noise makes a standard error of less than a quarter of that.
_SAME = 0.15
# Share of the frames of stretches that move, as far as known, which have to fall so.
_MOSTLY = 0.5
# What moves by less than so many standard deviations is at rest.
_AT_REST = 5.0
# Share of gravity that measured axes have to feel.
_FELT = 0.5
# Nothing falls freely for longer between frames: in five of them it falls 20 m.
_SLOW_FRAMES = 0.5  # s

_LENGTHS = {"": 1.0, "positions in cm": 1e2, "positions in inches": 39.37, "positions in mm": 1e3}
_TIMES = {"": 1.0, "times in milliseconds": 1e-6, "times in microseconds": 1e-12}
_WAYS = {"": 1.0, "an axis that points down": -1.0}


@dataclass(frozen=True, eq=False)
class Path:
    """Where something that can fall freely was seen.

    Attributes
    ----------
    time
        (n,) s.
    value
        (n, k) along `axes`, m.
    gravity
        (k,) along them, m/s^2.
    sigma
        (k,) stated standard deviations, m, infinite where none is.
    """

    time: Array
    value: Array
    gravity: Array
    sigma: Array


def strange_units(paths: Sequence[Path], gravity: float) -> str:
    """Return what is strange about units or axes where most flights say so, else nothing.

    Parameters
    ----------
    paths
        Of one trajectory.
    gravity
        Size of that of the model, m/s^2.
    """
    for path in paths:
        if np.linalg.norm(path.gravity) <= _FELT * gravity or gravity == 0.0:
            continue
        found = _strange(path)
        if found:
            return found
    return ""


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
    """Frames on a parabola: how many, whether they move, acceleration (k,) and its error (k,)."""

    frames: int
    moves: bool
    acceleration: Array
    error: Array


def _falls_so(stretches: Sequence[_Stretch], gravity: Array, factor: float) -> bool:
    """Whether most of what moves has an acceleration that is known to be so many times gravity."""
    size = abs(factor) * float(np.linalg.norm(gravity))
    falling = moving = 0
    for stretch in stretches:
        known = (stretch.error < _SAME / 4.0 * size).all()
        if known and np.linalg.norm(stretch.acceleration - factor * gravity) < _SAME * size:
            falling += stretch.frames
        if known and stretch.moves:
            moving += stretch.frames
    return falling > _MOSTLY * moving and falling > 0


def _stretches(path: Path) -> list[_Stretch]:
    """Return the stretches of frames on parabolas, from the first on, one after the other."""
    time, value = path.time[:_MOST], path.value[:_MOST]
    sigma = np.array([noise_of([column]) for column in value.T])
    if time.size < _NOISE_KNOWN:
        stated = np.where(np.isfinite(path.sigma), path.sigma, 0.0)
        sigma = np.maximum(np.where(np.isfinite(sigma), sigma, 0.0), stated)
    if not (np.isfinite(sigma).all() and (sigma > 0.0).all()):
        return []
    found, begin = [], 0
    while begin + _FEWEST <= time.size:
        stretch = _longest(time[begin:], value[begin:], sigma)
        if stretch is not None:
            found.append(stretch)
        begin += 1 if stretch is None else stretch.frames
    return found


def _longest(time: Array, value: Array, sigma: Array) -> _Stretch | None:
    """Return the longest stretch from the first frame on: tried ever longer, then in between."""
    longest, frames, too_many = None, _FEWEST, time.size + 1
    while frames < too_many:
        stretch = _on_parabola(time[:frames], value[:frames], sigma)
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


def _on_parabola(time: Array, value: Array, sigma: Array) -> _Stretch | None:
    """Return a stretch of frames, None where they are not on a parabola."""
    # Columns of one size, so that they are well conditioned.
    span = time[-1] - time[0]
    parabola = np.vander((time - time[0]) / span, 3)
    inverse = np.linalg.pinv(parabola)
    off = (value - parabola @ (inverse @ value)) / sigma
    if np.sqrt(np.mean(off**2)) > _ON_PARABOLA:
        return None
    to_acceleration = 2.0 / span**2 * inverse[0]
    moves = bool((np.ptp(value, axis=0) > _AT_REST * sigma).any())
    error = np.linalg.norm(to_acceleration) * sigma
    return _Stretch(time.size, moves, to_acceleration @ value, error)
