"""What rollouts take beside states and controls: other inputs, engines of their own, outputs."""

import mujoco
import numpy as np
import pytest
from mujoco import rollout as mujoco_rollout

import dashpot

# A paddle that is led by hand, a ball on it, and a pendulum that a weld holds until it is let go.
XML = """
<mujoco>
  <option timestep="0.004"/>
  <worldbody>
    <body name="paddle" mocap="true" pos="0 0 0.1"><geom name="paddle" type="box" size=".2 .2 .02"/>
    </body>
    <body name="ball" pos="0 0 0.17"><freejoint/><geom name="ball" size="0.05" mass="0.2"/></body>
    <body name="arm" pos="1 0 1">
      <joint name="hinge" axis="0 1 0"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0.2 0 0" mass="0.2"/>
    </body>
  </worldbody>
  <equality><joint name="hold" joint1="hinge"/></equality>
  <actuator><motor joint="hinge" gear="0.2"/></actuator>
  <sensor><framepos objtype="body" objname="ball"/><jointvel joint="hinge"/></sensor>
</mujoco>
"""
SPEC = mujoco.mjtState
FULL_PHYSICS, INTEGRATION = SPEC.mjSTATE_FULLPHYSICS, SPEC.mjSTATE_INTEGRATION
INPUTS = (
    SPEC.mjSTATE_CTRL
    | SPEC.mjSTATE_QFRC_APPLIED
    | SPEC.mjSTATE_XFRC_APPLIED
    | SPEC.mjSTATE_EQ_ACTIVE
    | SPEC.mjSTATE_MOCAP_POS
    | SPEC.mjSTATE_MOCAP_QUAT
)
STEPS = 60


def make_engine(**options):
    return dashpot.Engine(mujoco.MjModel.from_xml_string(XML), **options)


def get_state(engine, data, kind):
    state = np.empty(mujoco.mj_stateSize(engine.model, kind))
    mujoco.mj_getState(engine.model, data, state, kind)
    return state


def lead(data, step, sign=1.0):
    """Set the inputs of a step: the paddle swings, the ball is pushed, the arm let go half-way."""
    phase = 2.0 * np.pi * step / STEPS
    data.ctrl[0] = sign * np.sin(phase)
    data.qfrc_applied[6] = 0.05 * np.cos(phase)
    data.xfrc_applied[2, 0] = 0.1 * sign
    data.eq_active[0] = step < STEPS // 2
    data.mocap_pos[0, 2] = 0.1 + sign * 0.01 * np.sin(phase)
    data.mocap_quat[0] = [np.cos(0.05 * phase), np.sin(0.05 * phase), 0.0, 0.0]


