"""The inertia of a body as ten numbers that always make one: clouds, springs, a tumbling box."""

from __future__ import annotations

import json
import math
import pickle
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.calibrate import Fit, Parameter, Problem, Trajectory, fit
from dashpot.calibrate.inference.body_inertia import body_inertia
from dashpot.calibrate.problem.pseudo_inertia import NUMBERS, body_of, numbers_of, principal
from dashpot.calibrate.residuals.objective import Objective

BOX = """
<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <body name="box" pos="0 0 1" simple="false">
      <freejoint/>
      <geom name="box" type="box" size=".1 .07 .04" mass="0.5"/>
      {load}
    </body>
  </worldbody>
</mujoco>
"""
LOAD = '<geom name="load" type="sphere" size=".02" pos=".06 .03 -.01" mass="0.3"/>'
SPRING = """
<mujoco>
  <option timestep="0.005" gravity="0 0 0"/>
  <worldbody>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0" stiffness="50"/>
      <geom name="cart" type="box" size=".1 .1 .1" mass="1"/>
    </body>
  </worldbody>
  <sensor><jointpos name="encoder" joint="rail"/></sensor>
</mujoco>
"""
POSITION, ROTATION = 1e-3, 5e-3


def model(load=""):
    return mujoco.MjModel.from_xml_string(BOX.format(load=load))


def thrown(spin, rng, *, name, frames=40):
    """Return noisy poses of the loaded box that tumbles, every 0.01 s."""
    engine = dashpot.Engine(model(LOAD))
    data = engine.make_data()
    data.qvel[:] = [1, 0, 2, *spin]
    poses = [data.qpos.copy()]
    for _ in range(frames - 1):
        engine.step(data, 2)
        poses.append(data.qpos.copy())
    poses = np.array(poses)
    poses[:, :3] += POSITION * rng.normal(size=(frames, 3))
    for pose in poses:
        mujoco.mju_quatIntegrate(pose[3:], ROTATION * rng.normal(size=3), 1.0)
    return Trajectory(name, 0.01 * np.arange(frames), poses[:, :3], poses[:, 3:], bodies=("box",))


def throws(seed, count=2):
    rng = np.random.default_rng(seed)
    spins = [(9, 2, 1), (1, 9, 3), (2, -3, 8)][:count]
    return [thrown(spin, rng, name=f"throw {i}") for i, spin in enumerate(spins)]


def box_problem(trajectories, *parameters, system=None):
    return Problem(
        dashpot.Engine(model()) if system is None else system,
        parameters or [Parameter.inertia("box")],
        trajectories,
        POSITION,
        ROTATION,
        initial_state="pose_and_velocity",
        substeps=2,
    )


@pytest.fixture(scope="module")
def tumbled():
    return fit(box_problem(throws(7)), starts=0)


def true_box():
    """Return the true centre (3,) and inertia (3, 3) in the frame of the body, of 0.8 kg."""
    loaded = model(LOAD)
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, loaded.body_iquat[1])
    axes = axes.reshape(3, 3)
    return loaded.body_ipos[1].copy(), axes @ np.diag(loaded.body_inertia[1]) @ axes.T


@pytest.mark.parametrize("seed", range(4))
def test_the_numbers_of_a_cloud_of_points_give_its_inertia_back(seed):
    rng = np.random.default_rng(seed)
    masses = rng.uniform(0.1, 1.0, 6)
    points = rng.normal(size=(6, 3))
    mass, centre = masses.sum(), masses @ points / masses.sum()
    off = points - centre
    inertia = np.einsum("n,nij->ij", masses, np.sum(off**2, axis=1)[:, None, None] * np.eye(3))
    inertia -= np.einsum("n,ni,nj->ij", masses, off, off)
    moments, axes = principal(inertia)
    found = body_of(numbers_of(mass, centre, moments), axes)
    assert found[0] == pytest.approx(mass)
    np.testing.assert_allclose(found[1], centre)
    np.testing.assert_allclose(found[2], inertia, rtol=1e-12, atol=1e-12)


