"""Tables as plain text, and as notebooks show them."""

from __future__ import annotations

import html
import io
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

# Wide enough for every table of the package without folding a column.
_WIDTH = 100

_CELL = "padding: .25em .9em .25em 0; vertical-align: top;"


def table_text(table: Table) -> str:
    """Return a rich table as lines of plain text."""
    from rich.console import Console

    text = io.StringIO()
    Console(file=text, width=_WIDTH, color_system=None, force_jupyter=False).print(table)
    return "\n".join(line.rstrip() for line in text.getvalue().splitlines())


def table_html(table: Table) -> str:
    """Return a rich table as an HTML table: headings, rows, title and caption."""
    columns = list(table.columns)
    aligned = [f"{_CELL} text-align: {column.justify}" for column in columns]
    head = "".join(
        f'<th style="{style}">{_escaped(column.header)}</th>'
        for style, column in zip(aligned, columns, strict=True)
    )
    rows = "\n".join(
        "<tr>"
        + "".join(
            f'<td style="{style}">{_escaped(cell)}</td>'
            for style, cell in zip(aligned, row, strict=True)
        )
        + "</tr>"
        for row in zip(*(column.cells for column in columns), strict=True)
    )
    said = [text for text in (table.title, table.caption) if text is not None]
    caption = "".join(f"<div>{_escaped(text)}</div>" for text in said)
    return (
        '<table style="border-collapse: collapse">'
        f'<caption style="text-align: left">{caption}</caption>'
        f"<thead><tr>{head}</tr></thead>\n<tbody>{rows}</tbody></table>"
    )


def _escaped(cell: RenderableType) -> str:
    """Return a text of a table as HTML, in one line where it is broken into several."""
    from rich.text import Text

    plain = Text.from_markup(cell).plain if isinstance(cell, str) else str(cell)
    return html.escape(" ".join(plain.split()))
