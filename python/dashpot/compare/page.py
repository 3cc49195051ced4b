"""The report of a comparison: one HTML file that needs nothing from outside."""

from __future__ import annotations

import os
from pathlib import Path

from dashpot.colours import colours_of
from dashpot.compare.plots import draw_energy, draw_penetration, plot_comparison
from dashpot.compare.result import Comparison
from dashpot.figures import ShownFigure, clean, legend_above
from dashpot.rendering import embedded, need_templates, write_page
from dashpot.versions import now, versions

_SIZE = (8.0, 4.0)


def write_report(comparison: Comparison, path: str | os.PathLike[str], title: str) -> Path:
    """Write what `Comparison.report` does."""
    need_templates()
    header, rows = comparison.rows()
    figures = [
        (
            plot_comparison(comparison),
            "Penetration of the touching contacts, and mechanical energy above the lowest state "
            "that any setting reached.",
        ),
        (
            _contacts(comparison),
            "Contacts that touch, and the energy that each setting has lost since the start.",
        ),
    ]
    for draw, caption in (
        (draw_penetration, "Penetration alone."),
        (draw_energy, "Energy alone."),
    ):
        figure = ShownFigure(figsize=_SIZE, layout="constrained")
        axes = figure.add_subplot()
        draw(axes, comparison)
        axes.set_xlim(0, comparison.duration)
        legend_above(figure, axes)
        figures.append((figure, caption))
    told = [
        ("scene", comparison.scene),
        ("time step", f"{1e3 * comparison.timestep:g} ms"),
        ("duration", f"{comparison.duration:g} s, settled after {comparison.settled_after:g} s"),
        *([("model", f"SHA-256 {comparison.model}")] if comparison.model else []),
        ("date", now()),
        ("versions", ", ".join(f"{name} {version}" for name, version in versions().items())),
    ]
    values = {
        "title": title,
        "summary": f"{len(comparison.runs)} ways to step the same model from the same state for "
        f"{comparison.duration:g} s at {1e3 * comparison.timestep:g} ms, measured alike.",
        "header": header,
        "rows": rows,
        "figures": [(embedded(figure), caption) for figure, caption in figures[:2]],
        "single": [(embedded(figure), caption) for figure, caption in figures[2:]],
        "notes": comparison.notes(),
        "settings": [
            (run.name, run.description, "; ".join(run.warnings)) for run in comparison.runs
        ],
        "made": told,
        "version": versions()["dashpot"],
    }
    return write_page(path, "dashpot.compare", "comparison.html.j2", values)


def _contacts(comparison: Comparison) -> ShownFigure:
    """Return a figure with the number of contacts, and the energy lost since the start."""
    figure = ShownFigure(figsize=(10, 3.8), layout="constrained")
    contacts, lost = figure.subplots(1, 2)
    colours = colours_of(comparison)
    for run in comparison.runs:
        colour = colours[run.name]
        contacts.plot(
            run.time, run.contacts, color=colour, lw=1.1, label=comparison.label(run.name)
        )
        lost.plot(run.time, -run.excess, color=colour, lw=1.1)
    contacts.set_ylabel("touching contacts")
    lost.set_ylabel("energy lost [J]")
    start = max(float((-run.excess).max()) for run in comparison.runs)
    lost.set_ylim(-0.08 * start - 1e-12, 1.08 * start + 1e-12)
    for axes in (contacts, lost):
        axes.set_xlabel("time [s]")
        axes.set_xlim(0, comparison.duration)
    clean(contacts, lost)
    legend_above(figure, contacts)
    return figure
