"""Calibration of contact parameters against reference trajectories.

State what moves, what is unknown and what was observed in a `Problem`; `fit` estimates, gives
intervals, and says for each parameter whether the data identify it.
"""

from dashpot.calibrate.fit import fit
from dashpot.calibrate.identifiability import Estimate
from dashpot.calibrate.parameters import Parameter
from dashpot.calibrate.problem import Problem
from dashpot.calibrate.result import Fit
from dashpot.calibrate.trajectory import Trajectory

__all__ = ["Estimate", "Fit", "Parameter", "Problem", "Trajectory", "fit"]
