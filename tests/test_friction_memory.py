"""Friction remembers in all of its five directions and leaks nothing where contact points jump."""

import itertools

import mujoco
import numpy as np
import pytest

import dashpot

GRAVITY, HALF, FRICTION = 9.81, (0.1, 0.08, 0.05), (0.5, 0.01, 0.001)
TIMESTEPS = (0.001, 0.002, 0.005, 0.010)


def corners(half: tuple[float, float, float]) -> str:
    points = itertools.product((-1, 1), repeat=3)
    return " ".join(str(s * h) for signs in points for s, h in zip(signs, half, strict=True))


def on_a_table(body: str, table: str, dimensions: int, timestep: float) -> dashpot.Engine:
    surface = f'friction="{FRICTION[0]} {FRICTION[1]} {FRICTION[2]}" condim="{dimensions}"'
    geom = {
        "box": f'type="box" size="{HALF[0]} {HALF[1]} {HALF[2]}"',
        "mesh": 'type="mesh" mesh="body"',
        "sphere": f'type="sphere" size="{HALF[2]}"',
    }[body]
    below = {
        "plane": 'type="plane" size="0 0 1"',
        "box": 'type="box" size="0.5 0.5 0.05" pos="0 0 -0.05"',
        "mesh": 'type="mesh" mesh="table" pos="0 0 -0.05"',
    }[table]
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}"/><asset>
        <mesh name="body" vertex="{corners(HALF)}"/>
        <mesh name="table" vertex="{corners((0.5, 0.5, 0.05))}"/></asset>
        <worldbody><geom {below} {surface}/><body name="body" pos="0 0 {HALF[2]}"><freejoint/>
        <geom {geom} mass="1" {surface}/></body></worldbody></mujoco>"""
    )
    return dashpot.Engine(model)


# What a period of rocking may leave: pure sliding friction sticks throughout, so that only elastic
# displacement moves. With torsion and rolling, rocking slips the rolling friction of single corners
# to and fro, and a slip that is normal to the shared limit surface takes some sliding with it.
CREEP = {3: 1e-8, 6: 1e-5}


@pytest.mark.parametrize(
    ("body", "table", "dimensions"),
    [("box", "plane", 3), ("box", "box", 6), ("mesh", "plane", 6), ("mesh", "mesh", 3)],
)
@pytest.mark.parametrize("timestep", [0.002, 0.010])
def test_a_pushed_box_does_not_creep_while_it_is_rocked(body, table, dimensions, timestep):
    """70 % of the sliding limit in x; moments about all axes rock and turn it at 1 to 3 Hz."""
    engine = on_a_table(body, table, dimensions, timestep)
    data = engine.make_data()
    weight, period = GRAVITY, round(1.0 / timestep)
    means = []
    for step in range(8 * period):
        turn = 2 * np.pi * step * timestep
        data.xfrc_applied[1] = [
            0.7 * FRICTION[0] * weight * min(1.0, step * timestep),
            0.0,
            0.0,
            0.15 * weight * HALF[1] * np.sin(2 * turn),
            0.15 * weight * HALF[0] * np.sin(3 * turn),
            0.1 * FRICTION[0] * weight * HALF[0] * np.sin(turn),
        ]
        engine.step(data)
        means.append(data.qpos.copy())
    positions = np.reshape(means, (8, period, 7))
    # It rocks by what its contacts give.
    assert np.ptp(positions[-1, :, 4]) > 1e-7
    creep = positions[-1].mean(axis=0) - positions[2].mean(axis=0)
    assert np.abs(creep).max() <= CREEP[dimensions]


@pytest.mark.parametrize("timestep", TIMESTEPS)
@pytest.mark.parametrize(("part", "holds"), [(0.65, True), (0.8, False)])
def test_spin_and_roll_stick_below_the_ellipse(part, holds, timestep):
    """Torsional and rolling moments share the surface: 0.65 of each holds, 0.8 of each does not."""
    engine = on_a_table("sphere", "plane", 6, timestep)
    data = engine.make_data()
    # Friction at the contact balances the moment of the rolling force, so push with a moment only.
    data.xfrc_applied[1, 3:] = (part * FRICTION[2] * GRAVITY, 0, part * FRICTION[1] * GRAVITY)
    engine.step(data, nstep=round(4.0 / timestep))
    before = data.qpos.copy()
    engine.step(data, nstep=round(10.0 / timestep))
    if holds:
        assert np.abs(data.qpos - before).max() < 1e-9
    else:
        assert np.abs(data.qvel[3:]).max() > 1.0


@pytest.mark.parametrize("axis", [3, 5])
@pytest.mark.parametrize("timestep", [0.001, 0.010])
def test_torsion_and_rolling_spring_back(axis, timestep):
    """Below the limit a moment winds elastic displacement up; without it the ball is back."""
    engine = on_a_table("sphere", "plane", 6, timestep)
    data = engine.make_data()
    engine.step(data, nstep=round(1.0 / timestep))
    free = data.qpos.copy()
    limit = FRICTION[1 if axis == 5 else 2] * GRAVITY
    # A load that comes at once swings to no more than twice itself: nothing slips.
    data.xfrc_applied[1, axis] = 0.4 * limit
    engine.step(data, nstep=round(4.0 / timestep))
    wound = np.abs(data.qpos - free)[4:].max()
    assert wound > 1e-8
    data.xfrc_applied[:] = 0
    engine.step(data, nstep=round(8.0 / timestep))
    assert np.abs(data.qpos - free).max() < 1e-3 * wound
