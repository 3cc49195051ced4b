"""Options of an engine and their checks."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Literal

from dashpot import _core
from dashpot.checks import number, positive_count
from dashpot.materials import CombinationRules

# Numbers that are defaults here are those of the C++ core.
_CORE = _core.Options()
_RULES = CombinationRules()

_KELVIN_VOIGT_OPTIONS = (
    "microsteps",
    "max_microsteps",
    "recovery_speed",
    "mocap_timeconst",
    "impact",
    "rules",
)
_COMFREE_OPTIONS = ("comfree_stiffness", "comfree_damping")


@dataclass(frozen=True, kw_only=True)
class EngineOptions:
    """Validated options of an engine, with their defaults."""

    law: str = "kelvin_voigt"
    microsteps: int | Literal["auto"] = "auto"
    max_microsteps: int = _CORE.max_microsteps
    recovery_speed: float = _CORE.recovery_speed
    mocap_timeconst: float = _CORE.mocap_timeconst
    impact: Literal["none", "cut"] = "none"
    rules: CombinationRules = _RULES
    comfree_stiffness: float | None = None  # None: the core's
    comfree_damping: float | None = None

    def __post_init__(self) -> None:
        laws = list(_core.Law.__members__)
        if self.law not in laws:
            raise ValueError(f"law is {self.law!r}; it must be one of {laws}")
        self._check_owner()
        for name, lowest in (("comfree_stiffness", "> 0"), ("comfree_damping", ">= 0")):
            value = getattr(self, name)
            if value is None:
                continue
            constant = number(name, value)
            if not math.isfinite(constant) or constant < 0.0 or (not constant and lowest == "> 0"):
                raise ValueError(f"{name} is {value!r}; it must be finite and {lowest}")
        most = positive_count("max_microsteps", self.max_microsteps)
        if not isinstance(self.microsteps, str):
            fixed = positive_count('microsteps other than "auto"', self.microsteps)
            if fixed > most:
                raise ValueError(f"microsteps is {fixed}, more than max_microsteps, {most}")
        elif self.microsteps != "auto":
            raise ValueError(f'microsteps is {self.microsteps!r}; it must be "auto" or an integer')
        if not number("recovery_speed", self.recovery_speed) >= 0.0:
            raise ValueError(
                f"recovery_speed is {self.recovery_speed!r}; it must be >= 0 m/s (inf allowed)"
            )
        if not 0.0 <= number("mocap_timeconst", self.mocap_timeconst) < math.inf:
            raise ValueError(
                f"mocap_timeconst is {self.mocap_timeconst!r}; it must be finite and >= 0 s"
            )
        impacts = list(_core.Impact.__members__)
        if self.impact not in impacts:
            raise ValueError(f"impact is {self.impact!r}; it must be one of {impacts}")
        if not isinstance(self.rules, CombinationRules):
            raise TypeError(f"rules is {type(self.rules).__name__}; it must be CombinationRules")

    def _check_owner(self) -> None:
        """Raise ValueError for an option of another law than the one chosen."""
        owned = {"kelvin_voigt": _KELVIN_VOIGT_OPTIONS, "comfree": _COMFREE_OPTIONS}
        for owner, names in owned.items():
            for name in names:
                value = getattr(self, name)
                if owner != self.law and value != getattr(EngineOptions, name):
                    raise ValueError(
                        f"{name} is {value!r}, but only law {owner!r} has it; law is {self.law!r}"
                    )

    def changed(self) -> dict[str, object]:
        """Return the options that are not the defaults, but for the law."""
        options = {field.name: getattr(self, field.name) for field in fields(self)}
        return {
            name: value
            for name, value in options.items()
            if name != "law" and value != getattr(EngineOptions, name)
        }

    def to_core(self) -> _core.Options:
        """Options for the C++ core."""
        options = _core.Options()
        options.law = _core.Law[self.law]
        options.microsteps = 0 if self.microsteps == "auto" else int(self.microsteps)
        options.max_microsteps = int(self.max_microsteps)
        options.recovery_speed = float(self.recovery_speed)
        options.mocap_timeconst = float(self.mocap_timeconst)
        options.impact = _core.Impact[self.impact]
        options.rules = self.rules._to_core()
        if self.comfree_stiffness is not None:
            options.comfree_stiffness = float(self.comfree_stiffness)
        if self.comfree_damping is not None:
            options.comfree_damping = float(self.comfree_damping)
        return options


class ReadableOptions:
    """The options of an engine, which are fixed when it is made, as properties."""

    __slots__ = ("_options",)
    _options: EngineOptions

    @property
    def law(self) -> str:
        """Name of the contact law."""
        return self._options.law

    @property
    def microsteps(self) -> int | Literal["auto"]:
        """Micro-steps per step, or ``"auto"``."""
        return self._options.microsteps

    @property
    def max_microsteps(self) -> int:
        """Upper bound of the number of micro-steps."""
        return self._options.max_microsteps

    @property
    def recovery_speed(self) -> float:
        """Largest speed in m/s at which overlap that no spring has taken up is pushed out."""
        return self._options.recovery_speed

    @property
    def mocap_timeconst(self) -> float:
        """Time constant in s of mocap bodies, which follow the poses that users set."""
        return self._options.mocap_timeconst

    @property
    def impact(self) -> Literal["none", "cut"]:
        """What a step does at impacts."""
        return self._options.impact

    @property
    def rules(self) -> CombinationRules:
        """How the materials of two geoms combine."""
        return self._options.rules

    @property
    def comfree_stiffness(self) -> float | None:
        """Stiffness of law ``"comfree"`` in 1/s; None with another law."""
        given = self._options.comfree_stiffness
        return _CORE.comfree_stiffness if given is None and self.law == "comfree" else given

    @property
    def comfree_damping(self) -> float | None:
        """Damping of law ``"comfree"``, no unit; None with another law."""
        given = self._options.comfree_damping
        return _CORE.comfree_damping if given is None and self.law == "comfree" else given
