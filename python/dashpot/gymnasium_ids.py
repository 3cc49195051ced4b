"""Ids of Gymnasium's registry for environments that dashpot steps."""

from __future__ import annotations

import copy
import importlib
from collections.abc import Callable
from typing import Any

import mujoco

from dashpot.engine import Engine
from dashpot.gymnasium import with_dashpot

__all__ = ["class_of_path", "register"]

# Gymnasium's own, but for those of versions that MuJoCo's bindings no longer step.
_OWN = "gymnasium.envs.mujoco"
_LEAST_VERSION = 4


def register(
    *ids: str,
    make_engine: Callable[[mujoco.MjModel], Engine] = Engine,
    namespace: str = "dashpot",
) -> tuple[str, ...]:
    """Register environments that dashpot steps, for ``gymnasium.make`` and ``make_vec``.

    ``"Ant-v5"`` becomes ``"dashpot/Ant-v5"``, with the same time limit, arguments and wrappers.
    An id that is registered already is registered anew.

    Parameters
    ----------
    *ids
        Ids of MuJoCo's environments, of gymnasium, gymnasium-robotics or others that
        `with_dashpot` takes. Without any: those of gymnasium itself, version 4 and later.
    make_engine
        Makes the engine for an environment's model, with other options or with materials. Without
        one, specifications can be written as JSON and workers can be spawned.
    namespace
        What comes before the slash; give one for each `make_engine`.

    Returns
    -------
    tuple of str
        The new ids, in the order of the given ones.

    Raises
    ------
    ImportError
        If gymnasium is not installed.
    gymnasium.error.Error
        If an id is unknown; gymnasium names near ones.
    ValueError
        If an id has no class of environments; nothing is registered then.

    Examples
    --------
    >>> import gymnasium
    >>> import dashpot.gymnasium
    >>> dashpot.gymnasium.register("Ant-v5")
    ('dashpot/Ant-v5',)
    >>> env = gymnasium.make("dashpot/Ant-v5")
    >>> env.spec.max_episode_steps
    1000
    >>> env.close()
    """
    try:
        import gymnasium
    except ModuleNotFoundError as error:
        raise ImportError(
            "dashpot.gymnasium.register needs gymnasium:  pip install gymnasium", name="gymnasium"
        ) from error
    registry: dict[str, Any] = gymnasium.registry
    if not ids:
        ids = tuple(name for name, spec in registry.items() if _is_own(spec))
    made = []
    for name in ids:
        spec = copy.copy(gymnasium.spec(name))
        spec.id = f"{namespace}/{spec.name}" + ("" if spec.version is None else f"-v{spec.version}")
        spec.entry_point = _entry_point(name, spec.entry_point, make_engine)
        spec.namespace, spec.vector_entry_point = namespace, None
        made.append(spec)
    for spec in made:
        registry[spec.id] = spec
    return tuple(spec.id for spec in made)


def class_of_path(path: str) -> type[Any]:
    """Return a class of environments that dashpot steps, by the path of theirs.

    ``"gymnasium.envs.mujoco.ant_v5.AntEnv"``. AttributeError where there is none.
    """
    module, _, name = path.rpartition(".")
    if not module:
        raise AttributeError(f"module 'dashpot.gymnasium' has no attribute {path!r}")
    try:
        found: type[Any] = with_dashpot(getattr(importlib.import_module(module), name))
    except (AttributeError, ModuleNotFoundError, TypeError) as error:
        raise AttributeError(f"module 'dashpot.gymnasium' has no attribute {path!r}") from error
    return found


def _is_own(spec: Any) -> bool:
    entry = spec.entry_point
    return (
        isinstance(entry, str)
        and entry.startswith(_OWN)
        and spec.namespace is None
        and (spec.version or 0) >= _LEAST_VERSION
    )


def _entry_point(name: str, entry: Any, make_engine: Callable[[mujoco.MjModel], Engine]) -> Any:
    """Return the entry point of what steps with dashpot: by path where that says all."""
    if isinstance(entry, str) and make_engine is Engine:
        return f"dashpot.gymnasium:{entry.replace(':', '.')}"
    if isinstance(entry, str):
        module, _, attribute = entry.partition(":")
        entry = getattr(importlib.import_module(module), attribute)
    if not isinstance(entry, type):
        raise ValueError(f"environment {name!r} is made by {entry!r}, which is no class")
    return with_dashpot(entry, make_engine=make_engine)
