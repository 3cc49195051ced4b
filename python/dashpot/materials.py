"""Contact materials in SI units and the rules by which two of them make one contact."""

from __future__ import annotations

import difflib
import math
import numbers
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dashpot import _core, hertz
from dashpot.checks import number, positive_number
from dashpot.known_materials import KnownMaterial, Quantity, known

__all__ = ["CombinationRules", "KnownMaterial", "Material", "Quantity", "known"]


def _number(
    owner: str, field: str, value: object, *, positive: bool = False, upper: float = math.inf
) -> float:
    """Return `value` as a finite float in [0, upper] (above 0 if `positive`), or raise."""
    result = number(f"{owner}: {field}", value)
    if upper < math.inf:
        if not 0.0 <= result <= upper:
            raise ValueError(f"{owner}: {field} must be in [0, {upper:g}], got {value!r}")
    elif not math.isfinite(result) or result < 0.0 or (positive and result == 0.0):
        sign = "positive" if positive else "non-negative"
        raise ValueError(f"{owner}: {field} must be finite and {sign}, got {value!r}")
    return result


@dataclass(frozen=True)
class Material:
    """What a geom, or a pair of geoms, fixes of a Kelvin-Voigt contact with friction.

    Give at most one of `damping`, `damping_ratio` and `restitution`; without any the contact is
    critically damped (damping ratio 1). Rigid contacts are as stiff as micro-steps resolve first,
    and as damped as these resolve then. Alone they have their damping ratio. Several at one body
    may have less: a box that falls flat on a rigid floor rebounds at 0.13 to 0.25. Where a
    `restitution` asks for more, stiffness gives way, as far as weights do not press bodies in
    visibly.

    Contacts combine the materials of both geoms by the engine's `CombinationRules`. By default the
    larger friction counts, as in MuJoCo, and geoms without one keep that of the MJCF (sliding 1 if
    it says nothing). Lower friction has to be set for both geoms, or for the pair. Where neither
    material names friction, rules for it have no effect.

    Parameters
    ----------
    stiffness : float or None
        Contact stiffness k, N/m, > 0. None means rigid: as stiff as the micro-step resolves.
    damping : float, optional
        Damping d, N s/m, >= 0; one above 0 needs a stiffness. What a spring and a damper return of
        a bounce goes by both, and a rigid contact is as stiff as the time step has it. 5 N s/m
        would leave 1 kg all of its speed, 5000 N s/m four fifths or a seventh, by the step. Rigid
        contacts take a `damping_ratio` or a `restitution`.
    damping_ratio : float, optional
        ``d / (2 sqrt(k m))`` with the apparent mass m of the contact, >= 0. Contacts of one pair
        of geoms that are pressed together have it together: m is that of their common vibration.
    restitution : float, optional
        Ratio of rebound to approach speed in [0, 1], exact for an unloaded contact that releases
        when its force reaches zero. A body that lands flat rebounds with it to what micro-steps
        resolve (rigid boxes at 0.48 to 0.5 for 0.5, at 0.46 with steps of 10 ms). 0 means as much
        damping as the micro-step resolves. Rigid contacts have a damping ratio of 3 then, and of 5
        along the surface while they are hit, so that what lands off-centre stays where it lands.
        They rebound at 0.02, flat ones with steps of 10 ms at up to 0.1. With a stiffness, 0 is not
        the limit of small restitution where there is friction. Springs of friction are then damped
        as much as the normal (see `tangential_damping_ratio`), so that friction acts within the
        impact. What slides loses as much speed as with 0.02 to 0.03. With less than 0.01 the force
        of an impact is over before friction has grown, and it loses less.
    friction : float or (sliding, torsional, rolling), optional
        Friction coefficients, >= 0: sliding (dimensionless), torsional (m), rolling (m). A single
        number sets sliding only and leaves the other two as the MJCF says; None leaves all three.
        Which of them act is up to the ``condim`` of the contact, the larger of the geoms' or that
        of the higher priority. Sliding acts from 3 on (MuJoCo's default), torsional from 4 on,
        rolling at 6. The others have no effect.
    loaded_friction : float
        Share s of the friction coefficients that is left under heavy load, in (0, 1]; 1 for
        friction that does not depend on load. At a normal force f coefficients count
        ``s + (1 - s) / (1 + f / friction_load)`` times: surfaces that adhere lightly, or plastics,
        rub less per newton in an impact than when they slide at rest weight. Friction itself still
        grows with load.
    friction_load : float
        Normal force at one contact point, N, > 0, at which half of that loss is reached.
    tangential_ratio : float
        Tangential over normal stiffness, > 0. Of rigid contacts only while they, or contacts of
        the same few bodies, are hit; else both are as stiff as micro-steps resolve.
    tangential_damping_ratio : float
        Damping ratio of the friction springs, >= 0, at the mean inverse mass along the surface.
        With a stiffness and restitution 0 they have fifty times as much, as the normal has, whose
        force is over as soon. Rigid contacts with less than 0.135 have, while they are hit, up to
        five times as much.

    Raises
    ------
    TypeError
        A field is not a number.
    ValueError
        A field is outside its range, more than one form of damping is given, or a damping in
        N s/m without a stiffness.

    Examples
    --------
    >>> rubber = dashpot.Material(stiffness=1e5, restitution=0.8)
    >>> engine = dashpot.Engine(model)
    >>> engine.set_material("ball", rubber)
    >>> engine.material("ball").stiffness
    100000.0
    """

    stiffness: float | None = None
    _: KW_ONLY
    damping: float | None = None
    damping_ratio: float | None = None
    restitution: float | None = None
    friction: float | tuple[float, float, float] | None = None
    loaded_friction: float = 1.0
    friction_load: float = 10.0
    tangential_ratio: float = 1.0
    tangential_damping_ratio: float = 1.0

    if TYPE_CHECKING:
        # What is taken, which is more than the types that fields have in the end.
        def __init__(
            self,
            stiffness: float | None = None,
            *,
            damping: float | None = None,
            damping_ratio: float | None = None,
            restitution: float | None = None,
            friction: float | Sequence[float] | NDArray[np.float64] | None = None,
            loaded_friction: float = 1.0,
            friction_load: float = 10.0,
            tangential_ratio: float = 1.0,
            tangential_damping_ratio: float = 1.0,
        ) -> None: ...

    def __post_init__(self) -> None:
        def normalise(field: str, value: object) -> None:
            object.__setattr__(self, field, value)

        if self.stiffness is not None:
            normalise("stiffness", _number("Material", "stiffness", self.stiffness, positive=True))
        given = {
            field: getattr(self, field)
            for field in ("damping", "damping_ratio", "restitution")
            if getattr(self, field) is not None
        }
        if len(given) > 1:
            listed = ", ".join(f"{field}={value!r}" for field, value in given.items())
            raise ValueError(
                f"Material: give at most one of damping, damping_ratio, restitution, got {listed}"
            )
        for field, value in given.items():
            upper = 1.0 if field == "restitution" else math.inf
            normalise(field, _number("Material", field, value, upper=upper))
        if self.damping and self.stiffness is None:
            raise ValueError(
                f"Material: damping = {self.damping:g} N s/m needs a stiffness. Without one the "
                "contact is as stiff as the time step resolves, and what it returns of a bounce "
                "would go by the step. Give a stiffness too, or a damping_ratio or restitution "
                "in place of the damping"
            )
        if self.friction is not None:
            normalise("friction", _friction(self.friction))
        share = _number("Material", "loaded_friction", self.loaded_friction, upper=1.0)
        if share == 0.0:
            raise ValueError(
                f"Material: loaded_friction must be above 0, got {self.loaded_friction!r}"
            )
        normalise("loaded_friction", share)
        normalise(
            "friction_load", _number("Material", "friction_load", self.friction_load, positive=True)
        )
        normalise(
            "tangential_ratio",
            _number("Material", "tangential_ratio", self.tangential_ratio, positive=True),
        )
        normalise(
            "tangential_damping_ratio",
            _number("Material", "tangential_damping_ratio", self.tangential_damping_ratio),
        )

    @classmethod
    def from_elasticity(
        cls,
        youngs_moduli: Sequence[float],
        poisson_ratios: Sequence[float],
        radii: Sequence[float],
        *,
        load: float | None = None,
        speed: float | None = None,
        mass: float | None = None,
        **fields: Any,
    ) -> Material:
        """Return the material of a pair of elastic bodies, for `Engine.set_pair_material`.

        Bodies that touch at a point are stiffer the harder they are pressed together (Hertz:
        Johnson, Contact Mechanics, 1985, sections 4.2 and 11.4). The force is ``F = 4/3 E* sqrt(R)
        delta^1.5``, of their approach delta, with ``1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2`` and
        ``1/R = 1/R1 + 1/R2``. A `Material` has one stiffness, which is right at one load or for one
        impact:

        * with `load`, the slope ``dF/d(delta) = (6 R E*^2 F)^(1/3)`` there: vibrations about the
          load are right, the approach itself is two thirds of Hertz's;
        * with `speed` and `mass`, that of a spring that the impact compresses as far, by
          ``delta = (15/16 m v^2 / (sqrt(R) E*))^0.4``: it takes 7 % longer, at a peak force that is
          a fifth lower. Eight times the load has twice the stiffness, 32 times the speed four
          times.

        It holds while the circle of contact, of radius ``sqrt(R delta)``, is small beside radii and
        thicknesses (a tenth: errors of some per cent). Surfaces have to be smooth and not to stick,
        and bodies to be isotropic and not to yield. Metals yield early: where the peak pressure ``2
        E*/pi sqrt(delta/R)`` is 1.6 times the yield strength (Johnson, section 6.1). Impacts have
        to be slow beside waves in the bodies. Contacts of flat sides have no such law.

        Parameters
        ----------
        youngs_moduli : (E1, E2)
            Young's moduli of the bodies, Pa, > 0; infinite for a rigid body. `known` has some.
        poisson_ratios : (nu1, nu2)
            Poisson's ratios, above -1 and at most 0.5.
        radii : (R1, R2)
            Radii at the point of contact, m: infinite for a plane, negative for a hollow. Cylinders
            crossed at right angles are a sphere of radius ``sqrt(R1 R2)`` on a plane. It holds to
            1, 2 and 5 % of the approach for radii in a ratio of 2, 3 and 5.
        load : float
            Normal force F, N, > 0.
        speed, mass : float
            Speed of approach v, m/s, and mass m, kg, > 0: that of the only body that moves, or
            ``m1 m2 / (m1 + m2)``.
        **fields
            Other fields of the material: one of `damping`, `damping_ratio` and `restitution`,
            `friction` and so on. Elasticity says nothing of them.

        Raises
        ------
        TypeError, ValueError
            For what is out of range, and where not exactly one of `load`, and `speed` with `mass`,
            is given.

        Examples
        --------
        A steel ball of 10 mm on a steel plate, dropped from 5 cm:

        >>> steel = dashpot.materials.known("steel")
        >>> modulus, ratio = steel.youngs_modulus.middle, steel.poisson_ratio.middle
        >>> contact = dashpot.Material.from_elasticity(
        ...     (modulus, modulus), (ratio, ratio), (0.01, math.inf),
        ...     speed=1.0, mass=0.033, restitution=0.9,
        ... )
        >>> f"{contact.stiffness:.2e} N/m"
        '5.70e+07 N/m'
        """
        modulus = hertz.contact_modulus(youngs_moduli, poisson_ratios)
        radius = hertz.effective_radius(radii)
        if (load is None) == (speed is None) or (speed is None) != (mass is None):
            raise ValueError("give either load, or speed and mass")
        if load is not None:
            found = hertz.stiffness_at_load(modulus, radius, positive_number("load", load))
        else:
            found = hertz.stiffness_of_impact(
                modulus, radius, positive_number("speed", speed), positive_number("mass", mass)
            )
        return cls(found, **fields)

    def _to_core(self) -> _core.Material:
        """Return the C++ form; friction left to the MJCF is NaN there."""
        core = _core.Material()
        core.rigid = self.stiffness is None
        core.stiffness = 0.0 if self.stiffness is None else self.stiffness
        if self.damping is not None:
            core.form, core.damping = _core.DampingForm.damping, self.damping
        elif self.restitution is not None:
            core.form, core.damping = _core.DampingForm.restitution, self.restitution
        else:
            core.form = _core.DampingForm.ratio
            core.damping = 1.0 if self.damping_ratio is None else self.damping_ratio
        core.has_friction = self.friction is not None
        if isinstance(self.friction, tuple):
            core.friction = self.friction
        elif self.friction is not None:
            core.friction = (self.friction, math.nan, math.nan)
        else:
            core.friction = (math.nan, math.nan, math.nan)
        core.loaded_friction = self.loaded_friction
        core.friction_load = self.friction_load
        core.tangential_ratio = self.tangential_ratio
        core.tangential_damping_ratio = self.tangential_damping_ratio
        return core


