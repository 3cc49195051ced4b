"""Calibration on real cube tosses (ContactNets), dashpot and MuJoCo tuned the same way.

A toss is simulated from the last frame before the centre of the cube is below half width times
sqrt(3), the first height at which a corner could touch; its velocity there is fitted to the flight
before. Prediction errors are time means over all later frames: distance between the centres in
percent of the cube's width, and angle between the orientations in degrees.
"""

from dashpot.calibrate.tosses.cube import BODY, Cube
from dashpot.calibrate.tosses.flight import Toss, flight_state, trajectory, velocity_per_offset
from dashpot.calibrate.tosses.problems import (
    POSITION_SIGMA,
    ROTATION_SIGMA,
    body_problem,
    dashpot_problem,
    mujoco_problem,
)
from dashpot.calibrate.tosses.study import Errors, Study, evaluate, study

__all__ = [
    "BODY",
    "POSITION_SIGMA",
    "ROTATION_SIGMA",
    "Cube",
    "Errors",
    "Study",
    "Toss",
    "body_problem",
    "dashpot_problem",
    "evaluate",
    "flight_state",
    "mujoco_problem",
    "study",
    "trajectory",
    "velocity_per_offset",
]
