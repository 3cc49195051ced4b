"""A progress bar over the budget of a fit."""

from __future__ import annotations

import time
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

# Between two pictures of a notebook, s.
_INTERVAL = 0.2


class ProgressBar:
    """A progress bar over the budget, in a terminal or notebook, or nothing.

    That of a terminal goes when it is done, that of a notebook leaves a line.
    """

    def __init__(self, shown: bool, total: int) -> None:
        self._progress: Progress | _NotebookBar | None = None
        self._task: Any = None
        self._total = total
        if not shown:
            return
        if Console().is_jupyter:
            self._progress = _NotebookBar()
        else:
            self._progress = Progress(
                TextColumn("calibrating"),
                BarColumn(),
                TextColumn("{task.completed:.0f} simulations, cost {task.fields[cost]:.6g}"),
                TimeElapsedColumn(),
                transient=True,
            )

    def __enter__(self) -> ProgressBar:
        if self._progress:
            self._progress.start()
            self._task = self._progress.add_task("fit", total=self._total, cost=float("nan"))
        return self

    def __exit__(self, *exception: object) -> None:
        if self._progress:
            self._progress.stop()

    def report(self, evaluations: int, cost: float) -> None:
        """Show the evaluations spent and the lowest cost of the present search."""
        if self._progress:
            self._progress.update(self._task, completed=evaluations, cost=cost)


class _NotebookBar:
    """A bar that needs no widgets: rich shows none in a notebook without ipywidgets."""

    def start(self) -> None:
        self._began = time.monotonic()
        self._shown = -1.0
        self._handle: Any = None
        self._done, self._cost = 0, float("nan")

    def add_task(self, name: str, *, total: int, cost: float) -> str:
        self._total = total
        self._show("calibrating", bar=True)
        return name

    def update(self, task: str, *, completed: int, cost: float) -> None:
        self._done, self._cost = completed, cost
        if time.monotonic() - self._shown > _INTERVAL:
            self._show("calibrating", bar=True)

    def stop(self) -> None:
        self._show("calibrated", bar=False)

    def _show(self, word: str, *, bar: bool) -> None:
        from IPython.display import display  # a notebook has it

        self._shown = time.monotonic()
        seconds = self._shown - self._began
        text = f"{self._done} simulations, cost {self._cost:.6g}, {seconds:.1f} s"
        inside = f'<progress value="{self._done}" max="{self._total}"></progress> ' if bar else ""
        data = {"text/plain": f"{word}: {text}", "text/html": f"<div>{word} {inside}{text}</div>"}
        if self._handle is None:
            self._handle = display(data, raw=True, display_id=True)  # type: ignore[no-untyped-call]
        else:
            self._handle.update(data, raw=True)
