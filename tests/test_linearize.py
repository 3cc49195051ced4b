"""Derivatives of a step against closed forms, and against MuJoCo's where nothing touches."""

import mujoco
import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

import dashpot
from dashpot import Engine, Material

GRAVITY = 9.81


def engine_of(xml, **options):
    return Engine(mujoco.MjModel.from_xml_string(xml), **options)


ARM = """<mujoco><option timestep="0.005" integrator="{}"/><worldbody>
  <body name="base" pos="0 0 1"><joint type="ball" damping="0.01"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02"/>
    <body pos="0.3 0 0"><joint name="elbow" axis="0 1 0" damping="0.05"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.02"/><site name="tip" pos="0 0 0.2"/>
    </body></body></worldbody>
  <actuator><motor joint="elbow"/><general joint="elbow" dyntype="filter" dynprm="0.05"
    gainprm="2"/></actuator>
  <sensor><jointpos joint="elbow"/><accelerometer site="tip"/></sensor></mujoco>"""


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("centered", [True, False])
def test_step_without_contact_has_the_derivatives_of_mujocos(integrator, centered):
    engine = engine_of(ARM.format(integrator))
    model, data = engine.model, engine.make_data()
    rng = np.random.default_rng(0)
    mujoco.mj_integratePos(model, data.qpos, rng.uniform(-1, 1, model.nv), 1.0)
    data.qvel[:] = rng.uniform(-2, 2, model.nv)
    data.act[:], data.ctrl[:] = 0.3, [0.2, -0.1]
    found = dashpot.linearize(engine, data, centered=centered)
    nx = 2 * model.nv + model.na
    A, B = np.empty((nx, nx)), np.empty((nx, model.nu))
    C, D = np.empty((model.nsensordata, nx)), np.empty((model.nsensordata, model.nu))
    mujoco.mj_forward(model, data)
    mujoco.mjd_transitionFD(model, data, 1e-6, centered, A, B, C, D)
    if centered and mujoco.mj_version() < 4000000:  # which return -D
        D *= -1.0
    # The same differences of the same steps: rounding, over eps.
    for name, expected in zip("ABCD", (A, B, C, D), strict=True):
        np.testing.assert_allclose(getattr(found, name), expected, rtol=1e-7, atol=1e-7)


BALL = """<mujoco><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="5 5 .1" friction="{friction}"/>
  <body pos="0 0 {height}"><freejoint/><geom name="ball" {geom} mass="1" friction="{friction}"/>
  </body></worldbody></mujoco>"""


def test_pressed_ball_has_the_derivative_of_its_spring_and_damper():
    stiffness, damping, timestep = 1e4, 20.0, 0.002
    sag = GRAVITY / stiffness
    engine = engine_of(BALL.format(geom='size="0.1"', friction=0.5, height=0.1 - sag))
    engine.set_pair_material("ball", "floor", Material(stiffness=stiffness, damping=damping))
    found = dashpot.linearize(engine, engine.make_data())
    expected = expm(timestep * np.array([[0, 1], [-stiffness, -damping]]))
    np.testing.assert_allclose(found.A[np.ix_([2, 8], [2, 8])], expected, rtol=0, atol=1e-7)


def test_sliding_box_keeps_its_speed_and_a_sticking_one_loses_it():
    # Coulomb friction does not depend on speed while it slides. What sticks loses its speed as fast
    # as friction rises with the normal force, which starts at zero without memory.
    box = BALL.format(geom='type="box" size="0.1 0.1 0.1"', friction=0.5, height=0.1)
    sliding = engine_of(box)
    data = sliding.make_data()
    data.qvel[0] = 1.0
    sliding.step(data, nstep=50)
    by_speed = dashpot.linearize(sliding, data).A[:, 6]
    assert by_speed[6] == pytest.approx(1.0, abs=1e-3)
    assert by_speed[0] == pytest.approx(0.002, rel=1e-3)
    data.qvel[0] = 0.0
    sliding.step(data, nstep=50)
    sticking = dashpot.linearize(sliding, data).A
    assert abs(sticking[6, 6]) < 0.2
    # It keeps the place where it is put.
    assert sticking[0, 0] == pytest.approx(1.0, abs=1e-6)


