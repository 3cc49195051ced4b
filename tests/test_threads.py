"""Threads that share an engine: while one steps, others wait, and find the model as it was."""

import copy
import pickle
import threading

import mujoco
import numpy as np
import pytest

import dashpot

XML = """<mujoco><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="2 2 .1"/>
  <body pos="0 0 .3"><freejoint/><geom name="box" type="box" size=".1 .1 .1"/></body>
</worldbody></mujoco>"""
FULL_PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS


@pytest.fixture
def engine() -> dashpot.Engine:
    return dashpot.Engine(mujoco.MjModel.from_xml_string(XML))


def falling(engine: dashpot.Engine) -> mujoco.MjData:
    data = engine.make_data()
    data.qvel[2] = -3.0
    return data


def copied(engine: dashpot.Engine) -> np.ndarray:
    return copy.copy(engine).model.geom_gap


def rolled_out(engine: dashpot.Engine) -> np.ndarray:
    state = np.zeros(mujoco.mj_stateSize(engine.model, FULL_PHYSICS))
    mujoco.mj_getState(engine.model, falling(engine), state, FULL_PHYSICS)
    return dashpot.rollout(engine, state, nstep=50)[0]


def stepped_with_another_material(engine: dashpot.Engine) -> np.ndarray:
    engine.set_material("box", dashpot.Material(stiffness=1e5))
    data = falling(engine)
    engine.step(data, nstep=50)
    return data.qpos


@pytest.mark.parametrize("action", [copied, rolled_out, stepped_with_another_material])
def test_others_wait_for_the_step_of_one_thread(engine, action):
    """In the middle of its step, where contacts are filtered, the model has wider gaps."""
    gap = engine.model.geom_gap.copy()
    expected = action(dashpot.Engine(mujoco.MjModel.from_xml_string(XML)))
    results, finished_during_step, widened = [], [], []
    other = threading.Thread(target=lambda: results.append(action(engine)))

    def in_the_middle(*_) -> int:
        mujoco.set_mjcb_contactfilter(None)  # once is enough
        widened.append(engine.model.geom_gap.max())
        other.start()
        other.join(timeout=0.3)
        finished_during_step.append(not other.is_alive())
        return 0

    data = falling(engine)
    mujoco.set_mjcb_contactfilter(in_the_middle)
    try:
        engine.step(data)
        other.join()
    finally:
        mujoco.set_mjcb_contactfilter(None)
    assert finished_during_step == [False]
    assert widened[0] > gap.max()
    assert np.array_equal(results[0], expected)
    assert np.array_equal(engine.model.geom_gap, gap)


def test_a_thread_that_steps_in_a_loop_leaves_turns_to_others(engine):
    stop = threading.Event()

    def step_on() -> None:
        data = engine.make_data()
        while not stop.is_set():
            engine.step(data, nstep=20)

    thread = threading.Thread(target=step_on)
    thread.start()
    try:
        results = [rolled_out(engine) for _ in range(100)]
    finally:
        stop.set()
        thread.join()
    # The floor is there in all of them.
    assert all(np.array_equal(result, results[0]) for result in results)
    assert results[0][0, -1, 3] > 0.09


@pytest.mark.parametrize(
    "duplicate", [copy.copy, copy.deepcopy, lambda engine: pickle.loads(pickle.dumps(engine))]
)
def test_copies_step_as_the_engine_and_share_nothing(engine, duplicate):
    engine.set_material("box", dashpot.Material(stiffness=1e4, restitution=0.5))
    data = falling(engine)
    engine.step(data, nstep=100)
    other = duplicate(engine)
    theirs = falling(other)
    other.step(theirs, nstep=100)
    assert np.array_equal(theirs.qpos, data.qpos)
    other.set_material("box", dashpot.Material(stiffness=1e6))
    other.model.opt.timestep = 1e-3
    assert engine.material("box").stiffness == 1e4
    assert engine.model.opt.timestep == 2e-3


def test_a_material_that_is_set_while_a_stepper_is_made_counts_from_the_next_step(
    engine, monkeypatch
):
    """The stepper of the material before was kept, and the new one ignored, for good."""
    soft, stiff = dashpot.Material(stiffness=1e3), dashpot.Material(stiffness=1e6)
    for name in ("box", "floor"):
        engine.set_material(name, soft)
    build, set_already = dashpot.Engine._parameters, []

    def build_late(self, *arguments):
        parameters = build(self, *arguments)
        if not set_already:  # as another thread may, between the two
            set_already.append(True)
            for name in ("box", "floor"):
                self.set_material(name, stiff)
        return parameters

    monkeypatch.setattr(dashpot.Engine, "_parameters", build_late)
    data = falling(engine)
    engine.step(data)
    engine.step(data, nstep=1000)
    assert set_already
    # At rest, with two springs in a row.
    forces = engine.contacts(data).force[:, 0]
    np.testing.assert_allclose(
        engine.contacts(data).compression, forces / (0.5 * stiff.stiffness), rtol=1e-3
    )
