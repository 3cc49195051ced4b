"""Rolling without slip: a bicycle, a rattleback and discs, against their equations of motion."""

from __future__ import annotations

import numpy as np
import pytest

from bicycle import bicycle, modes_of_step, published_modes
from nonholonomic import tilted_disc, wobble
from rattleback import exact_spin, rattleback
from simulate import DASHPOT, measure

TIMESTEPS = (0.002, 0.005)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_bicycle_weaves_capsizes_and_casters_at_the_published_rates(timestep):
    """With its defaults MuJoCo is off by 10 to 13 %."""
    error = measure(bicycle(), DASHPOT, timestep)["mode error"]
    # Rims with a radius of curvature of 3 um turn capsize by 5e-4; castering, the fastest mode,
    # decays by 14/s, and steps are of second order.
    assert error < 1e-3 + (14 * timestep) ** 2


@pytest.mark.parametrize("speed", [1.0, 3.0, 5.0, 8.0])
@pytest.mark.parametrize("timestep", [0.001, 0.005])
def test_the_derivative_of_a_step_has_the_modes_of_a_bicycle(timestep, speed):
    """Of powers of A. Unstable at 1 and 3 m/s by weave, at 8 m/s by capsize."""
    published = published_modes(speed)
    modes = modes_of_step(DASHPOT, speed, timestep)
    fastest = np.abs(published).max()
    # Rigid friction gives way anew in each step (`dashpot.linearize`): capsize moves by 3e-3/s,
    # what is fast by 5e-4 of it. Steps are of second order, as the trapezoidal rule is.
    bound = 3e-3 + 5e-4 * fastest + fastest * (fastest * timestep) ** 2 / 12
    assert np.abs(modes - published).max() < bound
    assert (modes.real.max() > 0) == (published.real.max() > 0)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_rolling_disc_wobbles_at_its_frequency_and_neither_gains_nor_loses(timestep):
    numbers = measure(wobble(), DASHPOT, timestep)
    # 19 rad/s: turns by 0.09 rad in 5 ms, whose square is the error of a rate of second order.
    second_order = (19 * timestep) ** 2
    assert numbers["period error"] < 1e-5 + second_order / 12
    assert numbers["growth"] < 1e-4 + second_order / 4


@pytest.mark.parametrize("degrees", [10.0, 30.0, 60.0])
@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_tilted_disc_runs_round_at_the_rate_of_its_tilt(timestep, degrees):
    """Its centre stays; the line of contact turns under it at 2 sqrt(g / (r sin a))."""
    numbers = measure(tilted_disc(degrees=degrees), DASHPOT, timestep)
    # It turns by 28 rad/s at 30 degrees, twice that at 10.
    second_order = (28 * timestep) ** 2
    assert numbers["rate error"] < 1e-5 + second_order / 10
    assert numbers["tilt error"] < 1e-5 + second_order / 20


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_rattleback_spun_the_wrong_way_turns_round(timestep):
    """From -5 to 5 rad/s; with its defaults MuJoCo's comes out at 0.8 rad/s."""
    assert exact_spin(-5.0, 6.0) == pytest.approx(5.0, rel=1e-3)
    # It pitches at 53 rad/s, with all the energy in between: by 0.27 rad in a step of 5 ms.
    assert measure(rattleback(), DASHPOT, timestep)["spin error"] < 1e-4 + (53 * timestep) ** 2 / 5


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_rattleback_spun_the_right_way_spins_on(timestep):
    assert measure(rattleback(spin=5.0), DASHPOT, timestep)["spin error"] < 1e-3
