"""A fit as a table and as plain types."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from dashpot.calibrate.inference.estimate import Estimate, interval_digits, percent
from dashpot.calibrate.result import Fit


def fit_table(fit: Fit, truth: dict[str, float] | None) -> Table:
    """Return the table of `Fit.table`."""
    if truth is not None:
        missing = [e.name for e in fit.estimates if e.name not in truth]
        if missing:
            raise ValueError(f"truth has no value of {', '.join(missing)}")
    explained = "the stated noise explains" if fit.noise_explains else "more than noise is in"
    caption = f"{explained} the residuals: their variance is {fit.residual_variance:.3g}"
    if fit.noise_overstated:
        caption += ", so that noise is stated too large"
    if fit.errors == "independent":
        caption += "; intervals are scaled with it"
    if fit.misfits:
        caption += f"\nresiduals hang together: {', '.join(map(str, fit.misfits))}"
    caption += "".join(f"\n{explanation}" for explanation in fit.explanations)
    if not fit.converged:
        caption = f"not converged: {fit.message}\n{caption}"
    table = Table(
        title=f"Calibration ({fit.method}, {fit.evaluations} simulations)", caption=escape(caption)
    )
    table.add_column("parameter")
    if truth is not None:
        table.add_column("truth", justify="right")
    table.add_column("estimate", justify="right")
    table.add_column(f"{percent(fit.confidence)} interval", justify="right")
    table.add_column("identified")
    for e in fit.estimates:
        row = [escape(e.name)]
        if truth is not None:
            row.append(f"{truth[e.name]:.{interval_digits(e.lower, e.upper)}g}")
        digits = interval_digits(e.lower, e.upper)
        row += [f"{e.value:.{digits}g}", e.interval]
        row.append(grade_word(e))
        table.add_row(*row)
    for name, value in fit.problem.held.items():
        known = [] if truth is None else [f"{truth[name]:.6g}" if name in truth else ""]
        table.add_row(escape(name), *known, f"{value:.6g}", "", HELD)
    return table


HELD = "held"
"""What is said of frozen parameters in place of a grade."""


def grade_word(estimate: Estimate) -> str:
    """Return whether data identify a parameter, in a word or two."""
    if not estimate.identified:
        return "no"
    return "within the misfit" if estimate.grade == "within misfit" else "yes"


def fit_dict(fit: Fit) -> dict[str, Any]:
    """Return what `Fit.to_dict` does."""
    return {
        "estimates": [
            {
                "name": e.name,
                "value": e.value,
                "standard_error": e.standard_error if np.isfinite(e.standard_error) else None,
                "lower": e.lower,
                "upper": e.upper,
                "at_bounds": list(e.at_bounds),
                "identified": e.identified,
                "nonlinearity": e.nonlinearity,
                "grade": e.grade,
                "widening": e.widening if np.isfinite(e.widening) else None,
                "statement": e.statement,
            }
            for e in fit.estimates
        ],
        "held": fit.problem.held,
        "correlation": fit.correlation.tolist(),
        "combinations": [
            {
                "exponents": dict(c.exponents),
                "value": c.value,
                "relative_error": c.relative_error,
            }
            for c in fit.combinations
        ],
        "cost": fit.cost,
        "cost_history": fit.cost_history.tolist(),
        "evaluations": fit.evaluations,
        "seconds": fit.seconds,
        "method": fit.method,
        "loss": fit.loss,
        "loss_scale": fit.loss_scale,
        "errors": fit.errors,
        "confidence": fit.confidence,
        "converged": fit.converged,
        "noise_explains": fit.noise_explains,
        "noise_overstated": fit.noise_overstated,
        "message": fit.message,
        "channels": [
            {
                name: value if not isinstance(value, float) or np.isfinite(value) else None
                for name, value in asdict(channel).items()
            }
            for channel in fit.channels
        ],
        "explanations": [{**asdict(e), "said": str(e)} for e in fit.explanations],
        "metrics": fit.metrics(),
    }
