"""dm_control's environments, stepped by dashpot."""

from __future__ import annotations

import copy
import weakref
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import mujoco
import numpy as np
from absl import logging
from dm_control.mujoco import Physics
from dm_control.mujoco.wrapper import MjData
from dm_control.rl.control import PhysicsError

from dashpot.engine import Engine
from dashpot.handover import engine_for

Environment = TypeVar("Environment")

# Composer's environments make new physics by this method; all environments keep theirs here.
_MAKES = "_recompile_physics"
_KEEPS = "_physics"


def with_dashpot(
    env: Environment, *, make_engine: Callable[[mujoco.MjModel], Engine] = Engine
) -> Environment:
    """Let the steps of an environment, or of its physics, be dashpot's, and return it.

    Observations, rewards, rendering and resets stay the environment's. ``env.physics.model`` and
    ``env.physics.data`` are those of an engine, ``env.physics.dashpot_engine``. Episodes begin as
    without dashpot, and go on from where they are. Composer's environments begin another one. They
    compile their model anew for each episode (or for the first), and their entities keep what they
    found in it. Copies and pickles of the physics have an engine of their own, or share it with the
    model. Arrays, bindings and ``physics.named`` that were taken before are of the old data and
    show no step.

    After ``physics.step`` all that MuJoCo computes from positions and velocities (poses, distances,
    sensors of both) is that of the step's end, as in dm_control with ``legacy_step``, which is the
    default. Without that it is that of the last time step's start, as after ``mj_step``. What has
    to do with forces is that of the last time step either way: accelerations, sensors of force and
    touch, and the contacts in ``physics.data.contact``. ``physics.data.contact_force`` gives their
    mean forces over it. A state that diverges, and what else a step refuses, is dm_control's
    ``PhysicsError``, and leaves the state from before.

    Parameters
    ----------
    env
        An environment of ``dm_control.suite``, ``manipulation``, ``locomotion``, of another task
        for ``control.Environment`` or ``composer.Environment``, or what holds one in an attribute,
        such as wrappers do; or a ``dm_control.mujoco.Physics``.
    make_engine
        Makes the engine for a model, with other options or with materials.

    Raises
    ------
    TypeError
        If ``env`` neither is nor holds one of those, or holds several, or if ``make_engine``
        returned no `Engine`.
    ValueError
        If dashpot steps ``env`` already, or refuses its model; the message names the feature.


    Examples
    --------
    >>> from dm_control import suite
    >>> import dashpot.dm_control
    >>> env = dashpot.dm_control.with_dashpot(suite.load("walker", "run"))
    >>> first = env.reset()
    >>> env.step(np.zeros(6)).reward is None
    False
    """
    found = list(environments_in(env))
    if len(found) != 1:
        raise TypeError(f"env is {env!r}, in which {len(found)} of dm_control's are found, not one")
    inner = found[0]
    if isinstance(inner, weakref.ProxyType):
        raise TypeError("env is physics that its environment makes anew: give the environment")
    physics = inner if isinstance(inner, Physics) else getattr(inner, _KEEPS)
    _go_over(physics, make_engine)
    if hasattr(inner, _MAKES):
        inner.__class__ = _compiling(type(inner), make_engine)
        inner._mjcf_never_compiled = inner._reset_next_step = True
    return env


def environments_in(holder: Any) -> Iterator[Any]:
    """Find the environments, or physics of none, that something is or holds in attributes."""
    yield from {id(found): found for found in _search(holder, set())}.values()


def _search(holder: Any, seen: set[int]) -> Iterator[Any]:
    attributes = _attributes(holder)
    if isinstance(holder, Physics) or isinstance(attributes.get(_KEEPS), Physics):
        yield holder
    elif id(holder) not in seen:
        seen.add(id(holder))
        for value in attributes.values():
            if hasattr(value, "reset") and hasattr(value, "step"):
                yield from _search(value, seen)


def _attributes(holder: Any) -> dict[str, Any]:
    """Return the attributes of an object by name, those in slots too, as of some wrappers."""
    slots = [name for kind in type(holder).__mro__ for name in getattr(kind, "__slots__", ())]
    found = {name: getattr(holder, name) for name in slots if hasattr(holder, name)}
    return found | getattr(holder, "__dict__", {})


