"""Where cameras see points of the model: columns and rows of pictures.

As OpenCV counts them: u to the right, v down, from the middle of the pixel in the upper left corner
on. The middle of a picture of W columns is (W - 1) / 2. A point that a camera of the model has at
(x, y, z), x to the right, y up and z > 0 ahead, is seen at

    (u, v) = origin + R(tilt) (f_u x / z, -f_v y / z)

and without the division by z where the camera is orthographic.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot.calibrate.data.views import View
from dashpot.calibrate.problem.observables import Sensor
from dashpot.calibrate.problem.sensing import Sensing
from dashpot.object_ids import id_of_name

Array = NDArray[np.float64]

_BODY, _SITE, _CAMERA = (
    mujoco.mjtObj.mjOBJ_BODY,
    mujoco.mjtObj.mjOBJ_SITE,
    mujoco.mjtObj.mjOBJ_CAMERA,
)


@dataclass(frozen=True)
class Lens:
    """How directions become pixels.

    Attributes
    ----------
    scale
        (2,) of columns and rows: pixels of focal length; where there is no perspective, per metre.
    origin
        (2,) pixel of the optical axis; of a plane, of the origin of the world.
    tilt
        rad.
    perspective
        Whether what is farther away is smaller.
    """

    scale: Array
    origin: Array
    tilt: float = 0.0
    perspective: bool = False


def lens_of(view: View, model: mujoco.MjModel) -> Lens:
    """Return how a camera of a model, or a plane, sees."""
    if view.plane is not None:
        return Lens(np.full(2, view.plane.scale), np.array(view.plane.origin), view.plane.tilt)
    camera = id_of_name(model, _CAMERA, view.camera)
    resolution = model.cam_resolution[camera].astype(np.float64)
    middle = 0.5 * (resolution - 1.0)
    fovy = float(model.cam_fovy[camera])
    if model.cam_projection[camera] == mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC:
        return Lens(np.full(2, resolution[1] / fovy), middle)
    size = model.cam_sensorsize[camera].astype(np.float64)
    if size.all():
        focal, shift = model.cam_intrinsic[camera].astype(np.float64).reshape(2, 2)
        return Lens(focal * resolution / size, middle - shift * resolution / size, 0.0, True)
    focal = 0.5 * resolution[1] / np.tan(0.5 * np.radians(fovy))
    return Lens(np.full(2, focal), middle, 0.0, True)


def check_view(view: View, model: mujoco.MjModel, label: str) -> None:
    """Raise ValueError beginning with `label` where a model has no such point or camera."""
    if id_of_name(model, _BODY, view.point) < 0 and id_of_name(model, _SITE, view.point) < 0:
        known = [model.body(i).name for i in range(1, model.nbody)]
        known += [model.site(i).name for i in range(model.nsite)]
        raise ValueError(
            f"{label}: the model has no body or site {view.point!r}; it has "
            f"{', '.join(name for name in known if name)}"
        )
    if view.plane is not None:
        return
    camera = id_of_name(model, _CAMERA, view.camera)
    if camera < 0:
        known = [model.camera(i).name for i in range(model.ncam)]
        raise ValueError(
            f"{label}: the model has no camera {view.camera!r}; it has "
            f"{', '.join(known) or 'none: give an ImagePlane'}"
        )
    if model.cam_mode[camera] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED:
        raise ValueError(f"{label}: camera {view.camera!r} follows a body; its mode is not 'fixed'")
    if (model.cam_resolution[camera] <= 1).any():
        raise ValueError(
            f"{label}: camera {view.camera!r} has no resolution; the MJCF says it in pixels, as in "
            'resolution="640 480"'
        )


def check_in_picture(view: View, seen: Array, model: mujoco.MjModel, label: str) -> None:
    """Raise ValueError beginning with `label` where a point was seen beyond the picture."""
    if view.plane is not None:
        return
    size = model.cam_resolution[id_of_name(model, _CAMERA, view.camera)]
    beyond = np.argwhere((seen < -0.5) | (seen > size - 0.5))
    if beyond.size:
        frame, axis = (int(i) for i in beyond[0])
        raise ValueError(
            f"{label}: pixels of {view.point!r} in frame {frame} are at {seen[frame]}, beyond the "
            f"{size[0]} x {size[1]} of camera {view.camera!r}; {'uv'[axis]} counts from "
            f"{('the left', 'above')[axis]}, and NaN stands for what was not seen"
        )


def seen_sensor(model: mujoco.MjModel, view: View, label: str) -> Sensor:
    """Return a point in pixels as a sensor; raise ValueError where a model has it not."""
    check_view(view, model, label)
    return Sensor(view.name, -1, 2, False, view)


def with_deviations_of_pixels(
    sigma: Mapping[str, tuple[float, ...]], views: Mapping[str, View]
) -> dict[str, tuple[float, ...]]:
    """Return standard deviations by name, those of ``"pixels"`` for each point without its own."""
    result = dict(sigma)
    of_all = result.pop("pixels", None)
    if of_all is not None:
        result = {**dict.fromkeys(views, of_all), **result}
    return result


def is_seen_point(model: mujoco.MjModel, name: str) -> bool:
    """Whether a name is that of a channel of pixels, by a camera that nothing more is known of."""
    _, colon, point = name.partition(":")
    return bool(colon) and max(id_of_name(model, kind, point) for kind in (_BODY, _SITE)) >= 0


def bodies_of(view: View, model: mujoco.MjModel) -> list[int]:
    """Return the bodies whose poses say where a point is seen: that of the point, the camera's."""
    found = [place_of(view, model)[0]]
    if view.plane is None:
        found.append(int(model.cam_bodyid[id_of_name(model, _CAMERA, view.camera)]))
    return found


