"""A sliding ball ends up rolling; friction fixes only when, momentum fixes how fast."""

import numpy as np
import pytest

from scene import set_velocity
from scenes import roll
from simulate import DASHPOT, make_engine, measure

TIMESTEPS = (0.001, 0.002, 0.005, 0.010)
RADIUS = 0.1


SAG = 1e-5  # bound of a rigid contact's sag under gravity (test_rest): shortens friction's lever


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_terminal_velocity_is_five_sevenths(timestep):
    assert measure(roll(), DASHPOT, timestep)["velocity error"] <= 1e-5  # 1e-3 %


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_rolling_ball_turns_about_its_contact(timestep):
    # v = w (r - sag), so w sag separates the two.
    assert measure(roll(), DASHPOT, timestep)["slip"] <= 8 * SAG


@pytest.mark.parametrize("timestep", [0.001, 0.010])
@pytest.mark.parametrize("spin", [-30.0, 5.0, 40.0])
def test_terminal_velocity_with_spin(spin, timestep):
    """Angular momentum about the floor is kept: v = (5 v0 + 2 r w0) / 7."""
    scene = roll(friction=0.4)
    engine = make_engine(scene, scene.model(timestep))
    data = engine.make_data()
    set_velocity("ball", (1.0, 0, 0, 0, spin, 0))(engine.model, data)
    engine.step(data, nstep=round(1.5 / timestep))
    expected = (5 * 1.0 + 2 * RADIUS * spin) / 7
    assert data.qvel[0] == pytest.approx(
        expected, abs=2 / 7 * SAG / RADIUS * (1 + RADIUS * abs(spin))
    )


@pytest.mark.parametrize("timestep", [0.001, 0.010])
def test_rolling_goes_on(timestep):
    """Without rolling friction nothing slows a rolling ball."""
    scene = roll()
    engine = make_engine(scene, scene.model(timestep))
    data = engine.make_data()
    set_velocity("ball", (1.0, 0, 0, 0, 1.0 / RADIUS, 0))(engine.model, data)
    engine.step(data, nstep=round(0.5 / timestep))
    before = data.qvel.copy()
    engine.step(data, nstep=round(5 / timestep))
    np.testing.assert_allclose(data.qvel, before, atol=1e-5 * 10)
    assert data.qvel[0] == pytest.approx(1.0, abs=2 / 7 * SAG / RADIUS)
