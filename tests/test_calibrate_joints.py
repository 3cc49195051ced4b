"""Calibration of joints that are read: angles within a turn, first guesses, flights."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot.calibrate import Parameter, Problem, Trajectory, fit, predict, tosses, with_flights
from dashpot.calibrate.flights import flight_frames

RATE, FRAMES = 100.0, 41
TIME = np.arange(FRAMES) / RATE
WHEEL = """
<mujoco>
  <option timestep="0.005" gravity="0 0 0"/>
  <worldbody>
    <body><joint name="axle" type="{kind}" axis="0 1 0" damping="{damping}"/>
      <geom type="cylinder" size=".1 .02" mass="1"/></body>
  </worldbody>
  <sensor><jointpos name="angle" joint="axle"/></sensor>
</mujoco>
"""
# Two boxes on a hinge above a floor.
PAIR = """
<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="first" pos="0 0 .4"><freejoint/>
      <geom name="first" type="box" size=".05 .025 .025" mass=".4"/>
      <body name="second" pos="-.035 .06 0"><joint name="hinge" axis="0 1 0" damping="1e-4"/>
        <geom name="second" type="box" pos=".035 0 0" size=".05 .025 .025" mass=".4"/></body>
    </body>
  </worldbody>
  <sensor><jointpos name="angle" joint="hinge"/></sensor>
</mujoco>
"""


def within_a_turn(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def wheel_problem(reading, *, kind="hinge", damping=5e-3, **options):
    trajectory = Trajectory.of_sensors(
        "spin", TIME, {"angle": reading}, initial_qpos=[0.0], initial_qvel=[40.0]
    )
    return Problem(
        dashpot.Engine(mujoco.MjModel.from_xml_string(WHEEL.format(kind=kind, damping=damping))),
        [Parameter.model("dof_damping", "axle", start=0.05, bounds=(1e-3, 1.0))],
        [trajectory],
        sensor_sigma={"angle": 1e-2},
        **options,
    )


def turned(kind="hinge"):
    """Return values, and how far (rad) they turn the wheel in all, which is more than a turn."""
    values = {"dof_damping": 5e-3}
    problem = wheel_problem(np.zeros(FRAMES), kind=kind)
    return values, predict(problem, values)[0].sensors["angle"][:, 0]


@pytest.mark.parametrize("zero", [0.0, np.pi])  # of the turn that is read: -pi to pi, 0 to 2 pi
def test_angles_that_are_read_within_a_turn_are_as_good_as_others(zero):
    values, whole = turned()
    assert whole[-1] > 2 * np.pi > np.pi > np.abs(np.diff(whole)).max() * 2
    read = within_a_turn(whole - zero) + zero
    read[[5, 17]] = np.nan
    problem = wheel_problem(read)
    assert fit(problem, starts=0)["dof_damping"].value == pytest.approx(5e-3, rel=1e-5)
    (prediction,) = predict(problem, values)
    assert np.nanmax(np.abs(prediction.sensor_errors["angle"])) < 1e-9


def test_several_turns_that_are_counted_stay_so():
    """An encoder that counts turns is off by one where it is off by one."""
    values, whole = turned()
    (prediction,) = predict(wheel_problem(whole + 2 * np.pi), values)
    np.testing.assert_allclose(prediction.sensor_errors["angle"], -2 * np.pi, rtol=1e-9)


def test_a_slide_has_no_turns():
    """A cart that is read to be carried back by 5 m was carried back."""
    values, moved = turned("slide")
    jump = np.where(TIME < 0.2, 2.5, -2.5)
    (prediction,) = predict(wheel_problem(jump, kind="slide"), values)
    np.testing.assert_allclose(prediction.sensor_errors["angle"][:, 0], moved - jump, rtol=1e-12)
    assert np.abs(moved - jump).max() > np.pi


def pair_problem(trajectories, **options):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(PAIR))
    engine.set_materials(dict.fromkeys(("first", "second"), dashpot.Material(5e4)))
    unknown = [
        Parameter.material(("first", "second"), "damping_ratio", start=0.4, bounds=(0.05, 2.0))
    ]
    given = {"sensor_sigma": {"angle": 5e-3}, "initial_state": "pose_and_velocity", **options}
    return Problem(engine, unknown, trajectories, 1e-3, 5e-3, **given)


def thrown(seed, *, angle=2.5, rate=4.0):
    """Return a toss of the pair by the engine, its angle read within a turn, and its start."""
    engine = pair_problem([blank()]).build({"damping_ratio": 0.6})
    generator = np.random.default_rng(seed)
    data = engine.make_data()
    data.qpos[3:7] = generator.normal(size=4)
    data.qpos[3:7] /= np.linalg.norm(data.qpos[3:7])
    data.qpos[7] = angle
    data.qvel[:] = [*generator.normal(0.0, 0.5, 3), *generator.normal(0.0, 3.0, 3), rate]
    start = data.qpos.copy(), data.qvel.copy()
    rows = [data.qpos.copy()]
    for _ in range(FRAMES - 1):
        engine.step(data, 2)
        rows.append(data.qpos.copy())
    rows = np.array(rows)
    read = {"angle": within_a_turn(rows[:, 7])}
    toss = Trajectory(f"toss {seed}", TIME, rows[:, :3], rows[:, 3:7], "first", sensors=read)
    return toss, start


def blank():
    still = np.tile([0.0, 0.0, 0.4], (FRAMES, 1)), np.tile([1.0, 0, 0, 0], (FRAMES, 1))
    return Trajectory("blank", TIME, *still, "first", sensors={"angle": np.zeros(FRAMES)})


@pytest.mark.parametrize(("angle", "rate"), [(2.5, 4.0), (-3.1, -6.0), (0.5, 0.0)])
def test_joints_start_where_their_readings_do(angle, rate):
    toss, _ = thrown(0, angle=angle, rate=rate)
    problem = pair_problem([toss])
    qpos, qvel = problem.initial_states(problem.build(problem.start).model)
    # In five frames of 10 ms the other motions change the rate by some tenths.
    assert abs(qpos[0, 7] - angle) < 0.01
    assert abs(qvel[0, 6] - rate) < 0.5
    zero = Parameter.offset("angle", bounds=(-9.0, 9.0))
    # As if it had no noise, a reading is no start; and an unknown zero makes it another angle.
    for other in (
        pair_problem([toss], initial_state="velocity"),
        replace(problem, parameters=[*problem.parameters, zero]),
    ):
        qpos, _ = other.initial_states(problem.build(problem.start).model)
        assert qpos[0, 7] == 0.0


@pytest.mark.parametrize("clearance", [0.003, 0.03])
def test_a_flight_ends_before_the_first_contact(clearance):
    """A ball that falls from rest is nearer than the clearance after sqrt(2 (h - c) / g)."""
    ball = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom type="plane" size="5 5 .1"/>
        <body name="ball" pos="0 0 .3"><freejoint/><geom size=".05"/><geom size=".01"/></body>
        </worldbody></mujoco>"""
    )
    height = np.maximum(0.3 - 0.5 * 9.81 * TIME**2, 0.05)
    position = np.column_stack([np.zeros((FRAMES, 2)), height])
    fall = Trajectory("fall", TIME, position, None, "ball")
    last = np.sqrt(2.0 * (0.25 - clearance) / 9.81)
    assert flight_frames(fall, ball, clearance) == np.ceil(last * RATE)


