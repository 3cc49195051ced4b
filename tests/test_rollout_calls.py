"""Calls of `mujoco.rollout`, made to both: the same shapes, numbers and kinds of errors."""

import copy

import mujoco
import numpy as np
import pytest
from mujoco import rollout as mujoco_rollout

import dashpot

# No contacts: a driven arm of two links, which MuJoCo's own integrator moves in both.
MODEL = mujoco.MjModel.from_xml_string("""
<mujoco><option timestep="0.004"/><worldbody><body pos="0 0 1">
  <joint name="a" axis="0 1 0" damping=".1"/>
  <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" contype="0" conaffinity="0"/>
  <body pos=".3 0 0"><joint name="b" axis="0 1 0"/>
    <geom type="capsule" size=".02" fromto="0 0 0 .2 0 0" contype="0" conaffinity="0"/></body>
</body></worldbody>
<actuator><motor joint="a"/><general joint="b" dyntype="filter" dynprm=".1" gainprm="2"/></actuator>
<sensor><jointpos joint="a"/><jointvel joint="b"/></sensor></mujoco>""")
RNG = np.random.default_rng(0)
START = RNG.normal(size=6)  # time, qpos, qvel, act
STARTS = RNG.normal(size=(3, 6))
CONTROL = RNG.normal(size=(3, 5, 2))


def both(**arguments):
    """Return what both say to a call: shapes and arrays, or the exception."""
    data = arguments.pop("data", mujoco.MjData(MODEL))
    model, engine = MODEL, dashpot.Engine(MODEL)
    if arguments.pop("list_of_models", False):
        model, engine = [MODEL] * 3, [engine] * 3
    found = []
    for roll_out, stepped in (
        (mujoco_rollout.rollout, model),
        (dashpot.rollout, engine),
    ):
        given = copy.deepcopy({name: value for name, value in arguments.items()})
        positional = [given.pop(name) for name in ("initial_state", "control") if name in given]
        try:
            found.append(roll_out(stepped, data, *positional, **given))
        except Exception as error:
            found.append(error)
    return found


TAKEN = {
    "one state": {"initial_state": START, "nstep": 4},
    "states": {"initial_state": STARTS},
    "controls": {"initial_state": STARTS, "control": CONTROL},
    "controls for all": {"initial_state": STARTS, "control": CONTROL[:1]},
    "state for all": {"initial_state": START, "control": CONTROL},
    "constant control": {"initial_state": STARTS, "control": CONTROL[:, :1], "nstep": 7},
    "one control": {"initial_state": STARTS, "control": CONTROL[0, 0], "nstep": 2},
    "models": {"initial_state": STARTS, "control": CONTROL, "list_of_models": True},
    "warm start": {"initial_state": START, "nstep": 4, "initial_warmstart": np.ones(2)},
    "warm starts": {"initial_state": STARTS, "initial_warmstart": np.ones((3, 2))},
    "batch of warm starts": {"initial_state": START, "initial_warmstart": np.ones((4, 2))},
    "warm start for all": {"initial_state": STARTS, "initial_warmstart": np.ones((1, 2))},
    "warm start of nan": {"initial_state": START, "initial_warmstart": np.full(2, np.nan)},
    "list of data": {"initial_state": STARTS, "data": [mujoco.MjData(MODEL)]},
    "two data": {"initial_state": STARTS, "control": CONTROL,
                 "data": [mujoco.MjData(MODEL) for _ in range(2)]},
    "four data": {"initial_state": STARTS, "data": [mujoco.MjData(MODEL) for _ in range(4)]},
    "chunks": {"initial_state": STARTS, "chunk_size": 2},
    "chunk_size 0": {"initial_state": STARTS, "chunk_size": 0},
    "pool": {"initial_state": STARTS, "persistent_pool": True,
             "data": [mujoco.MjData(MODEL) for _ in range(2)]},
    "forces": {"initial_state": STARTS, "control": CONTROL,
               "control_spec": mujoco.mjtState.mjSTATE_QFRC_APPLIED},
    "outputs": {"initial_state": STARTS, "state": np.zeros((3, 5, 6)),
                "sensordata": np.zeros((3, 5, 2))},
    "integers": {"initial_state": np.ones((2, 6), dtype=int)},
    "numpy's integer": {"initial_state": START, "nstep": np.int64(3)},
}  # fmt: skip
REFUSED = {
    "text for states": {"initial_state": "here"},
    "text for controls": {"initial_state": START, "control": "string"},
    "text for warm starts": {"initial_state": START, "initial_warmstart": "string"},
    "list for an output": {"initial_state": START, "state": [1.0]},
    "text for an output": {"initial_state": START, "sensordata": "x"},
    "half a step": {"initial_state": START, "nstep": 1.5},
    "half a chunk": {"initial_state": START, "chunk_size": 0.5},
    "negative steps": {"initial_state": START, "nstep": -1},
    "states too long": {"initial_state": np.ones((1, 7))},
    "states too short": {"initial_state": np.ones(5)},
    "states of three axes": {"initial_state": np.ones((1, 1, 6))},
    "controls too long": {"initial_state": START, "control": np.ones((1, 3, 3))},
    "controls of four axes": {"initial_state": START, "control": np.ones((2, 3, 4, 2))},
    "warm start too long": {"initial_state": START, "initial_warmstart": np.ones(3)},
    "warm start of three axes": {"initial_state": START, "initial_warmstart": np.ones((1, 1, 2))},
    "number of warm starts": {"initial_state": STARTS, "initial_warmstart": np.ones((4, 2))},
    "number of controls": {"initial_state": STARTS, "control": np.ones((2, 5, 2))},
    "number of models": {"initial_state": STARTS[:2], "list_of_models": True},
    "steps of an output": {"initial_state": STARTS, "control": CONTROL,
                           "state": np.zeros((3, 6, 6))},
    "steps of controls": {"initial_state": STARTS, "control": CONTROL, "nstep": 4},
    "width of an output": {"initial_state": START, "state": np.zeros((1, 1, 5))},
    "no bits of a user": {"initial_state": START, "control_spec": mujoco.mjtState.mjSTATE_ACT},
    "no data": {"initial_state": START, "data": []},
}  # fmt: skip


