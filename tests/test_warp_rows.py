"""Limits, equalities, dry friction, condim and solref of dashpot.warp, and motion in flight."""

import numpy as np
import pytest

import dashpot
from warp_worlds import Worlds, energy, model_of

OPTION = '<option gravity="0 0 -9.81"/>'
PENDULUM = (
    f'<mujoco>{OPTION}<worldbody><body pos="0 0 1">'
    '<joint name="j" type="hinge" axis="0 1 0" {joint}/>'
    '<geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" mass="1"/></body></worldbody></mujoco>'
)
LINK = (
    '<joint name="{name}" type="hinge" axis="0 1 0"/>'
    '<geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" mass="1" contype="0" conaffinity="0"/>'
)
DOUBLE = (
    f'<mujoco>{OPTION}<worldbody><body pos="0 0 1">'
    + LINK.format(name="a")
    + '<body name="tip" pos="0.3 0 0">'
    + LINK.format(name="b")
    + "</body></body></worldbody>{rest}</mujoco>"
)


def engine_of(model, start=None):
    engine = dashpot.Engine(model)
    data = engine.make_data()
    if start:
        start(engine.model, data)
    return engine, data


@pytest.mark.parametrize("option", ["", 'integrator="implicit"'])
def test_a_double_pendulum_converges_as_the_square_of_the_step(option):
    """Drift, kick, drift, with Coriolis forces at the velocity of the middle, and dampers."""
    xml = DOUBLE.format(rest="").replace("<option", f"<option {option}")
    xml = xml.replace('type="hinge"', 'type="hinge" damping="0.05"')
    ends = []
    for timestep in (0.0005, 0.002, 0.004):
        worlds = Worlds(model_of(xml, timestep), nconmax=4)
        worlds.step(round(1 / timestep))
        ends.append(worlds.positions())
    fine, coarse = (np.abs(end - ends[0]).max() for end in ends[1:])
    assert coarse < 5e-4
    assert coarse / fine == pytest.approx(4.0, rel=0.25)


def test_a_torque_free_body_keeps_its_energy_and_turns_as_euler_says():
    xml = (
        '<mujoco><option gravity="0 0 0"/><worldbody><body><freejoint/>'
        '<geom type="box" size="0.1 0.05 0.02" pos="0.03 0.02 0.01"/></body></worldbody></mujoco>'
    )

    def spin(_, data):
        data.qvel[:] = [0.1, 0.2, 0.3, 1.0, 2.0, 6.0]

    model = model_of(xml, 0.002)
    worlds = Worlds(model, start=spin, nconmax=4)
    before = energy(model, worlds.qpos, worlds.qvel)
    worlds.step(1500)
    assert energy(model, worlds.qpos, worlds.qvel) == pytest.approx(before, rel=1e-5)
    finer = Worlds(model_of(xml, 0.0005), start=spin, nconmax=4)
    finer.step(6000)
    np.testing.assert_allclose(worlds.positions(), finer.positions(), atol=2e-5)


def test_a_limit_stops_a_pendulum():
    model = model_of(PENDULUM.format(joint='range="-60 60" limited="true"'))
    worlds = Worlds(model, nconmax=4)
    worlds.step(1000)
    assert worlds.qpos[0] == pytest.approx(np.pi / 3, abs=1e-5)
    assert abs(worlds.qvel[0]) < 1e-6


def test_dry_friction_holds_a_pendulum_and_lets_it_slip():
    held = Worlds(model_of(PENDULUM.format(joint='frictionloss="3"')), nconmax=4)
    held.step(500)
    assert abs(held.qpos[0]) < 2e-6  # the spring of the slider, no creep
    model = model_of(PENDULUM.format(joint='frictionloss="0.5"'))
    slips = Worlds(model, nconmax=4)
    engine, data = engine_of(model)
    slips.step(1000)
    engine.step(data, 1000)
    assert slips.qpos[0] == pytest.approx(data.qpos[0], abs=1e-4)


