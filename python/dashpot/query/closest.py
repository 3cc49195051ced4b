"""Pairs of geoms within a radius of each other."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot import _core
from dashpot.checks import number
from dashpot.object_ids import Element, object_id
from dashpot.query import arguments

if TYPE_CHECKING:
    from dashpot.engine import Engine


@dataclass(frozen=True, kw_only=True, eq=False)
class Closest:
    """Pairs of close geoms, nearest first; n pairs.

    Attributes
    ----------
    geom
        Shape (n, 2), ids of the first and second geom, smaller first.
    distance
        Shape (n,), m, signed, ascending.
    point1, point2
        Shape (n, 3), m, world, as in `Distance`.
    normal
        Shape (n, 3), unit, world, from the first geom to the second.

    Examples
    --------
    >>> near = dashpot.closest(engine, data, radius=0.05)
    >>> [tuple(engine.model.geom(int(g)).name for g in pair) for pair in near.geom]
    [('floor', 'ball'), ('floor', 'box')]
    >>> near.distance.shape, near.point1.shape
    ((2,), (2, 3))
    """

    geom: NDArray[np.int64]
    distance: NDArray[np.float64]
    point1: NDArray[np.float64]
    point2: NDArray[np.float64]
    normal: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.distance)


def closest(
    engine: Engine | mujoco.MjModel,
    data: mujoco.MjData,
    body: Element | None = None,
    *,
    radius: float,
) -> Closest:
    """Find all pairs of geoms within a radius of each other.

    A bounding-box tree finds candidates, `distance` decides. Geoms that take no part in collisions
    (``contype`` and ``conaffinity`` both zero), pairs that cannot move against each other, pairs of
    planes and pairs of height fields are left out. Other filters of the model (parent and child,
    exclusions) do not act.

    Parameters
    ----------
    engine
        The engine, or a plain model.
    data
        Data made from that model; poses as in `distance`.
    body
        Name or id: only pairs with a geom of that body. All pairs where not given.
    radius
        m, >= 0: largest distance of a pair. 0 gives what touches and overlaps.

    Raises
    ------
    ValueError
        Unknown body, a `radius` that is negative or not finite, a signed distance field among the
        geoms, data of another model, a pose or a height that is not finite.

    Examples
    --------
    >>> near = dashpot.closest(engine, data, body="ball", radius=0.01)
    >>> near.geom  # the floor, 0, and the ball, 1
    array([[0, 1]])
    >>> near.distance.round(6)
    array([-0.000981])
    """
    model = arguments.model_of(engine)
    arguments.check_data(model, data)
    radius = number("radius", radius)
    if not (math.isfinite(radius) and radius >= 0.0):
        raise ValueError(f"radius must be finite and >= 0 m, got {radius!r}")
    index = -1 if body is None else object_id(model, body, "body", "body")
    found = _core.close_geoms(model._address, data._address, index, radius)
    return Closest(
        geom=np.array([pair[:2] for pair in found], dtype=np.int64).reshape(-1, 2),
        distance=np.array([raw[0] for _, _, raw in found], dtype=float),
        point1=np.array([raw[1] for _, _, raw in found], dtype=float).reshape(-1, 3),
        point2=np.array([raw[2] for _, _, raw in found], dtype=float).reshape(-1, 3),
        normal=np.array([raw[3] for _, _, raw in found], dtype=float).reshape(-1, 3),
    )
