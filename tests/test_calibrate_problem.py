"""Calibration: trajectories, parameters, problems and what they refuse."""

import math
import pickle
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest

import dashpot
from ball_throws import BALL, IDENTITY, ball_engine, ball_parameters, make_trajectory
from dashpot.calibrate import Parameter, Problem, fit
from dashpot.calibrate.problem.data_warnings import strange_falls
from dashpot.calibrate.problem.transforms import Transform


def test_a_window_is_a_number():
    for window in ("a", None, True):
        with pytest.raises(TypeError, match=r"^trajectory 'throw 7': a window must be a number"):
            make_trajectory().head(window)


@pytest.mark.parametrize("joint", ["free", "ball"])
@pytest.mark.parametrize(("scale", "said"), [(0.0, "0"), (5.0, "5"), (1.001, "1.001")])
def test_quaternions_of_initial_positions_are_unit(joint, scale, said):
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body name="body"><joint type="{joint}"/><geom size=".1"/></body>'
        "</worldbody></mujoco>"
    )
    first = 3 if joint == "free" else 0
    qpos = [*([0.0] * first), scale, 0.0, 0.0, 0.0]
    unknown = Parameter.model("body_mass", "body", start=2.0, bounds=(1, 9))
    problem = partial(Problem, model, [unknown], position_sigma=1e-3, rotation_sigma=1e-2)
    velocity = np.zeros(model.nv)
    where = rf"initial_qpos\[{first}:{first + 4}\], the quaternion of body 'body', has norm {said};"
    with pytest.raises(ValueError, match=f"^trajectory 'throw 7': {where}"):
        problem([make_trajectory(initial_qpos=qpos, initial_qvel=velocity)])
    qpos[first] = 1.00001
    problem([make_trajectory(initial_qpos=qpos, initial_qvel=velocity)])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": [0.0, 0.01, 0.01, 0.02, 0.03]}, r"time\[2\]"),
        ({"time": [0.0, 0.01, 0.03, 0.02, 0.04]}, r"time\[3\] .* follows time\[2\]"),
        ({"time": [0.0, 0.01, 0.02, 0.045, 0.055]}, r"gap of 0.025 s before time\[3\]"),
        ({"time": [0.0, 0.01, 0.02, 0.025, 0.035]}, r"short interval of 0.005 s before time\[3\]"),
        ({"time": [0.0, 0.01, math.nan, 0.03, 0.04]}, r"time\[2\] is nan"),
        ({"time": [0.0]}, "n >= 2"),
        ({"position": np.zeros((4, 3))}, r"position must be \(5, 1, 3\)"),
        ({"quaternion": np.tile(IDENTITY, (5, 2, 1))}, r"quaternion must be \(5, 1, 4\)"),
        ({"quaternion": np.full((5, 4), 0.4)}, "quaternion of frame 0, body 'body' has norm 0.8"),
        ({"bodies": ("body", "body")}, "bodies"),
        ({"initial_qvel": [0.0, math.inf]}, r"initial_qvel\[1\] is inf"),
        ({"initial_qpos": np.zeros((2, 2))}, "initial_qpos must be 1-D"),
        ({"control": np.zeros((5, 1))}, "4 frame intervals, got 5"),
    ],
)
def test_bad_trajectory_is_named(changes, message):
    with pytest.raises(ValueError, match=rf"trajectory 'throw 7'.*{message}"):
        make_trajectory(**changes)


def test_bodies_are_named():
    with pytest.raises(TypeError, match="trajectory 'throw 7': bodies must be names"):
        make_trajectory(bodies=(1,))


@pytest.mark.parametrize("bodies", [None, 5])
def test_bodies_of_another_type_are_refused(bodies):
    with pytest.raises(TypeError, match=f"'throw 7': bodies must be a name or .*, got {bodies}"):
        make_trajectory(bodies=bodies)


def clocked(time):
    return make_trajectory(
        time=time,
        position=np.zeros((len(time), 3)),
        quaternion=np.tile(IDENTITY, (len(time), 1)),
    )


@pytest.mark.parametrize("rate", [30, 60, 120, 240])
@pytest.mark.parametrize("phase", [0.0, 3e-4, 1.7e9])
def test_times_rounded_to_milliseconds_are_even(rate, phase):
    """And their spacing is that of the clock, to what rounding leaves of a line through them."""
    frames = 200
    spacing = clocked(np.round(phase + np.arange(frames) / rate, 3)).spacing
    rounding = 1e-3 / math.sqrt(12)
    assert spacing == pytest.approx(1 / rate, abs=4 * rounding * math.sqrt(12 / frames**3))


