"""What an arm holds against a workpiece: a ball nose, a disc, or a tool of the user's own."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.checks import number, positive_count, positive_number

__all__ = ["BallNose", "Disc", "OwnTool", "Tool"]

Array = NDArray[np.float64]

BODY, TIP = "body", "tip"
"""Names of the body of every tool, and of the site at its working end, whose z points outwards."""


@runtime_checkable
class Tool(Protocol):
    """A tool: a body at the flange whose geoms touch the workpiece side by side.

    Examples
    --------
    >>> tool = grinding.BallNose(0.02)
    >>> isinstance(tool, grinding.Tool), tool.spin
    (True, 0.0)
    """

    @property
    def spin(self) -> float:
        """Turns per second about its axis, 1/s.

        It moves the surface of the tool, not the body, so that steps need not follow the turns.
        """

    @property
    def footprint(self) -> float:
        """Radius of the patch on which one touching geom spreads its pressure, m."""

    def spec(self) -> mujoco.MjSpec:
        """Return a model with one body, whose site ``tip`` is at the working end."""


@dataclass(frozen=True)
class BallNose:
    """A ball at the end of a shank, which touches at one point.

    Parameters
    ----------
    radius
        Of the ball, m, > 0.
    length
        From the flange to the tip, m, at least the diameter. None: four times the radius.
    mass
        Of shank and ball, kg, > 0.
    spin
        Turns per second about the shank, 1/s. The point on the axis does not slide: a tool that
        spins is held at a tilt (`Path.on_surface`, ``tilt``).
    footprint
        Radius of the patch of contact, m, > 0, on which pressure is a paraboloid. None: a quarter
        of the ball's radius.

    Examples
    --------
    >>> grinding.BallNose(0.02, spin=47).footprint  # m, by default a quarter of the radius
    0.005
    """

    radius: float
    length: float | None = None
    mass: float = 0.5
    spin: float = 0.0
    footprint: float = math.nan

    def __post_init__(self) -> None:
        radius = positive_number("BallNose: radius", self.radius)
        length = 4 * radius if self.length is None else self.length
        if positive_number("BallNose: length", length) < 2 * radius:
            raise ValueError(f"BallNose: length must be >= {2 * radius:g}, got {length!r}")
        object.__setattr__(self, "length", float(length))
        _set_common(self, radius / 4)

    def spec(self) -> mujoco.MjSpec:
        """Return the model of the tool."""
        assert self.length is not None
        spec, body = _new_body(self.length)
        centre = self.length - self.radius
        _shank(body, 0.6 * self.radius, centre)
        body.add_geom(
            name="point0",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[self.radius, 0, 0],
            pos=[0, 0, centre],
            mass=self.mass / 2,
            surfacevel=[0, 0, 0, 0, 0, 2 * math.pi * self.spin],
            rgba=_ABRASIVE,
        )
        _give_inertia(body, self.mass, self.radius, self.length)
        return spec


@dataclass(frozen=True)
class Disc:
    """A flat disc that touches at several points of its face: one at the centre, others in rings.

    Each point has its share of the stiffness, so that a tilt moves the load to an edge as it does
    on a bed of springs.

    Parameters
    ----------
    radius
        Of the outer ring of points, m, > 0.
    points
        Points of the outer ring, >= 3. Rings further in have fewer, at the same spacing.
    rings
        Number of rings, >= 1.
    length
        From the flange to the face, m. None: one and a half times the radius.
    mass
        kg, > 0.
    spin
        Turns per second about its axis, 1/s.
    footprint
        Radius of the patch of each point, m. None: half the spacing of the outer ring.

    Examples
    --------
    >>> disc = grinding.Disc(0.05, points=8, rings=2)
    >>> softer = cell.with_changes(tool=disc)
    """

    radius: float
    points: int = 12
    rings: int = 1
    length: float | None = None
    mass: float = 0.8
    spin: float = 0.0
    footprint: float = math.nan

    def __post_init__(self) -> None:
        radius = positive_number("Disc: radius", self.radius)
        if positive_count("Disc: points", self.points) < 3:
            raise ValueError(f"Disc: points must be >= 3, got {self.points}")
        positive_count("Disc: rings", self.rings)
        length = 1.5 * radius if self.length is None else self.length
        object.__setattr__(self, "length", positive_number("Disc: length", length))
        _set_common(self, math.pi * radius / self.points)

    @property
    def places(self) -> Array:
        """(n, 2) places of the points on the face, m, the centre first."""
        found = [(0.0, 0.0)]
        for ring in range(1, self.rings + 1):
            radius = self.radius * ring / self.rings
            count = max(3, round(self.points * ring / self.rings))
            turns = 2 * math.pi * np.arange(count) / count
            found += [(radius * math.cos(a), radius * math.sin(a)) for a in turns]
        return np.array(found)

    def spec(self) -> mujoco.MjSpec:
        """Return the model of the tool."""
        assert self.length is not None
        spec, body = _new_body(self.length)
        # Balls whose surfaces are flush with the face; the face is not solid itself.
        size = min(0.3 * self.radius, 0.4 * self.length)
        _shank(body, 0.3 * self.radius, self.length - size)
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[self.radius, size / 2, 0],
            pos=[0, 0, self.length - size / 2],
            contype=0,
            conaffinity=0,
            mass=0,
            rgba=_ABRASIVE,
        )
        rate = 2 * math.pi * self.spin
        for index, (x, y) in enumerate(self.places):
            body.add_geom(
                name=f"point{index}",
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[size, 0, 0],
                pos=[x, y, self.length - size],
                mass=0,
                # The velocity of the disc at the point; the ball itself does not turn.
                surfacevel=[-rate * y, rate * x, 0, 0, 0, 0],
                rgba=_ABRASIVE,
            )
        _give_inertia(body, self.mass, self.radius, self.length)
        return spec


@dataclass(frozen=True)
class OwnTool:
    """A tool from an MJCF file.

    The file has one body, without joints, with the site `tip` at its working end (z outwards). The
    geoms that may touch (``contype`` or ``conaffinity``) share the cell's stiffness evenly.

    Parameters
    ----------
    file
        MJCF file.
    footprint
        Radius of the patch of each touching geom, m, > 0.
    tip
        Name of the site.
    spin
        Turns per second, 1/s. Give geoms a ``surfacevel`` for what it does to friction; here it
        only names the frequency.

    Examples
    --------
    >>> from pathlib import Path
    >>> xml = '''<mujoco><worldbody><body name="tool">
    ...   <geom name="tip" size=".01" pos="0 0 .05" mass=".2"/><site name="tip" pos="0 0 .06"/>
    ... </body></worldbody></mujoco>'''
    >>> _ = Path("tool.xml").write_text(xml)
    >>> grinding.OwnTool("tool.xml", footprint=0.003).tip
    'tip'
    """

    file: str | os.PathLike[str]
    footprint: float
    tip: str = TIP
    spin: float = 0.0

    def __post_init__(self) -> None:
        positive_number("OwnTool: footprint", self.footprint)
        if not Path(self.file).is_file():
            raise FileNotFoundError(f"OwnTool: no file {os.fspath(self.file)!r}")

    def spec(self) -> mujoco.MjSpec:
        """Return the model of the tool; ValueError names what it lacks."""
        name = os.fspath(self.file)
        spec = mujoco.MjSpec.from_file(name)
        bodies = spec.worldbody.bodies
        if len(bodies) != 1:
            raise ValueError(f"tool {name!r}: it must have one body, not {len(bodies)}")
        if spec.joints:
            raise ValueError(f"tool {name!r}: it has joints; give the cell a spindle instead")
        sites = {site.name: site for site in spec.sites}
        if self.tip not in sites:
            raise ValueError(f"tool {name!r} has no site {self.tip!r}; it has {sorted(sites)}")
        body = bodies[0]
        body.name, sites[self.tip].name = BODY, TIP
        touching = [geom for geom in spec.geoms if geom.contype or geom.conaffinity]
        if not touching:
            raise ValueError(f"tool {name!r} has no geom that may touch")
        for index, geom in enumerate(touching):
            geom.name = f"point{index}"
        return spec


_ABRASIVE = [0.55, 0.35, 0.2, 1.0]
_STEEL = [0.5, 0.52, 0.55, 1.0]


def _set_common(tool: BallNose | Disc, footprint: float) -> None:
    """Check mass and spin, and give a tool its footprint where it has none."""
    label = type(tool).__name__
    positive_number(f"{label}: mass", tool.mass)
    if not math.isfinite(number(f"{label}: spin", tool.spin)):
        raise ValueError(f"{label}: spin must be finite, got {tool.spin!r}")
    given = tool.footprint
    chosen = footprint if isinstance(given, float) and math.isnan(given) else given
    object.__setattr__(tool, "footprint", positive_number(f"{label}: footprint", chosen))


def _new_body(length: float) -> tuple[mujoco.MjSpec, Any]:
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name=BODY)
    body.add_site(name=TIP, pos=[0, 0, length], size=[1e-3, 0, 0])
    return spec, body


def _shank(body: Any, radius: float, length: float) -> None:
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[radius, length / 2, 0],
        pos=[0, 0, length / 2],
        contype=0,
        conaffinity=0,
        mass=0,
        rgba=_STEEL,
    )


def _give_inertia(body: Any, mass: float, radius: float, length: float) -> None:
    """Give a body the inertia of a cylinder that reaches from the flange to the tip."""
    across = mass * (3 * radius**2 + length**2) / 12
    body.mass = mass
    body.ipos = [0, 0, length / 2]
    body.inertia = [across, across, mass * radius**2 / 2]
    body.explicitinertial = True
