"""Calibration: trajectories of sensors, against closed forms and conservation of momentum."""

import pickle
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import dashpot
from ball_throws import IDENTITY, make_trajectory
from dashpot.calibrate import Parameter, Problem, Trajectory, fit
from dashpot.calibrate.residuals.objective import Objective

CART = """
<mujoco>
  <option timestep="0.01" gravity="0 0 0"/>
  <worldbody>
    <body name="cart"><joint name="x" type="slide" axis="1 0 0" range="-9 9"/>
      <geom size=".1" mass="4"/><site name="imu"/></body>
  </worldbody>
  <actuator><motor joint="x"/></actuator>
  <sensor>
    <jointpos name="encoder" joint="x"/>
    <jointvel name="rate" joint="x"/>
    <accelerometer name="imu" site="imu"/>
    <framequat name="turn" objtype="site" objname="imu"/>
    <jointlimitpos name="stop" joint="x"/>
    <clock name="late" delay="0.02" nsample="4"/>
    <user name="own" dim="1"/>
  </sensor>
</mujoco>
"""
LEG = """
<mujoco>
  <option timestep="0.001"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body name="drone" pos="0 0 .1"><joint name="z" type="slide" axis="0 0 1"/>
      <geom name="foot" size=".02" mass="1.2"/><site name="imu"/>
      <site name="foot" size=".03"/></body>
  </worldbody>
  <sensor>
    <jointpos name="encoder" joint="z"/>
    <accelerometer name="imu" site="imu"/>
    <touch name="plate" site="foot"/>
  </sensor>
</mujoco>
"""
TRUTH = {"stiffness": 2e4, "restitution": 0.3}
CONTROL = np.array([[1.0], [-2.0], [0.5]])


def load(xml):
    return mujoco.MjModel.from_xml_string(xml)


def push(sensors, system=None, sigma=1.0, **changes):
    """Return the problem of a cart of unknown mass that motors push, a frame each 0.1 s."""
    fields = {
        "time": [0.0, 0.1, 0.2, 0.3],
        "sensors": sensors,
        "initial_qvel": [0.0],
        "control": CONTROL,
        **changes,
    }
    trajectory = Trajectory.of_sensors("push", **fields)
    mass = Parameter.model("body_mass", "cart", start=4.0, bounds=(1.0, 10.0))
    sigmas = dict.fromkeys(sensors, sigma)
    system = load(CART) if system is None else system
    return Problem(system, [mass], [trajectory], 1.0, 1.0, sensor_sigma=sigmas)


@pytest.mark.parametrize("stepped_by", [lambda m: m, dashpot.Engine], ids=["mujoco", "dashpot"])
def test_encoders_read_the_frame_and_accelerometers_the_mean_before_it(stepped_by):
    """Steps of 0.01 s with u / 4: Euler's, or exact ones; rotations and other axes are 0."""
    names = ("encoder", "rate", "imu")
    sizes = (1, 1, 3)
    readings = {name: np.zeros((4, size)) for name, size in zip(names, sizes, strict=True)}
    objective = Objective(push(readings, stepped_by(load(CART))))
    (found,) = objective.observe(objective.start())
    force = np.repeat(CONTROL[:, 0], 10) / 4.0
    velocity = np.concatenate([[0.0], 0.01 * np.cumsum(force)])
    exact = stepped_by is dashpot.Engine
    on_the_way = 0.5 * (velocity[:-1] + velocity[1:]) if exact else velocity[1:]
    position = np.concatenate([[0.0], 0.01 * np.cumsum(on_the_way)])
    np.testing.assert_allclose(found["encoder"][:, 0], position[::10], atol=1e-15)
    np.testing.assert_allclose(found["rate"][:, 0], velocity[::10], atol=1e-15)
    assert np.isnan(found["imu"][0]).all()
    np.testing.assert_allclose(found["imu"][1:, 0], CONTROL[:, 0] / 4.0, rtol=1e-13)
    residuals = objective.residuals(objective.start())[0]
    expected = np.concatenate([np.nan_to_num(found[name]).ravel() for name in names])
    np.testing.assert_array_equal(residuals, expected)
    assert objective.measured_count == 4 + 4 + 9


