"""Residuals and Jacobian of a problem in search coordinates, by parallel simulation.

A point of the search is the vector of the parameters' search coordinates, followed, where initial
states are estimated, by one block per trajectory: velocity (nv) and, if wanted, displacement of
the initial position (nv, a tangent vector as ``mj_integratePos`` takes it). Where parameters are
held at given values, points have these blocks alone. What of a block is known beforehand adds
residuals of its own to those of the trajectory, or is held
(`dashpot.calibrate.problem.known_starts`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.known_starts import KnownStarts
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.setters import System, model_of
from dashpot.calibrate.residuals.arrow import ArrowMatrix
from dashpot.calibrate.residuals.candidates import Candidate, SimulationError, failure_of
from dashpot.calibrate.residuals.checkpoint import Checkpoint
from dashpot.calibrate.residuals.differences import derivatives_along
from dashpot.calibrate.residuals.first_counts import with_counts
from dashpot.calibrate.residuals.idle_states import (
    without_idle_parameters,
    without_idle_states,
)
from dashpot.calibrate.residuals.readings import readings_of
from dashpot.calibrate.residuals.recorder import Recorder
from dashpot.calibrate.residuals.workers import Workers

Array = NDArray[np.float64]

# Half-widths of the finite differences of initial states: m/s and rad/s, m and rad. Large against
# rounding, small against the measurement noise of any pose tracker.
_VELOCITY_DIFFERENCE = 1e-5
_POSE_DIFFERENCE = 1e-6
# The same of how fast a trajectory runs: 3 um of what goes at 3 m/s for a second.
_CLOCK_DIFFERENCE = 1e-6
# Residuals of a channel that carries noise reach this many standard deviations; of one that does
# not, a rounding.
_LIVE = 1e-6


class Objective:
    """Weighted residuals as a function of points, many points in one parallel batch."""

    def __init__(
        self,
        problem: Problem,
        *,
        nthread: int = 0,
        held: Mapping[str, float] | None = None,
        workers: Workers | None = None,
        checkpoint: Checkpoint | None = None,
    ) -> None:
        self.nthread = nthread
        self._workers, self._checkpoint = workers, checkpoint
        #: Values of the parameters where points do not hold them.
        self.held = held
        #: Parameters that points hold.
        self.unknown = problem.unknowns if held is None else ()
        self.coordinates = [p.coordinate for p in self.unknown]
        self.evaluations = 0
        self._systems: dict[tuple[bytes, bytes], System] = {}
        model = model_of(problem.build(problem.start if held is None else held))
        self._model = model
        self._qpos, self._qvel = problem.initial_states(model, held)
        values = problem.start if held is None else held
        problem = with_counts(problem, model, values, self._qpos, self._qvel, nthread)
        self.problem = problem
        #: Of each trajectory.
        self.recorders = [Recorder(problem, t, model) for t in problem.trajectories]
        self._acting = [np.array(problem.acting(t), dtype=bool) for t in problem.trajectories]
        #: Of each trajectory.
        self.layouts = problem.layouts()
        #: Row ranges of the trajectories in the residuals: trajectory t has rows [t] to [t + 1].
        self.offsets = np.concatenate([[0], np.cumsum([layout.size for layout in self.layouts])])
        self._measured = np.concatenate(problem.measured())
        sigma = problem.start_sigma
        per_part = {"given": 0, "velocity": 1, "pose_and_velocity": 2}
        #: Of the unknowns of an initial state, how many are velocities and displacements.
        self._state_size = per_part[problem.initial_state] * int(model.nv)
        rest = np.zeros(sigma.shape)  # displacements and clocks
        rest[:, : min(self._state_size, model.nv)] = self._qvel[:, : self._state_size]
        self._known = KnownStarts(sigma, rest)
        #: Which residuals are of the motion, not of its start.
        self.moving = np.concatenate(
            [np.arange(layout.size) < layout.size - layout.starts for layout in self.layouts]
        )

    @property
    def parameters(self) -> int:
        """Number of parameters that points hold."""
        return len(self.coordinates)

    @property
    def initial_size(self) -> int:
        """Number of unknowns of the initial state of one trajectory."""
        return int(self._known.sigma.shape[1])

    @property
    def size(self) -> int:
        """Length of a point."""
        return self.parameters + self.initial_size * len(self.recorders)

    @property
    def unknowns(self) -> int:
        """How many numbers of a point are not held."""
        return self.size - int(np.count_nonzero(self._known.held))

    @property
    def free_states(self) -> NDArray[np.intp]:
        """Which unknowns of an initial state some trajectory does not hold."""
        return np.flatnonzero(~self._known.held.all(axis=0))

    @property
    def residual_count(self) -> int:
        """Number of residuals."""
        return int(self.offsets[-1])

    @property
    def measured_count(self) -> int:
        """Number of residuals of what was measured."""
        return int(np.count_nonzero(self._measured))

    def live(self, residuals: Array) -> NDArray[np.bool_]:
        """Return (residual_count,) whether each residual carries noise.

        A channel (trajectory, body or sensor, component) whose residuals all stay below a
        millionth of a standard deviation was not measured, or neither moved nor had noise: the
        rotation of a pendulum about the other axes, say. It is no evidence of how large noise is.
        Where all channels are so, as of data without noise, all that were measured count.

        Parameters
        ----------
        residuals
            (residual_count,) at the estimate.
        """
        live = np.empty(self.residual_count, dtype=bool)
        for t, layout in enumerate(self.layouts):
            rows = slice(self.offsets[t], self.offsets[t + 1])
            live[rows] = layout.in_live_channels(residuals[rows], _LIVE)
        live &= self._measured
        return live if live.any() else self._measured

    def by_channel(self, residuals: Array) -> list[dict[str, Array]]:
        """Return by trajectory and channel (rows, columns) of residuals (residual_count,)."""
        return [
            {
                block.name: part
                for block, part in zip(
                    layout.blocks,
                    layout.split(residuals[self.offsets[t] : self.offsets[t + 1]]),
                    strict=True,
                )
            }
            for t, layout in enumerate(self.layouts)
        ]

    def start(self, *, robust: bool = False) -> Array:
        """Return the point where the search starts; with `robust`, outliers do not lead it astray.

        Velocities are then from `Problem.robust_guesses`, and displacements, which else are 0.
        """
        point = np.zeros(self.size)
        for i, parameter in enumerate(self.unknown):
            point[i] = self.coordinates[i].to_search(parameter.start)
        if self._state_size:
            blocks = point[self.parameters :].reshape(len(self.recorders), self.initial_size)
            nv = int(self._model.nv)
            blocks[:, :nv] = self._qvel
            if robust:
                velocity, displacement = self.problem.robust_guesses(self._model, self._qvel)
                blocks[:, :nv] = velocity
                blocks[:, nv : self._state_size] = displacement[:, : self._state_size - nv]
        return point

    def bounds(self) -> tuple[Array, Array]:
        """Return lower and upper bounds of points, infinite where there are none."""
        lower = np.full(self.size, -np.inf)
        upper = np.full(self.size, np.inf)
        for i, coordinate in enumerate(self.coordinates):
            lower[i], upper[i] = coordinate.search_bounds
        return lower, upper

    def values(self, point: Array) -> dict[str, float]:
        """Return the parameters' values at a point, frozen ones included, by name."""
        if self.held is not None:
            return {**self.problem.held, **self.held}
        found = {
            parameter.name: coordinate.to_value(float(z))
            for parameter, coordinate, z in zip(self.unknown, self.coordinates, point, strict=False)
        }
        return {**found, **self.problem.held}

    def residuals(self, points: Array) -> Array:
        """Return the weighted residuals (points, residual_count) of `points` (points, size).

        Raises
        ------
        SimulationError
            For the first point that cannot be built or simulated, naming what was refused, or the
            trajectory and step that fail, and the values of the parameters.
        """
        residuals, failures = self.attempt(points)
        if failures:
            raise failures[0]
        return residuals

    def attempt(self, points: Array) -> tuple[Array, list[SimulationError]]:
        """Return the residuals of `points`, infinite where one fails, and why those fail."""
        points = np.atleast_2d(points)
        self.evaluations += len(points)
        known = None if self._checkpoint is None else self._checkpoint.find(self, points)
        if known is not None:
            residuals, failures = known
        else:
            work = self.simulate if self._workers is None else self._simulate_elsewhere
            residuals, failures = work(points)
            if self._checkpoint is not None:
                self._checkpoint.add(self, points, residuals, failures)
        return residuals, [failures[v] for v in sorted(failures)]

    def simulate(self, points: Array) -> tuple[Array, dict[int, SimulationError]]:
        """Return the residuals of `points`, infinite where one fails, and why, by row.

        Here, on threads, and whether they are known or not.
        """
        residuals = np.full((len(points), self.residual_count), np.inf)
        candidates, failures = self._candidates(points)
        rows = list(candidates)
        if rows:
            starts = self._known.residuals(self._states(points[rows]))
            residuals[np.ix_(np.array(rows), np.flatnonzero(~self.moving))] = starts
        for t, users, readings in readings_of(
            self.problem, self.recorders, candidates, failures, self.nthread
        ):
            rows_of_t = slice(self.offsets[t], self.offsets[t + 1] - self.layouts[t].starts)
            residuals[users, rows_of_t] = self.recorders[t].residuals(readings)
        residuals = np.where(self._measured, residuals, 0.0)
        for v in np.flatnonzero(np.isnan(residuals).any(axis=1)):
            name = self._unseen(residuals[v])
            failures[int(v)] = failure_of(candidates[int(v)].values, name)
        failed = list(failures)
        residuals[failed] = np.inf
        return residuals, failures

    def _unseen(self, residuals: Array) -> str:
        """Return what of one point cannot be seen where its residuals are NaN."""
        for trajectory, channels in zip(
            self.problem.trajectories, self.by_channel(residuals), strict=True
        ):
            for name, rows in channels.items():
                if np.isnan(rows).any():
                    behind = "; it is behind the camera" if name in trajectory.views else ""
                    return f"trajectory '{trajectory.name}': {name!r} reads nan{behind}"
        return "residuals are nan"

    def _simulate_elsewhere(self, points: Array) -> tuple[Array, dict[int, SimulationError]]:
        assert self._workers is not None
        return self._workers.attempt(self, points)

    def of(self, problem: Problem, *, kept: bool = True) -> Objective:
        """Return the objective of another problem, simulated in the same way; `kept` in a file."""
        return Objective(
            problem,
            nthread=self.nthread,
            held=self.held,
            workers=self._workers,
            checkpoint=self._checkpoint if kept else None,
        )

    def points_of(self, points: Array, first: int, last: int) -> Array:
        """Return points (n, size) of some of the trajectories, `first` to `last`, alone."""
        begin, end = (self.parameters + self.initial_size * t for t in (first, last))
        return np.concatenate([points[:, : self.parameters], points[:, begin:end]], axis=1)

    @property
    def fingerprint(self) -> bytes:
        """What tells it from objectives of other windows, noise and frozen values."""
        problem = self.problem
        stated = (problem.window, problem.names, problem.held)
        digest = hashlib.sha256(repr(stated).encode())
        for known in (self._known.sigma, self._known.given):
            digest.update(np.ascontiguousarray(known).tobytes())
        for recorder in self.recorders:
            for channel in recorder.channels:
                digest.update(repr((channel.name, channel.window)).encode())
                for array in (channel.time, channel.observed, channel.sigma, channel.measured):
                    digest.update(np.ascontiguousarray(array).tobytes())
        return digest.digest()

    def jacobian(
        self, point: Array, *, widths: Array | None = None, base: Array | None = None
    ) -> ArrowMatrix:
        """Return the Jacobian (residual_count, size) by finite differences in one batch.

        Perturbing one component of all trajectories' initial states takes one variant, since a
        trajectory's residuals depend on its own initial state only. Differences of parameters are
        central, at a bound one-sided.

        Parameters
        ----------
        point
            (size,).
        widths
            (parameters,) half-widths of the differences; None: the parameters' own.
        base
            (residual_count,) residuals at `point`, where known: differences of initial states are
            then forward and need half the simulations.

        Differences are one-sided too where the simulation of the other side fails, and narrower
        where those of both do. Initial states that move nothing have columns of 0.

        Raises
        ------
        SimulationError
            Where that fails as well.
        """
        count = self.parameters
        if widths is None:
            widths = np.array([p.difference for p in self.unknown])
        lower, upper = self.bounds()
        free = self.free_states
        steps = np.zeros((count + free.size, self.size))
        steps[np.arange(count), np.arange(count)] = widths
        initial_steps = self._initial_differences()
        for row, j in enumerate(free, start=count):
            columns = count + j + self.initial_size * np.arange(len(self.recorders))
            steps[row, columns] = initial_steps[j]
        up, down = (np.clip(point + sign * steps, lower, upper) for sign in (1.0, -1.0))
        derivatives = derivatives_along(
            self.attempt, point, up, down if base is None else down[:count], base
        )
        own = np.zeros((self.residual_count, self.initial_size))
        own[:, free] = derivatives[count:].T
        shared = np.ascontiguousarray(derivatives[:count].T)
        jacobian = ArrowMatrix(shared, own, self.offsets)
        jacobian = without_idle_parameters(jacobian, (upper - lower)[:count])
        return without_idle_states(jacobian, self.attempt, point, base, self.differences())

    def differences(self) -> Array:
        """Return the half-widths (size,) of the differences that derivatives take by default."""
        own = np.array([p.difference for p in self.unknown])
        return np.concatenate([own, np.tile(self._initial_differences(), len(self.recorders))])

    def observe(self, point: Array) -> list[dict[str, Array]]:
        """Return by trajectory and channel what its recorder reads (rows, columns).

        Of poses, ``"poses"``, that is (frames, 7 bodies): position and quaternion. What was not
        simulated is NaN: means over what comes before the start.

        Raises
        ------
        SimulationError
            As `residuals` does.
        """
        candidates, failures = self._candidates(np.atleast_2d(point))
        found: list[dict[str, Array]] = [{} for _ in self.recorders]
        for t, _, readings in readings_of(
            self.problem, self.recorders, candidates, failures, self.nthread
        ):
            for channel, reading in zip(self.recorders[t].channels, readings, strict=True):
                early = channel.time < 0.5 * channel.window
                found[t][channel.name] = np.where(early[:, None], np.nan, reading[0])
        if failures:
            raise failures[0]
        return found

    def initial_states(self, point: Array) -> tuple[Array, Array]:
        """Return qpos (trajectories, nq) and qvel (trajectories, nv) of the starts at a point."""
        candidates, failures = self._candidates(np.atleast_2d(point))
        if failures:
            raise failures[0]
        return candidates[0].qpos, candidates[0].qvel

    def as_from(self, other: Objective, point: Array) -> Array:
        """Return a point of another objective, its displacements from where this one starts."""
        nv, result = int(self._model.nv), point.copy()
        if self._state_size == 2 * nv and not np.array_equal(self._qpos, other._qpos):
            blocks = result[other.parameters :].reshape(len(self.recorders), -1)
            placed, _ = other.initial_states(point)
            for block, start, qpos in zip(blocks, self._qpos, placed, strict=True):
                mujoco.mj_differentiatePos(self._model, block[nv : 2 * nv], 1.0, start, qpos)
        return result

    def initial_estimates(self, point: Array) -> tuple[Array | None, Array | None]:
        """Return estimated initial velocity and displacement (trajectories, nv), None if given."""
        if not self._state_size:
            return None, None
        nv = int(self._model.nv)
        blocks = self._states(point)[:, : self._state_size]
        displacement = blocks[:, nv:].copy() if self._state_size > nv else None
        return blocks[:, :nv].copy(), displacement

    def frame_pace(self, point: Array) -> Array | None:
        """Return how many times as far apart as stated frames are (trajectories,); None: known."""
        if self.initial_size == self._state_size:
            return None
        return np.asarray(1.0 + self._states(point)[:, -1])

    def _states(self, points: Array) -> Array:
        """Return the initial states (..., trajectories, s) of points."""
        own = points[..., self.parameters :]
        shape = (*points.shape[:-1], len(self.recorders), self.initial_size)
        return self._known.with_held(own.reshape(shape))

    def _initial_differences(self) -> Array:
        nv = int(self._model.nv)
        steps = ([_VELOCITY_DIFFERENCE] * nv + [_POSE_DIFFERENCE] * nv)[: self._state_size]
        return np.array(steps + [_CLOCK_DIFFERENCE] * (self.initial_size - len(steps)))

    def _candidates(self, points: Array) -> tuple[dict[int, Candidate], dict[int, SimulationError]]:
        """Build the systems and initial states of points; say why where that fails.

        There is one system for each different set of the parameters that act in a trajectory.
        """
        systems: dict[tuple[bytes, bytes], System] = {}
        candidates, failures = {}, {}
        nv = int(self._model.nv)
        for v, point in enumerate(points):
            values = self.values(point)
            qpos, qvel = self._qpos, self._qvel
            try:
                of_trajectories = [
                    self._system(point, values, t, systems) for t in range(len(self.recorders))
                ]
                if self.problem.start_states is not None:
                    qpos, qvel = self.problem.initial_states(self._model, values)
            except ValueError as error:
                failures[v] = failure_of(values, error)
                continue
            blocks = self._states(point)
            pace = 1.0 + blocks[:, self._state_size :].sum(axis=1)
            if self._state_size:
                qvel = blocks[:, :nv]
            if self._state_size > nv:
                qpos = qpos.copy()
                for t, block in enumerate(blocks[:, nv : self._state_size]):
                    mujoco.mj_integratePos(self._model, qpos[t], block, 1.0)
            if not (pace > 0.0).all():
                failures[v] = failure_of(values, "frames would follow each other backwards")
                continue
            candidates[v] = Candidate(values, of_trajectories, qpos, qvel, pace)
        self._systems = systems  # keeps models alive during the batch and for the next one
        return candidates, failures

    def _system(
        self,
        point: Array,
        values: Mapping[str, float],
        t: int,
        systems: dict[tuple[bytes, bytes], System],
    ) -> System:
        """Return the system of a trajectory at a point, one of `systems` where it is the same."""
        acting = self._acting[t]
        chosen = point[: self.parameters][acting] if self.held is None else point[:0]
        key = (acting.tobytes(), chosen.tobytes())
        if key not in systems:
            known = self._systems.get(key)
            name = self.problem.trajectories[t].name
            systems[key] = self.problem.build(values, name) if known is None else known
        return systems[key]
