"""Calibration where candidates cannot be built or simulated: bad candidates, or named errors."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import dashpot
from ball_throws import SIDEWAYS, ball_engine, ball_parameters, make_trajectory, observe
from dashpot.calibrate import Parameter, Problem, fit
from dashpot.calibrate.residuals.candidates import SimulationError
from dashpot.calibrate.residuals.objective import Objective

SPINNER = """<mujoco><option timestep=".005" gravity="0 0 0"/><worldbody>
  <body name="body"><freejoint/><geom size=".1" contype="0" conaffinity="0"/>
    <inertial pos="0 0 0" mass="1" diaginertia=".1 .2 {}"/></body></worldbody></mujoco>"""
# Of moments 0.1 and 0.2 the third is at most 0.3, the sum of both.
THIRD, MOST = 0.28, 0.3


def spinner(start=0.15):
    """Return a problem of a body that turns freely, about all axes, with one moment unknown."""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(SPINNER.format(THIRD)))
    spin = [0, 0, 0, 3.0, 2.0, 4.0]
    seen = observe(engine, spin, noise=np.random.default_rng(1))
    unknown = Parameter.model("body_inertia", "body", index=2, start=start, bounds=(0.101, 0.9))
    return Problem(engine, [unknown], [seen], 1e-4, 1e-3)


@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("least_squares", {}),
        ("least_squares", {"starts": 0}),
        ("cma+least_squares", {}),
    ],
)
def test_candidates_that_are_no_bodies_are_no_estimates(method, options):
    """Two thirds of the range of a moment of inertia make no body; the search goes round them."""
    result = fit(spinner(), method=method, **options)
    assert result.converged
    estimate = result["body_inertia"]
    # 4.5 standard errors: a correct fit fails once in 100,000.
    assert abs(estimate.value - THIRD) < 4.5 * estimate.standard_error
    assert estimate.identified
    assert result.noise_explains


def test_a_start_at_the_edge_of_what_can_be_built_is_left():
    """Differences to both sides are not to be had there; those to one side will do."""
    result = fit(spinner(start=MOST * (1 - 1e-6)), starts=0)
    assert result.converged
    assert result["body_inertia"].value == pytest.approx(THIRD, rel=0.01)


def test_derivatives_at_the_edge_are_one_sided():
    inside, edge = spinner(start=0.29), spinner(start=MOST * (1 - 1e-6))
    width = np.array([1e-3])
    for base in (False, True):
        objective = Objective(edge)
        point = objective.start()
        known = objective.residuals(point)[0] if base else None
        one_sided = objective.jacobian(point, widths=width, base=known).dense()
        # Second-order: the central difference a width inside is that of half a width inside here.
        near = Objective(inside)
        central = near.jacobian(point - width / 2, widths=width / 2).dense()
        np.testing.assert_allclose(one_sided, central, atol=1e-6 * np.abs(central).max())
    objective = Objective(edge)

    def narrow(values):
        if abs(np.log(values["x"]) - np.log(2.0)) > 1e-3:
            raise ValueError("too far")
        return ball_engine()

    free = Parameter("x", 2.0, (1.0, 4.0))
    problem = replace(edge, system=narrow, parameters=[free])
    assert not Objective(problem).jacobian(np.log([2.0]), widths=np.array([0.05])).dense().any()
    with pytest.raises(SimulationError, match=r"too far; with x = 2\.0\d+$"):
        Objective(problem).jacobian(np.log([2.0]), widths=np.array([0.2]))


def test_what_lies_next_to_what_cannot_be_built_is_not_identified():
    """Here the best body is the last that can be built: no interval around it is a minimum's."""

    def build(values):
        if values["stiffness"] > 4e3 * (1 + 1e-9):
            raise ValueError("too stiff to build")
        return ball_engine(values["stiffness"])

    seen = observe(ball_engine(), SIDEWAYS, noise=np.random.default_rng(0))
    parameter = Parameter("stiffness", 3.9e3, (1e2, 1e6))
    found = fit(Problem(build, [parameter], [seen], 1e-4, 1e-3), starts=0)["stiffness"]
    assert found.value == pytest.approx(4e3, rel=1e-3)
    assert not found.identified


def test_a_candidate_that_fails_is_named_with_its_values():
    """Of a batch of candidates that one whose simulation fails, not all of them."""
    seen = observe(ball_engine(), SIDEWAYS)
    wild = replace(make_trajectory(), name="wild", initial_qpos=[1e200, 0, 0, 1, 0, 0, 0])
    problem = Problem(ball_engine(), ball_parameters(), [seen, wild], 1e-4, 1e-3)
    message = (
        r"^trajectory 'wild': step \d+: .*; with stiffness = 3000, damping = 60, "
        r"sliding_friction = 0\.6$"
    )
    for method in ("least_squares", "cma", "cma+least_squares"):
        for options in ({}, {"starts": 8}):
            with pytest.raises(SimulationError, match=message):
                fit(problem, method=method, **options)


def test_a_batch_says_which_of_its_candidates_fail():
    objective = Objective(spinner())
    points = np.log([[0.15], [0.5], [0.2], [0.7]])
    residuals, failures = objective.attempt(points)
    assert np.isfinite(residuals).all(axis=1).tolist() == [True, False, True, False]
    np.testing.assert_array_equal(residuals[::2], objective.residuals(points[::2]))
    assert [str(f).rpartition("; with ")[2] for f in failures] == [
        "body_inertia = 0.5", "body_inertia = 0.7",
    ]  # fmt: skip
    assert "body_inertia of body 'body' would be (0.1, 0.2, 0.5)" in str(failures[0])