ARM = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <camera name="eye" pos="2 0 1" xyaxes="0 1 0 0 0 1"/>
    <body name="upper" pos="0 0 .5"><joint name="shoulder" axis="0 1 0" damping=".1"/>
      <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass=".5"/>
      <body name="fore" pos=".3 0 0"><joint name="elbow" axis="0 1 0" damping=".1"/>
        <geom name="fore" type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass=".3"/>
        <site name="tip" pos=".3 0 0"/></body></body>
  </worldbody>
  <tendon><fixed name="both"><joint joint="shoulder" coef="1"/>
    <joint joint="elbow" coef="2"/></fixed></tendon>
  <actuator><position name="servo" joint="elbow" kp="5" gear="3"/></actuator>
  <sensor>
    <jointpos name="angle" joint="elbow"/> <jointvel name="rate" joint="elbow"/>
    <tendonpos name="length" tendon="both"/> <tendonvel name="speed" tendon="both"/>
    <actuatorpos name="turns" actuator="servo"/> <actuatorvel name="spin" actuator="servo"/>
    <framepos name="seen" objtype="site" objname="tip" reftype="camera" refname="eye"/>
    <framelinvel name="moves" objtype="site" objname="tip"/> <gyro name="gyro" site="tip"/>
    <velocimeter name="flow" site="tip"/> <subtreecom name="centre" body="upper"/>
    <subtreelinvel name="drift" body="upper"/> <subtreeangmom name="momentum" body="upper"/>
    <rangefinder name="range" site="tip"/> <e_potential name="potential"/>
    <e_kinetic name="kinetic"/> <clock name="clock"/>
  </sensor>
