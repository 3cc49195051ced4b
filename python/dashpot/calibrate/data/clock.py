"""Units and axes that are others than the model's, told by gravity.

What is thrown falls a million times too slowly where times are in milliseconds, a thousand times
too fast where positions are in millimetres, and up where an axis points down.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory

Array = NDArray[np.float64]

# Frames that an acceleration is read from: as many as are on a parabola to this many standard
# deviations.
_FEWEST, _MOST = 5, 100
_ON_PARABOLA = 2.0
# Or, where that has to be quick, the most of these.
_SOME = (5, 7, 10, 14, 20, 28, 40, 56, 80, 100)
# Nothing falls freely for longer between frames: in five of them it falls 20 m.
_SHORTEST_SPACING = 0.5  # s
_SLOWER = 1e-6  # (ms / s)^2
_MILLIMETRES = 1e3  # in a metre
# An acceleration is that of gravity where it differs by less than this share of it, along and
# across; it is known where noise makes a standard error of less than a third of that.
_SAME = 0.15


def in_milliseconds(
    trajectory: Trajectory, bodies: Sequence[int], gravity: Array, sigma: Array
) -> bool:
    """Whether one of some bodies begins in a fall at a millionth of gravity.

    Slow motion that is no fall has that acceleration, straight down, by rare chance only.

    Parameters
    ----------
    trajectory
        What was observed.
    bodies
        Which of its bodies can fall freely.
    gravity
        (3,) of the model, m/s^2.
    sigma
        (3,) standard deviations of observed coordinates, m; infinite where not measured.
    """
    if trajectory.spacing < _SHORTEST_SPACING:
        return False
    number = range(_FEWEST, min(_MOST, trajectory.frames) + 1)
    return _falls_at(_SLOWER * gravity, trajectory, bodies, sigma, number)


def in_millimetres(
    trajectory: Trajectory, bodies: Sequence[int], gravity: Array, sigma: Array
) -> bool:
    """Whether one of some bodies begins in a fall at a thousand times gravity.

    Arguments as of `in_milliseconds`, `sigma` in m or, as positions then are, in mm.
    """
    fall = _MILLIMETRES * gravity
    return any(
        _falls_at(fall, trajectory, bodies, scale * sigma, _SOME) for scale in (1.0, _MILLIMETRES)
    )


def falls_up(trajectory: Trajectory, bodies: Sequence[int], gravity: Array, sigma: Array) -> bool:
    """Whether one of some bodies begins in a fall against gravity.

    Other directions are not asked for: what slides with friction 1 has such an acceleration.
    Arguments as of `in_milliseconds`.
    """
    return _falls_at(-gravity, trajectory, bodies, sigma, _SOME)


def _falls_at(
    fall: Array, trajectory: Trajectory, bodies: Sequence[int], sigma: Array, number: Iterable[int]
) -> bool:
    """Whether one of some bodies begins with an acceleration that is known to be `fall` (3,)."""
    size = float(np.linalg.norm(fall))
    if size == 0.0 or not np.isfinite(sigma).all():
        return False
    for body in bodies:
        acceleration, error = _first_acceleration(trajectory, body, sigma, number)
        off = np.linalg.norm(acceleration - fall)
        if off < _SAME * size and (error < _SAME / 3.0 * size).all():
            return True
    return False


def _first_acceleration(
    trajectory: Trajectory, body: int, sigma: Array, number: Iterable[int]
) -> tuple[Array, Array]:
    """Return the acceleration (3,) of a body in its first frames, and its standard error (3,).

    They are as many of the ascending `number` as are on a parabola.
    """
    acceleration, error = np.zeros(3), np.full(3, np.inf)
    place, spacing = trajectory.frame_number, trajectory.spacing
    for frames in number:
        if frames > trajectory.frames:
            break
        time = spacing * place[:frames]
        # Columns of one size, so that they are well conditioned.
        parabola = np.vander(time / time[-1], 3)
        path = trajectory.position[:frames, body]
        inverse = np.linalg.pinv(parabola)
        off = (path - parabola @ (inverse @ path)) / sigma
        if np.sqrt(np.mean(off**2)) > _ON_PARABOLA:
            break
        to_acceleration = 2.0 / time[-1] ** 2 * inverse[0]
        acceleration = to_acceleration @ path
        error = np.linalg.norm(to_acceleration) * sigma
    return acceleration, error


def gravity_of(model: mujoco.MjModel) -> Array:
    """Return the gravity (3,) that acts in a model, m/s^2."""
    weightless = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    return np.zeros(3) if weightless else np.array(model.opt.gravity)
