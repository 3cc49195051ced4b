"""Figures that are drawn without pyplot: no display is needed, and notebooks show them."""

from __future__ import annotations

import io
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

__all__ = ["ShownFigure", "clean", "legend_above", "picture"]

# Dots per inch in notebooks and pages; the first is what a figure's size is measured in.
_SHOWN_DPI = 100
_SHARP = 1.6


# What is told of an SVG refers to terms of others.
_SVG_TERMS = ("Date", "Creator", "Format", "Type")


class ShownFigure(Figure):
    """A figure that any notebook shows, ``%matplotlib inline`` or not."""

    def _repr_png_(self) -> tuple[bytes, dict[str, Any]]:
        """Return a picture, and the size at which a notebook shows it."""
        width, height = self.get_size_inches()
        size = {"width": round(_SHOWN_DPI * width), "height": round(_SHOWN_DPI * height)}
        return picture(self, "png", dpi=_SHARP * _SHOWN_DPI), size


def picture(figure: Figure, form: str, *, dpi: float = 150.0) -> bytes:
    """Return a figure as the bytes of a file, the same for the same figure."""
    from matplotlib import rc_context

    stream = io.BytesIO()
    metadata = {"svg": dict.fromkeys(_SVG_TERMS), "pdf": {"CreationDate": None}}.get(form)
    with rc_context({"svg.hashsalt": "dashpot", "svg.fonttype": "path"}):
        figure.savefig(stream, format=form, dpi=dpi, metadata=metadata)
    return stream.getvalue()


def clean(*panels: Axes) -> None:
    """Give axes a faint grid and no frame at the top and on the right."""
    for axes in panels:
        axes.grid(True, linewidth=0.4, alpha=0.5)
        axes.spines[["top", "right"]].set_visible(False)


def legend_above(figure: Figure, axes: Axes) -> None:
    """Put the legend of axes above all axes of a figure, where it covers no curve."""
    handles, labels = axes.get_legend_handles_labels()
    laid_out = figure.get_layout_engine() is not None
    if labels:
        figure.legend(
            handles,
            labels,
            loc="outside upper center" if laid_out else "upper center",
            ncols=min(len(labels), 6),
            frameon=False,
            fontsize="small",
        )
