"""Edits of a model that engines were made of, which act on none of them.

An engine steps a copy of its model. Whoever edits the model instead of the copy is told so in one
of the next steps, unless a later engine was made of the edited model.
"""

from __future__ import annotations

import warnings
import weakref

import mujoco
import numpy as np

__all__ = ["Original", "original_of"]

_OPTIONS = ("timestep", "gravity", "wind", "density", "viscosity", "integrator")
_ARRAYS = (
    "qpos0",
    "qpos_spring",
    "body_pos",
    "body_quat",
    "body_ipos",
    "body_mass",
    "body_inertia",
    "body_gravcomp",
    "jnt_range",
    "jnt_stiffness",
    "dof_armature",
    "dof_damping",
    "dof_frictionloss",
    "geom_size",
    "geom_pos",
    "geom_quat",
    "geom_friction",
    "geom_condim",
    "geom_margin",
    "geom_solref",
    "geom_solimp",
    "pair_friction",
    "eq_data",
    "tendon_stiffness",
    "tendon_damping",
    "actuator_gainprm",
    "actuator_biasprm",
    "actuator_ctrlrange",
    "actuator_forcerange",
)


class Original:
    """A model as it was when the last engine was made of it."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = weakref.ref(model)
        self._state: dict[str, int] = {}

    def take(self) -> tuple[str, ...]:
        """Keep what the model is now, and return the names of what has changed since."""
        model = self._model()
        if model is None:
            return ()
        before, self._state = self._state, _state_of(model)
        return tuple(name for name in before if before[name] != self._state[name])

    def warn_of_edits(self) -> None:
        """Warn the caller of the caller of edits that no engine has, of each once."""
        edited = self.take()
        if edited:
            more = f" and {len(edited) - 1} more" if len(edited) > 1 else ""
            name = edited[0]
            warnings.warn(
                f"model.{name}{more} changed after an engine was made of the model; the engine "
                f"steps a copy and does not see it: edit engine.model.{name}",
                stacklevel=3,
            )


def original_of(model: mujoco.MjModel, private: mujoco.MjModel) -> Original | None:
    """Return what tells edits of a `model`, of which an engine has the copy `private`.

    None where the model is itself an engine's: it is edited for that engine.
    """
    _private.add(private)
    if model in _private:
        return None
    original = _originals.setdefault(model, Original(model))
    original.take()
    return original


_originals: weakref.WeakKeyDictionary[mujoco.MjModel, Original] = weakref.WeakKeyDictionary()
_private: weakref.WeakSet[mujoco.MjModel] = weakref.WeakSet()


def _state_of(model: mujoco.MjModel) -> dict[str, int]:
    """Return a hash of each option and array that engines step by."""
    values = {f"opt.{name}": getattr(model.opt, name) for name in _OPTIONS}
    values |= {name: getattr(model, name) for name in _ARRAYS}
    return {name: hash(np.asarray(value).tobytes()) for name, value in values.items()}
