"""Materials that differ from world to world, set without a way through the host."""

from typing import Any

import numpy as np
import warp as wp

from dashpot.warp.material import DAMPING, RATIO
from dashpot.warp.model import Model

__all__ = ["set_material"]

wp.set_module_options({"enable_backward": False})


@wp.kernel
def repeat(values: wp.array2d(dtype=wp.float32), out: wp.array2d(dtype=wp.float32)):
    """More rows of the same values, over again; thread per number."""
    world, i = wp.tid()
    out[world, i] = values[world % values.shape[0], i]


@wp.kernel
def repeat_vectors(values: wp.array2d(dtype=wp.vec3), out: wp.array2d(dtype=wp.vec3)):
    """Do the same with vectors."""
    world, i = wp.tid()
    out[world, i] = values[world % values.shape[0], i]


@wp.kernel
def write_column(values: wp.array(dtype=wp.float32), at: int, out: wp.array2d(dtype=wp.float32)):
    """Values of one geom; thread per row."""
    world = wp.tid()
    out[world, at] = values[world % values.shape[0]]


@wp.kernel
def write_friction(values: wp.array(dtype=wp.float32), at: int, out: wp.array2d(dtype=wp.vec3)):
    """Sliding friction of one geom; thread per row."""
    world = wp.tid()
    f = out[world, at]
    out[world, at] = wp.vec3(values[world % values.shape[0]], f[1], f[2])


def set_material(
    m: Model,
    geom: int | str,
    *,
    stiffness: Any = None,
    damping: Any = None,
    damping_ratio: Any = None,
    friction: Any = None,
) -> None:
    """Change the material of a geom in all worlds, or in each on its own.

    Parameters
    ----------
    m
        From `put_model`.
    geom
        Id or name. It must have a material since `put_model`.
    stiffness, damping, damping_ratio, friction
        N/m, N s/m, 1, and the sliding coefficient: a number, or a numpy, Warp or torch array of
        shape (k,), of which world w has entry ``w % k``. Warp and torch arrays on the device are
        copied there, without the host.

    Raises
    ------
    ValueError
        If the geom has no material, or an array no shape (k,).

    Examples
    --------
    >>> dw.set_material(m, "ball", stiffness=np.array([1e4, 2e4, 4e4, 8e4]))  # a world each
    """
    at = m.dashpot.geom_id[geom] if isinstance(geom, str) else int(geom)
    if at not in m.dashpot.materials:
        raise ValueError(f"geom {geom!r} has no material: give it one in put_model")
    if damping is not None and damping_ratio is not None:
        raise ValueError("give at most one of damping and damping_ratio")
    ngeom = m.ngeom
    law = m.dashpot
    if stiffness is not None:
        law.stiffness = _set_column(law.stiffness, at, stiffness, ngeom)
    for value, form in ((damping, DAMPING), (damping_ratio, RATIO)):
        if value is not None:
            law.damping = _set_column(law.damping, at, value, ngeom)
            law.form[at : at + 1].fill_(form)
    if friction is not None:
        values = _column(friction)
        count = len(values)
        if m.geom_friction.shape[0] < count:
            old = m.geom_friction
            m.geom_friction = wp.empty((count, ngeom), dtype=wp.vec3)
            wp.launch(repeat_vectors, dim=(count, ngeom), inputs=[old], outputs=[m.geom_friction])
        wp.launch(
            write_friction, dim=m.geom_friction.shape[0], inputs=[values, at, m.geom_friction]
        )


def _column(value: Any) -> wp.array:
    """Return a one-dimensional float array of Warp; torch tensors are not copied."""
    if isinstance(value, wp.array):
        array = value
    elif type(value).__module__.startswith("torch"):
        array = wp.from_torch(value)
    else:
        array = wp.array(np.atleast_1d(np.asarray(value, dtype=np.float32)), dtype=wp.float32)
    if array.ndim != 1 or array.dtype != wp.float32 or len(array) == 0:
        raise ValueError(f"expected float32 of shape (k,), got {array.dtype} {array.shape}")
    return array


def _set_column(old: wp.array, at: int, value: Any, ngeom: int) -> wp.array:
    """Write one geom's values, with as many rows as they need."""
    values = _column(value)
    array = old
    if old.shape[0] < len(values):
        array = wp.empty((len(values), ngeom), dtype=wp.float32)
        wp.launch(repeat, dim=array.shape, inputs=[old], outputs=[array])
    wp.launch(write_column, dim=array.shape[0], inputs=[values, at, array])
    return array
