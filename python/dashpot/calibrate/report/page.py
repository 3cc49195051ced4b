"""The report of a fit: one HTML file that needs nothing from outside."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import special

from dashpot._load import __version__
from dashpot.calibrate.report.drawings import (
    animation,
    autocorrelation_figure,
    curve_figure,
    profile_figure,
    residual_figure,
)
from dashpot.calibrate.report.inertia_table import inertia_header, inertia_rows
from dashpot.calibrate.report.making import shown_predictions
from dashpot.calibrate.report.page_tables import (
    channels_table,
    comparison_table,
    making_rows,
    metric_heading,
    misfit_table,
    parameters_table,
    pooled_errors,
)
from dashpot.calibrate.report.plots import plot_fit
from dashpot.calibrate.report.record import Record, Shown
from dashpot.calibrate.result import Fit
from dashpot.colours import colours_of
from dashpot.rendering import embedded, need_templates, write_page

if TYPE_CHECKING:
    from dashpot.calibrate.data.trajectory import Trajectory

# Trajectories whose curves are shown, from the best to the worst.
_MOST_SHOWN = 24


def write_report(
    fit: Fit,
    path: str | os.PathLike[str],
    *,
    held_out: Sequence[Trajectory] | None,
    head: float | None,
    beside: Mapping[str, Fit] | None,
    title: str,
    nthread: int | None,
) -> Path:
    """Write what `Fit.report` does."""
    need_templates()
    others = _others(beside)
    record = fit.record(nthread=nthread)
    name = record.stepper if record.stepper not in others else "this fit"
    colours = colours_of([name, *others])
    records = {label: other.record(nthread=nthread) for label, other in others.items()}
    held = None
    if held_out is not None:
        fits = {name: fit, **others}
        held = _held_out(fits, list(held_out), head, colours, nthread)
    elif head is not None:
        raise ValueError("head is of trajectories that are held out; give held_out too")
    threshold = float(special.ndtri(0.5 + 0.5 * fit.confidence)) ** 2
    values: dict[str, Any] = {
        "title": title,
        "summary": _summary(fit, record),
        "parameters": parameters_table(fit, record),
        "inertias": [
            {"name": name, "header": inertia_header(own), "rows": inertia_rows(own)}
            for name, own in fit.inertias().items()
        ],
        "combinations": [
            (str(c).split(" = ")[0], f"{c.value:.4g}", f"{100 * c.relative_error:.2g} %")
            for c in (fit.combinations if len(fit.combinations) > 1 else ())
        ],
        "profiles": embedded(
            profile_figure(record.profiles, record.units, threshold, colours[name])
        )
        if record.profiles
        else None,
        "correlation": embedded(plot_fit(fit)),
        "shown_note": f"{_note(record.trajectories)} {record.note}".strip(),
        "trajectories": _curves(
            record.trajectories,
            {label: {s.name: s for s in r.trajectories} for label, r in records.items()},
            name,
            colours,
        ),
        "sizes": [
            (s.name, s.frames, f"{s.duration:.4g}", f"{s.size:.3g}") for s in record.trajectories
        ],
        "clips": [
            {
                "address": embedded(animation(clip, colours[name])),
                "caption": f"{clip.trajectory}, {said} trajectory",
            }
            for clip, said in zip(
                record.clips, ("the median", "the worst")[-len(record.clips) :], strict=False
            )
        ],
        "channels": channels_table(record),
        "misfits": misfit_table(fit),
        "explanations": [str(explanation) for explanation in fit.explanations],
        "residuals": embedded(residual_figure(record.trajectories, colours[name])),
        "autocorrelation": embedded(autocorrelation_figure(record.trajectories, colours[name])),
        "beside_names": ", ".join(others),
        "comparison": comparison_table({name: record, **records}, {name: fit, **others}),
        "beside_parameters": [
            {"name": label, **parameters_table(other, records[label])}
            for label, other in others.items()
        ],
        "held_out": held,
        "made": making_rows(fit, record),
        "version": __version__,
    }
    return write_page(path, "dashpot.calibrate.report", "fit.html.j2", values)


def _others(beside: Mapping[str, Fit] | None) -> dict[str, Fit]:
    others = {} if beside is None else dict(beside) if isinstance(beside, Mapping) else None
    if others is None or not all(
        isinstance(label, str) and isinstance(other, Fit) for label, other in others.items()
    ):
        raise TypeError(f"beside must map names to fits, got {beside!r}")
    return others


def _summary(fit: Fit, record: Record) -> str:
    known = sum(e.identified for e in fit.estimates)
    count = len(record.trajectories)
    explained = "explains" if fit.noise_explains else "does not explain"
    text = (
        f"{known} of {len(fit.estimates)} parameters identified from {count} "
        f"trajector{'y' if count == 1 else 'ies'}, stepped by {record.stepper}. The {record.noise} "
        f"noise {explained} the residuals, whose variance is {fit.residual_variance:.3g}."
    )
    if fit.misfits:
        text += f" Residuals hang together in time: {', '.join(map(str, fit.misfits))}."
    if fit.explanations:
        text += f" {fit.explanations[0]}."
    return text if fit.converged else f"Not converged: {fit.message}. {text}"


def _note(trajectories: Sequence[Shown]) -> str:
    bands = (
        "Points are measured, lines simulated with the estimates. Bands hold 95 % of what "
        "the fit leaves open (dark), and of measurements with the stated noise (light)."
    )
    if len(trajectories) <= _MOST_SHOWN:
        return bands
    return (
        f"{bands} {_MOST_SHOWN} of {len(trajectories)} trajectories are shown, evenly from the "
        "largest residuals to the smallest."
    )


def _chosen(trajectories: Sequence[Shown]) -> list[Shown]:
    """Return trajectories to show: all in order or, of many, from the worst to the best."""
    if len(trajectories) <= _MOST_SHOWN:
        return list(trajectories)
    order = sorted(trajectories, key=lambda shown: -shown.size)
    places = np.linspace(0, len(order) - 1, _MOST_SHOWN).round().astype(int)
    return [order[place] for place in places]


def _curves(
    trajectories: Sequence[Shown],
    others: Mapping[str, Mapping[str, Shown]],
    name: str,
    colours: Mapping[str, str],
) -> list[dict[str, str]]:
    found = []
    for shown in _chosen(trajectories):
        same = {label: known[shown.name] for label, known in others.items() if shown.name in known}
        found.append(
            {
                "name": shown.name,
                "size": f"{shown.size:.3g}",
                "figure": embedded(curve_figure(shown, same, name, colours)),
                "caption": f"{shown.name}: measured and simulated.",
            }
        )
    return found


def _held_out(
    fits: Mapping[str, Fit],
    trajectories: list[Trajectory],
    head: float | None,
    colours: Mapping[str, str],
    nthread: int | None,
) -> dict[str, Any]:
    """Return what fits say of trajectories that they have not seen."""
    found = {
        label: fit.predict(trajectories, head=head, nthread=nthread) for label, fit in fits.items()
    }
    shown = {label: shown_predictions(fits[label], found[label]) for label in fits}
    errors = {label: pooled_errors(fits[label], found[label]) for label in fits}
    names = list(dict.fromkeys(name for each in errors.values() for name in each))
    first = next(iter(fits))
    others = {label: {s.name: s for s in shown[label]} for label in fits if label != first}
    started = (
        "from the initial states that they carry"
        if head is None
        else f"from initial states fitted to their first {head:g} s"
    )
    return {
        "note": f"{len(trajectories)} trajectories that were not fitted, simulated {started}.",
        "header": ("fit", *(metric_heading(name) for name in names)),
        "rows": [
            (label, *(f"{each[n]:.4g}" if n in each else "-" for n in names))
            for label, each in errors.items()
        ],
        "trajectories": _curves(shown[first], others, first, colours),
    }