def test_a_clock_that_drifts_is_refused():
    """Each interval is within 1.4 % of 10 ms, yet frame 100 is 6.7 ms off the mean spacing."""
    k = np.arange(201)
    drifting = 0.01 * k + 6.7e-3 * (1.0 - ((k - 100) / 100) ** 2)
    with pytest.raises(ValueError, match=r"'throw 7': the clock drifts: .* even grid of 0.01 s"):
        clocked(drifting)


def test_infinity_in_a_pose_is_located():
    position = np.zeros((5, 3))
    position[3, 1] = math.inf
    with pytest.raises(ValueError, match=r"trajectory 'throw 7': position\[3, 1\] is inf"):
        make_trajectory(position=position)


def test_trajectory_keeps_its_own_data():
    position = np.zeros((5, 3))
    trajectory = make_trajectory(position=position)
    position[0, 0] = 1.0
    assert trajectory.position[0, 0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        trajectory.position[0, 0, 0] = 2.0


def test_head_keeps_the_frames_of_a_window():
    assert make_trajectory(control=np.zeros((4, 1))).head(0.02).frames == 3
    assert make_trajectory().head(1e-6).frames == 2
    assert make_trajectory().head(1.0).frames == 5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"start": 0.5}, "start must lie between"),
        ({"start": math.nan}, "start must lie between"),
        ({"bounds": (2.0, 1.0)}, "bounds must be finite and ascend"),
        ({"bounds": (0.0, 10.0)}, "the log transform needs bounds > 0"),
        ({"bounds": (1.0, math.inf)}, "bounds must be finite"),
        ({"bounds": (1.0, 2.0, 3.0)}, r"bounds must be \(lower, upper\)"),
        ({"bounds": None}, r"bounds must be \(lower, upper\), got None"),
        ({"transform": "sqrt"}, "transform must be one of"),
        ({"difference": 0.0}, "difference"),
    ],
)
def test_bad_parameter_is_named(changes, message):
    with pytest.raises(ValueError, match=f"parameter 'mass': {message}"):
        Parameter(**{"name": "mass", "start": 2.0, "bounds": (1.0, 10.0), **changes})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"start": "x"}, "parameter 'mass': start must be a number, got 'x'"),
        ({"start": None}, "parameter 'mass': start must be a number, got None"),
        ({"bounds": ("a", "b")}, "parameter 'mass': bounds must be an array of numbers"),
        ({"difference": "x"}, "parameter 'mass': difference must be a number, got 'x'"),
        ({"apply": 3}, "parameter 'mass': apply must be a function, got 3"),
        ({"name": 3}, "a parameter's name must be a string, got 3"),
        ({"changes_model": 1.0}, "parameter 'mass': changes_model must be True or False, got 1.0"),
    ],
)
def test_parameter_of_the_wrong_type_is_named(changes, message):
    with pytest.raises(TypeError, match=message):
        Parameter(**{"name": "mass", "start": 2.0, "bounds": (1.0, 10.0), **changes})


