"""Poses as seven numbers: how far some are off others, and quaternions on one side."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def same_side(poses: Array) -> Array:
    """Return poses whose quaternions have no jump of sign from one to the next."""
    result = poses.copy()
    quaternion = result.reshape(*poses.shape[:2], -1, 7)[..., 3:]
    turned = np.einsum("...i,...i->...", quaternion[:, 1:], quaternion[:, :-1]) < 0.0
    sign = np.where(np.cumsum(turned, axis=1) % 2, -1.0, 1.0)
    quaternion[:, 1:] *= sign[..., None]
    return result


def pose_errors(reading: Array, observed: Array, bodies: int) -> Array:
    """Return (items, frames, 6 bodies) of poses (items, frames, 7 bodies), observed (frames, .)."""
    shape = (*reading.shape[:-1], bodies, 7)
    simulated, seen = reading.reshape(shape), observed.reshape(shape[1:])
    error = np.empty((*shape[:-1], 6))
    error[..., :3] = simulated[..., :3] - seen[..., :3]
    error[..., 3:] = rotation_between(seen[..., 3:], simulated[..., 3:])
    return error.reshape(*reading.shape[:-1], 6 * bodies)


def rotation_between(first: Array, second: Array) -> Array:
    """Return the rotation vectors (..., 3) of ``R_1^T R_2``, of quaternions, the shorter way."""
    a, b = np.moveaxis(first, -1, 0), np.moveaxis(second, -1, 0)
    w = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    v = np.stack(
        [
            a[0] * b[1] - a[1] * b[0] - a[2] * b[3] + a[3] * b[2],
            a[0] * b[2] + a[1] * b[3] - a[2] * b[0] - a[3] * b[1],
            a[0] * b[3] - a[1] * b[2] + a[2] * b[1] - a[3] * b[0],
        ],
        axis=-1,
    )
    sine = np.sqrt(np.einsum("...i,...i->...", v, v))
    angle = 2.0 * np.arctan2(sine, np.abs(w))
    scale = np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0.0)
    return np.asarray((np.where(w < 0.0, -1.0, 1.0) * scale)[..., None] * v)
