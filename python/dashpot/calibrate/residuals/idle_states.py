"""Unknowns, mostly of initial states, on which residuals do not depend, told from rounding.

Where heights of a ball are all that was measured, nothing tells how it was turned or where it was
over the floor. Differences of residuals along these are rounding: of a thousandth of a standard
deviation a metre, along which a search goes for kilometres and a covariance has regions of them. So
columns that are next to nothing are looked at again over a way on which rounding is next to nothing
too, and are 0 where that moves no residual.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.residuals.arrow import ArrowMatrix
from dashpot.calibrate.residuals.differences import Attempt, required

Array = NDArray[np.float64]

# Norms of columns, in standard deviations a unit (m, rad, m/s, rad/s), below which they may be
# rounding: what a tracker sees of free bodies has norms of 1000 and more.
_DOUBTFUL = 100.0
# The way is longer than differences by this factor: mm, mrad, cm/s. A state is idle where it moves
# all residuals of the trajectory together by less than these standard deviations.
_LONGER = 1e3
_IDLE = 1e-4


def without_idle_parameters(jacobian: ArrowMatrix, ranges: Array) -> ArrowMatrix:
    """Return the Jacobian with 0 in the columns of parameters that are next to nothing.

    Over their whole `ranges` (p,) they would move all residuals together by less than rounding may,
    as the mass of a body in free flight does.
    """
    norms = np.linalg.norm(jacobian.shared, axis=0)
    if (norms * ranges >= _IDLE).all():
        return jacobian
    shared = np.where(norms * ranges >= _IDLE, jacobian.shared, 0.0)
    return ArrowMatrix(shared, jacobian.own, jacobian.offsets)


def without_idle_states(
    jacobian: ArrowMatrix, attempt: Attempt, point: Array, base: Array | None, differences: Array
) -> ArrowMatrix:
    """Return the Jacobian with 0 in the columns of initial states that move nothing.

    Parameters
    ----------
    jacobian
        By differences.
    attempt
        Residuals of points.
    point
        (n,) where it is that of.
    base
        (m,) residuals at `point`, where known.
    differences
        (n,) half-widths that it was made with.
    """
    norms = np.sqrt(jacobian.sums(jacobian.own**2))
    doubtful = (norms > 0.0) & (norms < _DOUBTFUL)
    if not doubtful.any():
        return jacobian
    if base is None:
        base = required(attempt, point)

    def moves(which: list[NDArray[np.bool_]]) -> NDArray[np.bool_]:
        """Whether steps along (trajectories, s) states move residuals, (len(which), ...)."""
        steps = np.zeros((len(which), point.size))
        for step, states in zip(steps, which, strict=True):
            jacobian.parts(step)[1][:] = states
        residuals, _ = attempt(point + _LONGER * differences * steps)
        with np.errstate(invalid="ignore"):
            change = [np.sqrt(jacobian.sums((row - base) ** 2)) for row in residuals]
        return np.array([~(size < _IDLE) for size in change])

    # Mostly they are idle all together, which one simulation tells.
    live = doubtful & moves([doubtful])[0][:, None]
    columns = np.flatnonzero(live.any(axis=0))
    if columns.size:
        single = np.eye(live.shape[1], dtype=bool)[columns]
        live[:, columns] &= moves([live & column for column in single]).T
    idle = doubtful & ~live
    counts = np.diff(jacobian.offsets)
    own = np.where(np.repeat(idle, counts, axis=0), 0.0, jacobian.own)
    return ArrowMatrix(jacobian.shared, own, jacobian.offsets)
