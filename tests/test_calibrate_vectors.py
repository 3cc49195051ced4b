"""Parameters of several numbers: tilted gravity, sensors with an offset per axis, friction."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.calibrate import Fit, Parameter, Problem, Trajectory, fit

BALL = """
<mujoco>
  <option timestep="0.005" gravity="0 0 -9.81"/>
  <worldbody>
    <body name="ball" pos="0 0 1"><freejoint/><geom name="ball" size="0.05" mass="1"/></body>
  </worldbody>
</mujoco>
"""
CART = """
<mujoco>
  <option timestep="0.002" gravity="0 0 0"/>
  <worldbody>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0"/>
      <geom name="cart" type="box" size=".1 .1 .1" mass="2"/>
      <site name="mark"/>
    </body>
  </worldbody>
  <actuator><motor joint="rail"/></actuator>
  <sensor><accelerometer name="felt" site="mark"/></sensor>
</mujoco>
"""
TABLE = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 0.1"/>
    <body name="body" pos="0 0 0.2"><freejoint/><geom name="ball" size="0.1" mass="1"/></body>
  </worldbody>
</mujoco>
"""
TILTED = np.array([0.7, -0.3, -9.7])


def pull(system, gravity):
    """Set gravity as a whole."""
    assert np.shape(gravity) == (3,)
    system.model.opt.gravity[:] = gravity


def gravity(**fields):
    return Parameter(
        "gravity",
        start=(0.0, 0.0, -9.0),
        bounds=((-2.0, 2.0), (-2.0, 2.0), (-12.0, -5.0)),
        transform="linear",
        apply=pull,
        **fields,
    )


def flight(acceleration, *, name="flight", noise=0.0, seed=0):
    """Return the free flight of a ball from (0, 0, 1) with 1 m/s along x."""
    time = 0.01 * np.arange(40)
    position = np.array([0.0, 0.0, 1.0]) + np.outer(time, [1.0, 0.0, 0.0])
    position = position + 0.5 * np.outer(time**2, acceleration)
    position += noise * np.random.default_rng(seed).normal(size=position.shape)
    return Trajectory(
        name,
        time,
        position,
        np.tile([1.0, 0, 0, 0], (40, 1)),
        bodies=("ball",),
        initial_qpos=[0, 0, 1, 1, 0, 0, 0],
        initial_qvel=[1, 0, 0, 0, 0, 0],
    )


def thrown(parameters, trajectories):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL))
    return Problem(engine, parameters, trajectories, position_sigma=1e-3)


def test_a_function_sets_all_numbers_of_a_vector_together():
    result = fit(thrown([gravity()], [flight(TILTED)]), starts=0)
    assert [e.name for e in result.estimates] == ["gravity[0]", "gravity[1]", "gravity[2]"]
    np.testing.assert_allclose(result.vector("gravity"), TILTED, atol=1e-4)
    with pytest.raises(KeyError, match="no vector named 'pull'; there are gravity"):
        result.vector("pull")


def test_each_number_has_an_interval_and_a_statement():
    result = fit(thrown([gravity()], [flight(TILTED, noise=1e-3, seed=3)]), starts=0)
    for estimate, true in zip(result.estimates, TILTED, strict=True):
        assert estimate.identified, estimate.statement
        assert abs(estimate.value - true) < 4.0 * estimate.standard_error
        # Of a parabola t^2 / 2 and noise of 1 mm.
        expected = 1e-3 / np.sqrt(np.sum((0.5 * (0.01 * np.arange(40)) ** 2) ** 2))
        assert estimate.standard_error == pytest.approx(expected, rel=0.2)


def test_each_trajectory_may_have_a_vector_of_its_own():
    other = np.array([-0.5, 0.2, -9.9])
    flights = [flight(TILTED, name="a"), flight(other, name="b")]
    problem = thrown([gravity(per="trajectory")], flights)
    assert problem.names[:4] == ("gravity[a][0]", "gravity[a][1]", "gravity[a][2]", "gravity[b][0]")
    result = fit(problem, starts=0)
    np.testing.assert_allclose(result.vector("gravity[a]"), TILTED, atol=1e-4)
    np.testing.assert_allclose(result.vector("gravity[b]"), other, atol=1e-4)