def place_of(view: View, model: mujoco.MjModel) -> tuple[int, Array]:
    """Return the body of a point, and where it is in the body's frame, m."""
    body = id_of_name(model, _BODY, view.point)
    if body >= 0:
        return body, np.zeros(3)
    site = id_of_name(model, _SITE, view.point)
    return int(model.site_bodyid[site]), np.array(model.site_pos[site])


def pixels(view: View, poses: Mapping[int, Array], sensing: Sensing) -> Array:
    """Return (items, rows, 2) columns and rows of a point; NaN where it is behind the camera.

    Parameters
    ----------
    view
        The point and camera.
    poses
        (items, rows, 7) by body.
    sensing
        Of the items, with their models: parameters may move what a camera is.
    """
    models = sensing.models
    places = [place_of(view, model) for model in models]
    point = _placed(poses[places[0][0]], np.array([offset for _, offset in places]))
    lenses = [lens_of(view, model) for model in models]
    if view.plane is not None:
        away = point @ np.array([view.plane.right, view.plane.down]).T
    else:
        ahead = in_camera(view, point, poses, models)
        away = ahead[..., :2] * [1.0, -1.0]
        if lenses[0].perspective:
            depth = np.where(ahead[..., 2:] < 0.0, -ahead[..., 2:], np.nan)
            away = away / depth
    scale = np.array([lens.scale for lens in lenses])
    origin = np.array([lens.origin for lens in lenses])
    tilt = np.array([lens.tilt for lens in lenses])
    given = sensing.of("scale", view.camera)
    if given is not None:
        scale = scale * (given / scale[:, 0])[:, None]
    for axis, quantity in enumerate(("origin_u", "origin_v")):
        value = sensing.of(quantity, view.camera)  # type: ignore[arg-type]
        if value is not None:
            origin[:, axis] = value
    turned = sensing.of("tilt", view.camera)
    if turned is not None:
        tilt = turned
    u, v = np.moveaxis(away * scale[:, None], -1, 0)
    cosine, sine = np.cos(tilt)[:, None], np.sin(tilt)[:, None]
    turned_uv = np.stack([cosine * u - sine * v, sine * u + cosine * v], axis=-1)
    return np.asarray(turned_uv + origin[:, None])


def in_camera(
    view: View, point: Array, poses: Mapping[int, Array], models: Sequence[mujoco.MjModel]
) -> Array:
    """Return points (items, rows, 3) in the frame of a camera of the models: x right, y up, -z."""
    camera = id_of_name(models[0], _CAMERA, view.camera)
    carrier = poses[int(models[0].cam_bodyid[camera])]
    eye = _placed(carrier, np.array([model.cam_pos[camera] for model in models]))
    own = np.array([model.cam_quat[camera] for model in models])
    own /= np.linalg.norm(own, axis=-1, keepdims=True)
    in_body = _turned(_inverse(carrier[..., 3:]), point - eye)
    return _turned(_inverse(own)[:, None], in_body)


def _placed(poses: Array, offset: Array) -> Array:
    """Return (items, rows, 3) where points (items, 3) of bodies are, m."""
    if not offset.any():
        return poses[..., :3]
    return np.asarray(poses[..., :3] + _turned(poses[..., 3:], offset[:, None]))


def _inverse(quaternion: Array) -> Array:
    return quaternion * [1.0, -1.0, -1.0, -1.0]


def _turned(quaternion: Array, vector: Array) -> Array:
    """Return vectors turned by unit quaternions; both broadcast."""
    w, axis = quaternion[..., :1], quaternion[..., 1:]
    across = 2.0 * np.cross(axis, vector)
    return np.asarray(vector + w * across + np.cross(axis, across))
