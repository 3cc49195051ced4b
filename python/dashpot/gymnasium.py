"""Gymnasium's MuJoCo environments, stepped by dashpot."""

from __future__ import annotations

import copyreg
import sys
from collections.abc import Callable, Hashable
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

import mujoco

from dashpot.engine import Engine
from dashpot.handover import engine_for, refer_to

if TYPE_CHECKING:
    from dashpot.gymnasium_ids import register

__all__ = ["register", "with_dashpot"]

Environment = TypeVar("Environment")

# What the class of an environment that steps a simulation of its own has: how it makes the
# simulation, and how it steps it, by the family that it is of.
_MAKES = "_initialize_simulation"
_STEPS = {"gymnasium": "_step_mujoco_simulation", "gymnasium-robotics": "_mujoco_step"}
# MetaWorld's, which writes all numbers of a weld.
_WELDS = "reset_mocap_welds"


def with_dashpot(
    env_class: type[Environment], *, make_engine: Callable[[mujoco.MjModel], Engine] = Engine
) -> type[Environment]:
    """Derive an environment class whose steps are dashpot's; `register` does it for ids.

    Observations, rewards, rendering and resets stay the environment's; its ``model`` and ``data``
    are those of an engine, ``dashpot_engine``. What MuJoCo computes of a state (poses of bodies,
    sensors) is, after a step, that of the last time step's start, as after ``mj_step``. With
    ``RK4`` ``mj_step`` leaves that of its last stage, which is almost the end. Where an environment
    calls ``mj_step`` by itself, as some of gymnasium-robotics do in a reset to let things settle,
    it is MuJoCo that steps.

    An environment that steps another one that it holds, as gymnasium-robotics' kitchen and mazes
    do, is made as it is. Then the one that it holds goes over to the engine. So does one of
    dm_control's, as gym-aloha's environments hold (see `dashpot.dm_control`). Ids and names that it
    kept of the model stay right; views of arrays of the data that it kept would be of the old data
    and show no step.

    MetaWorld's tasks are environments of gymnasium's. Its release 3.1.1 is of MuJoCo 3.3 and writes
    equalities without the number that they have had more since; here that number stays as it is.
    What makes environments by itself takes the class from a table, as ``gym.make`` does of
    MetaWorld's from ``metaworld.env_dict.ALL_V3_ENVIRONMENTS``: put the derived class there.

    Parameters
    ----------
    env_class
        A class derived from ``gymnasium.envs.mujoco.MujocoEnv`` or from gymnasium-robotics'
        ``MujocoRobotEnv``, or whose environments hold one of such a class, or one of dm_control's,
        in an attribute, wrapped or not.
    make_engine
        Makes the engine for an environment's model, with other options or with materials.

    Raises
    ------
    TypeError
        If ``env_class`` is no class of environments; when an environment is made, if it neither is
        nor holds one of those, or holds several, or if ``make_engine`` returned no `Engine`.


    Examples
    --------
    >>> from gymnasium.envs.mujoco.ant_v5 import AntEnv
    >>> import dashpot.gymnasium
    >>> env = dashpot.gymnasium.with_dashpot(AntEnv)()
    >>> observation, _ = env.reset(seed=1)
    >>> observation, reward, *_ = env.step(env.action_space.sample())
    >>> env.dashpot_engine.model is env.unwrapped.model
    True
    """
    if not isinstance(env_class, type) or not (
        _steps_its_own(env_class) or all(hasattr(env_class, name) for name in ("reset", "step"))
    ):
        raise TypeError(f"env_class is {env_class!r}, no class of environments")
    given: Any = env_class
    derive = _derived if isinstance(make_engine, Hashable) else _derive
    derived: type[Environment] = derive(given, make_engine)
    return derived


def _derive(env_class: type[Any], make_engine: Callable[[mujoco.MjModel], Engine]) -> type[Any]:
    derive = _stepping if _steps_its_own(env_class) else _holding
    name = f"{env_class.__name__}WithDashpot"
    members = {
        "__doc__": env_class.__doc__,
        "__module__": __name__,
        "__qualname__": name,
        "dashpot_derived_from": (env_class, make_engine),
    }
    metaclass: Any = type(env_class)
    return _picklable(metaclass)(name, (derive(env_class, make_engine),), members)


@cache
def _derived(env_class: type[Any], make_engine: Callable[[mujoco.MjModel], Engine]) -> type[Any]:
    """Derive a class once: what it is pickled by leads back to it."""
    return _derive(env_class, make_engine)


@cache
def _picklable(metaclass: type[type]) -> Callable[..., type[Any]]:
    """Derive the metaclass of classes that are pickled by what they are derived from."""
    derived = type("WithDashpot", (metaclass,), {})
    copyreg.pickle(derived, lambda env_class: (_derived, env_class.dashpot_derived_from))
    return derived


