"""The inertia of a body as a vector parameter: what it starts from, its bounds, and setting it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NoReturn

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.groups import single_parameters
from dashpot.calibrate.problem.pseudo_inertia import (
    CENTRE,
    MASS,
    NUMBERS,
    SHAPE,
    body_of,
    numbers_of,
    principal,
)
from dashpot.calibrate.problem.setters import System, model_of
from dashpot.calibrate.problem.systems import Builder, own_system
from dashpot.calibrate.problem.vectors import builder_values
from dashpot.object_ids import Element, object_id

if TYPE_CHECKING:
    from dashpot.calibrate.problem.parameters import Parameter

Array = NDArray[np.float64]

UNITS = {"mass": "kg", "size": "m", **dict.fromkeys(CENTRE, "m")}
"""Of the numbers that have one."""
_LOGARITHMIC = ("mass", "size", "stretch x", "stretch y")


@dataclass(frozen=True)
class InertiaSetter:
    """Sets mass, centre and rotational inertia of a body.

    Attributes
    ----------
    body
        Name or id.
    labels
        Which of the ten numbers (`dashpot.calibrate.problem.pseudo_inertia`) it is given.
    model
        All ten of the model, which those that are not given keep.
    moments, quaternion
        (3,) kg m^2 and (4,) of the model's inertia: the axes of the stretches.
    """

    body: Element
    labels: tuple[str, ...]
    model: tuple[float, ...]
    moments: tuple[float, ...]
    quaternion: tuple[float, ...]

    def __post_init__(self) -> None:
        if not set(self.labels) <= set(NUMBERS) or len(set(self.labels)) < len(self.labels):
            raise ValueError(f"labels must be some of {', '.join(NUMBERS)}, got {self.labels}")
        for name, size in (("model", len(NUMBERS)), ("moments", 3), ("quaternion", 4)):
            array = np.array(getattr(self, name))
            if array.shape != (size,) or not np.isfinite(array).all():
                raise ValueError(f"{name} must be {size} finite numbers, got {array}")
        positive = [self.model[NUMBERS.index(name)] for name in _LOGARITHMIC]
        if min(positive + list(self.moments)) <= 0.0:
            raise ValueError("mass, size, stretches and moments must be > 0")

    def __call__(self, system: System, values: Array) -> None:
        """Set them in the model, or the model of an engine."""
        model = model_of(system)
        body = object_id(model, self.body, "body", "body")
        numbers = self.numbers(values)
        mass, centre, inertia = body_of(numbers, self.axes)
        model.body_mass[body] = mass
        model.body_inertia[body] = np.array(self.moments) * (mass / self.model[0])
        if CENTRE[0] in self.labels:
            model.body_ipos[body] = centre
        if SHAPE[0] in self.labels:
            model.body_inertia[body], axes = principal(inertia)
            mujoco.mju_mat2Quat(model.body_iquat[body], axes.reshape(-1))

    def numbers(self, values: Array) -> Array:
        """Return all ten numbers of a body (10,), for `values` of those that are given."""
        numbers = np.array(self.model)
        numbers[[NUMBERS.index(label) for label in self.labels]] = values
        return numbers

    @property
    def axes(self) -> Array:
        """(3, 3) the axes of the model's inertia in the frame of the body, as columns."""
        axes = np.empty(9)
        mujoco.mju_quat2Mat(axes, np.array(self.quaternion))
        return axes.reshape(3, 3)

    def targets(self, model: mujoco.MjModel) -> tuple[str, ...]:
        """Return what it sets in a model, in words, as setters of single arrays do."""
        body = object_id(model, self.body, "body", "body")
        name = model.body(body).name
        label = f"'{name}'" if name else str(body)
        columns = [f"body_inertia of {label}[{i}]" for i in range(3)]
        if CENTRE[0] in self.labels:
            columns += [f"body_ipos of {label}[{i}]" for i in range(3)]
        if SHAPE[0] in self.labels:
            columns += [f"body_iquat of {label}[{i}]" for i in range(4)]
        return (f"body_mass of {label}", *columns)


