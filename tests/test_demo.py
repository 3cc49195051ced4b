"""What the demonstration shows can be read without its source."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from dashpot import demo
from dashpot.calibrate import twin


def an_experiment(*, friction: float, history: list[float]) -> SimpleNamespace:
    """Return a fit of a stiffness that is right, and of a friction of 0.2 with errors of 0.001."""
    estimates = (
        SimpleNamespace(name="stiffness", value=1e4, lower=9e3, upper=1.1e4, standard_error=5e2),
        SimpleNamespace(
            name="sliding_friction",
            value=friction,
            lower=friction - 0.002,
            upper=friction + 0.002,
            standard_error=1e-3,
        ),
    )
    truth = {"stiffness": 1e4, "sliding_friction": 0.2}
    return SimpleNamespace(
        fit=SimpleNamespace(estimates=estimates, cost_history=np.array(history)),
        truth=truth,
        covered={e.name: e.lower <= truth[e.name] <= e.upper for e in estimates},
    )


def test_an_interval_that_misses_the_truth_is_explained():
    """Of two intervals of 95 % at least one misses in 1 - 0.95² = 10 % of fits."""
    told = demo._missed_truths(an_experiment(friction=0.2025, history=[1.0]))
    assert "in one fit of twenty. At least one of 2 does in 10 % of fits." in told
    assert told.endswith("Off here: sliding friction by 2.5 standard errors, 1.2 %.")
    assert demo._missed_truths(an_experiment(friction=0.2015, history=[1.0])) == ""


@pytest.mark.parametrize(
    ("history", "labels"),
    [
        ([90.0, 9.0, 9.0, 30.0, 12.0], ["first 0.2 s", "all frames"]),
        ([9.0, 3.0], ["window 1"]),
    ],
)
def test_curves_of_the_cost_go_down(history, labels):
    """A longer window has more frames, so its cost is a curve of its own."""
    assert twin.WINDOWS == (0.2,)
    costs = demo._twin_figure(an_experiment(friction=0.2, history=history)).axes[1]
    assert [line.get_label() for line in costs.lines] == labels
    drawn = [np.asarray(line.get_ydata()) for line in costs.lines]
    assert np.concatenate(drawn).tolist() == history
    for curve in drawn:
        assert (np.diff(curve) <= 0).all()
