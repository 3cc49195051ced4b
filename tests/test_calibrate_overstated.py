"""Calibration: noise that is stated larger than it is, below which a misfit hides."""

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest

from dashpot.calibrate import Parameter, Problem, fit
from dashpot.calibrate.problem.layout import Block, Layout
from dashpot.calibrate.residuals.whiteness import least_white, whiteness
from spinning_throws import BOUNDS, TRUTH, ball, observed

START = {"stiffness": 2e3, "restitution": 0.4, "sliding_friction": 0.5}
POSITION_NOISE, ROTATION_NOISE = 2e-4, 2e-3


def spinning_throw(seed, frames=150):
    """Throw a ball that spins, seen for 0.6 s; frames are 4 ms apart."""
    return observed(
        seed,
        frames=frames,
        substeps=2,
        speed=1.2,
        spin=20.0,
        position_noise=POSITION_NOISE,
        rotation_noise=ROTATION_NOISE,
    )


def problem(seed, larger, frames):
    """Return a fit to which noise is stated larger than it is by a factor."""
    unknown = [
        Parameter.pair("ball", "floor", name, start=START[name], bounds=BOUNDS[name])
        for name in TRUTH
    ]
    return Problem(
        ball(START),
        unknown,
        [spinning_throw(seed, frames)],
        larger * POSITION_NOISE,
        larger * ROTATION_NOISE,
        initial_state="pose_and_velocity",
    )


@pytest.fixture(scope="module")
def right():
    return fit(problem(0, 1.0, frames=110))


def test_noise_stated_too_large_changes_no_interval(right):
    """In the valley of friction 0.024 residuals have a variance of 6.3 true ones, 1 as stated."""
    larger = 2.5
    result = fit(problem(0, larger, frames=110))
    assert result.residual_variance * larger**2 == pytest.approx(right.residual_variance, rel=1e-3)
    assert result.noise_overstated
    assert not right.noise_overstated
    for name, value in TRUTH.items():
        found, expected = result[name], right[name]
        assert found.identified
        assert found.lower < value < found.upper
        # Both searches end within a tenth of a standard error; regions are drawn anew.
        assert abs(found.value - expected.value) < 0.1 * expected.standard_error
        assert found.standard_error == pytest.approx(expected.standard_error, rel=0.1)
        said = re.search(r"noise is not as stated, but (\S+) times as large", found.statement)
        assert float(said[1]) * larger == pytest.approx(1.0, rel=0.1)
        assert found.grade == expected.grade == "identified"
        assert "noise" not in expected.statement
    assert "so that noise is stated too large" in str(result.table().caption)


def test_a_misfit_that_noise_stated_too_large_hides_is_said():
    result = fit(problem(0, 10.0, frames=150), starts=0)
    assert result.noise_explains
    assert result["sliding_friction"].value < 0.05
    assert "position" in {misfit.channel for misfit in result.misfits}
    for estimate in result.estimates:
        assert estimate.grade == "within misfit"
        assert "hang together in time" in estimate.statement


def layouts(*frames):
    """Stand in for an objective of trajectories with one body and two channels of sensors."""
    shapes = [Layout((Block("poses", n, 6), Block("scale", n, 2))) for n in frames]
    return SimpleNamespace(
        layouts=shapes, offsets=np.concatenate([[0], np.cumsum([s.size for s in shapes])])
    )


def rows(objective, frames):
    """Return frames (n, 8) of all trajectories in the order of residuals."""
    parts, first = [], 0
    for shape in objective.layouts:
        own = frames[first : first + shape.blocks[0].rows]
        parts += [own[:, :6].reshape(-1), own[:, 6:].reshape(-1)]
        first += shape.blocks[0].rows
    return np.concatenate(parts)


def least_likely(objective, noise, counted=None):
    counted = np.ones(noise.size, dtype=bool) if counted is None else counted
    return least_white(whiteness(objective, noise, counted))


def test_white_noise_of_any_sizes_is_white():
    """Of 500 noises 2.3 % are beyond two deviations, or less: products have long tails."""
    objective, rng = layouts(40, 60), np.random.default_rng(2)
    sizes = np.exp(rng.normal(size=8))
    found = [
        least_likely(objective, rows(objective, sizes * rng.normal(size=(100, 8)))).deviations
        for _ in range(500)
    ]
    most = 500 * 0.0228 + 3.0 * math.sqrt(500 * 0.0228)
    assert np.count_nonzero(np.array(found) > 2.0) <= most
    assert np.max(found) < 4.0


def test_the_correlation_of_a_first_order_process_is_its_own():
    objective, rng = layouts(4000), np.random.default_rng(3)
    process = rng.normal(size=(4000, 8))
    for k in range(1, 4000):
        process[k] = 0.6 * process[k - 1] + 0.8 * process[k]
    noise = rows(objective, process)
    found = whiteness(objective, noise, np.ones(noise.size, dtype=bool))
    assert [channel.channel for channel in found] == ["position", "rotation", "scale"]
    for channel, count in zip(found, (3, 3, 2), strict=True):
        # Bartlett: the variance of the estimate is (1 - 0.6^2) / n.
        deviation = math.sqrt(0.64 / (4000 * count))
        assert channel.correlation == pytest.approx(0.6, abs=3.3 * deviation)
        assert not channel.holds(3.0)
    # Of data without noise nothing is told, nor of frames that do not count.
    assert least_likely(objective, 1e-5 * noise).holds(3.0)
    assert least_likely(objective, noise, np.zeros(noise.size, dtype=bool)).holds(3.0)


def test_one_channel_that_hangs_together_is_named():
    objective, rng = layouts(100, 100), np.random.default_rng(5)
    frames = rng.normal(size=(200, 8))
    frames[:, 6] += np.sin(np.arange(200) / 8.0)
    assert least_likely(objective, rows(objective, frames)).channel == "scale"


def test_what_is_small_but_lasts_is_seen_at_a_rate_of_its_own():
    """A ramp of a third of the noise, read in every fourth frame: neighbours alone miss it."""
    objective, by_neighbours, seen = layouts(4000), 0, 0
    counted = np.zeros((4000, 8), dtype=bool)
    counted[::4, 0] = True
    counted = rows(objective, counted)
    for seed in range(20):
        frames = np.random.default_rng(seed).normal(size=(4000, 8))
        frames[:, 0] += np.linspace(-0.5, 0.5, 4000)
        noise = rows(objective, frames)
        seen += not least_likely(objective, noise, counted).holds(3.0)
        (channel, *_) = whiteness(objective, noise, counted)
        by_neighbours += channel.correlation * math.sqrt(1000) > 3.0
    assert seen >= 18
    assert by_neighbours <= 10


def test_frames_do_not_go_along_with_those_of_another_trajectory():
    """Two frames each, alike from the end of one to the beginning of the next alone."""
    objective = layouts(2, 2)
    frames = np.stack([np.full(8, 1.0), np.tile([1.0, -1.0], 4)] * 2)
    noise = rows(objective, frames)
    for channel in whiteness(objective, noise, np.ones(noise.size, dtype=bool)):
        # By column products are 1 and -1 in turn, and a column each is alike or opposite.
        assert abs(channel.correlation) <= 0.5
