"""Calibration from part of the motion: heights alone, frames that were lost."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import dashpot
from ball_throws import IDENTITY, make_trajectory
from dashpot.calibrate import Parameter, Problem, Trajectory, fit
from dashpot.calibrate.residuals.objective import Objective

BALL = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body name="ball" pos="0 0 .4"><freejoint/><geom name="ball" size=".03" mass=".05"/></body>
  </worldbody>
</mujoco>
"""
TRUTH = {"stiffness": 8e3, "restitution": 0.75}
RATE, SUBSTEPS, NOISE = 120.0, 3, 1e-3  # Hz, steps a frame, m


def unknown():
    return [
        Parameter.pair("ball", "floor", "stiffness", start=2e3, bounds=(1e2, 1e6)),
        Parameter.pair("ball", "floor", "restitution", start=0.5, bounds=(0.05, 0.99)),
    ]


def bounces(frames=150):
    """Return times and positions of a ball that falls and bounces six times."""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL))
    engine.set_pair_material(
        "ball",
        "floor",
        dashpot.Material(TRUTH["stiffness"], restitution=TRUTH["restitution"]),
    )
    engine.model.opt.timestep = 1.0 / RATE / SUBSTEPS
    data = engine.make_data()
    position = np.empty((frames, 3))
    for k in range(frames):
        position[k] = data.qpos[:3]
        engine.step(data, SUBSTEPS)
    noise = NOISE * np.random.default_rng(3).normal(size=position.shape)
    return np.arange(frames) / RATE, position + noise


def problem(trajectory, position_sigma=(math.inf, math.inf, NOISE)):
    return Problem(
        dashpot.Engine(mujoco.MjModel.from_xml_string(BALL)),
        unknown(),
        [trajectory],
        position_sigma=position_sigma,
        rotation_sigma=math.inf,
        substeps=SUBSTEPS,
        initial_state="pose_and_velocity",
    )


def assert_recovers(result):
    assert result.noise_explains
    for name, value in TRUTH.items():
        assert result[name].identified, result[name].statement
        # Three standard errors: of two estimates one in 200 is farther off.
        assert abs(result[name].value - value) < 3.0 * result[name].standard_error


def whole(frames=150):
    time, position = bounces(frames)
    return Trajectory("drop", time, position, np.tile(IDENTITY, (frames, 1)), "ball")


def blinking(trajectory, kept):
    """Return the trajectory with NaN in the frames that are not kept."""
    lost = ~kept[:, None, None]
    return replace(
        trajectory,
        position=np.where(lost, np.nan, trajectory.position),
        quaternion=np.where(lost, np.nan, trajectory.quaternion),
    )


def shortened(trajectory, kept):
    """Return the trajectory without the frames that are not kept."""
    return replace(
        trajectory,
        time=trajectory.time[kept],
        position=trajectory.position[kept],
        quaternion=trajectory.quaternion[kept],
    )


def test_heights_alone_tell_how_a_ball_bounces():
    """Along what heights do not tell, differences of residuals are rounding: nothing goes there."""
    trajectory = whole()
    position = trajectory.position * [0.0, 0.0, 1.0]
    result = fit(problem(replace(trajectory, position=position)))
    assert_recovers(result)
    for states in (result.initial_velocity, result.initial_displacement):
        assert not np.delete(states[0], 2).any()


@pytest.mark.parametrize("lose", [blinking, shortened])
def test_residuals_of_the_frames_that_were_not_lost_stay(lose):
    kept = np.random.default_rng(1).uniform(size=150) > 0.2
    kept[[0, 60, 61, 62, 63]] = True, False, False, False, False
    trajectory = whole()
    every, some = (Objective(problem(t)) for t in (trajectory, lose(trajectory, kept)))
    point = every.start()
    expected = every.residuals(point).reshape(-1, 6)
    found = some.residuals(point).reshape(-1, 6)
    if lose is blinking:
        assert not found[~kept].any()
        found = found[kept]
    np.testing.assert_allclose(found, expected[kept], rtol=1e-9, atol=1e-9)  # of times, rounded
    assert some.measured_count == np.count_nonzero(kept)
    assert some.live(some.residuals(point)[0]).sum() == np.count_nonzero(kept)


def test_lost_frames_leave_a_fit_what_the_others_say():
    kept = np.random.default_rng(2).uniform(size=150) > 0.2
    kept[:3] = False, True, True
    result = fit(problem(blinking(whole(), kept), position_sigma=NOISE), starts=0)
    assert_recovers(result)
    assert result.live_residuals == 3 * np.count_nonzero(kept)
    # The root mean square of three coordinates of noise, to three of its standard deviations.
    rms = NOISE * math.sqrt(3.0)
    assert abs(result.metrics()["position_rms"] - rms) < 3.0 * rms / math.sqrt(6.0 * 120)
    (prediction,) = result.predict()
    lost = np.isnan(prediction.trajectory.position)
    np.testing.assert_array_equal(np.isnan(prediction.position_error), lost)
    assert np.isfinite(prediction.position).all()
    result.plot()


