"""What is round runs over tiles that are tilted against each other, beside its path or along it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dashpot import Engine

GRAVITY = 9.81
TIMESTEPS = [0.001, 0.002, 0.005]
RADIUS, MASS = 0.006, 0.1
SLIDES = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'


def planks_tilted_sideways(kink: float, timestep: float) -> mujoco.MjModel:
    """Return planks of 5 mm, turned about the path of a ball by half a kink (deg) to and fro.

    Their faces meet in the path, which is straight and level.
    """
    planks = ""
    for i in range(60):
        tilt = kink / 2 * (1 if i % 2 else -1)
        up = np.array([0, -np.sin(np.radians(tilt)), np.cos(np.radians(tilt))])
        x, y, z = [0.005 * i, 0, 0] - 0.004 * up
        planks += (
            f'<geom type="box" size=".00255 .01 .004" pos="{x} {y} {z}" euler="{tilt} 0 0"'
            ' friction="0"/>'
        )
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}"/><worldbody>{planks}
        <body pos="0 0 {RADIUS}">{SLIDES}<geom size="{RADIUS}" mass="{MASS}" friction="0"/></body>
        </worldbody></mujoco>"""
    )


@pytest.mark.parametrize("timestep", TIMESTEPS)
@pytest.mark.parametrize("speed", [0.5, 1.0])
@pytest.mark.parametrize("kink", [0.5, 1.0, 1.5, 6.0])
def test_a_ball_keeps_its_speed_over_planks_tilted_sideways(kink, speed, timestep) -> None:
    """Without friction nothing slows it, and nothing lifts it."""
    engine = Engine(planks_tilted_sideways(kink, timestep))
    data = engine.make_data()
    data.qvel[0] = speed
    highest = 0.0
    for _ in range(round(0.2 / speed / timestep)):
        engine.step(data)
        highest = max(highest, data.qpos[1])
    # The ball touches beside its lowest point, by r kink / 2, and leaves the sag of one plank for
    # that of the next.
    assert data.qvel[0] == pytest.approx(speed, rel=3e-3)
    assert highest < 1.5e-5
    assert data.qpos[1] > -1.5e-5


def bent(kink: float, timestep: float) -> tuple[mujoco.MjModel, float]:
    """Return a track of planks of 5 mm, each turned down by a kink (deg), with a ball on the first.

    Beside it the slope (rad) that it starts with. A kink below 0 makes a valley.
    """
    count, at, planks, slopes = 20, np.zeros(2), "", []
    for i in range(count):
        slope = np.radians(kink * ((count - 1) / 2 - i))
        end = at + 0.005 * np.array([np.cos(slope), np.sin(slope)])
        x, z = (at + end) / 2 - 0.01 * np.array([-np.sin(slope), np.cos(slope)])
        planks += (
            f'<geom type="box" size=".0025 .1 .01" pos="{x} 0 {z}" friction="0"'
            f' euler="0 {-np.degrees(slope)} 0"/>'
        )
        slopes.append(slope)
        at = end
    first = slopes[0]
    x, z = 0.0015 * np.array([np.cos(first), np.sin(first)]) + RADIUS * np.array(
        [-np.sin(first), np.cos(first)]
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}"/><worldbody>{planks}
        <body pos="{x} 0 {z}">{SLIDES}<geom size="{RADIUS}" mass="{MASS}" friction="0"/></body>
        </worldbody></mujoco>"""
    )
    return model, first


@pytest.mark.parametrize("timestep", TIMESTEPS)
@pytest.mark.parametrize("kink", [0.7, -0.7])
def test_a_ball_keeps_its_energy_over_kinks_that_count_as_flush(kink, timestep) -> None:
    """Rigid ones take v^2 kink^2 each of what is damped; none may be gained, nor much more lost."""
    model, slope = bent(kink, timestep)
    engine = Engine(model)
    data = engine.make_data()
    speed = 0.5
    data.qvel[:] = speed * np.cos(slope), speed * np.sin(slope)
    start = engine.energy(data)
    engine.step(data, nstep=round(0.005 * 19 / speed / timestep))
    end = engine.energy(data)
    kinetic = 0.5 * MASS * speed**2
    gained = (end.kinetic + end.potential - start.kinetic - start.potential) / kinetic
    assert -0.03 < gained < 1e-3


LEAD_RADIUS, LOAD = 0.05, 20.0
SCREW_INERTIA, NUT_MASS = 3e-4, 0.5


def screw(lead: float, friction: float, timestep: float) -> mujoco.MjModel:
    """Return a screw with a thread of 60 boxes a turn, and a nut with one pin on it, loaded."""
    rise, boxes = 2 * np.pi * LEAD_RADIUS * np.tan(lead), ""
    half = 1.02 * np.pi * LEAD_RADIUS / 60 / np.cos(lead)
    for i in range(120):
        turn = 2 * np.pi * (i + 0.5) / 60
        along = np.array([np.sin(lead), -np.sin(turn) * np.cos(lead), np.cos(turn) * np.cos(lead)])
        out = np.array([0, np.cos(turn), np.sin(turn)])
        face = np.cross(along, out)
        centre = [rise * turn / (2 * np.pi), 0, 0] + LEAD_RADIUS * out
        x, y, z = centre - 0.004 * face * np.sign(face[0])
        axes = " ".join(str(value) for value in (*along, *out))
        boxes += (
            f'<geom type="box" size="{half} .01 .004" pos="{x} {y} {z}" xyaxes="{axes}"'
            f' friction="{friction}" contype="1" conaffinity="2"/>'
        )
    middle = 2 * np.pi
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0" timestep="{timestep}"/><worldbody>
        <body><joint axis="1 0 0"/>
          <inertial mass=".3" pos="0 0 0" diaginertia="3e-4 3e-4 {SCREW_INERTIA}"/>{boxes}</body>
        <body pos="{rise + RADIUS / np.cos(lead)} 0 0"><joint type="slide" axis="1 0 0"/>
          <inertial mass="{NUT_MASS}" pos="0 0 0" diaginertia="1e-3 1e-3 1e-3"/>
          <geom size="{RADIUS}" friction="{friction}" contype="2" conaffinity="1"
            pos="0 {LEAD_RADIUS * np.cos(middle)} {LEAD_RADIUS * np.sin(middle)}"/></body>
        </worldbody></mujoco>"""
    )


