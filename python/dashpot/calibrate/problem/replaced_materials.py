"""What contacts would lose unnoticed where a parameter gives geoms or pairs a material."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import mujoco

from dashpot.calibrate.problem.parameters import Parameter
from dashpot.calibrate.problem.setters import MaterialSetter, PairSetter, kind_of_quantity
from dashpot.engine import Engine
from dashpot.idle_friction import partners
from dashpot.materials import Material

# What a pair's own material has in place of that of its geoms, beside friction: the quantity that a
# parameter sets, and where a contact shows it.
_REPLACED = (
    ("stiffness", ("stiffness",)),
    ("damping", ("damping", "damping_ratio")),
    ("loaded_friction", ("loaded_friction",)),
    ("tangential_ratio", ("tangential_ratio",)),
    ("tangential_damping_ratio", ("tangential_damping_ratio",)),
)


def check_nothing_is_lost(engine: Engine, parameters: Sequence[Parameter]) -> None:
    """Raise ValueError where parameters would replace more of a contact than what they set.

    A pair without a material of its own starts from ``Material()``, and so does a geom: what the
    geoms' materials combine to, or the model's own ``solref``, gives way to a rigid contact. That
    is refused unless other parameters set what would be lost.

    Parameters
    ----------
    engine
        As the user made it.
    parameters
        Those of the problem.
    """
    set_for_pair: dict[tuple[int, int], set[str]] = {}
    set_for_geom: dict[int, set[str]] = {}
    for parameter in parameters:
        setter = parameter.apply
        if isinstance(setter, PairSetter):
            for pair in _pairs_of(engine, setter):
                set_for_pair.setdefault(pair, set()).add(kind_of_quantity(setter.quantity))
        elif isinstance(setter, MaterialSetter):
            for element in setter.geoms:
                quantities = set_for_geom.setdefault(engine.geom_id(element), set())
                quantities.add(kind_of_quantity(setter.quantity))
    for parameter in parameters:
        setter = parameter.apply
        label = f"parameter '{parameter.name}'"
        if isinstance(setter, PairSetter):
            for pair in _pairs_of(engine, setter):
                if pair not in engine.pair_materials:
                    _check_pair(engine, pair, set_for_pair[pair], label)
        elif isinstance(setter, MaterialSetter):
            for geom in map(engine.geom_id, setter.geoms):
                for other in partners(engine.model, geom):
                    given = set_for_geom[geom] | set_for_geom.get(other, set())
                    if "stiffness" not in given and _ordered(geom, other) not in set_for_pair:
                        _check_solref(engine, geom, other, label)


def _check_pair(engine: Engine, pair: tuple[int, int], given: set[str], label: str) -> None:
    present = engine.contact_material(*pair)
    first, second = (_name(engine.model, geom) for geom in pair)
    remedy = (
        f"give the pair a material first (Engine.set_pair_material({first!r}, {second!r}, ...)), "
        "or estimate"
    )
    if present.source == "solref" and "stiffness" not in given:
        raise ValueError(
            f"{label} would make contacts of geoms {first!r} and {second!r} rigid, which the "
            f"model's solref {present.solref} makes soft; {remedy} the stiffness too"
        )
    if present.source != "geoms":
        return
    replaced = copy.copy(engine)
    replaced.set_pair_material(*pair, Material())
    own = replaced.contact_material(*pair)
    for quantity, shown in _REPLACED:
        if quantity in given:
            continue
        for field in shown:
            value = getattr(present, field)
            if value != getattr(own, field):
                raise ValueError(
                    f"{label} would give geoms {first!r} and {second!r} a material of the pair, "
                    f"without the {field} of {value:.6g} that their own materials make; {remedy} "
                    f"the {quantity} too"
                )


def _check_solref(engine: Engine, geom: int, other: int, label: str) -> None:
    present = engine.contact_material(geom, other)
    if present.source == "solref":
        name, partner = _name(engine.model, geom), _name(engine.model, other)
        raise ValueError(
            f"{label} would make contacts of geom {name!r} with {partner!r} rigid, which the "
            f"model's solref {present.solref} makes soft; give the geom a material first "
            f"(Engine.set_material({name!r}, ...)), or estimate its stiffness too"
        )


def _pairs_of(engine: Engine, setter: PairSetter) -> list[tuple[int, int]]:
    return [_ordered(engine.geom_id(a), engine.geom_id(b)) for a, b in setter.pairs]


def _ordered(geom1: int, geom2: int) -> tuple[int, int]:
    return min(geom1, geom2), max(geom1, geom2)


def _name(model: mujoco.MjModel, geom: int) -> str | int:
    return model.geom(geom).name or geom
