"""Calibration: costs whose bad valleys noise explains as well, and profiles that find others."""

import math
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from dashpot.calibrate import Parameter, Problem, Trajectory, fit
from dashpot.calibrate.inference import settlement
from dashpot.calibrate.inference.profiles import Place, Profiles, beyond_a_hill
from dashpot.calibrate.residuals.arrow import ArrowMatrix
from dashpot.calibrate.residuals.losses import Loss
from spinning_throws import BOUNDS, TRUTH, ball, observed

POSITION_NOISE, ROTATION_NOISE = 2e-3, 2e-2


def spinning_throw(seed, frames=60):
    """Throw a ball at 0.8 m/s with 10 rad/s of spin: it slides in its first contacts alone."""
    return observed(
        seed,
        frames=frames,
        substeps=5,
        speed=0.8,
        spin=10.0,
        position_noise=POSITION_NOISE,
        rotation_noise=ROTATION_NOISE,
    )


def problem(seed, held=()):
    """Return a fit that starts at the true parameters, of which some are held there."""
    unknown = [
        Parameter.pair("ball", "floor", name, start=TRUTH[name], bounds=BOUNDS[name])
        for name in TRUTH
        if name not in held
    ]
    return Problem(
        ball(TRUTH),
        unknown,
        [spinning_throw(seed)],
        POSITION_NOISE,
        ROTATION_NOISE,
        initial_state="pose_and_velocity",
    )


def test_a_valley_that_noise_explains_is_left_for_a_better_one():
    """From wrong first states friction is led to 0.03, where noise explains the cost of 186.6.

    With the true friction it is 172.3: 360 residuals have a chi^2 that varies by 27, and the
    likelihoods differ by exp(14).
    """
    data = 508
    result, truth = fit(problem(data)), fit(problem(data, ["sliding_friction"]))
    # No end is worse than the truth by more than a search leaves.
    assert result.cost < truth.cost + 0.05
    assert result.converged
    assert result["sliding_friction"].value > 0.05
    for name in ("stiffness", "restitution"):
        assert result[name].identified
        assert result[name].lower < TRUTH[name] < result[name].upper
    # Profiles and the second search, with its intervals, take no more than as much again and half.
    assert result.evaluations < 2.5 * truth.evaluations


def test_a_valley_beyond_a_hill_is_searched_where_profiles_lag():
    """Between frictions of 0.03 and 0.1 the cost of these data rises from 165 to 290.

    Behind it refits of the profile are not down yet; a search from there is, to 157.
    """
    data = 530
    result, truth = fit(problem(data), starts=0), fit(problem(data, ["sliding_friction"]))
    assert result.cost < truth.cost + 0.05
    friction = result["sliding_friction"]
    assert friction.value > 0.05
    assert friction.lower < TRUTH["sliding_friction"] < friction.upper


def test_a_lower_cost_that_no_search_goes_on_from_is_said(monkeypatch):
    monkeypatch.setattr(settlement, "_MOST_ROUNDS", 1)
    bad = problem(508)
    parameters = [
        replace(p, start=0.02) if p.name == "sliding_friction" else p for p in bad.parameters
    ]
    friction = fit(replace(bad, parameters=parameters), starts=0)["sliding_friction"]
    assert friction.value < 0.05
    assert not friction.identified
    assert "in a bad valley (the cost is lower at stiffness = " in friction.statement


def rows(matrix, offset):
    return lambda points: points @ matrix.T + offset


@pytest.mark.parametrize("own", [0, 2])
def test_profiles_of_linear_residuals_are_parabolas(own):
    """With one unknown held at x the cost rises by x^2 / 2 over its element of (J^T J)^-1."""
    rng = np.random.default_rng(1)
    shared, states = rng.normal(size=(60, 2)), rng.normal(size=(60, own))
    jacobian = ArrowMatrix(shared, states, np.array([0, 25, 60]))
    dense = jacobian.dense()
    offset = rng.normal(size=60)
    offset -= dense @ np.linalg.lstsq(dense, offset, rcond=None)[0]
    size = dense.shape[1]
    profiles = Profiles(Loss(), (np.full(2, -3.0), np.full(2, 3.0)), np.ones(size), 0.5)
    begin = Place(np.zeros(size), offset, 0.5 * float(offset @ offset))
    found, _ = profiles.around(rows(dense, offset), begin, jacobian, np.array([0.1, 0.1]))
    inverse = np.linalg.inv(dense.T @ dense)
    for i, sides in enumerate(found):
        for sign, places in zip((-1.0, 1.0), sides, strict=True):
            ways = [sign * float(place.point[i]) for place in places]
            assert ways == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.6, 3.0][: len(ways)])
            # It ends where the cost is hopeless, or at the bound.
            assert ways[-1] == 3.0 or places[-1].cost > 4.0 * begin.cost
            for way, place in zip(ways, places, strict=True):
                rise = place.cost - begin.cost
                # Refits stop at a tenth of the rise; bounds may stop the other parameter.
                assert rise >= 0.5 * way**2 / inverse[i, i] * (1.0 - 1e-6)
                if np.abs(place.point[1 - i]) < 3.0:
                    assert rise == pytest.approx(0.5 * way**2 / inverse[i, i], rel=1e-3)


