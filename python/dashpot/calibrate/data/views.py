"""Points that cameras saw: two numbers a frame, in pixels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dashpot.checks import number, number_array, positive_number

Array = NDArray[np.float64]

# Axes of a picture count as perpendicular when their cosine is below this.
_PERPENDICULAR = 1e-6


@dataclass(frozen=True, kw_only=True)
class ImagePlane:
    """A picture of a plane in the world, where no camera was calibrated.

    A point p of the world is seen at the column u and row v, in pixels, of

        (u, v) = origin + scale R(tilt) (right . p, down . p)

    where R turns clockwise, as one looks at the picture. Each of the numbers can be estimated:
    `Parameter.image`.

    Motion along the line of sight is not seen. Where initial states are estimated, a body on a free
    joint that nothing else observes starts in the plane. Its start is not moved along the line of
    sight, if that is an axis of the world, nor about axes across it. ``initial_qpos_sigma`` and
    ``initial_qvel_sigma`` of the trajectory may say how well it is known.

    Parameters
    ----------
    scale
        Pixels per metre, > 0.
    origin
        (u, v) where the origin of the world is seen, or would be; (0, 0) is the middle of the pixel
        in the upper left corner.
    right, down
        (3,) directions of the world along which u and v grow where the picture is not tilted;
        perpendicular, of any length. Where rows are counted from below, `down` points up.
    tilt
        By which angle the picture is turned clockwise: horizontal lines fall to the right, rad.
    name
        Names it in channels and parameters.

    Raises
    ------
    ValueError
        Naming the field.

    Examples
    --------
    A camera that looks along the world's y axis, 812 pixels a metre:

    >>> from dashpot.calibrate import ImagePlane
    >>> picture = ImagePlane(scale=812, origin=(320, 420))
    >>> uv = [(320, 420), (328, 420), (336, 420)]
    >>> roll = Trajectory.of_sensors("roll", time[:3], pixels={"ball": uv}, camera=picture)
    >>> list(roll.sensors)
    ['image:ball']
    """

    scale: float
    origin: tuple[float, float] = (0.0, 0.0)
    right: tuple[float, float, float] = (1.0, 0.0, 0.0)
    down: tuple[float, float, float] = (0.0, 0.0, -1.0)
    tilt: float = 0.0
    name: str = "image"

    if TYPE_CHECKING:
        # What is taken, which is more than the types that fields have in the end.
        def __init__(
            self,
            *,
            scale: float,
            origin: ArrayLike = (0.0, 0.0),
            right: ArrayLike = (1.0, 0.0, 0.0),
            down: ArrayLike = (0.0, 0.0, -1.0),
            tilt: float = 0.0,
            name: str = "image",
        ) -> None: ...

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name or ":" in self.name:
            raise ValueError(f"name of an image must be a word without ':', got {self.name!r}")
        scale = positive_number("scale of an image", self.scale)
        tilt = number("tilt of an image", self.tilt)
        if not (math.isfinite(scale) and math.isfinite(tilt)):
            raise ValueError("scale and tilt of an image must be finite")
        origin = _vector("origin of an image", self.origin, 2)
        right, down = (_vector(f"{n} of an image", getattr(self, n), 3) for n in ("right", "down"))
        lengths = [float(np.linalg.norm(axis)) for axis in (right, down)]
        if min(lengths) == 0.0 or abs(right @ down) > _PERPENDICULAR * lengths[0] * lengths[1]:
            raise ValueError(
                f"right and down of an image must be perpendicular, got {self.right}, {self.down}"
            )
        for name, value in (
            ("scale", scale),
            ("tilt", tilt),
            ("origin", tuple(map(float, origin))),
            ("right", tuple(map(float, right / lengths[0]))),
            ("down", tuple(map(float, down / lengths[1]))),
        ):
            object.__setattr__(self, name, value)

    @classmethod
    def from_points(
        cls,
        pixels: Sequence[ArrayLike],
        positions: Sequence[ArrayLike],
        *,
        right: ArrayLike = (1.0, 0.0, 0.0),
        down: ArrayLike = (0.0, 0.0, -1.0),
        name: str = "image",
    ) -> ImagePlane:
        """Return the picture in which two points are seen where they were, as the ends of a ruler.

        Parameters
        ----------
        pixels
            Two of (u, v).
        positions
            Two of (x, y, z), the points in the world, m.
        right, down, name
            As in the class.

        Raises
        ------
        ValueError
            Where either two are one point, or the line between them is along the line of sight.

        Examples
        --------
        >>> from dashpot.calibrate import ImagePlane
        >>> ruler = ImagePlane.from_points([(100, 300), (500, 300)], [(0, 0, 0), (0.5, 0, 0)])
        >>> ruler.scale  # pixels a metre
        800.0
        """
        plain = cls(scale=1.0, right=right, down=down, name=name)
        first, second = (_vector(f"pixels[{i}]", p, 2) for i, p in enumerate(_two(pixels)))
        axes = np.array([plain.right, plain.down])
        p, q = (axes @ _vector(f"positions[{i}]", x, 3) for i, x in enumerate(_two(positions)))
        # As complex numbers a turn and a scale are one factor.
        seen, true = complex(*(second - first)), complex(*(q - p))
        if abs(seen) == 0.0 or abs(true) == 0.0:
            raise ValueError("the two points are seen in one place, or are one in the picture")
        factor = seen / true
        origin = complex(*first) - factor * complex(*p)
        return cls(
            scale=abs(factor),
            origin=(origin.real, origin.imag),
            right=right,
            down=down,
            tilt=math.atan2(factor.imag, factor.real),
            name=name,
        )

    def unturned(self, pixels: Array) -> Array:
        """Return (n, 2) how far to the right and down of the origin pixels (n, 2) are, m."""
        cosine, sine = math.cos(self.tilt), math.sin(self.tilt)
        turned = np.array([[cosine, -sine], [sine, cosine]])
        return np.asarray((pixels - self.origin) @ turned / self.scale)


@dataclass(frozen=True)
class View:
    """What a channel of pixels shows.

    Attributes
    ----------
    point
        Name of a body, whose origin is seen, or of a site.
    camera
        Name of a camera of the model, or of the `plane`.
    plane
        Where no camera of the model took the picture.
    """

    point: str
    camera: str
    plane: ImagePlane | None = None

    @property
    def name(self) -> str:
        """Name of the channel."""
        return f"{self.camera}:{self.point}"


def with_pixels(
    label: str,
    sensors: Mapping[str, ArrayLike],
    pixels: Mapping[str, ArrayLike] | None,
    camera: str | ImagePlane | None,
    views: Mapping[str, View] | None,
) -> tuple[dict[str, ArrayLike], dict[str, View]]:
    """Return readings by name, those in pixels too, and what the latter show.

    Parameters
    ----------
    label
        Names the trajectory in messages.
    sensors
        Readings by name.
    pixels
        (n, 2) by point, or by ``CAMERA:POINT`` where `camera` is None.
    camera
        Which saw the points.
    views
        Of readings that are among `sensors` already.
    """
    if not isinstance(sensors, Mapping):
        return sensors, {}  # refused later
    readings, shown = dict(sensors), {k: v for k, v in (views or {}).items() if k in sensors}
    if pixels is None:
        if camera is not None:
            raise ValueError(f"{label}: camera is given, but no pixels")
        return readings, shown
    if not isinstance(pixels, Mapping):
        raise TypeError(f"{label}: pixels must be a mapping from points to (n, 2), got {pixels!r}")
    if not (camera is None or isinstance(camera, str | ImagePlane)):
        raise TypeError(
            f"{label}: camera must be the name of one of the model or an ImagePlane, got {camera!r}"
        )
    for key, seen in pixels.items():
        if not isinstance(key, str):
            raise TypeError(f"{label}: pixels must have names as keys, got {key!r}")
        if isinstance(camera, ImagePlane):
            view = View(key, camera.name, camera)
        elif camera is not None:
            view = View(key, camera)
        else:
            name, colon, point = key.partition(":")
            if not (name and colon and point):
                raise ValueError(
                    f"{label}: pixels[{key!r}] are of no camera: say which saw them, with camera "
                    "or as 'CAMERA:POINT'"
                )
            view = View(point, name)
        if view.name in readings:
            raise ValueError(f"{label}: two channels are named {view.name!r}")
        if np.ndim(seen) != 2 or np.shape(seen)[1] != 2:
            raise ValueError(
                f"{label}: pixels[{key!r}] must be (n, 2), columns and rows of the picture, got "
                f"{np.shape(seen)}"
            )
        readings[view.name], shown[view.name] = seen, view
    return readings, shown


def _two(points: Sequence[ArrayLike]) -> Sequence[ArrayLike]:
    if len(points) != 2:
        raise ValueError(f"two points are needed, got {len(points)}")
    return points


def _vector(label: str, value: ArrayLike, size: int) -> Array:
    array = number_array(label, value)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise ValueError(f"{label} must be {size} finite numbers, got {value!r}")
    return array
