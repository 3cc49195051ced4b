"""Ctrl-C ends long work on threads."""

import contextlib
import signal
import threading
import time

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot import calibrate

BALL = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 1"/>
  <body name="ball" pos="0 0 0.09"><freejoint/><geom size="0.1"/></body>
</worldbody></mujoco>"""
EGGS = """<mujoco><worldbody>
  <body><freejoint/><geom name="a" type="ellipsoid" size=".1 .1 .11"/></body>
  <body><freejoint/><geom name="b" type="ellipsoid" size=".1 .11 .1"/></body>
</worldbody></mujoco>"""
MINUTES = 10_000_000  # steps


@contextlib.contextmanager
def interrupted(handler=signal.default_int_handler, after=0.3):
    """Interrupt what runs within, and check that it ends long before its end on any machine."""
    timer = threading.Timer(after, signal.raise_signal, [signal.SIGINT])
    before = signal.signal(signal.SIGINT, handler)
    started = time.monotonic()
    timer.start()
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        timer.join()
    assert time.monotonic() - started < 5.0


@pytest.fixture
def engine():
    return dashpot.Engine(mujoco.MjModel.from_xml_string(BALL))


def full_physics(engine):
    state = np.empty(mujoco.mj_stateSize(engine.model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    data = engine.make_data()
    mujoco.mj_getState(engine.model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    return state


@pytest.mark.parametrize(("nbatch", "nthread"), [(1, 1), (3, 1), (3, 2), (2, 3)])
def test_rollouts_end_and_the_next_ones_are_as_ever(engine, nbatch, nthread):
    state = full_physics(engine)
    expected = dashpot.rollout(engine, state, nstep=20, nthread=1)
    many = np.tile(state, (nbatch, 1))
    with interrupted(), pytest.raises(KeyboardInterrupt):
        dashpot.rollout(engine, many, nstep=MINUTES // 4, nthread=nthread)
    again = dashpot.rollout(engine, many, nstep=20, nthread=nthread)
    for found, wanted in zip(again, expected, strict=True):
        np.testing.assert_array_equal(found, np.tile(wanted, (nbatch, 1, 1)))


def test_other_signals_are_handled_while_rollouts_go_on(engine):
    state = full_physics(engine)
    handled = []
    nstep = 100_000
    started = time.monotonic()
    with interrupted(lambda *_: handled.append(time.monotonic() - started), after=0.02):
        found, _ = dashpot.rollout(engine, state, nstep=nstep, nthread=1)
    took = time.monotonic() - started
    # Python handles what nothing looked for as soon as the rollout has ended.
    assert handled[0] < 0.5 * took
    assert found[0, -1, 0] == pytest.approx(nstep * engine.model.opt.timestep)


@pytest.mark.parametrize("nthread", [1, 2])
def test_queries_of_many_configurations_end(nthread):
    model = mujoco.MjModel.from_xml_string(EGGS)
    qpos = np.tile(model.qpos0, (400_000, 1))
    with interrupted(), pytest.raises(KeyboardInterrupt):
        dashpot.distances(model, "a", "b", qpos, nthread=nthread)
    qpos[:, 2] = 3.0
    qvel = np.tile([0, 0, -1.0, 5, 4, 3, 0, 0, 1.0, 3, 4, 5], (len(qpos), 1))
    with interrupted(), pytest.raises(KeyboardInterrupt):
        dashpot.times_of_impact(model, "a", "b", qpos, qvel, horizon=9.0, nthread=nthread)


@pytest.mark.parametrize("nthread", [1, 2])
def test_calibrations_end(engine, nthread):
    end = MINUTES * engine.model.opt.timestep
    trajectory = calibrate.Trajectory(
        "long", [0.0, end], np.zeros((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1)), ("ball",),
        initial_qpos=engine.model.qpos0, initial_qvel=np.zeros(6),
    )  # fmt: skip
    mass = calibrate.Parameter.model("body_mass", "ball", start=2.0, bounds=(0.1, 10.0))
    problem = calibrate.Problem(engine, [mass], [trajectory], 1.0, 1.0)
    with interrupted(), pytest.raises(KeyboardInterrupt):
        calibrate.fit(problem, nthread=nthread)