def test_flights_tell_the_start_whatever_the_contact():
    throws, starts = zip(*(thrown(seed) for seed in range(3)), strict=True)
    # Two frames of the first toss are off by ten standard deviations.
    held = throws[0].position.copy()
    held[:2] += 0.01
    throws = [replace(throws[0], position=held), *throws[1:]]
    tossed = with_flights(pair_problem(throws))  # with a damping ratio that is wrong
    assert tossed.initial_state == "given"
    for trajectory, (qpos, qvel) in zip(tossed.trajectories, starts, strict=True):
        np.testing.assert_allclose(trajectory.initial_qpos, qpos, atol=1e-4)
        np.testing.assert_allclose(trajectory.initial_qvel, qvel, atol=5e-3)
    # What was simulated is predicted, through contact to the end.
    for prediction in predict(tossed, {"damping_ratio": 0.6})[1:]:
        assert np.abs(prediction.position_error).max() < 1e-3
        assert np.abs(prediction.sensor_errors["angle"]).max() < 0.05


def test_what_is_no_flight_is_refused():
    toss, _ = thrown(0)
    with pytest.raises(ValueError, match="'toss 0': 0 frames come before the first contact"):
        with_flights(pair_problem([toss]), clearance=1.0)
    with pytest.raises(ValueError, match="initial_state='pose_and_velocity'"):
        with_flights(pair_problem([started(0)], initial_state="given"))
    with pytest.raises(ValueError, match="clearance must be > 0 m, got 0"):
        with_flights(pair_problem([toss]), clearance=0)


def started(seed):
    toss, (qpos, qvel) = thrown(seed)
    return replace(toss, initial_qpos=qpos, initial_qvel=qvel)


def test_tosses_with_a_hinge_are_fitted_and_others_predicted():
    problem = pair_problem([started(seed) for seed in range(4)], initial_state="given")
    study = tosses.fit_and_predict(problem, fitted=2, width=0.1, max_evaluations=40)
    # The search ends where its budget does.
    assert study.fit["damping_ratio"].value == pytest.approx(0.6, rel=0.05)
    # With the damping ratio of the start these are several times as large.
    seen, unseen = tosses.split(problem.trajectories, 2, seed=0)
    assert study.fit.problem.trajectories == tuple(seen)
    others = replace(problem, trajectories=unseen)
    before = tosses.errors_of(others, problem.start, 0.1)
    assert study.unseen.mean_position < 0.3 * before.mean_position
    assert study.unseen.mean_rotation < 0.3 * before.mean_rotation
    assert study.unseen.mean_hinge < 0.3 * before.mean_hinge


def test_errors_of_hinges_are_those_of_the_shorter_way_round():
    """Of two tosses alike but for the zero of the encoder, by 350 degrees, one is off by 10."""
    given = started(0)
    shifted = {"angle": given.sensors["angle"] + np.deg2rad(350.0)}
    pair = [given, replace(given, name="other zero", sensors=shifted)]
    problem = pair_problem(pair, initial_state="given")
    errors = tosses.errors_of(problem, {"damping_ratio": 0.6}, 0.1)
    np.testing.assert_allclose(errors.hinge, [0.0, 10.0], atol=1e-6)
    bare = [replace(t, sensors={}) for t in pair]
    without = tosses.errors_of(replace(problem, trajectories=bare), {"damping_ratio": 0.6}, 0.1)
    assert np.isnan(without.hinge).all()
