"""Times in milliseconds, told by gravity: what is thrown then falls a million times too slowly."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.trajectory import Trajectory

Array = NDArray[np.float64]

# Frames that an acceleration is read from: as many as are on a parabola to this many standard
# deviations.
_FEWEST, _MOST = 5, 100
_ON_PARABOLA = 2.0
# Nothing falls freely for longer between frames: in five of them it falls 20 m.
_SHORTEST_SPACING = 0.5  # s
_SLOWER = 1e-6  # (ms / s)^2
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
    fall = _SLOWER * float(np.linalg.norm(gravity))
    if trajectory.spacing < _SHORTEST_SPACING or fall == 0.0 or not np.isfinite(sigma).all():
        return False
    for body in bodies:
        acceleration, error = _first_acceleration(trajectory, body, sigma)
        off = np.linalg.norm(acceleration - _SLOWER * gravity)
        if off < _SAME * fall and (error < _SAME / 3.0 * fall).all():
            return True
    return False


def _first_acceleration(trajectory: Trajectory, body: int, sigma: Array) -> tuple[Array, Array]:
    """Return the acceleration (3,) of a body in its first frames, and its standard error (3,)."""
    acceleration, error = np.zeros(3), np.full(3, np.inf)
    for frames in range(_FEWEST, min(_MOST, trajectory.frames) + 1):
        time = trajectory.spacing * np.arange(frames)
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
