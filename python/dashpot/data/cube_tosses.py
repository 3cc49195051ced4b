"""Real tosses of a cube onto a table: the data set, its checks and where it is looked for.

The data are those of ContactNets (Pfrommer, Halm and Posa, CoRL 2020, arXiv:2009.11193), tracked
at 148 Hz; BSD-3-Clause, Copyright (c) 2020, Dynamic Autonomy and Intelligent Robotics Lab. They
are used as published: lengths are *not* corrected (free fall in the data is 9.604 m/s², so the
tracked lengths are 2.1 % too short: :attr:`CubeTosses.length_correction` makes them consistent).
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot.checks import number_array
from dashpot.data.archive import ArrayArchive

FILE_NAME = "cube_tosses_public.npz"
_FOLDER = "cube_tosses"

FRAME_RATE = 148.0
MASS = 0.37
INERTIA = 0.00081
HALF_WIDTH = 0.0524
GRAVITY = 9.81
NOMINAL_FRICTION = 0.18
NOMINAL_RESTITUTION = 0.125

# Four to six times what the published tosses reach: anything beyond is not this data.
_POSITION_LIMIT = 2.0
_VELOCITY_LIMIT = 10.0
_ANGULAR_VELOCITY_LIMIT = 100.0
_QUATERNION_TOLERANCE = 1e-6

_ROWS = ("pos", "quat_wxyz", "vel", "omega_body")
_CONSTANTS = ("dt", "mass", "inertia", "half_width", "gravity", "mu_repo", "restitution_repo")


@dataclass(frozen=True, eq=False)
class CubeToss:
    """One toss; F frames.

    Attributes
    ----------
    id
        Number of the toss in the publication, 0 to 569.
    time
        (F,) s, from the first frame.
    position
        (F, 3) m, centre of the cube in the world (z up, table at z = 0).
    quaternion
        (F, 4) unit, scalar first, body to world.
    velocity
        (F, 3) m/s, of the centre, world frame. A backward difference through a 3-sample median
        filter: in flight it is stale by half a frame.
    angular_velocity
        (F, 3) rad/s, body frame, as in the velocity of a MuJoCo free joint.

    Examples
    --------
    >>> toss = tosses[0]
    >>> toss.position.shape[1], toss.quaternion.shape[1]
    (3, 4)
    """

    id: int
    time: NDArray[np.float64]
    position: NDArray[np.float64]
    quaternion: NDArray[np.float64]
    velocity: NDArray[np.float64]
    angular_velocity: NDArray[np.float64]

    def __repr__(self) -> str:
        """Return number and length, without the arrays."""
        return f"CubeToss({self.id}, {len(self)} frames to {self.time[-1]:.4g} s)"

    @property
    def name(self) -> str:
        """Names the toss in messages: "toss" and its number."""
        return f"toss {self.id}"

    def __len__(self) -> int:
        return len(self.time)

    def content_sha256(self) -> str:
        """Return the SHA-256 of the poses in whole nanometres and 1e-9 parts of a quaternion.

        The rounding makes the digest the same whether a pose was converted here or elsewhere
        (conversions differ by 1e-16, and velocities, stored in single precision, are left out).
        """
        digest = hashlib.sha256(np.array(self.position.shape, "<i8").tobytes())
        for values in (self.position, self.quaternion):
            digest.update(np.rint(values * 1e9).astype("<i8").tobytes())
        return digest.hexdigest()


@dataclass(frozen=True, eq=False)
class CubeTosses:
    """The tosses and the cube they were made with.

    Attributes
    ----------
    tosses
        In ascending order of their published number.
    timestep
        s between frames.
    mass, inertia
        kg and kg m² (the same about every axis).
    half_width
        m, half the edge.
    gravity
        m/s², downwards.
    nominal_friction, nominal_restitution
        The authors' values; not measured toss by toss.

    Examples
    --------
    >>> study = dashpot.data.load_cube_tosses()
    >>> len(study.tosses), round(study.timestep, 5), study.half_width
    (400, 0.00676, 0.0524)
    """

    tosses: tuple[CubeToss, ...]
    timestep: float = 1.0 / FRAME_RATE
    mass: float = MASS
    inertia: float = INERTIA
    half_width: float = HALF_WIDTH
    gravity: float = GRAVITY
    nominal_friction: float = NOMINAL_FRICTION
    nominal_restitution: float = NOMINAL_RESTITUTION

    length_correction = 1.0215
    """Factor on positions and velocities that turns the tracked free fall into 9.81 m/s²."""

    def __repr__(self) -> str:
        """Return the number of tosses and frames, without the arrays."""
        frames = sum(len(toss) for toss in self.tosses)
        return f"CubeTosses({len(self)} tosses, {frames} frames {self.timestep:.4g} s apart)"

    def __len__(self) -> int:
        return len(self.tosses)

    def __iter__(self) -> Iterator[CubeToss]:
        return iter(self.tosses)

    def __getitem__(self, index: int) -> CubeToss:
        return self.tosses[index]

    @property
    def ids(self) -> NDArray[np.int64]:
        """Published numbers of the tosses, ascending."""
        return np.array([toss.id for toss in self.tosses], np.int64)

    def select(self, ids: Iterable[int]) -> CubeTosses:
        """Return the tosses with these published numbers; ValueError names one that is absent.

        Examples
        --------
        >>> chosen = dashpot.data.load_cube_tosses().select([tosses[1].id])
        >>> len(chosen.tosses)
        1
        """
        by_id = {toss.id: toss for toss in self.tosses}
        wanted = sorted({int(i) for i in ids})
        if absent := [i for i in wanted if i not in by_id]:
            raise ValueError(f"toss {absent[0]} is not among these {len(self)} tosses")
        return replace(self, tosses=tuple(by_id[i] for i in wanted))


def make_toss(
    toss_id: int,
    position: ArrayLike,
    quaternion: ArrayLike,
    velocity: ArrayLike,
    angular_velocity: ArrayLike,
    *,
    timestep: float = 1.0 / FRAME_RATE,
) -> CubeToss:
    """Check the arrays of one toss and return it, its arrays read-only.

    Raises
    ------
    ValueError
        If a shape is wrong, a number is not finite or outside what the experiment allows, or a
        quaternion is not unit; the message names toss, field and frame.
    """
    fields = {
        "position": (position, 3, _POSITION_LIMIT),
        "quaternion": (quaternion, 4, 2.0),
        "velocity": (velocity, 3, _VELOCITY_LIMIT),
        "angular_velocity": (angular_velocity, 3, _ANGULAR_VELOCITY_LIMIT),
    }
    frames = len(np.asarray(position))
    arrays: dict[str, NDArray[np.float64]] = {}
    for name, (values, width, limit) in fields.items():
        array = np.array(number_array(f"toss {toss_id}: {name}", values))
        if array.shape != (frames, width) or frames < 2:
            raise ValueError(f"toss {toss_id}: {name} has shape {array.shape}, not (F, {width})")
        bad = ~(np.abs(array) <= limit)
        if bad.any():
            frame, column = np.argwhere(bad)[0]
            raise ValueError(
                f"toss {toss_id}: {name}[{frame}, {column}] = {array[frame, column]} is outside "
                f"±{limit:g}"
            )
        arrays[name] = array
    error = np.abs(np.linalg.norm(arrays["quaternion"], axis=1) - 1.0)
    if error.max() > _QUATERNION_TOLERANCE:
        frame = int(error.argmax())
        raise ValueError(f"toss {toss_id}: quaternion of frame {frame} is not unit")
    arrays["time"] = np.arange(frames, dtype=np.float64) * timestep
    for array in arrays.values():
        array.flags.writeable = False
    return CubeToss(id=int(toss_id), **arrays)


def find_cube_tosses(path: str | os.PathLike[str] | None = None) -> Path:
    """Return the file of the cube tosses.

    Parameters
    ----------
    path
        The file, or a folder that holds it (directly or in ``cube_tosses``). None looks in the
        folder named by the environment variable ``DASHPOT_DATA`` and, where that is not set, in
        the user's cache, where ``dashpot data cube-tosses`` puts it.

    Raises
    ------
    FileNotFoundError
        If the file is not there; the message says how to get it.

    Examples
    --------
    >>> dashpot.data.find_cube_tosses().suffix
    '.npz'
    """
    if path is not None:
        root, origin = Path(path), "given"
    elif variable := os.environ.get("DASHPOT_DATA"):
        root, origin = Path(variable), "DASHPOT_DATA"
    else:
        root, origin = default_folder(), "the user's cache"
    candidates = [root / FILE_NAME, root / _FOLDER / FILE_NAME]
    for candidate in [root] if os.path.isfile(root) else candidates:
        if os.path.isfile(candidate):
            return candidate
    raise FileNotFoundError(
        f"no cube tosses ({FILE_NAME}) in {root} ({origin}): run `dashpot data cube-tosses` to "
        "download them, or set DASHPOT_DATA to the folder that holds them"
    )


def default_folder() -> Path:
    """Return the folder of the user's cache that holds downloaded data."""
    import pooch

    return Path(pooch.os_cache("dashpot"))