def test_any_ten_numbers_make_a_body():
    rng = np.random.default_rng(1)
    for _ in range(200):
        numbers = rng.normal(size=10)
        numbers[[0, 4, 5, 6]] = np.exp(numbers[[0, 4, 5, 6]])
        mass, centre, inertia = body_of(numbers, np.eye(3))
        moments, axes = principal(inertia)
        assert mass > 0.0
        assert moments[2] > 0.0
        assert moments[0] < moments[1] + moments[2]
        assert np.linalg.det(axes) == pytest.approx(1.0)
        spread = 0.5 * np.trace(inertia) * np.eye(3) - inertia + mass * np.outer(centre, centre)
        pseudo = np.block([[spread, mass * centre[:, None]], [mass * centre[None, :], mass]])
        assert np.linalg.eigvalsh(pseudo)[0] > 0.0


def test_the_size_of_a_solid_box_is_that_of_its_half_lengths():
    half = np.array([0.1, 0.07, 0.04])
    moments = 0.5 / 3.0 * (np.sum(half**2) - half**2)
    numbers = numbers_of(0.5, np.zeros(3), moments)
    size = np.cbrt(half.prod()) / math.sqrt(3.0)
    assert numbers[4] == pytest.approx(size)
    np.testing.assert_allclose(numbers[5:7], half[:2] / math.sqrt(3.0) / size)
    plate = numbers_of(1.0, np.zeros(3), np.array([1.0, 1.0, 2.0]))
    np.testing.assert_allclose(np.diag(body_of(plate, np.eye(3))[2]), [1.0, 1.0, 2.0], rtol=2e-6)


def test_a_tumbling_box_tells_where_its_load_is(tumbled):
    centre, inertia = true_box()
    found = tumbled.inertia("box")
    moments = np.linalg.eigvalsh(inertia)[::-1]
    truth = {f"centre {axis}": c for axis, c in zip("xyz", centre, strict=True)}
    truth |= {f"moment {i} / moment 1": moments[i - 1] / moments[0] for i in (2, 3)}
    for name, value in truth.items():
        estimate = found[name]
        assert estimate.identified, estimate.statement
        assert abs(estimate.value - value) < 4.0 * estimate.standard_error, name
    # Where it is, to half a millimetre; the model had it 25 mm off.
    assert found["centre x"].standard_error < 5e-4
    np.testing.assert_allclose(found.centre, [found[f"centre {a}"].value for a in "xyz"])
    scaled = found.matrix * np.trace(inertia) / np.trace(found.matrix)
    np.testing.assert_allclose(scaled, inertia, atol=0.05 * moments[0])


def test_what_flight_does_not_tell_is_named(tumbled):
    """Neither the mass, which is held, nor the size of the inertia."""
    assert tumbled.held == {"inertia of box[mass]": 0.5}
    assert not tumbled["inertia of box[size]"].identified
    found = tumbled.inertia("box")
    assert found["mass"].statement == "held"
    for name in ("moment 1", "inertia xx", "inertia xy"):
        assert not found[name].identified
        assert "depends on inertia of box[size], of which the data say nothing" in (
            found[name].statement
        )
    text = str(found)
    assert "moment 2 / moment 1" in text
    assert "held" in text
    assert "box[size]" in str(tumbled)
    assert tumbled.inertias().keys() == {"inertia of box"}


def test_a_fitted_inertia_is_saved_and_written(tumbled, tmp_path):
    loaded = Fit.load(tumbled.save(tmp_path / "box.json"))
    assert str(loaded.inertia("box")) == str(tumbled.inertia("box"))
    assert loaded.inertia("box").estimates == tumbled.inertia("box").estimates
    for result, scene in ((tumbled, BOX.format(load="")), (loaded, BOX.format(load=""))):
        written = result.write_mjcf(tmp_path / "box.xml", scene=scene)
        assert "inertia of box[mass]" in str(written)
        read = mujoco.MjModel.from_xml_path(str(written.path))
        fitted = tumbled.problem.build(tumbled.values).model
        for name in ("body_mass", "body_ipos", "body_inertia", "body_iquat"):
            np.testing.assert_allclose(
                getattr(read, name), getattr(fitted, name), rtol=1e-9, atol=1e-12
            )


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("labels", ["mass", "colour"], "labels must be some of mass, centre x"),
        ("quaternion", [1.0, 0.0, 0.0], "quaternion must be 4 finite numbers"),
        ("model", [0.5] * 9, "model must be 10 finite numbers"),
        ("moments", [1.0, "nan", 1.0], "moments must be 3 finite numbers"),
        ("moments", [1.0, 0.0, 1.0], "moments must be > 0"),
    ],
)
def test_files_that_say_what_no_inertia_is_are_refused(tumbled, tmp_path, field, value, message):
    file = tumbled.save(tmp_path / "box.json")
    content = json.loads(file.read_text())
    content["parameters"][0]["apply"]["function"][field] = value
    file.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=message):
        Fit.load(file)