def test_controls_at_a_limit_are_displaced_away_from_it():
    xml = """<mujoco><worldbody>
      <body><joint name="x" type="slide"/><geom size=".1" mass="2"/></body></worldbody>
      <actuator><motor joint="x" ctrllimited="true" ctrlrange="-1 1"/></actuator></mujoco>"""
    engine = engine_of(xml)
    data = engine.make_data()
    # Half of a difference across the limit would be lost; beyond it no control is felt.
    for control, expected in ((1.0, 1.0), (-1.0, 1.0), (0.0, 1.0), (2.0, 0.0)):
        data.ctrl[0] = control
        gain = dashpot.linearize(engine, data).B[1, 0]
        assert gain == pytest.approx(expected * engine.model.opt.timestep / 2, rel=1e-6)


WHEELED = """<mujoco><option timestep="0.005" integrator="implicitfast"/><worldbody>
  <geom name="floor" type="plane" size="50 5 .1"/>
  <body pos="0 0 0.1"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
    <joint name="pitch" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0.1 0 0 0.7" size="0.04" mass="3" contype="0"/>
    <body><joint name="wheel" axis="0 1 0"/>
      <geom name="tyre" type="cylinder" euler="90 0 0" size="0.1 0.04" mass="1"/></body></body>
  </worldbody><actuator><motor joint="wheel"/></actuator></mujoco>"""


def test_pendulum_on_wheels_balances_by_the_regulator_of_its_linearization():
    engine = engine_of(WHEELED)
    engine.set_pair_material("tyre", "floor", Material(stiffness=1e5, damping_ratio=0.5))
    data = engine.make_data()
    data.qpos[1] = -4 * GRAVITY / (2 * 1e5)  # it stands on both ends of the tyre
    found = dashpot.linearize(engine, data)
    # All but the angle of the wheel, which nothing depends on.
    felt = [0, 1, 2, 4, 5, 6, 7]
    A, B = found.A[np.ix_(felt, felt)], found.B[felt]
    falls = np.abs(np.linalg.eigvals(A)).max()
    # Upright it falls, over a wheel that rolls freely, as energies say: 3 kg at 0.4 m, and a wheel
    # of 1 kg whose turning counts as half of that.
    mass, arm, wheel = 3.0, 0.4, 1.5
    inertia = engine.model.body_inertia[1].max() + mass * arm**2
    determinant = inertia * (mass + wheel) - (mass * arm) ** 2
    expected = np.sqrt(mass * GRAVITY * arm * (mass + wheel) / determinant)
    # Of second order in the step, (0.03)^2 / 6; without the second half it was 0.8 % off.
    assert np.log(falls) / 0.005 == pytest.approx(expected, rel=1e-3)
    cost, weight = np.diag([1.0, 1, 1, 0.1, 0.1, 0.1, 0.1]), np.eye(1)
    riccati = solve_discrete_are(A, B, cost, weight)
    gain = np.linalg.solve(weight + B.T @ riccati @ B, B.T @ riccati @ A)
    slowest = np.abs(np.linalg.eigvals(A - B @ gain)).max()
    steps = round(np.log(1e-4) / np.log(slowest))
    assert 0 < steps < 10_000
    upright = data.qpos.copy()
    data.qpos[2] = 0.1
    for _ in range(steps):
        x = np.concatenate([data.qpos - upright, data.qvel])[felt]
        data.ctrl[:] = -gain @ x
        engine.step(data)
    assert np.abs(data.qpos[:3] - upright[:3]).max() < 1e-3
    assert np.abs(data.qvel).max() < 1e-2


def swing_of(engine, data):
    """Return the eigenvalue (1/s) of the fastest swing that a linearized step does not damp out."""
    timestep = engine.model.opt.timestep
    values = np.log(np.linalg.eigvals(dashpot.linearize(engine, data).A).astype(complex)) / timestep
    # Contacts damp what is left within some steps, or alternate, at pi a step.
    swings = values[(values.real > -50) & (values.imag < 0.9 * np.pi / timestep)]
    return swings[np.argmax(swings.imag)]


