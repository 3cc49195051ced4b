"""Fits in files: what was saved comes back, and what no file holds says so."""

from __future__ import annotations

import copy
import json
import pickle
import random
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import dashpot
from ball_throws import BALL, SIDEWAYS, ball_engine, ball_parameters, observe
from dashpot.calibrate import Fit, Parameter, Problem, fit, saved
from dashpot.calibrate.saved import apply_fit


@pytest.fixture(scope="module")
def problem():
    engine = ball_engine()
    rng = np.random.default_rng(8)
    throws = [
        observe(engine, velocity, noise=rng, name=f"throw {i}")
        for i, velocity in enumerate((SIDEWAYS, [0.5, 0, 0, 0, 0, 0]))
    ]
    parameters = [
        *ball_parameters(),
        Parameter.model("body_mass", "body", start=1.2, bounds=(0.5, 2.0)),
        Parameter.model("dof_damping", 0, start=1e-3, bounds=(1e-6, 1.0)),
    ]
    return Problem(engine, parameters, throws, 1e-4, 1e-3, initial_state="pose_and_velocity")


@pytest.fixture(scope="module")
def fitted(problem):
    return fit(problem, starts=0, max_evaluations=150, seed=3)


@pytest.fixture(scope="module")
def file(fitted, tmp_path_factory):
    return fitted.save(tmp_path_factory.mktemp("saved") / "ball.json")


def test_a_loaded_fit_says_what_the_saved_one_said(fitted, file):
    loaded = Fit.load(file)
    assert str(loaded) == str(fitted)
    assert repr(loaded) == repr(fitted)
    assert loaded._repr_html_() == fitted._repr_html_()
    assert loaded.values == fitted.values
    assert loaded.estimates == fitted.estimates
    assert loaded.to_dict() == fitted.to_dict()
    assert loaded.metrics() == fitted.metrics()
    assert loaded.combinations == fitted.combinations
    assert loaded.made == fitted.made
    assert repr(loaded.channels) == repr(fitted.channels)
    assert repr(loaded.misfits) == repr(fitted.misfits)
    assert loaded.sample(8, seed=1) == fitted.sample(8, seed=1)
    np.testing.assert_array_equal(loaded.covariance, fitted.covariance)
    np.testing.assert_array_equal(loaded.initial_velocity, fitted.initial_velocity)
    for ours, theirs in zip(loaded.residuals, fitted.residuals, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert [dict(s) for s in loaded.sensor_residuals] == [dict(s) for s in fitted.sensor_residuals]


def test_a_loaded_fit_can_be_saved_again(file, tmp_path):
    assert Fit.load(file).save(tmp_path / "again.json").read_bytes() == file.read_bytes()


def test_a_loaded_fit_can_be_pickled(file):
    loaded = Fit.load(file)
    for other in (pickle.loads(pickle.dumps(loaded)), copy.deepcopy(loaded)):
        assert str(other) == str(loaded)
        assert other.problem.names == loaded.problem.names


def test_a_file_is_plain_json(file):
    content = json.loads(file.read_text(), parse_constant=pytest.fail)
    assert content["fit"]["estimates"][0]["name"] == "stiffness"
    assert content["setup"]["stepper"] == "dashpot"


def test_what_a_file_does_not_hold_says_so(file):
    loaded = Fit.load(file)
    with pytest.raises(ValueError, match=r"predict needs the problem.*Fit\.load"):
        loaded.predict()
    with pytest.raises(AttributeError, match=r"ball\.json, which holds no problem: 'build' of it"):
        loaded.problem.build(loaded.values)
    with pytest.raises(ValueError, match="say what the model was compiled from"):
        loaded.write_mjcf("ball.xml")


def test_a_fit_that_is_given_its_problem_predicts(problem, fitted, file):
    found = Fit.load(file, problem=problem).predict()
    for ours, theirs in zip(found, fitted.predict(), strict=True):
        np.testing.assert_array_equal(ours.position, theirs.position)
    other = replace(problem, parameters=ball_parameters())
    with pytest.raises(ValueError, match=r"ball\.json: the parameters are .* those of problem are"):
        Fit.load(file, problem=other)


def test_an_engine_of_a_saved_fit_moves_as_the_fitted_one(problem, fitted, file):
    engine = apply_fit(Fit.load(file), mujoco.MjModel.from_xml_string(BALL))
    same = problem.build(fitted.values)
    ours, theirs = engine.make_data(), same.make_data()
    for data in (ours, theirs):
        data.qvel[:] = SIDEWAYS
    engine.step(ours, 100)
    same.step(theirs, 100)
    np.testing.assert_array_equal(ours.qpos, theirs.qpos)


def test_parameters_of_functions_are_named(tmp_path):
    """A function cannot be in a file; what the fit found out is, all the same."""

    def heavier(system, value):
        system.model.body_mass[1] = value

    engine = ball_engine()
    mass = Parameter("mass", 1.2, (0.5, 2.0), apply=heavier, changes_model=True)
    found = fit(
        Problem(engine, [*ball_parameters(), mass], [observe(engine, SIDEWAYS)], 1e-4, 1e-3),
        starts=0,
        max_evaluations=30,
    )
    loaded = Fit.load(found.save(tmp_path / "f.json"))
    assert loaded["mass"] == found["mass"]
    with pytest.raises(ValueError, match=r"'mass' = .*heavier.*cannot hold"):
        apply_fit(loaded, mujoco.MjModel.from_xml_string(BALL))
    for each in (found, loaded):
        with pytest.raises(ValueError, match="cannot hold mass"):
            each.write_mjcf(tmp_path / "f.xml", scene=BALL)


def test_a_fit_of_mujoco_is_no_engine(tmp_path):
    model = mujoco.MjModel.from_xml_string(BALL)
    throw = observe(ball_engine(), SIDEWAYS)
    friction = Parameter.model("geom_friction", "ball", index=0, start=0.5, bounds=(0.1, 1.0))
    found = fit(Problem(model, [friction], [throw], 1e-4, 1e-3), starts=0, max_evaluations=10)
    loaded = Fit.load(found.save(tmp_path / "f.json"))
    assert loaded.record().stepper == "MuJoCo"
    with pytest.raises(ValueError, match="one of MuJoCo's stepping"):
        apply_fit(loaded, model)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.update(format="a fit"), "no fit that dashpot saved"),
        (lambda c: c.update(version=2), "version is 2, not 1"),
        (lambda c: c.pop("record"), "record is missing"),
        (lambda c: c["fit"].update(cost="much"), "fit.cost is 'much'; it must be a number"),
        (lambda c: c["fit"].update(converged=1), "fit.converged is 1; it must be bool"),
        (lambda c: c["fit"].update(colour="red"), "fit.colour is unknown"),
        (lambda c: c["fit"].update(problem={}), "fit.problem is unknown"),
        (lambda c: c["fit"].pop("loss"), "fit.loss is missing"),
        (lambda c: c["fit"].update(loss="l1"), r"fit.loss is 'l1'"),
        (lambda c: c["fit"].update(correlation=[[1.0]]), r"shape \(1, 1\), not \(5, 5\)"),
        (lambda c: c["fit"].update(cost_history=[1, [2]]), "fit.cost_history is no array"),
        (lambda c: c["fit"]["estimates"].pop(), "those of estimates are"),
        (lambda c: c["fit"]["estimates"][0].update(value=0), "'stiffness' is 0, beyond its bounds"),
        (lambda c: c["parameters"][0].update(start=-1.0), r"parameters\[0\].*start must lie"),
        (
            lambda c: c["parameters"][0]["apply"].update({"is": "system"}),
            r"parameters\[0\].apply is .* known",
        ),
        (lambda c: c["setup"]["materials"][0][1].update(stiffness=-1), "stiffness must be finite"),
        (
            lambda c: c["record"]["trajectories"][0]["curves"][0]["place"].pop(),
            r"record.trajectories\[0\].curves\[0\]: 'body x': its numbers are not one a place",
        ),
    ],
)
def test_a_damaged_file_is_named(file, tmp_path, change, message):
    content = json.loads(file.read_text())
    change(content)
    damaged = tmp_path / "damaged.json"
    damaged.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=rf"damaged\.json: .*{message}"):
        Fit.load(damaged)


