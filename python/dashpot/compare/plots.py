"""Figures of a comparison; drawn without pyplot, so that no display is needed."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dashpot.compare.result import Comparison

# Okabe and Ito's palette, told apart by colour-blind readers; dashpot comes first, in blue.
COLOURS = ("#0072b2", "#d55e00", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#000000")

# m; what a logarithmic axis shows as "none".
_DEPTH_FLOOR = 1e-9


def plot_comparison(comparison: Comparison) -> Figure:
    """Return a figure with the deepest penetration and the mechanical energy over time."""
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    penetration, energy = figure.subplots(1, 2)
    draw_penetration(penetration, comparison)
    draw_energy(energy, comparison)
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
    _finish(axes, "penetration [mm], mean (thick) and max (thin)")


def draw_energy(axes: Axes, comparison: Comparison) -> None:
    """Draw kinetic plus potential energy of each run, above the lowest that any run reached."""
    finite = [run.energy[np.isfinite(run.energy)] for run in comparison.runs]
    lowest = min(float(energy.min()) for energy in finite)
    for index, run in enumerate(comparison.runs):
        axes.plot(
            run.time,
            run.energy - lowest,
            color=COLOURS[index % len(COLOURS)],
            label=run.name,
            linewidth=1.6 if index == 0 else 1.1,
            zorder=3 if index == 0 else 2,
        )
    # A diverging run must not hide the others.
    start = max(float(energy[0]) for energy in finite) - lowest
    axes.set_ylim(-0.03 * start, 1.25 * start if start > 0 else None)
    _finish(axes, "kinetic + potential energy [J]")
    axes.legend(fontsize="small", frameon=False)


def _finish(axes: Axes, label: str) -> None:
    axes.set_xlabel("time [s]")
    axes.set_ylabel(label)
    axes.grid(True, linewidth=0.4, alpha=0.5)
    axes.spines[["top", "right"]].set_visible(False)
