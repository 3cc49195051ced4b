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


def warn_of_strange_falls(problem: Problem) -> None:
    """Warn where bodies begin in a fall as of other units or axes than the model's."""
    for names, what in (
        (
            problem.slow_falls(),
            "it begins in a fall at a millionth of gravity, as with times in milliseconds; they "
            "must be in s",
        ),
        (
            problem.fast_falls(),
            "it begins in a fall at a thousand times gravity, as with positions in mm; they must "
            "be in m",
        ),
        (
            problem.upward_falls(),
            "it begins in a fall against gravity, as with an axis that points down; positions must "
            "be in the world of the model",
        ),
    ):
        if names:
            others = f" and {len(names) - 1} more" if len(names) > 1 else ""
            warnings.warn(
                f"trajectory '{names[0]}'{others}: {what}",
                stacklevel=_STACK_LEVEL,
            )
