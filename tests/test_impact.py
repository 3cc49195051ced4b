"""Steps cut at impacts: nothing passes, bounces hold at large steps, calm scenes stay the same."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import dashpot
from impacts import (
    Bounce,
    bouncing_boxes,
    largest_gain,
    random_bounce,
    random_shot,
    relative_errors,
)
from piles import pile
from scenes import slope, stack
from simulate import make_engine


def thrown_ball(*, velocity, start, timestep=0.01, plate="1 1 .025", impact="cut", extra=""):
    """Make an engine and data of a ball (radius 10 mm, 10 g) and a plate whose top is at z = 0."""
    half = float(plate.split()[2])
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0" timestep="{timestep}"/><worldbody>
        <geom name="plate" type="box" size="{plate}" pos="0 0 {-half}"/>
        <body pos="{" ".join(map(str, start))}"><freejoint/>
        <geom name="ball" type="sphere" size=".01" mass=".01"/></body>
        {extra}</worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model, impact=impact)
    data = engine.make_data()
    data.qvel[:3] = velocity
    return engine, data


@pytest.mark.parametrize("seed", range(36))
def test_no_shot_passes_through_a_thin_plate(seed):
    passed, _ = random_shot(seed).fly("cut")
    assert not passed


def test_some_of_the_shots_pass_without_cuts():
    """Otherwise the shots above would prove nothing."""
    assert any(random_shot(seed).fly("none")[0] for seed in range(36))


@pytest.mark.parametrize("stiffness", [1e6, 1e7, 1e8])
@pytest.mark.parametrize(
    ("quat", "velocity"),
    [
        ("0.9 0.3 0.2 0.1", (-8.0, 1.0, -2.0, 5.0, 20.0, -10.0)),
        ("0.2 -0.5 0.6 0.4", (-12.0, -2.0, 1.0, -15.0, 8.0, 12.0)),
    ],
)
def test_bounce_of_a_spinning_box_off_a_wall(quat, velocity, stiffness):
    """At 5 ms within 1 % of steps of 1 us without cuts."""
    material = dashpot.Material(stiffness=stiffness, restitution=0.7, friction=0.4)
    bounce = Bounce(quat, np.array(velocity), material)
    linear, angular = bounce.errors(0.005, "cut")
    assert linear < 0.01
    assert angular < 0.01


# 32 and 71 strike again slowly, 135 grazes, 13 and 27 roll over several corners.
@pytest.mark.parametrize("seed", [0, 13, 27, 32, 71, 135])
def test_random_bounces_of_a_spinning_box(seed):
    assert max(random_bounce(seed).errors(0.005, "cut")) < 0.01


@pytest.mark.parametrize("speed", [30.0, 300.0])
def test_oblique_bounce_reverses_the_normal_velocity_alone(speed):
    """From afar the nearest point of the plate is elsewhere, and so is its normal."""
    velocity = speed * np.array([-0.6, 0.0, -0.8])
    start = -velocity * 0.007 + (0.9, 0.0, 0.01)
    engine, data = thrown_ball(velocity=velocity, start=start)
    material = dashpot.Material(stiffness=1e7, restitution=0.6, friction=0.0)
    engine.set_pair_material("plate", "ball", material)
    stats = engine.step(data)
    assert stats.cuts > 0
    # One contact of two parameters is exact; the normal is a face's, right to rounding.
    np.testing.assert_allclose(data.qvel[:3], velocity * (1.0, 1.0, -0.6), rtol=1e-6, atol=1e-9)
    # Frictionless: no torque but rounding of a force of 1e5 N through the centre.
    np.testing.assert_allclose(data.qvel[3:], 0.0, atol=1e-9)


def test_a_ball_that_flies_past_an_edge_is_not_deflected():
    """5 mm outside: rows frozen at the start would have it hit the edge it approaches."""
    start = (1.015, 0.0, 0.75)
    velocity = (0.0, 0.0, -150.0)
    for impact in ("none", "cut"):
        engine, data = thrown_ball(velocity=velocity, start=start, plate="1 1 .0005", impact=impact)
        engine.step(data)
        assert data.qvel[:3].tolist() == list(velocity)
        # To rounding of 1 m.
        np.testing.assert_allclose(data.qpos[:3], (1.015, 0.0, -0.75), atol=1e-12)


@pytest.mark.parametrize("name", ["slope", "stack", "pile at rest"])
def test_without_anything_fast_results_are_equal_bit_for_bit(name):
    scene = {"slope": slope, "stack": stack, "pile at rest": lambda: pile(count=12)}[name]()
    model = scene.model(0.002)
    engines = [make_engine(scene, model, impact=impact) for impact in ("none", "cut")]
    first, second = (engine.make_data() for engine in engines)
    if name == "pile at rest":
        engines[0].step(first, nstep=3000)  # the last capsule rolls off a box after 3 to 5 s
        mujoco.mj_copyData(second, engines[1].model, first)
    assert engines[1].step(second, nstep=200).cuts == 0
    engines[0].step(first, nstep=200)
    for field in ("qpos", "qvel", "qacc", "userdata", "sensordata", "efc_force"):
        assert getattr(first, field).tobytes() == getattr(second, field).tobytes()
    assert first.time == second.time


def test_clock_time_step_and_control_of_a_cut_step():
    start = (0.0, 0.0, 0.51)
    engine, data = thrown_ball(velocity=(0.0, 0.0, -100.0), start=start)
    calls = []
    mujoco.set_mjcb_control(lambda m, d: calls.append(d.time))
    try:
        stats = engine.step(data)
    finally:
        mujoco.set_mjcb_control(None)
    assert stats.cuts >= 2
    assert data.time == 0.01
    assert engine.model.opt.timestep == 0.01
    assert calls == [0.0]


def test_a_part_that_fails_leaves_state_and_time_step_as_they_were():
    extra = """<body pos="5 0 0"><joint name="hinge" type="hinge"/>
      <geom size=".1" mass="1" contype="0" conaffinity="0"/></body>"""
    engine, data = thrown_ball(velocity=(0, 0, -100), start=(0, 0, 0.51), extra=extra)
    engine.step(data)  # past the impact: there is contact memory to lose
    data.qpos[:3], data.qvel[:3] = (0, 0, 0.51), (0, 0, -100)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    before = np.empty(mujoco.mj_stateSize(engine.model, kind))
    after = before.copy()
    mujoco.mj_getState(engine.model, data, before, kind)
    start = data.time

    def fail_later(model, later):
        if later.time > start:
            later.qfrc_passive[-1] = np.nan

    mujoco.set_mjcb_passive(fail_later)
    try:
        with pytest.raises(RuntimeError, match="diverged"):
            engine.step(data)
    finally:
        mujoco.set_mjcb_passive(None)
    mujoco.mj_getState(engine.model, data, after, kind)
    assert after.tobytes() == before.tobytes()
    assert engine.model.opt.timestep == 0.01


def test_cut_steps_are_the_same_on_any_number_of_threads():
    engine, data = thrown_ball(velocity=(-80, 10, -150), start=(0.3, 0, 1.2), plate="1 1 .0005")
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(engine.model, kind))
    mujoco.mj_getState(engine.model, data, state, kind)
    states = np.tile(state, (6, 1))
    states[:, 1] += np.linspace(0, 0.1, 6)
    runs = [dashpot.rollout(engine, states, nstep=3, nthread=n)[0] for n in (1, 2, 3)]
    assert runs[0].tobytes() == runs[1].tobytes() == runs[2].tobytes()
    engine.step(data, nstep=3)
    mujoco.mj_getState(engine.model, data, state, kind)
    assert runs[0][0, -1].tobytes() == state.tobytes()


def test_a_struck_body_does_not_pass_what_lies_behind_it():
    """A puck hit at 200 m/s, 5 mm in front of a plate of 1 mm, all within one step."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option gravity="0 0 0" timestep="0.01"/><worldbody>
        <geom type="box" size="1 1 .0005" pos="0 0 -.0005"/>
        <body pos="0 0 .015"><freejoint/><geom type="sphere" size=".01" mass=".05"/></body>
        <body pos="0 0 .8"><freejoint/><geom type="sphere" size=".01" mass=".05"/></body>
        </worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model, impact="cut")
    data = engine.make_data()
    data.qvel[8] = -200.0
    for _ in range(5):
        engine.step(data)
        assert data.qpos[2] > 0.0
        assert data.qpos[9] > data.qpos[2]
    assert abs(data.qvel[2]) > 1.0  # it was struck