def _stepping(env_class: type[Any], make_engine: Callable[[mujoco.MjModel], Engine]) -> type[Any]:
    """Derive a class of environments that step their own simulation."""

    class WithDashpot(env_class):  # type: ignore[misc]
        dashpot_engine: Engine
        model: Any
        data: Any

        def _initialize_simulation(self) -> Any:
            made = super()._initialize_simulation()
            model, data = (self.model, self.data) if made is None else made
            self.dashpot_engine, self.data = engine_for(model, data, make_engine)
            self.model = self.dashpot_engine.model
            return None if made is None else (self.model, self.data)

        def _step_mujoco_simulation(self, ctrl: Any, n_frames: int) -> None:
            self.data.ctrl[:] = ctrl
            self.dashpot_engine.step(self.data, nstep=n_frames)
            # As gymnasium does: environments observe the forces on bodies.
            mujoco.mj_rnePostConstraint(self.model, self.data)

        def _mujoco_step(self, action: Any) -> None:
            self.dashpot_engine.step(self.data, nstep=self.n_substeps)

        def __reduce__(self) -> tuple[Any, ...]:
            return _reduced(self, env_class, make_engine)

    if hasattr(env_class, _WELDS):
        setattr(WithDashpot, _WELDS, _resetting_welds(getattr(env_class, _WELDS)))
    return WithDashpot


class _OlderModel:
    """A model whose equalities have the 11 numbers that MuJoCo 3.3 gave them."""

    def __init__(self, model: mujoco.MjModel):
        self._model = model

    @property
    def eq_data(self) -> Any:
        return self._model.eq_data[:, :11]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._model, name)


def _resetting_welds(reset: Callable[[Any], None]) -> Callable[[Any], None]:
    """Return MetaWorld's method that resets mocap welds, for a model of today's."""

    def reset_mocap_welds(self: Any) -> None:
        model = self.model
        self.model = _OlderModel(model)
        try:
            reset(self)
        finally:
            self.model = model

    return reset_mocap_welds


def _holding(env_class: type[Any], make_engine: Callable[[mujoco.MjModel], Engine]) -> type[Any]:
    """Derive a class of environments that hold the one whose simulation they step."""

    class WithDashpot(env_class):  # type: ignore[misc]
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, **kwargs)
            self._dashpot_steps = _go_over(self, env_class, make_engine)

        @property
        def dashpot_engine(self) -> Engine:
            stepped = self._dashpot_steps
            return getattr(stepped, "physics", stepped).dashpot_engine  # type: ignore[no-any-return]

        def __reduce__(self) -> tuple[Any, ...]:
            return _reduced(self, env_class, make_engine)

    return WithDashpot


def _steps_its_own(env_class: type[Any]) -> bool:
    steps = any(hasattr(env_class, name) for name in _STEPS.values())
    return hasattr(env_class, _MAKES) and steps


def _go_over(
    env: Any, env_class: type[Any], make_engine: Callable[[mujoco.MjModel], Engine]
) -> Any:
    """Let what `env` holds be stepped by an engine, from the state that it has, and return it."""
    inside = {id(inner): inner for inner in map(_unwrapped, vars(env).values())}
    held = [inner for inner in inside.values() if _steps_its_own(type(inner))]
    if not held and "dm_control" in sys.modules:
        from dashpot import dm_control

        held = list(dm_control.environments_in(env))
        if len(held) == 1:
            dm_control.with_dashpot(held[0], make_engine=make_engine)
            return held[0]
    if len(held) != 1:
        raise TypeError(
            f"env_class is {env_class!r}: its environments are none of MuJoCo's, and they hold "
            f"{len(held)} of those, not one"
        )
    inner = held[0]
    model, data = inner.model, inner.data
    engine, own = engine_for(model, data, make_engine)
    inner.__class__ = with_dashpot(type(inner), make_engine=make_engine)
    inner.dashpot_engine = engine
    # The environments themselves refer to model and data, and so does what they render with.
    refer_to((env, inner, *vars(inner).values()), engine, own, model=model, data=data)
    return inner


def _unwrapped(held: Any) -> Any:
    """Return the environment in wrappers, anything else as it is."""
    return getattr(held, "unwrapped", held)


def _reduced(
    env: Any, env_class: type[Any], make_engine: Callable[[mujoco.MjModel], Engine]
) -> tuple[Any, ...]:
    """Return what an environment is pickled by: its class has no name that it could be found by."""
    get_state = getattr(env, "__getstate__", lambda: env.__dict__)
    return _make_empty, (env_class, make_engine), get_state()


def _make_empty(env_class: type[Any], make_engine: Callable[[mujoco.MjModel], Engine]) -> Any:
    """Make an environment whose state is yet to be set, as pickles do."""
    derived = with_dashpot(env_class, make_engine=make_engine)
    return object.__new__(derived)


def __getattr__(name: str) -> Any:
    """Return `register`, and classes by the paths of those that they are derived from."""
    from dashpot import gymnasium_ids

    return gymnasium_ids.register if name == "register" else gymnasium_ids.class_of_path(name)