def turned(lead: float, friction: float, timestep: float, seconds: float) -> float:
    """Return by how much (rad) the load turns the screw back."""
    engine = Engine(screw(lead, friction, timestep))
    data = engine.make_data()
    data.qfrc_applied[1] = -LOAD
    engine.step(data, nstep=round(seconds / timestep))
    # The nut has gone as far as its thread, but for what the contact gives way by.
    assert data.qpos[1] == pytest.approx(
        -LEAD_RADIUS * np.tan(lead) * data.qpos[0], rel=0.01, abs=5e-5
    )
    return data.qpos[0]


@pytest.mark.parametrize(
    ("friction", "timestep"),
    # At 5 ms others go farther in a step than detection follows, 1.25 of the radius of the pin.
    [
        (0.0, 0.001),
        (0.0, 0.002),
        (0.1, 0.001),
        (0.1, 0.002),
        (0.2, 0.001),
        (0.2, 0.002),
        (0.2, 0.005),
    ],
)
def test_a_load_drives_a_steep_screw_back(friction, timestep) -> None:
    """N pushes along the axis with N (cos + mu sin), about it with R N (sin - mu cos)."""
    lead, seconds = np.radians(15), 0.1
    axial, round_ = (
        np.cos(lead) + friction * np.sin(lead),
        np.sin(lead) - friction * np.cos(lead),
    )
    carried = NUT_MASS * LEAD_RADIUS**2 * np.tan(lead) * round_ / SCREW_INERTIA
    expected = 0.5 * LEAD_RADIUS * LOAD / (axial + carried) * round_ / SCREW_INERTIA * seconds**2
    # The first step is long for what turns by a radian in all.
    assert turned(lead, friction, timestep, seconds) == pytest.approx(expected, rel=0.012)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_screw_locks_itself_where_its_lead_is_below_friction(timestep) -> None:
    """It gives way by what the contact of the pin does, and stays."""
    lead = np.radians(10)
    at_once, later = (turned(lead, 0.2, timestep, seconds) for seconds in (0.3, 1.0))
    assert abs(at_once) < 5e-4
    assert later == pytest.approx(at_once, abs=1e-12)
