"""Islands that sleep stay as they came to rest, without contacts, and wake unharmed."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot import Engine

TIMESTEP, GRAVITY = 0.002, 9.81
ASLEEP_WITHIN = 500  # steps that everything here takes to come to rest and fall asleep

STACK = "".join(
    f'<body name="box{i}" pos="0 0 {0.05 + 0.1 * i}"><freejoint/>'
    f'<geom name="box{i}" type="box" size=".05 .05 .05" mass="1"/></body>'
    for i in range(3)
)


BESIDE = '<body pos="{beside}"><freejoint/><geom type="box" size=".05 .05 .05" mass="1"/></body>'


def make(
    bodies: str,
    *,
    more: str = "",
    option: str = "",
    sleep: bool = True,
    plane: str = "",
    **options: object,
) -> tuple[Engine, mujoco.MjData]:
    """Return an engine, and data at rest that sleep where they may."""
    flag = '<flag sleep="enable"/>' if sleep else ""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{TIMESTEP}" {option}>{flag}</option><worldbody>
        <geom name="floor" type="plane" size="9 9 .1" {plane}/>{bodies}</worldbody>
        {more}</mujoco>"""
    )
    engine = Engine(model, **options)
    data = engine.make_data()
    engine.step(data, nstep=ASLEEP_WITHIN)
    return engine, data


def asleep(data: mujoco.MjData) -> list[bool]:
    """Return for each tree whether it sleeps."""
    return [bool(next_tree >= 0) for next_tree in data.tree_asleep]


def total(engine: Engine, data: mujoco.MjData) -> float:
    """Return what the ledger keeps (J)."""
    energy = engine.energy(data)
    return energy.total - energy.work


INTEGRATORS = ["Euler", "implicit", "implicitfast"]


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("options", [{}, {"impact": "cut"}, {"nthread": 2}], ids=str)
def test_a_stack_that_sleeps_stays_bit_for_bit(integrator, options) -> None:
    engine, data = make(STACK, option=f'integrator="{integrator}"', **options)
    assert all(asleep(data))
    assert data.ntree_awake == 0
    position, energy = data.qpos.copy(), engine.energy(data)
    stats = engine.step(data, nstep=2000)
    np.testing.assert_array_equal(data.qpos, position)
    assert not data.qvel.any()
    assert not data.qacc.any()
    assert engine.energy(data) == energy
    assert (stats.contacts, stats.islands) == (0, 0)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_stack_wakes_as_it_fell_asleep(integrator) -> None:
    """A push of one step wakes all of it, and no spring lets go."""
    engine, data = make(STACK, option=f'integrator="{integrator}" sleep_tolerance="1e-8"')
    position = data.qpos.copy()
    data.xfrc_applied[3, 2] = -1e-6
    engine.step(data)
    assert not any(asleep(data))
    data.xfrc_applied[:] = 0.0
    for _ in range(50):
        engine.step(data)
        # The push gives 2e-9 m/s for some 5 ms; a spring that forgot its load lets it sag by 1e-6.
        assert np.abs(data.qpos - position).max() < 1e-10


def test_friction_holds_what_wakes_on_a_slope() -> None:
    """The elastic displacement of friction is remembered: a box on a slope does not creep."""
    tilt = np.radians(20)
    engine, data = make(
        '<body pos="0 0 .05"><freejoint/><geom type="box" size=".05 .05 .05" mass="1"/></body>',
        option=f'gravity="{GRAVITY * np.sin(tilt)} 0 {-GRAVITY * np.cos(tilt)}"'
        ' sleep_tolerance="1e-8"',
        plane='friction="0.5"',
    )
    assert all(asleep(data))
    start = data.qpos.copy()
    for _ in range(20):
        data.xfrc_applied[1, 2] = -1e-9
        engine.step(data)
        data.xfrc_applied[:] = 0.0
        assert not any(asleep(data))
        engine.step(data, nstep=40)
        assert all(asleep(data))
    assert np.abs(data.qpos - start).max() < 1e-9


def struck(*, sleep: bool) -> tuple[np.ndarray, float]:
    """Return where a row of boxes ends that a ball has struck, and the drift of the ledger."""
    row = "".join(
        f'<body pos="{0.11 * i} 0 .05"><freejoint/>'
        '<geom type="box" size=".05 .05 .05" mass="1"/></body>'
        for i in range(3)
    )
    ball = (
        '<body pos="-.3 0 .05"><joint type="slide" axis="1 0 0"/><geom size=".05" mass="2"/></body>'
    )
    engine, data = make(row + ball, sleep=sleep, plane='friction="0.5"')
    if sleep:
        assert asleep(data) == [True] * 4
    start = total(engine, data) + 0.5 * 2 * 2.0**2
    data.qvel[18] = 2.0
    drift = 0.0
    for _ in range(500):
        engine.step(data)
        drift = max(drift, abs(total(engine, data) - start))
    return data.qpos.copy(), drift


