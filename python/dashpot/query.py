"""Contact queries between geoms: signed distances, time of impact, close pairs."""

from __future__ import annotations

import difflib
import math
import operator
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot import _core

if TYPE_CHECKING:
    from dashpot.engine import Engine

Geom: TypeAlias = str | int

_OBJECT = {"geom": mujoco.mjtObj.mjOBJ_GEOM, "body": mujoco.mjtObj.mjOBJ_BODY}


@dataclass(frozen=True, kw_only=True)
class Distance:
    """Signed distance of two geoms, with the points that witness it.

    Attributes
    ----------
    distance
        m; positive apart, negative by the penetration depth: the length of the shortest
        translation that parts the two (of a height field: see `distance`).
    point1, point2
        Shape (3,), m, world: the closest points, or the deepest ones of a penetration, on the
        surfaces of the first and second geom. ``point2 - point1 == distance * normal``.
    normal
        Shape (3,), unit, world, from the first geom to the second.
    """

    distance: float
    point1: NDArray[np.float64]
    point2: NDArray[np.float64]
    normal: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
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
    """

    distance: NDArray[np.float64]
    point1: NDArray[np.float64]
    point2: NDArray[np.float64]
    normal: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class TimeOfImpact:
    """First contact of two geoms along their present velocities.

    Attributes
    ----------
    hit
        Whether they touch within the horizon.
    time
        s, of first contact; the horizon without a hit.
    point
        Shape (3,), m, world: between the closest points at `time`.
    normal
        Shape (3,), unit, world, from the first geom to the second at `time`.
    distance
        m, the signed distance at `time`: nearly zero for a hit, negative where the geoms overlap
        at the start, the clearance left without a hit.
    """

    hit: bool
    time: float
    point: NDArray[np.float64]
    normal: NDArray[np.float64]
    distance: float


@dataclass(frozen=True, kw_only=True)
class TimesOfImpact:
    """First contacts of two geoms from many states; ``...`` is the shape of these.

    Attributes
    ----------
    hit
        Shape (...), bool: whether they touch within the horizon.
    time
        Shape (...), s, of first contact; the horizon without a hit.
    point
        Shape (..., 3), m, world: between the closest points at `time`.
    normal
        Shape (..., 3), unit, world, from the first geom to the second at `time`.
    distance
        Shape (...), m, the signed distance at `time`, as in `TimeOfImpact`.
    """

    hit: NDArray[np.bool_]
    time: NDArray[np.float64]
    point: NDArray[np.float64]
    normal: NDArray[np.float64]
    distance: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
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
    """

    geom: NDArray[np.int64]
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
        overlap it is that of the prism which is deepest in the other geom, the length of the
        shortest translation that parts these two: no more than what clears the whole solid, and
        less where that translation points into a neighbouring prism, as it can for a geom that is
        as deep below the surface as a cell is wide. Against a plane it is exact for the solid.

    Returns
    -------
    Distance
        Exact to rounding for planes, spheres, capsules, boxes and meshes among each other; within
        1e-6 of the size of the pair where a cylinder or an ellipsoid takes part, mostly 1e-10.
        Where several directions are equally short, one of them.

    Raises
    ------
    ValueError
        Unknown geom, the same geom twice, two planes, two height fields, a signed distance field,
        data of another model, a pose or a height that is not finite.
    """
    model = _model(engine)
    id1, id2 = _geom_pair(model, data, geom1, geom2)
    return _distance(_core.geom_distance(model._address, data._address, id1, id2))


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
    """
    model = _model(engine)
    id1, id2 = _distinct_geoms(model, geom1, geom2)
    positions = _vectors("qpos", qpos, "nq", model.nq)
    shape = positions.shape[:-1]
    rows = positions.reshape(math.prod(shape), model.nq)
    value, point1, point2, normal = _core.geom_distances(
        model._address, id1, id2, rows, _threads(nthread)
    )
    return Distances(
        distance=value.reshape(shape),
        point1=point1.reshape(*shape, 3),
        point2=point2.reshape(*shape, 3),
        normal=normal.reshape(*shape, 3),
    )


