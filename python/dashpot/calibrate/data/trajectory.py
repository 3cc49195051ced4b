"""Reference trajectories: observed poses of bodies, checked."""

from __future__ import annotations

import copy
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot.calibrate.data.csv_file import Table, read_runs
from dashpot.calibrate.data.noise import initial_deviations
from dashpot.calibrate.data.recorder_fields import (
    Sampling,
    numbers_field,
    sampling_field,
    sensor_fields,
)
from dashpot.calibrate.data.stamps import Frames, frame_times
from dashpot.calibrate.data.trajectory_fields import finite_field, frozen, poses_field
from dashpot.checks import number

Array = NDArray[np.float64]
QuaternionOrder = Literal["wxyz", "xyzw"]

# A quaternion counts as unit when its norm is this close to 1; data written with five digits pass.
UNIT_TOLERANCE = 1e-4


@dataclass(frozen=True, eq=False, init=False)
class Trajectory:
    """Observed poses of bodies, and readings of sensors, at times of an even grid.

    Frames of it may be lost.

    Arrays are copied, so the caller's data stay as they are and later edits do not reach in. They
    hold integers or floats; text, times with a date, complex numbers and True are refused. Where
    NaN stands for what was not measured, so do the masked entries of ``numpy.ma`` and None.

    Parameters
    ----------
    name
        Names the trajectory in every message.
    time
        (n,) times in s, strictly increasing, n >= 2, and evenly spaced: at most 15 % of a spacing
        off the even grid that fits them best, so that those rounded to milliseconds pass to 240 Hz.
        The frames count as being on that grid. Lost frames may be left out, more than half of them
        too: intervals of several spacings are gaps, through which the simulation goes on. Where
        stamps jitter further see `frames`.
    position
        (n, bodies, 3) or, for one body, (n, 3): origin of the body frame in the world, m. NaN: not
        measured in that frame.
    quaternion
        (n, bodies, 4) or (n, 4): orientation body to world, scalar first, unit. Stored normalised.
        Four NaN: not measured in that frame. None: not measured at all.
    bodies
        Names of the observed bodies in the order of the arrays.
    initial_qpos
        (nq,) full position of the model at ``time[0]``, its quaternions unit. None: observed bodies
        with a free joint start at their first observed pose and every other joint at the model's
        ``qpos0``. That pose is as noisy as the others: where it is measured, estimate the start
        with ``Problem(initial_state="pose_and_velocity")``. What is estimated starts from what is
        given, else joints start from the first readings of their ``jointpos`` sensors.
    initial_qvel
        (nv,) full velocity of the model at ``time[0]`` (free joints: linear in the world, angular
        in the body frame). None is allowed where the problem estimates it; the search then starts
        from the first five frames (with a robust loss from as many as fly freely, outliers aside).
    initial_qpos_sigma, initial_qvel_sigma
        (nv,), or one number for all degrees of freedom: how well `initial_qpos` and `initial_qvel`
        are known, as standard deviations, m, rad, m/s and rad/s (rotations of free joints about the
        axes of the body). 0: exactly, so that the degree of freedom stays as it is given; inf: not
        at all, and the given is where the search starts. What lies between counts as a reading of
        it beside those of the motion. None: not at all. They act where the problem estimates the
        start, else it counts as known. Hold with 0 what nothing observes, as a body at rest in a
        place that is known: free, it is moved and turned at will to make up for parameters.
    control
        (n - 1, nu) controls held constant between successive frames, through gaps too. None: zero.
    sensors
        Readings of sensors of the model by name, (n, size) or, of one number, (n,), in the unit of
        the sensor: joint encoders (``jointpos``), accelerometers, force plates (``touch``,
        ``force``), positions of markers (``framepos`` of a site, in the frame of a camera, too).
        Angles of hinges may be those within a turn, which jump where it ends: where two that follow
        each other differ by more than half a turn.
        NaN: not measured. `of_sensors` makes trajectories of sensors alone.
    sampling
        By sensor: ``"instant"``: it reads what is at the time of the reading; ``"mean"``: the mean
        over the spacing before, as recorders that integrate do, so that there is none at the first.
        By default sensors of positions and velocities are instant, and those of accelerations and
        forces means.
    sensor_times
        By sensor, (n,) times of its readings, s, on the clock of `time`, for sensors that have a
        rate of their own: a load cell of 1 kHz beside a camera. None: those of the frames.
    events
        Times by kind, ascending, s, on the clock of `time`; NaN: missed. ``"impact"``: the observed
        bodies (all that move, where none is observed) begin to touch something; ``"impact:a,b"``:
        the geoms a and b do.
    scalars
        Numbers by kind, one or several. ``"apex_height"``: greatest heights (m) of the origin of
        the observed body between its impacts, from the first impact on. ``"peak:NAME"``: the
        reading of a sensor of one number that is farthest from 0.
    frames
        What is right. ``"stamped"``: the times. ``"even"``: the frames are even, as a camera takes
        them, and their stamps jitter, as a busy computer gives them. `time` is then that of the
        even grid that fits them best. Frames that were lost are found where the jitter is below a
        fifth of a spacing (standard deviation); where it is larger none may be lost. It is refused
        where the positions or sensors say that the clock itself varies.
    rate
        Frames a second, where they are even and it is known. None: as stamps say, which is known to
        ``sqrt(12 / n**3)`` of their jitter in n frames. Intervals of parameters do not contain
        that: give the rate of a camera where n is below some hundred.
    quaternion_order
        ``"wxyz"``: scalar first; ``"xyzw"``: scalar last.

    Raises
    ------
    ValueError
        Naming the trajectory, the field and the first offending index.
    """

    name: str
    time: Array
    position: Array
    quaternion: Array
    bodies: tuple[str, ...]
    initial_qpos: Array | None = None
    initial_qvel: Array | None = None
    control: Array | None = None
    sensors: Mapping[str, Array] = field(default_factory=dict)
    initial_qpos_sigma: Array | None = None
    initial_qvel_sigma: Array | None = None
    sampling: Mapping[str, Sampling] = field(default_factory=dict)
    sensor_times: Mapping[str, Array] = field(default_factory=dict)
    events: Mapping[str, Array] = field(default_factory=dict)
    scalars: Mapping[str, Array] = field(default_factory=dict)
    _frame_number: NDArray[np.intp] = field(init=False, repr=False)
    _spacing: float = field(init=False, repr=False)

    def __init__(
        self,
        name: str,
        time: ArrayLike,
        position: ArrayLike,
        quaternion: ArrayLike | None,
        bodies: str | Sequence[str],
        initial_qpos: ArrayLike | None = None,
        initial_qvel: ArrayLike | None = None,
        control: ArrayLike | None = None,
        sensors: Mapping[str, ArrayLike] | None = None,
        initial_qpos_sigma: ArrayLike | None = None,
        initial_qvel_sigma: ArrayLike | None = None,
        sampling: Mapping[str, Sampling] | None = None,
        sensor_times: Mapping[str, ArrayLike] | None = None,
        events: Mapping[str, ArrayLike] | None = None,
        scalars: Mapping[str, ArrayLike] | None = None,
        *,
        frames: Frames = "stamped",
        rate: float | None = None,
        quaternion_order: QuaternionOrder = "wxyz",
    ) -> None:
        given = {
            "name": name,
            "time": time,
            "position": position,
            "quaternion": quaternion,
            "bodies": bodies,
            "initial_qpos": initial_qpos,
            "initial_qvel": initial_qvel,
            "control": control,
            "sensors": {} if sensors is None else sensors,
            "initial_qpos_sigma": initial_qpos_sigma,
            "initial_qvel_sigma": initial_qvel_sigma,
            "sampling": {} if sampling is None else sampling,
            "sensor_times": {} if sensor_times is None else sensor_times,
            "events": {} if events is None else events,
            "scalars": {} if scalars is None else scalars,
        }
        for attribute, value in given.items():
            object.__setattr__(self, attribute, value)
        self._check(frames, rate, quaternion_order)

    def _check(self, frames: Frames, rate: float | None, quaternion_order: QuaternionOrder) -> None:
        """Raise where fields do not fit, and put arrays of numbers in the place of what is."""
        if not isinstance(self.name, str):
            raise TypeError(f"a trajectory's name must be a string, got {self.name!r}")
        if not isinstance(self.bodies, Iterable):
            raise TypeError(
                f"{self._label}: bodies must be a name or a sequence of names, got {self.bodies!r}"
            )
        for argument, word, known in (
            ("frames", frames, get_args(Frames)),
            ("quaternion_order", quaternion_order, get_args(QuaternionOrder)),
        ):
            if word not in known:
                raise ValueError(
                    f"{self._label}: {argument} must be {' or '.join(map(repr, known))}, "
                    f"got {word!r}"
                )
        if rate is not None and not number(f"{self._label}: rate", rate) > 0:
            raise ValueError(f"{self._label}: rate must be > 0 frames a second, got {rate!r}")
        bodies = (self.bodies,) if isinstance(self.bodies, str) else tuple(self.bodies)
        if not all(isinstance(body, str) for body in bodies):
            raise TypeError(f"{self._label}: bodies must be names, got {bodies}")
        if not (bodies or self._others) or len(set(bodies)) != len(bodies):
            raise ValueError(f"{self._label}: bodies must be one or more different names: {bodies}")
        time = finite_field(f"{self._label}: time", self.time)
        if time.ndim != 1 or time.size < 2:
            raise ValueError(f"{self._label}: time must be (n,) with n >= 2, got {time.shape}")
        n, b = time.size, len(bodies)
        position = poses_field(f"{self._label}: position", self.position, (n, b, 3))
        turned = np.full((n, b, 4), np.nan) if self.quaternion is None else self.quaternion
        quaternion = poses_field(f"{self._label}: quaternion", turned, (n, b, 4))
        if quaternion_order == "xyzw":
            quaternion = np.roll(quaternion, 1, axis=-1)
        missing = np.isnan(quaternion)
        partly = np.argwhere(missing.any(axis=-1) & ~missing.all(axis=-1))
        if partly.size:
            frame, body = partly[0]
            raise ValueError(
                f"{self._label}: quaternion of frame {frame}, body '{bodies[body]}' is nan in part"
            )
        self._check_measured(position, quaternion)
        sensors, times = sensor_fields(self._label, self.sensors, self.sensor_times, n)
        object.__setattr__(self, "sensors", sensors)
        object.__setattr__(self, "sensor_times", times)
        object.__setattr__(self, "sampling", sampling_field(self._label, self.sampling, sensors))
        for name in ("events", "scalars"):
            object.__setattr__(self, name, numbers_field(self._label, name, getattr(self, name)))
        norm = np.linalg.norm(quaternion, axis=-1)
        off = np.argwhere(np.abs(norm - 1.0) > UNIT_TOLERANCE)
        if off.size:
            frame, body = off[0]
            raise ValueError(
                f"{self._label}: quaternion of frame {frame}, body '{bodies[body]}' has norm "
                f"{norm[frame, body]:.6g}; unit quaternions are needed"
            )
        read = [readings for name, readings in sensors.items() if name not in times]
        channels = np.concatenate([position.reshape(n, -1), *read], axis=1)
        try:
            grid = frame_times(time, channels, frames, rate)
        except ValueError as error:
            raise ValueError(f"{self._label}: {error}") from None
        grid.number.flags.writeable = False
        object.__setattr__(self, "_frame_number", grid.number)
        object.__setattr__(self, "_spacing", grid.spacing)
        object.__setattr__(self, "bodies", bodies)
        object.__setattr__(self, "time", frozen(grid.time))
        object.__setattr__(self, "position", frozen(position))
        object.__setattr__(self, "quaternion", frozen(quaternion / norm[..., None]))
        for name, ndim in (("initial_qpos", 1), ("initial_qvel", 1), ("control", 2)):
            value = getattr(self, name)
            if value is None:
                continue
            array = finite_field(f"{self._label}: {name}", value)
            if array.ndim != ndim:
                raise ValueError(f"{self._label}: {name} must be {ndim}-D, got {array.shape}")
            if name == "control" and array.shape[0] != n - 1:
                raise ValueError(
                    f"{self._label}: control must have a row for each of the {n - 1} frame "
                    f"intervals, got {array.shape[0]}"
                )
            object.__setattr__(self, name, frozen(array))
        for name in ("initial_qpos", "initial_qvel"):
            value = getattr(self, f"{name}_sigma")
            if value is None:
                continue
            sigma = initial_deviations(f"{self._label}: {name}_sigma", value)
            if np.isfinite(sigma).any() and getattr(self, name) is None:
                raise ValueError(
                    f"{self._label}: {name}_sigma says how well {name} is known, which is not given"
                )
            object.__setattr__(self, f"{name}_sigma", frozen(sigma))

    @classmethod
    def of_sensors(
        cls,
        name: str,
        time: ArrayLike,
        sensors: Mapping[str, ArrayLike],
        *,
        initial_qpos: ArrayLike | None = None,
        initial_qvel: ArrayLike | None = None,
        control: ArrayLike | None = None,
        initial_qpos_sigma: ArrayLike | None = None,
        initial_qvel_sigma: ArrayLike | None = None,
        sampling: Mapping[str, Sampling] | None = None,
        sensor_times: Mapping[str, ArrayLike] | None = None,
        events: Mapping[str, ArrayLike] | None = None,
        scalars: Mapping[str, ArrayLike] | None = None,
        frames: Frames = "stamped",
        rate: float | None = None,
    ) -> Trajectory:
        """Return a trajectory of which sensors alone were observed; fields as in the class.

        A leg that lands, with an accelerometer and an encoder that the MJCF names ``imu`` and
        ``knee``, and no pose in the world::

            landing = Trajectory.of_sensors("landing", time, {"imu": acceleration, "knee": angle},
                                            initial_qpos=qpos, initial_qvel=qvel, control=control)
            problem = Problem(engine, unknown, [landing], math.inf, math.inf,
                              sensor_sigma={"imu": 0.5, "knee": 1e-3})
        """
        n = np.size(time)
        return cls(
            name,
            time,
            np.empty((n, 0, 3)),
            np.empty((n, 0, 4)),
            bodies=(),
            initial_qpos=initial_qpos,
            initial_qvel=initial_qvel,
            control=control,
            sensors=sensors,
            initial_qpos_sigma=initial_qpos_sigma,
            initial_qvel_sigma=initial_qvel_sigma,
            sampling=sampling or {},
            sensor_times=sensor_times or {},
            events=events or {},
            scalars=scalars or {},
            frames=frames,
            rate=rate,
        )

    @classmethod
    def of_events(
        cls,
        name: str,
        events: Mapping[str, ArrayLike] | None = None,
        *,
        scalars: Mapping[str, ArrayLike] | None = None,
        bodies: str | Sequence[str] = (),
        end: float | None = None,
        initial_qpos: ArrayLike | None = None,
        initial_qvel: ArrayLike | None = None,
        initial_qpos_sigma: ArrayLike | None = None,
        initial_qvel_sigma: ArrayLike | None = None,
    ) -> Trajectory:
        """Return a trajectory of which events and scalars alone were observed, from time 0.

        Impacts of a ball that a microphone heard, dropped from 0.8 m::

            drop = Trajectory.of_events("drop", {"impact": [0.40, 1.01, 1.48]}, bodies="ball",
                                        initial_qpos=[0, 0, 0.8, 1, 0, 0, 0], initial_qvel=[0] * 6)
            problem = Problem(engine, unknown, [drop], event_sigma={"impact": 1e-4})

        Parameters
        ----------
        bodies
            Whose impacts and apices they are; all that move where none is named.
        end
            s, until when it is simulated. None: a quarter longer than to the last event.
        name, events, scalars, initial_qpos, initial_qvel, initial_qpos_sigma, initial_qvel_sigma
            As in the class.
        """
        given = numbers_field(f"trajectory '{name}'", "events", events or {})
        if end is None:
            if not given:
                raise ValueError(f"trajectory '{name}': end must be given where there is no event")
            end = 1.25 * max(float(np.nanmax(times)) for times in given.values())
        count = 1 if isinstance(bodies, str) else len(bodies)
        return cls(
            name,
            [0.0, number(f"trajectory '{name}': end", end)],
            np.full((2, count, 3), np.nan),
            np.full((2, count, 4), np.nan),
            bodies,
            initial_qpos=initial_qpos,
            initial_qvel=initial_qvel,
            initial_qpos_sigma=initial_qpos_sigma,
            initial_qvel_sigma=initial_qvel_sigma,
            events=events or {},
            scalars=scalars or {},
        )

    @overload
    @classmethod
    def from_csv(
        cls,
        file: str | os.PathLike[str],
        *,
        columns: Mapping[str, str] | None = ...,
        body: str | Sequence[str] = ...,
        run: None = ...,
        unit: Mapping[str, str | float] | None = ...,
        name: str | None = ...,
        **fields: Any,
    ) -> Trajectory: ...

    @overload
    @classmethod
    def from_csv(
        cls,
        file: str | os.PathLike[str],
        *,
        run: str,
        columns: Mapping[str, str] | None = ...,
        body: str | Sequence[str] = ...,
        unit: Mapping[str, str | float] | None = ...,
        name: str | None = ...,
        **fields: Any,
    ) -> list[Trajectory]: ...

    @classmethod
    def from_csv(
        cls,
        file: str | os.PathLike[str],
        *,
        columns: Mapping[str, str] | None = None,
        body: str | Sequence[str] = (),
        run: str | None = None,
        unit: Mapping[str, str | float] | None = None,
        name: str | None = None,
        **fields: Any,
    ) -> Trajectory | list[Trajectory]:
        """Return the trajectory in a table, or a list of those of several runs.

        A ball whose height a camera read in cm, at times in ms; then a load cell in three runs::

            ball = Trajectory.from_csv("ball.csv", columns={"time": "t", "z": "height"},
                                       body="ball", unit={"z": "cm", "time": "ms"}, frames="even")
            runs = Trajectory.from_csv("pad.csv", columns={"time": "time_s", "sensor:load": "F"},
                                       run="run")

        Parameters
        ----------
        file
            Text in UTF-8 or Latin-1, cells apart by commas, semicolons or tabs; where not by
            commas, numbers may have one for the decimal point. Lines before the header are passed
            over.
            Empty cells and ``nan``, ``NA``, ``-``: not measured.
        columns
            Names of columns by what they hold: ``time``; ``x``, ``y``, ``z``, ``qw``, ``qx``,
            ``qy``, ``qz`` or, of several bodies, ``BODY.x`` and on; ``sensor:NAME``, of several
            numbers ``sensor:NAME.0`` and on. Coordinates and quaternions that are left out were
            not measured. None: columns are named so.
        body
            Name of the body, or of several; without one sensors alone were observed.
        run
            Column that tells several runs apart: a list is returned, in their order.
        unit
            Units by what columns hold or by their names, those of SI where none is given: ``cm``,
            ``mm``, ``in``, ``ms``, ``us``, ``deg``, ``kN``, ``mm/s`` and such, or the factor to
            SI's, negative for an axis that points the other way. ``position``: all coordinates.
        name
            Of the trajectory. None: that of the file. Of several runs: in front of the run's, by
            default the column (``run 1``).
        fields
            Others of `Trajectory`: ``frames``, ``initial_qpos`` ...

        Raises
        ------
        ValueError
            Naming the file, and the line, column, or field of the trajectory.
        OSError
            If the file cannot be read.
        """
        bodies = (body,) if isinstance(body, str) else tuple(body)
        try:
            runs = read_runs(file, Table(columns, bodies, run, unit))
            made = []
            for label, read in runs.items():
                if run is None and (np.diff(read["time"]) < 0).any():
                    row = int(np.argmax(np.diff(read["time"]) < 0)) + 1
                    raise ValueError(
                        f"time goes back, from {read['time'][row - 1]:.6g} to "
                        f"{read['time'][row]:.6g} s; where a file has several runs, run names the "
                        "column that tells them apart"
                    )
                first = name if name is not None else run if run is not None else Path(file).stem
                given = {"name": first if run is None else f"{first} {label}", **read, **fields}
                made.append(cls(bodies=bodies, **given) if bodies else cls.of_sensors(**given))
        except ValueError as error:
            raise ValueError(f"{os.fspath(file)}: {error}") from None
        return made[0] if run is None else made

    def __repr__(self) -> str:
        """Return name, length and bodies, without the arrays."""
        left_out = int(self.frame_number[-1]) + 1 - self.frames
        sensors = "".join(
            f", {field}={tuple(getattr(self, field))}"
            for field in ("sensors", "events", "scalars")
            if getattr(self, field)
        )
        lost = f" ({left_out} left out)" if left_out else ""
        return (
            f"Trajectory({self.name!r}, {self.frames} frames {self.spacing:.6g} s apart{lost}, "
            f"bodies={self.bodies}{sensors})"
        )

    @property
    def frames(self) -> int:
        """Number of observed frames."""
        return int(self.time.size)

    @property
    def spacing(self) -> float:
        """Time between frames, s: that of the even grid that fits their times best."""
        return self._spacing

    @property
    def frame_number(self) -> NDArray[np.intp]:
        """(n,) places of the frames on the even grid, from 0; with gaps where frames were lost."""
        return self._frame_number

    @property
    def measured(self) -> NDArray[np.bool_]:
        """(n, bodies, 6) whether x, y, z and the rotations about them were measured."""
        turned = ~np.isnan(self.quaternion[..., :1])
        return np.concatenate([~np.isnan(self.position), np.repeat(turned, 3, axis=-1)], axis=-1)

    def sensor_time(self, name: str) -> Array:
        """Return the times (n,) of a sensor's readings, s, on the clock of ``time``."""
        return self.sensor_times.get(name, self.time)

    def head(self, duration: float) -> Trajectory:
        """Return the frames up to `duration` s after the first, at least two of them.

        They keep their places on the grid of the whole, which few of them may not tell. Readings
        and events up to then stay; scalars, which are of the whole, do not.
        """
        if not number(f"{self._label}: a window", duration) > 0:
            raise ValueError(f"{self._label}: a window must be > 0 s, got {duration!r}")
        # Half a spacing of slack, so that a window of k spacings holds k + 1 frames.
        n = int(np.count_nonzero(self.time - self.time[0] <= duration + 0.5 * self.spacing))
        return self._cut(0, max(n, 2))

    def between(self, start: float, end: float) -> Trajectory:
        """Return the frames from time `start` to time `end`, as a window round an event.

        What is simulated begins at the first of them. Unless that is the first of all, it has none
        of the initial state given, which was of another time: estimate it
        (``initial_state="pose_and_velocity"``), or give it with ``dataclasses.replace``. Half a
        second either side of a peak at 2.3 s::

            peak = trajectory.between(1.8, 2.8)

        Raises
        ------
        ValueError
            Where less than two frames are left, or nothing that was measured.
        """
        first = number(f"{self._label}: start", start)
        last = number(f"{self._label}: end", end)
        slack = 1e-6 * self.spacing
        begin, stop = np.searchsorted(self.time, [first - slack, last + slack])
        if stop - begin < 2:
            raise ValueError(
                f"{self._label}: {stop - begin} frames are between {first:.6g} and {last:.6g} s, "
                f"of those from {self.time[0]:.6g} to {self.time[-1]:.6g} s; two are needed"
            )
        return self._cut(int(begin), int(stop))

    def _cut(self, begin: int, stop: int) -> Trajectory:
        """Return frames `begin` to `stop`, which keep their places on the grid of the whole."""
        if begin == 0 and stop == self.frames:
            return self
        frames = slice(begin, stop)
        self._check_measured(self.position[frames], self.quaternion[frames])
        cut = copy.copy(self)
        for name in ("time", "position", "quaternion"):
            object.__setattr__(cut, name, getattr(self, name)[frames])
        place = self.frame_number[frames] - self.frame_number[begin]
        place.flags.writeable = False
        object.__setattr__(cut, "_frame_number", place)
        if self.control is not None:
            object.__setattr__(cut, "control", self.control[begin : stop - 1])
        first, last = float(self.time[begin]), float(self.time[stop - 1] + 1e-9 * self.spacing)
        own = {name: (t >= first) & (t <= last) for name, t in self.sensor_times.items()}
        sensors = {name: readings[own.get(name, frames)] for name, readings in self.sensors.items()}
        object.__setattr__(cut, "sensors", sensors)
        times = {name: time[own[name]] for name, time in self.sensor_times.items()}
        object.__setattr__(cut, "sensor_times", times)
        events = {name: t[~((t < first) | (t > last))] for name, t in self.events.items()}
        object.__setattr__(cut, "events", {k: v for k, v in events.items() if v.size})
        # They are of the whole.
        object.__setattr__(cut, "scalars", {})
        if begin > 0:
            for name in ("initial_qpos", "initial_qvel"):
                object.__setattr__(cut, name, None)
                object.__setattr__(cut, f"{name}_sigma", None)
        return cut

    @property
    def _others(self) -> bool:
        """Whether anything but poses was observed."""
        return bool(self.sensors or self.events or self.scalars)

    @property
    def _label(self) -> str:
        return f"trajectory '{self.name}'"

    def _check_measured(self, position: Array, quaternion: Array) -> None:
        """Raise ValueError where poses are all that is observed, and none was measured."""
        nothing = np.isnan(position).all() and np.isnan(quaternion).all()
        if self.bodies and nothing and not self._others:
            raise ValueError(f"{self._label}: all positions and quaternions are nan")