def test_a_start_that_was_lost_is_that_of_the_line_through_the_first_frames_seen():
    """Two frames of free fall tell where it began: v = 0.3 m/s sideways, from 1 m."""
    time = 0.01 * np.arange(10)
    position = np.c_[0.3 * time, 0.0 * time, 1.0 - 0.5 * 9.81 * time**2]
    position[:3] = np.nan
    trajectory = make_trajectory(
        time=time, position=position, quaternion=np.full((10, 4), np.nan), bodies="ball",
        initial_qvel=None,
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string(BALL)
    qpos, qvel = problem(trajectory, NOISE).initial_states(model)
    np.testing.assert_allclose(qpos[0], [0, 0, 1, *IDENTITY], atol=1e-12)
    np.testing.assert_allclose(qvel[0], [0.3, 0, 0, 0, 0, 0], atol=1e-12)
    with pytest.raises(ValueError, match=r"'throw 7': body 'ball' was not measured in the first"):
        replace(problem(trajectory, NOISE), initial_state="velocity")


SEEN_IN = {
    "rotation in other frames than position": ([0, 0, 0], 1),
    "rotation in flight not at all": ([0, 0, 0], None),
    "a camera of each axis in turn": ([0, 1, 2], 0),
}


@pytest.mark.parametrize(("first", "turned"), SEEN_IN.values(), ids=SEEN_IN)
def test_a_throw_is_guessed_from_what_was_seen_of_each_coordinate(first, turned):
    """Position and rotation lost in different frames are never seen together; each has its line.

    A ball flies from 1 m at 2 m/s sideways and 1 m/s up, spinning at 20 rad/s, and after 0.3 s
    something stops it.
    """
    velocity, spin, frames = np.array([2.0, 0.0, 1.0]), np.array([0.0, 20.0, 0.0]), 60
    time = 0.01 * np.arange(frames)
    flight = np.minimum(time, 0.3)[:, None]
    position = [0, 0, 1] + flight * velocity - 0.5 * flight**2 * [0, 0, 9.81]
    quaternion = np.tile(IDENTITY, (frames, 1))
    for q, t in zip(quaternion, time, strict=True):
        mujoco.mju_quatIntegrate(q, spin, t)
    every = 1 + max(*first, turned or 0)
    for k in range(3):
        position[np.arange(frames) % every != first[k], k] = np.nan
    if turned is None:
        quaternion[time < 0.4] = np.nan
    else:
        quaternion[np.arange(frames) % every != turned] = np.nan
    trajectory = make_trajectory(
        time=time, position=position, quaternion=quaternion, bodies="ball", initial_qvel=None
    )
    model = mujoco.MjModel.from_xml_string(BALL)
    throw = replace(problem(trajectory, NOISE), rotation_sigma=NOISE)
    qpos, qvel = throw.initial_states(model)
    np.testing.assert_allclose(qvel[0], [*velocity, *spin], atol=1e-9)
    np.testing.assert_allclose(qpos[0], [0, 0, 1, *IDENTITY], atol=1e-9)
    robust, displacement = throw.robust_guesses(model, qvel)
    np.testing.assert_allclose(robust[0], [*velocity, *spin], atol=1e-9)
    np.testing.assert_allclose(displacement[0], 0.0, atol=1e-9)


def test_the_line_of_one_coordinate_ends_where_that_of_another_does():
    """A ball that bounces at 0.1 s goes on sideways a little slower: heights say where to stop."""
    frames, hit = 60, 10
    after = np.maximum(0.01 * (np.arange(frames) - hit), 0.0)
    time = 0.01 * np.arange(frames)
    position = np.c_[time - 0.03 * after, 0.0 * time, 1.0 - 0.5 * 9.81 * time**2 + 6.0 * after]
    position[1::2, 0] = np.nan
    trajectory = make_trajectory(
        time=time, position=position, quaternion=np.full((frames, 4), np.nan), bodies="ball",
        initial_qvel=None,
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string(BALL)
    throw = problem(trajectory, NOISE)
    robust, _ = throw.robust_guesses(model, throw.initial_states(model)[1])
    np.testing.assert_allclose(robust[0], [1, 0, 0, 0, 0, 0], atol=1e-9)


def test_controls_hold_through_a_gap():
    """A force of 2, then 6 N on 4 kg at rest, the frame between lost: Euler steps of 0.01 s."""
    model = mujoco.MjModel.from_xml_string(
        """
        <mujoco>
          <option timestep="0.01" gravity="0 0 0"/>
          <worldbody>
            <body name="cart"><joint name="x" type="slide" axis="1 0 0"/>
              <geom size="1" mass="4"/></body>
          </worldbody>
          <actuator><motor joint="x"/></actuator>
        </mujoco>
        """
    )
    trajectory = make_trajectory(
        time=[0.0, 0.1, 0.3, 0.4], position=np.zeros((4, 3)), quaternion=np.tile(IDENTITY, (4, 1)),
        bodies="cart", initial_qvel=[0.0], control=[[2.0], [6.0], [0.0]],
    )  # fmt: skip
    mass = Parameter.model("body_mass", "cart", start=4.0, bounds=(1.0, 10.0))
    objective = Objective(Problem(model, [mass], [trajectory], 1.0, 1.0))
    v = 0.01 * np.cumsum(np.repeat([2.0, 6.0, 6.0, 0.0], 10) / 4.0)
    expected = np.concatenate([[0.0], 0.01 * np.cumsum(v)])[[0, 10, 30, 40]]
    found = objective.residuals(objective.start()).reshape(4, 6)[:, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_long_gaps_count_right_in_times_rounded_to_milliseconds():
    number = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 40, 41, 42, 43, 44, 45, 46])
    lines = [len(number), 3]
    trajectory = make_trajectory(
        time=np.round(number / 240.0, 3),
        position=np.zeros(lines), quaternion=np.tile(IDENTITY, (len(number), 1)),
    )  # fmt: skip
    np.testing.assert_array_equal(trajectory.frame_number, number)
    assert "31 left out" in repr(trajectory)


def of_frames(number, rate=100.0, decimals=9):
    """Return a trajectory of some frames of a clock, whose times are rounded."""
    return make_trajectory(
        time=np.round(np.asarray(number) / rate, decimals),
        position=np.zeros((len(number), 3)),
        quaternion=np.tile(IDENTITY, (len(number), 1)),
    )


@pytest.mark.parametrize(("rate", "decimals"), [(100.0, 9), (120.0, 3)])
@pytest.mark.parametrize("lost", [40, 50, 60])
@pytest.mark.parametrize("seed", range(10))
def test_frames_lost_at_random_leave_the_clock_known(seed, lost, rate, decimals):
    """Of 100 frames half are lost: most intervals are of two spacings and more."""
    rng = np.random.default_rng(seed)
    number = np.sort(rng.choice(100, 100 - lost, replace=False))
    trajectory = of_frames(number, rate, decimals)
    np.testing.assert_array_equal(trajectory.frame_number, number - number[0])
    assert trajectory.spacing == pytest.approx(1.0 / rate, rel=1e-3)


def test_two_of_three_frames_lost_in_a_pattern_leave_the_clock_known():
    number = np.cumsum([0, *([2, 2, 1] * 10)])
    np.testing.assert_array_equal(of_frames(number).frame_number, number)


@pytest.mark.parametrize("seed", range(5))
def test_times_of_no_grid_are_refused(seed):
    """Triggered by hand, or by events: no finer grid is made up for them."""
    time = np.cumsum(np.random.default_rng(seed).uniform(0.005, 0.015, size=60))
    with pytest.raises(ValueError, match=r"before time.* No even grid, lost frames left out"):
        of_frames(time, rate=1.0)


@pytest.mark.parametrize("first", [[0, 2, 4, 6, 8], [0, 3, 5, 6, 7]])
def test_heads_of_frames_lost_early_stay_on_the_grid_of_the_whole(first):
    """Every second frame of the first, or intervals of 3, 2 and 1: few frames tell no spacing."""
    number = np.array([*first, *range(9, 60)])
    time, position = bounces(60)
    trajectory = Trajectory(
        "drop", time[number], position[number], np.tile(IDENTITY, (len(number), 1)), "ball",
        control=np.zeros((len(number) - 1, 0)), sensors={},
    )  # fmt: skip
    head = trajectory.head(time[first[-1]])
    np.testing.assert_array_equal(head.frame_number, first)
    np.testing.assert_array_equal(head.time, trajectory.time[:5])
    assert head.control.shape == (4, 0)
    assert head.spacing == trajectory.spacing
    assert repr(head).startswith(f"Trajectory('drop', 5 frames {1 / RATE:.6g} s apart (")
    assert head.head(time[first[1]]).frames == 2
    whole_problem = problem(trajectory, NOISE)
    objectives = [
        Objective(whole_problem.with_window(window)) for window in (None, time[first[-1]])
    ]
    every, some = (o.residuals(o.start())[0] for o in objectives)
    np.testing.assert_array_equal(some, every[: 5 * 6])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"quaternion": np.where(np.arange(20) == 7, np.nan, 0.5).reshape(5, 4)},
         "quaternion of frame 1, body 'body' is nan in part"),
        ({"position": np.full((5, 3), np.nan), "quaternion": np.full((5, 4), np.nan)},
         "all positions and quaternions are nan"),
    ],
)  # fmt: skip
def test_what_cannot_have_been_measured_is_named(changes, message):
    with pytest.raises(ValueError, match=rf"trajectory 'throw 7': {message}"):
        make_trajectory(**changes)


def test_nothing_left_of_a_trajectory_is_named():
    trajectory = replace(whole(5), position=np.full((5, 3), np.nan))
    with pytest.raises(ValueError, match="trajectory 'drop': nothing that was measured is left"):
        problem(trajectory)
