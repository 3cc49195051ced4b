"""What calibration may vary: contact material, pair material, properties of the model."""

from __future__ import annotations

import difflib
import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args, overload

import numpy as np

from dashpot.calibrate.problem import setters
from dashpot.calibrate.problem.channels import POSES
from dashpot.calibrate.problem.default_ranges import range_of
from dashpot.calibrate.problem.groups import checked_groups
from dashpot.calibrate.problem.inertia_setter import InertiaRange
from dashpot.calibrate.problem.physical_values import check_bounds
from dashpot.calibrate.problem.sensing import SensingQuantity, SensingSetter
from dashpot.calibrate.problem.setters import System
from dashpot.calibrate.problem.transforms import Transform, TransformName
from dashpot.calibrate.problem.vectors import components, is_vector, vector_fields
from dashpot.checks import flag, number, number_array, positive_number
from dashpot.materials import Material
from dashpot.object_ids import Element

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

Groups: TypeAlias = Literal["trajectory"] | Mapping[str, Sequence[str]]
Start: TypeAlias = float | Sequence[float]
Bounds: TypeAlias = tuple[float, float] | Sequence[tuple[float, float]]
Transforms: TypeAlias = TransformName | Sequence[TransformName]
Frozen: TypeAlias = bool | Sequence[bool]

# Search coordinate, finite-difference step: quantities of unknown order of magnitude in log.
_DEFAULT_TRANSFORM: dict[str, TransformName] = {"restitution": "logit"}
# Arrays of the model whose columns are not of one kind.
_UNLIKE_COLUMNS = re.compile(
    r"(geom|pair)_friction|\w+_sol(ref|imp)\w*|actuator_\w+prm|geom_fluid|\w+_i?quat"
)
_TRANSFORMS: tuple[str, ...] = get_args(TransformName)
_MATERIAL_FIELDS: tuple[str, ...] = get_args(MaterialField)