@pytest.mark.parametrize("timestep", [0.001, 0.005])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("kind", ["spring", "servo"])
def test_a_leg_in_stance_swings_at_the_rate_of_its_spring(kind, integrator, timestep):
    """A body of 5 kg at 60 rad/s, damped at 1.2 1/s.

    Without the second half of the step it seemed to grow, at 5 ms by 3.1 1/s.
    """
    mass, omega, rate = 5.0, 60.0, 1.2
    stiffness, damping = mass * omega**2, 2 * mass * rate
    sag = mass * GRAVITY / stiffness
    spring = f'stiffness="{stiffness}" springref="{-sag}"' if kind == "spring" else ""
    servo = f'<actuator><position joint="leg" kp="{stiffness}"/></actuator>'
    engine = engine_of(f"""<mujoco>
      <option timestep="{timestep}" integrator="{integrator}"/><worldbody>
        <geom type="plane" size="9 9 .1"/><body pos="0 0 .5"><joint type="slide" axis="0 0 1"/>
          <geom size=".05" mass="{mass}" contype="0" conaffinity="0"/>
          <body pos="0 0 -.48"><joint name="leg" type="slide" axis="0 0 1" damping="{damping}"
            {spring}/><geom size=".02" mass=".2"/></body></body></worldbody>
      {servo if kind == "servo" else ""}</mujoco>""")
    data = engine.make_data()
    data.ctrl[:] = -sag
    engine.step(data, nstep=5)
    found = swing_of(engine, data)
    # The foot's contact starts without memory, and takes up each change of load anew, by which the
    # swing falls by 0.05 1/s more at 1 ms, 0.16 at 5 ms, and is slower by 0.15 and 0.35 %. As stiff
    # as steps of 5 ms let it be, 4.8e6 N/m, it gives way under the spring: 0.19 % of the frequency.
    # (Verlet's, which servos have, is early by (omega H)^2 / 24, 0.38 %.) Without memory
    # dampers begin as in flight, which damps a servo's swing by 0.4 1/s more at 5 ms.
    most = 0.06 if timestep == 0.001 else 0.2 if kind == "spring" else 0.5
    assert found.real == pytest.approx(-rate, abs=most)
    slow = 2e-3 if timestep == 0.001 else 5.5e-3
    assert found.imag == pytest.approx(np.sqrt(omega**2 - rate**2), rel=slow)


@pytest.mark.parametrize("timestep", [0.001, 0.005])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_pendulums_that_contacts_and_equalities_hold_neither_grow_nor_fade(integrator, timestep):
    """A bob, root of its tree, below the hinge of a standing foot, and a parallelogram.

    At 5 ms the bob grew by 0.04 1/s for want of the second half, with RK4 by 0.25 1/s because the
    contacts of the foot did not move with it in steps as small as the differences are, and the
    parallelogram by 0.05 1/s.
    """
    length, option = 0.3, f'<option timestep="{timestep}" integrator="{integrator}"/>'
    standing = engine_of(f"""<mujoco>{option}<worldbody><geom type="plane" size="0 0 1"/>
      <body pos="0 0 .3"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
        <joint axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="1e-6 1e-6 1e-6"/>
        <body pos="0 0 {length}"><joint axis="0 1 0"/>
          <geom type="box" size=".2 .1 .02" pos="0 0 -.58" mass="5"/></body></body>
      </worldbody></mujoco>""")
    crank = f'<joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 {-length}"'
    linkage = engine_of(f"""<mujoco>{option}
      <default><geom mass="1" contype="0" conaffinity="0"/></default><worldbody>
        <body pos="0 0 1">{crank}/><body name="coupler" pos="0 0 {-length}">
          <joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .4 0 0"/></body></body>
        <body name="follower" pos=".4 0 1">{crank}/></body></worldbody>
      <equality><connect body1="follower" body2="coupler" anchor="0 0 {-length}"/></equality>
      </mujoco>""")
    # About the hinge: two cranks, and the coupler, which only translates.
    inertia = 2 * (linkage.model.body_inertia[1].max() + (length / 2) ** 2) + length**2
    weight = GRAVITY * (2 * length / 2 + length)
    for engine, expected in ((standing, GRAVITY / length), (linkage, weight / inertia)):
        data = engine.make_data()
        engine.step(data, nstep=round(1.0 / timestep))
        found = swing_of(engine, data)
        # To second order in H: omega^3 H^2 / 24.
        assert abs(found.real) < 2e-3
        assert found.imag == pytest.approx(np.sqrt(expected), rel=5e-3)


