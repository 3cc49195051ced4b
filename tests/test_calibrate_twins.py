"""Intervals and statements of fits, over recordings whose truth is hidden: a part of the table.

`benchmarks/twins.py` makes the table. Limits here are such that a right method exceeds any of them
in less than one of a thousand choices of seeds.
"""

from __future__ import annotations

import functools
import math

import pytest
from scipy import stats

import twins

# With fewer no number of misses would exceed what chance allows. Of a track that slopes a fit takes
# as long as of four others.
REPETITIONS = {kind: 3 if kind == "slope of a track" else 8 for kind in twins.KINDS}
RARE = 1e-3 / (3 * len(REPETITIONS))


@functools.cache
def found(kind):
    """Return what fits of a kind say; of jittered stamps without their rate, which is harder."""
    several = [o for seed in range(REPETITIONS[kind]) for o in twins.outcomes(kind, seed)]
    return [o for o in several if o.variant == 1] if kind == "jittered stamps" else several


def most(count, probability):
    """Return how often of `count` what has a probability happens at most, but for rare cases."""
    return stats.binom.isf(RARE, count, min(probability, 1.0))


@pytest.mark.parametrize("kind", REPETITIONS)
def test_intervals_hold_the_truth(kind):
    """That one of u unknowns is missed has a probability of u 5 % at most."""
    told = [o for o in found(kind) if o.covered]
    missed = sum(not all(o.covered.values()) for o in told)
    assert missed <= most(len(told), 0.05 * max(len(o.covered) for o in told))


def test_intervals_of_all_kinds_together_hold_the_truth():
    """The number of fits that miss has a mean and a variance below the sum of probabilities."""
    told = [o for kind in REPETITIONS for o in found(kind) if o.covered]
    mean = sum(0.05 * len(o.covered) for o in told)
    assert sum(not all(o.covered.values()) for o in told) <= mean + 3.3 * math.sqrt(mean)


@pytest.mark.parametrize("kind", REPETITIONS)
def test_what_a_recording_cannot_tell_is_not_called_identified(kind):
    silent = [o for o in found(kind) if o.silent]
    called = sum(any(o.grades[s] != "not identified" for s in o.silent) for o in silent)
    assert called <= most(len(silent), 0.05)


@pytest.mark.parametrize("kind", REPETITIONS)
def test_residuals_of_a_model_that_is_wrong_are_a_misfit_and_of_a_right_one_are_not(kind):
    assert all("place" in o.misfits for o in found(kind) if o.wrong)
    right = [o for o in found(kind) if not o.wrong]
    assert sum(bool(o.misfits) for o in right) <= most(len(right), 0.05)
