"""Calibration by the workers of executors, and from checkpoints: to the same bits."""

from __future__ import annotations

import pickle
import re
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

from ball_throws import SIDEWAYS, ball_engine, ball_parameters, observe
from dashpot.calibrate import Parameter, Problem, fit
from dashpot.calibrate.residuals import checkpoint as checkpoints
from dashpot.calibrate.residuals.objective import Objective

OPTIONS = {"starts": 0, "nthread": 1}


class Here(Executor):
    """Works at once in this process, and stops after so many jobs, as a killed worker does."""

    def __init__(self, jobs=10**9):
        self.jobs, self.asked = jobs, 0

    def submit(self, function, /, *args, **kwargs):
        self.asked += 1
        if self.asked > self.jobs:
            raise InterruptedError("a worker was killed")
        future = Future()
        future.set_result(function(*args, **kwargs))
        return future


def throws(count, frames=30):
    engine, rng = ball_engine(), np.random.default_rng(3)
    trajectories = [
        observe(engine, [*(0.1 * rng.normal(size=3) + SIDEWAYS[:3]), 0, 3.0, 0], frames, noise=rng,
                name=f"throw {i}")
        for i in range(count)
    ]  # fmt: skip
    return Problem(engine, ball_parameters(), trajectories, 1e-4, 1e-3, initial_state="velocity")


def same(first, second):
    """Whether two fits are equal bit for bit."""
    for a, b in zip(first.estimates, second.estimates, strict=True):
        assert (a.value, a.standard_error, a.lower, a.upper) == (
            b.value, b.standard_error, b.lower, b.upper,
        )  # fmt: skip
        assert a.statement == b.statement
    for a, b in zip(first.residuals, second.residuals, strict=True):
        np.testing.assert_array_equal(a, b)
    assert first.evaluations == second.evaluations
    np.testing.assert_array_equal(first.initial_velocity, second.initial_velocity)


@pytest.fixture(scope="module")
def problems():
    """One whose jobs are points, and one whose jobs are trajectories."""
    return {count: throws(count) for count in (2, 10)}


@pytest.fixture(scope="module")
def fits(problems):
    return {count: fit(problem, **OPTIONS) for count, problem in problems.items()}


def test_processes_come_to_the_bits_of_threads(problems, fits):
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        same(fit(problems[2], executor=pool, **OPTIONS), fits[2])


class FakeRay:
    """Has of Ray what an executor takes: tasks that become futures."""

    def __init__(self):
        self.tasks = 0

    def remote(self, function):
        ray = self

        class Task:
            def remote(self, *args):
                ray.tasks += 1
                self.result = pickle.dumps(function(*pickle.loads(pickle.dumps(args))))
                return self

            def future(self):
                future = Future()
                future.set_result(pickle.loads(self.result))
                return future

        return Task()


def test_the_executor_of_ray_that_the_page_shows_comes_to_the_bits_of_threads(problems, fits):
    page = (Path(__file__).parents[1] / "docs/recordings.md").read_text(encoding="utf-8")
    code = re.search(r"(class RayExecutor:\n(?:    .*\n)+)", page)[1]
    names = {"ray": FakeRay()}
    exec(code, names)
    same(fit(problems[2], executor=names["RayExecutor"](), **OPTIONS), fits[2])
    assert names["ray"].tasks > 10


def test_dask_comes_to_the_bits_of_threads(problems, fits):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, dashboard_address=None, processes=False
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        same(fit(problems[10], executor=client.get_executor(), **OPTIONS), fits[10])


@pytest.mark.parametrize("count", [2, 10])
def test_points_that_fail_in_workers_are_named_as_here(problems, count):
    def narrow(system, value):
        if value > 0.5:
            raise ValueError("it is too much")

    bad = Parameter("limit", start=0.4, bounds=(0.1, 1.0), apply=narrow)
    problem = replace(problems[count], parameters=[*problems[count].parameters, bad])
    here = Objective(problem, nthread=1)
    from dashpot.calibrate.residuals.workers import Workers

    away = Objective(problem, workers=Workers(Here()))
    points = np.stack([here.start()] * 3)
    points[1, 3] = np.log(0.9)
    (expected, failed), (found, also) = here.attempt(points), away.attempt(points)
    np.testing.assert_array_equal(expected, found)
    assert np.isinf(found[1]).all()
    assert [str(failure) for failure in failed] == [str(failure) for failure in also]