class EngineData(MjData):  # type: ignore[misc]
    """dm_control's wrapper of data, with the engine that they are of."""

    # Its metaclass takes what is not set in a class from mujoco.MjData.
    model, contact = MjData.model, MjData.contact

    def __init__(self, engine: Engine, data: mujoco.MjData):
        super().__init__(data)
        self.dashpot_engine = engine

    def contact_force(self, contact_id: int) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return force (N) and torque (N m) of a contact in its frame, normal first, (2, 3).

        They are means over the last time step; after ``physics.forward`` they are MuJoCo's own.
        """
        if not 0 <= contact_id < self.ncon:
            raise ValueError(f"contact_id is {contact_id}; it must be in 0 to {self.ncon - 1}")
        wrench = np.empty(6)
        mujoco.mj_contactForce(self.dashpot_engine.model, self.ptr, contact_id, wrench)
        return wrench.reshape(2, 3)

    def _make_copy(self, share_model: bool) -> EngineData:
        engine = self.dashpot_engine if share_model else copy.copy(self.dashpot_engine)
        data = engine.make_data()
        mujoco.mj_copyData(data, engine.model, self.ptr)
        return EngineData(engine, data)

    def __getstate__(self) -> tuple[Engine, np.ndarray[Any, np.dtype[np.float64]]]:
        model = self.dashpot_engine.model
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, self.ptr, state, kind)
        return self.dashpot_engine, state

    def __setstate__(self, kept: tuple[Engine, np.ndarray[Any, np.dtype[np.float64]]]) -> None:
        engine, state = kept
        data = engine.make_data()
        mujoco.mj_setState(engine.model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_forward(engine.model, data)
        EngineData.__init__(self, engine, data)


class SteppedPhysics(Physics):  # type: ignore[misc]
    """What physics of any class are made to be, besides, where dashpot steps them."""

    physics_class: type[Any]
    make_engine: Callable[[mujoco.MjModel], Engine]

    @property
    def dashpot_engine(self) -> Engine:
        """The engine that steps; another one after the model was loaded anew."""
        return self.data.dashpot_engine  # type: ignore[no-any-return]

    def step(self, nstep: int = 1) -> None:
        """Advance by `nstep` time steps."""
        model, data = self.model.ptr, self.data.ptr
        with self.check_invalid_state():
            try:
                self.dashpot_engine.step(data, nstep=nstep)
            except (RuntimeError, ValueError) as error:
                if self._warnings_cause_exception:
                    raise PhysicsError(str(error)) from error
                logging.warning(error)
                return
            if self.legacy_step:
                _compute_positions_and_velocities(model, data)

    def _reload_from_data(self, data: MjData) -> None:
        super()._reload_from_data(_engine_data(data, type(self).make_engine))

    def __reduce__(self) -> tuple[Any, ...]:
        # Its class has no name that it could be found by.
        derived = type(self)
        return _make_empty, (derived.physics_class, derived.make_engine), self.__getstate__()


def _compute_positions_and_velocities(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Compute as ``mj_step1`` does, but keep the contacts of the last step, and their forces."""
    mujoco.mj_fwdKinematics(model, data)
    mujoco.mj_makeM(model, data)
    mujoco.mj_factorM(model, data)
    mujoco.mj_transmission(model, data)
    mujoco.mj_sensorPos(model, data)
    mujoco.mj_fwdVelocity(model, data)
    mujoco.mj_sensorVel(model, data)
    if model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_ENERGY:
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)


def _engine_data(data: MjData, make_engine: Callable[[mujoco.MjModel], Engine]) -> EngineData:
    if isinstance(data, EngineData):
        return data
    return EngineData(*engine_for(data.model.ptr, data.ptr, make_engine))


def _go_over(physics: Physics, make_engine: Callable[[mujoco.MjModel], Engine]) -> None:
    """Let physics be stepped by an engine, from the state that they have."""
    if isinstance(physics, SteppedPhysics):
        raise ValueError("env is stepped by dashpot already")
    data = _engine_data(physics.data, make_engine)
    physics.__class__ = _stepped(type(physics), make_engine)
    physics._reload_from_data(data)


def _stepped(
    physics_class: type[Any], make_engine: Callable[[mujoco.MjModel], Engine]
) -> type[Any]:
    """Derive a class of physics, whose own methods come before those that step."""
    bases = (physics_class, SteppedPhysics) if physics_class is not Physics else (SteppedPhysics,)
    attributes = {
        "physics_class": physics_class,
        "make_engine": staticmethod(make_engine),
        "__doc__": physics_class.__doc__,
        "__module__": physics_class.__module__,
    }
    return type(f"{physics_class.__name__}WithDashpot", bases, attributes)


def _make_empty(
    physics_class: type[Any], make_engine: Callable[[mujoco.MjModel], Engine]
) -> SteppedPhysics:
    """Make physics whose state is yet to be set, as pickles do."""
    derived: Any = _stepped(physics_class, make_engine)
    return derived.__new__(derived)  # type: ignore[no-any-return]


def _compiling(env_class: type[Any], make_engine: Callable[[mujoco.MjModel], Engine]) -> type[Any]:
    """Derive a class of environments that compile their model anew."""

    class WithDashpot(env_class):  # type: ignore[misc]
        def _recompile_physics(self) -> None:
            super()._recompile_physics()
            _go_over(self._physics, make_engine)

    WithDashpot.__name__ = WithDashpot.__qualname__ = f"{env_class.__name__}WithDashpot"
    WithDashpot.__doc__ = env_class.__doc__
    return WithDashpot
