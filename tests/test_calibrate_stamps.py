"""Calibration: stamps that jitter about even frames, clocks that vary, and windows of time."""

import warnings
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from dashpot import Engine, Material
from dashpot.calibrate import Parameter, Problem, Trajectory, fit

GRAVITY, RATE = 9.81, 120.0
DROP = f"""<mujoco><option timestep="0.0042" gravity="0 0 -{GRAVITY}"/><worldbody>
  <geom name="floor" type="plane" size="9 9 1"/>
  <body name="ball" pos="0 0 .6"><freejoint/><geom name="ball" size=".1" mass="1"/></body>
  </worldbody></mujoco>"""


def bounces(time, restitution=0.9, height=0.5):
    """Return positions (n, 3) of a ball that flies and bounces off something rigid, exactly."""
    z = height - 0.5 * GRAVITY * time**2
    impact = np.sqrt(2 * height / GRAVITY)
    flight = 2.0 * impact
    while impact < time.max():
        flight *= restitution
        since = time - impact
        z = np.where(since >= 0, 0.5 * GRAVITY * since * (flight - since), z)
        impact += flight
    return np.c_[1.5 * time, -0.4 * time, z + 0.1]


def filmed(number, stamp, noise=1e-3, frames="even", seed=0, true=None):
    """Return a trajectory of frames whose numbers on an even grid, or true times, are given."""
    position = bounces(np.asarray(number) / RATE if true is None else true)
    position += noise * np.random.default_rng(1000 + seed).normal(size=position.shape)
    return Trajectory("rally", stamp, position, None, "ball", frames=frames)


def jittered(number, jitter, seed):
    """Return stamps that normal jitter, in spacings, moves about an even grid."""
    moved = jitter * np.random.default_rng(seed).normal(size=len(number))
    return np.maximum.accumulate((number + moved) / RATE)


@pytest.mark.parametrize("jitter", [0.1, 0.2, 0.3])
@pytest.mark.parametrize("frames", [20, 60, 200])
@pytest.mark.parametrize("seed", range(4))
def test_even_frames_with_jittered_stamps_are_on_the_grid(jitter, frames, seed):
    number = np.arange(frames)
    trajectory = filmed(number, jittered(number, jitter, seed), seed=seed)
    np.testing.assert_array_equal(trajectory.frame_number, number)
    # A line through n stamps knows its slope to sqrt(12 / n^3) of their jitter.
    error = 4.0 * jitter / RATE * np.sqrt(12 / frames**3)
    assert trajectory.spacing == pytest.approx(1 / RATE, abs=error)
    even = trajectory.time[0] + trajectory.spacing * number
    np.testing.assert_allclose(trajectory.time, even, rtol=0, atol=1e-12)


@pytest.mark.parametrize("frames", [60, 200, 600])
@pytest.mark.parametrize("seed", range(4))
def test_frames_lost_between_jittered_stamps_leave_gaps(frames, seed):
    rng = np.random.default_rng(seed)
    kept = np.sort(rng.choice(np.arange(1, frames), int(0.9 * frames), replace=False))
    number = np.concatenate([[0], kept])
    trajectory = filmed(number, jittered(number, 0.1, seed), seed=seed)
    np.testing.assert_array_equal(trajectory.frame_number, number)


def held_up(number):
    """Four frames that wait for a fifth, and arrive with it."""
    stamp = number / RATE
    stamp[30:34] = stamp[34] - 1e-4 * np.arange(4, 0, -1)
    return stamp


@pytest.mark.parametrize(
    "stamps",
    [
        held_up,
        lambda number: np.ceil(number / RATE * 100) / 100,  # by a loop at 100 Hz: some are equal
        lambda number: (number + 0.4 * (number % 2)) / RATE,  # two at a time
        lambda number: (number + np.random.default_rng(0).exponential(0.3, len(number))) / RATE,
        lambda number: 1.7e9 + jittered(number, 0.2, 1),
    ],
    ids=["held up", "coarse", "in pairs", "late", "time of day"],
)
def test_stamps_of_busy_computers_are_those_of_even_frames(stamps):
    number = np.arange(80)
    np.testing.assert_array_equal(filmed(number, stamps(number)).frame_number, number)