def test_what_a_parameter_sets_is_checked_when_it_is_made():
    at = {"start": 0.5, "bounds": (0.1, 0.9)}
    for geoms in (1.5, True, None, [1.5], ["ball", None]):
        with pytest.raises(TypeError, match=r"^geoms must be names or ids, one or a sequence"):
            Parameter.material(geoms, "stiffness", **at)
    with pytest.raises(ValueError, match=r"^geoms names nothing"):
        Parameter.material([], "stiffness", **at)
    with pytest.raises(TypeError, match=r"^geom2 must be the name or id of a geom, got 0.5"):
        Parameter.pair("ball", 0.5, "stiffness", **at)
    with pytest.raises(TypeError, match=r"^a parameter's name must be a string, got 0"):
        Parameter.material("ball", "stiffness", name=0, **at)
    with pytest.raises(TypeError, match=r"^a parameter's name must be a string, got 0"):
        Parameter.pair("ball", "floor", "stiffness", name=0, **at)
    with pytest.raises(TypeError, match=r"^a parameter's name must be a string, got 0"):
        Parameter.model("body_mass", "body", name=0, **at)
    with pytest.raises(ValueError, match=r"transform must be one of .*, got 0"):
        Parameter.pair("ball", "floor", "stiffness", transform=0, **at)
    with pytest.raises(TypeError, match=r"^quantity must be a string, got 5"):
        Parameter.material("ball", 5, **at)
    with pytest.raises(TypeError, match=r"^attribute must be a string, got 5"):
        Parameter.model(5, "body", **at)
    with pytest.raises(TypeError, match=r"^elements must be names or ids, one or a sequence"):
        Parameter.model("body_mass", 0.5, **at)
    with pytest.raises(ValueError, match="index names no column"):
        Parameter.model("geom_friction", "ball", index=np.array([], int), **at)
    for attribute in ("geom_friction", "geom_solref", "pair_solreffriction", "dof_solimp"):
        with pytest.raises(ValueError, match=f"columns of {attribute} differ in what they mean"):
            Parameter.model(attribute, "ball", **at)
    for index in ("a", 0.0, [], True):
        with pytest.raises(TypeError, match=r"^index must be an integer or a sequence of integers"):
            Parameter.model("geom_friction", "ball", index=index, **at)
    for make in (Parameter.material, Parameter.pair):
        geoms = ("ball", "floor")[: 1 + (make == Parameter.pair)]
        with pytest.raises(ValueError, match=r"^parameter 'restitution': bounds .* in \[0, 1\]"):
            make(*geoms, "restitution", start=0.5, bounds=(0.1, 1.5))
        make(*geoms, "restitution", start=0.5, bounds=(0.0, 1.0))


def test_unknown_names_list_near_matches():
    with pytest.raises(ValueError, match=r"unknown material quantity 'stifness'.*near: stiffness"):
        Parameter.material("ball", "stifness", start=1.0, bounds=(0.1, 2.0))
    for parameter, near in (
        (Parameter.material("bal", "stiffness", start=1e4, bounds=(1e2, 1e6)), "mean 'ball'"),
        (Parameter.model("body_mass", "bodi", start=1.0, bounds=(0.1, 2.0)), "mean 'body'"),
        (Parameter.model("body_masss", "body", start=1.0, bounds=(0.1, 2.0)), "near: body_mass"),
    ):
        with pytest.raises(ValueError, match=rf"parameter '{parameter.name}' = .*{near}"):
            Problem(ball_engine(), [parameter], [make_trajectory()], 1e-3, 1e-2)


