"""Scenes of contact queries, poses of single geoms, and support functions of convex shapes."""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

# Rounding of positions of about 0.1 m through a few hundred operations.
ROUNDING = 1e-13


def scene(*geoms, gravity="0 0 -9.81"):
    """Make a model with one free body per MJCF geom; planes go to the world."""
    bodies = "".join(
        geom if 'type="plane"' in geom else f"<body><freejoint/>{geom}</body>" for geom in geoms
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="{gravity}"/><worldbody>{bodies}</worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def geom(name, kind, size, extra=""):
    return f'<geom name="{name}" type="{kind}" size="{size}" {extra}/>'


def place(model, data, name, position, rotation=None):
    """Put a geom, and only the geom, at a pose."""
    index = model.geom(name).id
    data.geom_xpos[index] = position
    data.geom_xmat[index] = (np.eye(3) if rotation is None else rotation).ravel()


def support(model, data, name, direction):
    """Furthest point of a geom along a unit direction, written from the shapes' definitions."""
    index = model.geom(name).id
    position, rotation = data.geom_xpos[index], data.geom_xmat[index].reshape(3, 3)
    size, d = model.geom_size[index], rotation.T @ direction
    kind = name.rstrip("12")
    if kind == "sphere":
        local = size[0] * d
    elif kind == "capsule":
        local = size[0] * d + [0, 0, np.copysign(size[1], d[2])]
    elif kind == "cylinder":
        radial = np.hypot(*d[:2]) or 1.0
        local = np.append(size[0] * d[:2] / radial, np.copysign(size[1], d[2]))
    elif kind == "ellipsoid":
        local = size**2 * d / np.linalg.norm(size * d)
    elif kind == "box":
        local = np.copysign(size, d)
    else:
        vertices = model.mesh_vert.astype(float)
        local = vertices[np.argmax(vertices @ d)]
    return position + rotation @ local


def directional(model, data, name1, name2, normal):
    """Gap along a direction: a lower bound of the signed distance for every direction."""
    return normal @ (support(model, data, name2, -normal) - support(model, data, name1, normal))


def random_pair(model, data, rng, name1, name2, spread):
    for name in (name1, name2):
        place(
            model,
            data,
            name,
            rng.normal(size=3) * spread,
            Rotation.random(random_state=rng).as_matrix(),
        )
