"""The cost along single parameters, all other unknowns refitted: profiles.

From the end of a search each parameter is taken outwards to both sides, in distances that double
from the half-width of its interval to its bound, or to where the cost is hopelessly high. At each
value the others move as the Jacobian says, and are refitted by a few Gauss-Newton steps. No
derivatives are taken on the way: each simulation corrects the Jacobian of its trajectories by a
secant (Broyden, Math. Comp. 19, 1965; block by block after Schubert, Math. Comp. 24, 1970), which
follows the trend of a rough cost besides. All walks go in step, so that each round is one batch.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.residuals.arrow import ArrowMatrix, blocks_of
from dashpot.calibrate.residuals.losses import Loss
from dashpot.calibrate.search.trust_region import Linear, step_in_bounds

Array = NDArray[np.float64]

# A walk ends where the refitted cost is above that of its beginning by this factor: twice as many
# standard deviations of noise in all residuals.
_HOPELESS = 4.0
# The first value is at most this share of the way to the bound off.
_LONGEST_FIRST = 0.25
# Refits at one value, and the share of the rise of the cost that they have to take back.
_MOST_REFITS = 6
_WORTHWHILE = 0.1
# Steps are at most so many ranges of parameters, or tenths of a metre or radian, m/s or rad/s of
# initial states, long: what data hardly determine stays near.
_LONGEST_STEP = 3.0
# Keeps linear problems at full rank, as in searches.
_HOLD = 1e-4


@dataclass(frozen=True, eq=False)
class Place:
    """A point (n,) with its residuals (m,), infinite where it fails, and its cost."""

    point: Array
    residuals: Array
    cost: float


Walk: TypeAlias = Generator[Array, Array, None]


class Profiles:
    """Profiles of a cost around the end of a search.

    Parameters
    ----------
    loss
        Whose sum is the cost.
    bounds
        (p,) lower and upper bounds of the parameters.
    units
        (n,) ranges of the parameters and possible sizes of initial states, in which steps are
        measured.
    least_rise
        Of the cost, below which nothing is refitted.
    """

    def __init__(
        self, loss: Loss, bounds: tuple[Array, Array], units: Array, least_rise: float
    ) -> None:
        self._loss = loss
        self._lower, self._upper = bounds
        self._units = units
        self._least_rise = least_rise

    def around(
        self,
        evaluate: Callable[[Array], Array],
        end: Place,
        jacobian: ArrowMatrix,
        half_widths: Array,
        left: Callable[[], float] = lambda: np.inf,
    ) -> tuple[list[tuple[list[Place], list[Place]]], bool]:
        """Return by parameter the places below and above the end, and whether walks came to ends.

        Places are in order from the end outwards.

        Parameters
        ----------
        evaluate
            Residuals (k, m) of points (k, n), infinite where one fails.
        end, jacobian
            Where walks begin.
        half_widths
            (p,) distances of the first values, infinite of parameters that are not walked.
        left
            How many evaluations may follow; walks stop where there are too few.
        """
        walks = []
        places: list[list[Place]] = []
        for i, half_width in enumerate(half_widths):
            for sign, room in (
                (-1.0, end.point[i] - self._lower[i]), (1.0, self._upper[i] - end.point[i])
            ):  # fmt: skip
                ways = _distances(float(half_width), float(room))
                places.append([])
                values = end.point[i] + sign * ways
                walks.append(self._walk(end, jacobian, i, values, places[-1]))
        complete = _in_step(walks, evaluate, left)
        return list(zip(places[::2], places[1::2], strict=True)), complete

    def cost(self, residuals: Array) -> float:
        """Return the cost of residuals (m,), infinite where they are."""
        if not np.isfinite(residuals).all():
            return np.inf
        return 0.5 * float(self._loss.values(residuals).sum())

    def _walk(
        self, end: Place, jacobian: ArrowMatrix, held: int, values: Array, visited: list[Place]
    ) -> Walk:
        """Visit values of a parameter, and append the places that it comes to."""
        place = end
        for value in values:
            place, jacobian = yield from self._refit(place, end.cost, jacobian, held, float(value))
            if not np.isfinite(place.cost):
                break
            visited.append(place)
            if place.cost > _HOPELESS * end.cost:
                break

    def _refit(
        self, start: Place, lowest: float, jacobian: ArrowMatrix, held: int, value: float
    ) -> Generator[Array, Array, tuple[Place, ArrowMatrix]]:
        """Go to a value of a parameter and refit all others; return the place and the Jacobian."""
        best = start
        for refit in range(1 + _MOST_REFITS):
            room = (
                self._lower - best.point[: len(self._lower)],
                self._upper - (best.point[: len(self._upper)]),
            )
            for side in room:
                side[held] = value - best.point[held]
            linear = Linear(jacobian, best.residuals, self._loss, _HOLD, 0.0 * best.point)
            radius = _LONGEST_STEP * np.sqrt(jacobian.trajectories)
            step = step_in_bounds(linear, 1.0 / self._units, radius, *room)
            rise = max(best.cost - lowest, self._least_rise)
            if refit and linear.reduction(step) < _WORTHWHILE * rise:
                break
            point = best.point + step
            count = len(self._lower)
            point[:count] = np.clip(point[:count], self._lower, self._upper)
            point[held] = value
            residuals = yield point
            place = Place(point, residuals, self.cost(residuals))
            if np.isfinite(place.cost):
                change = residuals - best.residuals
                jacobian = _secant(jacobian, point - best.point, change, self._units)
            if refit == 0 or place.cost < best.cost:
                best = place
            if not np.isfinite(place.cost):
                break
        return best, jacobian


def reach(places: list[Place], held: int, begin: Place, floor: float, rise: float) -> float:
    """Return how far from its value at the beginning a parameter goes before the cost rises enough.

    Beyond the last place where the cost is above `floor` by less than `rise` it is interpolated,
    its root by a line, as that of a parabola is one. 0 where all places are higher.
    """
    ways = np.array([abs(float(place.point[held] - begin.point[held])) for place in places])
    heights = np.sqrt(np.maximum([place.cost - floor for place in places], 0.0))
    wanted = float(np.sqrt(rise))
    below = np.flatnonzero(heights < wanted)
    if below.size == 0:
        return 0.0
    last = below[-1]
    if last + 1 == len(places):
        return float(ways[last])
    share = (wanted - heights[last]) / (heights[last + 1] - heights[last])
    return float(ways[last] + share * (ways[last + 1] - ways[last]))


def beyond_a_hill(places: list[Place], end: Place, rise: float) -> Place | None:
    """Return the lowest place of a walk that lies below one before it by more than `rise`, if any.

    Its refit need not have ended. Hopeless places are none.
    """
    highest, found = end.cost, None
    for place in places:
        lower = place.cost < min(highest - rise, _HOPELESS * end.cost)
        if lower and (found is None or place.cost < found.cost):
            found = place
        highest = max(highest, place.cost)
    return found


def _distances(first: float, room: float) -> Array:
    """Return distances that double from `first` on, the last being `room`; none without either."""
    if not (0.0 < first < np.inf and room > 0.0):
        return np.empty(0)
    first = min(first, _LONGEST_FIRST * room)
    doublings = np.arange(np.ceil(np.log2(room / first)))
    return np.append(first * 2.0**doublings, room)


def _in_step(
    walks: list[Walk], evaluate: Callable[[Array], Array], left: Callable[[], float]
) -> bool:
    """Run walks, each round's points in one batch; return whether all came to their ends."""
    asked: dict[int, Array] = {}

    def advance(walk: int, answer: Array | None) -> None:
        try:
            asked[walk] = next(walks[walk]) if answer is None else walks[walk].send(answer)
        except StopIteration:
            asked.pop(walk, None)

    for walk in range(len(walks)):
        advance(walk, None)
    while asked and left() >= len(asked):
        waiting = list(asked)
        residuals = evaluate(np.stack([asked[walk] for walk in waiting]))
        for walk, row in zip(waiting, residuals, strict=True):
            advance(walk, row)
    return not asked


def _secant(jacobian: ArrowMatrix, step: Array, change: Array, units: Array) -> ArrowMatrix:
    """Return the nearest Jacobian, in `units` of the unknowns, that maps a step to its change."""
    along, squares = (blocks_of(jacobian, v) for v in (step / units**2, (step / units) ** 2))
    lengths = squares.sum(axis=1)
    left = change - jacobian.apply(step)
    counts = np.diff(jacobian.offsets)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(lengths[:, None] > 0.0, along / lengths[:, None], 0.0)
    added = left[:, None] * np.repeat(share, counts, axis=0)
    count = jacobian.shared.shape[1]
    return ArrowMatrix(
        jacobian.shared + added[:, :count], jacobian.own + added[:, count:], jacobian.offsets
    )
