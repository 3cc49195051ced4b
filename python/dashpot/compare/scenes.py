"""Scenes shipped for comparisons: MJCF with the materials that dashpot gives their geoms."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from dashpot.checks import number, positive_count, positive_number, whole_number
from dashpot.materials import Material


@dataclass(frozen=True)
class Scene:
    """A model with the materials of its geoms.

    Attributes
    ----------
    name, description
        For tables and titles.
    xml
        MJCF. A run starts at its first keyframe, where it has one.
    duration
        s, long enough for the scene to come to rest or to show that it does not.
    materials
        Geom name to material; geoms left out are rigid.

    Examples
    --------
    >>> ball = dashpot.compare.Scene(
    ...     "ball", "A ball on a floor.", "<mujoco><worldbody><geom type='plane' size='1 1 1'/>"
    ...     "<body pos='0 0 .2'><freejoint/><geom size='.1'/></body></worldbody></mujoco>", 1.0, {}
    ... )
    >>> ball.name
    'ball'
    """

    name: str
    description: str
    xml: str
    duration: float
    materials: Mapping[str, Material] = field(default_factory=dict)


_VISUALS = """
  <visual><global offwidth="1280" offheight="960"/><headlight ambient=".4 .4 .4"/></visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="1 1 1" rgb2=".85 .9 .95"
             width="64" height="64"/>
    <texture name="grid" type="2d" builtin="checker" rgb1=".93 .93 .91" rgb2=".86 .86 .84"
             width="256" height="256"/>
    <material name="grid" texture="grid" texrepeat="8 8" texuniform="true"/>
  </asset>
"""


def ball(*, restitution: float = 0.9, stiffness: float = 1e4, timestep: float = 0.002) -> Scene:
    """Return a 1 kg ball, 0.1 m in radius, dropped from 1 m onto a plane."""
    restitution = number("restitution", restitution)
    stiffness = positive_number("stiffness", stiffness)
    timestep = positive_number("timestep", timestep)
    xml = f"""
<mujoco model="ball">
  <option timestep="{timestep}"/>{_VISUALS}
  <worldbody>
    <light pos="0 0 4"/>
    <geom name="floor" type="plane" size="2 2 .1" material="grid"/>
    <body name="ball" pos="0 0 1.1">
      <freejoint/>
      <geom name="ball" type="sphere" size=".1" mass="1" rgba=".16 .47 .71 1"/>
    </body>
  </worldbody>
</mujoco>"""
    material = Material(stiffness, restitution=restitution)
    return Scene(
        "ball",
        f"1 kg ball dropped 1 m, k = {stiffness:g} N/m, restitution {restitution:g}",
        xml,
        4.0,
        {"ball": material},
    )


def slope(*, angle: float = 20.0, friction: float = 0.5, timestep: float = 0.002) -> Scene:
    """Return a 1 kg cube at rest on a slope, `angle` in degrees, below its friction angle."""
    angle, friction = number("angle", angle), number("friction", friction)
    if not -90.0 < angle < 90.0:
        raise ValueError(f"angle must be in (-90, 90) degrees, got {angle:g}")
    if not (np.isfinite(friction) and friction >= 0.0):
        raise ValueError(f"friction must be finite and >= 0, got {friction:g}")
    timestep = positive_number("timestep", timestep)
    radians = np.deg2rad(angle)
    height, half = 0.1, 0.05
    position = f"{half * np.sin(radians)} 0 {half * np.cos(radians)}"
    xml = f"""
<mujoco model="slope">
  <option timestep="{timestep}"/>{_VISUALS}
  <worldbody>
    <light pos="0 0 4"/>
    <geom name="slope" type="plane" size="2 2 .1" euler="0 {angle} 0" material="grid"
          friction="{friction} .005 .0001"/>
    <body name="box" pos="{position}" euler="0 {angle} 0">
      <freejoint/>
      <geom name="box" type="box" size="{half} {half} {height / 2}" mass="1"
            friction="{friction} .005 .0001" rgba=".16 .47 .71 1"/>
    </body>
  </worldbody>
</mujoco>"""
    return Scene("slope", f"1 kg cube on a {angle:g}° slope, friction {friction:g}", xml, 5.0)


def stack(*, boxes: int = 10, stiffness: float = 1e5, timestep: float = 0.002) -> Scene:
    """Return a stack of 1 kg cubes with a spring of `stiffness` N/m at each corner."""
    boxes, stiffness = positive_count("boxes", boxes), positive_number("stiffness", stiffness)
    timestep = positive_number("timestep", timestep)
    half = 0.05
    bodies = "".join(
        f"""
    <body name="box{i}" pos="0 0 {half * (2 * i + 1)}">
      <freejoint/>
      <geom name="box{i}" type="box" size="{half} {half} {half}" mass="1"
            rgba="{0.16 + 0.6 * (i % 2)} .47 {0.71 - 0.5 * (i % 2)} 1"/>
    </body>"""
        for i in range(boxes)
    )
    xml = f"""