def load_cube_tosses(path: str | os.PathLike[str] | None = None) -> CubeTosses:
    """Read and check the cube tosses.

    Parameters
    ----------
    path
        See :func:`find_cube_tosses`.

    Returns
    -------
    CubeTosses
        SI units, read-only arrays.

    Raises
    ------
    FileNotFoundError
        If the file is not there; the message says how to get it.
    ValueError
        If the file is not such a file or a value in it is impossible.

    Examples
    --------
    >>> len(dashpot.data.load_cube_tosses().tosses)
    400
    """
    file = find_cube_tosses(path)
    try:
        with ArrayArchive(file) as archive:
            content = {key: archive.read(key) for key in (*_ROWS, *_CONSTANTS, "ids", "offsets")}
        offsets, ids = (content[key].astype(np.int64) for key in ("offsets", "ids"))
        rows = [content[key] for key in _ROWS]
        timestep, *constants = (float(content[key]) for key in _CONSTANTS)
        if offsets.ndim != 1 or ids.ndim != 1 or not ids.size:
            raise ValueError("ids and offsets must be rows of numbers")
    except (KeyError, ValueError, TypeError) as error:
        raise ValueError(f"{file}: not a file of cube tosses: {error}") from error
    if (
        offsets.shape != (len(ids) + 1,)
        or offsets[0] != 0
        or (np.diff(offsets) <= 0).any()
        or any(len(array) != offsets[-1] for array in rows)
        or (np.diff(ids) <= 0).any()
    ):
        raise ValueError(f"{file}: ids, offsets and the lengths of the arrays do not agree")
    if not all(value > 0 and np.isfinite(value) for value in (timestep, *constants)):
        raise ValueError(f"{file}: a constant of the cube is not positive")
    tosses = []
    for index, toss_id in enumerate(ids):
        part = slice(offsets[index], offsets[index + 1])
        arrays = [array[part] for array in rows]
        tosses.append(make_toss(int(toss_id), *arrays, timestep=timestep))
    return CubeTosses(tuple(tosses), timestep, *constants)


