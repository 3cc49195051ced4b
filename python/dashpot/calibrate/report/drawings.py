"""Figures of a report: curves, residuals, profiles, animations."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from dashpot.calibrate.report.record import Clip, Curve, Profile, Shown
from dashpot.colours import MEASURED
from dashpot.figures import ShownFigure, clean, legend_above

Array = NDArray[np.float64]

_COLUMNS = 3
# Inches: of a panel with what is left of it, and of the margins of a figure.
_PANEL = (3.4, 1.7)
_ROOM = {"left": 0.9, "right": 0.1, "bottom": 0.5, "top": 0.35, "between": 0.85}
_MOST_LAGS = 20
# An animation lasts this long, s, and is this large, pixels.
_CLIP_SECONDS = 4.0
_CLIP_SIZE = (480, 320)
_CLIP_AXES = (0.15, 0.16, 0.83, 0.81)


def curve_figure(
    own: Shown, others: Mapping[str, Shown], name: str, colours: Mapping[str, str]
) -> ShownFigure:
    """Return a figure with a panel for each channel of a trajectory.

    Parameters
    ----------
    own
        What the fit `name` says of it.
    others
        What other fits say of it, by their names.
    colours
        Of all these names.
    """
    figure, panels = _grid(len(own.curves), "")
    for axes, curve in zip(panels, own.curves, strict=True):
        timed = curve.axis != "number"
        if timed and own.window is not None and own.window < own.duration:
            axes.axvspan(own.window, own.duration, color="0.95", lw=0, label="beyond the window")
        _draw_bands(axes, curve, colours[name])
        style = {"lw": 1.2} if timed else {"lw": 0, "marker": "s", "ms": 3.5}
        for label, other in others.items():
            for candidate in other.curves:
                if candidate.name == curve.name:
                    row = candidate.simulated
                    axes.plot(candidate.place, row, color=colours[label], label=label, **style)
        axes.plot(curve.place, curve.simulated, color=colours[name], label=name, **style)
        axes.plot(
            curve.place, curve.measured, ".", color=MEASURED, ms=2.5, label="measured", zorder=5
        )
        axes.set_ylabel(_with_unit(curve.name, curve.unit))
    _label_below(panels, [curve.axis for curve in own.curves])
    clean(*panels)
    if panels:
        legend_above(figure, panels[0])
    return figure


def autocorrelation(series: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Return the autocorrelation of residuals at lags of 1, 2 ... frames, and its deviation.

    Parameters
    ----------
    series
        Places of frames (n,) on their grid and residuals (n,), NaN where there is none, of each
        trajectory; products of frames that are a lag apart are summed over all.

    Returns
    -------
    (lags,) correlations, NaN without any pair, and (lags,) what white noise would have.
    """
    placed = []
    for frame, values in series:
        row = np.full(int(frame[-1]) + 1 if len(frame) else 0, np.nan)
        row[frame.astype(int)] = values
        placed.append(row)
    most = min(_MOST_LAGS, max((len(row) - 2 for row in placed if len(row) > 1), default=0))
    square = sum(float(np.nansum(row**2)) for row in placed)
    count = sum(int(np.isfinite(row).sum()) for row in placed)
    correlation, deviation = np.full(most, np.nan), np.full(most, np.nan)
    for lag in range(1, most + 1):
        products = [row[lag:] * row[:-lag] for row in placed if len(row) > lag]
        pairs = sum(int(np.isfinite(p).sum()) for p in products)
        if pairs and square > 0.0:
            mean = sum(float(np.nansum(p)) for p in products) / pairs
            correlation[lag - 1] = mean / (square / count)
            deviation[lag - 1] = 1.0 / np.sqrt(pairs)
    return correlation, deviation


def by_channel(trajectories: Sequence[Shown]) -> dict[str, list[tuple[Array, Array]]]:
    """Return frames and residuals of each trajectory by the channel's name."""
    found: dict[str, list[tuple[Array, Array]]] = {}
    for shown in trajectories:
        for residual in shown.residuals:
            found.setdefault(residual.name, []).append((residual.step, residual.weighted))
    return found