def make_problem(**changes):
    """Return a valid problem with some fields replaced."""
    fields = {
        "system": ball_engine(),
        "parameters": ball_parameters(),
        "trajectories": [make_trajectory()],
        "position_sigma": 1e-3,
        "rotation_sigma": 1e-2,
    }
    return Problem(**{**fields, **changes})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"trajectories": [make_trajectory(bodies=("bod",))]},
            "trajectory 'throw 7': .* no body 'bod'",
        ),
        (
            {"trajectories": [make_trajectory(), make_trajectory()]},
            "two trajectory entries are named 'throw 7'",
        ),
        ({"trajectories": []}, "at least one trajectory"),
        ({"parameters": []}, "at least one parameter"),
        ({"parameters": ball_parameters()[:1] * 2}, "two parameter entries .* 'stiffness'"),
        (
            {
                "parameters": [
                    Parameter.material("ball", "restitution", start=0.5, bounds=(0.1, 0.9)),
                    Parameter.material("ball", "damping", start=10.0, bounds=(1.0, 99.0)),
                ]
            },
            "'restitution' and 'damping' both set the damping of geom 'ball'",
        ),
        (
            {
                "parameters": [
                    Parameter.pair(
                        "ball", "floor", "stiffness", start=5.0, bounds=(1, 9), name="k"
                    ),
                    Parameter.pair(0, "ball", "stiffness", start=5.0, bounds=(1, 9), name="l"),
                ]
            },
            "'k' and 'l' both set the stiffness of the pair 'ball', 'floor'",
        ),
        (
            {
                "parameters": [
                    Parameter.model("body_mass", "body", start=2.0, bounds=(1, 9), name="m"),
                    Parameter.model("body_mass", 1, start=2.0, bounds=(1, 9), name="n"),
                ]
            },
            "'m' and 'n' both set the body_mass of 'body'",
        ),
        ({"trajectories": [make_trajectory(initial_qvel=None)]}, "'throw 7' has no initial_qvel"),
        (
            {"trajectories": [make_trajectory(initial_qvel=np.zeros(5))]},
            r"initial_qvel must be \(6,\)",
        ),
        (
            {"trajectories": [make_trajectory(initial_qpos=np.zeros(6))]},
            r"initial_qpos must be \(7,\)",
        ),
        (
            {"trajectories": [make_trajectory(control=np.zeros((4, 1)))]},
            "control must have 0 columns",
        ),
        ({"position_sigma": 0.0}, "position_sigma"),
        ({"rotation_sigma": math.nan}, "rotation_sigma"),
        ({"substeps": 0}, "substeps"),
        ({"window": -1.0}, "window"),
        ({"initial_state": "guess"}, "initial_state"),
    ],
)
def test_bad_problem_names_its_culprit(changes, message):
    with pytest.raises(ValueError, match=message):
        make_problem(**changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"parameters": ball_parameters()[0]}, "parameters must be a sequence of Parameter"),
        ({"parameters": ["stiffness"]}, r"parameters\[0\] is str; it must be a Parameter"),
        ({"trajectories": make_trajectory()}, "trajectories must be a sequence of Trajectory"),
        ({"trajectories": [make_trajectory(), 3]}, r"trajectories\[1\] is int"),
        ({"position_sigma": "a"}, "position_sigma must be a number, got 'a'"),
        ({"rotation_sigma": None}, "rotation_sigma must be a number, got None"),
        ({"substeps": True}, "substeps must be an integer, got True"),
        ({"window": "1"}, "window must be a number, got '1'"),
        ({"start_states": 3}, "start_states must be a function, got 3"),
    ],
)
def test_problem_of_the_wrong_types_names_its_culprit(changes, message):
    with pytest.raises(TypeError, match=message):
        make_problem(**changes)


def test_a_parameter_that_reaches_nothing_is_refused():
    """Its value went nowhere, and a fit found that the motion did not depend on it."""
    free = Parameter("k", 1e3, (1.0, 1e5))
    model = mujoco.MjModel.from_xml_string(BALL)
    for system in (ball_engine(), model):
        with pytest.raises(ValueError, match=r"^parameter 'k' sets nothing: make it with"):
            make_problem(system=system, parameters=[free])
    make_problem(system=lambda values: ball_engine(values["k"]), parameters=[free])
    states = np.array([[0.0, 0, 1, *IDENTITY]]), np.zeros((1, 6))
    make_problem(parameters=[free], start_states=lambda values: states)


def test_a_standard_deviation_may_be_an_array_of_no_dimension():
    problem = make_problem(position_sigma=np.array(1e-3), rotation_sigma=np.array(1e-2))
    assert problem.sigma.tolist() == [1e-3] * 3 + [1e-2] * 3


def test_a_material_cannot_be_varied_in_a_mujoco_model():
    model = mujoco.MjModel.from_xml_string(BALL)
    with pytest.raises(TypeError, match=r"parameter 'stiffness' = .*dashpot\.Engine"):
        Problem(model, ball_parameters()[:1], [make_trajectory()], 1e-3, 1e-2)


def test_building_a_candidate_leaves_the_engine_alone():
    engine = ball_engine()
    problem = Problem(engine, ball_parameters(), [make_trajectory()], 1e-3, 1e-2)
    built = problem.build({"stiffness": 5e4, "damping": 7.0, "sliding_friction": 0.9})
    assert built.material("ball").stiffness == 5e4
    assert built.material("ball").damping == 7.0
    # Torsional and rolling friction stay as the MJCF has them.
    assert built.material("ball").friction == (0.9, 0.005, 0.0001)
    assert engine.material("ball") == dashpot.Material(1e4, damping=20.0, friction=0.3)
    with pytest.raises(ValueError, match="exactly stiffness, damping, sliding_friction"):
        problem.build({"stiffness": 5e4})