def test_units_are_those_of_the_numbers(tumbled):
    from dashpot.calibrate.problem.units import parameter_unit

    units = [parameter_unit(p, tumbled.problem, model()) for p in tumbled.problem.parameters]
    assert units == ["kg", "m", "m", "m", "m", "", "", "", "", ""]


def test_a_mass_alone_is_known_from_a_spring(tmp_path):
    """A cart of unknown mass on a spring of 50 N/m: its inertia grows with it."""
    true = 1.7
    time = 0.01 * np.arange(100)
    swing = 0.1 * np.cos(math.sqrt(50.0 / true) * time)
    swing += 1e-3 * np.random.default_rng(0).normal(size=100)
    trajectory = Trajectory.of_sensors(
        "swing", time, {"encoder": swing}, initial_qpos=[0.1], initial_qvel=[0.0]
    )
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(SPRING))
    unknown = Parameter.inertia("cart", mass=(0.3, 5.0), centre=False, shape=False)
    problem = Problem(engine, [unknown], [trajectory], sensor_sigma={"encoder": 1e-3}, substeps=10)
    assert problem.names == ("inertia of cart[mass]",)
    result = fit(problem, starts=0)
    mass = result["inertia of cart[mass]"]
    assert mass.identified
    assert abs(mass.value - true) < 4.0 * mass.standard_error
    found = result.inertia("cart")
    moment = found["moment 1"]
    assert moment.value == pytest.approx(mass.value * 2.0 / 3.0 * 0.1**2)
    assert moment.standard_error / moment.value == pytest.approx(mass.standard_error / mass.value)
    assert moment.identified
    assert found["moment 2 / moment 1"].standard_error == 0.0
    # Ends of a mass are those of its parameter, but for what the linear model leaves over.
    assert found["mass"].lower == pytest.approx(mass.lower, rel=1e-4)
    built = problem.build({"inertia of cart[mass]": 2.0}).model
    np.testing.assert_allclose(built.body_inertia[1], 2.0 * engine.model.body_inertia[1])


def test_a_known_torque_tells_the_moment_about_its_axis():
    """A rotor under 0.01 N m, its shape held: I = torque / acceleration, whatever its mass."""
    true = 2.5e-3
    rotor = """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody>
      <body name="rotor" simple="false"><joint name="axle" type="hinge" axis="0 0 1"/>
      <geom type="box" size=".1 .07 .04" mass="0.5"/></body></worldbody>
      <actuator><motor joint="axle"/></actuator>
      <sensor><jointvel name="rate" joint="axle"/></sensor></mujoco>"""
    time = 0.01 * np.arange(60)
    rate = 0.01 / true * time + 0.01 * np.random.default_rng(0).normal(size=60)
    trajectory = Trajectory.of_sensors(
        "run up", time, {"rate": rate}, initial_qpos=[0.0], initial_qvel=[0.0],
        control=np.full((59, 1), 0.01), sampling={"rate": "instant"},
    )  # fmt: skip
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(rotor))
    unknown = Parameter.inertia("rotor", centre=False, name="rotor")
    problem = Problem(engine, [unknown], [trajectory], sensor_sigma={"rate": 0.01})
    shape = [f"rotor[{n}]" for n in NUMBERS[5:]]
    result = fit(problem.freeze(shape), starts=0)
    moment = result.inertia("rotor")["inertia zz"]
    assert moment.identified, moment.statement
    assert abs(moment.value - true) < 4.0 * moment.standard_error
    relative = 0.01 / (0.01 / true * np.sqrt(np.sum(time**2)))
    assert moment.standard_error / moment.value == pytest.approx(relative, rel=0.2)


