"""First contact of two geoms along their velocities, from one state or from many."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot import _core
from dashpot.checks import positive_number, thread_count
from dashpot.query import arguments
from dashpot.query.arguments import Geom
from dashpot.query.distance import Distance

if TYPE_CHECKING:
    from dashpot.engine import Engine


@dataclass(frozen=True, kw_only=True, eq=False)
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

    Examples
    --------
    >>> flying = engine.make_data()  # the ball is 0.1 m above the floor
    >>> flying.qvel[2] = -2.0
    >>> mujoco.mj_forward(engine.model, flying)
    >>> found = dashpot.time_of_impact(engine, flying, "ball", "floor", horizon=0.01)
    >>> found.hit, round(found.time, 6), round(found.distance, 6)
    (False, 0.01, 0.08)
    """

    hit: bool
    time: float
    point: NDArray[np.float64]
    normal: NDArray[np.float64]
    distance: float


@dataclass(frozen=True, kw_only=True, eq=False)
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

    Examples
    --------
    >>> still = np.zeros((2, engine.model.nv))
    >>> poses = np.tile(model.qpos0, (2, 1))
    >>> found = dashpot.times_of_impact(engine, "ball", "box", poses, still, horizon=1.0)
    >>> found.hit, found.time
    (array([False, False]), array([1., 1.]))
    """

    hit: NDArray[np.bool_]
    time: NDArray[np.float64]
    point: NDArray[np.float64]
    normal: NDArray[np.float64]
    distance: NDArray[np.float64]


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
    angular velocity in the world. A free body takes along all that is welded to it. Loads do not
    act. Conservative advancement: the time is never after the first contact, and the gap left at it
    is at most 1e-9 of the geoms' size. Geoms that pass each other with less clearance count as
    touching.

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
        No decision in 10,000 distances: the geoms hover about 1e-9 of their size apart. With a
        height field, none in 1,000,000 distances and parts of the way: it turns by hundreds of
        thousands of radians, or passes as many cells, near the field. The message names the geoms.

    Examples
    --------
    >>> flying = engine.make_data()  # the ball is 0.1 m above the floor
    >>> flying.qvel[2] = -2.0
    >>> mujoco.mj_forward(engine.model, flying)
    >>> found = dashpot.time_of_impact(engine, flying, "ball", "floor", horizon=1.0)
    >>> found.hit, round(found.time, 6)
    (True, 0.05)
    """
    model = arguments.model_of(engine)
    id1, id2 = arguments.geom_pair(model, data, geom1, geom2)
    hit, time, at, _ = _core.geom_time_of_impact(
        model._address, data._address, id1, id2, positive_number("horizon", horizon)
    )
    found = Distance._from_core(at)
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
        As in `distances`.

    Raises
    ------
    TypeError, ValueError
        As `time_of_impact` and `distances`; also a `qvel` of another shape or that is not finite,
        naming the index.
    RuntimeError
        As `time_of_impact`.

    Examples
    --------
    >>> speeds = np.zeros((3, engine.model.nv))
    >>> speeds[:, 2] = [-1.0, -2.0, 1.0]  # of the ball, which is 0.1 m above the floor
    >>> poses = np.tile(model.qpos0, (3, 1))
    >>> found = dashpot.times_of_impact(engine, "ball", "floor", poses, speeds, horizon=1.0)
    >>> found.hit, found.time.round(6)
    (array([ True,  True, False]), array([0.1 , 0.05, 1.  ]))
    """
    model = arguments.model_of(engine)
    id1, id2 = arguments.distinct_geoms(model, geom1, geom2)
    positions = arguments.vectors("qpos", qpos, "nq", model.nq)
    velocities = arguments.vectors("qvel", qvel, "nv", model.nv)
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
        positive_number("horizon", horizon),
        thread_count(nthread),
    )
    return TimesOfImpact(
        hit=hit.reshape(shape),
        time=time.reshape(shape),
        point=(0.5 * (point1 + point2)).reshape(*shape, 3),
        normal=normal.reshape(*shape, 3),
        distance=value.reshape(shape),
    )
