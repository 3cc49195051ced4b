"""The surface of a workpiece, found by rays: any geom that MuJoCo knows."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.grinding.work import GEOM, Work

__all__ = ["Surface"]

Array = NDArray[np.float64]

_FAR = 100.0  # m, from where rays start


class Surface:
    """What rays meet of a workpiece.

    Parameters
    ----------
    work
        The workpiece. Of a height field the surface is that of its facets, whose normals are
        smoothed over the grid.
    """

    def __init__(self, work: Work) -> None:
        spec = mujoco.MjSpec()
        work.add_to(spec)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)
        self._geom = int(self._model.geom(GEOM).id)
        self._work = work

    def meet(self, origins: Array, direction: Array) -> tuple[Array, Array]:
        """Return where rays meet the workpiece, and its outward normals there.

        Parameters
        ----------
        origins
            (n, 3) points that the rays pass through, world, m. Rays begin far before them.
        direction
            (3,) unit vector.

        Returns
        -------
        points, normals : (n, 3)
            NaN where a ray misses.
        """
        points = np.full(origins.shape, np.nan)
        normals = np.full(origins.shape, np.nan)
        normal = np.zeros(3)
        geom = np.zeros(1, dtype=np.int32)
        for index, origin in enumerate(origins):
            start = origin - _FAR * direction
            way = mujoco.mj_ray(
                self._model, self._data, start, direction, None, True, -1, geom, normal
            )
            if way >= 0 and geom[0] == self._geom:
                points[index] = start + way * direction
                normals[index] = -normal if normal @ direction > 0 else normal
        if self._work.kind == "height_field":
            normals = self._smoothed(points, normals)
        return points, normals

    def _smoothed(self, points: Array, normals: Array) -> Array:
        """Return normals of a height field from central differences, bilinear between nodes."""
        from scipy.interpolate import RegularGridInterpolator

        x, y = self._work.grid
        assert self._work.heights is not None
        along_y, along_x = np.gradient(self._work.heights, y, x)
        slopes = RegularGridInterpolator((y, x), np.stack([along_x, along_y], axis=-1))
        found = np.isfinite(points[:, 0])
        at = np.stack(
            [np.clip(points[found, 1], y[0], y[-1]), np.clip(points[found, 0], x[0], x[-1])], axis=1
        )
        slope = slopes(at)
        smooth = np.stack([-slope[:, 0], -slope[:, 1], np.ones(len(at))], axis=1)
        result = normals.copy()
        result[found] = smooth / np.linalg.norm(smooth, axis=1, keepdims=True)
        return result
