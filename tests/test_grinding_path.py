"""Paths lie on the surface, with its normals, and the arm reaches them."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from dashpot import grinding
from dashpot.grinding.curves import resampled
from grinding_scenes import CYLINDER, TABLE, TILT, ball_on_cylinder, cell


def test_points_are_on_the_cylinder_and_normals_are_radial():
    _, path = ball_on_cylinder()
    radial = path.points - np.array([0.0, 0.5, 0.05])
    radial[:, 0] = 0.0
    np.testing.assert_allclose(np.linalg.norm(radial, axis=1), 0.2, atol=1e-9)
    np.testing.assert_allclose(path.normals, radial / 0.2, atol=1e-9)
    np.testing.assert_allclose(np.sum(path.tangents * path.normals, axis=1), 0.0, atol=1e-12)
    spacing = np.diff(path.distance)
    assert spacing.max() < 0.00501
    np.testing.assert_allclose(spacing, spacing[0], rtol=1e-3)


def test_the_tip_of_the_arm_is_where_a_tilted_ball_touches():
    """The ball's centre is a radius above the point, its shank at the tilt to the normal."""
    made, path = ball_on_cylinder()
    model = made.rigid.model
    data = mujoco.MjData(model)
    for index in range(0, len(path), 10):
        data.qpos[:] = path.angles[1, index]
        mujoco.mj_kinematics(model, data)
        site = data.site_xmat[made.rigid.tip].reshape(3, 3)
        centre = data.site_xpos[made.rigid.tip] - 0.02 * site[:, 2]
        np.testing.assert_allclose(
            centre, path.points[index] + 0.02 * path.normals[index], atol=1e-6
        )
        assert -site[:, 2] @ path.normals[index] == pytest.approx(math.cos(TILT), abs=1e-6)


def test_joints_stay_within_limits_and_do_not_jump():
    made, path = ball_on_cylinder()
    lower, upper = made.rigid.model.jnt_range.T
    assert (path.angles >= lower).all()
    assert (path.angles <= upper).all()
    assert np.abs(np.diff(path.angles, axis=1)).max() < 0.05


def test_a_raster_covers_its_rectangle_without_corners():
    curve = grinding.raster((0.1, 0.2), (0.08, 0.03), 0.01)
    straight = curve[np.abs(curve[:, 0] - 0.1) < 0.0401]
    strokes = np.unique(straight[:, 1].round(9))
    assert {0.185, 0.195, 0.205, 0.215} <= set(strokes)
    fine = resampled(curve, 5e-4)
    steps = np.diff(fine, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    # Half circles of 5 mm, in eight chords of 22.5 degrees.
    assert np.sum(steps[1:] * steps[:-1], axis=1).min() > math.cos(math.radians(23))


def test_a_mesh_is_ground_where_rays_meet_it(tmp_path):
    file = tmp_path / "wedge.obj"
    corners = [(x, y, z) for x in (-0.2, 0.2) for y in (-0.2, 0.2) for z in (0, 0.1 + 0.25 * x)]
    lines = "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
    faces = "f 2 4 8\nf 2 8 6\nf 1 5 7\nf 1 7 3\nf 1 3 4\nf 1 4 2\nf 5 6 8\nf 5 8 7\n"
    file.write_text(lines + faces + "f 1 2 6\nf 1 6 5\nf 3 7 8\nf 3 8 4\n")
    made = cell(grinding.Work.mesh(file, (0.0, 0.5, 0.1)), imbalance=0.0)
    path = grinding.Path.on_surface(made, grinding.line((-0.05, 0.5), (0.05, 0.5)))
    slope = np.array([-0.25, 0.0, 1.0]) / math.hypot(1.0, 0.25)
    np.testing.assert_allclose(path.normals, np.tile(slope, (len(path), 1)), atol=1e-6)
    np.testing.assert_allclose(path.points[:, 2], 0.2 + 0.25 * path.points[:, 0], atol=1e-6)


def test_any_arm_with_a_named_flange_will_do(tmp_path):
    """A gantry of three slides and three hinges, with motors that the cell replaces."""
    arm = tmp_path / "gantry.xml"
    arm.write_text("""<mujoco><worldbody><body name="x" pos="0 0.5 0.5">
      <joint name="jx" type="slide" axis="1 0 0" range="-1 1" limited="true"/>
      <geom size=".05" mass="2"/>
      <body name="y"><joint name="jy" type="slide" axis="0 1 0"/><geom size=".05" mass="2"/>
      <body name="z"><joint name="jz" type="slide" axis="0 0 1"/><geom size=".05" mass="2"/>
      <body name="a"><joint name="ja" axis="1 0 0"/><geom size=".05" mass="1"/>
      <body name="b"><joint name="jb" axis="0 1 0"/><geom size=".05" mass="1"/>
      <body name="c" quat="0 1 0 0"><joint name="jc" axis="0 0 1"/><geom size=".05" mass="1"/>
        <site name="hand"/></body></body></body></body></body></body></worldbody>
      <actuator><motor joint="jx"/></actuator></mujoco>""")
    made = grinding.Cell(
        grinding.Arm(arm, "hand"),
        grinding.BallNose(0.02, spin=47.0),
        TABLE,
        2e4,
        control=grinding.Control(stiffness=20000.0, damping=2000.0),
    )
    path = grinding.Path.on_surface(made, grinding.line((-0.1, 0.5), (0.1, 0.5)), tilt=TILT)
    plan = grinding.plan(made, path, 50e-6, preston=4.7e-10, max_force=90.0)
    assert plan.met


def test_a_tool_of_the_users_own(tmp_path):
    file = tmp_path / "pads.xml"
    file.write_text("""<mujoco><worldbody><body name="pads">
      <geom type="box" size=".03 .01 .01" pos="0 0 .02" contype="0" conaffinity="0" mass=".3"/>
      <geom name="left" size=".01" pos="-.02 0 .04" mass=".05"/>
      <geom name="right" size=".01" pos=".02 0 .04" mass=".05"/>
      <site name="end" pos="0 0 .05"/></body></worldbody></mujoco>""")
    made = cell(TABLE, tool=grinding.OwnTool(file, 0.005, tip="end"), imbalance=0.0)
    assert len(made.parts.points) == 2
    assert made.material().stiffness == 1e4
    path = grinding.Path.on_surface(made, grinding.line((-0.05, 0.5), (0.05, 0.5)))
    assert path.points[:, 2] == pytest.approx(0.15)
    assert CYLINDER.kind == "cylinder"
