"""What calibration may vary: contact material, pair material, properties of the model."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, get_args

from dashpot.calibrate.problem.groups import checked_groups
from dashpot.calibrate.problem.material_parameters import MaterialField, MaterialParameters
from dashpot.calibrate.problem.model_parameters import ModelParameters
from dashpot.calibrate.problem.parameter_options import Bounds, Frozen, Groups, Start, Transforms
from dashpot.calibrate.problem.recorder_parameters import RecorderParameters
from dashpot.calibrate.problem.setters import System
from dashpot.calibrate.problem.transforms import Transform, TransformName
from dashpot.calibrate.problem.vectors import components, is_vector, vector_fields
from dashpot.checks import flag, number, number_array

__all__ = ["Groups", "MaterialField", "Parameter"]

_TRANSFORMS: tuple[str, ...] = get_args(TransformName)


@dataclass(frozen=True)
class Parameter(MaterialParameters, ModelParameters, RecorderParameters):
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
        trajectories are only piecewise smooth. A much smaller step resolves the rounding and the
        micro-step switches of a bounce instead of the trend that the fit needs. The default 1e-4 is
        0.01 % of the value (log) or of the range (linear).
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

    Examples
    --------
    >>> gravity = Parameter(
    ...     "gravity", start=9.0, bounds=(8.0, 11.0), changes_model=False,
    ...     apply=lambda engine, value: engine.model.opt.gravity.__setitem__(2, -value),
    ... )
    >>> gravity.transform
    'log'
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
        """Whether it acts in the trajectory of this name.

        Examples
        --------
        >>> unknown[0].acts_in("throw")
        True
        """
        return self.trajectories is None or trajectory in self.trajectories

    @property
    def coordinate(self) -> Transform:
        """The map between the parameter and its search coordinate."""
        return Transform(self.transform, *self.bounds)
