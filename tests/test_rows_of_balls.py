"""Blows that run through rows of touching balls."""

import functools

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import dashpot

SPEED = 1.0


@functools.cache
def speeds_of_equal_springs(balls, moving=1):
    """Return final speeds of equal masses with equal springs between; the first ones come."""

    def rates(_, state):
        x, v = state[:balls], state[balls:]
        force = np.maximum(0.0, x[:-1] - x[1:])
        return np.concatenate([v, np.append(-force, 0.0) + np.append(0.0, force)])

    start = np.zeros(2 * balls)
    start[balls : balls + moving] = SPEED
    end = solve_ivp(rates, [0.0, 60.0], start, rtol=1e-9, atol=1e-11, max_step=0.05)
    return end.y[balls:, -1]


def speeds_after_blow(balls, moving, *, timestep, phase, stiffness=None, **options):
    radius = 0.05
    bodies = "".join(
        f'<body pos="{2 * radius * i} 0 0"><joint type="slide" axis="1 0 0"/>'
        f'<geom name="b{i}" size="{radius}" mass="1"/></body>'
        for i in range(balls)
    )
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string(
            f'<mujoco><option timestep="{timestep}" gravity="0 0 0"/>'
            f"<worldbody>{bodies}</worldbody></mujoco>"
        ),
        **options,
    )
    for i in range(balls):
        engine.set_material(f"b{i}", dashpot.Material(stiffness, restitution=1.0, friction=0.0))
    data = engine.make_data()
    data.qpos[:moving] = -(2.0 + phase) * timestep * SPEED
    data.qvel[:moving] = SPEED
    engine.step(data, nstep=round(0.2 / timestep))
    return data.qvel.copy()


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize(("balls", "moving"), [(3, 1), (4, 1), (5, 1), (5, 2), (8, 1)])
def test_rigid_balls_that_touch_pass_a_blow_on_as_equal_springs_do(balls, moving, timestep):
    # The last of five left with 0.71, for contacts that the blow had yet to reach were stiffer.
    for phase in (0.1, 0.6):
        speeds = speeds_after_blow(balls, moving, timestep=timestep, phase=phase)
        assert speeds == pytest.approx(speeds_of_equal_springs(balls, moving), abs=0.02 * SPEED)


@pytest.mark.parametrize("timestep", [0.001, 0.002])
def test_cuts_at_the_blow_change_nothing_of_it(timestep):
    speeds = speeds_after_blow(5, 1, timestep=timestep, phase=0.4, impact="cut")
    assert speeds == pytest.approx(speeds_of_equal_springs(5), abs=0.02 * SPEED)


@pytest.mark.parametrize("stiffness", [1e5, 1e7])
def test_a_stiffness_changes_nothing_of_it(stiffness):
    speeds = speeds_after_blow(5, 1, timestep=0.001, phase=0.4, stiffness=stiffness)
    assert speeds == pytest.approx(speeds_of_equal_springs(5), abs=0.02 * SPEED)
