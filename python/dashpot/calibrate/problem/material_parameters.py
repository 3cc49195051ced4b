"""Parameters of materials: of geoms, and of pairs of geoms."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, cast, get_args, overload

import numpy as np

from dashpot.calibrate.problem import setters
from dashpot.calibrate.problem.default_ranges import range_of
from dashpot.calibrate.problem.parameter_options import (
    Bounds,
    Frozen,
    Groups,
    Start,
    Transforms,
    elements_of,
    is_element,
    pairs_of,
)
from dashpot.calibrate.problem.transforms import TransformName
from dashpot.calibrate.problem.vectors import components
from dashpot.materials import Material
from dashpot.object_ids import Element

if TYPE_CHECKING:
    from dashpot.calibrate.problem.parameters import Parameter

MaterialField = Literal[
    "stiffness",
    "damping",
    "damping_ratio",
    "restitution",
    "friction",
    "sliding_friction",
    "torsional_friction",
    "rolling_friction",
    "loaded_friction",
    "friction_load",
    "tangential_ratio",
    "tangential_damping_ratio",
]

# Quantities of unknown order of magnitude are searched in the logarithm.
_DEFAULT_TRANSFORM: dict[str, TransformName] = {"restitution": "logit"}
_MATERIAL_FIELDS: tuple[str, ...] = get_args(MaterialField)


class MaterialParameters:
    """The methods of `Parameter` that make parameters of materials."""

    @classmethod
    def material(
        cls,
        geoms: Element | Sequence[Element],
        quantity: MaterialField,
        *,
        start: Start | None = None,
        bounds: Bounds | None = None,
        name: str | None = None,
        transform: Transforms | None = None,
        difference: float = 1e-4,
        per: Groups | None = None,
        frozen: Frozen = False,
    ) -> Parameter:
        """Vary one quantity of the material of one geom, or of several geoms alike.

        Parameters
        ----------
        geoms
            Name or id of a geom, or several: ids are those of the model, as ``Engine.body_geoms``
            gives them for geoms without names.
        quantity
            ``stiffness`` (N/m), ``damping`` (N s/m), ``damping_ratio``, ``restitution``,
            ``sliding_friction``, ``torsional_friction`` (m), ``rolling_friction`` (m),
            ``friction`` (these three as a vector), ``loaded_friction``, ``friction_load`` (N),
            ``tangential_ratio`` or ``tangential_damping_ratio``. What is not varied stays as the
            engine's material has it; a problem refuses geoms without one whose softness is the
            model's ``solref``, unless their stiffness is varied too. So it does where ``damping``
            is varied of what has no stiffness, given or varied.
            Beside an unknown stiffness ask for ``restitution`` or ``damping_ratio`` rather than
            ``damping``. Motions show how much a bounce returns, which at one damping in N s/m
            depends on the stiffness too. Data that a search fits with ease in restitution may end
            it in a bad valley in N s/m, from a start a third off. Let bounds of a ``restitution``
            begin at about 0.05: 0 is not the limit of smaller ones where there is friction (see
            `Material`). Of motions with 0 a search that may go below finds 0.03 with an interval
            that leaves 0 out; with this bound it says that it ends there.
        start, bounds, name, transform, difference, per, frozen
            As in `Parameter`. By default the name is ``quantity`` and the transform ``log``
            (``logit`` for restitution); starts and bounds are those of what there is, as stiffness
            from 10 to 1e8 N/m.

        Examples
        --------
        >>> Parameter.material("ball", "restitution", start=0.5, bounds=(0.05, 0.99)).transform
        'logit'
        """
        make = cast("type[Parameter]", cls)
        _check_quantity(quantity)
        start, bounds = range_of(quantity, start, bounds)
        parameter = make(
            name=quantity if name is None else name,
            start=start,
            bounds=bounds,
            transform=_DEFAULT_TRANSFORM.get(quantity, "log") if transform is None else transform,
            difference=difference,
            per=per,
            frozen=frozen,
            apply=setters.MaterialSetter(elements_of("geoms", geoms), quantity),
        )
        _check_material_takes_bounds(parameter)
        return parameter

    @overload
    @classmethod
    def pair(
        cls,
        geom1: Element,
        geom2: Element,
        quantity: MaterialField,
        *,
        start: Start | None = ...,
        bounds: Bounds | None = ...,
        name: str | None = ...,
        transform: Transforms | None = ...,
        difference: float = ...,
        per: Groups | None = ...,
        frozen: Frozen = ...,
    ) -> Parameter: ...

    @overload
    @classmethod
    def pair(
        cls,
        pairs: Sequence[Sequence[Element]],
        quantity: MaterialField,
        /,
        *,
        start: Start | None = ...,
        bounds: Bounds | None = ...,
        name: str | None = ...,
        transform: Transforms | None = ...,
        difference: float = ...,
        per: Groups | None = ...,
        frozen: Frozen = ...,
    ) -> Parameter: ...

    @classmethod
    def pair(
        cls,
        geom1: Any,
        geom2: Any = None,
        quantity: Any = None,
        *,
        start: Start | None = None,
        bounds: Bounds | None = None,
        name: str | None = None,
        transform: Transforms | None = None,
        difference: float = 1e-4,
        per: Groups | None = None,
        frozen: Frozen = False,
    ) -> Parameter:
        """Vary one quantity of the material that two geoms have with each other.

        Several pairs may share one value: ``Parameter.pair([("left", "cube"), ("right", "cube")],
        "sliding_friction")``.

        A pair without a material of its own starts from ``Material()`` and the friction that it
        has. A problem refuses what would so lose stiffness or damping of its geoms' materials, or
        the model's ``solref``. Arguments as in `material`; the geoms by name or id.

        Examples
        --------
        >>> both = Parameter.pair([("ball", "floor"), ("box", "floor")], "sliding_friction")
        >>> both.start, both.bounds
        (0.3, (0.01, 3.0))
        """
        make = cast("type[Parameter]", cls)
        several: Any = geom1
        if is_element(geom1):
            for argument, geom in (("geom1", geom1), ("geom2", geom2)):
                if not is_element(geom):
                    raise TypeError(f"{argument} must be the name or id of a geom, got {geom!r}")
            several = [(geom1, geom2)]
        elif quantity is None:
            quantity = geom2
        else:
            raise TypeError(f"geom1 must be the name or id of a geom, got {geom1!r}")
        _check_quantity(quantity)
        pairs = pairs_of(several)
        start, bounds = range_of(quantity, start, bounds)
        parameter = make(
            name=quantity if name is None else name,
            start=start,
            bounds=bounds,
            transform=_DEFAULT_TRANSFORM.get(quantity, "log") if transform is None else transform,
            difference=difference,
            per=per,
            frozen=frozen,
            apply=setters.PairSetter(pairs, quantity),
        )
        _check_material_takes_bounds(parameter)
        return parameter


def _check_material_takes_bounds(parameter: Parameter) -> None:
    for single in components(parameter):
        assert isinstance(single.apply, setters.MaterialSetter | setters.PairSetter)
        for bound in single.bounds:
            try:
                setters.with_quantity(Material(1.0), single.apply.quantity, bound, np.zeros(3))
            except ValueError as error:
                raise ValueError(
                    f"parameter '{single.name}': bounds {single.bounds}: {error}"
                ) from None


def _check_quantity(quantity: str) -> None:
    if not isinstance(quantity, str):
        raise TypeError(f"quantity must be a string, got {quantity!r}")
    if quantity not in _MATERIAL_FIELDS:
        near = difflib.get_close_matches(quantity, _MATERIAL_FIELDS)
        hint = f"; near: {', '.join(near)}" if near else ""
        raise ValueError(
            f"unknown material quantity {quantity!r}; known: {', '.join(_MATERIAL_FIELDS)}{hint}"
        )
