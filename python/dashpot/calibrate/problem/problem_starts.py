"""Where the simulations of a problem start, and how they step."""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.first_guess import initial_state, robust_guess
from dashpot.calibrate.problem.joint_guess import guess_joints
from dashpot.calibrate.problem.pixel_starts import start_as_seen
from dashpot.calibrate.problem.problem_channels import ProblemChannels
from dashpot.calibrate.problem.problem_entries import checked_states
from dashpot.calibrate.problem.sensing import sensing
from dashpot.calibrate.problem.vectors import vectors_of

Array = NDArray[np.float64]


class ProblemStarts(ProblemChannels):
    """The methods of `Problem` that tell where simulations start."""

    def initial_states(
        self, model: mujoco.MjModel, values: Mapping[str, float] | None = None
    ) -> tuple[Array, Array]:
        """Return initial qpos (trajectories, nq) and qvel (trajectories, nv) of `values`.

        Raises
        ------
        ValueError
            If `start_states` returns arrays of another shape or numbers that are not finite.
        """
        count = len(self.trajectories)
        if self.start_states is not None:
            known = {**self.start, **({} if values is None else values)}
            starts = self.start_states(known | vectors_of(self.parameters, known))
            return checked_states(starts, count, model)
        qpos = np.empty((count, model.nq))
        qvel = np.empty((count, model.nv))
        for i, trajectory in enumerate(self.trajectories):
            qpos[i], qvel[i] = initial_state(trajectory, model, np.isfinite(self.sigma))
            setters = self.sensing_setters(trajectory)
            guess_joints(
                trajectory,
                model,
                qpos[i],
                qvel[i],
                positions=not self.starts_at_first_poses(),
                left_out={channel for s in setters.values() for channel in s.channels},
            )
            if trajectory.views and self.initial_state != "given":
                found = sensing(setters, [self.start])
                placed = self.initial_state == "pose_and_velocity"
                start_as_seen(trajectory, model, found, qpos[i], qvel[i], placed=placed)
        return qpos, qvel

    def robust_guesses(self, model: mujoco.MjModel, qvel: Array) -> tuple[Array, Array]:
        """Return velocities and displacements (trajectories, nv) to start an estimation with.

        Outliers in the first frames do not lead them astray, as they do those of
        `initial_states`, of which `qvel` (trajectories, nv) are the velocities.
        """
        guesses = [
            robust_guess(
                t if self.window is None else t.head(self.window), model, self.sigma, given
            )
            for t, given in zip(self.trajectories, qvel, strict=True)
        ]
        velocity, displacement = zip(*guesses, strict=True)
        return np.array(velocity), np.array(displacement)

    def starts_at_first_poses(self) -> bool:
        """Whether simulations without ``initial_qpos`` start at their first observed pose."""
        return self.initial_state != "pose_and_velocity" and self.start_states is None

    def steps_per_frame(self, trajectory: Trajectory, model: mujoco.MjModel) -> int:
        """Return the number of simulation steps between two frames."""
        if self.substeps is not None:
            return int(self.substeps)
        # The slack keeps rounding in the times from adding a step.
        return max(1, math.ceil(trajectory.spacing / float(model.opt.timestep) - 1e-6))
