"""Calibration: fits, their results and their options."""

import json
import math
import warnings
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import dashpot
from ball_throws import BALL, SIDEWAYS, ball_engine, ball_parameters, observe
from dashpot.calibrate import Parameter, Problem, Trajectory, fit, twin
from dashpot.calibrate.residuals.objective import Objective


@pytest.fixture(scope="module")
def noisy_ball():
    engine = ball_engine()
    rng = np.random.default_rng(8)
    trajectories = [
        observe(engine, velocity, noise=rng, name=f"throw {i}")
        for i, velocity in enumerate((SIDEWAYS, [0.5, 0, 0, 0, 0, 0]))
    ]
    return Problem(engine, ball_parameters(), trajectories, 1e-4, 1e-3)


TRUTH = {"stiffness": 1e4, "damping": 20.0, "sliding_friction": 0.3}


@pytest.fixture(scope="module")
def fitted(noisy_ball):
    return fit(noisy_ball)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"windows": (0.15,), "starts": 3},
        {"method": "cma+least_squares", "max_evaluations": 300},
        {"loss": "soft_l1", "loss_scale": 2.0},
    ],
)
def test_fits_recover_the_truth(noisy_ball, fitted, options):
    result = fit(noisy_ball, **options) if options else fitted
    for name, value in TRUTH.items():
        estimate = result[name]
        # 4.5 standard errors: a correct fit fails one of these once in 150,000.
        assert abs(estimate.value - value) < 4.5 * estimate.standard_error
        assert estimate.identified
        # Worth something: standard errors are 0.1 to 1 % (friction acts until the ball rolls).
        assert estimate.value == pytest.approx(value, rel=0.05)
    assert result.converged
    # Noise was stated rightly: 479 residuals, standard deviation of their variance 0.065.
    if "loss" not in options:
        assert result.residual_variance == pytest.approx(1.0, abs=0.3)
    if not options:
        assert (np.diff(result.cost_history) <= 0).all()


def test_cma_alone_comes_close(noisy_ball):
    """Shorter windows take shares of the budget, and the last one goes on from their estimate."""
    result = fit(noisy_ball, method="cma", windows=(0.15,), max_evaluations=500, seed=3)
    assert result["stiffness"].value == pytest.approx(1e4, rel=0.05)
    assert result["sliding_friction"].value == pytest.approx(0.3, rel=0.05)


def test_a_fit_does_not_depend_on_threads(noisy_ball):
    one, two = (fit(noisy_ball, nthread=n, starts=3).to_dict() for n in (1, 2))
    del one["seconds"], two["seconds"]
    assert one == two


def test_initial_states_are_estimated(noisy_ball):
    unknown = [
        Trajectory(t.name, t.time, t.position, t.quaternion, t.bodies)
        for t in noisy_ball.trajectories
    ]
    result = fit(replace(noisy_ball, trajectories=unknown, initial_state="pose_and_velocity"))
    for name, value in TRUTH.items():
        assert abs(result[name].value - value) < 4.5 * result[name].standard_error
    # Velocity from 10 frames of flight at 0.1 mm: about 1e-4 / (0.01 sqrt(82)) = 1.1 mm/s alone.
    np.testing.assert_allclose(result.initial_velocity[0][:3], SIDEWAYS[:3], atol=5e-3)
    assert result.initial_displacement.shape == (2, 6)


def test_mujoco_can_be_tuned_the_same_way():
    model = mujoco.MjModel.from_xml_string(BALL)
    model.geom_solref[:] = [0.03, 0.4]

    data = mujoco.MjData(model)
    data.qvel[:] = SIDEWAYS
    poses = [data.qpos.copy()]
    for _ in range(39):
        mujoco.mj_step(model, data, nstep=2)
        poses.append(data.qpos.copy())
    poses = np.array(poses)
    trajectory = Trajectory(
        "throw", 0.01 * np.arange(40), poses[:, :3], poses[:, 3:], ("body",),
        initial_qpos=poses[0], initial_qvel=SIDEWAYS,
    )  # fmt: skip
    parameters = [
        Parameter.model("geom_solref", ("ball", "floor"), index=i, start=start, bounds=bounds,
                        name=name)
        for i, (name, start, bounds) in enumerate(
            [("timeconst", 0.05, (0.011, 0.2)), ("dampratio", 0.8, (0.1, 2.0))]
        )
    ]  # fmt: skip
    result = fit(Problem(model, parameters, [trajectory], 1e-4, 1e-3), starts=8)
    assert result["timeconst"].value == pytest.approx(0.03, rel=1e-4)
    assert result["dampratio"].value == pytest.approx(0.4, rel=1e-4)
    assert model.geom_solref[0].tolist() == [0.03, 0.4]


