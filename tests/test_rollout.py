"""Parallel rollouts: shapes, semantics, and the same bits on any number of threads."""

import threading
import time

import mujoco
import numpy as np
import pytest
from mujoco import rollout as mujoco_rollout

import dashpot

XML = """
<mujoco>
  <option timestep="0.004"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 0.1"/>
    <body name="box" pos="0 0 0.3">
      <freejoint/>
      <geom name="box" type="box" size="0.05 0.04 0.03" mass="0.4"/>
    </body>
    <body name="arm" pos="0.6 0 0.3">
      <joint name="hinge" axis="0 1 0"/>
      <geom name="arm" type="capsule" size="0.02" fromto="0 0 0 0.2 0 0" mass="0.2"/>
    </body>
  </worldbody>
  <actuator><motor joint="hinge" gear="0.2"/></actuator>
  <sensor><framepos objtype="body" objname="box"/><jointvel joint="hinge"/></sensor>
</mujoco>
"""
FULL_PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS
INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION


@pytest.fixture(scope="module")
def engine():
    result = dashpot.Engine(mujoco.MjModel.from_xml_string(XML))
    result.set_material("box", dashpot.Material(2e4, damping_ratio=0.3, friction=0.4))
    return result


def get_state(engine, data, kind=FULL_PHYSICS):
    state = np.empty(mujoco.mj_stateSize(engine.model, kind))
    mujoco.mj_getState(engine.model, data, state, kind)
    return state


@pytest.fixture(scope="module")
def thrown(engine):
    """Twelve full-physics states of the box thrown at the floor, turning."""
    rng = np.random.default_rng(3)
    states = []
    for _ in range(12):
        data = engine.make_data()
        data.qpos[2] = rng.uniform(0.06, 0.2)
        data.qvel[:3] = [*rng.normal(size=2), -1.0]
        data.qvel[3:6] = 5.0 * rng.normal(size=3)
        states.append(get_state(engine, data))
    return np.array(states)


def test_same_bits_on_any_number_of_threads(engine, thrown):
    control = np.random.default_rng(4).normal(size=(12, 150, 1))
    results = [dashpot.rollout(engine, thrown, control, nthread=n) for n in (1, 2, 8)]
    for state, sensordata in results[1:]:
        assert np.array_equal(state, results[0][0])
        assert np.array_equal(sensordata, results[0][1])
    # Every box ends in reach of the floor (half diagonal), so the contact solver was compared.
    assert results[0][0][:, -1, 3].max() < np.linalg.norm([0.05, 0.04, 0.03])


def test_equals_stepping_one_data(engine, thrown):
    control = np.random.default_rng(5).normal(size=(12, 60, 1))
    state, sensordata = dashpot.rollout(engine, thrown, control, nthread=2)
    for i in (0, 7):
        data = engine.make_data()
        mujoco.mj_setState(engine.model, data, thrown[i], FULL_PHYSICS)
        for k in range(60):
            data.ctrl[:] = control[i, k]
            engine.step(data)
            assert np.array_equal(state[i, k], get_state(engine, data))
            assert np.array_equal(sensordata[i, k], data.sensordata)


def test_shapes_are_those_of_mujoco_rollout(engine, thrown):
    control = np.zeros((1, 7, 1))
    for initial, given in ((thrown, control), (thrown[0], control), (thrown[:1], control[0])):
        ours = dashpot.rollout(engine, initial, given)
        data = mujoco.MjData(engine.model)
        theirs = mujoco_rollout.rollout(engine.model, data, initial, given)
        assert [a.shape for a in ours] == [a.shape for a in theirs]


def test_equals_mujoco_rollout_without_contact():
    """Where no row is possible the arm takes MuJoCo's own update, bit for bit."""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(XML))
    engine.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data = engine.make_data()
    data.qpos[2] = 5.0
    data.qvel[6] = 2.0
    initial = np.tile(get_state(engine, data), (3, 1))
    control = np.random.default_rng(6).normal(size=(3, 40, 1))
    ours = dashpot.rollout(engine, initial, control)
    theirs = mujoco_rollout.rollout(engine.model, mujoco.MjData(engine.model), initial, control)
    arm = [0, 1 + 7, 1 + 8 + 6]  # time, position and velocity of the hinge
    assert np.array_equal(ours[0][:, :, arm], theirs[0][:, :, arm])
    assert np.array_equal(ours[1][:, :, 3], theirs[1][:, :, 3])