</mujoco>
"""


@pytest.mark.parametrize("stepped_by", [lambda m: m, dashpot.Engine], ids=["mujoco", "dashpot"])
def test_what_positions_and_velocities_make_is_that_of_the_frame(stepped_by):
    """As mj_forward says it of the state there; the arm swings down and hits the floor."""
    model = load(ARM)
    names = [model.sensor(i).name for i in range(model.nsensor)]
    shapes = {name: (5, *model.sensor(name).dim) for name in names}
    trajectory = Trajectory.of_sensors(
        "swing", 0.1 * np.arange(5), {k: np.zeros(v) for k, v in shapes.items()},
        initial_qvel=[0.0, 0.0], control=np.full((4, 1), 0.7),
    )  # fmt: skip
    mass = Parameter.model("body_mass", "fore", start=0.3, bounds=(0.1, 1.0))
    sigma = dict.fromkeys(names, 1.0)
    system = stepped_by(model)
    problem = Problem(system, [mass], [trajectory], 1.0, 1.0, sensor_sigma=sigma)
    objective = Objective(problem)
    (found,) = objective.observe(objective.start())
    data = system.make_data() if isinstance(system, dashpot.Engine) else mujoco.MjData(model)
    own = system.model if isinstance(system, dashpot.Engine) else model
    own.body("fore").mass = float(np.exp(np.log(0.3)))
    mujoco.mj_setConst(own, mujoco.MjData(own))
    for frame in range(5):
        there = mujoco.MjData(own)
        there.time, there.qpos[:], there.qvel[:] = data.time, data.qpos, data.qvel
        mujoco.mj_forward(own, there)
        for name in names:
            expected = there.sensor(name).data
            np.testing.assert_allclose(found[name][frame], expected, atol=1e-12, err_msg=name)
        data.ctrl[:] = 0.7
        for _ in range(50):
            system.step(data) if own is not model else mujoco.mj_step(model, data)


def test_through_a_gap_means_are_over_the_last_spacing():
    readings = {"imu": np.zeros((3, 3))}
    problem = push(readings, time=[0.0, 0.1, 0.3], control=CONTROL[:2])
    (found,) = Objective(problem).observe(np.log([4.0]))
    np.testing.assert_allclose(found["imu"][1:, 0], CONTROL[:2, 0] / 4.0, rtol=1e-13)
    # Forces of two spacings in one gap: the later one alone counts.
    change = mujoco.MjModel.from_xml_string(
        CART.replace('<motor joint="x"/>', '<damper joint="x" kv="8" ctrlrange="0 1"/>')
    )
    start = {"initial_qvel": [1.0], "time": [0.0, 0.1, 0.3], "control": np.ones((2, 1))}
    problem = push(readings, change, **start)
    (found,) = Objective(problem).observe(np.log([4.0]))
    speed = (1.0 - 0.01 * 8.0 / 4.0) ** np.arange(31)  # Euler steps of v' = -8 v / 4
    mean = (speed[[10, 30]] - speed[[0, 20]]) / 0.1
    np.testing.assert_allclose(found["imu"][1:, 0], mean, rtol=1e-12)


def test_a_camera_sees_a_marker_in_its_own_frame():
    """The marker falls; the camera stands 2 m off and looks along x: R^T (p - c)."""
    model = load(
        """
        <mujoco>
          <option timestep="0.01"/>
          <worldbody>
            <camera name="eye" pos="2 .5 1" xyaxes="0 1 0 0 0 1"/>
            <body name="body" pos="0 0 1"><freejoint/><geom size=".1" mass="1"/>
              <site name="marker" pos=".1 .2 .3"/></body>
          </worldbody>
          <sensor><framepos name="seen" objtype="site" objname="marker" reftype="camera"
            refname="eye"/></sensor>
        </mujoco>
        """
    )
    trajectory = Trajectory.of_sensors(
        "fall", 0.1 * np.arange(4), {"seen": np.zeros((4, 3))}, initial_qvel=np.zeros(6)
    )
    mass = Parameter.model("body_mass", "body", start=1.0, bounds=(0.5, 2.0))
    problem = Problem(
        dashpot.Engine(model), [mass], [trajectory], 1.0, 1.0, sensor_sigma={"seen": 1.0}
    )
    (found,) = Objective(problem).observe(np.zeros(1))
    # A freely falling body is moved exactly; its centre is the origin.
    height = 1.0 - 0.5 * 9.81 * trajectory.time**2
    world = np.c_[np.full(4, 0.1), np.full(4, 0.2), height + 0.3]
    axes = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])  # rows: x, y, z of the camera
    np.testing.assert_allclose(found["seen"], (world - [2, 0.5, 1]) @ axes.T, atol=1e-12)


def leg(values=TRUTH):
    engine = dashpot.Engine(load(LEG))
    material = dashpot.Material(values["stiffness"], restitution=values["restitution"])
    engine.set_pair_material("foot", "floor", material)
    return engine


def landing(sensors, noise, seed, frames=200):
    """Return a drop of the leg as its sensors record it: each 2 ms, means of 0.4 ms steps."""
    engine = leg()
    n = {"imu": 3}
    empty = {name: np.zeros((frames, n.get(name, 1))) for name in sensors}
    time = 0.002 * np.arange(frames)
    drop = Trajectory.of_sensors("drop", time, empty, initial_qvel=[0.0])
    problem = landing_problem([drop], noise)
    values = {name: TRUTH[name] for name in problem.names}
    objective = Objective(problem, held=values)
    (found,) = objective.observe(np.empty(0))
    rng = np.random.default_rng(seed)
    readings = {k: v + noise[k] * rng.normal(size=v.shape) for k, v in found.items()}
    assert engine.model.nsensor == 3
    return replace(drop, sensors=readings)


def landing_problem(trajectories, noise, **options):
    unknown = [
        Parameter.pair("foot", "floor", "stiffness", start=6e3, bounds=(1e2, 1e6)),
        Parameter.pair("foot", "floor", "restitution", start=0.6, bounds=(0.01, 0.99)),
    ]
    return Problem(
        dashpot.Engine(load(LEG)), unknown, trajectories, 1.0, 1.0, sensor_sigma=noise,
        substeps=5, **options,
    )  # fmt: skip


@pytest.mark.parametrize("noise", [{"imu": 0.5}, {"encoder": 1e-3, "plate": 5.0}])
def test_sensors_tell_stiffness_and_restitution_of_a_landing_leg(noise):
    drop = landing(noise, noise, seed=4)
    result = fit(landing_problem([drop], noise))
    assert result.noise_explains
    for name, value in TRUTH.items():
        assert result[name].identified, result[name].statement
        # Three standard errors: of two estimates one in 200 is farther off.
        assert abs(result[name].value - value) < 3.0 * result[name].standard_error
    for name, sigma in noise.items():
        size = drop.sensors[name].shape[1]
        # The square root of a mean of some 200 squares or more is known to 5 % or better.
        expected = sigma * np.sqrt(size)
        assert result.metrics()[f"sensors.{name}_rms"] == pytest.approx(expected, rel=0.15)
        weighted = result.predict()[0].sensor_errors[name] / sigma
        np.testing.assert_allclose(
            np.nan_to_num(weighted), result.sensor_residuals[0][name], atol=1e-9
        )
    result.plot()
    result.to_dict()


def test_an_unknown_start_is_found_from_encoders():
    noise = {"encoder": 1e-4}
    drop = replace(landing(noise, noise, seed=5), initial_qvel=None, initial_qpos=[0.02])
    result = fit(landing_problem([drop], noise, initial_state="pose_and_velocity"))
    assert result.noise_explains
    assert abs(0.02 + result.initial_displacement[0, 0]) < 3e-4  # noise over the root of the flight
    for name, value in TRUTH.items():
        assert abs(result[name].value - value) < 3.0 * result[name].standard_error


def test_a_force_plate_reads_the_momentum_that_it_takes():
    """Mean forces times the spacing add up to m (g T + v_T - v_0), whatever the bounce."""
    objective = Objective(
        landing_problem([landing({"plate": 1.0}, {"plate": 1.0}, 6)], {"plate": 1.0})
    )
    point = objective.start()
    (found,) = objective.observe(point)
    engine = leg(objective.values(point))
    engine.model.opt.timestep = 4e-4
    data = engine.make_data()
    engine.step(data, 5 * 199)
    momentum = 1.2 * (9.81 * data.time + data.qvel[0])
    assert 0.002 * np.nansum(found["plate"]) == pytest.approx(momentum, rel=1e-9)


@pytest.mark.parametrize("stepped_by", [lambda m: m, dashpot.Engine], ids=["mujoco", "dashpot"])
def test_reading_sensors_does_not_change_the_motion(stepped_by):
    system = stepped_by(load(LEG))
    frames = 150
    seen = {
        "time": 0.002 * np.arange(frames), "position": np.zeros((frames, 3)), "bodies": "drone",
        "quaternion": np.tile(IDENTITY, (frames, 1)), "initial_qvel": [0.0],
    }  # fmt: skip
    readings = {"encoder": np.zeros(frames), "imu": np.zeros((frames, 3))}
    mass = Parameter.model("body_mass", "drone", start=1.2, bounds=(0.5, 2.0))
    found = []
    for sensors in ({}, readings):
        trajectory = make_trajectory(**seen, sensors=sensors)
        sigma = dict.fromkeys(readings, 1.0)
        problem = Problem(system, [mass], [trajectory], 1.0, 1.0, sensor_sigma=sigma)
        objective = Objective(problem)
        found.append(objective.observe(objective.start())[0]["poses"])
    np.testing.assert_array_equal(*found)


def test_readings_that_are_lost_do_not_count():
    readings = np.ones(4)
    readings[2] = np.nan
    problem = push({"encoder": readings})
    objective = Objective(problem)
    assert objective.measured_count == 3
    assert objective.residuals(objective.start())[0, 2] == 0.0
    shorter = problem.trajectories[0].head(0.1)
    assert shorter.sensors["encoder"].shape == (2, 1)
    assert pickle.loads(pickle.dumps(problem)).trajectories[0].sensors.keys() == {"encoder"}
    assert "sensors=('encoder',)" in repr(shorter)


@pytest.mark.parametrize(
    ("sensors", "message"),
    [
        ({"encodr": np.zeros(4)}, "no sensor 'encodr'; did you mean 'encoder'"),
        ({"imu": np.zeros((4, 2))}, r"sensor 'imu' has 3 numbers, got readings \(4, 2\)"),
        ({"turn": np.zeros((4, 4))}, "sensor 'turn' is a quaternion; observe the pose"),
        ({"stop": np.zeros(4)}, "sensor 'stop' is of a limit"),
        ({"late": np.zeros(4)}, "sensor 'late' has a delay"),
        ({"own": np.zeros(4)}, "sensor 'own' is computed by a callback"),
        ({"encoder": np.zeros(5)}, r"sensors\['encoder'\] must be \(4, size\) or \(4,\)"),
        ({"encoder": [0.0, np.inf, 0.0, 0.0]}, r"sensors\['encoder'\]\[1\] is inf"),
        ({"encoder": np.full(4, np.nan)}, "nothing that was measured is left"),
        ({}, "bodies must be one or more"),
    ],
)
def test_what_no_sensor_can_have_read_is_named(sensors, message):
    with pytest.raises(ValueError, match=message):
        push(sensors)


@pytest.mark.parametrize(
    ("sigma", "kind", "message"),
    [
        ({}, ValueError, "trajectory 'push': sensor 'encoder' has no sensor_sigma"),
        ({"encoder": 0.0}, ValueError, r"sensor_sigma\['encoder'\] must be > 0"),
        ({"encoder": (1.0, 2.0)}, ValueError, r"sensor_sigma\['encoder'\] must be one number or 1"),
        ({"encoder": 1.0, "far": 1.0}, ValueError, "sensor_sigma: the model has no sensor 'far'"),
        (1.0, TypeError, "sensor_sigma must be a mapping"),
    ],
)
def test_bad_noise_of_a_sensor_is_named(sigma, kind, message):
    with pytest.raises(kind, match=message):
        replace(push({"encoder": np.zeros(4)}), sensor_sigma=sigma)
