"""Functions that put the value of a parameter into an engine or a MuJoCo model."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import mujoco
import numpy as np

from dashpot.calibrate.problem.physical_values import check_inertia
from dashpot.engine import Engine
from dashpot.materials import Material
from dashpot.object_ids import Element, object_id

System: TypeAlias = Engine | mujoco.MjModel
Setter = Callable[[System, float], None]

FRICTION_INDEX = {"sliding_friction": 0, "torsional_friction": 1, "rolling_friction": 2}
FRICTION = "friction"
"""All three of them, as a vector."""
_DAMPING_FORMS = ("damping", "damping_ratio", "restitution")

# Rows of arrays whose names begin so belong to elements of a kind. A joint has one row of "dof" for
# each of its degrees of freedom.
_KINDS = ("body", "geom", "jnt", "site", "pair", "actuator", "tendon", "cam", "dof")
_NOUN = {"jnt": "joint", "cam": "camera", "dof": "joint"}

_DOF_COUNT = {
    mujoco.mjtJoint.mjJNT_FREE: 6,
    mujoco.mjtJoint.mjJNT_BALL: 3,
    mujoco.mjtJoint.mjJNT_SLIDE: 1,
    mujoco.mjtJoint.mjJNT_HINGE: 1,
}


def model_of(system: System) -> mujoco.MjModel:
    """Return the MuJoCo model that a system steps."""
    return system if isinstance(system, mujoco.MjModel) else system.model


@dataclass(frozen=True)
class MaterialSetter:
    """Sets one quantity of the material of each of some geoms."""

    geoms: tuple[Element, ...]
    quantity: str

    def __call__(self, system: System, value: float) -> None:
        """Set the quantity in an engine."""
        engine = _engine(system, self.quantity)
        for geom in self.geoms:
            mjcf_friction = engine.model.geom_friction[engine.geom_id(geom)]
            material = with_quantity(engine.material(geom), self.quantity, value, mjcf_friction)
            engine._give({geom: material})

    def targets(self, model: mujoco.MjModel) -> tuple[str, ...]:
        """Return what it sets in a model, in words."""
        quantity = kind_of_quantity(self.quantity)
        return tuple(f"{quantity} of geom {_label(model, 'geom', geom)}" for geom in self.geoms)

    def component(self, number: int, count: int) -> MaterialSetter:
        """Return the setter of one of so many numbers: of the triple of friction."""
        return replace(self, quantity=_component_of(self.quantity, number, count))


@dataclass(frozen=True)
class PairSetter:
    """Sets one quantity of the materials of some pairs of geoms."""

    pairs: tuple[tuple[Element, Element], ...]
    quantity: str

    def __call__(self, system: System, value: float) -> None:
        """Set the quantity in an engine."""
        engine = _engine(system, self.quantity)
        for pair in self.pairs:
            material = engine.pair_material(*pair) or Material()
            sliding, _, torsional, rolling, _ = engine.contact_material(*pair).friction
            present = np.array([sliding, torsional, rolling])
            engine.set_pair_material(*pair, with_quantity(material, self.quantity, value, present))

    def targets(self, model: mujoco.MjModel) -> tuple[str, ...]:
        """Return what it sets in a model, in words."""
        quantity = kind_of_quantity(self.quantity)
        found = []
        for pair in self.pairs:
            first, second = sorted(_label(model, "geom", geom) for geom in pair)
            found.append(f"{quantity} of the pair {first}, {second}")
        return tuple(found)

    def component(self, number: int, count: int) -> PairSetter:
        """Return the setter of one of so many numbers: of the triple of friction."""
        return replace(self, quantity=_component_of(self.quantity, number, count))


@dataclass(frozen=True)
class ModelSetter:
    """Sets some rows of a float array of the model, in some columns or all (None)."""

    attribute: str
    elements: tuple[Element, ...]
    columns: tuple[int, ...] | None
    #: How many columns rows have to have; None: any number.
    width: int | None = None

    def __call__(self, system: System, value: float) -> None:
        """Set them in the model, or the model of an engine."""
        model = model_of(system)
        array = _table(_model_array(model, self.attribute))
        columns = self._checked_columns(array.shape[1])
        for element in self.elements:
            rows = _rows(model, self.attribute.split("_")[0], element)
            array[rows, columns] = value
            if self.attribute == "geom_size":
                _update_extent(model, rows.start)

    def check_result(self, system: System) -> None:
        """Raise ValueError where it and others have made what no body is."""
        model = model_of(system)
        if self.attribute == "body_inertia":
            for element in self.elements:
                check_inertia(model, _row(model, "body", element))

    def targets(self, model: mujoco.MjModel) -> tuple[str, ...]:
        """Return what it sets in a model, in words."""
        kind = self.attribute.split("_")[0]
        names = [f"{self.attribute} of {_label(model, kind, e)}" for e in self.elements]
        width = _table(_model_array(model, self.attribute)).shape[1]
        if width == 1:
            return tuple(names)
        columns = self._checked_columns(width)
        return tuple(f"{name}[{column}]" for name in names for column in columns)

    def component(self, number: int, count: int) -> ModelSetter:
        """Return the setter of one of so many columns; ValueError where they are not so many."""
        if self.columns is None:
            return replace(self, columns=(number,), width=count)
        if len(set(self.columns)) != count:
            raise ValueError(f"index names {len(set(self.columns))} columns, and start {count}")
        return replace(self, columns=(self.columns[number],))

    def _checked_columns(self, width: int) -> list[int]:
        """Return the columns that it sets; raise ValueError where rows have no such."""
        if self.width not in (None, width):
            raise ValueError(
                f"rows of {self.attribute} have {width} columns, and there are {self.width} "
                "numbers; say of which: index"
            )
        if self.columns is None:
            return list(range(width))
        absent = [column for column in self.columns if not 0 <= column < width]
        if absent:
            raise ValueError(
                f"index {absent[0]} of {self.attribute} is out of range: its rows have "
                f"{width} column{'s' if width > 1 else ''}"
            )
        return list(self.columns)


def model_setter(
    attribute: str, elements: tuple[Element, ...], columns: tuple[int, ...] | None
) -> Setter:
    """Return a setter of the rows `elements` of a float array of the model."""
    kind = attribute.split("_")[0]
    if kind not in _KINDS:
        raise ValueError(
            f"unknown model attribute {attribute!r}: its name must begin with one of "
            f"{', '.join(f'{k}_' for k in _KINDS)}"
        )
    return ModelSetter(attribute, elements, columns)


def with_quantity(
    material: Material, quantity: str, value: float, present_friction: np.ndarray[Any, Any]
) -> Material:
    """Return `material` with one quantity changed; friction it does not set stays as it is."""
    if quantity in _DAMPING_FORMS:
        forms: dict[str, float | None] = dict.fromkeys(_DAMPING_FORMS, None)
        forms[quantity] = value
        return replace(material, **forms)  # type: ignore[arg-type]
    if quantity in FRICTION_INDEX:
        given = material.friction
        if given is None:
            friction = [float(coefficient) for coefficient in present_friction]
        elif isinstance(given, tuple):
            friction = list(given)
        else:
            friction = [float(given), float(present_friction[1]), float(present_friction[2])]
        friction[FRICTION_INDEX[quantity]] = value
        return replace(material, friction=(friction[0], friction[1], friction[2]))
    return replace(material, **{quantity: value})  # type: ignore[arg-type]


def _component_of(quantity: str, number: int, count: int) -> str:
    """Return what one of so many numbers sets of a quantity; ValueError where it is one number."""
    if quantity != FRICTION or count != len(FRICTION_INDEX):
        size = len(FRICTION_INDEX) if quantity == FRICTION else 1
        raise ValueError(f"{quantity} of a material has {size} numbers, and there are {count}")
    return list(FRICTION_INDEX)[number]


def kind_of_quantity(quantity: str) -> str:
    """Return what a quantity sets: the forms of damping replace each other."""
    return "damping" if quantity in _DAMPING_FORMS else quantity


def _engine(system: System, quantity: str) -> Engine:
    if isinstance(system, mujoco.MjModel):
        raise TypeError(
            f"{quantity} is a material of a dashpot.Engine; the problem was given a mujoco.MjModel"
        )
    return system


def _rows(model: mujoco.MjModel, kind: str, element: Element) -> slice:
    """Return the rows of an element: one, but for the degrees of freedom of a joint."""
    row = _row(model, kind, element)
    if kind != "dof":
        return slice(row, row + 1)
    first = int(model.jnt_dofadr[row])
    return slice(first, first + _DOF_COUNT[mujoco.mjtJoint(model.jnt_type[row])])


def _row(model: mujoco.MjModel, kind: str, element: Element) -> int:
    return object_id(model, element, _NOUN.get(kind, kind), "elements")


def _label(model: mujoco.MjModel, kind: str, element: Element) -> str:
    """Return the name of an element in quotes or, where it has none, its id."""
    row = _row(model, kind, element)
    name = getattr(model, _NOUN.get(kind, kind))(row).name
    return f"'{name}'" if name else str(row)


def _model_array(model: mujoco.MjModel, attribute: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    array = getattr(model, attribute, None)
    if not isinstance(array, np.ndarray) or array.dtype != np.float64:
        known = [
            name
            for name in dir(model)
            if name.split("_")[0] in _KINDS and isinstance(getattr(model, name, None), np.ndarray)
        ]
        near = difflib.get_close_matches(attribute, known)
        raise ValueError(f"the model has no float array {attribute!r}; near: {', '.join(near)}")
    return array


def _table(array: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return a view of an array of the model with columns: one number a row is one column."""
    return array if array.ndim == 2 else array[:, None]