@pytest.mark.parametrize("other", [0.45, 0.51])
def test_a_link_that_turns_far_hides_no_impact(other):
    """It cuts the step, too: what is proven apart for its parts is not for all of the step."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="0.01" gravity="0 0 0"/><worldbody>
        <geom type="box" size=".005 5 .5" friction="0"/>
        <geom type="box" size=".005 1 .5" pos="0 20 0" friction="0"/>
        <body pos="-.1 -1 0"><freejoint/><geom size=".01" mass=".1" friction="0"/></body>
        <body pos="{-0.015 - other} 20 0"><freejoint/>
          <geom size=".01" mass=".1" friction="0"/></body>
        <body pos="0 9 0"><joint name="link" axis="0 0 1"/>
          <geom type="capsule" fromto="0 0 0 .2 0 0" size=".01" mass=".1" contype="0"
            conaffinity="0"/></body></worldbody>
        <actuator><motor joint="link"/></actuator></mujoco>"""
    )
    engine = dashpot.Engine(model, impact="cut")
    results = []
    for control in (0.0, 20.0):
        data = engine.make_data()
        data.qvel[[0, 1, 6]] = 20.0, 100.0, 100.0
        data.ctrl[0] = control
        engine.step(data)
        results.append(data.qpos[[0, 7]].copy())
    # The parts are others, and with them the micro-steps of hits: they last 10 us more or less.
    difference = np.abs(results[1] - results[0])
    assert (difference < 1e-5 * np.array([20.0, 100.0])).all()


