"""What rollouts go on from: states with contact memory, kept without their zeros."""

import pickle

import mujoco
import numpy as np
import pytest

import dashpot

FULL_PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS
INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION
# A box that sticks to a slope, the same with a fingertip on a limit, and a stack that has landed.
BOX = """<body pos="0 0 .0301"><freejoint/><geom type="box" size=".05 .04 .03" mass=".4"/></body>"""
FLOOR = """<option timestep="0.004" gravity="3 0 -9"/>"""
FINGER = """<body pos="1 0 .3"><joint axis="0 1 0" range="-10 10" frictionloss=".01"/>
  <geom type="capsule" size=".02" fromto="0 0 0 .2 0 0" mass=".2"/></body>"""
CUBE = '<freejoint/><geom type="box" size=".05 .05 .05"/>'
STACK = "".join(f'<body pos="0 .5 {0.0501 + 0.1001 * i}">{CUBE}</body>' for i in range(3))
SCENES = {"box": BOX, "box and finger": BOX + FINGER, "stack": BOX + STACK}
STEPS = 40


def make_engine(bodies):
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string(
            f"<mujoco>{FLOOR}<worldbody><geom type='plane' size='2 2 .1'/>{bodies}</worldbody>"
            "</mujoco>"
        )
    )
    for geom in range(1, engine.model.ngeom):
        engine.set_material(geom, dashpot.Material(2e4, damping_ratio=0.5, friction=0.8))
    return engine


def get_state(engine, data, kind):
    state = np.empty(mujoco.mj_stateSize(engine.model, int(kind)))
    mujoco.mj_getState(engine.model, data, state, int(kind))
    return state


@pytest.fixture(params=SCENES)
def engine(request):
    return make_engine(SCENES[request.param])


def stepped(engine, steps):
    """Return the integration states of so many steps of one data."""
    data = engine.make_data()
    states = []
    for _ in range(steps):
        engine.step(data)
        states.append(get_state(engine, data, INTEGRATION))
    return np.array(states)


@pytest.mark.parametrize("kind", [FULL_PHYSICS, INTEGRATION])
def test_states_are_as_short_as_those_of_mujoco_unless_memory_is_asked_for(engine, kind):
    initial = get_state(engine, engine.make_data(), kind)
    for options in ({}, {"with_memory": False}):
        states, _ = dashpot.rollout(engine, initial, nstep=3, **options)
        assert isinstance(states, np.ndarray)
        assert states.shape == (1, 3, mujoco.mj_stateSize(engine.model, int(FULL_PHYSICS)))
    states, _ = dashpot.rollout(engine, initial, nstep=3, with_memory=True)
    assert states.shape == (1, 3, mujoco.mj_stateSize(engine.model, int(INTEGRATION)))


def test_a_rollout_goes_on_from_any_step_as_if_it_had_not_ended(engine):
    initial = get_state(engine, engine.make_data(), FULL_PHYSICS)
    expected = stepped(engine, STEPS)
    states, _ = dashpot.rollout(engine, np.tile(initial, (2, 1)), nstep=STEPS, with_memory=True)
    full = mujoco.mj_stateSize(engine.model, int(FULL_PHYSICS))
    for step in (0, 7, STEPS - 2):
        rest, _ = dashpot.rollout(engine, states[:, step], nstep=STEPS - step - 1)
        np.testing.assert_array_equal(rest[1], expected[step + 1 :, :full])
    for step in (0, 20, STEPS - 1):
        data = engine.make_data()
        mujoco.mj_setState(engine.model, data, states[1, step], int(INTEGRATION))
        engine.step(data)
        if step + 1 < STEPS:
            np.testing.assert_array_equal(
                get_state(engine, data, FULL_PHYSICS), expected[step + 1, :full]
            )


def test_the_last_state_has_memory_where_it_is_asked_for(engine):
    initial = np.tile(get_state(engine, engine.make_data(), FULL_PHYSICS), (3, 1))
    last = np.empty((3, mujoco.mj_stateSize(engine.model, int(INTEGRATION))))
    whole, _ = dashpot.rollout(engine, initial, nstep=STEPS)
    first, _ = dashpot.rollout(engine, initial, nstep=25, final_state=last)
    second, _ = dashpot.rollout(engine, last, nstep=STEPS - 25, final_state=last)
    np.testing.assert_array_equal(np.concatenate([first, second], axis=1), whole)
    with_memory, _ = dashpot.rollout(engine, initial, nstep=STEPS, with_memory=True)
    np.testing.assert_array_equal(last, with_memory[:, -1])
    # The memory tells: without it the boxes let go, and stick anew a little lower.
    forgetful, _ = dashpot.rollout(engine, first[:, -1], nstep=STEPS - 25)
    assert not np.array_equal(forgetful, second)


def test_memory_takes_as_much_as_touching_contacts_need(engine):
    """36 numbers each, with their places, beside what a state has without contacts."""
    initial = get_state(engine, engine.make_data(), FULL_PHYSICS)
    states, _ = dashpot.rollout(engine, initial, nstep=STEPS, with_memory=True)
    data = engine.make_data()
    touching = np.sum([engine.step(data).touching for _ in range(STEPS)])
    assert touching > 3 * STEPS
    rest = 150 * STEPS * engine.model.nbody
    assert states.nbytes <= 12 * (36 * touching + rest)
    assert states.nbytes < 0.25 * np.asarray(states).nbytes


