"""How much searches may simulate."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Budget:
    """Simulated sets of trajectories that searches may still spend, and what they reached.

    Derivatives count too. A search takes one step at least, and may overrun by one Jacobian.
    """

    def __init__(self, total: int, report: Callable[[int, float], None]) -> None:
        self.spent = 0
        self.history: list[float] = []
        self._limit = total
        self._report = report

    @property
    def left(self) -> int:
        """Evaluations left in the present share."""
        return max(0, self._limit - self.spent)

    @contextmanager
    def share(self, parts: int) -> Iterator[None]:
        """Allow one of `parts` equal shares of what is left."""
        limit = self._limit
        self._limit = self.spent + self.left // parts
        try:
            yield
        finally:
            self._limit = limit

    def note(self, evaluations: int, cost: float) -> None:
        """Record evaluations and the lowest cost of the search that made them."""
        self.spent += evaluations
        self.history.append(cost)
        self._report(self.spent, cost)
