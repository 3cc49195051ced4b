"""Calls that work at run time and that ``mypy --strict`` accepts: lists, tuples, arrays."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from dashpot import Engine, Material
from dashpot.calibrate import ImagePlane, Parameter

SCENE = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 .1"/>
  <body name="ball" pos="0 0 .1"><freejoint/><geom name="ball" size=".1" mass="1"/></body>
</worldbody></mujoco>"""


def engines(folder: Path) -> list[Engine]:
    """Return an engine for each way to give a model."""
    file = folder / "scene.xml"
    file.write_text(SCENE, encoding="utf-8")
    specification = mujoco.MjSpec.from_string(SCENE)
    model = mujoco.MjModel.from_xml_string(SCENE)
    return [Engine(m) for m in (model, specification, SCENE, file, str(file))]


def materials(engine: Engine) -> None:
    """Give geoms materials, by name and id."""
    rubber = Material(1e4, friction=[0.5, 0.1, 0.2])
    engine.set_materials({"ball": rubber, 0: rubber})
    engine.set_material(np.int32(1), rubber)
    engine.set_materials(dict.fromkeys(engine.body_geoms("ball"), Material(1e4)))
    engine.set_pair_material("ball", np.int64(0), Material(2e4, restitution=0.5))


def contacts(engine: Engine) -> list[int]:
    """Return how many contacts each way to choose them leaves."""
    data = engine.make_data()
    engine.step(data, nstep=100)
    found = engine.contacts(data, pair=["ball", "floor"])
    again = engine.contacts(data, pair=("floor", "ball"))
    chosen = (found, again, found[[0]], found[found.force[:, 0] > 0.0], found[:1])
    return [len(each) for each in chosen]


def parameters() -> list[Parameter]:
    """Return parameters with bounds of every kind of sequence."""
    return [
        Parameter("mass", 1.0, bounds=[0.1, 2]),
        Parameter("mass", 1.0, bounds=np.array([0.1, 2.0])),
        Parameter.pair("ball", "floor", "stiffness", bounds=[1e3, 1e5]),
        Parameter.pair([["ball", "floor"]], "sliding_friction", bounds=(0.1, 1.0)),
        Parameter.material("ball", "restitution", start=0.5, bounds=[0.1, 0.9]),
        Parameter.model("body_mass", "ball", start=1, bounds=[0.1, 2]),
        Parameter.delay("load", bounds=[-0.01, 0.05]),
        Parameter.gain("load", bounds=[0.5, 2]),
        Parameter.scale(bounds=[0.5, 2]),
        Parameter.inertia("ball", mass=[0.1, 2]),
        Parameter("shift", [0.0, 1.0], bounds=[[-1, 1], [0.5, 2]], transform="linear"),
        Parameter("shift", np.zeros(3), bounds=np.array([-1.0, 2.0]), transform="linear"),
    ]


def picture() -> ImagePlane:
    """Return a picture whose vectors are lists."""
    return ImagePlane(scale=812, origin=[320, 420], right=[1, 0, 0], down=[0, 0, -1])
