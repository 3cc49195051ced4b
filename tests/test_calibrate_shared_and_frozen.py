"""One value for several pairs, values that are held, and models nested in each other."""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy import stats

import dashpot
from dashpot.calibrate import Fit, Parameter, Problem, Trajectory, fit, predict

G = 9.81
TWO_BALLS = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="left" type="plane" size="5 5 .1"/>
    <geom name="right" type="plane" size="5 5 .1" pos="0 0 -1"/>
    <body name="a" pos="0 0 1"><freejoint/><geom name="a" size="0.05" mass="0.2"/></body>
    <body name="b" pos="1 0 1"><freejoint/><geom name="b" size="0.05" mass="0.2"/></body>
  </worldbody>
</mujoco>
"""
CART = """
<mujoco>
  <option timestep="0.01" gravity="0 0 0"/>
  <worldbody>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0" damping="1"/>
      <geom name="cart" type="box" size=".1 .1 .1" mass="2"/>
    </body>
  </worldbody>
  <sensor><jointpos name="encoder" joint="rail"/></sensor>
</mujoco>
"""
MASS, DAMPING, SPEED = 2.0, 3.0, 1.0


def impacts(height, restitution, count):
    """Return when a rigid ball that falls by `height` hits the floor."""
    first = math.sqrt(2.0 * height / G)
    flights = 2.0 * first * restitution ** np.arange(1, count)
    return first + np.concatenate([[0.0], np.cumsum(flights)])


def drop(body, floor, height, restitution):
    """Return impact times of one of two balls; the other rests far above."""
    qpos = np.array([0, 0, 50.0, 1, 0, 0, 0, 2, 0, 50.0, 1, 0, 0, 0])
    start = 0 if body == "a" else 7
    qpos[start + 2] = height + 0.05 + floor
    return Trajectory.of_events(
        f"drop of {body}",
        {"impact": impacts(height, restitution, 4)},
        bodies=body,
        initial_qpos=qpos,
        initial_qvel=np.zeros(12),
    )


def two_balls():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(TWO_BALLS))
    for ball, floor in (("a", "left"), ("b", "left")):
        engine.set_pair_material(ball, floor, dashpot.Material(1e6, restitution=0.5))
    return engine


def test_several_pairs_share_one_value():
    pairs = [("a", "left"), ("left", "b")]
    unknown = Parameter.pair(pairs, "restitution", start=0.7, bounds=(0.05, 0.99))
    drops = [drop("a", 0.0, 0.5, 0.6), drop("b", 0.0, 0.3, 0.6)]
    problem = Problem(two_balls(), [unknown], drops, event_sigma={"impact": 1e-3})
    built = problem.build({"restitution": 0.8})
    assert all(built.pair_material(*pair).restitution == 0.8 for pair in pairs)
    assert fit(problem, starts=0)["restitution"].value == pytest.approx(0.6, abs=4e-3)


def test_what_differs_shows_beside_what_is_shared():
    """Two balls with a stiffness of both and a restitution each."""
    unknown = [
        Parameter.pair([("a", "left"), ("b", "left")], "stiffness", start=1e6, frozen=True),
        Parameter.pair("a", "left", "restitution", start=0.7, name="lively"),
        Parameter.pair("b", "left", "restitution", start=0.7, name="dull"),
    ]
    drops = [drop("a", 0.0, 0.5, 0.8), drop("b", 0.0, 0.3, 0.6)]
    result = fit(Problem(two_balls(), unknown, drops, event_sigma={"impact": 1e-3}), starts=0)
    assert result["lively"].value == pytest.approx(0.8, abs=4e-3)
    assert result["dull"].value == pytest.approx(0.6, abs=4e-3)


def test_channels_of_one_recorder_share_a_delay():
    """A ramp of 50 N/s felt by a cart of 2 kg, and its poses; both recorders are 20 ms late."""
    xml = CART.replace("<sensor>", '<sensor><accelerometer name="felt" site="mark"/>').replace(
        "</body>", '<site name="mark"/></body>'
    )
    xml = xml.replace("<sensor>", '<actuator><motor joint="rail"/></actuator><sensor>')
    model = mujoco.MjModel.from_xml_string(xml.replace('damping="1"', ""))
    time = 0.01 * np.arange(61)
    late = np.maximum(time - 0.02, 0.0)
    felt = np.zeros((61, 3))
    felt[:, 0] = 25.0 * late
    trajectory = Trajectory.of_sensors(
        "push", time, {"encoder": 25.0 * late**3 / 6.0, "felt": felt},
        initial_qpos=[0.0], initial_qvel=[0.0], control=50.0 * (time[:-1, None] + 0.005),
        sampling={"felt": "instant"},
    )  # fmt: skip
    both = Parameter.delay(["felt", "encoder"], bounds=(-0.01, 0.05))
    assert both.name == "delay of felt, encoder"
    sigma = {"encoder": 1e-3, "felt": 0.05}
    problem = Problem(dashpot.Engine(model), [both], [trajectory], sensor_sigma=sigma, substeps=10)
    assert fit(problem, starts=0)[both.name].value == pytest.approx(0.02, abs=2e-3)
    one = Parameter.delay("encoder", bounds=(-0.01, 0.05))
    with pytest.raises(ValueError, match="both set the delay of encoder"):
        replace(problem, parameters=[both, one])
    with pytest.raises(ValueError, match="no trajectory has a channel 'load'"):
        replace(problem, parameters=[Parameter.delay(["felt", "load"], bounds=(-0.01, 0.05))])
    for none in ([], 5, ["felt", 5]):
        with pytest.raises(TypeError, match="channel must be a name, or several"):
            Parameter.delay(none, bounds=(-0.01, 0.05))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([], "stiffness"), "pairs names nothing"),
        (([("a", "left"), ("left", "a")], "stiffness"), "pairs has 'left' and 'a' twice"),
        (([("a", "left", "b")], "stiffness"), "a pair is two geoms"),
        ((["left", "right"], "stiffness"), "a pair is two geoms"),
        (([("a", 1.5)], "stiffness"), "a pair is two geoms"),
        (([("a", "left")], "stiff"), "unknown material quantity 'stiff'"),
        (([("a", "left")], "a", "stiffness"), "geom1 must be the name or id of a geom"),
        (("a", "left"), "quantity must be a string"),
        ((None, "stiffness"), "pairs must be two geoms"),
    ],
)
def test_pairs_that_are_none_are_refused(arguments, message):
    with pytest.raises((ValueError, TypeError), match=message):
        Parameter.pair(*arguments)


def test_a_pair_that_loses_its_geoms_materials_is_named_among_several():
    engine = two_balls()
    engine.set_materials({"right": dashpot.Material(2e4), "a": dashpot.Material(3e4)})
    unknown = Parameter.pair([("a", "left"), ("a", "right")], "restitution")
    with pytest.raises(ValueError, match="'right' and 'a' a material of the pair, without the sti"):
        Problem(engine, [unknown], [drop("a", 0.0, 0.5, 0.6)], event_sigma={"impact": 1e-3})


def test_two_parameters_of_one_pair_are_refused():
    unknown = [
        Parameter.pair([("a", "left"), ("b", "left")], "restitution", name="both"),
        Parameter.pair("left", "b", "damping", name="one"),
    ]
    with pytest.raises(ValueError, match="'both' and 'one' both set the damping of the pair"):
        Problem(two_balls(), unknown, [drop("a", 0.0, 0.5, 0.6)], event_sigma={"impact": 1e-3})


def slowing(*, noise=0.0, seed=0, spring=0.0):
    """Return an encoder of a cart that a damper slows down, and perhaps a spring."""
    time = 0.02 * np.arange(51)
    rate = DAMPING / MASS
    readings = SPEED / rate * (1.0 - np.exp(-rate * time))
    if spring:
        root = math.sqrt(spring / MASS - 0.25 * rate**2)
        readings = SPEED / root * np.exp(-0.5 * rate * time) * np.sin(root * time)
    readings = readings + noise * np.random.default_rng(seed).normal(size=time.size)
    return Trajectory.of_sensors(
        "run", time, {"encoder": readings}, initial_qpos=[0.0], initial_qvel=[SPEED]
    )


def cart(trajectory, *, mass_frozen=True, spring_frozen=False):
    unknown = [
        Parameter.model("body_mass", "cart", start=MASS, bounds=(0.5, 8.0), frozen=mass_frozen),
        Parameter.model("dof_damping", "rail", start=1.0, bounds=(0.1, 10.0)),
        Parameter.model(
            "jnt_stiffness",
            "rail",
            start=0.5 * (not spring_frozen),
            bounds=(-1.0, 20.0),
            transform="linear",
            frozen=spring_frozen,
        ),
    ]
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(CART))
    return Problem(engine, unknown, [trajectory], sensor_sigma={"encoder": 1e-3}, substeps=10)


def test_what_is_frozen_is_set_but_not_fitted(tmp_path):
    """The motion knows damping over mass alone: with the mass held it knows the damping."""
    problem = cart(slowing(noise=1e-3))
    assert [p.name for p in problem.unknowns] == ["dof_damping", "jnt_stiffness"]
    result = fit(problem, starts=0)
    assert list(result) == ["dof_damping", "jnt_stiffness"]
    damping = result["dof_damping"]
    assert damping.identified
    assert abs(damping.value - DAMPING) < 4.0 * damping.standard_error
    assert result.values["body_mass"] == MASS
    assert problem.build(result.values).model.body_mass[1] == MASS
    assert "held" in str(result)
    assert "body_mass" in str(result)
    assert result.to_dict()["held"] == {"body_mass": MASS}
    assert result.sample(2, seed=0)[0]["body_mass"] == MASS
    loaded = Fit.load(result.save(tmp_path / "cart.json"))
    assert str(loaded) == str(result)
    assert loaded.values == result.values
    other = cart(slowing(), mass_frozen=False)
    with pytest.raises(ValueError, match="the problem's unknowns"):
        Fit.load(tmp_path / "cart.json", problem=other)
    again = Fit.load(tmp_path / "cart.json", problem=problem)
    assert again.predict()[0].sensor_errors["encoder"].std() < 2e-3
    predict(problem, {name: result.values[name] for name in result})


def test_both_free_are_not_told_apart():
    result = fit(
        cart(slowing(noise=1e-3), mass_frozen=False).freeze({"jnt_stiffness": 0.0}), starts=0
    )
    assert not result["body_mass"].identified
    assert not result["dof_damping"].identified


@pytest.mark.parametrize(("spring", "needed"), [(0.0, False), (4.0, True)])
def test_nested_models_are_compared_by_their_costs(spring, needed):
    """Twice a gain of the cost by one parameter too many is that of Student's t, squared."""
    problem = cart(slowing(noise=1e-3, seed=1, spring=spring))
    held = problem.freeze({"jnt_stiffness": 0.0})
    assert held.held == {"body_mass": MASS, "jnt_stiffness": 0.0}
    assert problem.held == {"body_mass": MASS}
    full, nested = fit(problem, starts=0), fit(held, starts=0)
    found = full.against(nested)
    assert found.names == ("jnt_stiffness",)
    assert found.degrees_of_freedom == (1, 49)
    assert found.gain == pytest.approx(nested.cost - full.cost)
    assert (found.p_value < 1e-12) == needed
    assert needed or found.p_value > 0.01
    assert str(found).startswith("data need" if needed else "data do not need")
    if not needed:
        spring_at = full["jnt_stiffness"]
        t = spring_at.value / spring_at.standard_error
        assert found.statistic == pytest.approx(t**2, rel=0.1)
        assert found.p_value == pytest.approx(2.0 * stats.t.sf(abs(t), 49), rel=0.1)
    with pytest.raises(ValueError, match="the other fit is not nested in this one: it fits dof"):
        nested.against(full)
    with pytest.raises(ValueError, match="noise differs"):
        full.against(fit(replace(held, sensor_sigma={"encoder": 2e-3}), starts=0))


