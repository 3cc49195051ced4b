"""MuJoCo's arena: what does not fit into it fails alike in one call of many steps and in many."""

import mujoco
import numpy as np
import pytest

import dashpot

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
STEPS = 3


@pytest.fixture(autouse=True)
def log_of_warnings(tmp_path, monkeypatch):
    """MuJoCo writes its warnings into a file of the working directory."""
    monkeypatch.chdir(tmp_path)


def boxes_in_a_row(memory: int, sensors: str = "") -> dashpot.Engine:
    """30 boxes on a floor: 120 contacts, whose rows MuJoCo could not keep in 110,000 bytes."""
    boxes = "".join(
        f'<body pos="{0.25 * i} 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'
        for i in range(30)
    )
    return dashpot.Engine(
        mujoco.MjModel.from_xml_string(f"""<mujoco><size memory="{memory}"/><worldbody>
        <geom type="plane" size="9 9 .1"/><site name="origin"/>{boxes}</worldbody>
        {sensors}</mujoco>""")
    )


def state_of(engine: dashpot.Engine, data: mujoco.MjData) -> np.ndarray:
    state = np.zeros(mujoco.mj_stateSize(engine.model, STATE))
    mujoco.mj_getState(engine.model, data, state, STATE)
    return state


def test_forces_that_cannot_be_reported_do_not_change_the_motion():
    ends = []
    for memory in (110_000, 20_000_000):
        engine = boxes_in_a_row(memory)
        apart, together = engine.make_data(), engine.make_data()
        start = state_of(engine, apart)
        rolled, _ = dashpot.rollout(engine, start, nstep=STEPS, with_memory=True)
        for _ in range(STEPS):
            assert engine.step(apart).contacts == 120
        engine.step(together, nstep=STEPS)
        final = state_of(engine, apart)
        assert np.array_equal(state_of(engine, together), final)
        assert np.array_equal(rolled[0, -1], final)
        ends.append(final)
        for data in (apart, together):
            fits = memory > 110_000
            assert (data.warning[mujoco.mjtWarning.mjWARN_CNSTRFULL].number == 0) == fits
            if fits:
                assert len(engine.contacts(data)) == 120
            else:
                with pytest.raises(RuntimeError, match="memory"):
                    engine.contacts(data)
    assert np.array_equal(*ends)


@pytest.mark.parametrize("nstep", [1, 2, STEPS])
def test_rows_that_a_sensor_reads_are_missed_in_every_step(nstep):
    engine = boxes_in_a_row(
        110_000, '<sensor><framelinacc objtype="site" objname="origin"/></sensor>'
    )
    data = engine.make_data()
    start = state_of(engine, data)
    with pytest.raises(RuntimeError, match=r"memory of the model; enlarge <size memory"):
        engine.step(data, nstep=nstep)
    assert np.array_equal(state_of(engine, data), start)
    with pytest.raises(ValueError, match=r"rollout 0, step 0: .*<size memory"):
        dashpot.rollout(engine, start, nstep=nstep)


def test_steps_that_lack_memory_for_their_computation_are_errors_that_keep_the_state():
    """MuJoCo would end the process. With more and more memory, one step succeeds as three do."""
    succeeded = []
    for memory in range(80_000, 400_000, 5_000):
        engine = boxes_in_a_row(memory)
        apart, together = engine.make_data(), engine.make_data()
        errors = []
        for data, nstep in ((together, STEPS), *[(apart, 1)] * STEPS):
            before = state_of(engine, data)
            try:
                engine.step(data, nstep=nstep)
            except RuntimeError as error:
                errors.append(str(error))
                if data is apart:
                    assert np.array_equal(state_of(engine, data), before)
                    break
            assert data.pstack == 0
        assert np.array_equal(state_of(engine, together), state_of(engine, apart))
        assert len(errors) in (0, 2)
        assert all("<size memory" in error for error in errors)
        succeeded.append(not errors)
    assert succeeded[-1]
    assert not all(succeeded)


def test_callbacks_of_the_smooth_stage_see_no_contacts():
    """So they need no rows of contacts, which would not fit here."""
    engine = boxes_in_a_row(110_000)
    data = engine.make_data()
    engine.step(data)
    assert data.ncon == 120
    seen = []

    def look(model, data, *_) -> None:
        seen.append((data.ncon, data.nefc))

    setters = (mujoco.set_mjcb_control, mujoco.set_mjcb_passive)
    try:
        for setter in setters:
            setter(look)
        engine.step(data, nstep=2)
    finally:
        for setter in setters:
            setter(None)
    assert seen == [(0, 0)] * 4