def test_functions_that_build_the_system_get_arrays():
    def build(values):
        model = mujoco.MjModel.from_xml_string(BALL)
        model.opt.gravity[:] = values["gravity"]
        return dashpot.Engine(model)

    def starts(values):
        assert np.shape(values["gravity"]) == (3,)
        assert values["gravity[2]"] < 0.0
        return np.array([[0, 0, 1, 1, 0, 0, 0]]), np.array([[1.0, 0, 0, 0, 0, 0]])

    unknown = Parameter("gravity", (0.0, 0.0, -9.0), (-12.0, 2.0), "linear")
    problem = Problem(build, [unknown], [flight(TILTED)], 1e-3, start_states=starts)
    np.testing.assert_allclose(fit(problem, starts=0).vector("gravity"), TILTED, atol=1e-4)


def felt(offset, gain):
    """Return what an accelerometer on a cart feels that is pushed by a ramp of 50 N/s."""
    time = 0.002 * np.arange(201)
    control = 50.0 * (time[:-1] + 0.001)
    true = np.zeros((201, 3))
    true[1:, 0] = control / 2.0
    readings = np.asarray(gain) * true + np.asarray(offset)
    return Trajectory.of_sensors(
        "push",
        time,
        {"felt": readings},
        initial_qpos=[0.0],
        initial_qvel=[0.0],
        control=control[:, None],
    )


def test_a_sensor_has_an_offset_and_a_gain_per_axis():
    unknown = [
        Parameter.offset("felt", start=(0.0, 0.0, 0.0), bounds=(-2.0, 2.0)),
        Parameter.gain(
            "felt", bounds=((0.5, 2.0), (0.5, 2.0), (0.5, 2.0)), frozen=(False, True, True)
        ),
    ]
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(CART))
    trajectory = felt([0.3, -0.2, 0.5], [1.2, 1.0, 1.0])
    result = fit(Problem(engine, unknown, [trajectory], sensor_sigma={"felt": 0.01}), starts=0)
    np.testing.assert_allclose(result.vector("offset of felt"), [0.3, -0.2, 0.5], atol=1e-6)
    np.testing.assert_allclose(result.vector("gain of felt"), [1.2, 1.0, 1.0], atol=1e-6)
    assert result.problem.held == {"gain of felt[1]": 1.0, "gain of felt[2]": 1.0}


def test_the_three_coefficients_of_friction_are_a_vector():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(TABLE))
    still = Trajectory(
        "still",
        [0, 0.1, 0.2],
        np.tile([0, 0, 0.1], (3, 1)),
        np.tile([1.0, 0, 0, 0], (3, 1)),
        bodies=("body",),
        initial_qvel=np.zeros(6),
    )
    for parameter in (
        Parameter.pair("ball", "floor", "friction", start=(0.4, 4e-3, 2e-4)),
        Parameter.material(["ball", "floor"], "friction", start=(0.4, 4e-3, 2e-4)),
        Parameter.model(
            "geom_friction", ["ball", "floor"], start=(0.4, 4e-3, 2e-4), bounds=(1e-6, 1)
        ),
    ):
        shown = [parameter]
        if parameter.name == "friction":
            kind = Parameter.pair("ball", "floor", "stiffness")
            if parameter.apply.__class__.__name__ == "MaterialSetter":
                kind = Parameter.material(["ball", "floor"], "stiffness")
            shown.append(kind)
        problem = Problem(engine, shown, [still], 1e-3)
        built = problem.build(problem.start)
        sliding, _, torsional, rolling, _ = built.contact_material("ball", "floor").friction
        assert (sliding, torsional, rolling) == pytest.approx((0.4, 4e-3, 2e-4))