def test_integration_state_continues_bit_identically(engine):
    """The box sticks on a turned floor: its friction memory must travel in the state."""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(XML))
    engine.set_material("box", dashpot.Material(2e4, damping_ratio=0.5, friction=0.8))
    engine.model.opt.gravity[:] = [3.0, 0.0, -9.0]
    data = engine.make_data()
    data.qpos[2] = 0.031
    initial = get_state(engine, data, INTEGRATION)
    whole, _ = dashpot.rollout(engine, initial, nstep=80, with_memory=True)
    first, _ = dashpot.rollout(engine, initial, nstep=50, with_memory=True)
    second, _ = dashpot.rollout(engine, first[:, -1], nstep=30, with_memory=True)
    assert np.array_equal(whole[:, 50:], second)
    # Without the memory the continuation differs, so the comparison above has teeth.
    size = mujoco.mj_stateSize(engine.model, FULL_PHYSICS)
    forgetful, _ = dashpot.rollout(engine, first[:, -1, :size], nstep=30)
    assert not np.array_equal(forgetful, second[..., :size])


def test_other_threads_run_meanwhile(engine, thrown):
    """The interpreter's lock is released: a Python thread makes progress during the call."""
    ticks = []
    stop = threading.Event()

    def tick():
        while not stop.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    try:
        began = time.perf_counter()
        dashpot.rollout(engine, np.repeat(thrown, 4, axis=0), nstep=400, nthread=1)
        ended = time.perf_counter()
    finally:
        stop.set()
        thread.join()
    # A held lock would leave none strictly inside; a loaded machine still schedules a few.
    assert sum(began < tick < ended for tick in ticks) >= 2


def test_engine_and_its_data_are_untouched(engine, thrown):
    margin = engine.model.geom_margin.copy()
    timestep = engine.model.opt.timestep
    before = thrown.copy()
    dashpot.rollout(engine, thrown, nstep=20, nthread=2)
    assert np.array_equal(thrown, before)
    assert np.array_equal(engine.model.geom_margin, margin)
    assert engine.model.opt.timestep == timestep


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: {"initial_state": np.where(np.arange(s.size) == 3, np.nan, s)}, r"\[3\] is nan"),
        (lambda s: {"initial_state": s[:-1]}, "nstate"),
        (lambda s: {"initial_state": s[None, None]}, "initial_state must be"),
        (lambda s: {"initial_state": s[None][:0]}, "initial_state must be"),
        (lambda s: {"control": np.zeros((1, 5, 2))}, "nu = 1"),
        (lambda s: {"control": np.full((5, 1), np.inf)}, r"control\[0, 0\] is inf"),
        (lambda s: {"initial_state": np.tile(s, (3, 1)), "control": np.zeros((2, 5, 1))}, "nbatch"),
        (lambda s: {"control": np.zeros((1, 5, 1)), "nstep": 4}, "nstep"),
        (lambda s: {"control": np.zeros((1, 5, 1)), "nstep": 1}, "nstep"),
        (lambda s: {"nstep": 0}, "nstep must be >= 1"),
        (lambda s: {"nthread": 0}, "nthread must be >= 1"),
    ],
)
def test_bad_input_names_its_culprit(engine, thrown, change, message):
    arguments = {"initial_state": thrown[0], **change(thrown[0])}
    with pytest.raises(ValueError, match=message):
        dashpot.rollout(engine, **arguments)


def test_wrong_types(engine, thrown):
    with pytest.raises(TypeError, match="initial_state"):
        dashpot.rollout(engine, "somewhere")
    with pytest.raises(TypeError, match="nthread"):
        dashpot.rollout(engine, thrown, nthread=1.5)
    with pytest.raises(TypeError, match="nstep"):
        dashpot.rollout(engine, thrown, nstep=True)
    with pytest.raises(TypeError, match=r"^engine is MjModel; it must be a dashpot\.Engine"):
        dashpot.rollout(engine.model, thrown)