def time_of_impact(
    engine: Engine | mujoco.MjModel,
    data: mujoco.MjData,
    geom1: Geom,
    geom2: Geom,
    *,
    horizon: float,
) -> TimeOfImpact:
    """First contact of two geoms along their present velocities, rotation included.

    Each body moves on as a rigid body with constant velocity of its centre of mass and constant
    angular velocity in the world; loads do not act. Conservative advancement: the time is never
    after the first contact, and the gap left at it is at most 1e-9 of the geoms' size, which also
    is the clearance below which geoms that pass each other count as touching.

    Positions and velocities are those that the kinematics of `data` last left: call
    ``mujoco.mj_forward`` after changing ``qpos`` or ``qvel``.

    Parameters
    ----------
    engine
        The engine, or a plain model.
    data
        Data made from that model.
    geom1, geom2
        Names or ids, of the kinds that `distance` takes.
    horizon
        s, > 0, how far to look ahead.

    Returns
    -------
    TimeOfImpact
        Time 0 where the geoms touch or overlap already.

    Raises
    ------
    ValueError
        As `distance`; also a `horizon` that is not positive and finite, a velocity that is not
        finite, a plane on a turning body.
    RuntimeError
        No decision in 10,000 distances: the geoms hover about 1e-9 of their size apart.
    """
    model = _model(engine)
    id1, id2 = _geom_pair(model, data, geom1, geom2)
    hit, time, at, _ = _core.geom_time_of_impact(
        model._address, data._address, id1, id2, _positive_horizon(horizon)
    )
    found = _distance(at)
    return TimeOfImpact(
        hit=hit,
        time=time,
        point=0.5 * (found.point1 + found.point2),
        normal=found.normal,
        distance=found.distance,
    )


def times_of_impact(
    engine: Engine | mujoco.MjModel,
    geom1: Geom,
    geom2: Geom,
    qpos: ArrayLike,
    qvel: ArrayLike,
    *,
    horizon: float,
    nthread: int | None = None,
) -> TimesOfImpact:
    """First contact of two geoms from many states, in parallel C++ threads.

    Every entry is what `time_of_impact` gives after the kinematics of that state
    (``mujoco.mj_forward``), bit for bit, whatever the number of threads. Bodies moved by mocap are
    where the model has them.

    Parameters
    ----------
    engine
        The engine, or a plain model; it is only read.
    geom1, geom2
        Names or ids, of the kinds that `distance` takes.
    qpos, qvel
        Shapes (..., nq) and (..., nv), the same ``...``: states, such as those of a trajectory.
        Those of a `rollout` with full-physics states are ``state[..., 1 : 1 + nq]`` and
        ``state[..., 1 + nq : 1 + nq + nv]``.
    horizon
        s, > 0, how far to look ahead of each state.
    nthread
        Number of threads, >= 1. None: one per core.

    Raises
    ------
    TypeError
        Arguments that are not numbers.
    ValueError
        As `time_of_impact`; also a `qpos` or `qvel` of another shape or that is not finite, naming
        the index, and an `nthread` below 1.
    RuntimeError
        As `time_of_impact`.
    """
    model = _model(engine)
    id1, id2 = _distinct_geoms(model, geom1, geom2)
    positions = _vectors("qpos", qpos, "nq", model.nq)
    velocities = _vectors("qvel", qvel, "nv", model.nv)
    shape = positions.shape[:-1]
    if velocities.shape[:-1] != shape:
        raise ValueError(
            f"qpos and qvel must hold the same states, got {positions.shape} and {velocities.shape}"
        )
    count = math.prod(shape)
    hit, time, (value, point1, point2, normal) = _core.geom_times_of_impact(
        model._address,
        id1,
        id2,
        positions.reshape(count, model.nq),
        velocities.reshape(count, model.nv),
        _positive_horizon(horizon),
        _threads(nthread),
    )
    return TimesOfImpact(
        hit=hit.reshape(shape),
        time=time.reshape(shape),
        point=(0.5 * (point1 + point2)).reshape(*shape, 3),
        normal=normal.reshape(*shape, 3),
        distance=value.reshape(shape),
    )


def closest(
    engine: Engine | mujoco.MjModel,
    data: mujoco.MjData,
    body: str | int | None = None,
    *,
    radius: float,
) -> Closest:
    """Find all pairs of geoms within a radius of each other.

    A bounding-box tree finds candidates, `distance` decides. Geoms that take no part in collisions
    (``contype`` and ``conaffinity`` both zero), pairs that cannot move against each other, pairs of
    planes and pairs of height fields are left out; other filters of the model (parent and child,
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
    """
    model = _model(engine)
    _check_data(data)
    radius = float(radius)
    if not (math.isfinite(radius) and radius >= 0.0):
        raise ValueError(f"radius = {radius} m must be finite and not negative")
    index = -1 if body is None else object_id(model, body, "body", "body")
    found = _core.close_geoms(model._address, data._address, index, radius)
    return Closest(
        geom=np.array([pair[:2] for pair in found], dtype=np.int64).reshape(-1, 2),
        distance=np.array([raw[0] for _, _, raw in found], dtype=float),
        point1=np.array([raw[1] for _, _, raw in found], dtype=float).reshape(-1, 3),
        point2=np.array([raw[2] for _, _, raw in found], dtype=float).reshape(-1, 3),
        normal=np.array([raw[3] for _, _, raw in found], dtype=float).reshape(-1, 3),
    )