def residual_figure(trajectories: Sequence[Shown], colour: str) -> ShownFigure:
    """Return a figure with the residuals of each channel over time, all trajectories together."""
    named: dict[str, list[tuple[Array, Array]]] = {}
    for shown in trajectories:
        for residual in shown.residuals:
            named.setdefault(residual.name, []).append((residual.time, residual.weighted))
    figure, panels = _grid(len(named))
    for axes, (name, rows) in zip(panels, named.items(), strict=True):
        axes.axhspan(-2, 2, color="0.92", lw=0)
        for time, weighted in rows:
            axes.plot(time, weighted, color=colour, lw=0.7, alpha=max(0.25, 0.8 / len(rows) ** 0.3))
        axes.set_ylabel(f"{name} [σ]")
    clean(*panels)
    return figure


def autocorrelation_figure(trajectories: Sequence[Shown], colour: str) -> ShownFigure:
    """Return a figure with the autocorrelation of each channel, and what white noise has."""
    named = by_channel(trajectories)
    figure, panels = _grid(len(named), "lag [frames]")
    for axes, (name, rows) in zip(panels, named.items(), strict=True):
        correlation, deviation = autocorrelation(rows)
        known = np.isfinite(correlation)  # readings may be rarer than frames
        correlation, deviation = correlation[known], deviation[known]
        lags = 1 + np.flatnonzero(known)
        axes.fill_between(lags, -1.96 * deviation, 1.96 * deviation, color="0.9", lw=0)
        axes.vlines(lags, 0, correlation, color=colour, lw=1.5)
        axes.axhline(0, color="black", lw=0.6)
        axes.set_ylim(-1, 1)
        axes.set_ylabel(name)
    clean(*panels)
    return figure


def profile_figure(
    profiles: Sequence[Profile], units: Mapping[str, str], threshold: float, colour: str
) -> ShownFigure:
    """Return a figure with the rise of the cost along each parameter.

    Its ends of the interval of a linear model are where the cost has risen by `threshold`.
    """
    figure, panels = _grid(len(profiles), "")
    figure.subplots_adjust(hspace=0.6)
    for axes, profile in zip(panels, profiles, strict=True):
        axes.axhline(threshold, color="0.5", lw=0.8, ls="--", label="end of the interval")
        axes.plot(profile.value, profile.rise, "o-", color=colour, ms=3, lw=1.2, label="cost")
        axes.set_xlabel(_with_unit(profile.name.replace("_", " "), units.get(profile.name, "")))
        axes.set_ylabel("rise of the cost")
        # Below 0 the search has ended where the cost is not lowest.
        lowest = max(np.nanmin(profile.rise, initial=0.0), -threshold)
        axes.set_ylim(min(1.1 * lowest, -0.15 * threshold), 3 * threshold)
    clean(*panels)
    legend_above(figure, panels[0])
    return figure