def test_encoders_of_a_double_pendulum_tell_the_mass_of_its_lower_link():
    """0.4 kg as drawn, and a load of 0.2 kg at (0.05, 0, -0.2); it turns about one axis."""
    xml = """<mujoco><option timestep="0.002"/><worldbody>
      <body name="upper" pos="0 0 1"><joint name="a" type="hinge" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass=".5" contype="0"/>
      <body name="lower" pos="0 0 -.3" simple="false"><joint name="b" type="hinge" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass=".4" contype="0"/>LOAD</body>
      </body></worldbody>
      <sensor><jointpos name="a" joint="a"/><jointpos name="b" joint="b"/></sensor></mujoco>"""
    load = '<geom size=".02" pos=".05 0 -.2" mass=".2" contype="0"/>'
    true = dashpot.Engine(mujoco.MjModel.from_xml_string(xml.replace("LOAD", load)))
    data = true.make_data()
    data.qpos[:] = (1.0, 0.5)
    angles = [data.qpos.copy()]
    for _ in range(80):
        true.step(data, 5)
        angles.append(data.qpos.copy())
    angles = np.array(angles) + 1e-3 * np.random.default_rng(0).normal(size=(81, 2))
    swing = Trajectory.of_sensors(
        "swing", 0.01 * np.arange(81), {"a": angles[:, 0], "b": angles[:, 1]},
        initial_qpos=[1.0, 0.5], initial_qvel=[0.0, 0.0],
    )  # fmt: skip
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml.replace("LOAD", "")))
    unknown = Parameter.inertia("lower", mass=(0.1, 2.0), name="lower")
    sigma = {"a": 1e-3, "b": 1e-3}
    problem = Problem(engine, [unknown], [swing], sensor_sigma=sigma, substeps=5)
    one_axis = [f"lower[{n}]" for n in ("centre y", *NUMBERS[5:])]
    result = fit(problem.freeze(one_axis), starts=0)
    found = result.inertia("lower")
    model = true.model
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[2])
    about_y = axes.reshape(3, 3)[1] ** 2 @ model.body_inertia[2]
    truth = {
        "mass": 0.6,
        "centre x": model.body_ipos[2, 0],
        "centre z": model.body_ipos[2, 2],
        "inertia yy": about_y,
    }
    for name, value in truth.items():
        assert found[name].identified, found[name].statement
        assert abs(found[name].value - value) < 4.0 * found[name].standard_error, name


def test_intervals_follow_the_delta_method():
    """Of a mass and a size known to 1 % and 2 %, moments m s^2 are to root(1 + 16) %."""
    problem = box_problem(throws(0, 1), Parameter.inertia("box", mass=(0.2, 1.0), centre=False))
    parameters = problem.parameters
    values = [p.start for p in parameters]
    covariance = np.zeros((7, 7))
    covariance[0, 0], covariance[1, 1] = (0.01 * values[0]) ** 2, (0.02 * values[1]) ** 2
    found = body_inertia(
        parameters[0].apply.function, parameters, values, covariance,
        quantile=2.0, confidence=0.95, unfinished=None, misfit=True,
    )  # fmt: skip
    for name in ("moment 1", "moment 3", "inertia yy"):
        estimate = found[name]
        error = math.sqrt(17.0) * 0.01
        assert estimate.standard_error / estimate.value == pytest.approx(error, rel=1e-6)
        assert estimate.upper / estimate.value == pytest.approx(math.exp(2.0 * error), rel=1e-6)
        assert estimate.grade == "within misfit"
    assert found["moment 2 / moment 1"].statement == "held"
    assert found["centre x"].statement == "held"


def test_intervals_without_an_end_say_so():
    problem = box_problem(throws(0, 1), Parameter.inertia("box", mass=(0.2, 1.0), centre=False))
    values = [p.start for p in problem.parameters]
    covariance = np.diag([1e-4, 1.0, *[1e-8] * 5])  # a size of 0.04 m, to 1 m
    found = body_inertia(
        problem.parameters[0].apply.function, problem.parameters, values, covariance,
        quantile=2.0, confidence=0.95, unfinished=None, misfit=False,
    )  # fmt: skip
    assert found["mass"].identified
    assert found["moment 2 / moment 1"].identified
    moment = found["moment 1"]
    assert (moment.lower, moment.upper) == (0.0, math.inf)
    assert moment.statement == "not identified: its interval has no end"
    assert "inf" not in str(found)


