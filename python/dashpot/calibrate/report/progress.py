"""A progress bar over the budget of a fit."""

from __future__ import annotations

from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn


class ProgressBar:
    """A rich progress bar over the budget, or nothing."""

    def __init__(self, shown: bool, total: int) -> None:
        self._progress = (
            Progress(
                TextColumn("calibrating"),
                BarColumn(),
                TextColumn("{task.completed:.0f} simulations, cost {task.fields[cost]:.6g}"),
                TimeElapsedColumn(),
                transient=True,
            )
            if shown
            else None
        )
        self._total = total

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