<mujoco model="stack">
  <option timestep="{timestep}"/>{_VISUALS}
  <worldbody>
    <light pos="0 0 4"/>
    <geom name="floor" type="plane" size="2 2 .1" material="grid"/>{bodies}
  </worldbody>
</mujoco>"""
    # Two boxes in series make one contact: each is given twice the stiffness of the contact.
    materials = {f"box{i}": Material(2 * stiffness) for i in range(boxes)}
    materials["floor"] = Material(2 * stiffness)
    return Scene("stack", f"{boxes} cubes of 1 kg, k = {stiffness:g} N/m", xml, 4.0, materials)


def pile(*, bodies: int = 40, seed: int = 0, timestep: float = 0.002) -> Scene:
    """Return boxes, spheres, capsules, cylinders and ellipsoids that fall into a bin; rigid."""
    bodies, seed = positive_count("bodies", bodies), whole_number("seed", seed, lowest=0)
    timestep = positive_number("timestep", timestep)
    rng = np.random.default_rng(seed)
    colours = [".16 .47 .71", ".89 .53 .16", ".30 .60 .35", ".76 .25 .27", ".52 .41 .66"]
    spacing, columns = 0.17, 9
    items = []
    for i in range(bodies):
        layer, cell = divmod(i, columns)
        x, y = (cell % 3 - 1) * spacing, (cell // 3 - 1) * spacing
        jitter = rng.uniform(-0.005, 0.005, 3)
        x, y, z = np.array([x, y, 0.2 + spacing * layer]) + jitter
        quaternion = rng.normal(size=4)
        quaternion /= np.linalg.norm(quaternion)
        a, b, c = rng.uniform(0.03, 0.046, 3)
        kind = ("box", "sphere", "capsule", "cylinder", "ellipsoid")[i % 5]
        size = {
            "box": f"{a:.4f} {b:.4f} {c:.4f}",
            "sphere": f"{a:.4f}",
            "capsule": f"{a * 0.8:.4f} {b * 0.9:.4f}",
            "cylinder": f"{a:.4f} {b:.4f}",
            "ellipsoid": f"{a:.4f} {b:.4f} {c:.4f}",
        }[kind]
        items.append(
            f"""
    <body name="{kind}{i}" pos="{x:.5f} {y:.5f} {z:.5f}"
          quat="{quaternion[0]:.6f} {quaternion[1]:.6f} {quaternion[2]:.6f} {quaternion[3]:.6f}">
      <freejoint/>
      <geom name="{kind}{i}" type="{kind}" size="{size}" rgba="{colours[i % 5]} 1"/>
    </body>"""
        )
    walls = "".join(
        f"""
    <geom name="wall{i}" type="box" pos="{x} {y} .2" size="{sx} {sy} .2" rgba=".6 .7 .8 .15"/>"""
        for i, (x, y, sx, sy) in enumerate(
            [
                (0.28, 0, 0.02, 0.3),
                (-0.28, 0, 0.02, 0.3),
                (0, 0.28, 0.26, 0.02),
                (0, -0.28, 0.26, 0.02),
            ]
        )
    )
    xml = f"""
<mujoco model="pile">
  <option timestep="{timestep}"/>{_VISUALS}
  <default><geom friction=".6 .005 .0001" density="1000"/></default>
  <worldbody>
    <light pos="0 0 4"/>
    <geom name="floor" type="plane" size="2 2 .1" material="grid"/>{walls}{"".join(items)}
  </worldbody>
</mujoco>"""
    return Scene("pile", f"{bodies} mixed bodies dropped into a bin", xml, 3.0)


SCENES: dict[str, Callable[..., Scene]] = {
    "ball": ball,
    "slope": slope,
    "stack": stack,
    "pile": pile,
}
"""Makers of the shipped scenes by name; their keyword arguments vary the scene."""


def scene(name: str) -> Scene:
    """Return a shipped scene by name; ValueError names near matches of an unknown one.

    Examples
    --------
    >>> sorted(dashpot.compare.SCENES)[:3]
    ['ball', 'pile', 'slope']
    >>> dashpot.compare.scene("pile").duration
    3.0
    """
    if not isinstance(name, str):
        raise TypeError(f"scene must be a name, got {name!r}")
    if name not in SCENES:
        near = difflib.get_close_matches(name, SCENES, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"scene {name!r} is none of {', '.join(SCENES)}{hint}")
    return SCENES[name]()
