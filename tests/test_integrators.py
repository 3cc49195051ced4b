"""MuJoCo's integrators where no row is possible, and what becomes of them where one is."""

import itertools

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import dashpot

FULL_PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS
GRAVITY = 9.81
ROD = """<geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass=".5" contype="0"
  conaffinity="0"/>"""


def pendulum(first: str = "", second: str = "", tip: str = "", rest: str = "") -> str:
    """Two rods of 0.3 m on hinges along y, released horizontally."""
    return f"""<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1" pos="0 0 -.1"/>
      <body name="upper"><joint name="upper" axis="0 1 0" {first}/>{ROD}
        <body name="lower" pos=".3 0 0"><joint name="lower" axis="0 1 0" {second}/>{ROD}{tip}
      </body></body></worldbody>{rest}</mujoco>"""


SMOOTH = {
    "springs and dampers": pendulum('stiffness="3" damping=".1"', 'damping=".02 .01 .003"'),
    "activations": pendulum(
        rest="""<actuator>
        <general joint="upper" dyntype="filter" dynprm=".02" gainprm="3"/>
        <general joint="lower" dyntype="filterexact" dynprm=".05" gainprm="1" biastype="affine"
          biasprm="0 -1 -.1"/>
        <intvelocity joint="upper" kp="5" actrange="-2 2"/>
        <muscle joint="lower" force="1" lengthrange="-3 3"/></actuator>"""
    ),
    "fluid": pendulum().replace(
        "<worldbody>", '<option density="500" viscosity=".3" wind="1 0 .5"/><worldbody>'
    ),
    "tendons": pendulum(
        rest="""<tendon><fixed name="t" stiffness="5" damping=".1" springlength=".1">
        <joint joint="upper" coef="1"/><joint joint="lower" coef="-1"/></fixed></tendon>
        <actuator><motor tendon="t"/></actuator>"""
    ),
    "weightless, with armature": pendulum('armature=".01"').replace(
        '<body name="lower"', '<body name="lower" gravcomp="1"'
    ),
    "ball joints": """<mujoco><worldbody><body><joint type="ball" damping=".01"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/><body pos=".3 0 0">
      <joint type="ball"/><geom type="box" size=".05 .1 .02" contype="0"/></body></body>
      <body pos="1 0 0"><freejoint/><geom type="box" size=".05 .1 .02"/>
        <body pos="0 0 .1"><joint axis="1 1 0"/><geom type="box" size=".1 .02 .05" contype="0"/>
      </body></body></worldbody></mujoco>""",
}