def test_a_profile_runs_over_held_values():
    """Along the spring the cost is a parabola whose width is the standard error."""
    problem = cart(slowing(noise=1e-3))
    best = fit(problem, starts=0)
    spring = best["jnt_stiffness"]
    for side in (-1.0, 1.0):
        held = spring.value + side * spring.standard_error
        rise = fit(problem.freeze({"jnt_stiffness": held}), starts=0).cost - best.cost
        assert 2.0 * rise / best.residual_variance == pytest.approx(1.0, rel=0.1)


def test_fits_with_other_values_held_may_share_a_checkpoint(tmp_path):
    """What one value gives is not taken for what another does."""
    options = {"starts": 0, "checkpoint": tmp_path / "profile.npz", "max_evaluations": 60}
    problem = cart(slowing(noise=1e-3)).freeze({"jnt_stiffness": 0.0})
    alone = [
        fit(problem.freeze({"body_mass": m}), starts=0, max_evaluations=60) for m in (2.0, 4.0)
    ]
    for mass, expected in zip((2.0, 4.0), alone, strict=True):
        assert fit(problem.freeze({"body_mass": mass}), **options).values == expected.values


def test_released_parameters_are_fitted_from_where_they_were_held():
    problem = cart(slowing(), spring_frozen=True)
    released = problem.release("jnt_stiffness")
    assert [p.start for p in released.unknowns] == [1.0, 0.0]
    with pytest.raises(ValueError, match="'body_mass': start must lie between the bounds"):
        problem.freeze({"body_mass": 0.1}).release(["body_mass"])
    assert problem.freeze(["dof_damping"]).held == {
        "body_mass": MASS,
        "dof_damping": 1.0,
        "jnt_stiffness": 0.0,
    }


