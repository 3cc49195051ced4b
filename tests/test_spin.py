"""A free asymmetric body keeps its angular momentum and its energy."""

import time

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import dashpot
from scene import GRAVITY, free_body
from scenes import spin
from simulate import DASHPOT, measure


def test_a_minute_of_tumbling():
    numbers = measure(spin(), DASHPOT, 0.001)
    # The motion about the middle axis is unstable: only an accurate integration passes.
    assert numbers["momentum error"] <= 1e-9
    assert numbers["energy error"] <= 1e-9


@pytest.mark.parametrize("timestep", [0.005, 0.010, 0.020])
def test_fast_spin_at_large_steps_gains_no_energy(timestep):
    """60 rad/s turns 1.2 rad in 20 ms, where explicit gyroscopic terms blow up."""
    numbers = measure(spin(rate=60.0, duration=20.0), DASHPOT, timestep)
    # As at 1 ms: the rotation takes as many parts of a step as its order needs for that.
    assert numbers["energy error"] <= 1e-9
    assert numbers["momentum error"] <= 1e-9


def test_free_fall_is_an_exact_parabola():
    body = free_body("a", 'type="box" size="0.1 0.2 0.3" mass="3"', (0, 0, 0))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 -{GRAVITY}" timestep="0.01"/>'
        f"<worldbody>{body}</worldbody></mujoco>"
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qvel[:3] = [1, 2, 3]
    engine.step(data, nstep=100)
    # Rounding of 100 steps.
    assert data.qpos[0] == pytest.approx(1, abs=1e-13)
    assert data.qpos[2] == pytest.approx(3 - GRAVITY / 2, abs=1e-13)
    assert data.qvel[2] == pytest.approx(3 - GRAVITY, abs=1e-13)


def spinning(inertia, rate, timestep):
    """Return an engine and data of a body of 1 kg that spins at `rate` (rad/s, its own frame)."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0" timestep="{timestep}"/><worldbody>
        <body><freejoint/><geom size=".01" mass="0"/>
          <inertial pos="0 0 0" mass="1" diaginertia="{" ".join(map(str, inertia))}"/>
        </body></worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qvel[3:] = rate
    return engine, data


ROD = (1 / 12, 1 / 12, 5e-7)  # a metre long, 1 mm in radius


@pytest.mark.parametrize("inertia", [ROD, (0.01, 0.01, 0.02), (0.004, 0.01, 0.01)])
@pytest.mark.parametrize("timestep", [0.002, 0.01])
def test_bodies_of_revolution_precess_about_their_angular_momentum(inertia, timestep):
    """Their axis turns about it at L / I, and they about their axis at (1 - I_a / I) w_a."""
    rate, duration = np.array([1.0, 2.0, 5.0]), 2.0
    engine, data = spinning(inertia, rate, timestep)
    engine.step(data, nstep=round(duration / timestep))
    axis = 0 if inertia[1] == inertia[2] else 2
    across = inertia[1]
    precession = Rotation.from_rotvec(duration * np.multiply(inertia, rate) / across)
    spin_rate = np.zeros(3)
    spin_rate[axis] = (1 - inertia[axis] / across) * rate[axis]
    end = precession * Rotation.from_rotvec(duration * spin_rate)
    w, x, y, z = data.qpos[3:]
    assert (end.inv() * Rotation.from_quat([x, y, z, w])).magnitude() < 1e-8
    assert data.qvel[3:] == pytest.approx(
        Rotation.from_rotvec(-duration * spin_rate).apply(rate), abs=1e-8
    )


def test_a_thin_rod_costs_no_more_than_a_thick_one():
    """Its moments differ by a factor of 170,000, which the steps of its rotation once followed."""

    def cost(inertia):
        engine, data = spinning(inertia, (1.0, 1.0, 0.0), 0.002)
        times = []
        for _ in range(5):
            start = time.process_time()
            engine.step(data, nstep=50)
            times.append(time.process_time() - start)
        return min(times)

    assert cost(ROD) < 10 * cost((0.1, 0.1, 0.02))
