"""Calibration on real tosses: cubes (ContactNets), dashpot and MuJoCo tuned the same way.

`study` is of the cubes; `fit_and_predict` of any body, with hinges too.

A toss is simulated from its first frame, with a start state fitted to its flight before the first
contact. Prediction errors are time means over all later frames, and over those from the first
contact on. They are the distance between the centres in percent of the cube's width, and the angle
between the orientations in degrees. Lengths are scaled to agree with gravity.

Body properties come first: the centre of mass shows in the flights, inertia and corner radius are
fitted together with the contact's parameters. Without them the contact alone has to explain errors
that are not its own.
"""

from dashpot.calibrate.tosses.cube import BODY, Cube
from dashpot.calibrate.tosses.errors import Errors, errors_of, evaluate
from dashpot.calibrate.tosses.flight import (
    LENGTH_SCALE,
    Flight,
    Toss,
    centre_of_mass,
    fit_flight,
    trajectory,
)
from dashpot.calibrate.tosses.problems import (
    POSITION_SIGMA,
    ROTATION_SIGMA,
    toss_problem,
    weighed,
)
from dashpot.calibrate.tosses.study import Study, fit_and_predict, split, study

__all__ = [
    "BODY",
    "LENGTH_SCALE",
    "POSITION_SIGMA",
    "ROTATION_SIGMA",
    "Cube",
    "Errors",
    "Flight",
    "Study",
    "Toss",
    "centre_of_mass",
    "errors_of",
    "evaluate",
    "fit_and_predict",
    "fit_flight",
    "split",
    "study",
    "toss_problem",
    "trajectory",
    "weighed",
]