def engine_of(
    xml: str, integrator: str, timestep: float = 0.002, **options
) -> tuple[dashpot.Engine, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.timestep = timestep
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    engine = dashpot.Engine(model, **options)
    return engine, engine.make_data()


def state_of(model: mujoco.MjModel, data: mujoco.MjData) -> bytes:
    """All that moves, without the memory that dashpot's engine adds."""
    fields = (data.qpos, data.qvel, data.act, data.ctrl, data.qacc_warmstart, data.time)
    return b"".join(np.asarray(field).tobytes() for field in fields)


@pytest.fixture
def control():
    """Set the control callback; after the test there is none."""
    yield mujoco.set_mjcb_control
    mujoco.set_mjcb_control(None)


# Of `discrete` without the ball joints, which it has stepped in parts as `implicit` has.
BITS = [(scene, integrator) for integrator in ("RK4", "implicit", "discrete") for scene in SMOOTH]
BITS.remove(("ball joints", "discrete"))


@pytest.mark.parametrize(("scene", "integrator"), BITS)
@pytest.mark.parametrize("impact", ["none", "cut"])
def test_without_rows_every_step_is_mujocos_to_the_bit(scene, integrator, impact):
    engine, ours = engine_of(SMOOTH[scene], integrator, impact=impact)
    engine.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model = mujoco.MjModel.from_xml_string(SMOOTH[scene])
    model.opt.integrator = engine.model.opt.integrator
    model.opt.timestep = engine.model.opt.timestep
    theirs = mujoco.MjData(model)
    rng = np.random.default_rng(1)
    for data in (ours, theirs):
        data.qvel[:] = np.linspace(-4.0, 5.0, model.nv)
    for _ in range(40):
        control, push = rng.normal(size=model.nu), rng.normal(size=6)
        for data in (ours, theirs):
            data.ctrl[:], data.xfrc_applied[1] = control, push
        parts = engine.step(ours, nstep=5).parts
        mujoco.mj_step(model, theirs, nstep=5)
        if parts > 1:
            # implicit throws the ball joints about, from 5 rad/s on, ever faster: what turns by
            # more than 0.3 rad in a step, its change of velocity added, is not followed any more.
            assert np.abs(theirs.qvel).max() * model.opt.timestep > 0.15
            assert (scene, integrator) == ("ball joints", "implicit")
            return
        assert state_of(model, ours) == state_of(model, theirs)


def test_the_control_callback_is_asked_in_every_stage(control):
    xml = pendulum(rest='<actuator><motor joint="upper"/><motor joint="lower"/></actuator>')
    engine, ours = engine_of(xml, "RK4")
    model = engine.model
    theirs = mujoco.MjData(model)
    asked: dict[int, list[float]] = {id(ours): [], id(theirs): []}

    def brake_and_push(_, data):
        asked[id(data)].append(data.time)
        data.ctrl[:] = -0.2 * data.qvel
        data.qfrc_applied[1] = np.sin(30 * data.time)
        data.xfrc_applied[1, 2] = data.qpos[0]

    control(brake_and_push)
    for _ in range(50):
        engine.step(ours)
        mujoco.mj_step(model, theirs)
        assert state_of(model, ours) == state_of(model, theirs)
        assert ours.qfrc_applied.tobytes() == theirs.qfrc_applied.tobytes()
    assert asked[id(ours)] == asked[id(theirs)]


@pytest.mark.parametrize("failing", [1, 2, 3, 4])
def test_a_callback_that_raises_in_a_stage_leaves_the_state_alone(control, failing):
    engine, data = engine_of(pendulum(rest='<actuator><motor joint="upper"/></actuator>'), "RK4")
    engine.step(data, nstep=3)
    before = state_of(engine.model, data)
    calls = 0

    def fail(_, __):
        nonlocal calls
        calls += 1
        if calls == failing:
            raise ArithmeticError

    control(fail)
    with pytest.raises(ArithmeticError):
        engine.step(data)
    assert state_of(engine.model, data) == before


def test_dampers_that_rk4_does_not_resolve_are_an_error_that_keeps_the_state():
    """As in mj_step they diverge where no row is possible; H D / M is 4 to 40."""
    engine, data = engine_of(pendulum('damping="40"', 'damping="10"'), "RK4", 0.005)
    data.qvel[:] = 10.0, -5.0
    before = b""

    def step() -> None:
        nonlocal before
        before = state_of(engine.model, data)
        engine.step(data)

    with pytest.raises(dashpot.DivergenceError, match="diverged"):
        all(step() is None for _ in range(1000))
    assert state_of(engine.model, data) == before
    assert np.isfinite(data.qpos).all()


@pytest.mark.parametrize("integrator", ["RK4", "implicit"])
@pytest.mark.parametrize("nthread", [1, 2])
def test_rollouts_and_splits_of_steps_give_the_same_bits(integrator, nthread):
    engine, data = engine_of(pendulum(tip='<geom pos=".3 0 0" size=".03"/>'), integrator)
    start = np.zeros((3, mujoco.mj_stateSize(engine.model, FULL_PHYSICS)))
    state = np.zeros_like(start[0])
    for i in range(3):
        mujoco.mj_resetData(engine.model, data)
        data.qvel[:] = i, 1.0
        mujoco.mj_getState(engine.model, data, start[i], FULL_PHYSICS)
    ends = dashpot.rollout(engine, start, nstep=200, nthread=nthread)[0][:, -1]
    for i in range(3):
        for split in (1, 40, 200):
            mujoco.mj_resetData(engine.model, data)
            mujoco.mj_setState(engine.model, data, start[i], FULL_PHYSICS)
            for _ in range(200 // split):
                stats = engine.step(data, nstep=split)
            mujoco.mj_getState(engine.model, data, state, FULL_PHYSICS)
            assert state.tobytes() == ends[i].tobytes()
    assert stats.contacts > 0


FREE = """<body pos="0 1 .4"><freejoint/><geom name="ball" size=".1" mass="1" condim="1"/></body>
  <body pos="0 2 -.05"><freejoint/><geom name="box" type="box" size=".05 .05 .05"/></body>"""


def throw(integrator: str, steps: int) -> mujoco.MjData:
    """Drop a ball and push a box beside an articulated tree."""
    xml = pendulum().replace("</worldbody>", f"{FREE}</worldbody>")
    engine, data = engine_of(xml, integrator, 0.005)
    engine.set_material("ball", dashpot.Material(1e4, restitution=0.9))
    for geom in ("box", "floor"):
        engine.set_material(geom, dashpot.Material(friction=(0.4, 0.0, 0.0)))
    data.qvel[8] = 2.0
    engine.step(data, nstep=steps)
    return data


@pytest.mark.parametrize("integrator", ["RK4", "implicit"])
def test_free_bodies_move_as_exactly_as_ever(integrator):
    """To the bit as with Euler, for which test_bounce, test_slide and others have closed forms."""
    ours, same = throw(integrator, 200), throw("Euler", 200)
    assert ours.qpos[2:].tobytes() == same.qpos[2:].tobytes()
    assert ours.qvel[2:].tobytes() == same.qvel[2:].tobytes()
    assert ours.qpos[9] == pytest.approx(2.0**2 / (2 * 0.4 * GRAVITY), abs=5e-5)
    assert np.abs(ours.qvel[8:14]).max() < 1e-9


def swing(xml: str, integrator: str, timestep: float, duration: float, tip=None) -> np.ndarray:
    """Return positions and velocities at the end."""
    engine, data = engine_of(xml, integrator, timestep)
    if tip is not None:
        engine.set_material("tip", tip)
    engine.step(data, nstep=round(duration / timestep))
    return np.concatenate([data.qpos, data.qvel])


def exact_swing(xml: str, duration: float, force) -> np.ndarray:
    """Return positions and velocities at the end, of MuJoCo's equations of motion without rows.

    `force(model, data)` are the generalized forces beside.
    """
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)

    def rates(_, state):
        data.qpos[:], data.qvel[:] = np.split(state, 2)
        data.qfrc_applied[:] = 0.0
        mujoco.mj_forward(model, data)
        data.qfrc_applied[:] = force(model, data)
        mujoco.mj_forward(model, data)
        return np.concatenate([data.qvel, data.qacc])

    start = np.concatenate([data.qpos, data.qvel])
    # Steps of 2 ms do not miss a contact.
    found = solve_ivp(rates, (0.0, duration), start, rtol=1e-9, atol=1e-10, max_step=2e-3)
    return found.y[:, -1]


def test_a_rod_that_dry_friction_slows_swings_to_second_order():
    """It slips one way all the time, so that friction is constant."""
    xml = pendulum('frictionloss=".1"')
    exact = exact_swing(xml, 0.2, lambda _, data: [-0.1 if data.qvel[0] >= 0.0 else 0.1, 0.0])
    errors = [np.abs(swing(xml, "Euler", h, 0.2) - exact).max() for h in (0.01, 0.005, 0.0025)]
    for coarse, fine in itertools.pairwise(errors):
        assert coarse / fine == pytest.approx(4.0, rel=0.25)


ROWS = {
    "limit": pendulum('range="-99 99" damping=".1"'),
    "limit that is hit": pendulum('range="-20 20" damping=".1"'),
    "dry friction": pendulum('frictionloss=".1"'),
    "servo at a contact": pendulum(
        'damping=".1"',
        'stiffness="2"',
        '<geom pos=".3 0 0" size=".03" mass=".1"/>',
        '<actuator><position joint="upper" kp="9" kv=".1"/></actuator>',
    ),
    "equality": pendulum(
        rest='<equality><joint joint1="upper" joint2="lower" polycoef="0 -1 0 0 0"/></equality>'
    ),
}


@pytest.mark.parametrize("scene", ROWS)
def test_rk4_is_stepped_as_euler_where_rows_are_possible(scene):
    """So no other test of rows asks for it; `Engine.report` says that it is mapped."""
    ends = [swing(ROWS[scene], name, 0.002, 0.5) for name in ("Euler", "RK4")]
    np.testing.assert_array_equal(*ends)
    engine, _ = engine_of(ROWS[scene], "RK4")
    assert "option integrator=RK4" in [f.name for f in engine.report().of("mapped")]


def test_a_tip_on_soft_ground_converges_to_second_order():
    """Its geometry is that of the middle of the step."""
    tip = '<geom name="tip" pos=".3 0 0" size=".03" mass=".1" condim="1"/>'
    soft = dashpot.Material(500.0, damping=1.0)
    xml = pendulum('damping=".05"', 'damping=".02"', tip)
    xml = xml.replace('name="floor"', 'name="floor" condim="1"')

    def pressed(model, data):
        ball = model.geom("tip").id
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacGeom(model, data, jacobian, None, ball)
        gap, rate = data.geom_xpos[ball, 2] - 0.03 + 0.1, jacobian[2] @ data.qvel
        return (max(0.0, -500.0 * gap - 1.0 * rate) if gap < 0.0 else 0.0) * jacobian[2]

    exact = exact_swing(xml, 0.2, pressed)
    errors = [np.abs(swing(xml, "Euler", h, 0.2, soft) - exact).max() for h in (0.008, 0.002)]
    # 16, but for the step in which it lands; 4 with the geometry of the start.
    assert errors[0] / errors[1] > 9.0


@pytest.mark.parametrize("timestep", [0.001, 0.004, 0.01])
def test_a_damped_arm_at_rest_loads_the_ground_with_its_weight(timestep):
    """Smooth forces are those of the rest, not of a fall within the step: H D / M is up to 0.9."""
    tip = '<geom name="tip" pos=".3 0 0" size=".03" mass=".1" condim="1"/>'
    xml = pendulum('range="-20 20" damping="3"', 'range="-1 1" damping="1"', tip)
    engine, data = engine_of(xml, "RK4", timestep)
    engine.step(data, nstep=round(2.0 / timestep))
    assert np.abs(data.qvel).max() < 1e-9
    np.testing.assert_allclose(
        data.qfrc_bias, data.qfrc_passive + data.qfrc_constraint, rtol=0, atol=1e-7
    )
    assert engine.contacts(data).force[0, 0] > 1.0


def test_a_ball_does_not_pass_through_an_articulated_plate_in_cut_steps():
    xml = """<mujoco><worldbody>
      <body><joint axis="0 1 0" stiffness="50" damping=".5"/>
        <geom type="box" size=".5 .5 .005" mass="1"/></body>
      <body pos="0 0 .5"><freejoint/><geom size=".02" mass=".1"/></body></worldbody></mujoco>"""
    engine, data = engine_of(xml, "RK4", 0.01, impact="cut")
    data.qvel[3] = -60.0
    cuts = sum(engine.step(data).cuts for _ in range(10))
    assert cuts > 0
    assert data.qpos[3] > 0.02


def test_rk4_is_stepped_as_euler_with_the_complementarity_free_law():
    xml = pendulum(tip='<geom pos=".3 0 0" size=".03" mass=".1"/>').replace(
        "</worldbody>",
        '<body pos="0 1 0"><freejoint/><geom type="box" size=".1 .1 .09"/></body></worldbody>',
    )
    ends = []
    for integrator in ("Euler", "RK4"):
        engine, data = engine_of(xml, integrator, 0.002, law="comfree")
        data.qpos[4] = 0.1
        assert engine.step(data, nstep=500).touching > 0
        ends.append(data.qpos.copy())
    np.testing.assert_array_equal(*ends)
