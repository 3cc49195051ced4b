"""Warnings of data that a fit takes, but that were hardly meant so."""

from __future__ import annotations

import warnings

from dashpot.calibrate.problem import Problem

# Of the function that the user called: fit, which calls these.
_STACK_LEVEL = 3


def warn_of_noisy_starts(problem: Problem) -> None:
    """Warn where simulations start at a measured pose as if it had no noise."""
    noisy = problem.noisy_starts()
    if noisy:
        others = f" and {len(noisy) - 1} more" if len(noisy) > 1 else ""
        warnings.warn(
            f"trajectory '{noisy[0]}'{others}: no initial_qpos, so that the simulation starts at "
            "the first observed pose as if that had no noise, and intervals are too narrow; give "
            "initial_qpos, or estimate the start with initial_state='pose_and_velocity'",
            stacklevel=_STACK_LEVEL,
        )


def warn_of_milliseconds(problem: Problem) -> None:
    """Warn where bodies begin in a fall at a millionth of gravity."""
    slow = problem.slow_falls()
    if slow:
        others = f" and {len(slow) - 1} more" if len(slow) > 1 else ""
        warnings.warn(
            f"trajectory '{slow[0]}'{others}: it begins in a fall at a millionth of gravity, as "
            "with times in milliseconds; they must be in s",
            stacklevel=_STACK_LEVEL,
        )
