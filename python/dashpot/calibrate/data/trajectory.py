"""Reference trajectories: observed poses of bodies, checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot.calibrate.data import trajectory_cuts
from dashpot.calibrate.data.recorder_fields import Sampling
from dashpot.calibrate.data.stamps import Frames
from dashpot.calibrate.data.trajectory_checks import UNIT_TOLERANCE, QuaternionOrder, check_fields
from dashpot.calibrate.data.trajectory_making import TrajectoryMaking
from dashpot.calibrate.data.views import ImagePlane, View, with_pixels

__all__ = ["UNIT_TOLERANCE", "QuaternionOrder", "Trajectory"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, init=False)
class Trajectory(TrajectoryMaking):
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
        (n,) times in s, strictly increasing, n >= 2, and evenly spaced. They are at most 15 % of a
        spacing off the even grid that fits them best, so that those rounded to milliseconds pass to
        240 Hz. The frames count as being on that grid. Lost frames may be left out, more than half
        of them too: intervals of several spacings are gaps, through which the simulation goes on.
        Where stamps jitter further see `frames`.
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
        (nv,), or one number for all degrees of freedom. How well `initial_qpos` and `initial_qvel`
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
        the sensor. They may be joint encoders (``jointpos``), accelerometers, force plates
        (``touch``, ``force``), positions of markers (``framepos`` of a site, in the frame of a
        camera, too). Angles of hinges may be those within a turn, which jump where it ends: where
        two that follow each other differ by more than half a turn. NaN: not measured. `of_sensors`
        makes trajectories of sensors alone.
    sampling
        By sensor. ``"instant"``: it reads what is at the time of the reading. ``"mean"``: the mean
        over the spacing before, as recorders that integrate do, so that there is none at the first.
        By default sensors of positions and velocities are instant, and those of accelerations and
        forces means.
    sensor_times
        By sensor, (n,) times of its readings, s, on the clock of `time`, for sensors that have a
        rate of their own. An example is a load cell of 1 kHz beside a camera. None: those of the
        frames.
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
        ``sqrt(12 / n**3)`` of their jitter in n frames.
    rate_sigma
        How well the rate of frames is known, as a standard deviation over it: 0.001 is 0.1 %. Fits
        estimate it then, from where it is. None: exactly, or with ``frames="even"`` and no `rate`
        as well as stamps tell it.
    quaternion_order
        ``"wxyz"``: scalar first; ``"xyzw"``: scalar last.
    pixels
        By name of a body (its origin) or site, (n, 2) columns and rows at which a camera saw it,
        NaN: not seen. As OpenCV counts: columns to the right, rows down, and 0 is the middle of the
        first pixel. They are readings like those of sensors, named ``"CAMERA:POINT"``.
    camera
        Which saw them: the name of a camera of the model, whose focal length and resolution count,
        or an `ImagePlane`. None: keys of `pixels` say it, ``"CAMERA:POINT"``.
    views
        What readings in pixels show, by name; `pixels` and `camera` make them.

    Raises
    ------
    ValueError
        Naming the trajectory, the field and the first offending index.

    Examples
    --------
    >>> throw.time.shape, throw.position.shape, throw.bodies
    ((41,), (41, 1, 3), ('ball',))
    >>> press = Trajectory.of_sensors("press", [0.0, 0.01, 0.02], {"load": [0.0, 4.1, 4.2]})
    >>> press.sensors["load"].shape
    (3, 1)
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
    views: Mapping[str, View] = field(default_factory=dict)
    rate_sigma: float = 0.0
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
        rate_sigma: float | None = None,
        quaternion_order: QuaternionOrder = "wxyz",
        pixels: Mapping[str, ArrayLike] | None = None,
        camera: str | ImagePlane | None = None,
        views: Mapping[str, View] | None = None,
    ) -> None:
        sensors = {} if sensors is None else sensors
        readings, shown = with_pixels(f"trajectory '{name}'", sensors, pixels, camera, views)
        given = {
            "name": name,
            "time": time,
            "position": position,
            "quaternion": quaternion,
            "bodies": bodies,
            "initial_qpos": initial_qpos,
            "initial_qvel": initial_qvel,
            "control": control,
            "sensors": readings,
            "initial_qpos_sigma": initial_qpos_sigma,
            "initial_qvel_sigma": initial_qvel_sigma,
            "sampling": {} if sampling is None else sampling,
            "sensor_times": {} if sensor_times is None else sensor_times,
            "events": {} if events is None else events,
            "scalars": {} if scalars is None else scalars,
            "views": shown,
        }
        for attribute, value in given.items():
            object.__setattr__(self, attribute, value)
        check_fields(self, frames, rate, rate_sigma, quaternion_order)

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
        """Return the times (n,) of a sensor's readings, s, on the clock of ``time``.

        Examples
        --------
        >>> press = Trajectory.of_sensors("press", [0.0, 0.01, 0.02], {"load": [0.0, 4.1, 4.2]})
        >>> press.sensor_time("load")
        array([0.  , 0.01, 0.02])
        """
        return self.sensor_times.get(name, self.time)

    def head(self, duration: float) -> Trajectory:
        """Return the frames up to `duration` s after the first, at least two of them.

        They keep their places on the grid of the whole, which few of them may not tell. Readings
        and events up to then stay; scalars, which are of the whole, do not.

        Examples
        --------
        >>> len(throw.head(0.1).time)
        11
        """
        return trajectory_cuts.head(self, duration)

    def between(self, start: float, end: float) -> Trajectory:
        """Return the frames from time `start` to time `end`, as a window round an event.

        What is simulated begins at the first of them. Unless that is the first of all, it has none
        of the initial state given, which was of another time: estimate it
        (``initial_state="pose_and_velocity"``), or give it with ``dataclasses.replace``.

        Raises
        ------
        ValueError
            Where less than two frames are left, or nothing that was measured.

        Examples
        --------
        >>> window = throw.between(0.1, 0.3)  # round an impact
        >>> len(window.time)
        21
        """
        return trajectory_cuts.between(self, start, end)

    @property
    def _others(self) -> bool:
        """Whether anything but poses was observed."""
        return bool(self.sensors or self.events or self.scalars)

    @property
    def _label(self) -> str:
        return f"trajectory '{self.name}'"
