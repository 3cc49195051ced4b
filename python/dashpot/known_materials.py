"""Elastic constants and densities of some materials, each number with its source.

They are for estimates where nothing was measured, with `dashpot.Material.from_elasticity`. Numbers
without a source that can be looked up are left out, and so are friction and restitution, which
belong to two surfaces and an impact rather than to a material.
"""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass

CALLISTER = (
    "Callister and Rethwisch, Fundamentals of Materials Science and Engineering, "
    "3rd edition, 2008, appendix B"
)
DOWLING = "Dowling, Mechanical Behavior of Materials, table 5.2 (elastic constants)"
GERE = "Gere, Mechanics of Materials, 5th edition, 2001, appendix H"
DATA_BOOK = "Cambridge University Engineering Department, Materials Data Book, 2003"
WOOD_HANDBOOK = "Forest Products Laboratory, Wood Handbook, FPL-GTR-190, 2010"


@dataclass(frozen=True)
class Quantity:
    """An interval of a quantity in SI units, and where it is from.

    Attributes
    ----------
    low, high
        Ends of the interval; equal where the source has one number.
    source
        Book, paper or standard, with the table or page.

    Examples
    --------
    >>> modulus = dashpot.materials.known("steel").youngs_modulus
    >>> modulus.low, modulus.high, modulus.middle
    (190000000000.0, 210000000000.0, 200000000000.0)
    """

    low: float
    high: float
    source: str

    @property
    def middle(self) -> float:
        """Mean of the ends, of those that differ by a factor of two and more the geometric one."""
        if 0.0 < 2.0 * self.low <= self.high:
            return math.sqrt(self.low * self.high)
        return 0.5 * (self.low + self.high)


@dataclass(frozen=True, kw_only=True)
class KnownMaterial:
    """What is known of a material; None where no source was found.

    Attributes
    ----------
    name
        As `known` takes it.
    description
        What the numbers are of, and what to mind.
    youngs_modulus
        Pa.
    poisson_ratio
        No unit.
    density
        kg/m^3.

    Examples
    --------
    >>> wood = dashpot.materials.known("wood along")
    >>> wood.name, wood.poisson_ratio.low
    ('wood along', 0.292)
    """

    name: str
    description: str
    youngs_modulus: Quantity
    poisson_ratio: Quantity | None = None
    density: Quantity | None = None


