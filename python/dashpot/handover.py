"""What a simulation that another library made goes over to an engine with."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import mujoco
import numpy as np

from dashpot.engine import Engine

# All that a step goes on from but user data, of which dashpot's data have more.
_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION) & ~int(mujoco.mjtState.mjSTATE_USERDATA)


def engine_for(
    model: mujoco.MjModel, data: mujoco.MjData, make_engine: Callable[[mujoco.MjModel], Engine]
) -> tuple[Engine, mujoco.MjData]:
    """Make an engine for a model, and data of its own in the same state."""
    engine = make_engine(model)
    if not isinstance(engine, Engine):
        raise TypeError(f"make_engine returned {type(engine).__name__}; it must be Engine")
    own = engine.make_data()
    _copy_state(model, data, engine.model, own)
    return engine, own


def refer_to(
    holders: Iterable[Any],
    engine: Engine,
    own: mujoco.MjData,
    *,
    model: mujoco.MjModel,
    data: mujoco.MjData,
) -> None:
    """Let attributes of objects that are `model` and `data` be those of an engine."""
    for holder in holders:
        for name, value in list(getattr(holder, "__dict__", {}).items()):
            if value is model:
                setattr(holder, name, engine.model)
            elif value is data:
                setattr(holder, name, own)


def _copy_state(
    model: mujoco.MjModel, data: mujoco.MjData, own_model: mujoco.MjModel, own: mujoco.MjData
) -> None:
    """Copy what the data of an environment hold to those of its engine."""
    state = np.empty(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, data, state, _STATE)
    mujoco.mj_setState(own_model, own, state, _STATE)
    own.userdata[: model.nuserdata] = data.userdata
    mujoco.mj_forward(own_model, own)
