"""How much a fit may simulate."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from dashpot.calibrate.residuals.objective import Objective


class Budget:
    """Simulated sets of trajectories that a fit may still spend, and what its searches reached.

    Derivatives count too. A search evaluates its start at least, and inference takes one Jacobian.

    Parameters
    ----------
    total
        Of the whole fit.
    report
        Called with what is spent and the lowest cost.
    reserve
        What of it searches leave to inference, until `release`.
    """

    def __init__(self, total: int, report: Callable[[int, float], None], reserve: int = 0) -> None:
        self.spent = 0
        self.total = total
        self.history: list[float] = []
        self._limit = total - reserve
        self._report = report
        self._counted: tuple[Objective, int] | None = None

    @contextmanager
    def beside(self, objective: Objective) -> Iterator[None]:
        """Count evaluations of an objective that no search makes, while they are made."""
        self._counted = (objective, objective.evaluations)
        try:
            yield
        finally:
            self.spent = self.spent_now
            self._counted = None

    def release(self, keep: int = 0) -> None:
        """Let what is reserved be spent, but for what is to be kept."""
        self._limit = max(self._limit, self.total - keep)

    @property
    def left(self) -> int:
        """Evaluations left in the present share."""
        return max(0, self._limit - self.spent_now)

    @property
    def spent_now(self) -> int:
        """What is spent, with what is `beside`."""
        if self._counted is None:
            return self.spent
        objective, before = self._counted
        return self.spent + objective.evaluations - before

    @contextmanager
    def share(self, share: float) -> Iterator[None]:
        """Allow a share of what is left, in (0, 1]."""
        limit = self._limit
        self._limit = self.spent + int(self.left * share)
        try:
            yield
        finally:
            self._limit = limit

    def note(self, evaluations: int, cost: float) -> None:
        """Record evaluations and the lowest cost of the search that made them."""
        self.spent += evaluations
        self.history.append(cost)
        self._report(self.spent, cost)

    def spend(self, evaluations: int) -> None:
        """Record evaluations that no search made."""
        self.spent += evaluations