def test_a_pair_keeps_the_friction_that_it_has():
    xml = """<mujoco><worldbody><geom name="a" type="plane" size="1 1 1"/>
      <body name="body"><freejoint/><geom name="b" size=".1"/></body></worldbody>
      <contact><pair geom1="a" geom2="b" friction=".2 .2 .01 .001 .001"/></contact></mujoco>"""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    parameter = Parameter.pair("a", "b", "torsional_friction", start=0.02, bounds=(0.01, 0.1))
    built = Problem(engine, [parameter], [make_trajectory()], 1e-3, 1e-2).build(
        {"torsional_friction": 0.05}
    )
    assert built.contact_material("a", "b").friction == (0.2, 0.2, 0.05, 0.001, 0.001)


# Mixed half and half with MuJoCo's default, (0.02, 1), of the ball.
SOFT_FLOOR = BALL.replace('size="3 3 0.1"', 'size="3 3 0.1" solref="0.05 0.7"')


def friction_of(kind):
    options = {"start": 0.5, "bounds": (0.1, 1.0)}
    if kind == "pair":
        return Parameter.pair("ball", "floor", "sliding_friction", **options)
    return Parameter.material("ball", "sliding_friction", **options)


def test_friction_of_a_pair_does_not_replace_what_its_geoms_combine_to():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL))
    engine.set_material("ball", dashpot.Material(2e4, restitution=0.5))
    at = [make_trajectory()], 1e-3, 1e-2
    with pytest.raises(ValueError, match=r"'sliding_friction' .*'floor' and 'ball'.* stiffness of"):
        Problem(engine, [friction_of("pair")], *at)
    stiffness = Parameter.pair("ball", "floor", "stiffness", start=1e4, bounds=(1e2, 1e6))
    with pytest.raises(ValueError, match=r"'sliding_friction' .* without the damping"):
        Problem(engine, [friction_of("pair"), stiffness], *at)
    restitution = Parameter.pair("ball", "floor", "restitution", start=0.5, bounds=(0.1, 0.9))
    Problem(engine, [friction_of("pair"), stiffness, restitution], *at)
    engine.set_pair_material("ball", "floor", dashpot.Material(2e4, restitution=0.5))
    Problem(engine, [friction_of("pair")], *at)


@pytest.mark.parametrize("kind", ["pair", "material"])
def test_friction_does_not_make_soft_contacts_of_the_model_rigid(kind):
    at = [make_trajectory()], 1e-3, 1e-2
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(SOFT_FLOOR))
    with pytest.raises(ValueError, match=r"'sliding_friction' .*'ball'.*rigid, .* solref \(0.035"):
        Problem(engine, [friction_of(kind)], *at)
    stiffness = Parameter.material("ball", "stiffness", start=1e4, bounds=(1e2, 1e6))
    if kind == "material":
        Problem(engine, [friction_of(kind), stiffness], *at)
    # Rigid by default, or because it was asked for: nothing is lost.
    Problem(dashpot.Engine(mujoco.MjModel.from_xml_string(BALL)), [friction_of(kind)], *at)
    engine.set_material("ball", dashpot.Material())
    Problem(engine, [friction_of(kind)], *at)


def test_problems_pickle():
    parameter = Parameter.model("body_mass", "body", start=2.0, bounds=(1.0, 9.0))
    problem = pickle.loads(pickle.dumps(make_problem(parameters=[parameter])))
    assert problem.build({"body_mass": 3.0}).model.body_mass[1] == 3.0


def test_one_form_of_damping_replaces_another():
    parameter = Parameter.pair("ball", "floor", "restitution", start=0.5, bounds=(0.0, 1.0))
    engine = ball_engine()
    engine.set_pair_material("ball", "floor", dashpot.Material(1e4, damping=3.0))
    built = Problem(engine, [parameter], [make_trajectory()], 1e-3, 1e-2).build(
        {"restitution": 0.7}
    )
    material = built.pair_material("ball", "floor")
    assert (material.damping, material.damping_ratio, material.restitution) == (None, None, 0.7)
    assert material.stiffness == 1e4


def test_a_damping_is_estimated_beside_a_stiffness_in_any_order():
    def parameters(make, geoms):
        return [
            make(*geoms, "damping", start=10.0, bounds=(1.0, 99.0)),
            Parameter.model("body_mass", "body", start=2.0, bounds=(1, 9)),
            make(*geoms, "stiffness", start=1e4, bounds=(1e3, 1e5)),
        ]

    bare = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL))
    for make, geoms in ((Parameter.material, ["ball"]), (Parameter.pair, ["ball", "floor"])):
        damping, *others = parameters(make, geoms)
        values = {"damping": 7.0, "body_mass": 2.0, "stiffness": 5e4}
        built = make_problem(system=bare, parameters=[damping, *others]).build(values)
        found = built.contact_material("ball", "floor")
        assert (found.stiffness, found.damping) == (5e4, 7.0)
        with pytest.raises(ValueError, match=r"^parameter 'damping' = 10: .* needs a stiffness"):
            make_problem(system=bare, parameters=[damping])
        make_problem(parameters=[Parameter.material("ball", "damping", start=9.0, bounds=(1, 99))])


