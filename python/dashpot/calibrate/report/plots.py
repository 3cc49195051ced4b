"""The figure of a fit; drawn without pyplot, so that no display is needed."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from dashpot.calibrate.result import Fit
from dashpot.colours import COLOURS
from dashpot.figures import ShownFigure, clean, legend_above

Array = NDArray[np.float64]

# Standard deviations that the histogram spans; what is beyond stands in its last bins.
_SPAN = 5.0
_BINS = 40


def plot_fit(fit: Fit) -> ShownFigure:
    """Return a figure with residuals over time, their distribution, and correlations."""
    figure = ShownFigure(figsize=(12, 3.6), layout="constrained")
    over_time, distribution, correlation = figure.subplots(1, 3, width_ratios=(4, 3, 3))
    draw_residuals(over_time, fit)
    draw_distribution(distribution, fit)
    draw_correlation(correlation, fit)
    clean(over_time, distribution)
    legend_above(figure, distribution)
    return figure


def measured_residuals(fit: Fit) -> list[list[tuple[Array, Array]]]:
    """Return by trajectory and channel times (rows,), s, and weighted residuals (rows, columns).

    Those of what was not measured are NaN.
    """
    if fit._record is not None:  # a fit that was loaded has no problem
        return [
            [(residual.time, residual.weighted[:, None]) for residual in shown.residuals]
            for shown in fit._record.trajectories
        ]
    return [
        [
            (channel.time, np.where(channel.measured, residuals[channel.name], np.nan))
            for channel in fit.problem.channels(trajectory)
        ]
        for trajectory, residuals in zip(
            fit.problem.trajectories, fit.channel_residuals, strict=True
        )
    ]


def draw_residuals(axes: Axes, fit: Fit) -> None:
    """Draw the root mean square residual of each time, one line a trajectory."""
    rows = measured_residuals(fit)
    for channels in rows:
        if not channels:
            continue
        times = np.concatenate([np.repeat(time, r.shape[1]) for time, r in channels])
        pooled = np.concatenate([residuals.ravel() for _, residuals in channels])
        seen = np.isfinite(pooled)
        moments, place = np.unique(times[seen], return_inverse=True)
        squares = np.bincount(place, pooled[seen] ** 2, len(moments))
        size = np.sqrt(squares / np.bincount(place, minlength=len(moments)))
        axes.plot(moments, size, color=COLOURS[0], lw=0.8, alpha=0.8 / len(rows) ** 0.3)
    axes.axhline(1, color="black", linewidth=0.8)
    axes.set_ylim(bottom=0)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("residual of a frame, rms [σ]")


def draw_distribution(axes: Axes, fit: Fit) -> None:
    """Draw the histogram of all residuals, and the unit normal of the stated noise."""
    pooled = np.concatenate(
        [residuals.ravel() for channels in measured_residuals(fit) for _, residuals in channels]
    )
    pooled = pooled[~np.isnan(pooled)]
    edges = np.linspace(-_SPAN, _SPAN, _BINS + 1)
    axes.hist(
        np.clip(pooled, -_SPAN, _SPAN),
        edges.tolist(),
        density=True,
        color=COLOURS[0],
        alpha=0.6,
        label="residuals",
    )
    x = np.linspace(-_SPAN, _SPAN, 201)
    normal = np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi)
    axes.plot(x, normal, color="black", linewidth=0.8, label="stated noise")
    axes.set_xlabel(f"residual [σ]; beyond {_SPAN:g} at the ends")
    axes.set_title(f"variance {fit.residual_variance:.3g}", fontsize="medium")


def draw_correlation(axes: Axes, fit: Fit) -> None:
    """Draw the matrix of correlations of the estimates, with its numbers."""
    names = [estimate.name.replace("_", " ") for estimate in fit.estimates]
    if not names:
        axes.set_axis_off()
        return
    axes.imshow(fit.correlation, vmin=-1, vmax=1, cmap="RdBu_r")
    for row in range(len(names)):
        for column in range(len(names)):
            value = float(fit.correlation[row, column])
            axes.text(
                column,
                row,
                f"{value:+.2f}",
                ha="center",
                va="center",
                fontsize="small",
                color="white" if abs(value) > 0.6 else "black",
            )
    axes.set_xticks(range(len(names)), names, rotation=30, ha="right")
    axes.set_yticks(range(len(names)), names)
    axes.set_title("correlation", fontsize="medium")
