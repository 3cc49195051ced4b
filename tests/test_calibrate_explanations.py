"""Misfits of recorders are called by their names: delay, gain, offset, scale, sampling."""

from __future__ import annotations

import copy
import dataclasses

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.calibrate import Fit, Parameter, Problem, Trajectory, fit
from dashpot.calibrate.inference.explanations import screened
from dashpot.calibrate.inference.intervals import pseudo_inverse
from dashpot.calibrate.inference.leftovers import Leftovers
from dashpot.calibrate.inference.recorder_trials import recorder_trials
from dashpot.calibrate.residuals.losses import Loss
from dashpot.calibrate.residuals.objective import Objective

SPRING = """
<mujoco>
  <option timestep="0.005" gravity="0 0 0"/>
  <worldbody>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0" stiffness="40" damping="0.4"/>
      <geom name="cart" type="box" size=".1 .1 .1" mass="1"/>
      <site name="mark"/>
    </body>
  </worldbody>
  <actuator><motor joint="rail"/></actuator>
  <sensor>
    <jointpos name="place" joint="rail"/>
    <jointvel name="speed" joint="rail"/>
    <force name="load" site="mark"/>
  </sensor>
</mujoco>
"""
BALL = """
<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="ball" pos="0 0 1">
      <freejoint/>
      <geom name="ball" type="sphere" size="0.05" mass="0.2"/>
    </body>
  </worldbody>
</mujoco>
"""
SIGMA = {"place": 1e-3, "speed": 5e-3, "load": 0.02}
# On the load cell, whose force on 1 kg is 4 N at most.
RECORDERS = {
    "late": (Parameter.delay("load", bounds=(-0.05, 0.05)), 0.02),
    "gain": (Parameter.gain("load", bounds=(0.5, 2.0)), 1.1),
    "offset": (Parameter.offset("load", bounds=(-1.0, 1.0)), 0.05),
}


def read(problem, extra, truth, rng):
    """Return `problem` with the readings, noise included, of a model with `truth`."""
    values = {p.name: truth.get(p.name, p.start) for p in (*problem.parameters, *extra)}
    parameters = [
        dataclasses.replace(p, start=values[p.name]) for p in (*problem.parameters, *extra)
    ]
    true = dataclasses.replace(problem, parameters=parameters, initial_state="given")
    objective = Objective(true)
    (found,) = objective.observe(objective.start())
    (trajectory,) = problem.trajectories
    seen = copy.copy(trajectory)
    sensors = {
        name: np.where(
            np.isnan(old), np.nan, found[name] + SIGMA[name] * rng.normal(size=old.shape)
        )
        for name, old in trajectory.sensors.items()
    }
    object.__setattr__(seen, "sensors", sensors)
    if trajectory.bodies:
        position = found["poses"].reshape(trajectory.frames, -1, 7)[..., :3]
        noise = problem.position_sigma * rng.normal(size=position.shape)
        object.__setattr__(seen, "position", position + noise)
    return dataclasses.replace(problem, trajectories=[seen])


def swing(*, every=1, **fields):
    """Return a problem of a cart on a spring; the load cell reads 3 numbers, of which x counts."""
    frames = 120
    load = np.zeros((frames, 3))
    load[np.arange(frames) % every != 0] = np.nan
    trajectory = Trajectory.of_sensors(
        "swing", 0.01 * np.arange(frames),
        {"place": np.zeros(frames), "speed": np.zeros(frames), "load": load},
        initial_qpos=[0.1], initial_qvel=[0.0],
    )  # fmt: skip
    unknown = [
        Parameter.model("jnt_stiffness", "rail", start=40.0, bounds=(5.0, 200.0), name="k"),
        Parameter.model("dof_damping", "rail", start=0.4, bounds=(0.01, 5.0), name="damping"),
    ]
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(SPRING))
    return Problem(
        engine, unknown, [trajectory], sensor_sigma=SIGMA, initial_state="pose_and_velocity",
        **fields,
    )  # fmt: skip