@pytest.mark.parametrize("seed", range(10))
def test_a_struck_body_hits_what_it_had_been_proven_apart_from(seed):
    """One ball strikes another towards a plate, from which it kept away at first."""
    rng = np.random.default_rng(seed)
    height, distance = rng.uniform(0.05, 0.4), rng.uniform(0.1, 0.5)
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0" timestep="0.01"/><worldbody>
        <geom type="box" size="5 5 .0005" pos="0 0 -.0005"/>
        <body pos="0 0 {height}"><freejoint/><geom size=".01" mass=".05"/></body>
        <body pos="{rng.uniform(-0.005, 0.005)} 0 {height + distance}"><freejoint/>
        <geom size=".01" mass=".05"/></body></worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model, impact="cut")
    data = engine.make_data()
    data.qvel[[0, 6]] = rng.uniform(0, 30)
    data.qvel[8] = -rng.uniform(50, 300)
    for _ in range(4):
        engine.step(data)
        assert data.qpos[[2, 9]].min() > 0.0
    assert abs(data.qvel[2]) > 1.0  # it was struck


@pytest.mark.parametrize("seed", [0, 15])
def test_rigid_bounces_are_the_limit_of_stiff_springs(seed):
    """The limit of k to infinity with the same restitution and friction, at 5 ms."""
    bounce = random_bounce(seed)
    exact, converged = bounce.rigid_reference()
    assert converged
    assert max(relative_errors(bounce.made_of(None).after(0.005, "cut"), exact)) < 0.01


@pytest.mark.parametrize("timestep", [0.002, 0.01])
@pytest.mark.parametrize("stiffness", [1e6, 1e8, None])
def test_cuts_add_no_energy(stiffness, timestep):
    """An elastic box in a closed room at 6 m/s."""
    material = dashpot.Material(stiffness=stiffness, restitution=1.0, friction=0.0)
    gain, left = largest_gain(bouncing_boxes(1, timestep, seed=3), material, round(1 / timestep))
    # Overlap that frozen geometry makes recovers at 0.1 m/s: (0.1 / 6)^2 = 3e-4 of the energy.
    assert gain < 3e-4
    assert left > 0.3


@pytest.mark.parametrize("timestep", [0.002, 0.01])
@pytest.mark.parametrize("stiffness", [1e5, None])
def test_impacts_start_at_the_margin(stiffness, timestep):
    """At 3 m/s, which would go in by all of the margin of 20 mm before the surfaces met."""
    engine, data = thrown_ball(velocity=(0, 0, -3), start=(0, 0, 0.2), timestep=timestep)
    engine.model.geom("ball").margin = 0.02
    engine.set_material("ball", dashpot.Material(stiffness, restitution=0.5))
    engine.set_material("plate", dashpot.Material(stiffness, restitution=0.5))
    lowest = np.inf
    while data.time < 0.2:
        engine.step(data)
        lowest = min(lowest, data.qpos[2])
    # An undamped one would go in by v sqrt(m / k) = 0.95 mm.
    assert lowest > 0.01 + 0.02 - 1e-3
    assert data.qvel[2] == pytest.approx(1.5, rel=1e-6)


@pytest.mark.parametrize("size", [1e3, 1e6, 1e7, 1e9])
@pytest.mark.parametrize("ground", ["box", "sphere"])
@pytest.mark.parametrize("shape", ['type="box" size=".1 .1 .1"', 'size=".1"'])
def test_a_bounce_off_a_geom_as_large_as_a_planet(shape, ground, size):
    """Distances from it are known to a part of its size, longer than what cuts aim at."""
    flat = f'type="box" size="{size} {size} {size}"' if ground == "box" else f'size="{size}"'
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0"/><worldbody><geom {flat} pos="0 0 {-size}"/>
        <body pos="0 0 .15"><freejoint/><geom {shape} mass="1"/></body></worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model, impact="cut")
    engine.set_material(1, dashpot.Material(1e5, restitution=0.5, friction=0.0))
    data = engine.make_data()
    data.qvel[2] = -3.0
    engine.step(data, nstep=50)
    # MuJoCo's collision of such boxes jumps by a millimetre beyond 1e6 m; a hit goes in by 9 mm.
    assert 0.0 < data.qvel[2] < 3.0
    if size <= 1e6:
        assert data.qvel[2] == pytest.approx(1.5, rel=1e-3)


def test_refuses_by_name():
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(ValueError, match="impact is 'stop'"):
        dashpot.Engine(model, impact="stop")
    with pytest.raises(ValueError, match="impact is 'cut'"):
        dashpot.Engine(model, impact="cut", law="comfree")
