"""Warnings of unknown friction of geoms that no contact takes, whatever its value."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

from dashpot.calibrate.problem.parameters import Parameter
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.setters import (
    FRICTION_INDEX,
    MaterialSetter,
    ModelSetter,
    System,
    model_of,
)
from dashpot.engine import Engine
from dashpot.idle_friction import COEFFICIENTS, outvoted
from dashpot.materials import CombinationRules
from dashpot.object_ids import Element, geom_label, object_id

# Of what called fit, which calls `warn_of_idle_friction`.
_STACK_LEVEL = 3


def warn_of_idle_friction(problem: Problem) -> None:
    """Warn of friction of geoms that has no effect between its bounds.

    That is so where the friction of every geom that they could touch counts in its place, even
    with it at one of its bounds and all other parameters at their opposite ones.
    """
    for parameter in problem.unknowns:
        geoms, coefficients = _friction_of_geoms(parameter)
        ends = [
            {p.name: p.bounds[side if p is parameter else 1 - side] for p in problem.unknowns}
            for side in (0, 1)
        ]
        try:
            systems = [problem.build(values) for values in ends] if geoms else []
        except (ValueError, TypeError):
            continue  # not all values go together; the fit finds those that do
        reasons = [
            _why_idle(system, geom, i) for geom in geoms for i in coefficients for system in systems
        ]
        if reasons and None not in reasons:
            low, high = parameter.bounds
            warnings.warn(
                f"parameter '{parameter.name}' has no effect between its bounds {low:g} and "
                f"{high:g}: {reasons[-1]}; let one parameter set both geoms "
                "(Parameter.material((geom1, geom2), ...)) or the pair (Parameter.pair)",
                stacklevel=_STACK_LEVEL,
            )


def _friction_of_geoms(parameter: Parameter) -> tuple[Sequence[Element], Sequence[int]]:
    """Return the geoms whose friction a parameter sets, and which coefficients of it."""
    setter = parameter.apply
    if isinstance(setter, MaterialSetter) and setter.quantity in FRICTION_INDEX:
        return setter.geoms, (FRICTION_INDEX[setter.quantity],)
    if isinstance(setter, ModelSetter) and setter.attribute == "geom_friction":
        return setter.elements, setter.columns or range(len(COEFFICIENTS))
    return (), ()


def _why_idle(system: System, element: Element, coefficient: int) -> str | None:
    """Say why friction of a geom counts in no contact; None where it counts."""
    model = model_of(system)
    geom = object_id(model, element, "geom", "geom")
    if isinstance(system, Engine):
        said = outvoted(
            model, system.materials, system.pair_materials, system.rules, geom, coefficient
        )
    else:
        said = outvoted(model, {}, {}, CombinationRules(), geom, coefficient)
    if said is None:
        return None
    return f"no contact of geom {geom_label(model, geom)} takes its friction, as {said}"
