"""Tables of a report: headings and rows of text."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from dashpot.calibrate.inference.estimate import (
    interval_digits,
    percent,
)
from dashpot.calibrate.report.drawings import autocorrelation, by_channel
from dashpot.calibrate.report.fit_report import HELD, grade_word
from dashpot.calibrate.report.prediction_report import prediction_errors
from dashpot.calibrate.report.record import Record
from dashpot.calibrate.result import Fit

if TYPE_CHECKING:
    from dashpot.calibrate.prediction import Prediction

_FROZEN = "frozen: it is set, but not fitted"


def parameters_table(fit: Fit, record: Record) -> dict[str, Any]:
    """Return the estimates of a fit with units, intervals and statements."""
    interval = f"{percent(fit.confidence)} interval"
    return {
        "header": ("parameter", "unit", "estimate", interval, "identified", "why"),
        "rows": [
            (
                e.name.replace("_", " "),
                record.units.get(e.name, ""),
                f"{e.value:.{interval_digits(e.lower, e.upper)}g}",
                e.interval,
                grade_word(e),
                e.statement,
            )
            for e in fit.estimates
        ]
        + [
            (name.replace("_", " "), record.units.get(name, ""), f"{value:.6g}", "", HELD, _FROZEN)
            for name, value in fit.problem.held.items()
        ],
    }


def channels_table(record: Record) -> dict[str, Any]:
    """Return a table with the size of the residuals of each channel, and their correlation."""
    scales = {
        residual.name: (residual.sigma, residual.unit)
        for shown in record.trajectories
        for residual in shown.residuals
    }
    rows = []
    for name, series in by_channel(record.trajectories).items():
        weighted = np.concatenate([values for _, values in series])
        weighted = weighted[np.isfinite(weighted)]
        correlation, deviation = autocorrelation(series)
        size = float(np.sqrt(np.mean(weighted**2)))
        sigma, unit = scales[name]
        alike = "-"
        known = np.flatnonzero(np.isfinite(correlation))  # readings may be rarer than frames
        if known.size:
            alike = f"{correlation[known[0]]:+.2f} ± {deviation[known[0]]:.2f}"
        rows.append(
            (
                name,
                len(weighted),
                f"{sigma:.4g} {unit}",
                f"{sigma * size:.4g} {unit}",
                f"{size:.3g}",
                alike,
            )
        )
    header = (
        "channel",
        "numbers",
        f"{record.noise} σ",
        "residuals, rms",
        "rms [σ]",
        "with the one before",
    )
    return {"header": header, "rows": rows}


def misfit_table(fit: Fit) -> dict[str, Any] | None:
    """Return what residuals say of each channel; None of a fit that does not say it."""
    if not fit.channels:
        return None
    return {
        "header": (
            "channel",
            "numbers",
            "rms [σ]",
            "correlation of neighbours",
            "in deviations of noise",
            "left over of what it shows",
            "misfit",
        ),
        "rows": [
            (
                c.channel,
                c.count,
                f"{c.size:.3g}",
                f"{c.correlation:+.2f}",
                f"{c.deviations:.1f}",
                f"{100 * c.left_over:.2g} %",
                "yes" if c.misfit else "no",
            )
            for c in fit.channels
            if c.count
        ],
    }


def comparison_table(
    records: Mapping[str, Record], fits: Mapping[str, Fit]
) -> dict[str, Any] | None:
    """Return what fits beside each other leave over; None of one alone."""
    if len(records) < 2:
        return None
    names = list(dict.fromkeys(name for r in records.values() for name in r.metrics))
    return {
        "header": ("fit", "parameters", "simulations", *(metric_heading(name) for name in names)),
        "rows": [
            (
                label,
                len(fits[label].estimates),
                fits[label].evaluations,
                *(f"{r.metrics[n]:.4g}" if n in r.metrics else "-" for n in names),
            )
            for label, r in records.items()
        ],
    }


def pooled_errors(fit: Fit, predictions: Sequence[Prediction]) -> dict[str, float]:
    """Return root mean squares over trajectories, of what the fit's problem counts as measured."""
    squares: dict[str, list[float]] = {}
    sigma = fit.problem.sigma
    for prediction in predictions:
        for name, value in prediction_errors(prediction).items():
            counted = {"position_rms": sigma[:3], "rotation_rms": sigma[3:]}.get(name, np.ones(1))
            if np.isfinite(counted).any():
                squares.setdefault(name, []).append(value**2)
    return {name: float(np.sqrt(np.mean(all_))) for name, all_ in squares.items()}


def metric_heading(name: str) -> str:
    """Return the heading of a metric of `Fit.metrics`."""
    known = {
        "position_rms": "position, rms [m]",
        "rotation_rms": "rotation, rms [rad]",
        "residual_variance": "residual variance",
    }
    short = re.sub(r"^(sensors|events|scalars|residuals)\.", "", name)
    return known.get(name, short.replace("_rms", ", rms"))


def making_rows(fit: Fit, record: Record) -> list[tuple[str, str]]:
    """Return how a fit was made: search, options, versions."""
    rows = [
        ("search", f"{fit.method}, {fit.evaluations} simulations in {fit.seconds:.1f} s"),
        ("ended", f"{'converged' if fit.converged else 'not converged'}: {fit.message}"),
        ("loss", fit.loss if fit.loss == "linear" else f"{fit.loss}, scale {fit.loss_scale:g}"),
        ("errors", f"{fit.errors}, {percent(fit.confidence)} confidence"),
        ("stepped by", record.stepper),
    ]
    if fit.made is not None:
        told = asdict(fit.made)
        model, seed, date = (told.pop(key) for key in ("model", "seed", "date"))
        rows += [
            ("seed", str(seed)),
            ("model", f"SHA-256 {model}"),
            ("date", str(date)),
            ("versions", ", ".join(f"{name} {version}" for name, version in told.items())),
        ]
    return rows