def test_a_state_with_memory_is_kept_bit_for_bit():
    """A negative zero is a number, too: it tells where a spring was let go."""
    engine = make_engine(BOX)
    data = engine.make_data()
    data.qvel[:] = -0.0
    data.qpos[2] = 1.0
    data.qfrc_applied[1] = -0.0
    states, _ = dashpot.rollout(
        engine, get_state(engine, data, INTEGRATION), nstep=3, with_memory=True
    )
    dense = np.empty(states.shape)
    dashpot.rollout(engine, get_state(engine, data, INTEGRATION), with_memory=True, state=dense)
    assert np.asarray(states).tobytes() == dense.tobytes()
    assert np.signbit(dense[dense == 0.0]).any()


KEYS = [
    np.s_[0],
    np.s_[-1, 2],
    np.s_[1, 2, 3],
    np.s_[:, -1],
    np.s_[::2, 1:4],
    np.s_[..., 1:8],
    np.s_[..., 3],
    np.s_[:, [4, 0]],
    np.s_[[0, 2], [1, 3]],
    np.s_[[0, 2], :, 3],
    np.s_[:, :, [3, 1]],
    np.s_[np.array([True, False, True])],
    np.s_[2:2],
    np.s_[:],
]


@pytest.mark.parametrize("key", KEYS, ids=str)
def test_states_with_memory_read_as_an_array(key):
    engine = make_engine(BOX)
    initial = np.tile(get_state(engine, engine.make_data(), FULL_PHYSICS), (3, 1))
    initial[:, 3] += [0.0, 0.01, 0.02]
    states, _ = dashpot.rollout(engine, initial, nstep=5, with_memory=True)
    dense = np.array(list(states))
    assert len(states) == 3
    assert dense.shape == states.shape
    found = states[key]
    assert found.shape == dense[key].shape
    np.testing.assert_array_equal(found, dense[key])


@pytest.mark.parametrize("key", [3, (0, 9), (0, 0, 0, 0), None, np.s_[0, :, [1, 2]]])
def test_what_states_with_memory_have_not_is_an_index_error(key):
    engine = make_engine(BOX)
    initial = np.tile(get_state(engine, engine.make_data(), FULL_PHYSICS), (3, 1))
    states, _ = dashpot.rollout(engine, initial, nstep=5, with_memory=True)
    with pytest.raises(IndexError):
        states[key]


def test_what_diverges_has_no_memory_from_there_on():
    model = mujoco.MjModel.from_xml_string("""<mujoco><option gravity="0 0 0"/><worldbody><body>
      <joint name="j" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/></body>
      </worldbody><actuator><velocity joint="j" kv="-50"/></actuator></mujoco>""")
    engine = dashpot.Engine(model)
    starts = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    last = np.zeros((2, mujoco.mj_stateSize(engine.model, int(INTEGRATION))))
    with pytest.warns(dashpot.DivergenceWarning):
        states, _ = dashpot.rollout(
            engine, starts, nstep=400, on_divergence="nan", with_memory=True, final_state=last
        )
    lost = np.isnan(states[0]).all(axis=1)
    assert 0 < lost.argmax() < 400
    assert lost[lost.argmax() :].all()
    assert np.isnan(last[0]).all()
    np.testing.assert_array_equal(last[1], states[1, -1])
    np.testing.assert_array_equal(states[1, :, 1], 0.0)


@pytest.mark.parametrize(
    ("final", "message"),
    [
        (np.zeros((2, 5)), "final_state must be of shape"),
        (np.zeros(5), "final_state must have two dimensions"),
        (np.zeros((1, 5, 3)), "final_state must have two dimensions"),
        ([1.0], "final_state must be an array of float64 to write to, got list"),
    ],
)
def test_final_states_that_do_not_fit_are_named(final, message):
    engine = make_engine(BOX)
    initial = np.tile(get_state(engine, engine.make_data(), FULL_PHYSICS), (2, 1))
    with pytest.raises(ValueError, match=message):
        dashpot.rollout(engine, initial, final_state=final)


def test_sparse_states_do_not_depend_on_threads_and_are_those_of_each_engine():
    engines = [make_engine(BOX) for _ in range(4)]
    for index, engine in enumerate(engines):
        engine.model.opt.gravity[0] = 0.5 * index
    initial = get_state(engines[0], engines[0].make_data(), INTEGRATION)
    one, _ = dashpot.rollout(engines, initial, nstep=STEPS, nthread=1, with_memory=True)
    three, _ = dashpot.rollout(engines, initial, nstep=STEPS, nthread=3, with_memory=True)
    assert np.asarray(one).tobytes() == np.asarray(three).tobytes()
    assert one.nbytes == three.nbytes
    for index, engine in enumerate(engines):
        alone, _ = dashpot.rollout(engine, initial, nstep=STEPS, with_memory=True)
        np.testing.assert_array_equal(alone[0], one[index])
    copied = pickle.loads(pickle.dumps(one))
    assert np.asarray(copied).tobytes() == np.asarray(one).tobytes()
