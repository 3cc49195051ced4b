"""Start states of simulated tosses, from their flight before the first contact.

In flight the centre of mass, at offset r from the cube's centre in the body frame, follows a
parabola, and an isotropic inertia makes the angular velocity constant:

    p(t) + R(t) r = C + V t - g t^2 / 2,        R(t) = R(0) exp(t w),

with the rotations R(t) body to world and w in the body frame. Both are fitted by least squares to
all frames of the flight. The start state, that of the first frame, is linear in r.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.tosses.cube import BODY, CORNERS, Cube
from dashpot.data.cube_tosses import GRAVITY, CubeTosses

Array = NDArray[np.float64]

LENGTH_SCALE = CubeTosses.length_correction
# Flight ends before the lowest corner of a sharp cube is this near to the table, m: tracking and
# length scale put corners a millimetre or two off.
_CLEARANCE = 0.003
# Rounds of Gauss-Newton for the turning rate: from rates off by noise alone it converges in two.
_ROUNDS = 4
# Flights of more than so many times the median influence count less; rounds that settle it.
_HUBER = 1.5
_REWEIGHTINGS = 20
# Sum of squares that a metre of offset leaves of the parabolas, m^2: with less, offsets of a metre
# would be as small as the noise of tracking, 0.03 mm.
_LEAST_INFORMATION = 1e-8


class Toss(Protocol):
    """One toss as `dashpot.data.load_cube_tosses` returns it.

    Examples
    --------
    >>> from dashpot.calibrate import tosses as study
    >>> toss: study.Toss = tosses[0]
    >>> toss.position.shape[1]
    3
    """

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


@dataclass(frozen=True, eq=False)
class Flight:
    """The fitted flight of a toss: its state in the first frame.

    Attributes
    ----------
    frames
        Number of frames of the flight.
    position, velocity
        (3,) of the cube's centre in the world if its mass is centred, m and m/s.
    position_per_offset, velocity_per_offset
        (3, 3) what a metre of offset of the centre of mass in the body adds, 1 and 1/s.
    quaternion
        (4,) body to world, scalar first.
    angular_velocity
        (3,) in the body, rad/s.
    residuals, residuals_per_offset
        (frames, 3) what the parabola leaves if the mass is centred, m, and (frames, 3, 3) what a
        metre of offset adds.

    Examples
    --------
    >>> from dashpot.calibrate import tosses as study
    >>> flight = study.fit_flight(tosses[0], study.Cube())
    >>> flight.position.shape, flight.residuals.shape == (flight.frames, 3)
    ((3,), True)
    """

    frames: int
    position: Array
    velocity: Array
    position_per_offset: Array
    velocity_per_offset: Array
    quaternion: Array
    angular_velocity: Array
    residuals: Array
    residuals_per_offset: Array

    def qpos(self, offset: Array) -> Array:
        """Return (7,) position of a free joint in the first frame."""
        return np.concatenate([self.position + self.position_per_offset @ offset, self.quaternion])

    def qvel(self, offset: Array) -> Array:
        """Return (6,) velocity of a free joint in the first frame."""
        linear = self.velocity + self.velocity_per_offset @ offset
        return np.concatenate([linear, self.angular_velocity])


def fit_flight(
    toss: Toss, cube: Cube, *, length_scale: float = LENGTH_SCALE, gravity: float = GRAVITY
) -> Flight:
    """Fit the flight of a toss.

    Parameters
    ----------
    toss
        The toss.
    cube
        Its half width says where the flight ends.
    length_scale
        Factor on all lengths of the toss. The default makes the published lengths consistent with
        gravity.
    gravity
        m/s^2.

    Raises
    ------
    ValueError
        Naming the toss, where it never comes down or has no two frames of flight.

    Examples
    --------
    >>> from dashpot.calibrate import tosses as study
    >>> flight = study.fit_flight(tosses[0], study.Cube())
    >>> float(np.abs(flight.residuals).max()) < 2e-3  # m
    True
    """
    scaled = np.asarray(toss.position, dtype=float) * length_scale
    frames = flight_frames(scaled, toss.quaternion, cube)
    if not 2 <= frames < len(scaled):
        raise ValueError(f"'{toss.name}' has no two frames of flight before its first contact")
    t = toss.time[:frames] - toss.time[0]
    rotation, rate = _turning(t, _rotations(toss.quaternion[:frames]))
    matrices = (rotation * Rotation.from_rotvec(t[:, None] * rate)).as_matrix()
    design = np.stack([np.ones_like(t), t], axis=1)
    inverse = np.linalg.pinv(design)
    lifted = scaled[:frames].copy()
    lifted[:, 2] += 0.5 * gravity * t**2
    position, velocity = inverse @ lifted
    position_effect, velocity_effect = np.einsum("ik,kab->iab", inverse, matrices)
    cross = np.cross(rate, np.eye(3)).T  # columns rate x e_i
    return Flight(
        frames=frames,
        position=position,
        velocity=velocity,
        position_per_offset=position_effect - matrices[0],
        velocity_per_offset=velocity_effect - matrices[0] @ cross,
        quaternion=rotation.as_quat()[[3, 0, 1, 2]],
        angular_velocity=rate,
        residuals=lifted - design @ (inverse @ lifted),
        residuals_per_offset=matrices - np.einsum("kl,lab->kab", design @ inverse, matrices),
    )


def trajectory(
    toss: Toss, flight: Flight, cube: Cube, *, length_scale: float = LENGTH_SCALE
) -> Trajectory:
    """Return a toss with the start state of its flight for the centre of mass of `cube`.

    Examples
    --------
    >>> from dashpot.calibrate import tosses as study
    >>> flight = study.fit_flight(tosses[0], study.Cube())
    >>> study.trajectory(tosses[0], flight, study.Cube()).bodies
    ('cube',)
    """
    offset = np.array(cube.offset)
    return Trajectory(
        name=toss.name,
        time=toss.time,
        position=np.asarray(toss.position, dtype=float) * length_scale,
        quaternion=toss.quaternion,
        bodies=(BODY,),
        initial_qpos=flight.qpos(offset),
        initial_qvel=flight.qvel(offset),
    )


def centre_of_mass(flights: Iterable[Flight]) -> tuple[Array, Array]:
    """Return offset (3,) of the centre of mass in the body and its standard errors (3,), m.

    The offset that leaves the least of all flights' parabolas. What a flight leaves hangs together,
    and some flights are tracked worse than others. Each counts by Huber's weight of its influence
    (reweighted least squares), and the errors are those of the flights' scatter.

    Raises
    ------
    ValueError
        With fewer than two flights, or where they do not turn enough to tell.

    Examples
    --------
    >>> from dashpot.calibrate import tosses as study
    >>> flights = [study.fit_flight(toss, study.Cube()) for toss in tosses[:20]]
    >>> offset, error = study.centre_of_mass(flights)
    >>> offset.shape, error.shape
    ((3,), (3,))
    """
    several = tuple(flights)
    if len(several) < 2:
        raise ValueError(f"a centre of mass needs at least two flights, got {len(several)}")
    designs = [flight.residuals_per_offset.reshape(-1, 3) for flight in several]
    normal = np.array([design.T @ design for design in designs])
    target = np.array(
        [-d.T @ f.residuals.reshape(-1) for d, f in zip(designs, several, strict=True)]
    )
    if np.linalg.eigvalsh(normal.sum(axis=0))[0] < _LEAST_INFORMATION:
        raise ValueError("the flights do not turn: they do not say where the centre of mass is")
    weight = np.ones(len(several))
    for _ in range(_REWEIGHTINGS):
        spread = np.linalg.inv(np.einsum("f,fij->ij", weight, normal))
        offset = spread @ (weight @ target)
        influence = (target - normal @ offset) @ spread
        size = np.linalg.norm(influence, axis=1)
        bound = _HUBER * float(np.median(size))
        weight = bound / np.maximum(size, bound) if bound > 0 else weight
    return offset, np.sqrt(((weight[:, None] * influence) ** 2).sum(axis=0))


def _rotations(quaternion: Array) -> Rotation:
    return Rotation.from_quat(np.asarray(quaternion)[:, [1, 2, 3, 0]])


def flight_frames(position: Array, quaternion: Array, cube: Cube) -> int:
    """Return the number of frames before a corner of a sharp `cube` comes near the table.

    Parameters
    ----------
    position
        (n, 3) centre in the world, m, lengths consistent with the cube's.
    quaternion
        (n, 4) body to world, scalar first.
    cube
        Its half width counts.
    """
    corners = _rotations(quaternion).as_matrix() @ (cube.half_width * CORNERS.T)
    low = np.flatnonzero(position[:, 2] + corners[:, 2].min(axis=1) < _CLEARANCE)
    return int(low[0]) if low.size else len(position)


def _turning(time: Array, rotations: Rotation) -> tuple[Rotation, Array]:
    """Return first rotation and rate (3,) in the body of a constant turning, by least squares."""
    first = rotations[0]
    increments = (rotations[:-1].inv() * rotations[1:]).as_rotvec()
    rate = increments.sum(axis=0) / (time[-1] - time[0])
    for _ in range(_ROUNDS):
        turns = Rotation.from_rotvec(time[:, None] * rate)
        left = ((first * turns).inv() * rotations).as_rotvec()
        effect_of_first = turns.inv().as_matrix()
        effect_of_rate = time[:, None, None] * _right_jacobian(time[:, None] * rate)
        design = np.concatenate([effect_of_first, effect_of_rate], axis=2).reshape(-1, 6)
        change = np.linalg.lstsq(design, left.reshape(-1), rcond=None)[0]
        first = first * Rotation.from_rotvec(change[:3])
        rate = rate + change[3:]
    return first, rate


def _right_jacobian(turn: Array) -> Array:
    """Return (n, 3, 3): exp(turn + d) = exp(turn) exp(J d) to first order in d."""
    angle = np.linalg.norm(turn, axis=1)[:, None, None]
    cross = np.cross(turn[:, None, :], np.eye(3)).swapaxes(1, 2)
    # (1 - cos a) / a^2 and (a - sin a) / a^3 through sinc, and the series where they cancel.
    first = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    small = angle < 1e-2
    safe = np.where(small, 1.0, angle)
    second = np.where(small, 1.0 / 6.0 - angle**2 / 120.0, (safe - np.sin(safe)) / safe**3)
    return np.asarray(np.eye(3) - first * cross + second * (cross @ cross))