def test_tendons_have_limits_and_dry_friction():
    xml = (
        f'<mujoco>{OPTION}<worldbody><body pos="0 0 1"><joint name="j" type="slide" axis="0 0 1"/>'
        '<geom type="sphere" size=".05" mass="1"/></body></worldbody><tendon>'
        '<fixed limited="true" range="-0.3 1" frictionloss="5"><joint joint="j" coef="1"/></fixed>'
        "</tendon></mujoco>"
    )
    worlds = Worlds(model_of(xml), nconmax=4)
    worlds.step(100)
    assert worlds.qvel[0] == pytest.approx(-(9.81 - 5.0) * 0.2, rel=1e-4)
    worlds.step(400)
    assert worlds.qpos[0] == pytest.approx(-0.3, abs=1e-5)


@pytest.mark.parametrize(
    ("rest", "error"),
    [
        (
            '<equality><connect body1="tip" body2="world" anchor="0.3 0 0"/></equality>',
            lambda q: abs(0.3 * np.sin(q[0]) + 0.3 * np.sin(q[0] + q[1])),
        ),
        ('<equality><joint joint1="b" joint2="a"/></equality>', lambda q: abs(q[1] - q[0])),
    ],
)
def test_equalities_hold(rest, error):
    worlds = Worlds(model_of(DOUBLE.format(rest=rest)), nconmax=4)
    for _ in range(10):
        worlds.step(50)
        assert error(worlds.positions()) < 2e-3  # of 0.6 m, while it falls


def test_a_weld_carries_a_body():
    box = '<geom type="box" size=".05 .05 .05"/>'
    xml = (
        f'<mujoco>{OPTION}<worldbody><geom type="plane" size="1 1 .1"/>'
        f'<body name="a" pos="0 0 .3"><freejoint/>{box}</body>'
        f'<body name="b" pos="0.15 0 .3"><freejoint/>{box}</body></worldbody>'
        '<equality><weld body1="a" body2="b"/></equality></mujoco>'
    )
    worlds = Worlds(model_of(xml), nconmax=20)
    worlds.step(500)
    a, b = worlds.positions().reshape(2, 7)
    np.testing.assert_allclose(b[:3] - a[:3], [0.15, 0, 0], atol=1e-4)
    assert a[2] == pytest.approx(0.05, abs=1e-5)


@pytest.mark.parametrize("condim", [1, 3, 4, 6])
def test_a_spinning_ball_rolls_as_in_the_engine(condim):
    xml = (
        f'<mujoco>{OPTION}<worldbody><geom type="plane" size="1 1 .1" condim="{condim}"/>'
        '<body pos="0 0 .1"><freejoint/>'
        f'<geom type="sphere" size=".1" condim="{condim}" friction="1 0.01 0.005"/></body>'
        "</worldbody></mujoco>"
    )

    def push(_, data):
        data.qvel[:] = [1, 0.5, 0, 0, 10, 20]

    model = model_of(xml)
    worlds = Worlds(model, start=push, nconmax=4)
    engine, data = engine_of(model, push)
    worlds.step(1000)
    engine.step(data, 1000)
    np.testing.assert_allclose(worlds.qpos[:3], data.qpos[:3], atol=2e-5)
    np.testing.assert_allclose(worlds.qvel[:3], data.qvel[:3], atol=2e-5)
    # In the frame of a ball that has turned by 40 rad.
    np.testing.assert_allclose(worlds.qvel[3:], data.qvel[3:], atol=2e-3)