@pytest.mark.parametrize("kind", [FULL_PHYSICS, INTEGRATION])
def test_every_input_acts_as_if_set_in_data(kind):
    engine = make_engine()
    initial = get_state(engine, engine.make_data(), kind)
    expected, controls = [], []
    for sign in (1.0, -1.0):
        data = engine.make_data()
        for step in range(STEPS):
            lead(data, step, sign)
            controls.append(get_state(engine, data, INPUTS))
            engine.step(data)
            expected.append(np.concatenate([data.qpos, data.qvel, data.sensordata]))
    control = np.reshape(controls, (2, STEPS, -1))
    state, sensordata = dashpot.rollout(
        engine, initial, control, control_spec=INPUTS, nthread=2, with_memory=False
    )
    found = np.concatenate([state[:, :, 1:], sensordata], axis=2)
    np.testing.assert_array_equal(found, np.reshape(expected, found.shape))
    # The arm is held, and then falls: the last of the inputs in the vector arrive, too.
    hinge = 1 + 7
    assert abs(state[0, STEPS // 2 - 1, hinge]) < 1e-3 < 0.05 < abs(state[0, -1, hinge])


def test_inputs_are_laid_out_as_in_mujoco_rollout():
    """No row is possible: the arm, which MuJoCo's own update moves, agrees bit for bit."""
    engine = make_engine()
    engine.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = engine.make_data()
    data.qpos[2] = 5.0
    data.eq_active[0] = 0
    initial = get_state(engine, data, FULL_PHYSICS)
    spec = int(SPEC.mjSTATE_QFRC_APPLIED | SPEC.mjSTATE_EQ_ACTIVE)
    control = np.zeros((1, STEPS, mujoco.mj_stateSize(engine.model, spec)))
    control[:, :, 6] = 0.1
    ours, _ = dashpot.rollout(engine, initial, control, control_spec=spec)
    theirs, _ = mujoco_rollout.rollout(
        engine.model, mujoco.MjData(engine.model), initial, control, control_spec=spec
    )
    hinge = [1 + 7, 1 + 8 + 6]
    np.testing.assert_array_equal(ours[:, :, hinge], theirs[:, :, hinge])
    assert abs(ours[0, -1, hinge[1]]) > 0.5


def test_inputs_that_are_left_out_stay_as_the_state_has_them():
    engine = make_engine()
    data = engine.make_data()
    data.ctrl[0], data.eq_active[0], data.mocap_pos[0, 2] = 0.7, 0, 0.12
    initial = get_state(engine, data, INTEGRATION)
    given = np.tile(data.mocap_pos.ravel(), (STEPS, 1))
    led, _ = dashpot.rollout(engine, initial, given, control_spec=SPEC.mjSTATE_MOCAP_POS)
    held, _ = dashpot.rollout(engine, initial, nstep=STEPS)
    np.testing.assert_array_equal(led, held)


@pytest.mark.parametrize(
    ("spec", "error", "message"),
    [
        (SPEC.mjSTATE_USERDATA, ValueError, "mjSTATE_USERDATA: engines keep contact memory"),
        (SPEC.mjSTATE_QPOS, ValueError, r"bits that are not in mjSTATE_USER \(8128\)"),
        (int(SPEC.mjSTATE_CTRL | SPEC.mjSTATE_TIME), ValueError, "not in mjSTATE_USER"),
        (0, ValueError, "control_spec must be >= 1"),
        ("ctrl", TypeError, "control_spec must be an integer"),
    ],
)
def test_what_no_control_can_hold_is_refused(spec, error, message):
    engine = make_engine()
    initial = get_state(engine, engine.make_data(), FULL_PHYSICS)
    with pytest.raises(error, match=message):
        dashpot.rollout(engine, initial, control_spec=spec)


def test_size_of_controls_goes_by_what_they_hold():
    engine = make_engine()
    initial = get_state(engine, engine.make_data(), FULL_PHYSICS)
    with pytest.raises(ValueError, match=r"ncontrol = 3 by control_spec 1024, got shape \(5, 1\)"):
        dashpot.rollout(engine, initial, np.zeros((5, 1)), control_spec=SPEC.mjSTATE_MOCAP_POS)


# --- Engines of their own -------------------------------------------------------------------------


def rubber_balls(restitutions):
    engines = []
    for restitution in restitutions:
        engine = make_engine()
        rubber = dashpot.Material(stiffness=1e4, restitution=restitution)
        engine.set_pair_material("ball", "paddle", rubber)
        engine.model.body_mass[2] *= 1.0 + restitution
        engine.model.opt.gravity[2] *= 1.0 + restitution
        engines.append(engine)
    return engines


@pytest.mark.parametrize("nthread", [1, 2, 5])
def test_each_rollout_is_that_of_its_engine_alone(nthread):
    engines = rubber_balls([0.1, 0.3, 0.5, 0.7, 0.9, 1.0])
    engines.append(engines[0])  # once more, for two rollouts share it then
    data = engines[0].make_data()
    data.qpos[2] = 0.4
    initial = get_state(engines[0], data, FULL_PHYSICS)
    control = np.random.default_rng(1).normal(size=(len(engines), 100, 1))
    for _ in range(2):  # with new simulations, then with those that are kept
        state, sensordata = dashpot.rollout(engines, initial, control, nthread=nthread)
        for i, engine in enumerate(engines):
            alone, alone_sensors = dashpot.rollout(engine, initial, control[i], nthread=1)
            np.testing.assert_array_equal(state[i], alone[0])
            np.testing.assert_array_equal(sensordata[i], alone_sensors[0])
    heights = state[:, -1, 3]
    assert len(np.unique(heights)) == len(engines) - 1


def test_engines_that_differ_in_size_are_named():
    first = make_engine()
    other = dashpot.Engine(
        mujoco.MjModel.from_xml_string(XML.replace("<sensor>", "<sensor><clock/>"))
    )
    initial = get_state(first, first.make_data(), FULL_PHYSICS)
    with pytest.raises(
        ValueError, match=r"sensordata has 5 numbers in engine\[1\], 4 in engine\[0\]"
    ):
        dashpot.rollout([first, other], initial)


@pytest.mark.parametrize(
    ("engines", "error", "message"),
    [
        ([], ValueError, "engine is an empty sequence"),
        ("engine", TypeError, "engine is str"),
        ([1], TypeError, r"engine\[0\] is int"),
    ],
)
def test_what_is_no_sequence_of_engines_is_refused(engines, error, message):
    with pytest.raises(error, match=message):
        dashpot.rollout(engines, np.zeros((1, 28)))


def test_number_of_engines_has_to_agree():
    engines = rubber_balls([0.1, 0.2])
    initial = np.tile(get_state(engines[0], engines[0].make_data(), FULL_PHYSICS), (3, 1))
    with pytest.raises(
        ValueError, match="nbatch does not agree: engine has 2, initial_state has 3"
    ):
        dashpot.rollout(engines, initial)


# --- Outputs --------------------------------------------------------------------------------------


def test_outputs_are_written_and_returned():
    engine = make_engine()
    initial = np.tile(get_state(engine, engine.make_data(), FULL_PHYSICS), (3, 1))
    state, sensordata = np.full((3, 20, initial.shape[1]), np.nan), np.full((3, 20, 4), np.nan)
    found = dashpot.rollout(engine, initial, state=state, sensordata=sensordata)
    assert found[0] is state
    assert found[1] is sensordata
    expected = dashpot.rollout(engine, initial, nstep=20)
    np.testing.assert_array_equal(state, expected[0])
    np.testing.assert_array_equal(sensordata, expected[1])
    only = np.empty((3, 20, 4))
    new, same = dashpot.rollout(engine, initial, sensordata=only)
    assert same is only
    np.testing.assert_array_equal(new, expected[0])


def test_a_rollout_may_go_on_in_the_array_that_it_starts_from():
    engine = make_engine()
    initial = get_state(engine, engine.make_data(), FULL_PHYSICS)
    state = np.tile(initial, (2, 5, 1))
    expected, _ = dashpot.rollout(engine, state[:, -1], nstep=5)
    dashpot.rollout(engine, state[:, -1], state=state)
    np.testing.assert_array_equal(state, expected)


@pytest.mark.parametrize(
    ("outputs", "error", "message"),
    [
        ({"state": np.zeros((3, 4, 28))}, ValueError, r"state must be of shape \(3, 4, 16\)"),
        ({"state": np.zeros((2, 4, 16))}, ValueError, "nbatch does not agree"),
        ({"state": np.zeros((1, 4, 16))}, ValueError, "nbatch does not agree"),
        ({"state": np.zeros((4, 16))}, ValueError, "state must have three dimensions"),
        ({"state": np.zeros((3, 4, 16), dtype=np.float32)}, TypeError, "array of float64.*float32"),
        (
            {"state": [[[0.0]]]},
            TypeError,
            "state must be an array of float64 to write to, got list",
        ),
        ({"sensordata": np.zeros((3, 4, 8))[:, :, ::2]}, ValueError, "sensordata must be C-contig"),
        ({"sensordata": np.zeros((3, 1, 4)), "nstep": 2}, ValueError, "nstep does not agree"),
    ],
)
def test_outputs_that_do_not_fit_are_named(outputs, error, message):
    engine = make_engine()
    initial = np.tile(get_state(engine, engine.make_data(), FULL_PHYSICS), (3, 1))
    with pytest.raises(error, match=message):
        dashpot.rollout(engine, initial, **outputs)


def test_outputs_that_may_not_be_written_are_refused():
    engine = make_engine()
    initial = get_state(engine, engine.make_data(), FULL_PHYSICS)
    state = np.zeros((1, 4, 16))
    state.flags.writeable = False
    with pytest.raises(ValueError, match="writeable"):
        dashpot.rollout(engine, initial, state=state)
    both = np.zeros(1000)
    with pytest.raises(ValueError, match="state and sensordata share memory"):
        dashpot.rollout(
            engine,
            initial,
            state=both[:64].reshape(1, 4, 16),
            sensordata=both[32:48].reshape(1, 4, 4),
        )