def test_model_properties_bring_derived_constants_along():
    parameters = [
        Parameter.model("body_mass", "body", start=2.0, bounds=(0.1, 10.0)),
        Parameter.model("geom_size", "ball", index=0, start=0.2, bounds=(0.01, 1.0)),
        Parameter.model(
            "body_ipos", "body", index=2, start=0.01, bounds=(-0.1, 0.1), transform="linear"
        ),
    ]
    compiled_simple = mujoco.MjModel.from_xml_string(BALL)
    with pytest.raises(ValueError, match=r"does not take the values of .*body_ipos.*simple"):
        Problem(compiled_simple, parameters, [make_trajectory()], 1e-3, 1e-2)
    model = mujoco.MjModel.from_xml_string(BALL.replace("<body ", '<body simple="false" '))
    built = Problem(model, parameters, [make_trajectory()], 1e-3, 1e-2).build(
        {"body_mass": 3.0, "geom_size": 0.25, "body_ipos": 0.02}
    )
    assert built.body_subtreemass[0] == 3.0
    assert built.geom_rbound[1] == 0.25
    assert built.body_ipos[1].tolist() == [0.0, 0.0, 0.02]
    assert model.body_mass[1] == 1.0


def test_geom_size_equals_a_compiled_model():
    """The extent that is set for a varied box is what the compiler derives."""
    xml = BALL.replace('size="0.1"', 'type="box" size="{}"')
    parameter = Parameter.model("geom_size", "ball", start=0.2, bounds=(0.01, 1.0))
    model = mujoco.MjModel.from_xml_string(xml.format("0.1 0.1 0.1"))
    built = Problem(model, [parameter], [make_trajectory()], 1e-3, 1e-2).build({"geom_size": 0.3})
    compiled = mujoco.MjModel.from_xml_string(xml.format("0.3 0.3 0.3"))
    np.testing.assert_allclose(built.geom_rbound, compiled.geom_rbound, rtol=1e-15)
    np.testing.assert_allclose(built.geom_aabb, compiled.geom_aabb, rtol=1e-15)


@pytest.mark.parametrize(
    "transform",
    [Transform("log", 0.1, 1e4), Transform("linear", -2.0, 3.0), Transform("logit", 0.0, 1.0)],
)
def test_transforms_invert_and_have_their_slope(transform):
    for share in (0.02, 0.3, 0.5, 0.98):
        x = transform.lower + share * (transform.upper - transform.lower)
        z = transform.to_search(x)
        assert transform.to_value(z) == pytest.approx(x, rel=1e-13)
        h = 1e-5  # central difference: error h^2 relative
        slope = (transform.to_value(z + h) - transform.to_value(z - h)) / (2 * h)
        assert transform.slope(z) == pytest.approx(slope, rel=1e-6)
    assert transform.to_value(1e3) == transform.upper
    assert transform.to_value(-1e3) == transform.lower


