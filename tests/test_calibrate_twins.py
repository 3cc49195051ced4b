"""Intervals and statements of fits, over recordings whose truth is hidden.

`benchmarks/twins.py` makes the table of a hundred of each kind, and with ``--smoke`` holds eight to
limits. Here is one recording of each kind whose fit takes a second at most.
"""

from __future__ import annotations

import functools

import pytest
from scipy import stats

import twins

KINDS = (
    "40 % of frames lost",
    "scale 15 % off",
    "noise ten times off",
    "apices alone",
    "impact times alone",
    "three objects",
)


@functools.cache
def found(kind):
    return twins.outcomes(kind, 0)


def test_intervals_are_as_wide_as_their_errors():
    """Errors over standard errors squared are a chi-square: intervals half as wide exceed it."""
    errors = [1.96 * error for kind in KINDS for o in found(kind) for error in o.error.values()]
    squares = sum(error**2 for error in errors)
    assert stats.chi2.ppf(1e-3, len(errors)) < squares < stats.chi2.isf(1e-3, len(errors))


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_recording_cannot_tell_is_not_called_identified(kind):
    for o in found(kind):
        assert [o.grades[name] for name in o.silent] == ["not identified"] * len(o.silent)


@pytest.mark.parametrize("kind", KINDS)
def test_residuals_of_a_right_model_are_no_misfit(kind):
    assert [o.misfits for o in found(kind)] == [[]] * len(found(kind))


def outcome(seed, **said):
    usual = {"grades": {"k": "identified", "mu": "not identified"}, "silent": ["mu"]}
    return twins.Outcome(
        "scale 15 % off", seed, 0, False, 0.0, **{"covered": {"k": True}} | usual | said
    )


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"covered": {"k": False}}, "fits miss the truth"),
        ({"grades": {"k": "identified", "mu": "identified"}}, "what the recording cannot tell"),
        ({"misfits": ["place"]}, "right models are called a misfit"),
    ],
)
def test_too_many_wrong_fits_exceed_a_limit(wrong, said):
    """Of eight fits that are wrong by chance once in twenty, five are too many and four are not."""
    for count in (4, 5):
        fits = [outcome(seed, **(wrong if seed < count else {})) for seed in range(8)]
        limits = [line for line in twins.exceeded(fits) if line.startswith("scale 15 % off")]
        assert [said in line for line in limits] == ([True] if count == 5 else [])


def test_a_wrong_model_that_fits_well_exceeds_a_limit():
    fits = [
        twins.Outcome("slope of a track", seed, 1, True, 0.0, misfits=["place"][seed:])
        for seed in (0, 1)
    ]
    assert twins.exceeded(fits[:1]) == []
    assert twins.exceeded(fits) == [
        "slope of a track: a model that is wrong is not called a misfit of its place"
    ]
