"""Fixtures that several files of tests share."""

from __future__ import annotations

import mujoco
import pytest

from query_geoms import hull_mesh, hull_points, two_of_each


@pytest.fixture(scope="module")
def zoo():
    """Two free bodies of each convex type, and a plane."""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset>{hull_mesh(hull_points())}</asset><worldbody>
        <geom name="plane" type="plane" size="1 1 1"/>{two_of_each()}</worldbody></mujoco>"""
    )
