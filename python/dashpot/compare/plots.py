"""Figures of a comparison; drawn without pyplot, so that no display is needed."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dashpot.colours import COLOURS
from dashpot.compare.result import Comparison

# m; what a logarithmic axis shows as "none".
_DEPTH_FLOOR = 1e-9
# The energy axis spans this part of the energy at the start.
_ENERGY_SPAN = 1e-3


def plot_comparison(comparison: Comparison) -> Figure:
    """Return a figure with the deepest penetration and the mechanical energy over time."""
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    penetration, energy = figure.subplots(1, 2)
    draw_penetration(penetration, comparison)
    draw_energy(energy, comparison)
    for axes in (penetration, energy):
        axes.set_xlim(0, comparison.duration)
    figure.suptitle(
        f"{comparison.scene}, time step {1e3 * comparison.timestep:g} ms", fontsize="medium"
    )
    return figure


def draw_penetration(axes: Axes, comparison: Comparison) -> None:
    """Draw the mean penetration of each run, logarithmic, with its maximum as a thin line."""
    for index, run in enumerate(comparison.runs):
        colour = COLOURS[index % len(COLOURS)]
        touching = run.contacts > 0
        mean = np.where(touching, run.penetration_mean, np.nan)
        deepest = np.where(touching, run.penetration_max, np.nan)
        above = 2 if index == 0 else 1
        axes.semilogy(
            run.time,
            1e3 * np.maximum(mean, _DEPTH_FLOOR),
            color=colour,
            label=run.name,
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
    _finish(axes, "penetration [mm], mean (thick) and max (thin)")


def draw_energy(axes: Axes, comparison: Comparison) -> None:
    """Draw kinetic plus potential energy of each run, above the lowest that any run reached."""
    lowest = min(float(run.energy.min()) for run in comparison.runs)
    start = max(float(run.energy[0]) for run in comparison.runs) - lowest
    floor = _ENERGY_SPAN * start if start > 0 else 1.0
    for index, run in enumerate(comparison.runs):
        axes.semilogy(
            run.time,
            np.maximum(run.energy - lowest, floor),
            color=COLOURS[index % len(COLOURS)],
            label=run.name,
            linewidth=1.6 if index == 0 else 1.1,
            zorder=3 if index == 0 else 2,
        )
    # A diverging run must not hide the others.
    axes.set_ylim(floor, 3 * max(start, floor))
    _finish(axes, "kinetic + potential energy [J]")
    axes.legend(fontsize="small", loc="upper right", framealpha=0.85, edgecolor="none")


def _finish(axes: Axes, label: str) -> None:
    axes.set_xlabel("time [s]")
    axes.set_ylabel(label)
    axes.grid(True, linewidth=0.4, alpha=0.5)
    axes.spines[["top", "right"]].set_visible(False)
