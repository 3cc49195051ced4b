"""All memory of contact lives in MjData: saving, copying and clearing it works as in MuJoCo."""

import copy
import pickle

import mujoco
import numpy as np
import pytest

import dashpot
from piles import pile
from scene import Scene
from scenes import slope
from simulate import make_engine

INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION


def get_state(model, data) -> np.ndarray:
    state = np.zeros(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, data, state, INTEGRATION)
    return state


def set_state(model, data, state) -> None:
    mujoco.mj_setState(model, data, state, INTEGRATION)


def prepared(scene: Scene, steps: int):
    """Engine and data in the midst of things: stretched friction springs, pressed contacts."""
    engine = make_engine(scene, scene.model(0.002))
    data = engine.make_data()
    engine.step(data, nstep=steps)
    return engine, data


SCENES = {
    "stiction while loading": (slope(), 5),
    "stiction at rest": (slope(), 500),
    "tumbling pile": (pile(count=12), 250),
}


@pytest.fixture(params=SCENES, scope="module")
def midway(request):
    scene, steps = SCENES[request.param]
    return *prepared(scene, steps), scene, steps


def test_saved_state_continues_to_the_bit(midway):
    engine, data, *_ = midway
    state = get_state(engine.model, data)
    restored = engine.make_data()
    set_state(engine.model, restored, state)
    for _ in range(50):
        engine.step(data)
        engine.step(restored)
        assert restored.qpos.tobytes() == data.qpos.tobytes()
        assert restored.qvel.tobytes() == data.qvel.tobytes()
    assert get_state(engine.model, restored).tobytes() == get_state(engine.model, data).tobytes()


def test_the_state_holds_what_contact_remembers(midway):
    """Were the memory outside of it, the continuation above could pass without it."""
    engine, data, *_ = midway
    with_memory, without = engine.make_data(), engine.make_data()
    set_state(engine.model, with_memory, get_state(engine.model, data))
    without.qpos[:], without.qvel[:] = data.qpos, data.qvel
    engine.step(with_memory)
    engine.step(without)
    assert with_memory.qvel.tobytes() != without.qvel.tobytes()


def test_a_copy_continues_to_the_bit(midway):
    engine, data, *_ = midway
    copies = [engine.make_data(), copy.copy(data), pickle.loads(pickle.dumps(data))]
    mujoco.mj_copyData(copies[0], engine.model, data)
    engine.step(data, nstep=50)
    for other in copies:
        engine.step(other, nstep=50)
        assert get_state(engine.model, other).tobytes() == get_state(engine.model, data).tobytes()


def test_one_call_of_many_steps_equals_many_calls(midway):
    engine, data, *_ = midway
    other = engine.make_data()
    mujoco.mj_copyData(other, engine.model, data)
    engine.step(data, nstep=30)
    for _ in range(30):
        engine.step(other)
    assert get_state(engine.model, other).tobytes() == get_state(engine.model, data).tobytes()


def test_reset_forgets(midway):
    engine, data, scene, steps = midway
    mujoco.mj_resetData(engine.model, data)
    engine.step(data, nstep=steps)
    _, fresh = prepared(scene, steps)
    assert get_state(engine.model, data).tobytes() == get_state(engine.model, fresh).tobytes()


def test_restitution_of_saved_state_in_another_engine():
    """A second engine of the same model and materials continues identically."""
    first, data = prepared(slope(), 300)
    second = make_engine(slope(), slope().model(0.002))
    other = second.make_data()
    set_state(second.model, other, get_state(first.model, data))
    first.step(data, nstep=100)
    second.step(other, nstep=100)
    assert other.qpos.tobytes() == data.qpos.tobytes()


def test_stiction_survives_a_restore_without_creep():
    """Restoring every 20 steps for 4 s must not leak elastic displacement."""
    engine, data = prepared(slope(), 500)
    before = data.qpos.copy()
    for _ in range(100):
        state = get_state(engine.model, data)
        data = engine.make_data()
        set_state(engine.model, data, state)
        engine.step(data, nstep=20)
    assert np.abs(data.qpos - before).max() <= 1e-9  # 1e-6 mm