def test_what_sleeps_is_struck_as_what_rests_awake() -> None:
    """The first box wakes when the ball comes, the others when boxes do; all end as awake ones."""
    (asleep_end, drift), (awake_end, _) = struck(sleep=True), struck(sleep=False)
    assert awake_end[14] > 0.26  # the last one was reached
    # Faces that hit flat turn by what the boxes still moved when they were struck; 2 % of the way.
    np.testing.assert_allclose(asleep_end, awake_end, atol=4e-3)
    assert drift < 1e-3 * 4.0


def test_the_ledger_closes_over_sleep() -> None:
    """Energy is kept while a part falls asleep, sleeps and wakes."""
    engine, data = make(STACK + '<body pos="2 0 1"><freejoint/><geom size=".1" mass="1"/></body>')
    data.qpos[23] = 1.0
    data.qvel[:] = 0.0
    start, drift, slept = total(engine, data), 0.0, 0
    for k in range(3000):
        data.xfrc_applied[1, 0] = 1.0 if k == 1500 else 0.0
        engine.step(data)
        slept += all(asleep(data))
        drift = max(drift, abs(total(engine, data) - start))
    assert slept > 1000
    assert drift < 1e-3 * GRAVITY * 0.9


HELD = """<body pos="2 0 1"><joint axis="0 1 0" damping=".5" range="-.4 .4" limited="true"/>
  <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1"/></body>
<body pos="3 0 1"><joint axis="0 1 0" frictionloss="5" damping=".5"/>
  <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1"/></body>
<body name="hung" pos="4 0 1"><freejoint/><geom size=".05" mass="1"/></body>
<body name="other" pos="5 0 1"><joint axis="0 1 0" stiffness="50" damping="2"/>
  <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1"/></body>"""
HANG = '<equality><weld body1="hung" anchor="4 0 1"/></equality>'


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_limits_friction_equalities_and_springs_hold_what_wakes(integrator) -> None:
    """Each bears its load when it wakes as when it fell asleep."""
    engine, data = make(HELD, more=HANG, option=f'integrator="{integrator}" sleep_tolerance="1e-8"')
    engine.step(data, nstep=1500)
    assert all(asleep(data))
    position = data.qpos.copy()
    data.qfrc_applied[:] = 1e-9
    engine.step(data)
    assert not any(asleep(data))
    data.qfrc_applied[:] = 0.0
    for _ in range(50):
        engine.step(data)
        assert np.abs(data.qpos - position).max() < 1e-9


@pytest.mark.parametrize("change", ["position", "velocity", "force", "torque"])
def test_what_is_changed_wakes_with_its_island_alone(change) -> None:
    engine, data = make(STACK + HELD, more=HANG)
    engine.step(data, nstep=1000)
    assert all(asleep(data))
    if change == "position":
        data.qpos[2] += 1e-3
    elif change == "velocity":
        data.qvel[0] = 1e-9
    elif change == "force":
        data.xfrc_applied[1, 0] = 1e-9
    else:
        data.qfrc_applied[4] = 1e-9
    engine.step(data)
    assert asleep(data) == [False] * 3 + [True] * 4


def test_what_hangs_falls_when_it_is_let_go_and_stays_when_it_is_held() -> None:
    """Equalities that are switched while what they hold sleeps wake it."""
    engine, data = make(HELD, more=HANG)
    engine.step(data, nstep=1000)
    assert all(asleep(data))
    data.eq_active[0] = 0
    engine.step(data, nstep=50)
    # To a step.
    assert data.body("hung").xpos[2] == pytest.approx(1 - 0.5 * GRAVITY * 0.1**2, abs=4e-3)
    assert asleep(data) == [True, True, False, True]
    engine.step(data, nstep=1000)
    assert all(asleep(data))
    assert data.body("hung").xpos[2] == pytest.approx(0.05, abs=1e-4)
    data.eq_active[0] = 1
    # It closes at recovery_speed, without a velocity of its own.
    engine.step(data, nstep=round(9 / TIMESTEP))
    assert asleep(data) == [True, True, False, True]
    engine.step(data, nstep=round(2 / TIMESTEP))
    assert all(asleep(data))
    assert data.body("hung").xpos[2] == pytest.approx(1.0, abs=0.02)  # as its solref lets it sag


def test_equalities_that_are_disabled_wake_nothing() -> None:
    engine, data = make(HELD, more=HANG)
    engine.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    engine.step(data, nstep=2000)
    for _ in range(20):
        assert all(asleep(data))
        engine.step(data)
    engine.model.opt.disableflags = 0
    engine.step(data)
    assert asleep(data) == [True, True, False, True]


