"""Figures of a comparison; drawn without pyplot, so that no display is needed."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from dashpot.colours import colours_of
from dashpot.compare.result import Comparison
from dashpot.figures import ShownFigure, clean, legend_above

# m; what a logarithmic axis shows as "none".
_DEPTH_FLOOR = 1e-9
# The energy axis ends above the highest start by this share of what the runs lose.
_ROOM = 0.08


def plot_comparison(comparison: Comparison) -> ShownFigure:
    """Return a figure with the penetration and the mechanical energy over time."""
    figure = ShownFigure(figsize=(10, 4.2), layout="constrained")
    penetration, energy = figure.subplots(1, 2)
    draw_penetration(penetration, comparison)
    draw_energy(energy, comparison)
    for axes in (penetration, energy):
        axes.set_xlim(0, comparison.duration)
    legend_above(figure, energy)
    penetration.set_title(
        f"{comparison.scene}, time step {1e3 * comparison.timestep:g} ms",
        fontsize="medium",
        loc="left",
    )
    return figure


def draw_penetration(axes: Axes, comparison: Comparison) -> None:
    """Draw the mean penetration of each run, logarithmic, with its maximum as a thin line."""
    colours = colours_of(comparison)
    for index, run in enumerate(comparison.runs):
        colour = colours[run.name]
        touching = run.contacts > 0
        mean = np.where(touching, run.penetration_mean, np.nan)
        deepest = np.where(touching, run.penetration_max, np.nan)
        above = 2 if index == 0 else 1
        axes.semilogy(
            run.time,
            1e3 * np.maximum(mean, _DEPTH_FLOOR),
            color=colour,
            label=comparison.label(run.name),
            linewidth=1.6,
            zorder=2 + above,
        )
        axes.semilogy(
            run.time,
            1e3 * np.maximum(deepest, _DEPTH_FLOOR),
            color=colour,
            linewidth=0.5,
            alpha=0.5,
            zorder=1 + above,
        )
    # Contacts that just begin or end are arbitrarily shallow: the axis follows the bulk.
    bulk = [run.penetration_mean[run.contacts > 0] for run in comparison.runs]
    shallowest = [1e3 * float(np.percentile(depths, 5)) for depths in bulk if len(depths)]
    if shallowest:
        axes.set_ylim(bottom=max(0.3 * min(shallowest), 1e3 * _DEPTH_FLOOR))
    _finish(axes, "penetration [mm]; thin: deepest")


def draw_energy(axes: Axes, comparison: Comparison) -> None:
    """Draw kinetic plus potential energy of each run, above the lowest that any run reached.

    The axis is linear: on a logarithmic one, the run that comes lowest dives without end.
    """
    colours = colours_of(comparison)
    lowest = min(float(run.energy.min()) for run in comparison.runs)
    highest = max(float(run.energy[0]) for run in comparison.runs) - lowest
    for index, run in enumerate(comparison.runs):
        axes.plot(
            run.time,
            run.energy - lowest,
            color=colours[run.name],
            label=comparison.label(run.name),
            linewidth=1.6 if index == 0 else 1.1,
            zorder=3 if index == 0 else 2,
        )
    # A diverging run must not hide the others.
    room = _ROOM * highest if highest > 0 else 1.0
    axes.set_ylim(-room, highest + room)
    _finish(axes, "kinetic + potential energy [J]")


def _finish(axes: Axes, label: str) -> None:
    axes.set_xlabel("time [s]")
    axes.set_ylabel(label)
    clean(axes)