@pytest.mark.parametrize("arguments", TAKEN.values(), ids=TAKEN)
def test_what_mujoco_rollout_takes_gives_the_same(arguments):
    theirs, ours = both(**arguments)
    for found, expected in zip(ours, theirs, strict=True):
        assert found.shape == expected.shape
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("arguments", REFUSED.values(), ids=REFUSED)
def test_where_mujoco_rollout_raises_a_value_error_so_does_dashpot(arguments):
    theirs, ours = both(**arguments)
    assert isinstance(theirs, ValueError), theirs
    assert isinstance(ours, ValueError), ours


def test_names_of_arguments_are_those_of_mujoco_rollout():
    theirs, _ = mujoco_rollout.rollout(
        model=MODEL, data=mujoco.MjData(MODEL), initial_state=STARTS, control=CONTROL
    )
    engine = dashpot.Engine(MODEL)
    data = [mujoco.MjData(MODEL) for _ in range(2)]
    for given in (
        dashpot.rollout(engine=engine, data=data, initial_state=STARTS, control=CONTROL),
        dashpot.rollout(engine, data[0], initial_state=STARTS, control=CONTROL),
        dashpot.rollout(engine, data, STARTS, CONTROL, skip_checks=True),
        # Without data, as dashpot has no use for them:
        dashpot.rollout(engine, STARTS, CONTROL),
        dashpot.rollout(engine, STARTS, control=CONTROL),
        dashpot.rollout(engine, STARTS.tolist(), CONTROL.tolist()),
        dashpot.rollout(engine, initial_state=STARTS, control=CONTROL),
    ):
        np.testing.assert_array_equal(given[0], theirs)


def test_data_are_neither_read_nor_written():
    engine = dashpot.Engine(MODEL)
    data = [mujoco.MjData(MODEL), engine.make_data()]
    for each in data:
        each.qpos[:], each.ctrl[:], each.qfrc_applied[:] = 0.3, 5.0, 7.0
    found, _ = dashpot.rollout(engine, data, STARTS, nstep=20)
    expected, _ = dashpot.rollout(engine, STARTS, nstep=20)
    np.testing.assert_array_equal(found, expected)
    assert all((each.qpos == 0.3).all() and each.time == 0.0 for each in data)


def test_data_with_a_thread_pool_are_refused():
    data = [mujoco.MjData(MODEL) for _ in range(2)]
    mujoco.mju_threadpool(data[1], 2)
    with pytest.raises(ValueError, match=r"^data\[1\] has a thread pool"):
        dashpot.rollout(dashpot.Engine(MODEL), data, STARTS)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"data": [mujoco.MjData(MODEL), 3]}, r"^data\[1\] is int; it must be a mujoco.MjData"),
        ({"data": [mujoco.MjData(MODEL)] * 2, "nthread": 3}, "^nthread is 3, but data are 2"),
        ({"data": STARTS, "control": CONTROL}, "^data is ndarray; it must be a mujoco.MjData"),
        ({"data": mujoco.MjData(MODEL), "initial_state": None}, "^initial_state is missing"),
        ({"skip_checks": "no"}, "^skip_checks must be True or False"),
        ({"persistent_pool": 1}, "^persistent_pool must be True or False"),
        ({"chunk_size": -1}, "^chunk_size must be >= 0"),
    ],
)
def test_what_is_wrong_with_a_call_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        dashpot.rollout(dashpot.Engine(MODEL), **({"initial_state": STARTS} | arguments))


@pytest.mark.parametrize("name", ["initial_state", "control", "initial_warmstart", "state"])
def test_a_wrong_type_is_a_type_error_and_a_value_error(name):
    for error in (TypeError, ValueError):
        with pytest.raises(error, match=f"^{name} must be"):
            dashpot.rollout(dashpot.Engine(MODEL), **({"initial_state": STARTS} | {name: "x"}))
