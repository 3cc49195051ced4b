"""Draw docs/overview.png: the pile at rest, its penetration and its energy, beside MuJoCo.

MUJOCO_GL=egl python docs/overview.py        (or osmesa; rendering needs one of the two)
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

import dashpot
from dashpot import compare
from dashpot.compare.plots import draw_energy, draw_penetration
from dashpot.figures import ShownFigure, legend_above

SETTINGS = ("dashpot", "mujoco-default", "elliptic", "solref-direct")


def picture_of_the_pile() -> np.ndarray:
    """Return an image of the pile at rest, stepped by dashpot; (height, width, 3)."""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(compare.scene("pile").xml))
    data = engine.make_data()
    engine.step(data, 1000)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = (0, 0, 0.08)
    camera.distance, camera.azimuth, camera.elevation = 1.0, 140, -42
    with mujoco.Renderer(engine.model, 880, 800) as renderer:
        renderer.update_scene(data, camera)
        return np.asarray(renderer.render())


def main() -> None:
    """Draw and write the picture."""
    comparison = compare.run("pile", settings=SETTINGS)
    figure = ShownFigure(figsize=(12, 3.9), layout="constrained")
    image, penetration, energy = figure.subplots(1, 3, width_ratios=(0.9, 1.2, 1.2))
    image.imshow(picture_of_the_pile())
    image.set_axis_off()
    draw_penetration(penetration, comparison)
    draw_energy(energy, comparison)
    for axes in (penetration, energy):
        axes.set_xlim(0, comparison.duration)
    legend_above(figure, energy)
    figure.savefig(Path(__file__).with_suffix(".png"), dpi=105, pil_kwargs={"optimize": True})


if __name__ == "__main__":
    main()
