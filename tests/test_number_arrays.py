"""Arrays that hold something else than real numbers are refused, not read as some."""

import mujoco
import numpy as np
import pytest

import dashpot
from ball_throws import IDENTITY, ball_engine, ball_parameters, make_trajectory
from dashpot.calibrate import Problem

FRAMES = 5
DATES = np.datetime64("2026-01-01T00:00:00", "ms") + 100 * np.arange(FRAMES)
NO_NUMBERS = [
    DATES,
    DATES - DATES[0],
    np.arange(FRAMES) + 0j,
    np.arange(FRAMES) > 2,
    np.arange(FRAMES).astype(str),
    np.array([b"0", b"1", b"2", b"3", b"4"]),
    np.array([0.0, 0.1, "0.2", 0.3, 0.4], dtype=object),
    np.array([0.0, 0.1, True, 0.3, 0.4], dtype=object),
]


def masked_at(array, *index):
    """Return a masked array; beneath the mask lies what looks like a measurement."""
    masked = np.ma.masked_array(array, mask=np.zeros(np.shape(array), dtype=bool))
    masked[index] = np.ma.masked
    return masked


@pytest.mark.parametrize("time", NO_NUMBERS, ids=lambda a: str(a.dtype))
def test_dates_and_text_are_no_times_in_seconds(time):
    """Milliseconds of a clock would count as seconds: frames 0.1 s apart as 100 s."""
    with pytest.raises(TypeError, match=r"^trajectory 'throw 7': time.* must be a"):
        make_trajectory(time=time)


@pytest.mark.parametrize("values", NO_NUMBERS, ids=lambda a: str(a.dtype))
@pytest.mark.parametrize("field", ["position", "quaternion", "initial_qvel", "control", "sensors"])
def test_what_is_no_number_was_not_measured_either(field, values):
    width = {"position": 3, "quaternion": 4}.get(field)
    entry = values if width is None else np.tile(values[:, None], width)
    changes = {"control": entry[:4, None], "sensors": {"touch": entry}}
    with pytest.raises(TypeError, match=rf"^trajectory 'throw 7': {field}.* must be a"):
        make_trajectory(**{field: changes.get(field, entry)})


def test_masked_poses_were_not_measured():
    position, quaternion = np.zeros((FRAMES, 3)), np.tile(IDENTITY, (FRAMES, 1))
    touch = np.arange(FRAMES)
    trajectory = make_trajectory(
        position=masked_at(position, 1),
        quaternion=masked_at(quaternion, 2),
        sensors={"touch": masked_at(touch, 3)},
    )
    assert trajectory.measured[:, 0, 0].tolist() == [True, False, True, True, True]
    assert trajectory.measured[:, 0, 3].tolist() == [True, True, False, True, True]
    assert np.isnan(trajectory.sensors["touch"][:, 0]).tolist() == [False] * 3 + [True, False]
    assert np.array_equal(trajectory.sensors["touch"][[0, 1, 2, 4], 0], [0.0, 1.0, 2.0, 4.0])
    whole = make_trajectory(position=np.ma.masked_array(position, mask=False))
    assert whole.measured.all()


def test_none_among_poses_was_not_measured():
    position = [[0.0, 0.0, 1.0], [None] * 3, [np.float32(0.5), 0, 1], [0, 0, 1], [0, 0, 1]]
    trajectory = make_trajectory(position=position)
    assert trajectory.measured[:, 0, 0].tolist() == [True, False, True, True, True]
    assert trajectory.position[2, 0].tolist() == [0.5, 0.0, 1.0]


def test_a_mask_within_a_list_counts():
    rows = [np.ma.masked_array([0.0, 0.0, 1.0], mask=[False, False, k == 2]) for k in range(FRAMES)]
    trajectory = make_trajectory(position=rows)
    assert trajectory.measured[:, 0, 2].tolist() == [True, True, False, True, True]


@pytest.mark.parametrize("field", ["time", "initial_qpos", "initial_qvel", "control"])
def test_what_has_to_be_known_cannot_be_masked(field):
    values = {
        "time": 0.01 * np.arange(FRAMES),
        "initial_qpos": np.array([0.0, 0, 1, 1, 0, 0, 0]),
        "initial_qvel": np.zeros(6),
        "control": np.zeros((FRAMES - 1, 1)),
    }[field]
    with_none = values.astype(object)
    with_none[2] = None
    for missing in (masked_at(values, 2), with_none):
        with pytest.raises(TypeError, match=rf"^trajectory 'throw 7': {field}\[2.*\] is missing"):
            make_trajectory(**{field: missing})


def test_states_that_are_no_numbers_are_not_rolled_out():
    engine = ball_engine()
    size = mujoco.mj_stateSize(engine.model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    state = np.zeros(size)
    state[4] = 1.0
    for wrong in (state.astype(str), state + 0j, state > 0.5):
        with pytest.raises(TypeError, match=r"^initial_state must be an array of numbers, got dt"):
            dashpot.rollout(engine, wrong)
    with pytest.raises(TypeError, match=r"^initial_state\[3\] is missing"):
        dashpot.rollout(engine, masked_at(state, 3))


def test_distances_at_complex_positions_are_refused():
    with pytest.raises(TypeError, match="must be an array of numbers, got dtype complex128"):
        dashpot.distances(ball_engine(), "ball", "floor", np.array([0, 0, 1, 1, 0, 0, 0]) + 5j)


def test_a_masked_restitution_has_no_damping_ratio():
    with pytest.raises(TypeError, match=r"\[1\] is missing"):
        dashpot.law.restitution_to_damping_ratio(masked_at(np.array([0.5, 0.5]), 1))


def test_durations_of_numpy_are_no_numbers():
    """NumPy registers them as integers; of nanoseconds float() makes counts."""
    duration = np.timedelta64(5, "ns")
    with pytest.raises(TypeError, match="stiffness must be a number"):
        dashpot.Material(duration)
    engine = ball_engine()
    with pytest.raises(TypeError, match="nstep must be an integer"):
        engine.step(engine.make_data(), duration)


def test_complex_start_states_are_refused():
    trajectory = make_trajectory()
    states = np.array([[0, 0, 1, 1, 0, 0, 0]]) + 1j, np.zeros((1, 6))
    problem = Problem(
        ball_engine(), ball_parameters(), [trajectory], 1e-3, 1e-2, start_states=lambda _: states
    )
    with pytest.raises(TypeError, match=r"^qpos of start_states must be an array of numbers"):
        problem.initial_states(ball_engine().model)
