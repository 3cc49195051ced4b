"""MyoSuite's environments, stepped by dashpot."""

from __future__ import annotations

import copy
import importlib
from collections.abc import Callable
from typing import Any

import mujoco

from dashpot.engine import Engine
from dashpot.handover import engine_for, refer_to

__all__ = ["make", "with_dashpot"]


def make(
    env_id: str, *, make_engine: Callable[[mujoco.MjModel], Engine] = Engine, **kwargs: Any
) -> Any:
    """Make one of MyoSuite's environments that dashpot steps, as ``gymnasium.make`` does.

    Parameters
    ----------
    env_id
        As of ``gymnasium.make``; myosuite is imported, which registers its own.
    make_engine
        As of `with_dashpot`.
    kwargs
        What else ``gymnasium.make`` takes.

    Examples
    --------
    >>> import dashpot.myosuite
    >>> env = dashpot.myosuite.make("myoHandPenTwirlRandom-v0")
    >>> type(env.unwrapped.dashpot_engine).__name__
    'Engine'
    """
    importlib.import_module("myosuite")
    registration = importlib.import_module("gymnasium.envs.registration")
    spec = copy.deepcopy(registration.spec(env_id))
    creator = spec.entry_point
    if isinstance(creator, str):
        creator = registration.load_env_creator(creator)
    spec.entry_point = with_dashpot(creator, make_engine=make_engine)
    return registration.make(spec, **kwargs)


def with_dashpot(
    env_class: type[Any], *, make_engine: Callable[[mujoco.MjModel], Engine] = Engine
) -> type[Any]:
    """Derive an environment class whose steps are dashpot's.

    Muscles, observations, rewards, rendering and resets stay the environment's; its ``model`` and
    ``data`` are those of an engine, ``dashpot_engine``. What MuJoCo computes of a state is, after a
    step, that of the new state, as MyoSuite has it. Contacts and the sensors of forces are those of
    the last time step.

    Parameters
    ----------
    env_class
        A class derived from MyoSuite 3's ``MyoGymnasiumEnv``.
    make_engine
        Makes the engine for an environment's model, with other options or with materials.

    Raises
    ------
    TypeError
        If ``env_class`` is no such class; when an environment is made, if ``make_engine`` returned
        no `Engine`.


    Examples
    --------
    >>> import gymnasium, dashpot.myosuite
    >>> plain = gymnasium.make("myoHandPenTwirlRandom-v0").unwrapped
    >>> with_dashpot = dashpot.myosuite.with_dashpot(type(plain))
    """
    if not isinstance(env_class, type) or not hasattr(env_class, "_step_physics"):
        raise TypeError(f"env_class is {env_class!r}, no class of MyoSuite's environments")

    class WithDashpot(env_class):  # type: ignore[misc]
        dashpot_engine: Engine | None = None
        model: Any
        data: Any

        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, **kwargs)
            _take_over(self, make_engine)

        def _step_physics(self, nstep: int | None = None) -> None:
            engine = _take_over(self, make_engine)  # a reset may choose another model
            engine.step(self.data, nstep=self.frame_skip if nstep is None else nstep)
            # As mj_forward, but for the forces, which would be those of MuJoCo's contacts.
            mujoco.mj_step1(self.model, self.data)
            mujoco.mj_fwdActuation(self.model, self.data)

    WithDashpot.__name__ = WithDashpot.__qualname__ = f"{env_class.__name__}WithDashpot"
    WithDashpot.__doc__ = env_class.__doc__
    return WithDashpot


def _take_over(env: Any, make_engine: Callable[[mujoco.MjModel], Engine]) -> Engine:
    """Return the engine of the model that an environment has now."""
    model, data = env.model, env.data
    if env.dashpot_engine is not None and env.dashpot_engine.model is model:
        return env.dashpot_engine  # type: ignore[no-any-return]
    engine, own = engine_for(model, data, make_engine)
    env.dashpot_engine = engine
    # The environment refers to model and data, and so does what it reads and renders them with.
    refer_to((env, *vars(env).values()), engine, own, model=model, data=data)
    return engine
