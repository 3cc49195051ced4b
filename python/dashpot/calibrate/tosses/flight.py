"""Start states of simulated tosses, from their flight before the first contact."""

from __future__ import annotations

import itertools
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.tosses.cube import BODY, Cube
from dashpot.calibrate.trajectory import Trajectory

Array = NDArray[np.float64]


class Toss(Protocol):
    """One toss as `dashpot.data.load_cube_tosses` returns it."""

    @property
    def name(self) -> str:
        """Name of the toss."""

    @property
    def time(self) -> Array:
        """(n,) s."""

    @property
    def position(self) -> Array:
        """(n, 3) centre in the world, m."""

    @property
    def quaternion(self) -> Array:
        """(n, 4) body to world, scalar first."""


def flight_state(
    time: Array, position: Array, quaternion: Array, gravity: float = 9.81
) -> tuple[Array, Array]:
    """Return velocity (3,) in the world and angular velocity (3,) in the body at the last frame.

    The velocity is the least-squares fit of a parabola with known gravity through all frames, the
    angular velocity the mean rate between first and last frame (constant for an isotropic inertia).

    Raises
    ------
    ValueError
        With fewer than two frames.
    """
    if len(time) < 2:
        raise ValueError("a velocity needs at least two frames of flight")
    t = time - time[-1]
    lifted = position + 0.5 * np.array([0.0, 0.0, gravity]) * t[:, None] ** 2
    design = np.stack([np.ones_like(t), t], axis=1)
    velocity = np.linalg.lstsq(design, lifted, rcond=None)[0][1]
    rate = np.zeros(3)
    turn = np.zeros(3)
    for before, after in itertools.pairwise(quaternion):
        mujoco.mju_subQuat(turn, after, before)
        rate += turn
    return velocity, rate / (time[-1] - time[0])


def trajectory(
    toss: Toss, cube: Cube, *, length_scale: float = 1.0, gravity: float = 9.81
) -> Trajectory:
    """Return the part of a toss that is simulated, with its initial state.

    Parameters
    ----------
    toss
        The toss.
    cube
        Its half width says where the simulated part begins.
    length_scale
        Factor on all lengths of the toss; 1.0215 makes the published lengths consistent with
        gravity.
    gravity
        m/s^2, for the parabola of the flight.

    Raises
    ------
    ValueError
        Naming the toss, where it never comes down or has no two frames of flight.
    """
    position = np.asarray(toss.position, dtype=float) * length_scale
    first = _last_free_frame(toss, position, cube)
    flight = slice(0, first + 1)
    velocity, rate = flight_state(
        toss.time[flight], position[flight], toss.quaternion[flight], gravity
    )
    return Trajectory(
        name=toss.name,
        time=toss.time[first:],
        position=position[first:],
        quaternion=toss.quaternion[first:],
        bodies=(BODY,),
        initial_qpos=np.concatenate([position[first], toss.quaternion[first]]),
        initial_qvel=np.concatenate([velocity, rate]),
    )


def velocity_per_offset(toss: Toss, cube: Cube, *, length_scale: float = 1.0) -> Array:
    """Return (3, 3): change of the centre's initial velocity with the centre of mass, 1/s.

    It is the centre of mass, at offset r in the body, that flies on a parabola: with rotations R_k
    of the flight and weights c_k of the least-squares slope, the velocity of the cube's centre is
    that of a centred mass plus ``(sum_k c_k R_k - R_last [w]x) r``.
    """
    position = np.asarray(toss.position, dtype=float) * length_scale
    first = _last_free_frame(toss, position, cube)
    flight = slice(0, first + 1)
    rate = flight_state(toss.time[flight], position[flight], toss.quaternion[flight])[1]
    t = toss.time[flight] - toss.time[first]
    weights = np.linalg.pinv(np.stack([np.ones_like(t), t], axis=1))[1]
    rotations = np.empty((first + 1, 9))
    for k in range(first + 1):
        mujoco.mju_quat2Mat(rotations[k], toss.quaternion[k])
    slope = (weights @ rotations).reshape(3, 3)
    cross = np.cross(np.eye(3), rate).T  # columns rate x e_i
    return np.asarray(slope + rotations[-1].reshape(3, 3) @ cross)


def _last_free_frame(toss: Toss, position: Array, cube: Cube) -> int:
    low = np.flatnonzero(position[:, 2] < cube.half_width * np.sqrt(3.0))
    if low.size == 0 or low[0] < 2:
        raise ValueError(f"'{toss.name}' has no two frames of flight before its first contact")
    return int(low[0]) - 1
