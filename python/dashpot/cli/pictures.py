"""Options of points in pixels: which camera saw them, and what of a picture is unknown."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import mujoco

    from dashpot.calibrate import ImagePlane, Parameter

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_AXES |= {f"-{name}": (-x, -y, -z) for name, (x, y, z) in _AXES.items()}
_KEYS = ("scale", "ruler", "origin", "right", "down", "tilt")
# Around what is stated: a factor, pixels, and radians either way.
_SCALE_RANGE, _ORIGIN_RANGE, _TILT_RANGE = 3.0, 100.0, 0.2


def add_to(options: Any) -> None:
    """Add the options to a group of them."""
    options.add_argument(
        "--camera", metavar="NAME", help="camera of the model that saw what columns u, v hold"
    )
    options.add_argument(
        "--image",
        type=_image,
        metavar="KEY=VALUE,...",
        help="picture in which columns u, v are, where no camera of the model took it. "
        "scale=PIXELS_PER_METRE or ruler=U1/V1/U2/V2/METRES; origin=U/V, where the origin of the "
        "world is seen; right=x and down=-z (default), axes of the world; tilt=RADIANS",
    )


def camera_of(arguments: argparse.Namespace) -> str | ImagePlane | None:
    """Return the camera that the options name; raise ValueError where there are two."""
    if arguments.camera is not None and arguments.image is not None:
        raise ValueError("--camera and --image both say what saw the points; give one of them")
    if arguments.image is None:
        return arguments.camera  # type: ignore[no-any-return]
    from dashpot.calibrate import ImagePlane

    return ImagePlane(**arguments.image)


def parameter_of(
    quantity: str,
    camera: str | ImagePlane | None,
    options: Mapping[str, Any],
    model: mujoco.MjModel,
) -> Parameter:
    """Return a parameter of a picture; its range is round what is stated, where none is given.

    Raises
    ------
    ValueError
        Where no picture is given, or it has no such number.
    """
    from dashpot.calibrate import Parameter
    from dashpot.calibrate.data.views import View
    from dashpot.calibrate.problem.pixels import lens_of
    from dashpot.object_ids import object_id

    if camera is None:
        raise ValueError("there is no picture: say --camera or --image")
    if isinstance(camera, str):
        object_id(model, camera, "camera", "--camera")
        view = View("", camera)
    else:
        view = View("", camera.name, camera)
    lens = lens_of(view, model)
    scale = float(lens.scale[0])
    stated = {
        "scale": (scale, scale / _SCALE_RANGE, scale * _SCALE_RANGE),
        "tilt": _around(lens.tilt, _TILT_RANGE),
        "origin_u": _around(float(lens.origin[0]), _ORIGIN_RANGE),
        "origin_v": _around(float(lens.origin[1]), _ORIGIN_RANGE),
    }
    given = dict(options)
    if "bounds" not in given:
        if quantity not in stated:
            raise ValueError(f"a picture has {', '.join(stated)}, no {quantity!r}")
        now, lower, upper = stated[quantity]
        given = {"start": now, "bounds": (lower, upper), **given}
    return Parameter.image(quantity, view.camera, **given)  # type: ignore[arg-type]


def _around(value: float, either: float) -> tuple[float, float, float]:
    return value, value - either, value + either


def _image(text: str) -> dict[str, Any]:
    """Return the fields of an `ImagePlane`, or raise what argparse reports."""
    fields: dict[str, Any] = {}
    try:
        for part in text.split(","):
            key, _, value = part.strip().partition("=")
            if key not in _KEYS or key in fields:
                raise ValueError(f"{part!r} is none of {', '.join(_KEYS)}, once each")
            fields[key] = _value(key, value)
        ruler = fields.pop("ruler", None)
        if (ruler is None) == ("scale" not in fields):
            raise ValueError("give scale, pixels per metre, or ruler")
        if ruler is not None:
            u1, v1, u2, v2, metres = ruler
            if not (metres > 0.0 and math.hypot(u2 - u1, v2 - v1) > 0.0):
                raise ValueError("a ruler has two ends, and a length > 0 m")
            fields["scale"] = math.hypot(u2 - u1, v2 - v1) / metres
        from dashpot.calibrate import ImagePlane

        ImagePlane(**fields)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: {error}") from None
    return fields


def _value(key: str, text: str) -> Any:
    """Return what is given of a picture."""
    if key in ("right", "down") and text in _AXES:
        return _AXES[text]
    count = {"scale": 1, "tilt": 1, "origin": 2, "ruler": 5}.get(key, 3)
    numbers = tuple(float(word) for word in text.split("/"))
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        shown = "/".join("N" * count)
        raise ValueError(f"{key} is {text!r}, not {shown}{' or an axis' * (count == 3)}")
    return numbers[0] if count == 1 else numbers