def test_a_vector_of_columns_is_written_and_comes_back(tmp_path):
    """The centre of a ball moves about that of its body, which spins."""
    xml = TABLE.replace("<freejoint/>", '<freejoint/><site name="mark" pos="0.02 0 0"/>').replace(
        "</mujoco>",
        '<sensor><framepos name="seen" objtype="site" objname="mark"/></sensor></mujoco>',
    )
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    engine.model.opt.gravity[:] = 0.0
    angle = 5.0 * 0.01 * np.arange(40)
    true = np.array([0.03, -0.02, 0.01])
    seen = np.array([0, 0, 0.2]) + np.stack(
        [
            true[0] * np.cos(angle) - true[1] * np.sin(angle),
            true[0] * np.sin(angle) + true[1] * np.cos(angle),
            np.full(40, true[2]),
        ],
        axis=1,
    )
    trajectory = Trajectory.of_sensors(
        "spin",
        0.01 * np.arange(40),
        {"seen": seen},
        initial_qpos=[0, 0, 0.2, 1, 0, 0, 0],
        initial_qvel=[0, 0, 0, 0, 0, 5.0],
    )
    unknown = Parameter.model(
        "site_pos",
        "mark",
        start=(0.02, 0.0, 0.0),
        bounds=(-0.1, 0.1),
        transform="linear",
        name="mark",
    )
    function = Parameter(
        "size", (0.1, 0.1), (0.05, 0.2), frozen=True, apply=lambda system, sizes: None
    )
    result = fit(
        Problem(engine, [unknown, function], [trajectory], sensor_sigma={"seen": 1e-4}), starts=0
    )
    np.testing.assert_allclose(result.vector("mark"), true, atol=1e-6)
    loaded = Fit.load(result.save(tmp_path / "mark.json"))
    assert loaded.estimates == result.estimates
    assert loaded.values == result.values
    np.testing.assert_array_equal(loaded.vector("mark"), result.vector("mark"))
    assert loaded.sample(3, seed=2) == result.sample(3, seed=2)
    assert str(loaded) == str(result)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: gravity(frozen=(True, False)), "'gravity': frozen has 2 entries, and start 3"),
        (lambda: Parameter("g", (1.0, 9.0), (0.5, 2.0)), r"'g\[1\]': start must lie between"),
        (
            lambda: Parameter("g", (1.0, 1.0), ((0.5, 2.0),)),
            "'g': start has 2 numbers, and there are 1",
        ),
        (
            lambda: Parameter("g", (1.0, 1.0), ((0.5, 2.0), (-1.0, 2.0))),
            r"'g\[1\]': the log transform",
        ),
        (lambda: Parameter("g", (), (0.5, 2.0)), "'g': start has no number"),
        (lambda: Parameter("g", ((1.0,),), (0.5, 2.0)), "numbers in a row"),
        (lambda: Parameter("g", (1.0, "x"), (0.5, 2.0)), "'g': start"),
        (
            lambda: Parameter.pair("a", "b", "stiffness", start=(1e3, 1e4)),
            "stiffness of a material is one",
        ),
        (lambda: Parameter.pair("a", "b", "friction", start=(1.0, 0.1)), "friction is 3 numbers"),
        (lambda: Parameter.delay("felt", start=(0.0, 0.0), bounds=(-1, 1)), "delay is one number"),
        (
            lambda: Parameter.model(
                "body_ipos",
                "a",
                index=(0, 1),
                start=(0.1, 0.1, 0.1),
                bounds=(0, 1),
                transform="linear",
            ),
            "'body_ipos': index names 2 columns, and start 3",
        ),
        (
            lambda: Parameter.model(
                "geom_friction",
                "a",
                start=(0.5, 0.1, 0.2),
                bounds=((0.1, 1), (-0.1, 1), (0.1, 1)),
                transform="linear",
            ),
            r"'geom_friction\[1\]': geom_friction of 'a' must be >= 0",
        ),
    ],
)
def test_errors_name_the_number(make, message):
    with pytest.raises((ValueError, TypeError), match=message):
        make()


def refuse(system, values):
    raise ValueError("no")


@pytest.mark.parametrize(
    ("parameter", "message"),
    [
        (
            Parameter.offset("felt", start=(0.0, 0.0), bounds=(-1, 1)),
            "there are 2 numbers, and 'felt' has 3",
        ),
        (
            Parameter.model("body_inertia", "cart", start=(0.1, 0.1), bounds=(0.01, 1)),
            "rows of body_inertia have 3 columns, and there are 2 numbers",
        ),
        (
            Parameter("pull", (1.0, 2.0), (0.5, 3.0), apply=refuse),
            "parameter 'pull' = 1, 2: no",
        ),
    ],
)
def test_vectors_have_the_size_of_what_they_set(parameter, message):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(CART))
    with pytest.raises(ValueError, match=message):
        Problem(engine, [parameter], [felt(0.0, 1.0)], sensor_sigma={"felt": 0.01})


def test_an_offset_of_all_axes_and_one_per_axis_do_not_go_together():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(CART))
    unknown = [
        Parameter.offset("felt", bounds=(-1, 1), name="all"),
        Parameter.offset("felt", start=(0.0, 0.0, 0.0), bounds=(-1, 1), name="each"),
    ]
    with pytest.raises(ValueError, match=r"'all' and 'each\[0\]' both set the offset of felt"):
        Problem(engine, unknown, [felt(0.0, 1.0)], sensor_sigma={"felt": 0.01})
