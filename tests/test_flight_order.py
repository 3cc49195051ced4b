"""Trees of joints in flight, where rows are possible: second order, momentum, energy."""

import numpy as np
import pytest

from flight import DRIVEN, TREES, conserved, flight
from simulate import INTEGRATORS, Setting, measure


@pytest.mark.parametrize("integrator", ["Euler", "implicit"])
@pytest.mark.parametrize("drive", DRIVEN)
@pytest.mark.parametrize("tree", TREES)
def test_flight_is_of_second_order(tree, drive, integrator):
    setting = Setting(integrator, dashpot=True, option={"integrator": INTEGRATORS[integrator]})
    steps = [0.005, 0.002, 0.001]
    scene = flight(tree, drive)
    errors = [measure(scene, setting, timestep)["position error"] for timestep in steps]
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(2.0, abs=0.25)
    # Joints turn by 0.01 rad in a step of 2 ms.
    assert errors[1] < 1e-3


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_a_limp_robot_in_flight_keeps_its_energy_and_momentum(timestep):
    """For five seconds without weight; energy in parts of what turns it, momentum of its size."""
    drifts = conserved("floating", timestep)
    assert drifts["energy drift"] < 1e-6 * (timestep / 0.002) ** 2
    assert drifts["momentum drift"] < 1e-6 * (timestep / 0.002) ** 2
