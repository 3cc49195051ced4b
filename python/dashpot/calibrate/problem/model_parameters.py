"""Parameters of the MuJoCo model: numbers of its arrays, and the inertia of bodies."""

from __future__ import annotations

import operator
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

from dashpot.calibrate.problem import setters
from dashpot.calibrate.problem.inertia_setter import InertiaRange
from dashpot.calibrate.problem.parameter_options import (
    Bounds,
    Frozen,
    Groups,
    Start,
    Transforms,
    columns_of,
    elements_of,
    is_element,
)
from dashpot.calibrate.problem.physical_values import check_bounds
from dashpot.calibrate.problem.vectors import components, is_vector
from dashpot.checks import positive_number
from dashpot.object_ids import Element

if TYPE_CHECKING:
    from dashpot.calibrate.problem.parameters import Parameter

# Arrays of the model whose columns are not of one kind.
_UNLIKE_COLUMNS = re.compile(
    r"(geom|pair)_friction|\w+_sol(ref|imp)\w*|actuator_\w+prm|geom_fluid|\w+_i?quat"
)


class ModelParameters:
    """The methods of `Parameter` that make parameters of the model."""

    @classmethod
    def model(
        cls,
        attribute: str,
        elements: Element | Sequence[Element],
        *,
        start: Start,
        bounds: Bounds,
        index: int | Sequence[int] | None = None,
        name: str | None = None,
        transform: Transforms = "log",
        difference: float = 1e-4,
        per: Groups | None = None,
        frozen: Frozen = False,
    ) -> Parameter:
        """Vary an array of the MuJoCo model, for example a mass.

        Parameters
        ----------
        attribute
            A float array of ``mujoco.MjModel`` with one row per body, geom, joint, site, pair,
            tendon, actuator or degree of freedom: ``body_mass``, ``body_inertia``, ``body_ipos``,
            ``geom_friction``, ``geom_solref``, ``geom_size``, ``dof_damping``,
            ``dof_frictionloss`` ...
            Moving the centre of mass (``body_ipos``) of a body that MuJoCo compiled as simple, its
            frame being that of its inertia, needs ``simple="false"`` of the body in the MJCF.
            ``body_mass`` leaves ``body_inertia`` as it is: for a body that grows heavier as a whole
            give `Parameter` an ``apply`` that scales both, and ``changes_model``.
        elements
            Name or id of the body, geom ... whose row is set, or several; of the joint, for all of
            its degrees of freedom.
        index
            Which columns of the row take the value, or of a vector its numbers; None: all of them,
            where they are alike. Those
            of ``geom_friction``, ``solref``, ``solimp``, quaternions and parameters of actuators
            are not.
        start, bounds, name, transform, difference, per, frozen
            As in `Parameter`. By default the name is ``attribute``. Bounds that reach beyond what
            bodies can be (masses, moments of inertia and sizes <= 0, damping, armature and friction
            < 0) are refused. Values between them that make no body together, as moments of inertia
            of which one exceeds the sum of the others do, are refused as a start. A search finds
            none of them good.

        Examples
        --------
        >>> Parameter.model("geom_friction", "floor", start=0.5, bounds=(0.1, 2.0), index=0).name
        'geom_friction'
        """
        make = cast("type[Parameter]", cls)
        if not isinstance(attribute, str):
            raise TypeError(f"attribute must be a string, got {attribute!r}")
        names = elements_of("elements", elements)
        alike = index is not None or is_vector(start, bounds)
        if not alike and _UNLIKE_COLUMNS.fullmatch(attribute):
            raise ValueError(
                f"columns of {attribute} differ in what they mean; say which take the value: index"
            )
        parameter = make(
            name=attribute if name is None else name,
            start=start,
            bounds=bounds,
            transform=transform,
            difference=difference,
            per=per,
            frozen=frozen,
            apply=setters.model_setter(attribute, names, columns_of(index)),
            changes_model=True,
        )
        for single in components(parameter):
            try:
                check_bounds(attribute, ", ".join(f"'{e}'" for e in names), single.bounds)
            except ValueError as error:
                raise ValueError(f"parameter '{single.name}': {error}") from None
        return parameter

    @classmethod
    def inertia(
        cls,
        body: Element,
        *,
        mass: Sequence[float] | None = None,
        centre: float | bool = True,
        shape: float | bool = True,
        name: str | None = None,
        difference: float = 1e-4,
        per: Groups | None = None,
        frozen: bool = False,
    ) -> Parameter:
        """Vary mass, centre of mass and rotational inertia of a body, which stays physical.

        They are a vector of ten numbers, of which any within their bounds make a body (a Cholesky
        factor of the pseudo-inertia, `dashpot.calibrate.problem.pseudo_inertia`). Each starts from
        the model's. `Fit.inertia` tells mass, centre and moments of inertia with intervals.

        Motions without known forces tell neither the mass nor how large the inertia is, but where
        the centre is and how the moments are to each other. What turns about one axis alone tells
        one moment: hold stretches and shears there (`Problem.freeze`).

        Parameters
        ----------
        body
            Name or id. Where its centre or shape vary, MuJoCo must not have compiled it as simple:
            give it ``simple="false"`` in the MJCF.
        mass
            (lower, upper), kg; None: the model's is held, as of a body that was weighed.
        centre
            How far it may be from the model's along each axis of the body, m; True: as far as mass
            spreads along its longest axis; False: it stays.
        shape
            Factor > 1 by which sizes and stretches may differ from the model's; True: 3; False:
            moments of inertia stay, but for the mass that they grow with.
        name, difference, per, frozen
            As in `Parameter`. By default the name is ``inertia of BODY``.

        Examples
        --------
        A box with an unknown load inside that was weighed and thrown; and a mass alone:

        >>> load = Parameter.inertia("box", centre=0.05)
        >>> mass = Parameter.inertia("box", mass=(0.2, 1.0), centre=False, shape=False)
        >>> load.name
        'inertia of box'
        """
        make = cast("type[Parameter]", cls)
        if not is_element(body):
            raise TypeError(f"body must be a name or an id, got {body!r}")
        label = f"inertia of {body}" if name is None else name
        parts = {"centre": centre, "shape": shape}
        for part, value in parts.items():
            if not isinstance(value, bool):
                least = 1.0 if part == "shape" else 0.0
                parts[part] = positive_number(f"parameter '{label}': {part}", value)
                if value <= least:
                    raise ValueError(f"parameter '{label}': {part} must be > 1, got {value!r}")
        if mass is None and not centre and not shape:
            raise ValueError(f"parameter '{label}': mass, centre and shape are all held")
        if mass is not None:
            mass = make(label, 1.0, mass, frozen=True).bounds
        return make(
            name=label,
            start=0.0,  # as those that a Problem makes of it, whose model tells them
            bounds=(-1.0, 1.0),
            transform="linear",
            difference=difference,
            per=per,
            frozen=frozen,
            apply=InertiaRange(
                body if isinstance(body, str) else operator.index(body),
                mass,
                None if centre is True else float(parts["centre"]),
                3.0 if shape is True else float(parts["shape"]) or None,
            ),
            changes_model=True,
        )