LIFT = """<body name="lift" mocap="true" pos="7 0 .05"><geom type="box" size=".3 .3 .05"/></body>
<body name="part" pos="7 0 .15"><freejoint/><geom type="box" size=".05 .05 .05" mass="1"/></body>"""


@pytest.mark.parametrize("speed", [0.2, 1e-5])
def test_what_sleeps_on_a_lift_goes_with_it(speed) -> None:
    """Also with one that is slower than the tolerance of sleep: nothing sleeps on what moves."""
    engine, data = make(LIFT, mocap_timeconst=0.0)
    assert all(asleep(data))
    start, apart = data.qpos[2], 0.0
    for k in range(300):
        data.mocap_pos[0, 2] = 0.05 + speed * TIMESTEP * (k + 1)
        engine.step(data)
        apart = max(apart, abs(data.qpos[2] - start - (data.mocap_pos[0, 2] - 0.05)))
    assert not any(asleep(data))
    # The lift starts with a jump in velocity, which compresses what stands on it.
    assert apart < speed * TIMESTEP + 1e-7
    engine.step(data, nstep=ASLEEP_WITHIN)
    assert all(asleep(data))
    data.mocap_pos[0, 0] += 0.05
    engine.step(data)
    assert not any(asleep(data))


def test_what_a_moving_mocap_body_holds_wakes() -> None:
    hand = """<body name="hand" mocap="true" pos="4 0 1">
      <geom size=".01" contype="0" conaffinity="0"/></body>"""
    weld = '<equality><weld body1="hung" body2="hand"/></equality>'
    engine, data = make(hand + HELD, more=weld, mocap_timeconst=0.0)
    engine.step(data, nstep=1000)
    assert all(asleep(data))
    for k in range(100):
        data.mocap_pos[0, 2] = 1 + 0.1 * TIMESTEP * (k + 1)
        engine.step(data)
    assert not asleep(data)[2]
    assert data.body("hung").xpos[2] == pytest.approx(1 + 0.1 * TIMESTEP * 100, abs=2e-3)


def test_comfree_sleeps_too() -> None:
    engine, data = make(STACK, law="comfree")
    assert all(asleep(data))
    position = data.qpos.copy()
    engine.step(data, nstep=100)
    np.testing.assert_array_equal(data.qpos, position)
    data.qvel[2] = 0.5
    engine.step(data, nstep=5)
    assert data.qpos[2] > position[2]


@pytest.mark.parametrize("law", ["kelvin_voigt", "comfree"])
def test_linkages_that_start_asleep_stay_so(law: str) -> None:
    """No step has found their inertia yet."""
    links = """<body pos="3 0 1" sleep="init"><joint axis="0 1 0"/><geom size=".1" pos=".2 0 0"/>
      <body pos=".4 0 0"><joint axis="0 1 0"/><geom size=".1"/></body></body>"""
    _, data = make(links + STACK, law=law)
    np.testing.assert_array_equal(data.qpos[:2], 0.0)
    assert asleep(data)[0]


def test_nothing_sleeps_that_may_not() -> None:
    """Actuated trees, by default, those that tendons couple, and all where the flag is off."""
    never = '<body pos="1 0 .05" sleep="never"><freejoint/><geom size=".05"/></body>'
    motor = """<body pos="2 0 1"><joint name="j" axis="0 1 0" damping="1"/>
      <geom size=".1" pos="0 0 -.2"/></body>"""
    actuator = '<actuator><motor joint="j"/></actuator>'
    engine, data = make(STACK + never + motor, more=actuator)
    engine.step(data, nstep=1000)
    assert asleep(data) == [True] * 3 + [False] * 2
    engine.model.opt.enableflags = 0
    engine.step(data)
    assert not any(asleep(data))
    assert not any(asleep(make(STACK, sleep=False)[1]))


