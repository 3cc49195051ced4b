"""Least squares with block-arrow Jacobians, whose steps cost time linear in the trajectories.

Gauss-Newton within a trust region (More, The Levenberg-Marquardt algorithm, 1978): the step is the
full one or, where that is longer than the radius in scaled unknowns, that of this length, found by
damping. Initial states are eliminated from each linear problem by QR, trajectory by trajectory,
before the parameters are solved for. Parameters meet their bounds by projection: those that a step
would take beyond a bound go to it, and all others are solved for again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.residuals.arrow import ArrowMatrix
from dashpot.calibrate.residuals.losses import Loss

Array = NDArray[np.float64]

# Of the reduction that the model predicts: below the first share the region shrinks, above the
# second it grows.
_POOR, _GOOD = 0.25, 0.75
_SHRINK, _GROW = 0.25, 2.0
# A step as long as the radius is one of at least this share of it.
_WHOLE_LENGTH = 0.95
# The length of a step is right to this share of the radius, which a few corrections of the damping
# reach.
_RIGHT_LENGTH = 0.01
_MOST_CORRECTIONS = 10
# A cost is level when so many evaluations together lower it by less than its tolerance.
_LEVEL_EVALUATIONS = 8


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where a search ended.

    Attributes
    ----------
    point
        (n,).
    residuals
        (m,) at `point`.
    converged
        Whether it ended by its tolerances.
    message
        By which of them, in words; empty where it ran out of evaluations.
    """

    point: Array
    residuals: Array
    converged: bool
    message: str


def minimise(
    residuals_at: Callable[[Array], Array],
    jacobian_at: Callable[[Array], ArrowMatrix],
    start: Array,
    bounds: tuple[Array, Array],
    *,
    loss: Loss,
    hold: float,
    most_evaluations: int,
    cost_tolerance: float,
    step_tolerance: float,
    level_tolerance: float = 0.0,
    longest: float = np.inf,
) -> Minimum:
    """Return a minimum of the summed loss of residuals.

    Parameters
    ----------
    residuals_at
        Residuals (m,) at a point (n,); infinite ones where there are none: the region then shrinks.
    jacobian_at
        Their derivative at a point where they were asked for last, or before.
    start
        (n,) within the bounds.
    bounds
        (p,) lower and upper bounds of the parameters. Initial states have none.
    loss
        Of the residuals.
    hold
        Weight of the distance from `start`, as of one more residual for each unknown.
    most_evaluations
        Of the residuals, >= 1.
    cost_tolerance, step_tolerance
        Relative changes of cost and point at which it stops.
    level_tolerance
        Change of the cost, of residuals of unit variance, at which it stops on rough ground: where
        several evaluations one after the other do not reach it, and the last is not predicted to.
    longest
        Longest step of a parameter.
    """
    lower, upper = bounds
    count = len(lower)

    def cost_of(point: Array, residuals: Array) -> float:
        distance = point - start
        return 0.5 * float(loss.values(residuals).sum() + hold**2 * (distance @ distance))

    point, residuals = start, residuals_at(start)
    cost = cost_of(point, residuals)
    linear, scale, radius = None, np.zeros_like(point), 0.0
    costs = [cost]
    for _ in range(most_evaluations - 1):
        if linear is None:
            linear = Linear(jacobian_at(point), residuals, loss, hold, point - start)
            scale = np.maximum(scale, linear.norms)
            radius = radius or float(np.linalg.norm(scale * point)) or 1.0
        room = lower - point[:count], upper - point[:count]
        for _ in range(_MOST_CORRECTIONS):
            step = step_in_bounds(linear, scale, radius, *room)
            farthest = np.abs(step[:count]).max(initial=0.0)
            if farthest > longest:
                step *= longest / farthest
            predicted = linear.reduction(step)
            if predicted > 0.0:
                break
            # Bounds may turn a long step uphill, but no short one.
            radius *= _SHRINK
        else:
            return Minimum(point, residuals, True, "no step lowers the cost")
        new_point = point + step
        new_point[:count] = np.clip(new_point[:count], lower, upper)
        new_residuals = residuals_at(new_point)
        length = float(np.linalg.norm(scale * step))
        still = np.linalg.norm(step) < step_tolerance * (step_tolerance + np.linalg.norm(point))
        works = bool(np.isfinite(new_residuals).all())
        new_cost = cost_of(new_point, new_residuals) if works else np.inf
        ratio = (cost - new_cost) / predicted
        level = works and cost - new_cost < cost_tolerance * cost and ratio > _POOR
        if ratio < _POOR:
            radius = _SHRINK * length
        elif ratio > _GOOD and length > _WHOLE_LENGTH * radius:
            radius *= _GROW
        if new_cost < cost:
            point, residuals, cost, linear = new_point, new_residuals, new_cost, None
        costs.append(cost)
        # Where no step lowers it at all, steps are too long yet, or it is still soon.
        tolerance = level_tolerance * max(1.0, 2.0 * cost / len(residuals))
        lately = costs[-1 - _LEVEL_EVALUATIONS :]
        level |= (
            predicted < tolerance
            and len(lately) > _LEVEL_EVALUATIONS
            and 0.0 < lately[0] - cost < tolerance
        )
        if level or still:
            changed = "the cost" if level else "the point"
            return Minimum(point, residuals, True, f"{changed} changes no more")
    return Minimum(point, residuals, False, "")