@pytest.mark.parametrize("jitter", [0.15, 0.25])
@pytest.mark.parametrize("noise", [1e-4, 2e-3])
@pytest.mark.parametrize("seed", range(4))
def test_refusal_of_jittered_stamps_names_even_frames(jitter, noise, seed):
    number = np.arange(60)
    stamp = jittered(number, jitter, seed)
    with pytest.raises(
        ValueError, match=r"'rally': .* frames look even, and their stamps jit.*'even'"
    ):
        filmed(number, stamp, noise, "stamped", seed)


@pytest.mark.parametrize("seed", range(4))
def test_jitter_of_what_hardly_moves_is_told_by_neighbouring_intervals(seed):
    """What is late one interval gains, and the next one loses: a correlation of -1/2."""
    number = np.arange(150)
    stamp = jittered(number, 0.25, seed)
    still = np.zeros((150, 3))
    with pytest.raises(ValueError, match=r"correlation of -0\.[3-7]\d\. Say frames='even'"):
        Trajectory("still", stamp, still, None, "ball")
    even = Trajectory("still", stamp, still, None, "ball", frames="even")
    np.testing.assert_array_equal(even.frame_number, number)


@pytest.mark.parametrize("spread", [0.3, 0.5])
@pytest.mark.parametrize("frames", [25, 60, 300])
@pytest.mark.parametrize("seed", range(4))
def test_a_clock_that_varies_is_not_even(spread, frames, seed):
    rng = np.random.default_rng(seed)
    true = np.cumsum(rng.uniform(1 - spread, 1 + spread, frames)) / RATE
    with pytest.raises(ValueError, match=r"'rally': frames='even', but .*clock itself varies"):
        filmed(None, true, 1e-4, "even", seed, true)
    with pytest.raises(ValueError, match=r"[Rr]esample or split the trajectory$"):
        filmed(None, true, 1e-4, "stamped", seed, true)


def test_times_that_hardly_jitter_are_taken_either_way():
    number = np.arange(50)
    stamp = np.round(number / RATE, 3)
    for frames in ("even", "stamped"):
        trajectory = filmed(number, stamp, frames=frames)
        np.testing.assert_array_equal(trajectory.frame_number, number)


def test_frames_are_even_or_stamped():
    with pytest.raises(ValueError, match=r"'rally': frames must be 'stamped' or 'even', got 'od"):
        filmed(np.arange(20), np.arange(20) / RATE, frames="odd")


