"""Bodies held by the ranges of ball joints, whose rows turn with them, keep their energy."""

import mujoco
import numpy as np
import pytest

import dashpot

RATE, TIME = 9.0, 3.0  # rad/s, s
STEPS = [0.001, 0.002, 0.005]  # s
LINK = '<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".1" mass=".5"/>'
UNEVEN = '<inertial pos=".1 .05 -.4" mass="1" fullinertia=".03 .02 .025 .008 -.006 .005"/>'


def ball(angle: float, inside: str, limit: str = "") -> str:
    degrees = np.rad2deg(angle)
    return f'<body><joint type="ball" limited="true" range="0 {degrees}" {limit}/>{inside}</body>'


def engine_of(bodies: str, integrator: str, dt: float) -> dashpot.Engine:
    return dashpot.Engine(
        mujoco.MjModel.from_xml_string(f"""<mujoco>
          <option timestep="{dt}" integrator="{integrator}"/>
          <default><geom contype="0" conaffinity="0"/></default>
          <worldbody>{bodies}</worldbody></mujoco>""")
    )


def whirling(angle: float, turned: float) -> np.ndarray:
    half = 0.5 * angle
    return np.array(
        [np.cos(half), np.sin(half) * np.cos(turned), np.sin(half) * np.sin(turned), 0.0]
    )


def angle_of(orientation: np.ndarray) -> float:
    return 2.0 * np.arcsin(min(1.0, np.linalg.norm(orientation[1:4])))


def start_whirl(model: mujoco.MjModel, data: mujoco.MjData, limits: list[float]) -> None:
    """Every joint's axis turns about the vertical of the body that carries it."""
    for joint, angle in enumerate(limits):
        rotation = np.zeros(9)
        data.qpos[4 * joint : 4 * joint + 4] = whirling(angle, 0.0)
        mujoco.mju_quat2Mat(rotation, whirling(angle, 0.0))
        data.qvel[3 * joint : 3 * joint + 3] = RATE * (rotation.reshape(3, 3)[2] - [0.0, 0.0, 1.0])
    mujoco.mj_forward(model, data)


@pytest.mark.parametrize("dt", STEPS)
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("limits", [[0.6], [0.4, 0.2, 0.1]])
def test_what_whirls_at_its_limits_goes_on_as_it_does(limits, integrator, dt):
    bodies = ""
    for angle in reversed(limits):
        bodies = ball(angle, LINK + bodies.replace("<body>", '<body pos="0 0 -.3">', 1))
    engine = engine_of(bodies, integrator, dt)
    data = engine.make_data()
    start_whirl(engine.model, data, limits)
    start = engine.energy(data)
    engine.step(data, nstep=round(TIME / dt))
    now = engine.energy(data)
    # Both of second order. With the axes of the start a chain gained some 0.5 J, at 1 ms, too.
    assert now.mechanical == pytest.approx(start.mechanical, abs=start.kinetic * (RATE * dt) ** 2)
    assert now.total == pytest.approx(start.total, abs=start.kinetic * (RATE * dt) ** 2)
    turned = RATE * TIME
    for joint, angle in enumerate(limits):
        orientation = data.qpos[4 * joint : 4 * joint + 4]
        assert orientation == pytest.approx(
            whirling(angle, turned), abs=turned * (RATE * dt) ** 2 / 8.0
        )


@pytest.mark.parametrize("dt", STEPS)
def test_an_uneven_body_on_an_elastic_limit_keeps_its_energy(dt):
    engine = engine_of(ball(0.6, UNEVEN, 'solreflimit="-4000 0"'), "RK4", dt)
    data = engine.make_data()
    start_whirl(engine.model, data, [0.6])
    start = engine.energy(data)
    for _ in range(round(TIME / dt)):
        engine.step(data)
        now = engine.energy(data).mechanical
        # It was 2 to 3 % at all these steps.
        assert now == pytest.approx(start.mechanical, abs=3.0 * start.kinetic * (RATE * dt) ** 2)
        # Without the limit it would swing outwards; the spring gives by some milliradians.
        assert 0.59 < angle_of(data.qpos) < 0.61


@pytest.mark.parametrize("dt", STEPS)
def test_a_joint_without_a_range_is_held(dt):
    engine = engine_of(ball(0.0, UNEVEN), "Euler", dt)
    data = engine.make_data()
    data.qvel[:] = velocity = np.array([0.8, -0.8, 3.8])
    mujoco.mj_forward(engine.model, data)
    for _ in range(round(TIME / dt)):
        engine.step(data)
        # No row is that of its motion before it has moved, in the first step. It came 2.4 to 3.6
        # steps far, and recovery did 20 J of work.
        assert angle_of(data.qpos) < 1.1 * np.linalg.norm(velocity) * dt
    assert abs(engine.energy(data).dissipated_recovery) < 1.0


@pytest.mark.parametrize("dt", STEPS)
def test_the_ledger_closes_of_what_tumbles_with_a_joint_at_its_limit(dt):
    body = f'<geom size=".1" mass="1"/>{ball(0.7, UNEVEN)}'
    engine = engine_of(f"<body><freejoint/>{body}</body>", "RK4", dt)
    engine.model.opt.gravity[:] = 0.0
    data = engine.make_data()
    data.qvel[:] = 6.0 * np.random.default_rng(0).normal(size=9)
    mujoco.mj_forward(engine.model, data)
    start = engine.energy(data)
    held = 0
    for _ in range(round(5.0 / dt)):
        engine.step(data)
        held += data.qfrc_constraint.any()
        assert angle_of(data.qpos[7:]) < 0.7 + 1e-3
    # It leans on the limit for most of the time, and loses there what the damper of it takes.
    assert held * dt > 2.5
    end = engine.energy(data)
    assert end.total == pytest.approx(start.total, abs=1e-3 * start.kinetic)
    assert end.dissipated_constraint > 5e-3 * start.kinetic


@pytest.mark.parametrize("dt", [0.001, 0.002])
@pytest.mark.parametrize("degrees", [0.6, 1.5, 3.0, 6.0])
def test_a_narrow_range_gains_next_to_nothing(degrees, dt):
    """What swings at 3.6 rad/s across it turns its row by 0.1 to 0.7 rad in 2 ms."""
    body = """<geom type="capsule" size=".04" fromto="0 0 0 0 0 -.4" mass="1"/>
        <geom size=".2" pos="0 0 -.4" mass=".5"/>"""
    limit = 'solreflimit="-1e4 0" solimplimit=".99 .99 .001 .5 2"'
    engine = engine_of(ball(np.deg2rad(degrees), body, limit), "Euler", dt)
    data = engine.make_data()
    data.qvel[:] = 3.0, 2.0, 0.0
    start = engine.energy(data)
    most, widest = start.mechanical, 0.0
    for _ in range(round(1.0 / dt)):
        engine.step(data)
        most = max(most, engine.energy(data).mechanical)
        widest = max(widest, angle_of(data.qpos))
    # Free it would swing by 0.7 rad. The spring gives, by no more than a twentieth of a radian or,
    # where the row turns by most of a radian in a step, half as much again.
    assert np.deg2rad(degrees) < widest < np.deg2rad(degrees) + 0.075
    # Of what it swings with. In rows of a middle that velocities at the start lead to, but their
    # force does not, it gained up to 70 times all.
    assert most - start.mechanical < 0.05 * start.kinetic