def test_a_profile_finds_the_other_valley_of_a_double_well():
    """Valleys at 0 and 1.5, the latter lower, along a line that a second unknown must follow."""
    wells = SimpleNamespace(high=0.3, t=np.linspace(0.0, 1.0, 40))

    def residuals(points):
        x, y = points.T
        hill = 4.0 * np.sin(math.pi * np.clip(x, 0.0, 1.5) / 1.5)
        beyond = 3.0 * (np.minimum(x, 0.0) + np.maximum(x - 1.5, 0.0))
        depth = wells.high * (x < 0.75)
        follow = np.outer(y - 0.5 * x**2, 10.0 + wells.t)
        return np.concatenate(
            [follow, (1.0 + hill + depth)[:, None], beyond[:, None], np.ones((len(x), 30))], axis=1
        )

    start = np.zeros(2)
    at = residuals(start[None])[0]
    h = 1e-6
    columns = [(residuals((start + h * e)[None])[0] - at) / h for e in np.eye(2)]
    jacobian = ArrowMatrix.of_dense(np.stack(columns, axis=1))
    profiles = Profiles(Loss(), (np.full(2, -3.0), np.full(2, 3.0)), np.full(2, 6.0), 0.5)
    begin = Place(start, at, 0.5 * float(at @ at))
    ((_, above), _), _ = profiles.around(residuals, begin, jacobian, np.array([0.1, np.inf]))
    lowest = min(above, key=lambda place: place.cost)
    assert lowest.cost < begin.cost - 0.2
    assert lowest.point[0] > 1.0


@pytest.mark.parametrize(
    ("costs", "found"),
    [
        ([10.1, 12.0, 15.0, 30.0], None),  # only up
        ([11.0, 30.0, 20.0, 15.0, 25.0], 3),
        ([12.0, 11.0, 30.0], None),  # a dent of a flat side
        ([60.0, 50.0], None),  # hopeless: more than four times that of the end
        ([], None),
    ],
)
def test_the_lowest_place_behind_a_hill_is_told(costs, found):
    end, *places = (Place(np.empty(0), np.empty(0), cost) for cost in (10.0, *costs))
    assert beyond_a_hill(places, end, 1.92) is (None if found is None else places[found])


def test_a_walk_ends_where_simulations_fail():
    """Beyond 1 nothing can be simulated: the places before are kept."""

    def residuals(points):
        line = points @ np.ones((1, 30)) * 0.01
        return np.where(points > 1.0, np.inf, line + 1.0)

    jacobian = ArrowMatrix.of_dense(np.full((30, 1), 0.01))
    profiles = Profiles(Loss(), (np.array([-3.0]), np.array([3.0])), np.array([6.0]), 0.5)
    begin = Place(np.zeros(1), np.ones(30), 15.0)
    ((below, above),), _ = profiles.around(residuals, begin, jacobian, np.array([0.2]))
    assert [float(place.point[0]) for place in above] == pytest.approx([0.2, 0.4, 0.8])
    assert [float(place.point[0]) for place in below] == pytest.approx(
        [-0.2, -0.4, -0.8, -1.6, -3.0]
    )


@pytest.mark.parametrize("other", [2.0, 4.0])
def test_an_interval_contains_the_other_value_that_does_as_well(other):
    """A ball that falls shows gravity alone, which two values of the unknown give it."""
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="0.005" gravity="0 0 -9.81"/><worldbody><body name="ball">'
        '<freejoint/><geom size=".1" mass="1"/></body></worldbody></mujoco>'
    )

    # Between them it is off by five standard errors.
    hill = 0.084 / (other - 1.0) ** 2

    def apply(system, value):
        system.opt.gravity[2] = -9.81 - hill * (value - 1.0) * (value - other)

    unknown = Parameter(
        "unknown", start=0.9, bounds=(0.5, 5.0), transform="linear", apply=apply,
        changes_model=True,
    )  # fmt: skip
    time = 0.01 * np.arange(40)
    # Euler's steps fall by a sum that is closed.
    steps = 2 * np.arange(40)
    height = -9.81 * 0.005**2 * steps * (steps + 1) / 2
    position = np.stack([0 * time, 0 * time, height], axis=1)
    position += 1e-3 * np.random.default_rng(2).normal(size=(40, 3))
    fall = Trajectory(
        "fall", time, position, None, "ball", initial_qpos=model.qpos0, initial_qvel=np.zeros(6)
    )
    estimate = fit(Problem(model, [unknown], [fall], 1e-3)).estimates[0]
    assert estimate.lower < 1.0
    assert estimate.upper > other