def test_files_with_bytes_changed_are_read_or_refused(file, tmp_path):
    """Never anything but a fit or a ValueError."""
    rng = random.Random(1)
    original = file.read_bytes()
    damaged = tmp_path / "damaged.json"
    refused = 0
    for _ in range(40):
        content = bytearray(original)
        for _ in range(rng.choice([1, 3, 30])):
            at = rng.randrange(len(content))
            content[at : at + rng.choice([0, 1, 40])] = rng.choice([b"[", b'"', b"9", b"\xff", b""])
        damaged.write_bytes(content)
        try:
            str(Fit.load(damaged))
        except ValueError:
            refused += 1
    assert refused > 5
    damaged.write_text("[" * 100_000)
    with pytest.raises(ValueError, match="nested too deeply"):
        Fit.load(damaged)


def test_a_file_that_is_too_large_is_not_read(file, monkeypatch):
    monkeypatch.setattr(saved, "_MOST_BYTES", 1000)
    with pytest.raises(ValueError, match=r"ball\.json is larger than a fit can be, 1000 bytes"):
        Fit.load(file)


def test_a_fit_of_geoms_without_names_comes_back(tmp_path):
    model = mujoco.MjModel.from_xml_string(BALL.replace(' name="ball"', ""))
    engine = dashpot.Engine(model)
    engine.set_material(1, dashpot.Material(1e4, damping=20.0, friction=0.3))
    stiffness = Parameter.material(1, "stiffness", start=8e3, bounds=(1e3, 1e5))
    problem = Problem(engine, [stiffness], [observe(engine, SIDEWAYS)], 1e-4, 1e-3)
    found = fit(problem, starts=0, max_evaluations=20)
    loaded = Fit.load(found.save(tmp_path / "f.json"))
    assert apply_fit(loaded, model).material(1).stiffness == found.values["stiffness"]