def test_an_integer_beyond_floats_is_named(engine, thrown):
    with pytest.raises(ValueError, match=r"^initial_state\[0\] is too large for a float"):
        dashpot.rollout(engine, [10**400] * thrown.shape[-1])


def test_a_failing_rollout_is_named(engine, thrown):
    """A state that the engine refuses: the first of the failing ones is named on any threads."""
    states = np.tile(thrown, (2, 1))
    states[[9, 17], 1 + 3 : 1 + 7] = 0.0  # quaternion of the box
    states[[9, 17], 1] = 1e200  # so far out that MuJoCo calls the state bad
    for nthread in (1, 4):
        with pytest.raises(ValueError, match=r"rollout 9, step 0: data.qpos\[0\] is 1"):
            dashpot.rollout(engine, states, nstep=5, nthread=nthread)


@pytest.fixture(scope="module")
def bursting():
    """Return an arm whose servo has the wrong sign and a thrown ball; three starts of five rest."""
    model = mujoco.MjModel.from_xml_string("""<mujoco>
      <option timestep="0.002" gravity="0 0 0"/><worldbody>
      <geom type="plane" size="2 2 .1"/>
      <body pos="0 0 1"><joint name="arm" axis="0 1 0"/>
        <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" contype="0" conaffinity="0"/></body>
      <body pos="2 0 .15"><freejoint/><geom size=".1"/></body></worldbody>
      <actuator><velocity joint="arm" kv="-50"/></actuator>
      <sensor><jointvel joint="arm"/></sensor></mujoco>""")
    engine = dashpot.Engine(model)
    starts = np.tile(get_state(engine, engine.make_data()), (5, 1))
    starts[[1, 3], 1 + model.nq] = 1.0, 30.0
    starts[:, 1 + model.nq + 3] = -1.0
    return engine, starts


@pytest.mark.parametrize("nthread", [1, 2])
@pytest.mark.parametrize("integration", [False, True])
def test_a_rollout_that_diverges_is_nan_from_there_on(bursting, nthread, integration):
    engine, starts = bursting
    if integration:
        data = engine.make_data()
        whole = []
        for start in starts:
            mujoco.mj_resetData(engine.model, data)
            mujoco.mj_setState(engine.model, data, start, FULL_PHYSICS)
            whole.append(get_state(engine, data, INTEGRATION))
        starts = np.array(whole)
    steps = 400
    with pytest.raises(dashpot.DivergenceError, match=r"rollout [13], step \d+"):
        dashpot.rollout(engine, starts, nstep=steps, nthread=nthread)
    with pytest.warns(
        dashpot.DivergenceWarning,
        match=r"^2 of 5 rollouts diverged and are nan from there on: 1, 3; rollout 1, step \d+: ",
    ):
        states, sensors = dashpot.rollout(
            engine, starts, nstep=steps, nthread=nthread, on_divergence="nan"
        )
    calm = [0, 2, 4]
    alone, readings = dashpot.rollout(engine, starts[calm], nstep=steps, nthread=1)
    assert np.array_equal(states[calm], alone)
    assert np.array_equal(sensors[calm], readings)
    for index in (1, 3):
        lost = np.isnan(states[index]).all(axis=1)
        first = int(lost.argmax())
        assert 0 < first < steps
        assert lost[first:].all()
        assert np.isfinite(states[index, :first]).all()
        assert np.array_equal(np.isnan(sensors[index]).all(axis=1), lost)
        with pytest.raises(dashpot.DivergenceError, match=f"rollout 0, step {first}: "):
            dashpot.rollout(engine, starts[index], nstep=steps)


def test_what_diverged_before_leaves_nothing_to_later_rollouts(bursting):
    engine, starts = bursting
    before = dashpot.rollout(engine, starts[0], nstep=50, nthread=1)
    with pytest.warns(dashpot.DivergenceWarning):
        dashpot.rollout(engine, starts, nstep=400, nthread=1, on_divergence="nan")
    after = dashpot.rollout(engine, starts[0], nstep=50, nthread=1)
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))


def test_what_to_do_about_divergence_is_named(engine, thrown):
    with pytest.raises(ValueError, match="on_divergence is 'ignore'; it must be 'raise' or 'nan'"):
        dashpot.rollout(engine, thrown, on_divergence="ignore")