def test_a_models_own_solref_gives_way_as_in_the_engine():
    geom = 'solref="0.03 0.5"'
    xml = (
        f'<mujoco>{OPTION}<worldbody><geom type="plane" size="1 1 .1" {geom}/>'
        f'<body pos="0 0 .3"><freejoint/><geom type="sphere" size=".1" {geom}/></body>'
        "</worldbody></mujoco>"
    )
    model = model_of(xml)
    worlds = Worlds(model, nconmax=4)
    engine, data = engine_of(model)
    worst = 0.0
    for _ in range(500):
        worlds.step()
        engine.step(data)
        worst = max(worst, abs(worlds.qpos[2] - data.qpos[2]))
    assert worst < 2e-6


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.004])
def test_a_body_that_a_connect_holds_swings_as_near_to_the_converged_motion_as_in_the_engine(
    timestep,
):
    xml = (
        f'<mujoco>{OPTION}<worldbody><body name="b" pos="0 0 1"><freejoint/>'
        '<geom type="box" size="0.1 0.05 0.02" mass="1"/></body></worldbody>'
        '<equality><connect body1="b" body2="world" anchor="0.1 0.02 0"/></equality></mujoco>'
    )
    worlds = Worlds(model_of(xml, timestep), nconmax=4)
    engine, data = engine_of(worlds.model)
    fine, exact = engine_of(model_of(xml, 1.25e-4))
    steps = round(0.5 / timestep)
    worlds.step(steps)
    engine.step(data, steps)
    fine.step(exact, round(0.5 / 1.25e-4))
    error, of_engine = (np.abs(q - exact.qpos).max() for q in (worlds.positions(), data.qpos))
    assert error < of_engine + 1e-5


def test_a_slider_crank_loses_little_of_its_energy():
    link = '<geom type="capsule" size=".02" contype="0" conaffinity="0" fromto="0 0 0 {} 0 0"/>'
    xml = (
        f'<mujoco>{OPTION}<worldbody><body pos="0 0 1"><joint axis="0 1 0"/>{link.format(0.2)}'
        f'<body name="rod" pos="0.2 0 0"><joint axis="0 1 0"/>{link.format(0.5)}</body></body>'
        '<body name="slider" pos="0.7 0 1"><joint type="slide" axis="1 0 0"/>'
        '<geom type="box" size=".05 .05 .05" contype="0" conaffinity="0"/></body></worldbody>'
        '<equality><connect body1="rod" body2="slider" anchor="0.5 0 0"/></equality></mujoco>'
    )

    def turn(_, data):
        data.qvel[:] = [10, -14, 0]

    model = model_of(xml)
    worlds = Worlds(model, start=turn, nconmax=4)
    before = energy(model, worlds.qpos, worlds.qvel)
    kinetic = before - energy(model, worlds.qpos, 0 * worlds.qvel)
    worlds.step(2500)
    after = energy(model, worlds.positions(), worlds.qvel)
    assert -0.06 * kinetic < after - before < 0.001 * kinetic


def test_a_damper_on_what_is_light_where_others_give_way_does_not_overshoot():
    """1 g on a slide with a damper, 1 kg free on it: its velocity decays at 1e4 1/s."""
    slide = '<joint type="slide" axis="1 0 0"'
    xml = (
        '<mujoco><option gravity="0 0 0"/><worldbody>'
        f'<body>{slide} damping="10"/><geom size="0.01" mass="0.001"/>'
        f'<body>{slide}/><geom size="0.01" mass="1"/></body></body></worldbody></mujoco>'
    )

    def start(_, data):
        data.qvel[:] = [1, -1]

    worlds = Worlds(model_of(xml, 0.01), start=start, nconmax=2)
    worlds.step()
    assert abs(worlds.qvel[0]) < 0.01
    assert worlds.qvel.sum() == pytest.approx(0.0, abs=1e-5)


def test_a_tendon_over_a_ball_pulls_three_bodies():
    """Inner forces leave their momentum alone."""
    body = '<body pos="{1}"><freejoint/><geom name="{0}" type="sphere" size=".1"/>{2}</body>'
    xml = (
        '<mujoco><option gravity="0 0 0"/><worldbody>'
        + body.format("a", "-0.5 0 0", '<site name="a"/>')
        + body.format("b", "0 0 0.05", '<site name="side" pos="0 0 0.3"/>')
        + body.format("c", "0.5 0 0", '<site name="c"/>')
        + '</worldbody><tendon><spatial limited="true" range="0 0.9"><site site="a"/>'
        '<geom geom="b" sidesite="side"/><site site="c"/></spatial></tendon></mujoco>'
    )
    worlds = Worlds(model_of(xml), nconmax=4)
    worlds.step(20)
    velocity = worlds.qvel.reshape(3, 6)[:, :3]
    assert velocity[1, 2] < -0.01
    np.testing.assert_allclose(velocity.sum(axis=0), 0.0, atol=1e-6)