def test_damping_and_dry_friction_of_joints_and_tendons_are_set_by_name():
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
        <body name="a"><joint name="swing" type="ball"/><geom size=".1"/>
          <body name="b"><joint name="knee"/><geom size=".1"/></body></body></worldbody>
        <tendon><fixed name="cord"><joint joint="knee" coef="1"/></fixed></tendon></mujoco>""")
    at = {"start": 2.0, "bounds": (0.1, 10.0)}
    parameters = [
        Parameter.model("dof_damping", ["swing"], **at),
        Parameter.model("dof_frictionloss", "knee", **at),
        Parameter.model("tendon_damping", "cord", index=0, **at),
    ]
    trajectory = make_trajectory(bodies=("a",), initial_qpos=None, initial_qvel=np.zeros(4))
    problem = Problem(model, parameters, [trajectory], 1e-3, 1e-2)
    built = problem.build({"dof_damping": 3.0, "dof_frictionloss": 4.0, "tendon_damping": 5.0})
    assert built.dof_damping.tolist() == [3.0, 3.0, 3.0, 0.0]
    assert built.dof_frictionloss.tolist() == [0.0, 0.0, 0.0, 4.0]
    assert built.tendon_damping.tolist() == [5.0]
    with pytest.raises(ValueError, match="no joint named 'kne'; did you mean 'knee'"):
        Problem(model, [Parameter.model("dof_damping", "kne", **at)], [trajectory], 1e-3, 1e-2)


def fallen(spacing, sigma=2e-4, gravity=9.81, seed=0):
    """Return a problem of two throws: 40 frames in 0.4 s, with noise, said to last longer."""
    t = 0.01 * np.arange(40)
    rng = np.random.default_rng(seed)
    throws = []
    for name, velocity in (("up", [1.0, 0.0, 2.0]), ("down", [0.5, 1.0, -1.0])):
        path = np.array(velocity) * t[:, None] - 0.5 * np.array([0, 0, gravity]) * t[:, None] ** 2
        throws.append(
            make_trajectory(
                name=name,
                time=spacing / 0.01 * t,
                position=path + sigma * rng.normal(size=path.shape),
                quaternion=np.tile(IDENTITY, (40, 1)),
                initial_qpos=[0, 0, 0, *IDENTITY],
            )
        )
    return make_problem(trajectories=throws, position_sigma=sigma)


def test_times_in_milliseconds_are_told_by_gravity():
    for seed in range(20):
        assert list(strange_falls(fallen(10.0, seed=seed))) == ["up", "down"]
        assert strange_falls(fallen(0.01, seed=seed)) == {}


def test_slow_motion_is_no_fall_in_milliseconds():
    """Other accelerations are none of gravity's, nor any without it, nor one that noise hides."""
    for seed in range(20):
        for gravity in (-20.0, 0.0, 5.0, 20.0):
            assert strange_falls(fallen(10.0, gravity=gravity, seed=seed)) == {}
        assert strange_falls(fallen(10.0, sigma=4e-2, seed=seed)) == {}
    weightless = mujoco.MjModel.from_xml_string(BALL.replace("<option", '<option gravity="0 0 0"'))
    mass = Parameter.model("body_mass", "body", start=1.0, bounds=(0.1, 2.0))
    problem = replace(fallen(10.0), system=weightless, parameters=[mass])
    assert strange_falls(problem) == {}


def test_a_fit_refuses_times_in_milliseconds():
    problem = replace(fallen(10.0), substeps=1, window=30.0)
    with pytest.raises(ValueError, match=r"'up' and 1 more: .* milliseconds; times must be in s"):
        fit(problem, starts=0)


# As real models have them: a body of two geoms, and a floor, without names.
UNNAMED = """<mujoco><worldbody><geom type="plane" size="3 3 .1"/>
    <body name="body" pos="0 0 .2"><freejoint/>
      <geom size=".1" mass="1"/><geom size=".05" pos="0 0 .1" mass=".2"/></body>
    <body><joint/><geom size=".1" pos="2 0 1"/></body></worldbody></mujoco>"""


def test_geoms_bodies_and_joints_without_names_are_varied_by_id():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(UNNAMED))
    assert engine.body_geoms("body") == engine.body_geoms(1) == (1, 2)
    assert engine.body_geoms("world") == (0,)
    at = {"start": 2.0, "bounds": (0.1, 9.0)}
    parameters = [
        Parameter.material(engine.body_geoms("body"), "stiffness", **at),
        Parameter.pair(np.int32(3), 0, "stiffness", name="pair", **at),
        Parameter.model("body_mass", 2, **at),
        Parameter.model("dof_damping", 1, **at),
    ]
    trajectory = make_trajectory(initial_qpos=None, initial_qvel=np.zeros(7))
    problem = Problem(engine, parameters, [trajectory], 1e-3, 1e-2)
    built = problem.build({"stiffness": 3.0, "pair": 4.0, "body_mass": 5.0, "dof_damping": 6.0})
    assert [built.material(geom).stiffness for geom in range(4)] == [None, 3.0, 3.0, None]
    assert built.pair_material(0, 3).stiffness == 4.0
    assert built.model.body_mass[2] == 5.0
    assert built.model.dof_damping.tolist() == [0.0] * 6 + [6.0]
    twice = [Parameter.material(1, "stiffness", name=name, **at) for name in "ab"]
    with pytest.raises(ValueError, match="'a' and 'b' both set the stiffness of geom 1"):
        Problem(engine, twice, [trajectory], 1e-3, 1e-2)
    for attribute, unknown, message in (
        ("body_mass", 3, "elements = 3 is not a body id of the model, 0 to 2"),
        ("tendon_damping", 0, "elements = 0: the model has no tendon"),
    ):
        parameter = Parameter.model(attribute, unknown, **at)
        with pytest.raises(ValueError, match=f"parameter '{attribute}' = 2: {message}"):
            Problem(engine, [parameter], [trajectory], 1e-3, 1e-2)
    with pytest.raises(ValueError, match="did you mean 'body'"):
        engine.body_geoms("bodi")


