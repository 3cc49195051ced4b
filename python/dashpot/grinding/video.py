"""An animation of a plan: rendered by MuJoCo where a GL is there, else drawn."""

from __future__ import annotations

import functools
import io
import os
import subprocess
import sys
import warnings
from pathlib import Path as File
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.checks import positive_count
from dashpot.colours import COLOURS
from dashpot.figures import ShownFigure, clean, picture

if TYPE_CHECKING:
    from dashpot.grinding.passes import PlannedPass
    from dashpot.grinding.plan import Plan

__all__ = ["write_video"]

Array = NDArray[np.float64]

_SIZE = (480, 640)  # pixels, rows and columns
_FRAME = 80  # ms


def write_video(plan: Plan, file: str | os.PathLike[str], frames: int = 60) -> File:
    """Write what `Plan.video` does."""
    from PIL import Image

    count = positive_count("video: frames", frames)
    target = File(file)
    if target.suffix.lower() != ".gif":
        raise ValueError(f"video: {os.fspath(file)!r} does not end in .gif")
    pictures: list[Any] = []
    for index, planned in enumerate(plan.passes):
        share = max(2, count // len(plan.passes))
        chosen = np.linspace(0, len(planned.found.time) - 1, share).astype(int)
        if _gl_is_there():
            pictures += [Image.fromarray(shot) for shot in _rendered(planned, chosen)]
        else:
            pictures += [
                Image.open(io.BytesIO(each)).convert("RGB")
                for each in _drawn(plan, index, planned, chosen)
            ]
    pictures[0].save(
        target, save_all=True, append_images=pictures[1:], duration=_FRAME, loop=0, optimize=True
    )
    return target


_TRIAL = "import mujoco; mujoco.Renderer(mujoco.MjModel.from_xml_string('<mujoco/>'), 8, 8)"
_TRIAL_TIMEOUT = 60.0  # s


@functools.cache
def _gl_is_there() -> bool:
    """Return whether MuJoCo can render here.

    A process of its own tries: where no display is, some bindings of GL end the process.
    """
    try:
        done = subprocess.run(
            [sys.executable, "-c", _TRIAL], capture_output=True, timeout=_TRIAL_TIMEOUT, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0


def _rendered(planned: PlannedPass, chosen: NDArray[np.intp]) -> list[NDArray[np.uint8]]:
    """Return pictures of the cell, rendered."""
    parts = planned.cell.shown
    data = mujoco.MjData(parts.model)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a GL that finds no display
        renderer = mujoco.Renderer(parts.model, *_SIZE)
    try:
        camera = mujoco.MjvCamera()
        middle = planned.path.points.mean(axis=0)
        camera.lookat[:] = middle
        camera.distance, camera.azimuth, camera.elevation = 1.6, 140.0, -25.0
        shots = []
        for index in chosen:
            data.qpos[parts.joints] = planned.found.angles[index]
            mujoco.mj_forward(parts.model, data)
            renderer.update_scene(data, camera)
            shots.append(np.array(renderer.render()))
        return shots
    finally:
        renderer.close()


def _drawn(plan: Plan, number: int, planned: PlannedPass, chosen: NDArray[np.intp]) -> list[bytes]:
    """Return pictures (PNG) of the arm as lines, and of the force along the way."""
    chains = _chains(planned, chosen)
    found = planned.found
    way, _, _ = planned.command.law.at(found.time)
    peak = 1.1 * float(found.total.max())
    path = planned.path.points
    shots = []
    for index, chain in zip(chosen, chains, strict=True):
        figure = ShownFigure(figsize=(6.4, 4.8))
        arm = figure.add_subplot(2, 1, 1, projection="3d")
        arm.plot(*chain.T, color="0.35", linewidth=3)
        arm.plot(*path.T, color=COLOURS[0], linewidth=1.2)
        arm.scatter(*found.tip[index], color=COLOURS[1], s=20)
        arm.set_title(
            f"pass {number + 1} of {len(plan.passes)}, {found.time[index]:.2f} s",
            fontsize="medium",
        )
        _frame_arm(arm, np.concatenate([chains.reshape(-1, 3), path]))
        force = figure.add_subplot(2, 1, 2)
        force.plot(1e3 * way[: index + 1], found.total[: index + 1], color=COLOURS[0], lw=1.0)
        force.set_xlim(0, 1e3 * planned.path.length)
        force.set_ylim(0, peak)
        force.set_xlabel("way [mm]")
        force.set_ylabel("force [N]")
        clean(force)
        figure.subplots_adjust(hspace=0.3, bottom=0.12)
        shots.append(picture(figure, "png", dpi=100))
    return shots


def _chains(planned: PlannedPass, chosen: NDArray[np.intp]) -> Array:
    """Return (frames, bodies, 3) places of the arm's bodies from its foot to the tip, m."""
    parts = planned.cell.parts
    model, data = parts.model, mujoco.MjData(parts.model)
    body = int(model.site_bodyid[parts.tip])
    bodies = []
    while body != 0:
        bodies.append(body)
        body = int(model.body_parentid[body])
    bodies.reverse()
    chains = np.empty((len(chosen), len(bodies) + 1, 3))
    for row, index in enumerate(chosen):
        data.qpos[parts.joints] = planned.found.angles[index]
        mujoco.mj_kinematics(model, data)
        chains[row, :-1], chains[row, -1] = data.xpos[bodies], data.site_xpos[parts.tip]
    return chains


def _frame_arm(axes: Any, points: Array) -> None:
    low, high = points.min(axis=0), points.max(axis=0)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_zlim(low[2], high[2])
    axes.set_box_aspect(np.maximum(high - low, 0.1))
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_zticks([])
