"""What calibration may vary: contact material, pair material, properties of the model."""

from __future__ import annotations

import difflib
import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias, get_args

import numpy as np

from dashpot.calibrate.problem import setters
from dashpot.calibrate.problem.channels import POSES
from dashpot.calibrate.problem.default_ranges import middle, start_and_bounds
from dashpot.calibrate.problem.groups import checked_groups
from dashpot.calibrate.problem.physical_values import check_bounds
from dashpot.calibrate.problem.sensing import ImageQuantity, SensingQuantity, SensingSetter
from dashpot.calibrate.problem.setters import System
from dashpot.calibrate.problem.transforms import Transform, TransformName
from dashpot.checks import flag, number, number_array
from dashpot.materials import Material
from dashpot.object_ids import Element

MaterialField = Literal[
    "stiffness",
    "damping",
    "damping_ratio",
    "restitution",
    "sliding_friction",
    "torsional_friction",
    "rolling_friction",
    "loaded_friction",
    "friction_load",
    "tangential_ratio",
    "tangential_damping_ratio",
]

Groups: TypeAlias = Literal["trajectory"] | Mapping[str, Sequence[str]]

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
        Where the search starts, strictly between the bounds.
    bounds
        (lower, upper); > 0 for the log transform.
    transform
        Search coordinate: ``"log"``, ``"linear"`` or ``"logit"``.
    difference
        Half-width of the central finite difference in the search coordinate, in (0, 0.5]. Contact
        trajectories are only piecewise smooth: a much smaller step resolves the rounding and the
        micro-step switches of a bounce instead of the trend that the fit needs; the default 1e-4
        is 0.01 % of the value (log) or of the range (linear).
    apply
        Sets the value in a system.
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

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise TypeError(f"a parameter's name must be a string, got {self.name!r}")
        label = f"parameter '{self.name}'"
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
        if not lower < number(f"{label}: start", self.start) < upper:
            raise ValueError(
                f"{label}: start must lie between the bounds {self.bounds}, got {self.start!r}"
            )
        if not 0 < number(f"{label}: difference", self.difference) <= 0.5:
            raise ValueError(f"{label}: difference must be in (0, 0.5], got {self.difference!r}")
        if self.apply is not None and not callable(self.apply):
            raise TypeError(f"{label}: apply must be a function, got {self.apply!r}")
        flag(f"{label}: changes_model", self.changes_model)
        object.__setattr__(self, "per", checked_groups(label, self.per))
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
        start: float | None = None,
        bounds: tuple[float, float] | None = None,
        name: str | None = None,
        transform: TransformName | None = None,
        difference: float = 1e-4,
        per: Groups | None = None,
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
            ``loaded_friction``, ``friction_load`` (N), ``tangential_ratio`` or
            ``tangential_damping_ratio``. What is not varied stays as the engine's material has it;
            a problem refuses geoms without one whose softness is the model's ``solref``, unless
            their stiffness is varied too. So it does where ``damping`` is varied of what has no
            stiffness, given or varied.
            Beside an unknown stiffness ask for ``restitution`` or ``damping_ratio`` rather than
            ``damping``. Motions show how much a bounce returns, which at one damping in N s/m
            depends on the stiffness too: data that a search fits with ease in restitution may end
            it in a bad valley in N s/m, from a start a third off.
            Let bounds of a ``restitution`` begin at about 0.05: 0 is not the limit of smaller ones
            where there is friction (see `Material`). Of motions with 0 a search that may go below
            finds 0.03 with an interval that leaves 0 out; with this bound it says that it ends
            there.
        start, bounds, name, transform, difference, per
            As in `Parameter`. By default the name is ``quantity`` and the transform ``log``
            (``logit`` for restitution); starts and bounds are those of what there is, as stiffness
            from 10 to 1e8 N/m.
        """
        _check_quantity(quantity)
        start, bounds = start_and_bounds(quantity, start, bounds)
        parameter = cls(
            name=quantity if name is None else name,
            start=start,
            bounds=bounds,
            transform=_DEFAULT_TRANSFORM.get(quantity, "log") if transform is None else transform,
            difference=difference,
            per=per,
            apply=setters.MaterialSetter(_elements("geoms", geoms), quantity),
        )
        parameter._check_material_takes_bounds(quantity)
        return parameter

    @classmethod
    def pair(
        cls,
        geom1: Element,
        geom2: Element,
        quantity: MaterialField,
        *,
        start: float | None = None,
        bounds: tuple[float, float] | None = None,
        name: str | None = None,
        transform: TransformName | None = None,
        difference: float = 1e-4,
        per: Groups | None = None,
    ) -> Parameter:
        """Vary one quantity of the material that two geoms have with each other.

        A pair without a material of its own starts from ``Material()`` and the friction that it
        has; a problem refuses what would so lose stiffness or damping of its geoms' materials, or
        the model's ``solref``. Arguments as in `material`; the geoms by name or id.
        """
        _check_quantity(quantity)
        for argument, geom in (("geom1", geom1), ("geom2", geom2)):
            if not _is_element(geom):
                raise TypeError(f"{argument} must be the name or id of a geom, got {geom!r}")
        start, bounds = start_and_bounds(quantity, start, bounds)
        parameter = cls(
            name=quantity if name is None else name,
            start=start,
            bounds=bounds,
            transform=_DEFAULT_TRANSFORM.get(quantity, "log") if transform is None else transform,
            difference=difference,
            per=per,
            apply=setters.PairSetter(geom1, geom2, quantity),
        )
        parameter._check_material_takes_bounds(quantity)
        return parameter

    @classmethod
    def model(
        cls,
        attribute: str,
        elements: Element | Sequence[Element],
        *,
        start: float,
        bounds: tuple[float, float],
        index: int | Sequence[int] | None = None,
        name: str | None = None,
        transform: TransformName = "log",
        difference: float = 1e-4,
        per: Groups | None = None,
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
            Which columns of the row take the value; None: all of them, where they are alike. Those
            of ``geom_friction``, ``solref``, ``solimp``, quaternions and parameters of actuators
            are not.
        start, bounds, name, transform, difference, per
            As in `Parameter`. By default the name is ``attribute``. Bounds that reach beyond what
            bodies can be (masses, moments of inertia and sizes <= 0, damping, armature and friction
            < 0) are refused. Values between them that make no body together, as moments of inertia
            of which one exceeds the sum of the others do, are refused as a start; a search finds
            none of them good.
        """
        if not isinstance(attribute, str):
            raise TypeError(f"attribute must be a string, got {attribute!r}")
        names = _elements("elements", elements)
        if index is None and _UNLIKE_COLUMNS.fullmatch(attribute):
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
            apply=setters.model_setter(attribute, names, _columns(index)),
            changes_model=True,
        )
        try:
            check_bounds(attribute, ", ".join(f"'{e}'" for e in names), parameter.bounds)
        except ValueError as error:
            raise ValueError(f"parameter '{parameter.name}': {error}") from None
        return parameter

    @classmethod
    def delay(
        cls,
        channel: str,
        *,
        bounds: tuple[float, float],
        start: float = 0.0,
        name: str | None = None,
        per: Groups | None = None,
    ) -> Parameter:
        """Estimate by how much a recorder is late, s.

        Parameters
        ----------
        channel
            Name of a sensor, ``"poses"``, or a kind of events, as ``"impact"``.
        bounds
            (lower, upper), s. Readings at times before the upper one do not count: what they show
            comes before the start. Simulations go on beyond the end by a lower one < 0.
        start, name, per
            As in `Parameter`. By default the name is ``delay of CHANNEL``.

        Example
        -------
        A load cell that may be up to 50 ms late beside a camera::

            Parameter.delay("load", bounds=(-0.01, 0.05))
        """
        return cls._of_sensing("delay", channel, start, bounds, name, per, "linear")

    @classmethod
    def gain(
        cls,
        channel: str,
        *,
        bounds: tuple[float, float],
        start: float = 1.0,
        name: str | None = None,
        per: Groups | None = None,
    ) -> Parameter:
        """Estimate the gain of a sensor, or of a scalar: its reading is so many times the true one.

        Parameters as in `delay`; `bounds` > 0.
        """
        return cls._of_sensing("gain", channel, start, bounds, name, per, "log")

    @classmethod
    def offset(
        cls,
        channel: str,
        *,
        bounds: tuple[float, float],
        start: float = 0.0,
        name: str | None = None,
        per: Groups | None = None,
    ) -> Parameter:
        """Estimate what a sensor, or a scalar, reads where the true reading is 0, in its unit.

        Parameters as in `delay`. Of sensors of several numbers all have the same.
        """
        return cls._of_sensing("offset", channel, start, bounds, name, per, "linear")

    @classmethod
    def scale(
        cls,
        *,
        bounds: tuple[float, float],
        start: float = 1.0,
        centre: Sequence[float] = (0.0, 0.0, 0.0),
        name: str | None = None,
        per: Groups | None = None,
    ) -> Parameter:
        """Estimate the scale of measured positions: they are so many times the true ones.

        Parameters
        ----------
        centre
            (3,) the point that is measured rightly, world, m: the optical axis of a camera.
        bounds, start, name, per
            As in `delay`; `bounds` > 0. By default the name is ``scale of poses``.
        """
        point = number_array("centre", centre)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise ValueError(f"centre must be three finite numbers, got {centre!r}")
        x, y, z = (float(entry) for entry in point)
        return cls._of_sensing("scale", POSES, start, bounds, name, per, "log", (x, y, z))

    @classmethod
    def image(
        cls,
        quantity: ImageQuantity,
        camera: str = "image",
        *,
        bounds: tuple[float, float],
        start: float | None = None,
        name: str | None = None,
        per: Groups | None = None,
    ) -> Parameter:
        """Estimate a number of a picture in which points are seen (``Trajectory(pixels=...)``).

        Parameters
        ----------
        quantity
            ``"scale"``: pixels per metre of an `ImagePlane`, of a camera of the model its focal
            length in pixels; ``"tilt"``: rad, clockwise; ``"origin_u"``, ``"origin_v"``: the pixel
            where the origin of the world is seen, of a camera of the model the middle.
            Where a camera stands and looks `model` varies: ``cam_pos``, ``cam_fovy`` ...
        camera
            Name of the camera, or of the `ImagePlane`.
        bounds
            (lower, upper); of a scale > 0.
        start, name, per
            As in `Parameter`. By default the start is in the middle of the bounds, the name
            ``scale of image``.
        """
        if quantity not in get_args(ImageQuantity):
            raise ValueError(
                f"quantity of a picture must be one of {', '.join(get_args(ImageQuantity))}, got "
                f"{quantity!r}"
            )
        scale = quantity == "scale"
        if start is None and np.shape(bounds) == (2,):
            start = middle(bounds, logarithmic=scale)
        transform: TransformName = "log" if scale else "linear"
        return cls._of_sensing(quantity, camera, start, bounds, name, per, transform)  # type: ignore[arg-type]

    @classmethod
    def _of_sensing(
        cls,
        quantity: SensingQuantity,
        channel: str,
        start: float,
        bounds: tuple[float, float],
        name: str | None,
        per: Groups | None,
        transform: TransformName,
        centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> Parameter:
        if not isinstance(channel, str):
            raise TypeError(f"channel must be a name, got {channel!r}")
        return cls(
            name=f"{quantity} of {channel}" if name is None else name,
            start=start,
            bounds=bounds,
            transform=transform,
            per=per,
            apply=SensingSetter(quantity, channel, centre),
        )

    def _check_material_takes_bounds(self, quantity: str) -> None:
        for bound in self.bounds:
            try:
                setters.with_quantity(Material(1.0), quantity, bound, np.zeros(3))
            except ValueError as error:
                raise ValueError(
                    f"parameter '{self.name}': bounds {self.bounds}: {error}"
                ) from None


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
