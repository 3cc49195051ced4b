"""Gymnasium's MuJoCo environments, stepped by dashpot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import mujoco
import numpy as np

from dashpot.engine import Engine

Environment = TypeVar("Environment")

# What an environment's class must have: how it makes the simulation, and how it steps it, by the
# family that it is of.
_MAKES = "_initialize_simulation"
_STEPS = {"gymnasium": "_step_mujoco_simulation", "gymnasium-robotics": "_mujoco_step"}

# All that a step goes on from but user data, of which dashpot's data have more.
_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION) & ~int(mujoco.mjtState.mjSTATE_USERDATA)


def with_dashpot(
    env_class: type[Environment], *, make_engine: Callable[[mujoco.MjModel], Engine] = Engine
) -> type[Environment]:
    """Derive an environment class whose steps are dashpot's.

    Observations, rewards, rendering and resets stay the environment's; its ``model`` and ``data``
    are those of an engine, ``dashpot_engine``. What MuJoCo computes of a state (poses of bodies,
    sensors) is, after a step, that of the last time step's start, as after ``mj_step``; but with
    ``RK4`` ``mj_step`` leaves that of its last stage, which is almost the end. Where an environment
    calls ``mj_step`` by itself, as some of gymnasium-robotics do in a reset to let things settle,
    it is MuJoCo that steps::

        from gymnasium.envs.mujoco.ant_v5 import AntEnv

        env = dashpot.gymnasium.with_dashpot(AntEnv)(render_mode="rgb_array")

    Parameters
    ----------
    env_class
        A class derived from ``gymnasium.envs.mujoco.MujocoEnv`` or from gymnasium-robotics'
        ``MujocoRobotEnv``.
    make_engine
        Makes the engine for an environment's model, with other options or with materials.

    Raises
    ------
    TypeError
        If ``env_class`` is of neither family; when an environment is made, if ``make_engine``
        returned no `Engine`.

    """
    missing = f"env_class is {env_class!r}, no class of MuJoCo environments: it has no method "
    if not isinstance(env_class, type) or not hasattr(env_class, _MAKES):
        raise TypeError(missing + _MAKES)
    if not any(hasattr(env_class, name) for name in _STEPS.values()):
        raise TypeError(missing + " or ".join(_STEPS.values()))

    class WithDashpot(env_class):  # type: ignore[misc, valid-type]
        dashpot_engine: Engine
        model: Any
        data: Any

        def _initialize_simulation(self) -> Any:
            made = super()._initialize_simulation()
            model, data = (self.model, self.data) if made is None else made
            engine = make_engine(model)
            if not isinstance(engine, Engine):
                raise TypeError(f"make_engine returned {type(engine).__name__}; it must be Engine")
            self.dashpot_engine = engine
            self.model, self.data = engine.model, engine.make_data()
            _copy_state(model, data, self.model, self.data)
            return None if made is None else (self.model, self.data)

        def _step_mujoco_simulation(self, ctrl: Any, n_frames: int) -> None:
            self.data.ctrl[:] = ctrl
            self.dashpot_engine.step(self.data, nstep=n_frames)
            # As gymnasium does: environments observe the forces on bodies.
            mujoco.mj_rnePostConstraint(self.model, self.data)

        def _mujoco_step(self, action: Any) -> None:
            self.dashpot_engine.step(self.data, nstep=self.n_substeps)

        def __reduce__(self) -> tuple[Any, ...]:
            # The class has no name that a pickle could find it by.
            get_state = getattr(self, "__getstate__", lambda: self.__dict__)
            return _make_empty, (env_class, make_engine), get_state()

    WithDashpot.__name__ = WithDashpot.__qualname__ = f"{env_class.__name__}WithDashpot"
    WithDashpot.__doc__ = env_class.__doc__
    return WithDashpot


def _make_empty(env_class: type[Any], make_engine: Callable[[mujoco.MjModel], Engine]) -> Any:
    """Make an environment whose state is yet to be set, as pickles do."""
    derived = with_dashpot(env_class, make_engine=make_engine)
    return object.__new__(derived)


def _copy_state(
    model: mujoco.MjModel, data: mujoco.MjData, own_model: mujoco.MjModel, own: mujoco.MjData
) -> None:
    """Copy what the data of an environment hold to those of its engine."""
    state = np.empty(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, data, state, _STATE)
    mujoco.mj_setState(own_model, own, state, _STATE)
    own.userdata[: model.nuserdata] = data.userdata
    mujoco.mj_forward(own_model, own)
