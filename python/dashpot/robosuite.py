"""robosuite's environments, stepped by dashpot."""

from __future__ import annotations

import importlib
import types
from collections.abc import Callable
from functools import cache
from typing import Any

import mujoco

from dashpot.engine import Engine
from dashpot.handover import engine_for
from dashpot.robosuite_calls import accept_calls_of_older_mujoco

__all__ = ["with_dashpot"]


def with_dashpot(
    env_class: type[Any] | str, *, make_engine: Callable[[mujoco.MjModel], Engine] = Engine
) -> type[Any]:
    """Derive an environment class whose steps are dashpot's.

    Robots, controllers, observations, rewards, rendering and resets stay the environment's. Its
    simulation ``env.sim`` holds the model and data of an engine, ``env.dashpot_engine``; a hard
    reset, which makes another simulation, makes another engine too. Controllers see the state at
    the start of each time step, as with ``mj_step1`` and ``mj_step2``. What they observe after it
    is that of its start, as there.

    ``sim.get_state()`` keeps contact memory (friction that sticks, springs that are compressed),
    and ``sim.set_state`` restores it. A state without any, such as a flattened one, begins as data
    just made do.

    robosuite knows the class by its name, too: ``"LiftWithDashpot"``.

    robosuite 1.5.2 calls functions of MuJoCo as they were before 3.10; from the first call of this
    function on they take such calls, in environments of plain robosuite as well.

    Parameters
    ----------
    env_class
        A class derived from robosuite's ``MujocoEnv``, or the name that robosuite knows it by.
    make_engine
        Makes the engine for the model of each simulation, with other options or with materials.

    Raises
    ------
    TypeError
        If ``env_class`` is no such class; when an environment is made, if ``make_engine`` returned
        no `Engine`.
    ValueError
        If robosuite knows no environment of that name.


    Examples
    --------
    >>> import dashpot.robosuite
    >>> without = {"has_renderer": False, "has_offscreen_renderer": False}
    >>> env = dashpot.robosuite.with_dashpot("Lift")("Panda", use_camera_obs=False, **without)
    >>> type(env).__name__
    'LiftWithDashpot'
    """
    if isinstance(env_class, str):
        env_class = _registered(env_class)
    if not isinstance(env_class, type) or not hasattr(env_class, "_initialize_sim"):
        raise TypeError(f"env_class is {env_class!r}, no class of robosuite's environments")
    accept_calls_of_older_mujoco()

    def _initialize_sim(self: Any, xml_string: str | None = None) -> None:
        super(derived, self)._initialize_sim(xml_string)
        self.dashpot_engine = _take_over(self.sim, make_engine)

    # robosuite registers a class by the name that it is made with.
    derived: type[Any] = types.new_class(
        f"{env_class.__name__}WithDashpot",
        (env_class,),
        exec_body=lambda names: names.update(
            __module__=__name__, __doc__=env_class.__doc__, _initialize_sim=_initialize_sim
        ),
    )
    return derived


def _registered(name: str) -> type[Any]:
    known: dict[str, type[Any]] = importlib.import_module("robosuite.environments").REGISTERED_ENVS
    if name not in known:
        raise ValueError(f"env_class is {name!r}; robosuite knows {', '.join(known)}")
    return known[name]


def _take_over(sim: Any, make_engine: Callable[[mujoco.MjModel], Engine]) -> Engine:
    """Let an engine step a simulation, of which robots and renderers may hold parts already."""
    engine, own = engine_for(sim.model._model, sim.data._data, make_engine)
    sim_class: Any = type(sim)
    sim.__class__ = _stepping(sim_class)
    sim.dashpot_engine = engine
    sim.users_userdata = sim.model._model.nuserdata
    sim.model._model = engine.model
    sim.data._data = own
    return engine


@cache
def _stepping(sim_class: Any) -> type[Any]:
    """Derive a class of simulations, robosuite's ``MjSim``, that an engine steps."""

    class WithDashpot(sim_class):  # type: ignore[misc]
        dashpot_engine: Engine
        users_userdata: int  # what lies behind it in the user data is contact memory

        def step(self, with_udd: bool = True) -> None:
            self.dashpot_engine.step(self.data._data)

        def step2(self) -> None:
            self.dashpot_engine.step(self.data._data)

        def get_state(self) -> Any:
            state = super().get_state()
            state.contact_memory = self.data.userdata[self.users_userdata :].copy()
            return state

        def set_state(self, value: Any) -> None:
            super().set_state(value)
            memory = getattr(value, "contact_memory", 0.0)
            self.data.userdata[self.users_userdata :] = memory

        def set_state_from_flattened(self, value: Any) -> None:
            super().set_state_from_flattened(value)
            self.data.userdata[self.users_userdata :] = 0.0

    WithDashpot.__name__ = WithDashpot.__qualname__ = f"{sim_class.__name__}WithDashpot"
    return WithDashpot
