"""Covariance of an estimate, from derivatives that are as wide as the intervals that they make."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.inference.intervals import Covariance, covariance
from dashpot.calibrate.inference.statistical_linearization import (
    over_its_region,
    possible,
    region_evaluations,
)
from dashpot.calibrate.residuals.arrow import ArrowMatrix
from dashpot.calibrate.residuals.candidates import SimulationError
from dashpot.calibrate.residuals.losses import Loss
from dashpot.calibrate.residuals.misfit import ResidualCovariance
from dashpot.calibrate.residuals.objective import Objective

Array = NDArray[np.float64]

# Differences for the intervals start at this width in the search coordinate and may stay wider
# than the interval by this factor.
_WIDEST_DIFFERENCE = 0.2
_WIDTH_SLACK = 2.0


def covariance_around(
    objective: Objective,
    point: Array,
    residuals: Array,
    loss: Loss,
    errors: str,
    confidence: float,
    seed: int | None,
    misfit: ResidualCovariance | None = None,
    left: Callable[[], float] = lambda: np.inf,
) -> tuple[Covariance, Array, ArrowMatrix, str | None]:
    """Return the covariance of a linear model over its own region, and its departure from one.

    Then follow the Jacobian by differences that it starts from, and why simulations fail, if so.

    That is the region that the covariance implies. It starts from a Jacobian whose differences of
    parameters are as wide as the intervals that it gives: they start wide and shrink, never below
    the parameters' own. Where `seed` is None, as no interval around the end of a search that has
    not converged is that of a minimum, it ends there; and so it does where simulations in the
    region fail. `misfit` is the covariance of residuals that are no noise of one size.
    """
    live = objective.live(residuals)
    offsets = objective.offsets if errors == "clustered" else None

    def from_jacobian(jacobian: ArrowMatrix, hold: Array) -> Covariance:
        return covariance(
            jacobian, residuals, loss=loss, live=live, offsets=offsets, hold=hold, misfit=misfit
        )

    own = np.array([p.difference for p in objective.unknown])
    widths = np.maximum(own, _WIDEST_DIFFERENCE)
    hold = possible(objective)
    while True:
        jacobian = objective.jacobian(point, widths=widths)
        estimated = from_jacobian(jacobian, hold)
        implied = estimated.half_width(confidence)[: objective.parameters]
        wanted = np.clip(implied, own, widths)
        each = 2 * (objective.parameters + objective.free_states.size)
        if (widths <= _WIDTH_SLACK * wanted).all() or left() < each:
            break
        widths = wanted
    # Data without any noise leave a region of no size.
    too_few = objective.parameters == 0 or left() < region_evaluations(objective)
    if seed is None or estimated.residual_variance == 0.0 or too_few:
        return estimated, np.zeros(objective.size), jacobian, None
    slopes = loss.slopes(residuals)
    rise = float(slopes[live].mean())
    if not rise > 0.0:
        return estimated, np.zeros(objective.size), jacobian, None
    relative = slopes / rise if loss.robust else None
    try:
        region = over_its_region(objective, point, jacobian, from_jacobian, relative, seed, left)
    except SimulationError as error:
        return estimated, np.zeros(objective.size), jacobian, str(error)
    return *region, jacobian, None
