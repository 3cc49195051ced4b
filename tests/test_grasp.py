"""Friction holds a shaken object between two fingers without slip."""

import numpy as np
import pytest

from scenes import gripper
from simulate import DASHPOT, measure, record


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005, 0.010])
def test_a_shaken_grasp_does_not_slip(timestep):
    # 0.01 mm is the bound for 10 s. The elastic displacement averages out over a period.
    assert measure(gripper(duration=4.0), DASHPOT, timestep)["slip"] <= 1e-5


def test_a_grip_below_the_friction_limit_lets_go():
    # 2 fingers of 2 N at friction 1 hold 4 N, the object weighs 4.9 N.
    run = record(gripper(duration=0.25, force=2.0, amplitude=0.0), DASHPOT, 0.002)
    # It falls under the excess weight alone, (4.9 - 4) N on 0.5 kg, once the fingers press: they
    # shake for some 0.05 s.
    slides = run.time > 0.1
    fall = np.polyfit(run.time[slides], run.position("held")[slides, 2], 2)
    assert -2.0 * fall[0] == pytest.approx(9.81 - 4.0 / 0.5, rel=1e-3)