def test_what_cannot_be_sent_is_said(monkeypatch, problems):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    problem = replace(
        problems[2],
        parameters=[
            *problems[2].parameters,
            Parameter("lambda", start=1.0, bounds=(0.5, 2.0), apply=lambda system, value: None),
        ],
    )
    with pytest.raises(TypeError, match="an executor needs a problem that can be pickled"):
        fit(problem, executor=Here(), **OPTIONS)
    with pytest.raises(TypeError, match="executor must have submit"):
        fit(problem, executor="dask", **OPTIONS)


def test_a_fit_that_was_killed_goes_on_to_the_same_bits(tmp_path, problems, fits):
    path, jobs = tmp_path / "fit.npz", 75
    with pytest.raises(InterruptedError):
        fit(problems[2], executor=Here(jobs), checkpoint=path, **OPTIONS)
    rest = Here()
    same(fit(problems[2], executor=rest, checkpoint=path, **OPTIONS), fits[2])
    whole = Here()
    fit(problems[2], executor=whole, **OPTIONS)
    # Of the batch that was cut short nothing is kept; 24 jobs are the most that one has.
    assert whole.asked - jobs <= rest.asked <= whole.asked - jobs + 24
    nothing = Here()
    same(fit(problems[2], executor=nothing, checkpoint=path, **OPTIONS), fits[2])
    assert nothing.asked == 0


def test_an_interrupt_loses_nothing(tmp_path, monkeypatch, problems, fits):
    path, calls = tmp_path / "fit.npz", []
    simulate = Objective.simulate

    def interrupted(self, points):
        calls.append(len(points))
        if len(calls) == 6:
            raise KeyboardInterrupt
        return simulate(self, points)

    with monkeypatch.context() as patch:
        patch.setattr(Objective, "simulate", interrupted)
        with pytest.raises(KeyboardInterrupt):
            fit(problems[2], checkpoint=path, **OPTIONS)
    same(fit(problems[2], checkpoint=path, **OPTIONS), fits[2])
    assert not path.with_name("fit.npz.new").exists()


def test_a_checkpoint_of_another_fit_is_refused(tmp_path, problems):
    path = tmp_path / "fit.npz"
    fit(problems[2], checkpoint=path, **OPTIONS)
    heavier = replace(problems[2], system=ball_engine(stiffness=2e4, friction=0.1))
    starts = [replace(p, start=1.01 * p.start) for p in problems[2].parameters]
    other = replace(heavier, parameters=starts[:1] + list(problems[2].parameters[1:]))
    # Other points are simulated beside those that are known.
    fit(other, checkpoint=path, max_evaluations=5, **OPTIONS)
    friction = problems[2].parameters[2]
    fixed = replace(problems[2], parameters=[replace(friction, apply=lambda system, value: None)])
    fresh = tmp_path / "one.npz"
    fit(fixed, checkpoint=fresh, max_evaluations=5, **OPTIONS)
    softer = replace(fixed, system=ball_engine(stiffness=2e3))
    with pytest.raises(ValueError, match=r"one\.npz is of another problem"):
        fit(softer, checkpoint=fresh, max_evaluations=5, **OPTIONS)


def test_damaged_checkpoints_are_refused(tmp_path, problems):
    path = tmp_path / "fit.npz"
    fit(problems[2], checkpoint=path, max_evaluations=5, **OPTIONS)
    whole, rng = path.read_bytes(), np.random.default_rng(0)
    refused = []
    for _ in range(200):
        damaged = bytearray(whole)
        for place in rng.integers(len(whole), size=3):
            damaged[place] = rng.integers(256)
        path.write_bytes(damaged[: rng.integers(len(whole))] if rng.random() < 0.3 else damaged)
        try:
            checkpoints.Checkpoint(path)
        except ValueError as error:
            refused.append(str(error))
    assert len(refused) > 100
    assert all("fit.npz cannot be read" in message for message in refused)
    np.savez(path, other=np.zeros(3))
    with pytest.raises(ValueError, match="it holds other"):
        checkpoints.Checkpoint(path)
    with pytest.raises(ValueError, match="there is no folder"):
        fit(problems[2], checkpoint=tmp_path / "no" / "fit.npz", **OPTIONS)
