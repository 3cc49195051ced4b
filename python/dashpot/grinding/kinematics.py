"""Inverse kinematics of a path, by mink: joint limits, no jumps, what is out of reach."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.grinding.cell_model import SITE
from dashpot.grinding.packages import needed

if TYPE_CHECKING:
    from dashpot.grinding.cell import Cell

__all__ = ["PoseSolver", "rotations"]

Array = NDArray[np.float64]

_CLOSE = 1e-9  # m and rad, where a search ends
_REACHED = 1e-6
_ROUNDS = 200
_STALLED = 0.999
_JUMP = 0.5  # rad, between neighbouring points


def rotations(axes: Array, first: Array) -> Array:
    """Return (n, 3, 3) frames whose z are `axes`; x turns as little as may be, from `first`."""
    frames, x = np.empty((len(axes), 3, 3)), first
    for index, z in enumerate(axes):
        x = x - (x @ z) * z
        length = float(np.linalg.norm(x))
        if length < 1e-9:
            raise ValueError(f"path point {index}: the tool turns over there")
        x = x / length
        frames[index] = np.stack([x, np.cross(z, x), z], axis=1)
    return frames


class PoseSolver:
    """Joint angles for poses of the tip, one after the other, each from the last one's."""

    def __init__(self, cell: Cell) -> None:
        self._mink = needed("mink", "inverse kinematics")
        needed("daqp", "inverse kinematics")
        self._model = cell.rigid.model
        self._names = cell.rigid.joint_names
        self._home = cell.home
        self._configuration: Any = self._mink.Configuration(self._model)
        self._task: Any = self._mink.FrameTask(SITE, "site", 1.0, 1.0)
        self._limits = [self._mink.ConfigurationLimit(self._model)]

    def home_frame(self) -> Array:
        """Return the orientation (3, 3) of the tip at home."""
        self._configuration.update(self._home)
        return np.array(self._configuration.data.site(SITE).xmat).reshape(3, 3)

    def along(self, places: Array, frames: Array, start: Array | None = None) -> Array:
        """Return (n, joints) angles for places (n, 3) and orientations (n, 3, 3) of the tip.

        Raises
        ------
        ValueError
            Naming the point, where it cannot be reached or a joint would jump.
        """
        angles = np.empty((len(places), self._model.nq))
        last = self._home if start is None else start
        for index, (place, frame) in enumerate(zip(places, frames, strict=True)):
            found, error = self._solve(place, frame, last)
            if error > _REACHED:
                raise ValueError(self._said(index, place, found, error))
            change = np.abs(found - last)
            if index > 0 and change.max() > _JUMP:
                joint = int(change.argmax())
                raise ValueError(
                    f"path point {index} at {_place(place)}: joint {self._names[joint]!r} jumps by "
                    f"{change[joint]:.2f} rad from the point before"
                )
            angles[index] = last = found
        return angles

    def _solve(self, place: Array, frame: Array, start: Array) -> tuple[Array, float]:
        """Return joint angles, and how far (m or rad) the tip is from the pose."""
        mink, configuration = self._mink, self._configuration
        configuration.update(start)
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(frame).ravel())
        target = mink.SE3.from_rotation_and_translation(mink.SO3(quaternion), place)
        self._task.set_target(target)
        best, angles = np.inf, start
        for _ in range(_ROUNDS):
            error = float(np.abs(self._task.compute_error(configuration)).max())
            stalled = error > _STALLED * best
            if error < best:
                best, angles = error, np.array(configuration.q)
            if best < _CLOSE or stalled:
                break
            speed = mink.solve_ik(
                configuration, [self._task], 1.0, "daqp", damping=1e-9, limits=self._limits
            )
            configuration.integrate_inplace(speed, 1.0)
        return angles, best

    def _said(self, index: int, place: Array, angles: Array, error: float) -> str:
        text = f"path point {index} at {_place(place)} cannot be reached: {1e3 * error:.3g} mm off"
        limited = self._model.jnt_limited.astype(bool)
        lower, upper = self._model.jnt_range.T
        at_limit = limited & ((angles < lower + 1e-4) | (angles > upper - 1e-4))
        if at_limit.any():
            names = ", ".join(repr(self._names[j]) for j in np.flatnonzero(at_limit))
            text += f", with {names} at the limit"
        return text


def _place(point: Array) -> str:
    return "(" + ", ".join(f"{x:.3f}" for x in point) + ") m"
