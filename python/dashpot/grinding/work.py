"""Workpieces: a primitive, a mesh, a height field, or an MJCF file."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot.checks import finite_array, positive_number

__all__ = ["Work"]

Array = NDArray[np.float64]

GEOM = "work"
"""Name of the geom that is ground."""

_COLOUR = [0.62, 0.66, 0.72, 1.0]
_NUMBERS = {"box": 3, "sphere": 1, "cylinder": 2, "capsule": 2, "ellipsoid": 3}


@dataclass(frozen=True, eq=False)
class Work:
    """The part that is ground: one geom, fixed to the world.

    Make it with `primitive`, `mesh`, `height_field` or `from_mjcf`.

    Attributes
    ----------
    kind
        ``"box"``, ``"sphere"``, ``"cylinder"``, ``"capsule"``, ``"ellipsoid"``, ``"mesh"``,
        ``"height_field"`` or ``"mjcf"``.
    position, quaternion
        Pose in the world, whose origin is the foot of the arm; m and unit, scalar first.
    size
        Half lengths and radii of a primitive as in MJCF, m; lengths along x and y of a height
        field.
    heights
        (ny, nx) heights of a height field above its position, m, x along the columns.
    file
        Of a mesh or MJCF.

    Examples
    --------
    >>> field = grinding.Work.height_field(np.zeros((40, 60)), (0.3, 0.2), (0, 0.5, 0.1))
    >>> field.kind, field.heights.shape
    ('height_field', (40, 60))
    """

    kind: str
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    size: tuple[float, ...] = ()
    heights: Array | None = None
    file: str | None = None

    @classmethod
    def primitive(
        cls,
        kind: str,
        size: ArrayLike,
        position: ArrayLike = (0.0, 0.0, 0.0),
        quaternion: ArrayLike = (1.0, 0.0, 0.0, 0.0),
    ) -> Work:
        """Return a workpiece of one of MuJoCo's primitives; `size` is that of the MJCF geom."""
        if kind not in _NUMBERS:
            raise ValueError(f"work: kind is {kind!r}, none of {', '.join(_NUMBERS)}")
        numbers = np.atleast_1d(finite_array("work: size", size))
        if numbers.shape != (_NUMBERS[kind],) or not (numbers > 0).all():
            raise ValueError(
                f"work: size of a {kind} must be {_NUMBERS[kind]} numbers > 0, got {size!r}"
            )
        return cls(kind, *_pose(position, quaternion), tuple(map(float, numbers)))

    @classmethod
    def mesh(
        cls,
        file: str | os.PathLike[str],
        position: ArrayLike = (0.0, 0.0, 0.0),
        quaternion: ArrayLike = (1.0, 0.0, 0.0, 0.0),
    ) -> Work:
        """Return a workpiece of a mesh file (STL, OBJ), in m. It is ground on its convex hull."""
        return cls("mesh", *_pose(position, quaternion), file=_existing(file))

    @classmethod
    def height_field(
        cls,
        heights: ArrayLike,
        size: tuple[float, float],
        position: ArrayLike = (0.0, 0.0, 0.0),
    ) -> Work:
        """Return a workpiece whose surface is a field of heights, which recedes when it is ground.

        Parameters
        ----------
        heights
            (ny, nx) heights above `position`, m: x along the columns, y along the rows.
        size
            Lengths along x and y, m, > 0, with `position` in the middle.
        position
            World, m.
        """
        field = finite_array("work: heights", heights)
        if field.ndim != 2 or min(field.shape) < 2:
            raise ValueError(f"work: heights must be (ny, nx), >= 2 each, got {field.shape}")
        lengths = tuple(positive_number(f"work: size[{i}]", size[i]) for i in range(2))
        field = np.array(field)
        field.flags.writeable = False
        return cls("height_field", *_pose(position, (1, 0, 0, 0)), lengths, heights=field)

    @classmethod
    def from_mjcf(cls, file: str | os.PathLike[str]) -> Work:
        """Return what an MJCF file holds, placed as it is there; its geom ``work`` is ground."""
        return cls("mjcf", file=_existing(file))

    def with_heights(self, heights: Array) -> Work:
        """Return the same height field with other heights."""
        return replace(self, heights=heights)

    @property
    def grid(self) -> tuple[Array, Array]:
        """Places of the columns (nx,) and rows (ny,) of a height field, world, m."""
        if self.heights is None:
            raise ValueError(f"work: a {self.kind} has no heights; make it a height_field")
        ny, nx = self.heights.shape
        x, y = (
            self.position[i] + self.size[i] * np.linspace(-0.5, 0.5, n)
            for i, n in enumerate((nx, ny))
        )
        return x, y

    def add_to(self, spec: mujoco.MjSpec) -> None:
        """Put the workpiece into a model; ValueError names what a file lacks."""
        if self.kind == "mjcf":
            self._attach_file(spec)
            return
        options: dict[str, Any] = {"name": GEOM, "rgba": _COLOUR, "pos": self.position}
        options["quat"] = self.quaternion
        if self.kind == "height_field":
            options["pos"] = self._add_height_field(spec)
            options |= {"type": mujoco.mjtGeom.mjGEOM_HFIELD, "hfieldname": GEOM}
        elif self.kind == "mesh":
            spec.add_mesh(name=GEOM, file=self.file)
            options |= {"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": GEOM}
        else:
            kind = getattr(mujoco.mjtGeom, f"mjGEOM_{self.kind.upper()}")
            options |= {"type": kind, "size": [*self.size, 0.0, 0.0][:3]}
        spec.worldbody.add_geom(**options)

    def _add_height_field(self, spec: mujoco.MjSpec) -> list[float]:
        """Add the heights, which MuJoCo holds from 0 to 1; return where the geom is."""
        assert self.heights is not None
        lowest, highest = float(self.heights.min()), float(self.heights.max())
        span = max(highest - lowest, 1e-3)
        ny, nx = self.heights.shape
        spec.add_hfield(
            name=GEOM,
            nrow=ny,
            ncol=nx,
            size=[self.size[0] / 2, self.size[1] / 2, span, 0.02],
            userdata=list(((self.heights - lowest) / span).ravel()),
        )
        x, y, z = self.position
        return [x, y, z + lowest]

    def _attach_file(self, spec: mujoco.MjSpec) -> None:
        part = mujoco.MjSpec.from_file(self.file)
        names = [geom.name for geom in part.geoms]
        if names.count(GEOM) != 1:
            raise ValueError(f"work {self.file!r} has no geom named {GEOM!r}; it has {names}")
        if part.joints:
            raise ValueError(f"work {self.file!r} has joints; a workpiece is fixed")
        frame = spec.worldbody.add_frame()
        # Without a prefix: the geom keeps its name.
        spec.attach(part, frame=frame, prefix="")


def _existing(file: str | os.PathLike[str]) -> str:
    if not Path(file).is_file():
        raise FileNotFoundError(f"work: no file {os.fspath(file)!r}")
    return str(Path(file).resolve())


def _pose(
    position: ArrayLike, quaternion: ArrayLike
) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    place = finite_array("work: position", position)
    turn = finite_array("work: quaternion", quaternion)
    if place.shape != (3,):
        raise ValueError(f"work: position must be (3,), got {place.shape}")
    length = float(np.linalg.norm(turn))
    if turn.shape != (4,) or length < 1e-6:
        raise ValueError(f"work: quaternion must be four numbers, not all 0, got {quaternion!r}")
    x, y, z = map(float, place)
    a, b, c, d = map(float, turn / length)
    return (x, y, z), (a, b, c, d)