def test_a_function_can_build_the_system():
    """A parameter without a setter reaches the builder: here a geometry that is compiled."""

    def build(values):
        engine = dashpot.Engine(
            mujoco.MjModel.from_xml_string(BALL.replace('size="0.1"', f'size="{values["radius"]}"'))
        )
        engine.set_material("ball", dashpot.Material(1e4, damping=20.0, friction=0.3))
        return engine

    trajectory = observe(build({"radius": 0.1}), SIDEWAYS)
    radius = Parameter("radius", start=0.09, bounds=(0.05, 0.15))
    result = fit(Problem(build, [radius], [trajectory], 1e-4, 1e-3))
    assert result["radius"].value == pytest.approx(0.1, rel=1e-6)
    with pytest.raises(TypeError, match=r"must return a dashpot\.Engine"):
        Problem(lambda values: values, [radius], [trajectory], 1e-4, 1e-3)


def test_results_read_well(noisy_ball, fitted):
    result = fitted
    text = json.dumps(result.to_dict())
    assert "sliding_friction" in text
    table = result.table(TRUTH)
    assert table.row_count == 3
    assert result.noise_explains
    assert "the stated noise explains" in str(result)
    assert "sliding_friction" in str(result)
    assert repr(result).startswith("Fit(")
    assert len(repr(result)) < 300
    doubted = fit(replace(noisy_ball, position_sigma=0.5e-4))  # half the true noise
    assert not doubted.noise_explains
    assert "more than noise is in the residuals" in str(doubted.table().caption)
    for estimate in doubted.estimates:
        # Residuals are white, so that it is the noise that is wrong, and by how much is said.
        assert estimate.grade == "identified"
        assert "times as large of position, " in estimate.statement
    sizes = {channel.channel: channel.size for channel in doubted.channels}
    assert sizes["position"] == pytest.approx(2.0, rel=0.2)
    assert sizes["rotation"] == pytest.approx(1.0, rel=0.2)
    # Intervals are scaled with the residuals: noise halved throughout changes none. (Points drawn
    # in their region leave some percent.)
    halved = replace(noisy_ball, position_sigma=0.5e-4, rotation_sigma=0.5e-3)
    halved = fit(halved, starts=0)
    for name in TRUTH:
        expected = pytest.approx(result[name].standard_error, rel=0.1)
        assert halved[name].standard_error == expected
    assert not any("noise" in estimate.statement for estimate in result.estimates)
    assert [residual.shape for residual in result.residuals] == [(40, 1, 6)] * 2
    metrics = result.metrics()
    # Three axes at 0.1 mm and at 1 mrad.
    assert metrics["position_rms"] == pytest.approx(math.sqrt(3) * 1e-4, rel=0.3)
    assert metrics["rotation_rms"] == pytest.approx(math.sqrt(3) * 1e-3, rel=0.3)
    assert list(result) == list(TRUTH)
    assert "stiffness" in result
    assert "mass" not in result
    with pytest.raises(KeyError, match="no parameter named 'mass'; there are stiffness"):
        result["mass"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "newton"}, "method must be one of"),
        ({"loss": "l1"}, "loss must be one of"),
        ({"loss_scale": 0.0}, "loss_scale"),
        ({"windows": (0.3, 0.2)}, "windows"),
        ({"starts": -1}, "starts"),
        ({"seed": -1}, "seed must be >= 0, got -1"),
        ({"local_searches": 0}, "local_searches"),
        ({"max_evaluations": 0}, "max_evaluations"),
        ({"errors": "bootstrap"}, "errors must be one of"),
        ({"confidence": 1.0}, "confidence"),
        ({"nthread": 0}, "nthread must be >= 1"),
    ],
)
def test_bad_options_are_named(noisy_ball, options, message):
    with pytest.raises(ValueError, match=message):
        fit(noisy_ball, **options)