def _friction(value: object) -> float | tuple[float, float, float]:
    if not isinstance(value, Sequence) and hasattr(value, "tolist"):
        value = value.tolist()  # numbers and arrays of numpy
    if isinstance(value, numbers.Real):
        return _number("Material", "friction", value)
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise TypeError(
            f"Material: friction must be a number or (sliding, torsional, rolling), got {value!r}"
        )
    if len(value) != 3:
        raise ValueError(
            "Material: friction must be a number or the three numbers (sliding, torsional, "
            f"rolling), got {len(value)}: {value!r}"
        )
    names = ("friction[0] (sliding)", "friction[1] (torsional)", "friction[2] (rolling)")
    sliding, torsional, rolling = (
        _number("Material", name, entry) for name, entry in zip(names, value, strict=True)
    )
    return sliding, torsional, rolling


@dataclass(frozen=True, kw_only=True)
class CombinationRules:
    """How the materials of two geoms make one contact.

    Parameters
    ----------
    stiffness : {"series", "min", "max", "mean"}
        "series": two springs in series, ``1/k = 1/k1 + 1/k2``. A rigid side has no compliance.
    damping : {"series", "min", "max", "mean"}
        "series": two dampings in N s/m are two dashpots in series, ``d = d1 d2 / (d1 + d2)``. Two
        damping ratios (restitution is turned into one) are averaged with the share of elastic
        energy as weight. Of one each, the ratio part and the N s/m part scaled by their shares add.
        Beside a geom without a material that of the other is taken whole under every rule. So is
        that of a soft side against a rigid one, unless both are in N s/m. "min" and "max" need both
        in the same form.
    friction : {"max", "min", "mean", "geometric_mean"}
        Element by element; "max" is MuJoCo's. It acts where a `Material` of at least one of the two
        geoms names friction, the other's being its own or that of the MJCF. Contacts of geoms
        without such a material have MuJoCo's own friction, whatever the rule. Sliding friction
        under heavy load combines by the same rule, and the load at which it falls is the mean of
        both, by how much of it each loses.

    Raises
    ------
    ValueError
        Unknown rule; the message lists the known ones.

    Examples
    --------
    >>> engine = dashpot.Engine(model, rules=dashpot.CombinationRules(friction="min"))
    >>> engine.set_material("ball", dashpot.Material(1e4, friction=0.2))
    >>> contact = engine.contact_material("ball", "floor")
    >>> contact.stiffness, contact.friction[0]
    (10000.0, 0.2)
    """

    stiffness: str = "series"
    damping: str = "series"
    friction: str = "max"

    def __post_init__(self) -> None:
        for field, rules in _RULES.items():
            value = getattr(self, field)
            if not isinstance(value, str):
                raise TypeError(f"CombinationRules: {field} must be a string, got {value!r}")
            if value not in rules.__members__:
                near = difflib.get_close_matches(value, rules.__members__, n=1)
                hint = f"; did you mean {near[0]!r}?" if near else ""
                raise ValueError(
                    f"CombinationRules: {field} must be one of {', '.join(rules.__members__)}, "
                    f"got {value!r}{hint}"
                )

    def _to_core(self) -> _core.CombinationRules:
        core = _core.CombinationRules()
        core.stiffness = _core.StiffnessRule.__members__[self.stiffness]
        core.damping = _core.DampingRule.__members__[self.damping]
        core.friction = _core.FrictionRule.__members__[self.friction]
        return core


_RULES: dict[str, type[_core.StiffnessRule | _core.DampingRule | _core.FrictionRule]] = {
    "stiffness": _core.StiffnessRule,
    "damping": _core.DampingRule,
    "friction": _core.FrictionRule,
}