def _update_extent(model: mujoco.MjModel, geom: int) -> None:
    """Recompute bounding radius and box, which the compiler derives from the size."""
    size = model.geom_size[geom]
    kind = mujoco.mjtGeom(model.geom_type[geom])
    body = int(model.geom_bodyid[geom])
    if model.body_geomnum[body] > 1:
        raise ValueError(
            "geom_size can only be varied for a geom alone on its body (bounding volumes are "
            "compiled); give Problem a function that builds the model instead"
        )
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        half = np.full(3, size[0])
        radius = size[0]
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        half = np.array([size[0], size[0], size[0] + size[1]])
        radius = size[0] + size[1]
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        half = np.array([size[0], size[0], size[1]])
        radius = np.hypot(size[0], size[1])
    elif kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        half = size.copy()
        radius = size.max()
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        half = size.copy()
        radius = np.linalg.norm(size)
    else:
        raise ValueError(f"geom_size of a {kind.name[len('mjGEOM_') :].lower()} cannot be varied")
    model.geom_rbound[geom] = radius
    model.geom_aabb[geom] = np.concatenate([np.zeros(3), half])
    leaf = int(model.body_bvhadr[body])
    if model.body_bvhnum[body] == 1:
        # The tree's box is in the frame of the body's inertia; a sphere around the geom is safe.
        model.bvh_aabb[leaf, 3:] = radius
