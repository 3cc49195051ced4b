"""Seeded subsets of benchmarks/query_accuracy.py and benchmarks/time_of_impact.py.

The benchmarks say what their references are, and what counts as wrong, missed, false or late.
"""

from __future__ import annotations

import numpy as np
import pytest

import query_accuracy
import time_of_impact


@pytest.mark.parametrize(("kind1", "kind2"), query_accuracy.all_pairs())
def test_distance_of_random_configurations(kind1, kind2):
    count = 12
    rng = np.random.default_rng(1)
    pair = query_accuracy.Pair(query_accuracy.make_model(), kind1, kind2, count, rng)
    results, _ = query_accuracy.measure(pair, count, rng, peers=())
    worst, wrong, _ = results["dashpot"]
    assert wrong == 0
    # Searches of curved overlaps end within 1e-10 of the size, rarely within 1e-7 m.
    assert worst < 1e-6


@pytest.mark.parametrize("case", time_of_impact.CASES)
def test_time_of_impact_of_random_motions(case):
    count = 12
    number, errors, _ = time_of_impact.measure(time_of_impact.CASES[case], count, seed=1)
    assert number["contacts"] >= 5
    assert (number["missed"], number["false"], number["late"]) == (0, 0, 0)
    # Contact counts from 1e-9 of the size on, which takes about as much of the horizon to close.
    assert np.median(errors) < 1e-8
