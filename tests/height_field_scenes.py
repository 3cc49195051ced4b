"""A height field with one free body of each convex type, its prisms, and their distances."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np
from scipy.optimize import lsq_linear
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from query_geoms import CONVEX, hull_mesh, hull_points, prism_corners, shape
from query_scenes import place
from scene import free_body

ROWS, COLUMNS = 7, 5
HALF_X, HALF_Y, ELEVATION, BASE = 0.3, 0.5, 0.2, 0.1
SIZE = {
    "sphere": (0.05,),
    "capsule": (0.03, 0.08),
    "cylinder": (0.05, 0.06),
    "ellipsoid": (0.09, 0.05, 0.03),
    "box": (0.08, 0.04, 0.05),
}


def make_model(heights, *, moving=False, pose='pos=".1 -.2 .3" euler="10 -20 30"'):
    """Make a height field, and one free body of each convex type with a geom of that name."""
    heights = np.asarray(heights)
    rows, columns = heights.shape
    bodies = "".join(free_body(kind, shape(kind, SIZE), (0, 0, 9)) for kind in CONVEX)
    hills = '<geom name="hills" type="hfield" hfield="hills" density="100" {}/>'
    world = (
        f'<body name="hills"><freejoint/>{hills.format("")}</body>'
        if moving
        else hills.format(pose)
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0"/>
        <asset>{hull_mesh(hull_points(20, (0.08, 0.06, 0.05)))}
        <hfield name="hills" nrow="{rows}" ncol="{columns}"
         size="{HALF_X} {HALF_Y} {ELEVATION} {BASE}"/></asset>
        <worldbody>{world}{bodies}</worldbody></mujoco>"""
    )
    # Heights are single precision in the model; references use the same rounded heights.
    model.hfield_data[:] = heights.ravel()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def rough(seed=0):
    return np.random.default_rng(seed).random((ROWS, COLUMNS))


def prisms(model, data):
    """Corners (n, 6, 3) in the world of every prism."""
    heights = model.hfield_data.astype(float).reshape(model.hfield_nrow[0], model.hfield_ncol[0])
    pose = data.geom("hills")
    local = prism_corners(model.hfield_size[0], heights)
    return pose.xpos + local @ pose.xmat.reshape(3, 3).T


def place_on_hills(model, data, name, position, rotation):
    """Put a geom at a pose in the frame of the height field."""
    hills = data.geom("hills")
    frame = hills.xmat.reshape(3, 3)
    place(model, data, name, hills.xpos + frame @ position, frame @ rotation)


def random_place(model, data, rng, name, spread=0.2):
    position = rng.normal(size=3) * spread + (0, 0, 0.15)
    place_on_hills(model, data, name, position, Rotation.random(random_state=rng).as_matrix())


def core(model, data, kind):
    """Corners (n, 3) of a polytope's core in the world, and the radius that sweeps it."""
    size = SIZE.get(kind)
    if kind == "sphere":
        local, radius = np.zeros((1, 3)), size[0]
    elif kind == "capsule":
        local, radius = np.array([(0, 0, -size[1]), (0, 0, size[1])]), size[0]
    elif kind == "box":
        local, radius = np.array(list(itertools.product((-1, 1), repeat=3))) * size, 0.0
    else:
        local, radius = model.mesh_vert.astype(float), 0.0
    pose = data.geom(kind)
    return pose.xpos + local @ pose.xmat.reshape(3, 3).T, radius


def convex_distance(points):
    """Signed distance of the origin from the convex hull of points (n, 3).

    Outside: the least norm of convex combinations, by non-negative least squares (``nnls`` of SciPy
    1.15 is wrong in one of ten) with a row that asks for weights of some sum. Whatever sum t they
    have then, |P w|^2 / t^2 is least, since it does not depend on t. Inside: the nearest facet, by
    Qhull.
    """
    size = np.abs(points).max()
    system = np.vstack((points.T, np.full(len(points), size)))
    weights = lsq_linear(system, (0, 0, 0, size), (0, np.inf), method="bvls", tol=1e-14).x
    outside = np.linalg.norm(weights @ points) / weights.sum()
    return outside if outside > 1e-7 * size else ConvexHull(points).equations[:, 3].max()