def known(name: str) -> KnownMaterial:
    """Return what is known of a material.

    Parameters
    ----------
    name
        ``"steel"``, ``"aluminium"``, ``"wood along"`` or ``"wood across"`` (the grain), ``"ABS"``,
        ``"silicone rubber"``, ``"nitrile rubber"``, ``"foam"``, ``"skin"`` or ``"concrete"``.

    Raises
    ------
    ValueError
        For other names; the message lists these.

    Examples
    --------
    >>> dashpot.materials.known("steel").youngs_modulus
    Quantity(low=190000000000.0, high=210000000000.0, source='Gere, ... table H-2')
    """
    if name in _BY_NAME:
        return _BY_NAME[name]
    near = difflib.get_close_matches(str(name), _BY_NAME, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise ValueError(f"no material {name!r} is known; there are {', '.join(_BY_NAME)}{hint}")


_MATERIALS = (
    KnownMaterial(
        name="steel",
        description="Steels in general.",
        youngs_modulus=Quantity(190e9, 210e9, f"{GERE}, table H-2"),
        poisson_ratio=Quantity(0.27, 0.30, f"{GERE}, table H-2"),
        density=Quantity(7850.0, 7850.0, f"{GERE}, table H-1"),
    ),
    KnownMaterial(
        name="aluminium",
        description="Aluminium alloys.",
        youngs_modulus=Quantity(70e9, 79e9, f"{GERE}, table H-2"),
        poisson_ratio=Quantity(0.33, 0.33, f"{GERE}, table H-2"),
        density=Quantity(2600.0, 2800.0, f"{GERE}, table H-1"),
    ),
    KnownMaterial(
        name="wood along",
        description="Douglas fir and red oak at 12 % moisture, bent along the grain. Wood is not "
        "isotropic: Hertz's law gives an order of magnitude.",
        youngs_modulus=Quantity(10.8e9, 14.1e9, f"{CALLISTER}, table B.2, p. 807"),
        poisson_ratio=Quantity(0.292, 0.449, f"{WOOD_HANDBOOK}, table 5-2 (LR, LT)"),
        density=Quantity(460.0, 670.0, f"{CALLISTER}, table B.1, p. 804"),
    ),
    KnownMaterial(
        name="wood across",
        description="Douglas fir and red oak at 12 % moisture, bent across the grain, as a table "
        "is pressed. Wood is not isotropic: Hertz's law gives an order of magnitude.",
        youngs_modulus=Quantity(0.54e9, 0.71e9, f"{CALLISTER}, table B.2, p. 807"),
        density=Quantity(460.0, 670.0, f"{CALLISTER}, table B.1, p. 804"),
    ),
    KnownMaterial(
        name="ABS",
        description="Acrylonitrile butadiene styrene; printed parts with gaps are softer. "
        "Poisson's ratio of a grade of medium impact strength.",
        youngs_modulus=Quantity(1.1e9, 2.9e9, f"{DATA_BOOK}, p. 11"),
        poisson_ratio=Quantity(0.35, 0.35, DOWLING),
        density=Quantity(1010.0, 1210.0, f"{DATA_BOOK}, p. 10"),
    ),
    KnownMaterial(
        name="silicone rubber",
        description="Polydimethylsiloxane Sylgard 184, stretched, by the temperature of curing. "
        "Filled silicones are stiffer. Poisson's ratio of rubber in general.",
        youngs_modulus=Quantity(
            1.32e6,
            2.97e6,
            "Johnston et al., doi:10.1088/0960-1317/24/3/035017, abstract",
        ),
        poisson_ratio=Quantity(0.45, 0.50, f"{GERE}, table H-2 (rubber)"),
    ),
    KnownMaterial(
        name="nitrile rubber",
        description="Butadiene-acrylonitrile, stress over strain when stretched to twice the "
        "length; small strains are stiffer. Poisson's ratio of rubber in general.",
        youngs_modulus=Quantity(3.4e6, 3.4e6, f"{CALLISTER}, table B.2, p. 806"),
        poisson_ratio=Quantity(0.45, 0.50, f"{GERE}, table H-2 (rubber)"),
    ),
    KnownMaterial(
        name="foam",
        description="Flexible polymer foam of low density. Poisson's ratio of flexible "
        "polyurethane foam, from 66 to 5 % of compression; cells buckle, and Hertz's law holds "
        "for some per cent of compression at most.",
        youngs_modulus=Quantity(1e6, 3e6, f"{DATA_BOOK}, p. 11"),
        poisson_ratio=Quantity(
            -0.05, 0.5, "Widdle, Bajaj and Davies, doi:10.1016/j.ijengsci.2007.09.002, abstract"
        ),
        density=Quantity(38.0, 70.0, f"{DATA_BOOK}, p. 10"),
    ),
    KnownMaterial(
        name="skin",
        description="Human skin by all methods, living and excised: pressed, sucked, twisted and "
        "stretched. Layers beneath count, so that a number for one's own case has to be measured.",
        youngs_modulus=Quantity(
            5e3,
            140e6,
            "Kalra, Lowe and Al-Jumaily, J. Material Sci. Eng. 5 (2016) 1000254, abstract",
        ),
    ),
    KnownMaterial(
        name="concrete",
        description="Concretes C12/15 to C90/105 with quartzite aggregate, secant up to 40 % of "
        "the strength, uncracked.",
        youngs_modulus=Quantity(27e9, 44e9, "EN 1992-1-1:2004, table 3.1"),
        poisson_ratio=Quantity(0.2, 0.2, "EN 1992-1-1:2004, 3.1.3(4)"),
        density=Quantity(2300.0, 2300.0, f"{GERE}, table H-1 (plain)"),
    ),
)
_BY_NAME = {material.name: material for material in _MATERIALS}
