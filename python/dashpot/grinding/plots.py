"""Figures of a plan; drawn without pyplot, so that no display is needed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from dashpot.colours import COLOURS
from dashpot.figures import ShownFigure, clean, legend_above

if TYPE_CHECKING:
    from dashpot.grinding.checks import Checks
    from dashpot.grinding.plan import Plan

__all__ = ["plot_along", "plot_checks", "plot_depth", "plot_joints", "plot_plan"]

Array = NDArray[np.float64]

_MM, _UM = 1e3, 1e6


def plot_plan(plan: Plan) -> ShownFigure:
    """Return a figure with the depth map and the depth along the path."""
    figure = ShownFigure(figsize=(9, 5.2), layout="constrained")
    top, bottom = figure.subplots(2, 1)
    _draw_map(figure, top, plan)
    _draw_depth(bottom, plan)
    return figure


def plot_depth(plan: Plan) -> ShownFigure:
    """Return a figure with the depth map alone."""
    figure = ShownFigure(figsize=(9, 3.0), layout="constrained")
    _draw_map(figure, figure.subplots(), plan)
    return figure


def plot_along(plan: Plan) -> ShownFigure:
    """Return a figure with force, feed and depth along the path."""
    figure = ShownFigure(figsize=(9, 6.5), layout="constrained")
    force, feed, depth = figure.subplots(3, 1, sharex=True)
    for index, each in enumerate(plan.passes):
        way, speed, _ = each.command.law.at(each.found.time)
        colour = COLOURS[index % len(COLOURS)]
        label = f"pass {index + 1}" if len(plan.passes) > 1 else "simulated"
        force.plot(_MM * way, each.found.total, color=colour, linewidth=1.0, label=label)
        feed.plot(_MM * way, speed, color=colour, linewidth=1.0)
    force.axhline(plan.target.max_force, color="0.4", linestyle=":", label="largest allowed")
    force.set_ylabel("normal force [N]")
    feed.set_ylabel("feed [m/s]")
    feed.set_ylim(bottom=0)
    force.set_ylim(bottom=0)
    _draw_depth(depth, plan)
    clean(force, feed)
    legend_above(figure, force)
    return figure


def plot_joints(plan: Plan) -> ShownFigure:
    """Return a figure with angles and speeds of the joints over time."""
    figure = ShownFigure(figsize=(9, 5.0), layout="constrained")
    angle, speed = figure.subplots(2, 1, sharex=True)
    begin = 0.0
    for each in plan.passes:
        time = begin + each.found.time
        for joint, name in enumerate(plan.cell.parts.joint_names):
            colour = COLOURS[joint % len(COLOURS)]
            label = name if begin == 0 else None
            angle.plot(time, each.found.angles[:, joint], color=colour, lw=1.0, label=label)
            speed.plot(time, each.found.speeds[:, joint], color=colour, lw=0.8)
        begin += each.duration
    angle.set_ylabel("angle [rad]")
    speed.set_ylabel("speed [rad/s]")
    speed.set_xlabel("time [s]")
    clean(angle, speed)
    legend_above(figure, angle)
    return figure


def plot_checks(plan: Plan, checks: Checks) -> ShownFigure:
    """Return a figure with the depth along the path of each check."""
    figure = ShownFigure(figsize=(9, 4.2), layout="constrained")
    axes = figure.subplots()
    for index, row in enumerate(checks.rows):
        axes.plot(
            _MM * plan.way,
            _UM * row.depth,
            color=COLOURS[index % len(COLOURS)],
            linewidth=1.0,
            linestyle="--" if row.name.startswith("MuJoCo") else "-",
            label=row.name,
        )
    axes.set_xlabel("way [mm]")
    axes.set_ylabel("depth [um]")
    # What chatters must not hide the others.
    axes.set_ylim(0, 2 * _UM * plan.target.depth)
    clean(axes)
    axes.legend(fontsize="x-small", ncols=3, frameon=False)
    return figure


def _draw_map(figure: ShownFigure, axes: Axes, plan: Plan) -> None:
    found = plan.depth_map()
    middle = 0.5 * (found.u[0] + found.u[-1]), 0.5 * (found.v[0] + found.v[-1])
    shown = axes.pcolormesh(
        _MM * (found.u - middle[0]),
        _MM * (found.v - middle[1]),
        _UM * np.where(np.isfinite(found.points[..., 0]), found.depth, np.nan),
        shading="nearest",
        cmap="viridis",
        rasterized=True,
    )
    axes.set_aspect("equal")
    axes.set_xlabel("along the part [mm]")
    axes.set_ylabel("across [mm]")
    figure.colorbar(shown, ax=axes, label="depth [um]")


def _draw_depth(axes: Axes, plan: Plan) -> None:
    goal = _UM * plan.target.depth
    axes.plot(_MM * plan.way, _UM * plan.depth, color=COLOURS[0], linewidth=1.2)
    axes.axhline(goal, color="0.4", linestyle=":")
    for share in (-plan.target.largest, plan.target.largest):
        axes.axhline(goal * (1 + share), color="0.7", linewidth=0.7)
    room = max(1.5 * plan.target.largest, 1.2 * plan.largest)
    axes.set_ylim(goal * (1 - room), goal * (1 + room))
    axes.set_xlabel("way [mm]")
    axes.set_ylabel("depth [um]")
    clean(axes)