class Linear:
    """The linear problem ``min |W (J s + r)|^2 + hold^2 |s + x - x0|^2`` around a point.

    Rows of each trajectory are compressed by QR to as many as there are unknowns; damped problems
    with other scales are solved from these.
    """

    def __init__(
        self, jacobian: ArrowMatrix, residuals: Array, loss: Loss, hold: float, pull: Array
    ) -> None:
        # As scipy does: second derivatives of the loss that are below 0 count as 0.
        weights = np.sqrt(np.maximum(loss.slopes(residuals), np.finfo(np.float64).eps))
        target = loss.scores(residuals) / weights
        rows = np.column_stack(
            [jacobian.own * weights[:, None], jacobian.shared * weights[:, None], target]
        )
        width = rows.shape[1]
        compressed = np.zeros((jacobian.trajectories, width, width))
        for t in range(jacobian.trajectories):
            triangle = np.linalg.qr(rows[jacobian.rows(t)], mode="r")
            compressed[t, : len(triangle)] = triangle
        self._matrix = jacobian
        size = jacobian.own.shape[1]
        self._own, self._shared = compressed[:, :, :size], compressed[:, :, size:-1]
        self._target = compressed[:, :, -1]
        self._hold, self._pull = hold, pull
        shared = np.einsum("tki,tk->i", self._shared, self._target)
        own = np.einsum("tki,tk->ti", self._own, self._target)
        #: (n,) gradient of half the objective.
        self.gradient = np.concatenate([shared, own.reshape(-1)]) + self._hold**2 * pull
        squares = [np.sum(self._shared**2, axis=(0, 1)), np.sum(self._own**2, axis=1).reshape(-1)]
        #: (n,) norms of the columns.
        self.norms = np.sqrt(np.concatenate(squares) + self._hold**2)

    def reduction(self, step: Array) -> float:
        """Return by how much the model says that half the objective falls."""
        shared, own = self._matrix.parts(step)
        change = self._shared @ shared + np.einsum("tki,ti->tk", self._own, own)
        curvature = np.sum(change**2) + self._hold**2 * (step @ step)
        return float(-self.gradient @ step - 0.5 * curvature)

    def step(self, damping: Array, fixed: Array) -> tuple[Array, Callable[[Array], Array]]:
        """Return the minimum with ``|damping s|^2`` added, and ``|R^-T v|`` of its factor R.

        Parameters
        ----------
        damping
            (n,).
        fixed
            (p,) steps of parameters, nan of those to be solved for.
        """
        free = np.isnan(fixed)
        given = np.where(free, 0.0, fixed)
        shared_pull, own_pull = self._matrix.parts(self._pull)
        shared_damping, own_damping = self._matrix.parts(damping)
        number, _, size = self._own.shape
        hold = self._hold * np.broadcast_to(np.eye(size), (number, size, size))
        damped = own_damping[:, :, None] * np.eye(size)
        own = np.concatenate([self._own, hold, damped], axis=1)
        target = self._target + self._shared @ given
        target = np.concatenate([target, self._hold * own_pull, np.zeros((number, size))], axis=1)
        shared = np.zeros((number, own.shape[1], int(np.count_nonzero(free))))
        shared[:, : self._shared.shape[1]] = self._shared[:, :, free]

        q, triangle = np.linalg.qr(own)
        follow = np.swapaxes(q, 1, 2) @ shared
        offset = np.einsum("tki,tk->ti", q, target)
        left = (target - np.einsum("tki,ti->tk", q, offset)).reshape(-1)
        count = shared.shape[2]
        rest = (shared - q @ follow).reshape(left.size, count)
        rest = np.concatenate([rest, self._hold * np.eye(count), np.diag(shared_damping[free])])
        left = np.concatenate([left, self._hold * shared_pull[free], np.zeros(count)])
        q_rest, triangle_rest = np.linalg.qr(rest)

        step = np.zeros(self._matrix.size)
        shared_step, own_step = self._matrix.parts(step)
        solved = -np.linalg.solve(triangle_rest, q_rest.T @ left)
        shared_step[:] = given
        shared_step[free] = solved
        own_step[:] = -np.linalg.solve(triangle, (offset + follow @ solved)[:, :, None])[:, :, 0]

        def whitened(vector: Array) -> Array:
            shared_part, own_part = self._matrix.parts(vector)
            states = np.linalg.solve(np.swapaxes(triangle, 1, 2), own_part[:, :, None])[:, :, 0]
            others = shared_part[free] - np.einsum("tij,ti->j", follow, states)
            parameters = np.linalg.solve(triangle_rest.T, others)
            return np.concatenate([parameters, states.reshape(-1)])

        return step, whitened


