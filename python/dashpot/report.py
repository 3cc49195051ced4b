"""Self-contained HTML reports: text, tables and pictures in one file, nothing loaded from outside.

Every picture is also written as a PNG beside the report, under its own name.
"""

from __future__ import annotations

import base64
import html
import io
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Picture", "Section", "Table", "Text", "write_report"]

FILE_NAME = "report.html"
_DPI = 150

STYLE = """
:root { --ink: #1c2430; --muted: #5b6776; --line: #d9dee5; --accent: #0072b2; }
* { box-sizing: border-box; }
body { margin: 0; background: #fff; color: var(--ink); text-rendering: optimizeLegibility;
  font: 17px/1.6 "Charter", "Bitstream Charter", "Source Serif Pro", Georgia, serif; }
main { max-width: 62rem; margin: 0 auto; padding: 4rem 1.5rem 6rem; }
h1, h2, table, figcaption, footer, nav { font-family: system-ui, -apple-system, "Segoe UI",
  "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: 2.1rem; line-height: 1.2; letter-spacing: -.02em; margin: 0 0 .6rem; }
h2 { font-size: 1.3rem; letter-spacing: -.01em; margin: 3.2rem 0 .8rem; padding-top: .9rem;
  border-top: 2px solid var(--ink); }
p { max-width: 42rem; margin: 0 0 1rem; }
.summary { font-size: 1.15rem; color: var(--muted); }
.scroll { overflow-x: auto; margin: 1.4rem 0; }
table { border-collapse: collapse; font-size: .84rem; font-variant-numeric: tabular-nums; }
caption { caption-side: top; text-align: left; color: var(--muted); padding-bottom: .5rem; }
th, td { padding: .4rem .9rem .4rem 0; text-align: right; border-bottom: 1px solid var(--line);
  vertical-align: top; }
th { font-weight: 600; border-bottom: 1.5px solid var(--ink); }
th:first-child, td:first-child { text-align: left; }
td.text { text-align: left; }
tr.strong td { font-weight: 650; color: var(--accent); }
figure { margin: 1.8rem 0; }
figure img { display: block; width: 100%; height: auto; }
figcaption { font-size: .84rem; color: var(--muted); margin-top: .5rem; max-width: 46rem; }
footer { margin-top: 4rem; font-size: .8rem; color: var(--muted); }
@media print { main { padding: 0; } h2 { break-after: avoid; } figure { break-inside: avoid; } }
"""


@dataclass(frozen=True)
class Text:
    """A paragraph of plain text."""

    text: str


@dataclass(frozen=True)
class Table:
    """A table of plain text; the first column names the row.

    Attributes
    ----------
    header
        One cell per column.
    rows
        As many cells each.
    caption
        Above the table.
    strong
        Indices of the rows to stress.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    strong: Sequence[int] = ()


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure with a caption; `name` names its PNG file (letters, digits, ``_`` and ``-``)."""

    name: str
    figure: Figure
    caption: str = ""

    def png(self) -> bytes:
        """Draw the figure."""
        stream = io.BytesIO()
        self.figure.savefig(stream, format="png", dpi=_DPI)
        return stream.getvalue()


Block = Text | Table | Picture


@dataclass(frozen=True)
class Section:
    """A titled part of a report."""

    title: str
    blocks: Sequence[Block]


def write_report(
    folder: str | os.PathLike[str],
    *,
    title: str,
    summary: str,
    sections: Sequence[Section],
    footer: str = "",
) -> Path:
    """Write ``report.html`` and one PNG per picture into `folder`, which is made where missing.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    ValueError
        If two pictures share a name, a name is unfit for a file, or a row of a table has not as
        many cells as the header; nothing is written then.
    OSError
        If the folder cannot be written.
    """
    _check(sections)
    directory = Path(folder)
    directory.mkdir(parents=True, exist_ok=True)
    body = []
    for section in sections:
        body.append(f"<section>\n<h2>{html.escape(section.title)}</h2>")
        for block in section.blocks:
            if isinstance(block, Picture):
                png = block.png()
                (directory / f"{block.name}.png").write_bytes(png)
                body.append(_picture(block, png))
            elif isinstance(block, Table):
                body.append(_table(block))
            else:
                body.append(f"<p>{html.escape(block.text)}</p>")
        body.append("</section>")
    report = directory / FILE_NAME
    report.write_text(_page(title, summary, "\n".join(body), footer), encoding="utf-8")
    return report


def _check(sections: Sequence[Section]) -> None:
    names: set[str] = set()
    for section in sections:
        for block in section.blocks:
            if isinstance(block, Picture):
                if not re.fullmatch(r"[A-Za-z0-9_-]+", block.name):
                    raise ValueError(f"picture name {block.name!r} is unfit for a file")
                if block.name in names:
                    raise ValueError(f"two pictures are named {block.name!r}")
                names.add(block.name)
            elif isinstance(block, Table):
                for index, row in enumerate(block.rows):
                    if len(row) != len(block.header):
                        raise ValueError(
                            f"row {index} of a table in {section.title!r} has {len(row)} cells, "
                            f"the header {len(block.header)}"
                        )


def _picture(picture: Picture, png: bytes) -> str:
    data = base64.b64encode(png).decode("ascii")
    caption = html.escape(picture.caption)
    return (
        f'<figure><img src="data:image/png;base64,{data}" alt="{caption}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _table(table: Table) -> str:
    def cell(column: int, value: str) -> str:
        # Numbers align right, words left.
        kind = "" if column == 0 or re.match(r"\s*[-−+±<≤~]?\s*[\d.]", value) else ' class="text"'
        return f"<td{kind}>{html.escape(value)}</td>"

    head = "".join(f"<th>{html.escape(name)}</th>" for name in table.header)
    rows = []
    for index, row in enumerate(table.rows):
        kind = ' class="strong"' if index in table.strong else ""
        cells = "".join(cell(column, value) for column, value in enumerate(row))
        rows.append(f"<tr{kind}>{cells}</tr>")
    caption = f"<caption>{html.escape(table.caption)}</caption>" if table.caption else ""
    return (
        f'<div class="scroll"><table>{caption}<thead><tr>{head}</tr></thead>\n'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def _page(title: str, summary: str, body: str, footer: str) -> str:
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{html.escape(title)}</title>
<style>{STYLE}</style>
</head>
<body>
<main>
<h1>{html.escape(title)}</h1>
<p class="summary">{html.escape(summary)}</p>
{body}
<footer>{html.escape(footer)}</footer>
</main>
</body>
</html>
"""
