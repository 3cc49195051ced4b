"""Signed distance of two geoms, at one configuration or at many."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot import _core
from dashpot.checks import thread_count
from dashpot.query import arguments
from dashpot.query.arguments import Geom

if TYPE_CHECKING:
    from dashpot.engine import Engine


@dataclass(frozen=True, kw_only=True, eq=False)
class Distance:
    """Signed distance of two geoms, with the points that witness it.

    Attributes
    ----------
    distance
        m; positive apart, negative by the penetration depth: the length of the shortest
        translation that parts the two (of a height field: see `distance`).
    point1, point2
        Shape (3,), m, world: the closest points, or the deepest ones of a penetration, on the
        surfaces of the first and second geom. ``point2 - point1 == distance * normal`` to rounding,
        and to 1e-5 of the size of the pair where a cylinder or an ellipsoid takes part. It is to
        5e-4 where these overlap about a common centre, as many directions are nearly as short
        there.
    normal
        Shape (3,), unit, world, from the first geom to the second.

    Examples
    --------
    >>> found = dashpot.distance(engine, data, "ball", "box")
    >>> bool(np.allclose(found.point2 - found.point1, found.distance * found.normal))
    True
    >>> round(float(found.normal[0]), 6)  # from the ball to the box
    1.0
    """

    distance: float
    point1: NDArray[np.float64]
    point2: NDArray[np.float64]
    normal: NDArray[np.float64]

    @classmethod
    def _from_core(
        cls, raw: tuple[float, tuple[float, ...], tuple[float, ...], tuple[float, ...]]
    ) -> Distance:
        value, point1, point2, normal = raw
        return cls(
            distance=value,
            point1=np.array(point1),
            point2=np.array(point2),
            normal=np.array(normal),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Distances:
    """Signed distances of two geoms at many configurations; ``...`` is the shape of these.

    Attributes
    ----------
    distance
        Shape (...), m, as in `Distance`.
    point1, point2
        Shape (..., 3), m, world.
    normal
        Shape (..., 3), unit, world, from the first geom to the second.

    Examples
    --------
    >>> path = np.tile(data.qpos, (3, 1))
    >>> path[:, 2] = [0.2, 0.3, 0.4]  # heights of the ball
    >>> found = dashpot.distances(engine, "ball", "floor", path)
    >>> found.distance.shape, found.normal.shape
    ((3,), (3, 3))
    """

    distance: NDArray[np.float64]
    point1: NDArray[np.float64]
    point2: NDArray[np.float64]
    normal: NDArray[np.float64]


def distance(
    engine: Engine | mujoco.MjModel, data: mujoco.MjData, geom1: Geom, geom2: Geom
) -> Distance:
    """Signed distance of two geoms, with closest points and normal.

    Poses are those that the kinematics of `data` last left, as in ``mujoco.mj_geomDistance``: call
    ``mujoco.mj_forward`` after changing ``qpos``. After a step they are those of its start.

    Parameters
    ----------
    engine
        The engine, or a plain model.
    data
        Data made from that model.
    geom1, geom2
        Names or ids. Planes (half-spaces), spheres, capsules, cylinders, ellipsoids, boxes,
        meshes (their convex hulls) and height fields. `margin` and `gap` play no part.

        A height field is a solid: two triangular prisms a cell, as MuJoCo splits it, from the
        surface down to its base. Apart from it, the distance is that of the nearest prism. In
        overlap it is that of the prism which is deepest in the other geom: the length of the
        shortest translation that parts these two. That is no more than what clears the whole solid.
        It is less where that translation points into a neighbouring prism, as it can for a geom
        that is as deep below the surface as a cell is wide. Against a plane it is exact for the
        solid.

    Returns
    -------
    Distance
        Exact to rounding for planes, spheres, capsules, boxes and meshes among each other, and for
        cylinders and capsules with parallel axes. Where a cylinder or an ellipsoid takes part it is
        within 1e-6 of the size of the pair, mostly 1e-10, and within 1e-5 where these overlap about
        a common centre. Where several directions are equally short, one of them.

    Raises
    ------
    ValueError
        Unknown geom, the same geom twice, two planes, two height fields, a signed distance field,
        data of another model, a pose or a height that is not finite.

    Examples
    --------
    >>> round(dashpot.distance(engine, data, "ball", "box").distance, 6)
    0.8
    >>> round(dashpot.distance(engine, data, "ball", "floor").distance, 6)  # it sags by m g / k
    -0.000981
    """
    model = arguments.model_of(engine)
    id1, id2 = arguments.geom_pair(model, data, geom1, geom2)
    return Distance._from_core(_core.geom_distance(model._address, data._address, id1, id2))


def distances(
    engine: Engine | mujoco.MjModel,
    geom1: Geom,
    geom2: Geom,
    qpos: ArrayLike,
    *,
    nthread: int | None = None,
) -> Distances:
    """Signed distance of two geoms at many configurations, in parallel C++ threads.

    Every entry is what `distance` gives after ``mujoco.mj_kinematics`` at that configuration, bit
    for bit, whatever the number of threads. Bodies moved by mocap are where the model has them.

    Parameters
    ----------
    engine
        The engine, or a plain model; it is only read.
    geom1, geom2
        Names or ids, of the kinds that `distance` takes.
    qpos
        Shape (..., nq): configurations, such as (n, nq) or a trajectory's (nbatch, nstep, nq).
        Those of a `rollout` with full-physics states are ``state[..., 1 : 1 + nq]``.
    nthread
        Number of threads, >= 1. None: one per core.

    Raises
    ------
    TypeError
        Arguments that are not numbers.
    ValueError
        As `distance`; also a `qpos` of another shape or that is not finite, naming the index, and
        an `nthread` below 1.

    Examples
    --------
    >>> path = np.tile(data.qpos, (3, 1))
    >>> path[:, 2] = [0.2, 0.3, 0.4]  # heights of the ball
    >>> dashpot.distances(engine, "ball", "floor", path).distance.round(6)
    array([0.1, 0.2, 0.3])
    """
    model = arguments.model_of(engine)
    id1, id2 = arguments.distinct_geoms(model, geom1, geom2)
    positions = arguments.vectors("qpos", qpos, "nq", model.nq)
    shape = positions.shape[:-1]
    rows = positions.reshape(math.prod(shape), model.nq)
    value, point1, point2, normal = _core.geom_distances(
        model._address, id1, id2, rows, thread_count(nthread)
    )
    return Distances(
        distance=value.reshape(shape),
        point1=point1.reshape(*shape, 3),
        point2=point2.reshape(*shape, 3),
        normal=normal.reshape(*shape, 3),
    )