def test_neither_threads_nor_memory_of_the_data_matter_and_data_stay():
    engine = engine_of(BALL.format(geom='type="box" size="0.1 0.1 0.1"', friction=0.5, height=0.1))
    data = engine.make_data()
    data.qvel[:2] = 0.3, 0.1
    engine.step(data, nstep=200)
    fresh = engine.make_data()
    fresh.qpos[:], fresh.qvel[:] = data.qpos, data.qvel
    fresh.xfrc_applied[1, 0] = data.xfrc_applied[1, 0] = 1.0
    before = [np.copy(v) for v in (data.qpos, data.qvel, data.userdata)]
    one, many, other = (
        dashpot.linearize(engine, d, nthread=n) for d, n in ((data, 1), (data, 3), (fresh, 2))
    )
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(one, name), getattr(many, name))
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for value, now in zip(before, (data.qpos, data.qvel, data.userdata), strict=True):
        np.testing.assert_array_equal(value, now)
    assert (one.B.shape, one.C.shape, one.D.shape) == ((12, 0), (0, 12), (0, 0))


@pytest.mark.parametrize("centered", ["no", 1, None])
def test_centered_is_true_or_false(centered):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string("<mujoco/>"))
    with pytest.raises(TypeError, match=f"centered must be True or False, got {centered!r}"):
        dashpot.linearize(engine, engine.make_data(), centered=centered)


@pytest.mark.parametrize("eps", [0.0, -1e-6, np.nan, np.inf, 1e-15, 1.0])
def test_eps_must_be_of_use(eps):
    engine = engine_of(ARM.format("Euler"))
    with pytest.raises(ValueError, match="eps"):
        dashpot.linearize(engine, engine.make_data(), eps=eps)


def test_data_must_be_of_the_engine():
    engine = engine_of(ARM.format("Euler"))
    with pytest.raises(ValueError, match="another model"):
        dashpot.linearize(engine, mujoco.MjData(mujoco.MjModel.from_xml_string("<mujoco/>")))
    with pytest.raises(TypeError, match="engine"):
        dashpot.linearize(engine.model, engine.make_data())


def test_a_linearization_prints_as_a_table():
    """A pendulum that stands on its tip: what grows does so by e^(sqrt(g/l) dt) in a step."""
    pendulum = """<mujoco><option timestep="0.002"/><worldbody><body pos="0 0 1">
      <joint axis="0 1 0"/><geom type="sphere" pos="0 0 .5" size=".001" mass="1"/></body>
      </worldbody><actuator><motor joint="j"/></actuator></mujoco>"""
    engine = engine_of(pendulum.replace("<joint", '<joint name="j"'))
    step = dashpot.linearize(engine, engine.make_data())
    text = str(step)
    assert len(text.splitlines()) < 12
    row = ["B", "(2,", "1)", f"{np.abs(step.B).max():.4g}", "state"]
    assert row in [line.split()[:5] for line in text.splitlines()]
    grown, shrunk = (float(number) for number in text.split(": ")[-1].split(", "))
    rate = np.sqrt(GRAVITY / 0.5) * 0.002
    # As printed, and of second order in the step.
    assert grown == pytest.approx(np.exp(rate), abs=5e-5)
    assert shrunk == pytest.approx(np.exp(-rate), abs=5e-5)
    assert "eigenvalues of A" in step._repr_html_()
