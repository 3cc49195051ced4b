"""What would help where a search ended before it converged."""

from __future__ import annotations

from dashpot.calibrate.search.search import BUDGET_SPENT, Search

# A parameter has gone to its bound when it is within this share of its range.
_AT_BOUND = 1e-3
# The cost still falls where the last quarter of the evaluations lowered it by more than this share.
_FALLS = 0.01


def advice(search: Search, max_evaluations: int) -> str:
    """Return why a search that has not converged ended, and what would help."""
    helps = []
    for parameter, coordinate, z in zip(
        search.objective.unknown, search.objective.coordinates, search.best_point, strict=False
    ):
        low, high = coordinate.search_bounds
        near = _AT_BOUND * (high - low)
        if z < low + near or z > high - near:
            side = "lower" if z < low + near else "upper"
            value = parameter.bounds[side == "upper"]
            helps.append(
                f"'{parameter.name}' has gone to its {side} bound {value:.4g}: other bounds, or a "
                "number in its place"
            )
    spent = search.message == BUDGET_SPENT
    costs = search.history
    before = costs[(3 * len(costs)) // 4 - 1] if len(costs) > 3 else float("inf")
    if spent and search.best_cost < (1.0 - _FALLS) * before:
        helps.append("the cost was still falling: more evaluations (max_evaluations)")
    else:
        helps.append(
            "the cost falls no more, but is rough or a bad valley: further starts (starts=16), or "
            "short windows first (windows=...)"
        )
    why = f"max_evaluations = {max_evaluations} is spent" if spent else search.message
    return f"{why}; what would help: {'; '.join(helps)}"
