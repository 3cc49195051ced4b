"""Systems with values of parameters put in: copies, or built anew."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import mujoco
import numpy as np

from dashpot.calibrate.problem.setters import (
    MaterialSetter,
    ModelSetter,
    PairSetter,
    System,
    model_of,
)
from dashpot.calibrate.problem.vectors import Joint, vectors_of
from dashpot.engine import Engine

if TYPE_CHECKING:
    from dashpot.calibrate.problem.parameters import Parameter

Builder: TypeAlias = Callable[[Mapping[str, Any]], System]


def own_system(system: System | Builder, values: Mapping[str, Any]) -> System:
    """Return a copy of the system, or a new one, before any parameter is put in."""
    if isinstance(system, mujoco.MjModel | Engine):
        return copy.copy(system)
    if not callable(system):
        raise TypeError(
            "system must be a dashpot.Engine, a mujoco.MjModel or a function that returns "
            f"one, got {type(system).__name__}"
        )
    built = system(dict(values))
    if not isinstance(built, mujoco.MjModel | Engine):
        raise TypeError(
            "the function that builds the system must return a dashpot.Engine or a "
            f"mujoco.MjModel, got {type(built).__name__}"
        )
    return built


def put_in(system: System, parameters: Sequence[Parameter], values: Mapping[str, float]) -> None:
    """Set the values of parameters in a system; raise ValueError naming what was refused."""
    changed = False
    vectors = vectors_of(parameters, values)
    for parameter in _stiffness_before_damping(parameters):
        name, setter = parameter.name, parameter.apply
        if setter is None or (isinstance(setter, Joint) and parameter.component != 0):
            continue
        value: Any = values[name]
        if isinstance(setter, Joint) and parameter.vector is not None:
            name, setter, value = parameter.vector, setter.function, vectors[parameter.vector]
        try:
            setter(system, value)
        except (ValueError, TypeError) as error:
            shown = ", ".join(f"{entry:.6g}" for entry in np.atleast_1d(value))
            raise type(error)(f"parameter '{name}' = {shown}: {error}") from error
        changed = changed or parameter.changes_model
    for parameter in parameters:
        if isinstance(parameter.apply, ModelSetter):
            try:
                parameter.apply.check_result(system)
            except ValueError as error:
                value = values[parameter.name]
                raise ValueError(f"parameter '{parameter.name}' = {value:.6g}: {error}") from None
    if changed:
        model = model_of(system)
        try:
            mujoco.mj_setConst(model, mujoco.MjData(model))
        except mujoco.FatalError as error:
            names = ", ".join(p.name for p in parameters if p.changes_model)
            raise ValueError(f"the model does not take the values of {names}: {error}") from error


def _stiffness_before_damping(parameters: Sequence[Parameter]) -> list[Parameter]:
    """Return parameters in order, but what gives a stiffness before any damping that needs one."""

    def sets(parameter: Parameter, quantity: str) -> bool:
        setter = parameter.apply
        return isinstance(setter, MaterialSetter | PairSetter) and setter.quantity == quantity

    order = list(parameters)
    first = next((i for i, p in enumerate(order) if sets(p, "damping")), len(order))
    rest = order[first:]
    stiff = [p for p in rest if sets(p, "stiffness")]
    return order[:first] + stiff + [p for p in rest if p not in stiff]
