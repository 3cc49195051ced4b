"""Pages that need nothing from outside, made from Jinja2 templates.

A template extends ``page.html.j2``, which holds the style; it is given figures as data.
"""

from __future__ import annotations

import base64
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dashpot.figures import picture
from dashpot.report import STYLE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["embedded", "need_templates", "write_page"]

_EXTRA = "reports need the package jinja2; install it with  pip install 'dashpot[report]'"


def need_templates() -> None:
    """Raise ImportError, naming the extra, where Jinja2 is not installed."""
    try:
        import jinja2  # noqa: F401
    except ModuleNotFoundError as error:
        raise ImportError(_EXTRA, name="jinja2") from error


def write_page(
    path: str | os.PathLike[str], package: str, template: str, values: dict[str, Any]
) -> Path:
    """Render a template of a package (its folder ``templates``) and write it as one file."""
    need_templates()
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package), PackageLoader("dashpot")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    text = environment.get_template(template).render(style=STYLE, **values)
    file = Path(path)
    file.write_text(text, encoding="utf-8")
    return file


def embedded(figure: Figure | bytes) -> str:
    """Return a figure, or the bytes of a GIF, as an address that holds it."""
    if isinstance(figure, bytes):
        kind, data = "gif", figure
    else:
        kind, data = "svg+xml", picture(figure, "svg")
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"
