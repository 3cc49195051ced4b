"""What stands on a mocap body that accelerates feels its acceleration, not a jump in every step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np
import pytest

from dashpot import Energy, Engine, Material

if TYPE_CHECKING:
    from collections.abc import Callable

GRAVITY, FRICTION, MASS = 9.81, 0.5, 0.5
TIMESTEPS = [0.002, 0.005]
SHAPES = {"box": 'type="box" size=".05 .05 .02"', "ball": 'size=".02"'}


def tray(
    timestep: float,
    *,
    shape: str = "box",
    place: float = 0.0,
    more: tuple[str, str] = ("", ""),
    integrator: str = "Euler",
    **options: object,
) -> tuple[Engine, mujoco.MjData]:
    """Return a tray of 1 kg that is moved by mocap, with a body on it that has come to rest."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}" integrator="{integrator}"/>
        <default><geom friction="{FRICTION} 0 0"/></default><worldbody>
        <body name="tray" mocap="true" pos="0 0 -.05">
          <geom name="tray" type="box" size="3 1 .05" mass="1"/></body>
        <body name="part" pos="{place} 0 .02"><freejoint/>
          <geom name="part" {SHAPES[shape]} mass="{MASS}"/></body>
        {more[0]}</worldbody>{more[1]}</mujoco>"""
    )
    if "law" not in options:
        options = {"mocap_timeconst": 0.0, **options}
    engine = Engine(model, **options)
    data = engine.make_data()
    engine.step(data, nstep=round(0.05 / timestep))
    return engine, data


def accelerated(
    engine: Engine, data: mujoco.MjData, acceleration: float, *, seconds: float
) -> np.ndarray:
    """Return by how much (m) the part goes along the tray from its start on, step by step."""
    timestep, slip = engine.model.opt.timestep, []
    for k in range(round(seconds / timestep)):
        data.mocap_pos[0, 0] = 0.5 * acceleration * (timestep * (k + 1)) ** 2
        engine.step(data)
        slip.append(data.qpos[0] - data.mocap_pos[0, 0])
    return np.asarray(slip)


def shaken(
    engine: Engine,
    data: mujoco.MjData,
    way: Callable[[float], float],
    *,
    axis: int,
    seconds: float,
) -> tuple[np.ndarray, np.ndarray, list[Energy]]:
    """Return the mean times of steps, the force of the tray over the weight, and the energies."""
    timestep, first = engine.model.opt.timestep, data.mocap_pos[0, axis].item()
    times, force, energies = [], [], [engine.energy(data)]
    for k in range(round(seconds / timestep)):
        data.mocap_pos[0, axis] = first + way(timestep * (k + 1))
        engine.step(data)
        times.append((k + 0.5) * timestep)
        force.append(engine.contacts(data).force[:, 0].sum() / (MASS * GRAVITY))
        energies.append(engine.energy(data))
    return np.asarray(times), np.asarray(force), energies


def sine(ratio: float, frequency: float) -> Callable[[float], float]:
    """Return a motion from rest whose acceleration is at most `ratio` times gravity."""
    turn = 2.0 * np.pi * frequency
    return lambda t: ratio * GRAVITY / turn**2 * (1.0 - np.cos(turn * t))


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_box_does_not_slip_on_a_tray_that_accelerates_below_friction(timestep):
    """At 0.6 mu g it slipped by 0.14, 0.29 and 0.94 mm in every 0.2 s at 1, 2 and 5 ms."""
    acceleration = 0.6 * FRICTION * GRAVITY
    slip = accelerated(*tray(timestep), acceleration, seconds=0.5)
    # From the third step on, positions of up to a metre are rounded.
    assert np.ptp(slip[5:]) < 1e-8
    # Told where to be at the end of the first step, the tray begins at half of what it has then: a
    # jump of a H / 2, as does the second step. From each the box slips until friction has it.
    jump, rest = 0.5 * acceleration * timestep, FRICTION * GRAVITY
    most = 0.5 * jump**2 * (1.0 / rest + 1.0 / (rest - acceleration))
    assert abs(slip[-1]) < 1.5 * most


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_box_slips_on_a_tray_that_accelerates_beyond_friction(timestep):
    acceleration, seconds = 1.5 * FRICTION * GRAVITY, 0.5
    engine, data = tray(timestep)
    start = engine.energy(data)
    slip = accelerated(engine, data, acceleration, seconds=seconds)
    # In the first step the tray goes at half of what it is to have at its end, which the box does
    # not exceed; from then on friction has it, to a micro-step of 0.25 ms.
    first, friction, rest = 0.5 * acceleration * timestep, FRICTION * GRAVITY, seconds - timestep
    way = first * (timestep - 0.5 * first / friction) + first * rest + 0.5 * friction * rest**2
    exact = 0.5 * acceleration * seconds**2 - way
    assert slip[-1] == pytest.approx(-exact, abs=friction * 0.25e-3 * seconds)
    # Friction took its force times the slip, and the tray worked against it all its way.
    end, force = engine.energy(data), friction * MASS
    dissipated = end.dissipated_friction - start.dissipated_friction
    assert dissipated == pytest.approx(-force * slip[-1], rel=1e-3)
    assert end.work - start.work == pytest.approx(0.5 * force * acceleration * seconds**2, rel=1e-3)


@pytest.mark.parametrize("timeconst", [0.0, 0.02])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_what_stands_on_a_plate_that_shakes_below_gravity_keeps_contact(
    timestep, shape, integrator, timeconst
):
    """N = m g (1 - Gamma sin(w t)). At Gamma 0.8 16 to 19 % of the steps had no force."""
    frequency, ratio = 10.0, 0.8
    engine, data = tray(timestep, shape=shape, integrator=integrator, mocap_timeconst=timeconst)
    times, force, _ = shaken(engine, data, sine(ratio, frequency), axis=2, seconds=0.5)
    exact = 1.0 + ratio * np.cos(2.0 * np.pi * frequency * times)
    late = times > 0.1
    assert force[late].min() > 0.0
    # Mean forces of steps, between which the velocity jumps by H^3 / 4 times the fourth derivative
    # of the way, which is w^2 times its acceleration.
    turn = 2.0 * np.pi * frequency * timestep
    assert np.abs(force - exact)[late].max() < 0.25 * ratio * turn**2


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_tray_that_speeds_up_its_turn_takes_a_box_along(timestep):
    place, acceleration, seconds = 0.5, 4.0, 0.5
    engine, data = tray(timestep, place=place)
    # Up to 2 m/s^2 along and, at 2 rad/s, 2 m/s^2 across, of 4.9 m/s^2.
    way = []
    for k in range(round(seconds / timestep)):
        angle = 0.5 * acceleration * (timestep * (k + 1)) ** 2
        data.mocap_quat[0] = np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)
        engine.step(data)
        place_on_tray = np.exp(-1j * angle) * complex(*data.qpos[:2])
        way.append(place_on_tray)
    # Of second order in the turn of a step, up to 0.01 rad, as on trays that turn evenly; it was
    # 0.25, 0.5 and 1.5 mm.
    assert abs(way[-1] - way[5]) < 2e-5


@pytest.mark.parametrize("speed", [0.5, -0.5])
@pytest.mark.parametrize("axis", [0, 2])
@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_starts_and_stops_throw_as_jumps_of_velocity_do(timestep, axis, speed):
    """An acceleration through the step of the start would end at half as much again."""
    engine, data = tray(timestep)
    engine.set_material("tray", Material(restitution=0.0))
    engine.set_material("part", Material(restitution=0.0))
    first, velocity = data.mocap_pos[0, axis].item(), []
    moving = round(0.3 / timestep)
    for k in range(2 * moving):
        data.mocap_pos[0, axis] = first + speed * timestep * min(k + 1, moving)
        engine.step(data)
        velocity.append(data.qvel[axis])
    ahead = np.asarray(velocity) / speed
    if axis == 0:
        # Sliding springs stop with an overshoot below a thousandth.
        assert ahead.min() > -1e-3
        assert ahead.max() < 1.0 + 1e-3
        assert ahead[moving - 1] == pytest.approx(1.0, abs=1e-3)
        assert ahead[-1] == pytest.approx(0.0, abs=1e-3)
    elif speed > 0.0:
        # Thrown up at the speed of the plate where this stops, no faster; rigid contacts without
        # restitution leave some percent of a hit.
        assert ahead[:moving] == pytest.approx(1.0, abs=0.05)
        assert ahead[moving:].max() <= 1.0
    else:
        # Left behind, it falls until it meets the plate at twice its speed, which stops it.
        assert ahead.max() == pytest.approx(2.0, abs=GRAVITY * timestep / abs(speed))
        assert ahead[moving - 1] == pytest.approx(1.0, abs=1e-3)
        assert ahead[moving + 2 :] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("impact", ["none", "cut"])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("axis", "ratio"), [(0, 0.75), (2, 1.5)])
@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_the_ledger_of_a_shaken_tray_closes(timestep, axis, ratio, shape, impact):
    engine, data = tray(timestep, shape=shape, impact=impact)
    _, force, energies = shaken(engine, data, sine(ratio, 5.0), axis=axis, seconds=0.6)
    assert force.max() > 0.99  # weights: it stands there
    work = np.asarray([energy.work for energy in energies])
    total = np.asarray([energy.total for energy in energies])
    # The tray is lifted, too, which is of its work; forces and work go by the same closed form.
    turned_over = np.abs(np.diff(work)).sum()
    assert np.ptp(total) < 1e-9 * max(turned_over, 1e-3)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_shaking_what_keeps_contact_dissipates_next_to_nothing(timestep, shape):
    """Jumps of each step took 2.5 of the weight times the amplitude a second at 5 ms."""
    engine, data = tray(timestep, shape=shape)
    _, force, energies = shaken(engine, data, sine(0.8, 5.0), axis=2, seconds=1.0)
    assert force.min() > 0.0
    lost = energies[-1].dissipated_normal - energies[0].dissipated_normal
    amplitude = 0.8 * GRAVITY / (2.0 * np.pi * 5.0) ** 2
    # What the jump of the start leaves, a^2 H^2 / 8 a mass, and again in its second step.
    start = 0.25 * MASS * (0.8 * GRAVITY * timestep) ** 2
    assert lost < start + 5e-3 * MASS * GRAVITY * amplitude


# A link that a torque turns far cuts steps into parts, a fast ball those with impact="cut".
LINK = (
    """<body pos="0 9 0"><joint name="link" axis="0 0 1"/>
      <geom type="capsule" fromto="0 0 0 .2 0 0" size=".01" mass=".1"/></body>""",
    '<actuator><motor joint="link"/></actuator>',
)
BALL = (
    """<geom name="floor" type="box" size=".5 .5 .01" pos="0 5 0"/>
    <geom name="roof" type="box" size=".5 .5 .01" pos="0 5 .1"/>
    <body pos="0 5 .05"><freejoint/><geom name="ball" size=".005" mass=".01"/></body>""",
    "",
)


@pytest.mark.parametrize(("more", "impact"), [(LINK, "none"), (BALL, "cut")])
@pytest.mark.parametrize("timestep", [0.002, 0.005])
def test_a_box_does_not_slip_where_steps_are_taken_in_parts(timestep, more, impact):
    engine, data = tray(timestep, more=more, impact=impact)
    for geom in ("floor", "roof", "ball") if more is BALL else ():
        engine.set_material(geom, Material(restitution=1.0))
    if more is BALL:
        data.qvel[8] = 6.0
    parts, slip, acceleration = [], [], 0.6 * FRICTION * GRAVITY
    for k in range(round(0.3 / timestep)):
        if more is LINK:
            data.ctrl[0] = 20.0 if (k // 5) % 2 else -20.0
        before = data.mocap_pos[0, 0].item()
        data.mocap_pos[0, 0] = 0.5 * acceleration * (timestep * (k + 1)) ** 2
        parts.append(engine.step(data).parts)
        slip.append(data.qpos[0] - data.mocap_pos[0, 0])
        # The velocity that sensors see is the mean of the last part, here that of v(t) in a step.
        mean = (data.mocap_pos[0, 0] - before) / timestep
        low, high = (mean + side * 0.5 * acceleration * timestep for side in (-1.0, 1.0))
        assert k < 2 or low - 1e-9 <= data.body("tray").cvel[3] <= high + 1e-9
        assert parts[-1] > 1 or data.body("tray").cvel[3] == pytest.approx(mean, rel=1e-12)
    assert np.mean(np.asarray(parts) > 1) > 0.05
    assert np.ptp(slip[5:]) < 1e-7


def test_a_box_does_not_slip_where_steps_differ_in_length():
    engine, data = tray(0.001)
    slip, time = [], 0.0
    for k in range(120):
        engine.model.opt.timestep = (0.001, 0.003, 0.002)[k % 3]
        time += engine.model.opt.timestep
        data.mocap_pos[0, 0] = 0.3 * FRICTION * GRAVITY * time**2
        engine.step(data)
        slip.append(data.qpos[0] - data.mocap_pos[0, 0])
    # Of the springs of friction, whose stiffness goes by the length of micro-steps.
    assert np.ptp(slip[6:]) < 1e-6


@pytest.mark.parametrize("impact", ["none", "cut"])
def test_shaking_goes_on_from_a_saved_state_bit_for_bit(impact):
    engine, data = tray(0.002, impact=impact)
    way = sine(0.8, 10.0)

    def shake(d, first, last):
        for k in range(first, last):
            d.mocap_pos[0] = 0.5 * way(0.002 * k), 0.0, way(0.002 * k) - 0.05
            engine.step(d)

    shake(data, 0, 33)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(engine.model, kind))
    mujoco.mj_getState(engine.model, data, state, kind)
    other = engine.make_data()
    mujoco.mj_setState(engine.model, other, state, kind)
    for d in (data, other):
        shake(d, 33, 90)
    assert np.array_equal(data.qpos, other.qpos)
    assert np.array_equal(data.qvel, other.qvel)
    assert np.array_equal(data.userdata, other.userdata)


def test_a_tray_moves_nothing_by_the_complementarity_free_law():
    """There mocap bodies are at once where they are told to be, without any motion."""
    engine, data = tray(0.002, law="comfree")
    accelerated(engine, data, 3.0, seconds=0.3)
    assert data.qvel[:2] == pytest.approx(0.0, abs=1e-12)