def test_values_of_what_is_frozen_may_be_given():
    problem = cart(slowing())
    values = {"dof_damping": 2.0, "jnt_stiffness": 0.0}
    assert problem.build(values).model.body_mass[1] == MASS
    assert problem.build({**values, "body_mass": 4.0}).model.body_mass[1] == 4.0
    with pytest.raises(ValueError, match="values must be given for exactly body_mass, dof_damping"):
        problem.build({"dof_damping": 2.0})


def test_nothing_but_frozen_parameters_leaves_a_cost():
    """Of exact readings none, of a wrong mass one."""
    held = {"dof_damping": DAMPING, "jnt_stiffness": 0.0}
    right = fit(cart(slowing()).freeze(held))
    assert right.estimates == ()
    assert right.values == {"body_mass": MASS, **held}
    wrong = fit(cart(slowing(noise=1e-3)).freeze({**held, "body_mass": 3.0}))
    assert wrong.cost > 100.0 * right.cost
    assert "held" in str(wrong)


def test_names_that_are_none_are_refused():
    problem = cart(slowing())
    with pytest.raises(ValueError, match="no parameter is named 'mass'; there are body_mass"):
        problem.freeze(["mass"])
    with pytest.raises(TypeError, match="parameter 'body_mass' must be a number"):
        problem.freeze({"body_mass": "2"})
    with pytest.raises(TypeError, match="parameter 'body_mass': frozen must be"):
        Parameter.model("body_mass", "cart", start=MASS, bounds=(0.5, 8.0), frozen="yes")
