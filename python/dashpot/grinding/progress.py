"""A bar of how many passes were simulated."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["rollout_bar"]


@contextmanager
def rollout_bar(shown: bool) -> Iterator[Callable[[int], None]]:
    """Yield what to call with a number of passes that were simulated; it counts them on a bar."""
    if not shown:
        yield lambda count: None
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(),
        TextColumn("planning: {task.completed} passes simulated"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("planning", total=None)
        yield lambda count: bar.advance(task, count)
