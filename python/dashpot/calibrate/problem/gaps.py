"""Which geoms' gap tells the events and scalars of a trajectory."""

from __future__ import annotations

import mujoco

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.observables import body_id
from dashpot.object_ids import object_id

_MOST_PAIRS = 256


def check_kinds(trajectory: Trajectory, model: mujoco.MjModel) -> None:
    """Raise ValueError where events or scalars of a trajectory are of an unknown kind."""
    label = f"trajectory '{trajectory.name}'"
    of = set()
    for name in trajectory.events:
        kind, _, geoms = name.partition(":")
        if kind != "impact" or (geoms and geoms.count(",") != 1):
            raise ValueError(
                f"{label}: unknown event {name!r}; known: 'impact', 'impact:GEOM1,GEOM2'"
            )
        of.add(tuple(gap_geoms(model, trajectory, name)))
    if len(of) > 1:
        raise ValueError(
            f"{label}: events of one trajectory must be of the same geoms, got "
            f"{', '.join(trajectory.events)}"
        )
    for name in trajectory.scalars:
        kind, _, sensor = name.partition(":")
        if name != "apex_height" and not (kind == "peak" and sensor):
            raise ValueError(
                f"{label}: unknown scalar {name!r}; known: 'apex_height', 'peak:SENSOR'"
            )
        if name == "apex_height":
            if len(trajectory.bodies) != 1:
                raise ValueError(
                    f"{label}: apex_height is of one observed body, got {trajectory.bodies}"
                )
            of.add(tuple(gap_geoms(model, trajectory, name)))
    if any(not pairs for pairs in of):
        raise ValueError(f"{label}: nothing can touch the geoms whose impacts are observed")


def gap_geoms(model: mujoco.MjModel, trajectory: Trajectory, channel: str) -> list[tuple[int, int]]:
    """Return the pairs of geoms whose gap a channel needs; none where it needs no gap.

    Raises
    ------
    ValueError
        Where a geom is not there, or the pairs are too many to follow.
    """
    kind, _, names = channel.partition(":")
    if kind == "apex_height" or (kind == "impact" and not names):
        given = [key for key in trajectory.events if key.startswith("impact:")]
        if kind == "apex_height" and given:
            return gap_geoms(model, trajectory, given[0])
        return _touching(model, trajectory)
    if kind != "impact":
        return []
    first, second = (
        object_id(model, name.strip(), "geom", f"event {channel!r}") for name in names.split(",")
    )
    return [(first, second)]


def _touching(model: mujoco.MjModel, trajectory: Trajectory) -> list[tuple[int, int]]:
    """Return the pairs of a geom of the observed bodies and one that it can collide with."""
    label = f"trajectory '{trajectory.name}'"
    own = {body_id(model, body, label) for body in trajectory.bodies}
    pairs = [
        (a, b)
        for a in range(model.ngeom)
        for b in range(model.ngeom)
        if _is_own(model, a, own)
        and (not _is_own(model, b, own) or a < b)
        and model.geom_bodyid[a] != model.geom_bodyid[b]
        and _collide(model, a, b)
    ]
    if len(pairs) > _MOST_PAIRS:
        raise ValueError(
            f"{label}: {len(pairs)} pairs of geoms could make its impacts; name the two: "
            "'impact:GEOM1,GEOM2'"
        )
    return pairs


def _is_own(model: mujoco.MjModel, geom: int, own: set[int]) -> bool:
    """Whether a geom is of an observed body or, where there is none, of one that moves."""
    body = int(model.geom_bodyid[geom])
    return body in own if own else int(model.body_weldid[body]) != 0


def _collide(model: mujoco.MjModel, a: int, b: int) -> bool:
    types, affinities = model.geom_contype, model.geom_conaffinity
    return bool(types[a] & affinities[b]) or bool(types[b] & affinities[a])