def _distance(
    raw: tuple[float, tuple[float, ...], tuple[float, ...], tuple[float, ...]],
) -> Distance:
    value, point1, point2, normal = raw
    return Distance(
        distance=value,
        point1=np.array(point1),
        point2=np.array(point2),
        normal=np.array(normal),
    )


def _vectors(name: str, value: ArrayLike, size_name: str, size: int) -> NDArray[np.float64]:
    """Array (..., size) of finite numbers."""
    try:
        vectors = np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} must be an array of numbers: {error}") from None
    if np.ndim(value) == 0 or vectors.shape[-1] != size:
        raise ValueError(
            f"{name} must be (..., {size_name}) with {size_name} = {size}, got {np.shape(value)}"
        )
    bad = np.argwhere(~np.isfinite(vectors))
    if bad.size:
        index = tuple(int(i) for i in bad[0])
        raise ValueError(f"{name}{list(index)} is {vectors[index]}")
    return vectors


def _threads(nthread: int | None) -> int:
    """Check a number of threads; the core takes 0 as one per core."""
    if nthread is None:
        return 0
    if isinstance(nthread, bool) or not isinstance(nthread, int | np.integer):
        raise TypeError(f"nthread must be an integer, got {nthread!r}")
    if nthread < 1:
        raise ValueError(f"nthread must be >= 1, got {nthread}")
    return int(nthread)


def _positive_horizon(horizon: float) -> float:
    horizon = float(horizon)
    if not (math.isfinite(horizon) and horizon > 0.0):
        raise ValueError(f"horizon = {horizon} s must be positive and finite")
    return horizon


def _model(engine: Engine | mujoco.MjModel) -> mujoco.MjModel:
    model = engine if isinstance(engine, mujoco.MjModel) else getattr(engine, "model", None)
    if not isinstance(model, mujoco.MjModel) or isinstance(engine, mujoco.MjData):
        raise TypeError(
            f"expected a dashpot.Engine or a mujoco.MjModel, got {type(engine).__name__}"
        )
    return model


def _check_data(data: mujoco.MjData) -> None:
    if not isinstance(data, mujoco.MjData):
        raise TypeError(f"data must be a mujoco.MjData, got {type(data).__name__}")


def _geom_pair(
    model: mujoco.MjModel, data: mujoco.MjData, geom1: Geom, geom2: Geom
) -> tuple[int, int]:
    _check_data(data)
    return _distinct_geoms(model, geom1, geom2)


def _distinct_geoms(model: mujoco.MjModel, geom1: Geom, geom2: Geom) -> tuple[int, int]:
    id1, id2 = (
        object_id(model, geom, "geom", argument)
        for geom, argument in ((geom1, "geom1"), (geom2, "geom2"))
    )
    if id1 == id2:
        raise ValueError(f"geom1 and geom2 are the same geom: {geom1!r}")
    return id1, id2


def object_id(model: mujoco.MjModel, key: str | int, kind: str, argument: str) -> int:
    """Id of the geom or body that `argument` names."""
    count: int = getattr(model, f"n{kind}")
    if isinstance(key, str):
        index = mujoco.mj_name2id(model, _OBJECT[kind], key)
        if index >= 0:
            return int(index)
        accessor = getattr(model, kind)
        names = [name for i in range(count) if (name := accessor(i).name)]
        near = difflib.get_close_matches(key, names, n=3)
        hint = f"; did you mean {', '.join(map(repr, near))}?" if near else ""
        raise ValueError(f"{argument}: the model has no {kind} named {key!r}{hint}")
    if isinstance(key, bool):
        raise TypeError(f"{argument} must be a {kind} name or id, got {key!r}")
    try:
        index = operator.index(key)
    except TypeError:
        raise TypeError(
            f"{argument} must be a {kind} name or id, got {type(key).__name__}"
        ) from None
    if not 0 <= index < count:
        raise ValueError(f"{argument} = {index} is not a {kind} id of the model, 0 to {count - 1}")
    return index