def test_what_starts_asleep_stays_until_it_is_touched() -> None:
    floating = '<body pos="0 0 1" sleep="init"><freejoint/><geom size=".1" mass="1"/></body>'
    falling = '<body pos="0 0 1.5"><freejoint/><geom size=".1" mass="1"/></body>'
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{TIMESTEP}"><flag sleep="enable"/></option><worldbody>
        {floating}{falling}</worldbody></mujoco>"""
    )
    engine = Engine(model)
    data = engine.make_data()
    assert asleep(data) == [True, False]
    meets = np.sqrt(2 * 0.3 / GRAVITY)
    engine.step(data, nstep=int(meets / TIMESTEP) - 1)
    assert asleep(data) == [True, False]
    np.testing.assert_array_equal(data.qpos[:3], [0, 0, 1])
    engine.step(data, nstep=3)
    assert not any(asleep(data))
    # Momentum of both, of free fall for what fell all the time; the other fell for two steps.
    fallen = data.time * GRAVITY
    assert -(data.qvel[2] + data.qvel[8]) == pytest.approx(fallen, abs=3 * TIMESTEP * GRAVITY)


def test_rollouts_start_awake_and_fall_asleep() -> None:
    engine, data = make(STACK)
    state = np.empty(mujoco.mj_stateSize(engine.model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(engine.model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    states, _ = dashpot.rollout(engine, state[None], nstep=800, nthread=1)
    again, _ = dashpot.rollout(engine, np.repeat(state[None], 3, axis=0), nstep=800, nthread=2)
    np.testing.assert_array_equal(again, np.repeat(states, 3, axis=0))
    velocity = states[0, :, -engine.model.nv :]
    # Without memory boxes begin anew to be pressed together; asleep they do not move at all.
    assert velocity[0].any()
    assert not velocity[-100:].any()
    np.testing.assert_array_equal(states[0, -1, 1:], states[0, -100, 1:])


def test_contacts_of_what_sleeps_are_not_listed() -> None:
    """As in MuJoCo; they are again when it wakes, with the forces that they bore."""
    engine, data = make(STACK, option='sleep_tolerance="1e-8"')
    assert len(engine.contacts(data).gap) == 0
    data.qfrc_applied[2] = 1e-9
    engine.step(data)
    contacts = engine.contacts(data)
    below = [i for i, pair in enumerate(contacts.geom) if 0 in pair]
    assert contacts.force[below, 0].sum() == pytest.approx(3 * GRAVITY, rel=1e-3)


def test_threads_agree_bit_for_bit() -> None:
    ends = []
    for nthread in (1, 2):
        row = "".join(
            f'<body pos="{0.3 * (i % 5)} {0.3 * (i // 5)} {0.06 + 0.1 * (i % 3)}"><freejoint/>'
            '<geom type="box" size=".05 .05 .05" mass="1"/></body>'
            for i in range(20)
        )
        engine, data = make(row, nthread=nthread)
        assert any(asleep(data))
        data.qvel[0] = 2.0
        engine.step(data, nstep=600)
        ends.append(np.concatenate([data.qpos, data.qvel, data.tree_asleep]))
    np.testing.assert_array_equal(ends[0], ends[1])


def test_trees_without_rows_fall_asleep_as_in_mujoco() -> None:
    """Where MuJoCo leaves them when it puts them to sleep, which is one step later."""
    swings = """<body pos="0 0 1"><joint axis="0 1 0" damping=".3"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass="1"/></body>"""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{TIMESTEP}"><flag sleep="enable"/></option>
        <worldbody>{swings}</worldbody></mujoco>"""
    )
    engine, theirs = Engine(model), mujoco.MjData(model)
    ours = engine.make_data()
    theirs.qpos[0] = ours.qpos[0] = 0.5
    while not any(asleep(ours)):
        engine.step(ours)
        mujoco.mj_step(model, theirs)
    for _ in range(5):
        mujoco.mj_step(model, theirs)
        engine.step(ours)
    assert any(asleep(theirs))
    np.testing.assert_array_equal(ours.qpos, theirs.qpos)


@pytest.mark.parametrize("impact", ["none", "cut"])
def test_a_step_that_is_refused_wakes_nothing(impact) -> None:
    """What comes down on a stack, or pulls at it, wakes it, but not in a step that raises."""
    bodies = STACK + BESIDE.format(beside="2 0 .1")
    sensor = '<sensor><user dim="1" needstage="acc"/></sensor>'
    engine, data = make(bodies, more=sensor, impact=impact)
    assert all(asleep(data))
    before, memory = np.array(data.tree_asleep), np.array(data.userdata)

    data.xfrc_applied[1, 2] = 1e15
    with pytest.raises(dashpot.DivergenceError):
        engine.step(data)
    assert np.array_equal(data.tree_asleep, before)
    data.xfrc_applied[1, 2] = 0.0

    def refuse(model: mujoco.MjModel, data: mujoco.MjData, stage: int) -> None:
        raise ZeroDivisionError(f"in stage {stage}, when {asleep(data)} sleep")

    data.qpos[21:24], data.qvel[20] = [0.0, 0.0, 0.349], -1.0
    mujoco.set_mjcb_sensor(refuse)
    try:
        with pytest.raises(ZeroDivisionError, match=r"when \[False, False, False, False\] sleep"):
            engine.step(data)
    finally:
        mujoco.set_mjcb_sensor(None)
    assert np.array_equal(data.tree_asleep, before)
    assert np.array_equal(data.userdata, memory)
