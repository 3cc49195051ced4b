"""Parameters of recorders: delay, gain and offset of channels, scale of positions, pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, cast, get_args

import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.problem.channels import POSES
from dashpot.calibrate.problem.default_ranges import middle
from dashpot.calibrate.problem.parameter_options import Bounds, Frozen, Groups, Start
from dashpot.calibrate.problem.sensing import ImageQuantity, SensingQuantity, SensingSetter
from dashpot.calibrate.problem.transforms import TransformName
from dashpot.checks import number_array

if TYPE_CHECKING:
    from dashpot.calibrate.problem.parameters import Parameter


class RecorderParameters:
    """The methods of `Parameter` that make parameters of recorders."""

    @classmethod
    def delay(
        cls,
        channel: str | Sequence[str],
        *,
        bounds: Sequence[float] | NDArray[np.float64],
        start: float = 0.0,
        name: str | None = None,
        per: Groups | None = None,
        frozen: Frozen = False,
    ) -> Parameter:
        """Estimate by how much a recorder is late, s.

        Parameters
        ----------
        channel
            Name of a sensor, ``"poses"``, or a kind of events, as ``"impact"``; or several, which
            one recorder has.
        bounds
            (lower, upper), s. Readings at times before the upper one do not count: what they show
            comes before the start. Simulations go on beyond the end by a lower one < 0.
        start, name, per, frozen
            As in `Parameter`. By default the name is ``delay of CHANNEL``.

        Examples
        --------
        A load cell that may be up to 50 ms late beside a camera:

        >>> Parameter.delay("load", bounds=(-0.01, 0.05)).name
        'delay of load'
        """
        return cls._of_sensing("delay", channel, start, bounds, name, per, frozen, "linear")

    @classmethod
    def gain(
        cls,
        channel: str | Sequence[str],
        *,
        bounds: Bounds,
        start: Start = 1.0,
        name: str | None = None,
        per: Groups | None = None,
        frozen: Frozen = False,
    ) -> Parameter:
        """Estimate the gain of a sensor, or of a scalar: its reading is so many times the true one.

        Parameters as in `delay`; `bounds` > 0.

        Examples
        --------
        >>> Parameter.gain("load", bounds=(0.5, 2.0)).start
        1.0
        """
        return cls._of_sensing("gain", channel, start, bounds, name, per, frozen, "log")

    @classmethod
    def offset(
        cls,
        channel: str | Sequence[str],
        *,
        bounds: Bounds,
        start: Start = 0.0,
        name: str | None = None,
        per: Groups | None = None,
        frozen: Frozen = False,
    ) -> Parameter:
        """Estimate what a sensor, or a scalar, reads where the true reading is 0, in its unit.

        Parameters as in `delay`. Of sensors of several numbers all have the same, unless `start` or
        `bounds` are those of a vector.

        Examples
        --------
        >>> Parameter.offset("load", bounds=(-5.0, 5.0)).transform  # in N
        'linear'
        """
        return cls._of_sensing("offset", channel, start, bounds, name, per, frozen, "linear")

    @classmethod
    def scale(
        cls,
        *,
        bounds: Sequence[float] | NDArray[np.float64],
        start: float = 1.0,
        centre: Sequence[float] = (0.0, 0.0, 0.0),
        name: str | None = None,
        per: Groups | None = None,
        frozen: Frozen = False,
    ) -> Parameter:
        """Estimate the scale of measured positions: they are so many times the true ones.

        Parameters
        ----------
        centre
            (3,) the point that is measured rightly, world, m: the optical axis of a camera.
        bounds, start, name, per, frozen
            As in `delay`; `bounds` > 0. By default the name is ``scale of poses``.

        Examples
        --------
        >>> Parameter.scale(bounds=(0.9, 1.1)).name
        'scale of poses'
        """
        point = number_array("centre", centre)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise ValueError(f"centre must be three finite numbers, got {centre!r}")
        x, y, z = (float(entry) for entry in point)
        return cls._of_sensing("scale", POSES, start, bounds, name, per, frozen, "log", (x, y, z))

    @classmethod
    def image(
        cls,
        quantity: ImageQuantity,
        camera: str = "image",
        *,
        bounds: Sequence[float] | NDArray[np.float64],
        start: float | None = None,
        name: str | None = None,
        per: Groups | None = None,
        frozen: Frozen = False,
    ) -> Parameter:
        """Estimate a number of a picture in which points are seen (``Trajectory(pixels=...)``).

        Parameters
        ----------
        quantity
            ``"scale"``: pixels per metre of an `ImagePlane`, of a camera of the model its focal
            length in pixels. ``"tilt"``: rad, clockwise. ``"origin_u"``, ``"origin_v"``: the pixel
            where the origin of the world is seen, of a camera of the model the middle. Where a
            camera stands and looks `model` varies: ``cam_pos``, ``cam_fovy`` ...
        camera
            Name of the camera, or of the `ImagePlane`.
        bounds
            (lower, upper); of a scale > 0.
        start, name, per, frozen
            As in `Parameter`. By default the start is in the middle of the bounds, the name
            ``scale of image``.

        Examples
        --------
        >>> Parameter.image("tilt", bounds=(-0.1, 0.1)).name
        'tilt of image'
        """
        if quantity not in get_args(ImageQuantity):
            raise ValueError(
                f"quantity of a picture must be one of {', '.join(get_args(ImageQuantity))}, got "
                f"{quantity!r}"
            )
        if not isinstance(camera, str):
            raise TypeError(f"camera must be a name, got {camera!r}")
        scale = quantity == "scale"
        if start is None and np.shape(bounds) == (2,):
            start = middle(bounds, logarithmic=scale)
        transform: TransformName = "log" if scale else "linear"
        return cls._of_sensing(quantity, camera, start, bounds, name, per, frozen, transform)  # type: ignore[arg-type]

    @classmethod
    def _of_sensing(
        cls,
        quantity: SensingQuantity,
        channel: str | Sequence[str],
        start: Start,
        bounds: Bounds,
        name: str | None,
        per: Groups | None,
        frozen: Frozen,
        transform: TransformName,
        centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> Parameter:
        listed = channel if isinstance(channel, Iterable) else ()
        several = (channel,) if isinstance(channel, str) else tuple(listed)
        if not several or not all(isinstance(one, str) for one in several):
            raise TypeError(f"channel must be a name, or several, got {channel!r}")
        make = cast("type[Parameter]", cls)
        return make(
            name=f"{quantity} of {', '.join(several)}" if name is None else name,
            start=start,
            bounds=bounds,
            transform=transform,
            per=per,
            frozen=frozen,
            apply=SensingSetter(quantity, several[0], centre, others=several[1:]),
        )
