"""The cube that is tossed: body properties and model."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

BODY = "cube"
# Corners of a sharp cube of half width 1; a corner radius replaces the box by spheres in them.
CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


@dataclass(frozen=True)
class Cube:
    """Body properties of the cube.

    Attributes
    ----------
    half_width
        m.
    mass
        kg.
    inertia
        About every axis through the centre of mass, kg m^2.
    corner_radius
        m, >= 0; 0: a box with sharp corners; else spheres of this radius in its corners.
    offset
        Centre of mass in the body frame, m.

    Examples
    --------
    >>> from dashpot.calibrate import tosses as study
    >>> cube = study.Cube()
    >>> round(cube.half_width, 3)
    0.052
    """

    half_width: float = 0.0524
    mass: float = 0.37
    inertia: float = 0.00081
    corner_radius: float = 0.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def model(self, *, timestep: float = 1.0 / 592.0) -> mujoco.MjModel:
        """Return the cube over a table at z = 0, elliptic friction cones, frictional condim 3."""
        half, radius = self.half_width, self.corner_radius
        if radius == 0.0:
            geoms = f'<geom name="cube" type="box" size="{half} {half} {half}"/>'
        else:
            inner = half - radius
            geoms = "".join(
                f'<geom name="corner{i}" type="sphere" size="{radius}" '
                f'pos="{x * inner} {y * inner} {z * inner}"/>'
                for i, (x, y, z) in enumerate(CORNERS)
            )
        offset = " ".join(str(component) for component in self.offset)
        return mujoco.MjModel.from_xml_string(
            f"""
            <mujoco>
              <option timestep="{timestep}" gravity="0 0 -9.81" cone="elliptic"/>
              <worldbody>
                <geom name="table" type="plane" size="2 2 0.1"/>
                <body name="{BODY}" pos="0 0 0.2">
                  <freejoint/>
                  <inertial pos="{offset}" mass="{self.mass}"
                            diaginertia="{self.inertia} {self.inertia} {self.inertia}"/>
                  {geoms}
                </body>
              </worldbody>
            </mujoco>
            """
        )

    @property
    def geoms(self) -> tuple[str, ...]:
        """Names of the cube's geoms."""
        if self.corner_radius == 0.0:
            return ("cube",)
        return tuple(f"corner{i}" for i in range(8))