@dataclass(frozen=True)
class Parameter:
    """One unknown of a calibration: a start, bounds, a search coordinate and what it sets.

    Make one with `material`, `pair` or `model`, or directly with any function ``apply(system,
    value)``, where ``system`` is the problem's private copy (`dashpot.Engine`, or `mujoco.MjModel`
    when the problem steps with MuJoCo). Without ``apply`` the value only reaches the functions that
    build the system or give the initial states (see `Problem`), of which there has to be one.

    Parameters
    ----------
    name
        Names the parameter in tables and messages.
    start
        Where the search starts, strictly between the bounds. Several numbers make a vector: a
        `Problem` makes single parameters of it, named ``name[0]``, ``name[1]`` ..., each with a
        value, an interval and a statement of its own.
    bounds
        (lower, upper); > 0 for the log transform. Of a vector for all of its numbers, or one such
        for each.
    transform
        Search coordinate: ``"log"``, ``"linear"`` or ``"logit"``; of a vector one, or one for each
        number.
    difference
        Half-width of the central finite difference in the search coordinate, in (0, 0.5]. Contact
        trajectories are only piecewise smooth: a much smaller step resolves the rounding and the
        micro-step switches of a bounce instead of the trend that the fit needs; the default 1e-4
        is 0.01 % of the value (log) or of the range (linear).
    apply
        Sets the value in a system; of a vector an array of its numbers.
    changes_model
        Whether ``apply`` edits the MuJoCo model, whose derived constants are then recomputed with
        ``mj_setConst``.
    per
        ``"trajectory"``: each trajectory has a value of its own; or names of trajectories by group:
        ``{"thin": ["run 1", "run 2"], "thick": ["run 3"]}``. A `Problem` makes single parameters of
        it, named ``name[group]``. None: all trajectories share one.
    trajectories
        Names of the trajectories in which it acts, as a `Problem` sets them; None: all.
    base
        The name of the parameter with ``per`` that a `Problem` made it of.
    frozen
        Held at its start, which may then be anywhere: it is set and listed, but not fitted. Of a
        vector also one for each number. `Problem.freeze` and `Problem.release` change it, as to
        compare nested models.
    vector, component
        The name of the vector that a `Problem` made it of, and which of its numbers it is.

    Raises
    ------
    TypeError, ValueError
        Naming the parameter and the field.
    """

    name: str
    start: float
    bounds: tuple[float, float]
    transform: TransformName = "log"
    difference: float = 1e-4
    apply: Callable[[System, float], None] | None = field(default=None, repr=False, compare=False)
    changes_model: bool = False
    per: Groups | None = field(default=None, hash=False)
    trajectories: tuple[str, ...] | None = None
    base: str | None = None
    frozen: bool = False
    vector: str | None = None
    component: int | None = None

    if TYPE_CHECKING:
        # What is taken. Single parameters, as problems have them, have the types of the fields.
        def __init__(
            self,
            name: str,
            start: Start,
            bounds: Bounds,
            transform: Transforms = "log",
            difference: float = 1e-4,
            apply: Callable[[System, Any], None] | None = None,
            changes_model: bool = False,
            per: Groups | None = None,
            trajectories: tuple[str, ...] | None = None,
            base: str | None = None,
            frozen: Frozen = False,
            vector: str | None = None,
            component: int | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise TypeError(f"a parameter's name must be a string, got {self.name!r}")
        label = f"parameter '{self.name}'"
        if self.apply is not None and not callable(self.apply):
            raise TypeError(f"{label}: apply must be a function, got {self.apply!r}")
        object.__setattr__(self, "per", checked_groups(label, self.per))
        if is_vector(self.start, self.bounds):
            given = {"transform": self.transform, "frozen": self.frozen}
            for name, value in vector_fields(label, self.start, self.bounds, **given).items():
                object.__setattr__(self, name, value)
            components(self)  # each has to be a parameter
            return
        object.__setattr__(self, "frozen", flag(f"{label}: frozen", self.frozen))
        if self.transform not in _TRANSFORMS:
            raise ValueError(
                f"{label}: transform must be one of {', '.join(_TRANSFORMS)}, "
                f"got {self.transform!r}"
            )
        bounds = number_array(f"{label}: bounds", () if self.bounds is None else self.bounds)
        if bounds.shape != (2,):
            raise ValueError(f"{label}: bounds must be (lower, upper), got {self.bounds!r}")
        lower, upper = float(bounds[0]), float(bounds[1])
        if not (math.isfinite(lower) and math.isfinite(upper) and lower < upper):
            raise ValueError(f"{label}: bounds must be finite and ascend, got {self.bounds}")
        if self.transform == "log" and lower <= 0:
            raise ValueError(f"{label}: the log transform needs bounds > 0, got {self.bounds}")
        start = number(f"{label}: start", self.start)
        if not (math.isfinite(start) if self.frozen else lower < start < upper):
            raise ValueError(
                f"{label}: start must lie between the bounds {self.bounds}, got {self.start!r}"
            )
        if not 0 < number(f"{label}: difference", self.difference) <= 0.5:
            raise ValueError(f"{label}: difference must be in (0, 0.5], got {self.difference!r}")
        flag(f"{label}: changes_model", self.changes_model)
        object.__setattr__(self, "bounds", (lower, upper))
        object.__setattr__(self, "start", float(self.start))

    def acts_in(self, trajectory: str) -> bool:
        """Whether it acts in the trajectory of this name."""
        return self.trajectories is None or trajectory in self.trajectories

    @property
    def coordinate(self) -> Transform:
        """The map between the parameter and its search coordinate."""
        return Transform(self.transform, *self.bounds)

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
            depends on the stiffness too: data that a search fits with ease in restitution may end
            it in a bad valley in N s/m, from a start a third off.
            Let bounds of a ``restitution`` begin at about 0.05: 0 is not the limit of smaller ones
            where there is friction (see `Material`). Of motions with 0 a search that may go below
            finds 0.03 with an interval that leaves 0 out; with this bound it says that it ends
            there.
        start, bounds, name, transform, difference, per, frozen
            As in `Parameter`. By default the name is ``quantity`` and the transform ``log``
            (``logit`` for restitution); starts and bounds are those of what there is, as stiffness
            from 10 to 1e8 N/m.
        """
        _check_quantity(quantity)
        start, bounds = range_of(quantity, start, bounds)
        parameter = cls(
            name=quantity if name is None else name,
            start=start,
            bounds=bounds,
            transform=_DEFAULT_TRANSFORM.get(quantity, "log") if transform is None else transform,
            difference=difference,
            per=per,
            frozen=frozen,
            apply=setters.MaterialSetter(_elements("geoms", geoms), quantity),
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
        pairs: Sequence[tuple[Element, Element]],
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
        has; a problem refuses what would so lose stiffness or damping of its geoms' materials, or
        the model's ``solref``. Arguments as in `material`; the geoms by name or id.
        """
        several: Any = geom1
        if _is_element(geom1):
            for argument, geom in (("geom1", geom1), ("geom2", geom2)):
                if not _is_element(geom):
                    raise TypeError(f"{argument} must be the name or id of a geom, got {geom!r}")
            several = [(geom1, geom2)]
        elif quantity is None:
            quantity = geom2
        else:
            raise TypeError(f"geom1 must be the name or id of a geom, got {geom1!r}")
        _check_quantity(quantity)
        pairs = _pairs(several)
        start, bounds = range_of(quantity, start, bounds)
        parameter = cls(
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
            of which one exceeds the sum of the others do, are refused as a start; a search finds
            none of them good.
        """
        if not isinstance(attribute, str):
            raise TypeError(f"attribute must be a string, got {attribute!r}")
        names = _elements("elements", elements)
        alike = index is not None or is_vector(start, bounds)
        if not alike and _UNLIKE_COLUMNS.fullmatch(attribute):
            raise ValueError(
                f"columns of {attribute} differ in what they mean; say which take the value: index"
            )
        parameter = cls(
            name=attribute if name is None else name,
            start=start,
            bounds=bounds,
            transform=transform,
            difference=difference,
            per=per,
            frozen=frozen,
            apply=setters.model_setter(attribute, names, _columns(index)),
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
        mass: tuple[float, float] | None = None,
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

        Example
        -------
        A box with an unknown load inside that was weighed and thrown; and a mass alone::

            Parameter.inertia("box", centre=0.05)
            Parameter.inertia("box", mass=(0.2, 1.0), centre=False, shape=False)
        """
        if not _is_element(body):
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
            mass = cls(label, 1.0, mass, frozen=True).bounds
        return cls(
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

    @classmethod
    def delay(
        cls,
        channel: str | Sequence[str],
        *,
        bounds: tuple[float, float],
        start: float = 0.0,
        name: str | None = None,
        per: Groups | None = None,
        frozen: Frozen = False,
    ) -> Parameter:
        """Estimate by how much a recorder is late, s.

        Parameters
        ----------
        channel
            Name of a sensor, ``"poses"``, or a kind of events, as ``"impact"``; or several, which
            one recorder has.
        bounds
            (lower, upper), s. Readings at times before the upper one do not count: what they show
            comes before the start. Simulations go on beyond the end by a lower one < 0.
        start, name, per, frozen
            As in `Parameter`. By default the name is ``delay of CHANNEL``.

        Example
        -------
        A load cell that may be up to 50 ms late beside a camera::

            Parameter.delay("load", bounds=(-0.01, 0.05))
        """
        return cls._of_sensing("delay", channel, start, bounds, name, per, frozen, "linear")

    @classmethod
    def gain(
        cls,
        channel: str | Sequence[str],
        *,
        bounds: Bounds,
        start: Start = 1.0,
        name: str | None = None,
        per: Groups | None = None,
        frozen: Frozen = False,
    ) -> Parameter:
        """Estimate the gain of a sensor, or of a scalar: its reading is so many times the true one.

        Parameters as in `delay`; `bounds` > 0.
        """
        return cls._of_sensing("gain", channel, start, bounds, name, per, frozen, "log")

    @classmethod
    def offset(
        cls,
        channel: str | Sequence[str],
        *,
        bounds: Bounds,
        start: Start = 0.0,
        name: str | None = None,
        per: Groups | None = None,
        frozen: Frozen = False,
    ) -> Parameter:
        """Estimate what a sensor, or a scalar, reads where the true reading is 0, in its unit.

        Parameters as in `delay`. Of sensors of several numbers all have the same, unless `start` or
        `bounds` are those of a vector.
        """
        return cls._of_sensing("offset", channel, start, bounds, name, per, frozen, "linear")

    @classmethod
    def scale(
        cls,
        *,
        bounds: tuple[float, float],
        start: float = 1.0,
        centre: Sequence[float] = (0.0, 0.0, 0.0),
        name: str | None = None,
        per: Groups | None = None,
        frozen: Frozen = False,
    ) -> Parameter:
        """Estimate the scale of measured positions: they are so many times the true ones.

        Parameters
        ----------
        centre
            (3,) the point that is measured rightly, world, m: the optical axis of a camera.
        bounds, start, name, per, frozen
            As in `delay`; `bounds` > 0. By default the name is ``scale of poses``.
        """
        point = number_array("centre", centre)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise ValueError(f"centre must be three finite numbers, got {centre!r}")
        x, y, z = (float(entry) for entry in point)
        return cls._of_sensing("scale", POSES, start, bounds, name, per, frozen, "log", (x, y, z))

    @classmethod
    def _of_sensing(
        cls,
        quantity: SensingQuantity,
        channel: str | Sequence[str],
        start: Start,
        bounds: Bounds,
        name: str | None,
        per: Groups | None,
        frozen: Frozen,
        transform: TransformName,
        centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> Parameter:
        listed = channel if isinstance(channel, Iterable) else ()
        several = (channel,) if isinstance(channel, str) else tuple(listed)
        if not several or not all(isinstance(one, str) for one in several):
            raise TypeError(f"channel must be a name, or several, got {channel!r}")
        return cls(
            name=f"{quantity} of {', '.join(several)}" if name is None else name,
            start=start,
            bounds=bounds,
            transform=transform,
            per=per,
            frozen=frozen,
            apply=SensingSetter(quantity, several[0], centre, others=several[1:]),
        )


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


def _pairs(given: object) -> tuple[tuple[Element, Element], ...]:
    """Return one pair of geoms or more; raise TypeError or ValueError for anything else."""
    if not isinstance(given, Iterable) or isinstance(given, str):
        raise TypeError(f"pairs must be two geoms by name or id, or several twos, got {given!r}")
    found: list[tuple[Element, Element]] = []
    for pair in given:
        geoms = () if isinstance(pair, str) or not isinstance(pair, Iterable) else tuple(pair)
        if len(geoms) != 2 or not all(map(_is_element, geoms)):
            raise TypeError(f"a pair is two geoms by name or id, got {pair!r}")
        first, second = (g if isinstance(g, str) else operator.index(g) for g in geoms)
        if (first, second) in found or (second, first) in found:
            raise ValueError(f"pairs has {first!r} and {second!r} twice")
        found.append((first, second))
    if not found:
        raise ValueError("pairs names nothing")
    return tuple(found)


def _elements(argument: str, given: Element | Sequence[Element]) -> tuple[Element, ...]:
    """Return one name or id, or several, as a tuple of at least one."""
    several = (given,) if isinstance(given, str) or not isinstance(given, Iterable) else given
    elements = tuple(several)
    if not all(map(_is_element, elements)):
        raise TypeError(f"{argument} must be names or ids, one or a sequence, got {given!r}")
    if not elements:
        raise ValueError(f"{argument} names nothing")
    return tuple(e if isinstance(e, str) else operator.index(e) for e in elements)


def _is_element(key: object) -> bool:
    """Whether `key` can be the name or the id of an element of a model."""
    return isinstance(key, str | int | np.integer) and not isinstance(key, bool)


def _columns(index: int | Sequence[int] | None) -> tuple[int, ...] | None:
    """Return the columns that a parameter sets, None for all."""
    if index is None:
        return None
    columns = np.atleast_1d(np.asarray(index))
    if columns.ndim != 1 or not np.issubdtype(columns.dtype, np.integer):
        raise TypeError(f"index must be an integer or a sequence of integers, got {index!r}")
    if not columns.size:
        raise ValueError("index names no column")
    return tuple(int(column) for column in columns)


def _check_quantity(quantity: str) -> None:
    if not isinstance(quantity, str):
        raise TypeError(f"quantity must be a string, got {quantity!r}")
    if quantity not in _MATERIAL_FIELDS:
        near = difflib.get_close_matches(quantity, _MATERIAL_FIELDS)
        hint = f"; near: {', '.join(near)}" if near else ""
        raise ValueError(
            f"unknown material quantity {quantity!r}; known: {', '.join(_MATERIAL_FIELDS)}{hint}"
        )