def animation(clip: Clip, colour: str) -> bytes:
    """Return an animated GIF of a clip: simulated in `colour`, measured as outlines."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    figure = ShownFigure(figsize=(_CLIP_SIZE[0] / 100, _CLIP_SIZE[1] / 100), dpi=100)
    canvas: Any = FigureCanvasAgg(figure)
    axes = figure.add_axes(_CLIP_AXES)
    points = [p.reshape(-1, 2) for p in (*clip.simulated, *clip.measured)]
    places = np.concatenate(points) if points else np.zeros((1, 2))
    low, high = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    shape = np.array(_CLIP_SIZE) * _CLIP_AXES[2:]
    scale = 1.15 * float(((high - low) / shape).max()) + 1e-9  # m a pixel, alike on both axes
    (left, right), (bottom, top) = np.stack(
        [0.5 * (low + high - scale * shape), 0.5 * (low + high + scale * shape)], axis=1
    )
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    axes.set_xlabel(f"{clip.label} [m]")
    axes.set_ylabel("z [m]")
    clean(axes)
    for outline in clip.still:
        axes.add_patch(Polygon(outline, facecolor="0.85", edgecolor="0.5", lw=1.0, zorder=1))
    canvas.draw()
    background = canvas.copy_from_bbox(figure.bbox)
    bodies = [Polygon(np.zeros((1, 2)), fc=colour, ec=colour, alpha=0.45) for _ in clip.simulated]
    seen = [Polygon(np.zeros((1, 2)), fill=False, ec=MEASURED, lw=1.2) for _ in clip.measured]
    patches = [*bodies, *seen]
    for patch in patches:
        axes.add_patch(patch)
    clock = axes.text(0.02, 0.94, "", transform=axes.transAxes, fontsize="small")
    pictures: list[Image.Image] = []
    for row, time in enumerate(clip.time):
        canvas.restore_region(background)
        for patch, outlines in zip(
            (*bodies, *seen), (*clip.simulated, *clip.measured), strict=True
        ):
            if np.isfinite(outlines[row]).all():
                patch.set_xy(outlines[row])
                axes.draw_artist(patch)
        clock.set_text(f"{time:.3f} s")
        axes.draw_artist(clock)
        image = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())
        if pictures:
            image = image.quantize(palette=pictures[0], dither=Image.Dither.NONE)
        pictures.append(image if pictures else image.quantize(32))
    stream = io.BytesIO()
    pictures[0].save(
        stream,
        format="GIF",
        save_all=True,
        append_images=pictures[1:],
        duration=max(20, round(1e3 * _CLIP_SECONDS / len(pictures))),
        loop=0,
    )
    return stream.getvalue()


def _draw_bands(axes: Axes, curve: Curve, colour: str) -> None:
    """Draw where 95 % of measurements would be, and of simulations that the fit leaves open."""
    total = 1.96 * np.sqrt(curve.sigma**2 + np.nan_to_num(curve.spread) ** 2)
    low, high = curve.simulated - total, curve.simulated + total
    place = curve.place
    axes.fill_between(place, low, high, color=colour, alpha=0.15, lw=0, label="95 % with noise")
    if np.isfinite(curve.spread).any():
        own = 1.96 * curve.spread
        axes.fill_between(
            place,
            curve.simulated - own,
            curve.simulated + own,
            color=colour,
            alpha=0.35,
            lw=0,
            label="95 % of the fit",
        )


def _grid(count: int, time: str = "time [s]") -> tuple[ShownFigure, list[Axes]]:
    """Return a figure of `count` panels, three in a row, those at the bottom with a label.

    Margins are fixed, in inches: finding them takes longer than drawing.
    """
    columns = min(_COLUMNS, max(count, 2))  # a legend needs the width of two
    rows = -(-max(count, 1) // columns)
    width, height = _PANEL[0] * columns, _PANEL[1] * rows + _ROOM["top"] + _ROOM["bottom"]
    figure = ShownFigure(figsize=(width, height))
    figure.subplots_adjust(
        left=_ROOM["left"] / width,
        right=1.0 - _ROOM["right"] / width,
        bottom=_ROOM["bottom"] / height,
        top=1.0 - _ROOM["top"] / height,
        wspace=_ROOM["between"] / (_PANEL[0] - _ROOM["between"]),
        hspace=0.3,
    )
    panels = []
    for index in range(count):
        axes = figure.add_subplot(rows, columns, index + 1)
        axes.locator_params(nbins=5)
        axes.tick_params(labelsize="small")
        if index + columns >= count and time:
            axes.set_xlabel(time)
        panels.append(axes)
    return figure, panels


def _label_below(panels: Sequence[Axes], labels: Sequence[str]) -> None:
    """Label the axes of panels at the bottom, and where the one below has another label."""
    columns = min(_COLUMNS, max(len(panels), 2))
    for index, (axes, label) in enumerate(zip(panels, labels, strict=True)):
        below = index + columns
        if below >= len(panels) or labels[below] != label:
            axes.set_xlabel(label)


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name
