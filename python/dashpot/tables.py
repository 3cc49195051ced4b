"""Tables as plain text, and as notebooks show them."""

from __future__ import annotations

import html
import io
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

# Wide enough for every table of the package without folding a column.
_WIDTH = 100


def table_text(table: Table) -> str:
    """Return a rich table as lines of plain text."""
    from rich.console import Console

    text = io.StringIO()
    Console(file=text, width=_WIDTH, color_system=None, force_jupyter=False).print(table)
    return "\n".join(line.rstrip() for line in text.getvalue().splitlines())


def table_html(table: Table) -> str:
    """Return a rich table as HTML for a notebook: its text, with the width of its characters."""
    text = html.escape(table_text(table))
    return f'<pre style="line-height: normal; white-space: pre">{text}</pre>'
