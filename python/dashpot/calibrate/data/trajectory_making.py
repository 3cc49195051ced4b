"""Ways to make a trajectory: of sensors, of events, of a table."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike

from dashpot.calibrate.data.csv_file import Table, read_runs
from dashpot.calibrate.data.recorder_fields import Sampling, numbers_field
from dashpot.calibrate.data.stamps import Frames
from dashpot.calibrate.data.views import ImagePlane
from dashpot.checks import number

Made = TypeVar("Made", bound="TrajectoryMaking")


class TrajectoryMaking:
    """Class methods that make a trajectory."""

    if TYPE_CHECKING:

        def __init__(self, *args: Any, **fields: Any) -> None: ...

    @classmethod
    def of_sensors(
        cls: type[Made],
        name: str,
        time: ArrayLike,
        sensors: Mapping[str, ArrayLike] | None = None,
        *,
        pixels: Mapping[str, ArrayLike] | None = None,
        camera: str | ImagePlane | None = None,
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
        rate_sigma: float | None = None,
    ) -> Made:
        """Return one of which sensors, or points in pixels, alone were observed.

        Examples
        --------
        A leg that lands, with an accelerometer and an encoder, and no pose in the world:

        >>> acceleration, angle = np.zeros((41, 3)), np.zeros(41)
        >>> landing = Trajectory.of_sensors("landing", time, {"imu": acceleration, "knee": angle})
        >>> landing.sensors["imu"].shape, landing.sensors["knee"].shape
        ((41, 3), (41, 1))
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
            rate_sigma=rate_sigma,
            pixels=pixels,
            camera=camera,
        )

    @classmethod
    def of_events(
        cls: type[Made],
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
    ) -> Made:
        """Return a trajectory of which events and scalars alone were observed, from time 0.

        Parameters
        ----------
        bodies
            Whose impacts and apices they are; all that move where none is named.
        end
            s, until when it is simulated. None: a quarter longer than to the last event.
        name, events, scalars, initial_qpos, initial_qvel, initial_qpos_sigma, initial_qvel_sigma
            As in the class.

        Examples
        --------
        Impacts of a ball that a microphone heard:

        >>> drop = Trajectory.of_events("drop", {"impact": [0.40, 1.01, 1.48]}, bodies="ball")
        >>> sigma = {"impact": 1e-4}  # s
        >>> heard = Problem(engine, unknown, [drop], event_sigma=sigma, initial_state="velocity")
        >>> drop.events["impact"]
        array([0.4 , 1.01, 1.48])
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
        cls: type[Made],
        file: str | os.PathLike[str],
        *,
        columns: Mapping[str, str] | None = ...,
        body: str | Sequence[str] = ...,
        run: None = ...,
        unit: Mapping[str, str | float] | None = ...,
        name: str | None = ...,
        **fields: Any,
    ) -> Made: ...

    @overload
    @classmethod
    def from_csv(
        cls: type[Made],
        file: str | os.PathLike[str],
        *,
        run: str,
        columns: Mapping[str, str] | None = ...,
        body: str | Sequence[str] = ...,
        unit: Mapping[str, str | float] | None = ...,
        name: str | None = ...,
        **fields: Any,
    ) -> list[Made]: ...

    @classmethod
    def from_csv(
        cls: type[Made],
        file: str | os.PathLike[str],
        *,
        columns: Mapping[str, str] | None = None,
        body: str | Sequence[str] = (),
        run: str | None = None,
        unit: Mapping[str, str | float] | None = None,
        name: str | None = None,
        **fields: Any,
    ) -> Made | list[Made]:
        """Return the trajectory in a table, or a list of those of several runs.

        Parameters
        ----------
        file
            Text in UTF-8 or Latin-1, cells apart by commas, semicolons or tabs; where not by
            commas, numbers may have one for the decimal point. Lines before the header are passed
            over.
            Empty cells and ``nan``, ``NA``, ``-``: not measured.
        columns
            Names of columns by what they hold. ``time``. ``x``, ``y``, ``z``, ``qw``, ``qx``,
            ``qy``, ``qz``, or ``u``, ``v`` in pixels, of several bodies ``BODY.x`` and on.
            ``sensor:NAME``, of several numbers ``sensor:NAME.0`` and on. What is left out was not
            measured. None: columns are named so.
        body
            Name of the body, or of several; without one sensors alone were observed.
        run
            Column that tells several runs apart: a list is returned, in their order.
        unit
            Units by what columns hold or by their names, those of SI where none is given. ``cm``,
            ``mm``, ``in``, ``ms``, ``us``, ``deg``, ``kN``, ``mm/s`` and such, or the factor to
            SI's, negative for an axis that points the other way. ``position``: all coordinates.
        name
            Of the trajectory. None: that of the file. Of several runs: in front of the run's, by
            default the column (``run 1``).
        fields
            Others of `Trajectory`: ``frames``, ``initial_qpos``; of ``u``, ``v`` the ``camera``.

        Raises
        ------
        ValueError
            Naming the file, and the line, column, or field of the trajectory.
        OSError
            If the file cannot be read.

        Examples
        --------
        A ball whose height a camera read in cm, at times in ms:

        >>> table = np.column_stack([1000 * time, 100 * position[:, 2]])
        >>> np.savetxt("ball.csv", table, delimiter=",", header="t,height", comments="")
        >>> ball = Trajectory.from_csv(
        ...     "ball.csv", columns={"time": "t", "z": "height"}, body="ball",
        ...     unit={"time": "ms", "z": "cm"},
        ... )
        >>> bool(np.allclose(ball.position[:, 0, 2], position[:, 2], atol=1e-5))
        True
        """
        bodies = (body,) if isinstance(body, str) else tuple(body)
        try:
            seen = fields.get("camera") is not None
            runs = read_runs(file, Table(columns, bodies, run, unit, seen))
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
                if seen and "pixels" not in read:
                    raise ValueError("no column 'u' or 'v' of what the camera saw")
                made.append(cls(**given) if "bodies" in read else cls.of_sensors(**given))
        except ValueError as error:
            raise ValueError(f"{os.fspath(file)}: {error}") from None
        return made[0] if run is None else made