def test_windows_beyond_the_problems_are_refused(noisy_ball):
    with pytest.raises(ValueError, match=r"windows end with 0.2 s; .* shorter than the problem's"):
        fit(noisy_ball.with_window(0.2), windows=(0.1, 0.2))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"windows": 0.2}, "windows must be a sequence of numbers, got 0.2"),
        ({"windows": ("a",)}, "windows must be an array of numbers"),
        ({"starts": 1.5}, "starts must be an integer, got 1.5"),
        ({"local_searches": 1.5}, "local_searches must be an integer"),
        ({"max_evaluations": 9.5}, "max_evaluations must be an integer"),
        ({"loss_scale": "a"}, "loss_scale must be a number, got 'a'"),
        ({"seed": "a"}, "seed must be an integer, got 'a'"),
        ({"confidence": None}, "confidence must be a number, got None"),
        ({"nthread": 1.0}, "nthread must be an integer"),
    ],
)
def test_options_of_the_wrong_type_are_named(noisy_ball, options, message):
    with pytest.raises(TypeError, match=f"^{message}"):
        fit(noisy_ball, **options)
    with pytest.raises(TypeError, match=r"^problem is Engine; it must be a calibrate\.Problem"):
        fit(noisy_ball.system, **options)


@pytest.mark.parametrize(
    ("changes", "options", "message"),
    [
        (
            {"initial_state": "pose_and_velocity", "window": 0.01},
            {},
            "24 residuals cannot determine 27 unknowns",
        ),
        ({}, {"errors": "clustered"}, "errors='clustered' needs at least two trajectories"),
    ],
)
def test_what_cannot_be_told_is_refused_before_the_search(noisy_ball, changes, options, message):
    """Not after a search of minutes whose intervals then fail."""
    if "errors" in options:
        changes = {"trajectories": noisy_ball.trajectories[:1]}
    called = []

    def build(values):
        called.append(values)
        return noisy_ball.system

    problem = replace(noisy_ball, **changes)
    problem = replace(
        problem,
        system=build,
        parameters=[Parameter(p.name, p.start, p.bounds) for p in problem.parameters],
    )
    called.clear()
    with pytest.raises(ValueError, match=message):
        fit(problem, **options)
    assert len(called) <= 1


def test_twin_experiment_covers_the_truth():
    """The 100-seed coverage is benchmarks/twin_coverage.py; here one seed at 99.99 %."""
    result = twin.run(seed=2)
    assert result.fit.residual_variance == pytest.approx(1.0, abs=0.25)
    for name, value in result.truth.items():
        estimate = result.fit[name]
        assert estimate.identified
        assert abs(estimate.value - value) < 3.9 * estimate.standard_error
        assert abs(math.log(result.start[name] / value)) > math.log(1.2)


def test_motion_is_continuous_in_stiffness():
    """A tumbling, slipping and sticking box: cliffs here would be cliffs of every calibration.

    Over 41 stiffnesses within 0.2 % the residuals move in even steps; where slip resets friction
    springs discontinuously, single steps are hundreds of times the usual one.
    """
    rng = np.random.default_rng(3)
    truth, _ = twin.draw(rng)
    stiffness = Parameter.pair("body", "floor", "stiffness", start=truth["stiffness"],
                               bounds=twin.BOUNDS["stiffness"])  # fmt: skip
    trajectories = twin.throws(truth, rng)
    problem = Problem(
        twin.engine(truth), [stiffness], trajectories, 2e-4, 2e-3, substeps=twin.SUBSTEPS,
        initial_state="pose_and_velocity",
    )  # fmt: skip
    objective = Objective(problem)
    points = np.repeat(objective.start()[None], 41, axis=0)
    points[:, 0] += np.linspace(-1e-3, 1e-3, 41)
    steps = np.abs(np.diff(objective.residuals(points), axis=0)).max(axis=1)
    assert np.median(steps) > 1e-3  # of a standard deviation: the box did hit the floor
    assert steps.max() < 5 * np.median(steps)


@pytest.mark.parametrize("initial_state", ["given", "velocity"])
def test_a_start_at_a_noisy_frame_is_warned_of(noisy_ball, initial_state):
    """The pose of the first frame has noise, too; nothing but an estimate takes that in."""
    unknown = [replace(t, initial_qpos=None) for t in noisy_ball.trajectories]
    problem = replace(noisy_ball, trajectories=unknown, initial_state=initial_state)
    with pytest.warns(UserWarning, match=f"'{unknown[0].name}'.* no initial_qpos"):
        fit(problem, max_evaluations=1, starts=0)
    for quiet in (noisy_ball, replace(problem, initial_state="pose_and_velocity")):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            fit(quiet, max_evaluations=1, starts=0)


def test_a_table_names_the_truth_that_it_lacks(noisy_ball):
    result = fit(noisy_ball, max_evaluations=1, starts=0)
    with pytest.raises(ValueError, match=r"truth has no value of stiffness, damping$"):
        result.table(truth={"sliding_friction": 0.3})
