"""The inertia of a body as a table."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.markup import escape
from rich.table import Table

from dashpot.calibrate.inference.body_inertia import BodyInertia
from dashpot.calibrate.inference.estimate import interval_digits, percent
from dashpot.calibrate.report.fit_report import HELD, grade_word


def inertia_table(inertia: BodyInertia) -> Table:
    """Return the table of `BodyInertia.table`."""
    table = Table(title=f"Inertia of {escape(str(inertia.body))}")
    for title in inertia_header(inertia):
        words = title in ("quantity", "identified")
        table.add_column(title, justify="left" if words else "right")
    for row in inertia_rows(inertia):
        table.add_row(*row)
    return table


def inertia_header(inertia: BodyInertia) -> Sequence[str]:
    """Return the titles of the columns."""
    return ("quantity", "unit", "estimate", f"{percent(inertia.confidence)} interval", "identified")


def inertia_rows(inertia: BodyInertia) -> list[Sequence[str]]:
    """Return a row for each quantity; those that are held, or not known, have no interval."""
    rows: list[Sequence[str]] = []
    for e, unit in zip(inertia.estimates, inertia.units, strict=True):
        value, interval, word = f"{e.value:.4g}", "", grade_word(e)
        if e.standard_error == 0.0:
            value, word = f"{e.value:.6g}", HELD
        elif math.isfinite(e.upper):
            value = f"{e.value:.{interval_digits(e.lower, e.upper)}g}"
            interval = e.interval
        rows.append((e.name, unit, value, interval, word))
    return rows