def save_cube_tosses(tosses: CubeTosses, file: str | os.PathLike[str]) -> None:
    """Write tosses to an ``.npz`` file that :func:`load_cube_tosses` reads.

    Positions and quaternions keep double precision; velocities are stored in single precision.

    Raises
    ------
    TypeError
        If `tosses` is no `CubeTosses`.

    Examples
    --------
    >>> few = dashpot.data.load_cube_tosses().select([toss.id for toss in tosses[:2]])
    >>> dashpot.data.save_cube_tosses(few, "few.npz")
    >>> len(dashpot.data.load_cube_tosses("few.npz").tosses)
    2
    """
    if not isinstance(tosses, CubeTosses):
        raise TypeError(f"tosses is {type(tosses).__name__}; it must be a CubeTosses")
    lengths = [len(toss) for toss in tosses]
    Path(file).parent.mkdir(parents=True, exist_ok=True)
    with open(file, "wb") as stream:
        np.savez_compressed(
            stream,
            ids=tosses.ids.astype(np.int32),
            offsets=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32),
            pos=np.concatenate([toss.position for toss in tosses]),
            quat_wxyz=np.concatenate([toss.quaternion for toss in tosses]),
            vel=np.concatenate([toss.velocity for toss in tosses]).astype(np.float32),
            omega_body=np.concatenate([t.angular_velocity for t in tosses]).astype(np.float32),
            dt=tosses.timestep,
            mass=tosses.mass,
            inertia=tosses.inertia,
            half_width=tosses.half_width,
            gravity=tosses.gravity,
            mu_repo=tosses.nominal_friction,
            restitution_repo=tosses.nominal_restitution,
        )
