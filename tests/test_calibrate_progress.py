"""The progress of a fit in a notebook's kernel, and in a terminal."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from dashpot.calibrate.report import progress
from dashpot.calibrate.report.progress import ProgressBar

CELL = """
import os, time
from dashpot.calibrate.report.progress import ProgressBar
with ProgressBar(True, 2000) as bar:
    for k in range(6):
        bar.report(100 * k, 7.5)
        time.sleep(0.06)
"""


def test_a_kernel_shows_one_line_that_changes():
    """No widgets are needed, and nothing else is printed."""
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    shown = []

    class Client(nbclient.NotebookClient):
        def process_message(self, message, cell, index):
            if message["msg_type"] in ("display_data", "update_display_data"):
                shown.append(message["content"]["data"])
            return super().process_message(message, cell, index)

    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(CELL)])
    Client(book, timeout=60, kernel_name="python3").execute()
    (output,) = book.cells[0].outputs
    assert output.output_type == "display_data"
    assert output.data["text/plain"].startswith("calibrated: 500 simulations, cost 7.5, 0.")
    assert len(shown) >= 3
    assert all("<progress" in data["text/html"] for data in shown[:-1])
    assert "<progress" not in output.data["text/html"]


def test_a_terminal_shows_a_bar_that_goes(monkeypatch):
    out = io.StringIO()
    terminal = Console(file=out, force_terminal=True, width=90)
    monkeypatch.setattr("rich._console", terminal)
    with ProgressBar(True, 2000) as bar:
        bar.report(1234, 7.5)
        bar._progress.refresh()
    text = out.getvalue()
    assert "1234 simulations, cost 7.5" in text
    assert text.endswith("\x1b[2K")  # the line is cleared


def test_nothing_is_shown_where_it_was_not_asked_for(capsys, monkeypatch):
    monkeypatch.setattr(progress, "_NotebookBar", None)
    with ProgressBar(False, 2000) as bar:
        bar.report(100, 1.0)
    assert capsys.readouterr() == ("", "")
