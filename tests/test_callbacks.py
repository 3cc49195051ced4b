"""Callbacks of MuJoCo's Python package, and what they raise."""

import copy
import signal
import threading
import time

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot import Engine

MODEL = """<mujoco><worldbody>
  <geom type="plane" size="1 1 1"/>
  <body pos="0 0 0.09"><freejoint/><geom size="0.1"/></body>
  <body pos="1 0 0"><joint name="hinge" type="hinge"/><geom size="0.1"/></body>
</worldbody>
<actuator>
  <general joint="hinge" dyntype="user" gaintype="user" biastype="user" actdim="1"/>
</actuator>
<sensor>
  <user dim="1" needstage="pos"/><user dim="1" needstage="vel"/><user dim="1" needstage="acc"/>
</sensor></mujoco>"""
RK4 = mujoco.mjtIntegrator.mjINT_RK4
CALLBACKS = ("control", "passive", "contactfilter", "sensor", "act_dyn", "act_gain", "act_bias")


class CallbackError(Exception):
    """Raised by callbacks here."""


@pytest.fixture
def install():
    """Install a callback by name; after the test there is none."""

    def set_callback(name, function):
        getattr(mujoco, f"set_mjcb_{name}")(function)

    yield set_callback
    for name in CALLBACKS:
        set_callback(name, None)