def test_rollouts_on_any_number_of_threads_give_the_same_bits():
    engine, data = prepared(pile(count=12), 250)
    size = mujoco.mj_stateSize(engine.model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    rng = np.random.default_rng(0)
    state = np.zeros(size)
    mujoco.mj_getState(engine.model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    states = np.tile(state, (9, 1))
    velocity = slice(1 + engine.model.nq, 1 + engine.model.nq + engine.model.nv)
    states[:, velocity] += 0.01 * rng.normal(size=(9, engine.model.nv))
    results = [dashpot.rollout(engine, states, nstep=40, nthread=n)[0] for n in (1, 2, 8)]
    assert results[0].shape == (9, 40, size)
    assert np.isfinite(results[0]).all()
    assert results[1].tobytes() == results[0].tobytes()
    assert results[2].tobytes() == results[0].tobytes()
    for start, trajectory in zip(states, results[0], strict=True):
        mujoco.mj_resetData(engine.model, data)
        mujoco.mj_setState(engine.model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        engine.step(data, nstep=40)
        assert data.qpos.tobytes() == trajectory[-1, 1 : 1 + engine.model.nq].tobytes()


CHAIN_ON_A_CONNECT = """<mujoco><option timestep="0.002"/>
  <default><geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1" contype="0"
    conaffinity="0"/><joint axis="0 1 0"/></default>
  <worldbody><body pos="0 0 1" euler="0 17 0"><joint/><geom/>
    <body pos=".3 0 0" euler="0 -52 0"><joint/><geom/>
      <body name="last" pos=".3 0 0" euler="0 23 0"><joint/><geom/></body></body></body></worldbody>
  <equality><connect body1="last" anchor=".3 0 0"/></equality></mujoco>"""


def test_a_tree_that_rows_let_go_moves_on_whatever_the_engine_stepped_before():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(CHAIN_ON_A_CONNECT))
    data = engine.make_data()
    data.qvel[:] = [1.0, -3.0, 4.0]
    engine.step(data, nstep=26)
    data.eq_active[0] = 0
    state = get_state(engine.model, data)
    elsewhere = engine.make_data()
    elsewhere.qpos[:] = [0.5, 1.2, -2.0]
    velocities = []
    for _ in range(2):
        data = engine.make_data()
        set_state(engine.model, data, state)
        engine.step(data)
        velocities.append(data.qvel.tobytes())
        engine.step(elsewhere, nstep=5)
    assert velocities[0] == velocities[1]


WELDED = """<mujoco><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="5 5 .1"/><geom name="post" size=".2"/>
  <body name="hand" mocap="true" pos="0 0 .25"><geom name="palm" size=".1"/></body>
  <body pos="1 0 .095"><freejoint/><geom name="ball" size=".1"/>
    <geom name="bump" size=".1" pos=".05 0 0"/>
    <body pos="0 .1 0"><geom name="welded" size=".1"/></body></body></worldbody>
  <contact><pair geom1="ball" geom2="bump"/><pair geom1="welded" geom2="ball"/>
    <pair geom1="palm" geom2="post"/></contact></mujoco>"""


@pytest.mark.parametrize("stiffness", [None, 1e5])
def test_pairs_that_nothing_moves_against_each_other_are_no_contacts(stiffness):
    """MuJoCo drops them when it makes rows, which single and joined steps do at other times."""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(WELDED))
    if stiffness:
        for geom in ("ball", "bump", "welded"):
            engine.set_material(geom, dashpot.Material(stiffness=stiffness, damping_ratio=0.5))
    start, apart, together = (engine.make_data() for _ in range(3))
    for _ in range(200):
        stats = engine.step(apart)
        assert stats.contacts <= 3  # with the floor, each ball once
    assert engine.step(together, nstep=200).contacts == stats.contacts == 3
    initial = get_state(engine.model, start)
    rolled, _ = dashpot.rollout(engine, initial, nstep=200, with_memory=True)
    final = get_state(engine.model, apart)
    assert np.array_equal(get_state(engine.model, together), final)
    assert np.array_equal(rolled[0, -1], final)