def test_advice_on_geoms_without_names_can_be_followed():
    """It names what Engine.set_material takes."""
    soft = UNNAMED.replace('<geom size=".05"', '<geom solref=".05 .7" size=".05"')
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(soft))
    parameter = Parameter.material(2, "sliding_friction", start=0.5, bounds=(0.1, 1.0))
    trajectory = make_trajectory(initial_qvel=np.zeros(7))
    with pytest.raises(ValueError, match=r"geom 2 with 0 rigid.*Engine\.set_material\(2, "):
        Problem(engine, [parameter], [trajectory], 1e-3, 1e-2)


@pytest.mark.parametrize(
    ("attribute", "element", "lower", "allowed"),
    [
        ("body_mass", "body", 0.0, 1e-9),
        ("body_inertia", "body", -1.0, 1e-9),
        ("geom_size", "ball", 0.0, 1e-9),
        ("geom_friction", "ball", -0.1, 0.0),
        ("dof_damping", "swing", -0.1, 0.0),
        ("dof_frictionloss", 0, -0.1, 0.0),
        ("dof_armature", 0, -0.1, 0.0),
        ("tendon_damping", 0, -0.1, 0.0),
    ],
)
def test_bounds_that_hold_what_no_body_is_are_refused(attribute, element, lower, allowed):
    index = 0 if attribute == "geom_friction" else None
    at = {"start": 0.5, "transform": "linear", "index": index}
    sign = ">" if allowed else ">="
    message = f"parameter '{attribute}': {attribute} of '{element}' must be {sign} 0.*at {lower:g}$"
    with pytest.raises(ValueError, match=message):
        Parameter.model(attribute, element, bounds=(lower, 1.0), **at)
    Parameter.model(attribute, element, bounds=(allowed, 1.0), **at)


def test_a_start_whose_inertia_is_that_of_no_body_is_refused():
    """Of a body, no moment of inertia exceeds the sum of the others; a ring's is their sum."""

    def of(axis, start):
        return Parameter.model(
            "body_inertia", "body", index=axis, start=start, bounds=(1e-5, 1.0), name=f"I{axis}"
        )

    system = mujoco.MjModel.from_xml_string(BALL.replace("<body ", '<body simple="false" '))
    at = {"system": system, "trajectories": [make_trajectory()]}
    message = r"parameter 'I0' = 0.1: body_inertia of body 'body' would be \(0.1, 0.3, 0.004\)"
    with pytest.raises(ValueError, match=message):
        make_problem(parameters=[of(0, 0.1), of(1, 0.3)], **at)
    problem = make_problem(parameters=[of(0, 0.1), of(1, 0.1), of(2, 0.2)], **at)
    built = problem.build({"I0": 0.1, "I1": 0.3, "I2": 0.2 + 1e-9})
    assert built.body_inertia[1].tolist() == [0.1, 0.3, 0.2 + 1e-9]
    with pytest.raises(ValueError, match=r"0\.35 is more than the other two together, 0\.3"):
        problem.build({"I0": 0.1, "I1": 0.35, "I2": 0.2})


def test_a_problem_shows_no_arrays():
    shown = repr(make_trajectory())
    assert shown == "Trajectory('throw 7', 5 frames 0.01 s apart, bodies=('body',))"
    problem = Problem(ball_engine(), ball_parameters(), [make_trajectory()], 1e-3, 1e-2)
    assert shown in repr(problem)
    assert "array" not in repr(problem)