def _within(linear: Linear, scale: Array, radius: float, fixed: Array) -> Array:
    """Return the step that lowers the model most within ``|scale s| <= radius``."""
    step, whitened = linear.step(np.zeros_like(scale), fixed)
    length = float(np.linalg.norm(scale * step))
    if length <= (1.0 + _RIGHT_LENGTH) * radius:
        return step
    # Newton on 1 / length as a function of the squared damping, which is nearly straight.
    damping = 0.0
    for _ in range(_MOST_CORRECTIONS):
        slope = float(np.linalg.norm(whitened(scale**2 * step))) ** 2 / length
        damping += (length / radius - 1.0) * length / slope
        damping = max(damping, 0.0)
        step, whitened = linear.step(np.sqrt(damping) * scale, fixed)
        length = float(np.linalg.norm(scale * step))
        if abs(length - radius) <= _RIGHT_LENGTH * radius:
            break
    return step


def step_in_bounds(
    linear: Linear, scale: Array, radius: float, lower: Array, upper: Array
) -> Array:
    """Return the step of `_within` whose parameters stay in (p,) `lower` to `upper`."""
    count = len(lower)
    # Parameters at a bound that the gradient pushes out stay there.
    out = np.where(linear.gradient[:count] > 0.0, lower, upper)
    fixed = np.where((out == 0.0) & (linear.gradient[:count] != 0.0), 0.0, np.nan)
    while True:
        step = _within(linear, scale, radius, fixed)
        beyond = np.isnan(fixed) & ((step[:count] < lower) | (step[:count] > upper))
        if not beyond.any():
            return step
        fixed[beyond] = np.clip(step[:count], lower, upper)[beyond]
