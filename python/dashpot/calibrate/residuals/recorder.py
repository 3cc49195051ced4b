"""What the recorders of one trajectory read of simulations, and how far that is off.

Simulations are read at the frames where these are all that matters. A channel with a clock, a delay
or an impulse of its own needs every step (`dashpot.calibrate.residuals.clocks`).

For a channel that reads r where s was observed with a standard deviation sigma, the residual is

    (r - s) / sigma                     of a number
    log(R_s^T R_r) / sigma              of an orientation: a rotation vector, |.| <= pi

and 0 of what was not measured.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot import _core
from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.data.trajectory_fields import frozen
from dashpot.calibrate.data.views import View
from dashpot.calibrate.problem.channels import POSES, Channel
from dashpot.calibrate.problem.gaps import gap_geoms
from dashpot.calibrate.problem.observables import body_id, observable_sensors
from dashpot.calibrate.problem.own_residuals import ResidualError, SimulatedRecording
from dashpot.calibrate.problem.pixels import bodies_of, pixels
from dashpot.calibrate.problem.problem import Problem
from dashpot.calibrate.problem.sensing import Sensing
from dashpot.calibrate.residuals.clocks import at_times, instants_of, means_over
from dashpot.calibrate.residuals.events import apex_heights, impact_times, in_order, peak
from dashpot.calibrate.residuals.poses import pose_errors, same_side

Array = NDArray[np.float64]

_PEAK = "peak:"


class Recorder:
    """The recorders of a trajectory of a problem, within its window."""

    def __init__(self, problem: Problem, trajectory: Trajectory, model: mujoco.MjModel) -> None:
        self.channels = problem.channels(trajectory)
        self._bodies = len(trajectory.bodies)
        substeps = problem.steps_per_frame(trajectory, model)
        self._step = trajectory.spacing / substeps
        frames = trajectory if problem.window is None else trajectory.head(problem.window)
        delays = problem.delays(trajectory)
        # They are of the whole.
        self._own = problem.own if frames is trajectory else {}
        self._trajectory = trajectory
        self._every_step = bool(delays or self._own) or any(
            channel.own_clock
            or channel.kind in ("event", "scalar", "residual")
            or (channel.sensor is not None and channel.sensor.mean != (channel.window > 0.0))
            for channel in self.channels
        )
        frame_step = substeps * frames.frame_number
        record_step = frame_step
        if self._every_step:
            early = max([0.0, *(-lower for lower, _ in delays.values())])
            ends = [float(channel.time.max(initial=0.0)) for channel in self.channels]
            # The slack keeps rounding in the times from adding a step.
            last = math.ceil((max(ends) + early) / self._step - 1e-6)
            record_step = np.arange(max(last, int(frame_step[-1])) + 1)
        control: Array = np.empty((0, 0))
        if frames.control is not None:
            control = np.repeat(frames.control, np.diff(frame_step), axis=0)
            beyond = int(record_step[-1]) - len(control)
            control = np.concatenate([control, np.repeat(control[-1:], beyond, axis=0)])
        self._columns: dict[str, slice] = {}
        numbers: list[tuple[int, bool]] = []
        self._held: set[str] = set()
        names = [name for name in trajectory.sensors if name not in trajectory.views]
        read = [problem.sensor(name) for name in (*names, *_peaks(self.channels))]
        if self._own:
            read += observable_sensors(model)
        for sensor in {sensor.name: sensor for sensor in read}.values():
            name = sensor.name
            self._held |= {name} if sensor.mean else set()
            self._columns[name] = slice(len(numbers), len(numbers) + sensor.size)
            numbers += [(sensor.address + i, sensor.mean) for i in range(sensor.size)]
        gaps = [
            gap_geoms(model, trajectory, channel.name)
            for channel in self.channels
            if channel.kind in ("event", "scalar")
        ]
        recorded = [body_id(model, body, trajectory.name) for body in trajectory.bodies]
        for view in trajectory.views.values():
            recorded += bodies_of(view, model)
        #: Bodies whose poses are recorded, those observed first.
        self._recorded = recorded[: self._bodies]
        self._recorded += [b for b in dict.fromkeys(recorded) if b not in self._recorded]
        self._recording: dict[str, Any] = dict(
            name=trajectory.name,
            record_step=record_step.tolist(),
            body=self._recorded,
            channel=numbers,
            gap=next((pairs for pairs in gaps if pairs), []),
            control=control,
            interval=1 if self._every_step else substeps,
        )
        self._as_stated = _core.Recording(timestep=self._step, **self._recording)

    @property
    def numbers(self) -> int:
        """How many numbers a simulation records."""
        rows, columns = self._as_stated.shape
        return int(rows) * int(columns)

    def recording(self, pace: float) -> _core.Recording:
        """Return what is read of a motion whose frames are `pace` times as far apart as stated."""
        if pace == 1.0:
            return self._as_stated
        return _core.Recording(timestep=pace * self._step, **self._recording)

    def readings(
        self, recorded: Array, sensing: Sensing, pace: Array
    ) -> tuple[list[Array], dict[int, str]]:
        """Return by channel what it reads (items, rows, columns) of recorded items (items, n).

        Their frames are `pace` (items,) times as far apart as stated: times of the steps, frames
        with them, are here counted as if they were not.
        Then follow items of which functions of the user's own find no residuals, and why; they are
        NaN.
        """
        rows, columns = self._as_stated.shape
        table = recorded.reshape(len(recorded), rows, columns)
        poses = table[..., : 7 * self._bodies]
        others = table[..., 7 * len(self._recorded) :]
        found: dict[str, Array] = {}
        for channel in self.channels:
            view = None if channel.sensor is None else channel.sensor.view
            delay = sensing.of("delay", channel.name)
            if delay is None and view is not None:
                delay = sensing.of("delay", view.camera)
            late = np.zeros((1, 1)) if delay is None else delay[:, None]
            times = channel.time if channel.with_frames else channel.time / pace[:, None]
            times = times - late / pace[:, None]
            times = np.broadcast_to(times, (len(table), channel.time.size))
            if channel.kind == "residual":
                continue
            if channel.kind == "poses":
                reading = self._poses(poses, times, sensing)
            elif view is not None:
                reading = pixels(view, self._poses_of(view, table, times, sensing), sensing)
            elif channel.kind == "sensor":
                reading = self._sensor(channel, others[..., self._columns[channel.name]], times)
            elif channel.kind == "event":
                end = (rows - 1) * self._step
                happened = [
                    in_order(impact_times(gap, self._step), channel.time.size, end)
                    for gap in table[..., -1]
                ]
                reading = (np.array(happened) * pace[:, None] + late)[..., None]
            else:
                reading = self._scalar(channel, table)
            found[channel.name] = sensing.through(reading, channel.name)
        refused = self._add_own(found, table, pace)
        return [found[channel.name] for channel in self.channels], refused

    def _add_own(self, found: dict[str, Array], table: Array, pace: Array) -> dict[int, str]:
        """Add what functions of the user's own return, and say where they refuse."""
        refused: dict[int, str] = {}
        own = [channel for channel in self.channels if channel.kind == "residual"]
        for channel in own:
            found[channel.name] = np.full((len(table), *channel.observed.shape), np.nan)
        for item in range(len(table) if own else 0):
            read = {name: readings[item] for name, readings in found.items()}
            simulated = self.simulated(table[item], read, float(pace[item]))
            try:
                for channel in own:
                    residuals = self._own[channel.name](simulated, self._trajectory)
                    found[channel.name][item, :, 0] = residuals
            except ResidualError as error:
                refused[item] = str(error)
        return refused

    def simulated(
        self, table: Array, readings: Mapping[str, Array], pace: float
    ) -> SimulatedRecording:
        """Return what was simulated (rows, columns), and read, as functions get it.

        Frames are `pace` times as far apart as stated.
        """
        start = self._trajectory.time[0]
        poses = table[:, : 7 * self._bodies].reshape(len(table), -1, 7)
        sensors = {}
        for name, columns in self._columns.items():
            sensors[name] = table[:, 7 * len(self._recorded) :][:, columns].copy()
            if name in self._held:
                sensors[name][0] = np.nan
        read = [channel for channel in self.channels if channel.kind != "residual"]
        bodies = self._trajectory.bodies
        return SimulatedRecording(
            time=frozen(start + pace * self._step * np.arange(len(table))),
            position={body: frozen(poses[:, i, :3]) for i, body in enumerate(bodies)},
            quaternion={body: frozen(poses[:, i, 3:]) for i, body in enumerate(bodies)},
            sensors={name: frozen(values) for name, values in sensors.items()},
            times={c.name: frozen(start + (pace if c.with_frames else 1.0) * c.time) for c in read},
            readings={channel.name: frozen(readings[channel.name]) for channel in read},
        )

    def residuals(self, readings: list[Array]) -> Array:
        """Return (items, n) weighted residuals of `readings`, channel by channel."""
        parts = [
            self._errors(channel, reading).reshape(len(reading), -1)
            for channel, reading in zip(self.channels, readings, strict=True)
        ]
        return np.concatenate(parts, axis=1)

    def spread(self) -> Array:
        """Return (n,) how far observed numbers are off their mean, in sigmas, as residuals are."""
        still = [np.zeros((1, *channel.observed.shape)) for channel in self.channels]
        for channel, first in zip(self.channels, still, strict=True):
            if channel.kind == "poses":
                first[:] = channel.observed[0]
        parts = []
        for channel, first in zip(self.channels, still, strict=True):
            off = self._errors(channel, first)[0]
            seen = channel.measured.sum(axis=0)
            parts.append((off - np.sum(off, axis=0) / np.maximum(seen, 1)) * channel.measured)
        return np.concatenate([part.reshape(-1) for part in parts])

    def _errors(self, channel: Channel, reading: Array) -> Array:
        """Return (items, rows, columns) weighted residuals of a channel."""
        if channel.kind == "poses":
            error = pose_errors(reading, channel.observed, self._bodies)
        else:
            error = channel.off(reading)
        return np.asarray(error / channel.sigma * channel.measured)

    def _poses(self, poses: Array, times: Array, sensing: Sensing) -> Array:
        poses = self._at(poses, times)
        scale = sensing.of("scale", POSES)
        if scale is not None:
            poses = poses.copy()
            position = poses.reshape(*poses.shape[:2], -1, 7)[..., :3]
            position += (scale[:, None, None, None] - 1.0) * (position - sensing.centre)
        return poses

    def _poses_of(
        self, view: View, table: Array, times: Array, sensing: Sensing
    ) -> dict[int, Array]:
        """Return the poses (items, rows, 7) at `times` of the bodies that a view needs."""
        found = {}
        for body in bodies_of(view, sensing.models[0]):
            first = 7 * self._recorded.index(body)
            found[body] = self._at(table[..., first : first + 7], times)
        return found

    def _at(self, poses: Array, times: Array) -> Array:
        if not self._every_step:
            return poses
        poses = at_times(same_side(poses), times, self._step)
        turned = poses.reshape(*poses.shape[:2], -1, 7)
        turned[..., 3:] /= np.linalg.norm(turned[..., 3:], axis=-1, keepdims=True)
        return poses

    def _sensor(self, channel: Channel, numbers: Array, times: Array) -> Array:
        if not self._every_step:
            return numbers
        if channel.sensor is None or not channel.sensor.mean:
            if channel.window:
                # The mean of what lies on lines between steps.
                middle = 0.5 * (numbers[:, 1:] + numbers[:, :-1])
                numbers = np.concatenate([middle[:, :1], middle], axis=1)
                return means_over(numbers, times, channel.window, self._step)
            return at_times(numbers, times, self._step)
        if channel.window:
            return means_over(numbers, times, channel.window, self._step)
        return instants_of(numbers, times, self._step)

    def _scalar(self, channel: Channel, table: Array) -> Array:
        count = channel.time.size
        found = []
        for item in table:
            if channel.name.startswith(_PEAK):
                column = 7 * len(self._recorded) + self._columns[channel.name[len(_PEAK) :]].start
                found.append(np.full(count, peak(item[1:, column])))
            else:
                height = item[:, 2]
                impacts = impact_times(item[:, -1], self._step)
                heights = apex_heights(height, impacts, self._step)
                found.append(in_order(heights, count, float(height[-1])))
        return np.array(found)[..., None]


def _peaks(channels: list[Channel]) -> list[str]:
    """Return the sensors of which peaks are observed."""
    scalars = [channel.name for channel in channels if channel.kind == "scalar"]
    return [name[len(_PEAK) :] for name in scalars if name.startswith(_PEAK)]
