"""A free asymmetric body keeps its angular momentum and its energy."""

import pytest

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
    # A sanity bound, three orders above what an accurate rotation needs.
    assert numbers["energy error"] <= 1e-2
    assert numbers["momentum error"] <= 1e-2


def test_free_fall_is_an_exact_parabola():
    import mujoco

    import dashpot

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