def slow_cell(sampling):
    """Return the problem of a load cell at 12.5 Hz, whose means are those of 80 ms."""
    problem = swing()
    (trajectory,) = problem.trajectories
    time = 0.08 * np.arange(15)
    other = Trajectory.of_sensors(
        "swing", trajectory.time, {**trajectory.sensors, "load": np.zeros((15, 3))},
        sensor_times={"load": time}, sampling={"load": sampling},
        initial_qpos=[0.1], initial_qvel=[0.0],
    )  # fmt: skip
    return dataclasses.replace(problem, trajectories=[other])


def throw():
    """Return a problem of a ball that is thrown, and bounces twice."""
    frames = 60
    trajectory = Trajectory(
        "throw", 0.0125 * np.arange(frames), np.zeros((frames, 3)), None, "ball",
        initial_qpos=[0.3, 0.2, 0.3, 1, 0, 0, 0], initial_qvel=[0.5, 0.2, 0, 0, 0, 0],
    )  # fmt: skip
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL))
    engine.set_pair_material("ball", "floor", dashpot.Material(1e5, restitution=0.7))
    unknown = [Parameter.pair("ball", "floor", "restitution", start=0.7, bounds=(0.05, 0.99))]
    return Problem(
        engine, unknown, [trajectory], position_sigma=2e-3, initial_state="pose_and_velocity"
    )


def with_data(problem, data):
    return dataclasses.replace(problem, trajectories=data.trajectories)


@pytest.mark.parametrize(
    ("name", "noise"),
    [("late", "stated"), *((name, "estimate") for name in ("gain", "offset"))],
)
def test_what_a_recorder_does_is_named_with_its_size(name, noise):
    parameter, truth = RECORDERS[name]
    data = read(swing(), [parameter], {parameter.name: truth}, np.random.default_rng(0))
    result = fit(with_data(swing(noise=noise), data), starts=0)
    assert result.misfits
    best = result.explanations[0]
    assert (best.quantity, best.channel) == (parameter.apply.quantity, parameter.apply.channel)
    assert best.value == pytest.approx(truth, abs=4.0 * best.standard_error)
    assert best.standard_error < 0.1 * abs(truth - (0.0 if name == "late" else 1.0))
    assert best.share > 0.9
    assert best.white
    # The remedy is what the problem lacked.
    assert f"{best}".count(f'Parameter.{best.quantity}("{best.channel}")') == 1


@pytest.mark.parametrize(("true", "said"), [("mean", "instant"), ("instant", "mean")])
def test_sampling_comes_before_the_delay_that_is_like_it(true, said):
    """Means over 80 ms lag by 40 ms: a delay explains as much, but has a value to be chosen."""
    data = read(slow_cell(true), [], {}, np.random.default_rng(0))
    (trajectory,) = data.trajectories
    object.__setattr__(trajectory, "sampling", {"load": said})
    result = fit(data, starts=0)
    first, second = result.explanations
    assert (first.channel, first.quantity) == ("load", "sampling")
    assert f'sampling={{"load": "{true}"}}' in str(first)
    assert second.quantity == "delay"
    assert abs(second.value) == pytest.approx(0.04, rel=0.1)


def test_a_scale_of_positions_is_named():
    truth = 1.15
    scale = Parameter.scale(bounds=(0.5, 2.0))
    data = read(throw(), [scale], {scale.name: truth}, np.random.default_rng(0))
    result = fit(with_data(throw(), data), starts=0)
    best = result.explanations[0]
    assert (best.channel, best.quantity) == ("poses", "scale")
    assert best.value == pytest.approx(truth, abs=0.02)
    assert best.share > 0.9
    assert str(best).startswith("positions look 1")
    assert "too large" in str(best)


