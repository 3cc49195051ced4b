"""Stiffness of the contact of two elastic bodies after Hertz.

K. L. Johnson, Contact Mechanics (Cambridge University Press, 1985): sections 4.2 (static) and 11.4
(impact). With ``1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2`` and ``1/R = 1/R1 + 1/R2`` two bodies that
are pressed together by F approach each other by delta, on a circle of radius a::

    F = 4/3 E* sqrt(R) delta^(3/2),    a^2 = R delta
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from dashpot.checks import number_array


def contact_modulus(youngs_moduli: Sequence[float], poisson_ratios: Sequence[float]) -> float:
    """Return E* (Pa) of two bodies; infinite Young's moduli are rigid ones."""
    moduli = _pair("youngs_moduli", youngs_moduli)
    ratios = _pair("poisson_ratios", poisson_ratios)
    for modulus in moduli:
        if not modulus > 0.0:
            raise ValueError(f"youngs_moduli must be > 0 Pa, got {modulus!r}")
    for ratio in ratios:
        if not -1.0 < ratio <= 0.5:
            raise ValueError(f"poisson_ratios must be above -1 and at most 0.5, got {ratio!r}")
    compliance = sum((1.0 - nu**2) / e for e, nu in zip(moduli, ratios, strict=True))
    if compliance == 0.0:
        raise ValueError(f"one of the youngs_moduli must be finite, got {moduli}")
    return 1.0 / compliance


def effective_radius(radii: Sequence[float]) -> float:
    """Return R (m) of two radii; infinite ones are planes, negative ones hollows."""
    pair = _pair("radii", radii)
    if 0.0 in pair:
        raise ValueError(f"radii must not be 0 m, got {pair}")
    curvature = 1.0 / pair[0] + 1.0 / pair[1]
    if not curvature > 0.0:
        raise ValueError(f"radii must be those of bodies that touch at one point, got {pair}")
    return 1.0 / curvature


def stiffness_at_load(modulus: float, radius: float, load: float) -> float:
    """Return ``dF/d(delta) = (6 R E*^2 F)^(1/3)`` (N/m) at a load F (N)."""
    return float((6.0 * radius * modulus**2 * load) ** (1.0 / 3.0))


def stiffness_of_impact(modulus: float, radius: float, speed: float, mass: float) -> float:
    """Return the stiffness (N/m) of the spring that an impact compresses as far as Hertz's law.

    That is by ``delta = (15/16 m v^2 / (sqrt(R) E*))^(2/5)``, and ``k = m v^2 / delta^2``.
    """
    energy = mass * speed**2
    depth = (0.9375 * energy / (math.sqrt(radius) * modulus)) ** 0.4
    return float(energy / depth**2)


def _pair(argument: str, given: Sequence[float]) -> tuple[float, float]:
    array = number_array(argument, given)
    if array.shape != (2,):
        raise ValueError(f"{argument} must be two numbers, one of each body, got {given!r}")
    return float(array[0]), float(array[1])