def state_of(engine, data):
    """Return everything that the next step depends on."""
    state = np.empty(mujoco.mj_stateSize(engine.model, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(engine.model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    return state


@pytest.mark.parametrize("name", CALLBACKS)
@pytest.mark.parametrize("impact", ["none", "cut"])
@pytest.mark.parametrize("integrator", [mujoco.mjtIntegrator.mjINT_EULER, RK4])
def test_an_exception_of_a_callback_leaves_the_step_and_the_state_alone(
    install, name, impact, integrator
):
    model = mujoco.MjModel.from_xml_string(MODEL)
    model.opt.integrator = integrator
    engine = Engine(model, impact=impact)
    data, undisturbed = engine.make_data(), engine.make_data()
    calls = 0

    def fail_later(*_):
        nonlocal calls
        calls += 1
        if calls > 5:
            raise CallbackError
        return 0

    install(name, fail_later)
    with pytest.raises(CallbackError):
        engine.step(data, nstep=100)
    install(name, None)
    steps = round(data.time / engine.model.opt.timestep)
    assert calls == 6
    assert data.pstack == 0
    # What came before is as it would have been, and what comes after goes on from there.
    if steps > 0:
        engine.step(undisturbed, nstep=steps)
    assert np.array_equal(state_of(engine, data), state_of(engine, undisturbed))
    engine.step(data, nstep=20)
    engine.step(undisturbed, nstep=20)
    assert np.array_equal(state_of(engine, data), state_of(engine, undisturbed))


def test_a_control_callback_drives_the_model(install):
    engine = Engine(mujoco.MjModel.from_xml_string(MODEL))
    data, by_hand = engine.make_data(), engine.make_data()
    by_hand.qfrc_applied[0] = 1.0

    def push(_, d):
        d.qfrc_applied[0] = 1.0

    install("control", push)
    engine.step(data, nstep=50)
    install("control", None)
    engine.step(by_hand, nstep=50)
    assert np.array_equal(data.qpos, by_hand.qpos)


def test_an_exception_leaves_what_an_equality_has_let_go_alone(install):
    """The second half of the last step under the equality stayed in the velocity."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
      <body name="upper"><joint type="hinge" axis="0 1 0"/>
        <geom type="capsule" size=".02" fromto="0 0 0 .2 0 0" mass=".3"/>
        <body name="lower" pos=".2 0 0"><joint type="hinge" axis="0 1 0"/>
          <geom type="capsule" size=".02" fromto="0 0 0 .2 0 -.1" mass=".3"/></body></body>
      </worldbody><equality><connect body1="lower" body2="world" anchor=".2 0 -.1"/></equality>
      </mujoco>""")
    engine = Engine(model)
    data = engine.make_data()
    data.qvel[:] = 3.0, -8.0
    engine.step(data, nstep=100)
    data.eq_active[0] = 0
    before = state_of(engine, data)

    def fail(*_):
        raise CallbackError

    install("control", fail)
    with pytest.raises(CallbackError):
        engine.step(data)
    assert np.array_equal(state_of(engine, data), before)


@pytest.mark.parametrize("name", ["control", "passive"])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_feedback_of_a_callback_on_sensors_is_that_of_mj_step(install, integrator, name):
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="0.004" integrator="{integrator}"/>
      <worldbody><body pos="0 0 1"><joint name="hinge" axis="0 1 0"/>
        <geom size="0.05" pos="0.3 0 0"/><site name="tip" pos="0.3 0 0"/></body></worldbody>
      <actuator><motor joint="hinge"/></actuator>
      <sensor><jointpos joint="hinge"/><framepos objtype="site" objname="tip"/>
        <jointvel joint="hinge"/></sensor></mujoco>""")
    engine = Engine(model)
    data, theirs = engine.make_data(), mujoco.MjData(model)

    def feedback(_, d):
        torque = -5.0 * d.sensordata[0] - 3.0 * d.sensordata[3]
        if name == "control":
            d.ctrl[0] = torque - 0.5 * d.sensordata[4]
        else:
            d.qfrc_passive[0] += torque

    install(name, feedback)
    for _ in range(100):
        engine.step(data)
        mujoco.mj_step(model, theirs)
        assert np.array_equal(data.qpos, theirs.qpos)
        assert np.array_equal(data.sensordata, theirs.sensordata)
    assert abs(data.qpos[0]) > 0.01


def test_interrupts_pass_through_steps(install):
    engine = Engine(mujoco.MjModel.from_xml_string(MODEL))
    data = engine.make_data()

    def interrupt(*_):
        raise KeyboardInterrupt

    install("passive", interrupt)
    with pytest.raises(KeyboardInterrupt):
        engine.step(data)


def test_a_callback_cannot_step_the_engine_that_called_it(install):
    engine = Engine(mujoco.MjModel.from_xml_string(MODEL))
    data, ahead = engine.make_data(), engine.make_data()
    another = copy.deepcopy(engine)
    state = np.zeros(mujoco.mj_stateSize(engine.model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    for look_ahead in (
        lambda: engine.step(ahead),
        lambda: dashpot.rollout(engine, state),
        lambda: copy.deepcopy(engine),
    ):
        inside = []

        def control(_, d, look_ahead=look_ahead, inside=inside):
            if not inside:
                inside.append(True)
                look_ahead()

        install("control", control)
        with pytest.raises(RuntimeError, match="the engine is being stepped"):
            engine.step(data)
    inside = []

    def plan(_, d):
        if not inside:
            inside.append(True)
            another.step(another.make_data())

    install("control", plan)
    engine.step(data)
    assert inside


def test_rollouts_say_that_they_take_no_python_callbacks(install):
    engine = Engine(mujoco.MjModel.from_xml_string(MODEL))
    state = np.zeros(mujoco.mj_stateSize(engine.model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    state[4] = 1.0
    install("control", lambda *_: None)
    for nthread in (1, 2):
        with pytest.raises(ValueError, match=r"rollout 0, step 0: callbacks .*Engine\.make_data"):
            dashpot.rollout(engine, np.tile(state, (3, 1)), nstep=2, nthread=nthread)


def test_interrupts_end_a_call_of_many_steps_between_two():
    engine = Engine(mujoco.MjModel.from_xml_string(MODEL))
    data = engine.make_data()
    steps = 10_000_000  # minutes
    timer = threading.Timer(0.3, signal.raise_signal, [signal.SIGINT])
    started = time.monotonic()
    # A shell that starts Python in the background has it ignore interrupts.
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            engine.step(data, nstep=steps)
    finally:
        signal.signal(signal.SIGINT, handler)
    assert time.monotonic() - started < 10.0  # long before the end, on any machine
    # The data are those of a whole number of steps, and the next call goes on.
    taken = data.time / engine.model.opt.timestep
    assert 0 < taken < steps
    before = data.time
    engine.step(data)
    assert data.time == pytest.approx(before + engine.model.opt.timestep)