@pytest.mark.parametrize(("attribute", "value"), [("dof_frictionloss", 0.3), ("density", 300.0)])
def test_physics_that_is_missing_is_no_recorder(attribute, value):
    """Dry friction, or drag, of which the model knows nothing."""
    model = mujoco.MjModel.from_xml_string(SPRING)
    if attribute == "density":
        model.opt.density = value
    else:
        model.dof_frictionloss[:] = value
    true = dataclasses.replace(swing(), system=dashpot.Engine(model))
    result = fit(with_data(swing(), read(true, [], {}, np.random.default_rng(0))), starts=0)
    assert result.misfits
    assert not result.explanations


def test_of_a_right_model_nothing_is_said():
    for seed in range(2):
        assert not fit(read(swing(), [], {}, np.random.default_rng(seed)), starts=0).explanations


def test_a_score_is_off_by_chance_as_often_as_it_says():
    """Of 9 ways to read a right model's data, about one in twenty is off at 5 %."""
    chances = []
    for seed in range(8):
        problem = read(swing(), [], {}, np.random.default_rng(seed))
        objective = Objective(problem)
        point = objective.start()
        point[objective.parameters :] = 0.0
        residuals = objective.residuals(point)[0]
        jacobian = objective.jacobian(point, base=residuals)
        point = point - pseudo_inverse(jacobian).solve(residuals[None])[0]
        residuals = objective.residuals(point)[0]
        left = Leftovers(objective, point, residuals, jacobian, Loss())
        trials = [t for t in recorder_trials(objective, point) if t.quantity != "sampling"]
        chances += [screened(trial, left).chance for trial in trials]
    assert len(chances) == 8 * 9
    # Its standard deviation is 2.6 %.
    assert np.mean(np.array(chances) < 0.05) < 0.05 + 3 * 0.026
    assert min(chances) > 0.01 / 8 / 9


def test_what_is_unknown_already_is_not_tried():
    parameter, truth = RECORDERS["late"]
    problem = swing()
    problem = dataclasses.replace(problem, parameters=[*problem.parameters, parameter])
    objective = Objective(problem)
    tried = {(t.channel, t.quantity) for t in recorder_trials(objective, objective.start())}
    assert ("load", "delay") not in tried
    assert ("load", "gain") in tried
    data = read(swing(), [parameter], {parameter.name: truth}, np.random.default_rng(0))
    assert not fit(with_data(problem, data), starts=0).explanations


def test_explanations_are_shown_saved_and_counted(tmp_path, undrawn):
    parameter, truth = RECORDERS["offset"]
    data = read(swing(), [parameter], {parameter.name: truth}, np.random.default_rng(0))
    result = fit(with_data(swing(), data), starts=0)
    (said,) = map(str, result.explanations)
    assert said in " ".join(str(result).split())
    assert said.replace('"', "&quot;") in result._repr_html_()
    assert result.to_dict()["explanations"][0]["said"] == said
    assert Fit.load(result.save(tmp_path / "fit.json")).explanations == result.explanations
    page = result.report(tmp_path / "fit.html").read_text()
    assert page.count(said.replace('"', "&#34;")) == 2
    plain = fit(with_data(swing(), data), starts=0, max_evaluations=40)
    assert plain.evaluations <= 40 + 2 * 25


def test_functions_of_the_users_own_get_no_parameter_that_they_do_not_know():
    """The builder of a system takes exactly the values that it asks for."""

    def build(values):
        assert set(values) == {"k", "damping"}
        model = mujoco.MjModel.from_xml_string(SPRING)
        model.jnt_stiffness[:], model.dof_damping[:] = values["k"], values["damping"]
        return dashpot.Engine(model)

    parameter, truth = RECORDERS["offset"]
    data = read(swing(), [parameter], {parameter.name: truth}, np.random.default_rng(0))
    unknown = [dataclasses.replace(p, apply=None) for p in swing().parameters]
    result = fit(dataclasses.replace(data, system=build, parameters=unknown), starts=0)
    assert result.explanations[0].quantity == "offset"
