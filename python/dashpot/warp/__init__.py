"""Thousands of worlds at once: dashpot's contact law on MuJoCo Warp's data.

A drop-in for ``mujoco_warp``: the same names, on the same models and data::

    import dashpot.warp as dw

    m = dw.put_model(mjm, materials={"ball": dashpot.Material(1e4, restitution=0.9)})
    d = dw.make_data(mjm, nworld=4096)
    for _ in range(1000):
        dw.step(m, d)

`Model` and `Data` are subclasses of MuJoCo Warp's, so that its sensors, rays, renderer and bridges
to JAX and torch take them. Every other name of ``mujoco_warp`` is found here too. Needs the extra:
``pip install dashpot[warp]``.
"""

from __future__ import annotations

from typing import Any

try:
    import mujoco_warp as _mujoco_warp
    import warp as _warp  # noqa: F401
except ImportError as _error:
    raise ImportError(
        "dashpot.warp needs warp-lang and mujoco-warp: pip install 'dashpot[warp]'"
    ) from _error

from dashpot.warp.batches import set_material
from dashpot.warp.data import (
    Data,
    get_data_into,
    make_data,
    put_data,
    reset_data,
)
from dashpot.warp.model import Model, put_model
from dashpot.warp.step import forward, rollout, step

__all__ = [
    "Data",
    "Model",
    "forward",
    "get_data_into",
    "make_data",
    "put_data",
    "put_model",
    "reset_data",
    "rollout",
    "set_material",
    "step",
]


def __getattr__(name: str) -> Any:
    """Return what only MuJoCo Warp has."""
    return getattr(_mujoco_warp, name)