@dataclass(frozen=True)
class InertiaRange:
    """How far the inertia of a body may be from that of the model, of which a problem tells more.

    Attributes
    ----------
    body
        Name or id.
    mass
        (lower, upper), kg; None: it is held.
    centre
        How far it may be along each axis, m; None: as far as mass spreads; 0: it stays.
    shape
        Factor by which sizes and stretches may differ; None: it stays.
    """

    body: Element
    mass: tuple[float, float] | None
    centre: float | None
    shape: float | None

    def __call__(self, system: System, value: float) -> NoReturn:
        """Raise ValueError: it is not known yet from where it starts."""
        raise ValueError("the inertia of a body is set by the parameters that a Problem makes")

    def around(self, parameter: Parameter, model: mujoco.MjModel) -> Parameter:
        """Return the vector that starts from the inertia of a model."""
        label = f"parameter '{parameter.name}'"
        body = object_id(model, self.body, "body", label)
        mass, moments = float(model.body_mass[body]), np.array(model.body_inertia[body])
        if not (mass > 0.0 and (moments > 0.0).all()):
            raise ValueError(f"{label}: the model's body has no mass or no inertia to start from")
        moves = self.centre != 0.0 or self.shape is not None
        if moves and model.body_simple[body]:
            raise ValueError(
                f"{label}: MuJoCo compiled the body as simple, with axes that stay; give it "
                'simple="false" in the MJCF'
            )
        numbers = numbers_of(mass, np.array(model.body_ipos[body]), moments)
        spread = numbers[4] * np.array([*numbers[5:7], 1.0 / (numbers[5] * numbers[6])])
        labels = MASS + (CENTRE if self.centre != 0.0 else ()) + (SHAPE if self.shape else ())
        ends = []
        for name in labels:
            now = float(numbers[NUMBERS.index(name)])
            if name == "mass":
                ends.append((0.5 * mass, 2.0 * mass) if self.mass is None else self.mass)
            elif name in CENTRE:
                reach = float(spread.max()) if self.centre is None else self.centre
                ends.append((now - reach, now + reach))
            else:
                assert self.shape is not None
                lean = 0.5 * (self.shape - 1.0 / self.shape)
                scaled = (now / self.shape, now * self.shape)
                ends.append(scaled if name in _LOGARITHMIC else (now - lean, now + lean))
        chosen = [float(numbers[NUMBERS.index(name)]) for name in labels]
        held = [parameter.frozen or (name == "mass" and self.mass is None) for name in labels]
        fields: dict[str, Any] = {
            "start": tuple(chosen),
            "bounds": tuple(ends),
            "transform": tuple("log" if n in _LOGARITHMIC else "linear" for n in labels),
            "frozen": tuple(held),
            "apply": InertiaSetter(
                self.body,
                labels,
                tuple(map(float, numbers)),
                tuple(map(float, moments)),
                tuple(map(float, model.body_iquat[body])),
            ),
        }
        return dataclasses.replace(parameter, **fields)


def with_inertia(
    parameters: Sequence[Parameter], trajectories: Sequence[str], system: System | Builder
) -> tuple[Parameter, ...]:
    """Return parameters with those of inertia started from the model of the first trajectory."""
    if not any(isinstance(p.apply, InertiaRange) for p in parameters):
        return tuple(parameters)
    others = [p for p in parameters if not isinstance(p.apply, InertiaRange)]
    first = [p for p in single_parameters(others, trajectories) if p.acts_in(trajectories[0])]
    values = builder_values(first, {p.name: p.start for p in first})
    model = model_of(own_system(system, values))
    return tuple(
        p.apply.around(p, model) if isinstance(p.apply, InertiaRange) else p for p in parameters
    )
