"""Calibration of contact parameters against reference trajectories.

State what moves, what is unknown and what was observed in a `Problem`; `fit` estimates, gives
intervals, and says for each parameter whether the data identify it. Observed are poses of bodies,
sensors of the model: encoders, accelerometers, force plates (`Trajectory.of_sensors`), or points in
pixels that a camera saw.

Five throws of a ball, with time (s), position (m) and quaternion (scalar first) of every frame, of
which four are fitted and one is predicted::

    from dashpot.calibrate import Parameter, Problem, Trajectory, fit

    throws = [
        Trajectory(f"throw {i}", time, position, quaternion, bodies=("ball",))
        for i, (time, position, quaternion) in enumerate(recordings)
    ]
    unknown = [
        Parameter.pair("ball", "floor", "stiffness", start=1e4, bounds=(1e2, 1e6)),
        Parameter.pair("ball", "floor", "restitution", start=0.5, bounds=(0.01, 0.99)),
        Parameter.pair("ball", "floor", "sliding_friction", start=0.3, bounds=(0.01, 2.0)),
    ]
    problem = Problem(engine, unknown, throws[:4], position_sigma=2e-4, rotation_sigma=2e-3,
                      initial_state="pose_and_velocity")
    result = fit(problem)
    print(result, result.values, result.noise_explains)

    # The first 0.1 s of the fifth tell how it started; what follows is predicted.
    (prediction,) = result.predict(throws[4:], head=0.1)
    print(prediction.position_error, prediction.rotation_error)
"""

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.data.views import ImagePlane
from dashpot.calibrate.fit import fit
from dashpot.calibrate.flights import with_flights
from dashpot.calibrate.inference.combinations import Combination
from dashpot.calibrate.inference.estimate import Estimate
from dashpot.calibrate.inference.explanation import Explanation
from dashpot.calibrate.prediction import Prediction, predict
from dashpot.calibrate.problem.own_residuals import SimulatedRecording
from dashpot.calibrate.problem.parameters import Parameter
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.result import Fit

__all__ = [
    "Combination",
    "Estimate",
    "Explanation",
    "Fit",
    "ImagePlane",
    "Parameter",
    "Prediction",
    "Problem",
    "SimulatedRecording",
    "Trajectory",
    "fit",
    "predict",
    "with_flights",
]