def test_even_frames_stay_so_in_copies_with_changes():
    number = np.arange(60)
    trajectory = filmed(number, jittered(number, 0.3, 0))
    changed = replace(trajectory, name="other", initial_qvel=np.zeros(6))
    np.testing.assert_allclose(changed.time, trajectory.time, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(changed.frame_number, number)


@pytest.mark.parametrize("jitter", [0.2, 0.3])
def test_restitution_of_a_filmed_ball_needs_no_right_stamps(jitter):
    """As stamped, 3 m/s times the jitter would be 6 mm of noise in place of 1 mm."""
    engine = Engine(mujoco.MjModel.from_xml_string(DROP))
    engine.set_pair_material("ball", "floor", Material(stiffness=1e8, restitution=0.7, friction=0))
    number = np.arange(100)
    ball = filmed(number, jittered(number, jitter, 3))
    unknown = Parameter.pair("ball", "floor", "restitution", start=0.8, bounds=(0.1, 0.99))
    problem = Problem(engine, [unknown], [ball], 1e-3, np.inf, initial_state="pose_and_velocity")
    result = fit(problem, starts=0)
    assert result["restitution"].lower < 0.9 < result["restitution"].upper
    assert result["restitution"].value == pytest.approx(0.9, abs=0.005)


@pytest.mark.parametrize("seed", range(5))
def test_a_rate_that_is_known_is_kept(seed):
    """Times are then off all together, by the mean of the jitter: sqrt(1 / n) of it."""
    number = np.delete(np.arange(50), [7, 30])
    stamp = 5.0 + jittered(number, 0.1, seed)
    position = bounces(number / RATE)
    ball = Trajectory("ball", stamp, position, None, "ball", frames="even", rate=RATE)
    assert ball.spacing == 1 / RATE
    np.testing.assert_array_equal(ball.frame_number, number)
    late = ball.time - 5.0 - number / RATE
    np.testing.assert_allclose(late, late[0], rtol=0, atol=1e-12)
    assert abs(late[0]) < 4 * 0.1 / RATE / np.sqrt(48)
    for rate, frames, message in (
        (60.0, "even", r"rate is 60 frames a second, but there are 1\d\d\.?\d* a second by their"),
        (RATE, "stamped", "rate is of even frames: say frames='even'"),
        (-1.0, "even", "rate must be > 0 frames a second, got -1.0"),
    ):
        with pytest.raises(ValueError, match=message):
            Trajectory("ball", stamp, position, None, "ball", frames=frames, rate=rate)


def test_quaternions_may_have_the_scalar_last():
    turned = np.array([0.1, 0.2, 0.3, np.sqrt(0.86)])
    trajectory = Trajectory(
        "box", [0, 1, 2], np.zeros((3, 3)), np.tile(turned, (3, 1)), "box", quaternion_order="xyzw"
    )
    np.testing.assert_allclose(trajectory.quaternion[1, 0], np.roll(turned, 1))
    with pytest.raises(ValueError, match="quaternion_order must be 'wxyz' or 'xyzw', got 'zyx'"):
        Trajectory("box", [0, 1], np.zeros((2, 3)), None, "box", quaternion_order="zyx")


def test_quaternions_may_be_left_out():
    trajectory = Trajectory("ball", [0, 1, 2], np.zeros((3, 3)), None, "ball")
    np.testing.assert_array_equal(trajectory.measured[0, 0], [1, 1, 1, 0, 0, 0])


def recorded():
    """Return 40 frames, two of them lost, with controls and a sensor."""
    number = np.delete(np.arange(42), [5, 20])
    return Trajectory(
        "push", number / 100, np.zeros((40, 3)) + number[:, None], None, "ball",
        initial_qpos=[0, 0, 0, 1, 0, 0, 0], initial_qvel=np.zeros(6), initial_qvel_sigma=1.0,
        control=np.arange(39)[:, None], sensors={"load": number},
    )  # fmt: skip


def test_a_window_round_an_event_keeps_its_frames_controls_and_sensors():
    window = recorded().between(0.15, 0.30)
    number = np.array([15, 16, 17, 18, 19, *range(21, 31)])
    np.testing.assert_array_equal(window.time, number / 100)
    np.testing.assert_array_equal(window.frame_number, number - 15)
    np.testing.assert_array_equal(window.sensors["load"][:, 0], number)
    np.testing.assert_array_equal(window.position[:, 0, 2], number)
    # Rows of controls are by interval: the frame of number 15 is the 14th, one being lost before.
    np.testing.assert_array_equal(window.control[:, 0], np.arange(14, 28))
    assert window.initial_qpos is None
    assert window.initial_qvel is None
    assert window.initial_qvel_sigma is None
    assert window.between(0.19, 0.21).frames == 2


def test_a_window_from_the_first_frame_keeps_the_initial_state():
    whole = recorded()
    assert whole.between(-1.0, 9.0) is whole
    window = whole.between(0.0, 0.2)
    np.testing.assert_array_equal(window.initial_qpos, whole.initial_qpos)


def test_a_window_without_frames_is_refused():
    with pytest.raises(
        ValueError, match=r"'push': 1 frames are between 0.05 and 0.06 s, of those "
    ):
        recorded().between(0.05, 0.06)
    with pytest.raises(TypeError, match="'push': end must be a number"):
        recorded().between(0.05, "1")


def test_a_fit_of_a_window_starts_where_it_does():
    """One bounce of four: the velocity at the cut is read from the frames that follow it."""
    number = np.arange(140)
    ball = filmed(number, number / RATE, frames="stamped").between(0.6, 1.15)
    engine = Engine(mujoco.MjModel.from_xml_string(DROP))
    engine.set_pair_material("ball", "floor", Material(stiffness=1e8, restitution=0.7, friction=0))
    unknown = Parameter.pair("ball", "floor", "restitution", start=0.8, bounds=(0.1, 0.99))
    problem = Problem(engine, [unknown], [ball], 1e-3, np.inf, initial_state="pose_and_velocity")
    result = fit(problem, starts=0)
    assert result["restitution"].value == pytest.approx(0.9, abs=0.02)


@pytest.mark.parametrize("frames", ["stamped", "even"])
def test_a_clock_that_stands_is_said_without_a_warning(frames):
    """All frames but two have one stamp: no spacing is left of the others."""
    time = np.array([0.0, *[0.01] * 60, 0.02])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ValueError, match="time"):
            Trajectory("ball", time, np.zeros((62, 3)), None, "ball", frames=frames)