def test_groups_have_an_inertia_of_their_own_and_nested_models_hold_it():
    unknown = Parameter.inertia("box", per="trajectory", shape=False)
    problem = box_problem(throws(0), unknown)
    assert problem.names[:2] == (
        "inertia of box[throw 0][mass]",
        "inertia of box[throw 0][centre x]",
    )
    values = {**problem.start, "inertia of box[throw 1][centre x]": 0.01}
    assert problem.build(values, "throw 0").model.body_ipos[1, 0] == 0.0
    assert problem.build(values, "throw 1").model.body_ipos[1, 0] == 0.01
    nested = problem.freeze(["inertia of box[throw 1]"])
    assert len(nested.unknowns) == 3
    assert len(problem.freeze(["inertia of box"]).unknowns) == 0


def test_functions_that_build_the_model_say_where_it_starts():
    def build(values):
        engine = dashpot.Engine(model(LOAD if values["loaded"] > 0.5 else ""))
        return engine

    loaded = Parameter("loaded", 0.9, (0.1, 1.0))
    problem = box_problem(throws(0, 1), loaded, Parameter.inertia("box"), system=build)
    assert problem.held["inertia of box[mass]"] == pytest.approx(0.8)
    assert problem.start["inertia of box[centre x]"] == pytest.approx(0.0225)


def test_corners_of_the_bounds_are_bodies_that_mujoco_takes():
    problem = box_problem(throws(0, 1), Parameter.inertia("box", mass=(0.1, 2.0)))
    rng = np.random.default_rng(0)
    for _ in range(50):
        values = {p.name: p.bounds[int(rng.integers(2))] for p in problem.parameters}
        built = problem.build(values).model
        data = mujoco.MjData(built)
        mujoco.mj_forward(built, data)
        np.testing.assert_allclose(data.xipos[1] - data.xpos[1], built.body_ipos[1], atol=1e-15)
        largest, *others = built.body_inertia[1]
        assert largest < sum(others) * (1.0 + 1e-12)


def test_processes_and_checkpoints_give_the_same_bits(tmp_path):
    problem = box_problem(throws(0, 1))
    objective = Objective(problem)
    begin = objective.start()
    copied = Objective(pickle.loads(pickle.dumps(problem)))
    np.testing.assert_array_equal(
        copied.residuals(copied.start() + 1e-3), objective.residuals(begin + 1e-3)
    )
    options = {"starts": 0, "max_evaluations": 60, "checkpoint": tmp_path / "fit.npz"}
    with ThreadPoolExecutor(2) as executor:
        first = fit(problem, executor=executor, **options)
    again = fit(problem, **options)
    assert again.values == first.values
    assert again.estimates == first.estimates


def simple():
    return dashpot.Engine(
        mujoco.MjModel.from_xml_string(BOX.format(load="").replace('simple="false"', ""))
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Parameter.inertia("box", mass=(2.0, 1.0)), "'inertia of box': bounds must"),
        (lambda: Parameter.inertia("box", shape=0.5), "'inertia of box': shape must be > 1"),
        (lambda: Parameter.inertia("box", centre=-1.0), "'inertia of box': centre must be"),
        (lambda: Parameter.inertia("box", centre=False, shape=False), "are all held"),
        (lambda: Parameter.inertia(["box"]), "body must be a name or an id"),
        (
            lambda: box_problem(throws(0, 1), Parameter.inertia("box", mass=(1.0, 2.0))),
            r"'inertia of box\[mass\]': start must lie between the bounds \(1.0, 2.0\)",
        ),
        (lambda: box_problem(throws(0, 1), Parameter.inertia("bix")), "no body named 'bix'"),
        (lambda: box_problem(throws(0, 1), Parameter.inertia(0)), "has no mass"),
        (
            lambda: box_problem(throws(0, 1), system=simple()),
            "'inertia of box': MuJoCo compiled the body as simple",
        ),
        (
            lambda: box_problem(
                throws(0, 1),
                Parameter.inertia("box"),
                Parameter.model("body_mass", 1, start=0.5, bounds=(0.1, 1.0)),
            ),
            r"'inertia of box\[mass\]' and 'body_mass' both set the body_mass of 'box'",
        ),
    ],
)
def test_errors_name_the_parameter_and_the_field(make, message):
    with pytest.raises((ValueError, TypeError), match=message):
        make()


def test_bodies_whose_inertia_was_not_fitted_are_refused(tumbled):
    with pytest.raises(
        KeyError, match="no parameter varies the inertia of 'ball'; bodies of such: box"
    ):
        tumbled.inertia("ball")
    assert len(NUMBERS) == 10
