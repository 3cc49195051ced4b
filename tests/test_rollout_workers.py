"""Workers of rollouts are kept by the engine: they follow its model and materials."""

import itertools
import threading

import mujoco
import numpy as np
import pytest

import dashpot

XML = """<mujoco><option timestep="0.004"/><worldbody>
  <geom name="floor" type="plane" size="2 2 0.1"/>
  <body pos="0 0 0.08"><freejoint/><geom name="box" type="box" size="0.05 0.04 0.03" mass="0.4"/>
  </body></worldbody></mujoco>"""
STEPS = 50


def throw(engine, kind):
    """Return a state of data that have contact memory."""
    data = engine.make_data()
    data.qvel[:] = [1.0, 0.2, -1.0, 1.0, 3.0, 0.5]
    engine.step(data, nstep=STEPS)
    state = np.empty(mujoco.mj_stateSize(engine.model, int(kind)))
    mujoco.mj_getState(engine.model, data, state, int(kind))
    return state


def step(engine, state, kind):
    data = engine.make_data()
    mujoco.mj_setState(engine.model, data, state, int(kind))
    engine.step(data, nstep=STEPS)
    return np.concatenate([data.qpos, data.qvel])


def last(states, engine, kind):
    data = mujoco.MjData(engine.model)
    mujoco.mj_setState(engine.model, data, states[0, -1], int(kind))
    return np.concatenate([data.qpos, data.qvel])


def grow(engine):
    engine.model.geom_size[1] *= 1.2
    engine.model.geom_rbound[1] *= 1.2
    engine.model.geom_aabb[1] *= 1.2


@pytest.mark.parametrize(
    "edit",
    [
        lambda engine: engine.model.opt.gravity.__setitem__(0, 3.0),
        lambda engine: setattr(engine.model.opt, "timestep", 0.002),
        lambda engine: engine.model.geom_margin.__setitem__(1, 0.02),
        lambda engine: engine.model.geom_friction.__setitem__((slice(None), 0), 0.05),
        grow,
        lambda engine: engine.set_material("box", dashpot.Material(3e4, damping_ratio=0.2)),
        lambda engine: engine.set_pair_material("box", "floor", dashpot.Material(friction=0.1)),
    ],
    ids=["gravity", "timestep", "margin", "friction", "size", "material", "pair material"],
)
def test_rollouts_follow_edits_of_the_engine(edit):
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(XML))
    state = throw(engine, kind)
    options = {"nstep": STEPS, "nthread": 2, "with_memory": True}
    before, _ = dashpot.rollout(engine, np.tile(state, (3, 1)), **options)
    np.testing.assert_array_equal(last(before, engine, kind), step(engine, state, kind))
    edit(engine)
    after, _ = dashpot.rollout(engine, np.tile(state, (3, 1)), **options)
    np.testing.assert_array_equal(last(after, engine, kind), step(engine, state, kind))
    assert not np.array_equal(before, after)


def test_states_without_memory_are_those_of_full_physics():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(XML))
    full, integration = mujoco.mjtState.mjSTATE_FULLPHYSICS, mujoco.mjtState.mjSTATE_INTEGRATION
    state = throw(engine, integration)
    with_memory, sensors = dashpot.rollout(engine, state, nstep=STEPS, with_memory=True)
    without, same_sensors = dashpot.rollout(engine, state, nstep=STEPS)
    assert without.shape == (1, STEPS, mujoco.mj_stateSize(engine.model, int(full)))
    np.testing.assert_array_equal(sensors, same_sensors)
    data = engine.make_data()
    for long, short in zip(with_memory[0], without[0], strict=True):
        mujoco.mj_setState(engine.model, data, long, int(integration))
        expected = np.empty(len(short))
        mujoco.mj_getState(engine.model, data, expected, int(full))
        np.testing.assert_array_equal(short, expected)


def test_whether_states_have_memory_is_true_or_false():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(XML))
    state = throw(engine, mujoco.mjtState.mjSTATE_INTEGRATION)
    with pytest.raises(TypeError, match="with_memory must be True or False, got 'no'"):
        dashpot.rollout(engine, state, with_memory="no")


def test_rollouts_of_several_threads_at_once_do_not_meet():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(XML))
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    states = [throw(engine, kind)]
    states += [states[0] + 1e-3 * i for i in range(1, 4)]
    alone = [dashpot.rollout(engine, s, nstep=400, nthread=1)[0] for s in states]
    found = [None] * len(states)

    def run(index):
        found[index] = dashpot.rollout(engine, states[index], nstep=400, nthread=1)[0]

    for _ in range(5):
        threads = [threading.Thread(target=run, args=(i,)) for i in range(len(states))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for one, other in zip(alone, found, strict=True):
            np.testing.assert_array_equal(one, other)


def test_engine_can_be_stepped_while_it_rolls_out():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(XML))
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    states = np.tile(throw(engine, kind), (8, 1))
    alone, _ = dashpot.rollout(engine, states, nstep=300, nthread=2)
    margin = engine.model.geom_gap.copy()
    done = threading.Event()

    def step_on():
        data = engine.make_data()
        while not done.is_set():
            engine.step(data, nstep=20)

    thread = threading.Thread(target=step_on)
    thread.start()
    try:
        for _ in range(5):
            beside, _ = dashpot.rollout(engine, states, nstep=300, nthread=2)
            np.testing.assert_array_equal(alone, beside)
    finally:
        done.set()
        thread.join()
    np.testing.assert_array_equal(engine.model.geom_gap, margin)


def packed(contype):
    """Return a cube of 343 spheres, held together by walls a micrometre too narrow."""
    radius, side = 0.05, 7
    spheres = "".join(
        f"""<body pos="{2 * radius * x} {2 * radius * y} {2 * radius * z}"><freejoint/>
        <geom type="sphere" size="{radius + 1e-6}" mass="0.1" contype="{contype}"
        conaffinity="{contype}"/></body>"""
        for x, y, z in itertools.product(range(side), repeat=3)
    )
    return f"<mujoco><option gravity='0 0 0'/><worldbody>{spheres}</worldbody></mujoco>"


def test_a_full_memory_of_contacts_says_so_and_leaves_data():
    # 882 contacts fit where spheres may touch; what is only to be seen has little room.
    material = dashpot.Material(stiffness=1e5)
    full = dashpot.Engine(mujoco.MjModel.from_xml_string(packed(1)))
    unseen = dashpot.Engine(mujoco.MjModel.from_xml_string(packed(0)))
    for engine in (full, unseen):
        for geom in range(engine.model.ngeom):
            engine.set_material(geom, material)
    unseen.model.geom_contype[:] = unseen.model.geom_conaffinity[:] = 1
    unseen.model.body_contype[1:] = unseen.model.body_conaffinity[1:] = 1
    assert full.step(full.make_data()).touching == 3 * 7 * 7 * 6
    data = unseen.make_data()
    with pytest.raises(RuntimeError, match="882 contacts exceed the memory for 75"):
        unseen.step(data)
    np.testing.assert_array_equal(data.qvel, 0.0)
    assert data.time == 0.0
