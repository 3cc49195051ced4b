"""Depth after Preston: closed forms of a straight pass, volumes, discs, fields that recede."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dashpot import grinding
from dashpot.grinding.motion import Motion
from dashpot.grinding.passes import receded
from dashpot.grinding.removal import track_width
from dashpot.grinding.simulation import Simulator
from grinding_scenes import PRESTON, TABLE, TILT, cell, steady

FOOTPRINT = 0.005


def even_pass(feed=0.1, force=50.0, slide=3.0, points=1, timestep=1e-3, length=0.2):
    """Return a pass at constant feed, force and sliding speed along x over a plane."""
    time = np.arange(0.0, length / feed, timestep)
    place = np.zeros((len(time), points, 3))
    place[:, :, 0] = (feed * (time + timestep / 2) - length / 2)[:, None]
    shape = (len(time), points)
    normal = np.zeros_like(place)
    normal[..., 2] = 1.0
    return grinding.Pass(
        time,
        np.full(shape, force / points),
        np.zeros(shape),
        place,
        normal,
        np.full(shape, slide),
        np.zeros((len(time), 6)),
        np.zeros((len(time), 6)),
        np.zeros((len(time), 3)),
    )


def test_a_straight_pass_leaves_prestons_depth():
    """In the middle of the track: preston F v / u times 8 / (3 pi a); across, the chord's power."""
    found = even_pass()
    across = np.array([0.0, 0.4, 0.8, 1.0]) * FOOTPRINT
    points = np.c_[np.zeros(4), across, np.zeros(4)]
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    depth = grinding.depth_along(found, points, up, preston=PRESTON, footprint=FOOTPRINT)
    middle = PRESTON * 50.0 * 3.0 / 0.1 / track_width(FOOTPRINT)
    assert track_width(FOOTPRINT) == pytest.approx(3 * math.pi * FOOTPRINT / 8)
    chord = (1 - (across / FOOTPRINT) ** 2) ** 1.5
    # Sums over steps of a fiftieth of the patch.
    np.testing.assert_allclose(depth, middle * chord, rtol=3e-4, atol=1e-12)


def test_volume_is_the_integral_of_preston_s_law():
    found = even_pass(length=0.1)
    volume = PRESTON * 50.0 * 3.0 * 1.0
    assert grinding.removed_volume(found, PRESTON) == pytest.approx(volume, rel=1e-9)
    field = grinding.Work.height_field(np.zeros((41, 161)), (0.16, 0.04))
    worn = grinding.DepthMap.of_height_field(field).with_pass(
        found, preston=PRESTON, footprint=FOOTPRINT
    )
    assert worn.volume == pytest.approx(volume, rel=1e-9)
    left = worn.receded(field)
    assert left.heights is not None
    assert -left.heights.sum() * 1e-6 == pytest.approx(volume, rel=1e-9)


def test_what_a_patch_has_beyond_the_edge_is_not_removed():
    found = even_pass(length=0.1)
    # Half of the track lies on the part.
    field = grinding.Work.height_field(np.zeros((81, 321)), (0.16, 0.04), (0.0, 0.02, 0.0))
    worn = grinding.DepthMap.of_height_field(field).with_pass(
        found, preston=PRESTON, footprint=FOOTPRINT
    )
    # Nodes of a tenth of the patch.
    whole = grinding.removed_volume(found, PRESTON)
    assert worn.volume == pytest.approx(whole / 2, rel=0.02)


def test_points_of_a_disc_are_springs_side_by_side():
    """Flat they share the load; at a tilt of 1 degree each has k_i (d + x sin(tilt))."""
    stiffness, tilt = 2e4, math.radians(1)
    disc = grinding.Disc(0.03)
    made = cell(TABLE, tool=disc, stiffness=stiffness, imbalance=0.0, damping=0.0)
    forces = {}
    for angle in (0.0, tilt):
        path = grinding.Path.on_surface(made, grinding.line((-0.06, 0.5), (0.06, 0.5)), lead=angle)
        command = steady(path, force=60.0, stiffness=stiffness, feed=(0.02, 0.02))
        found = Simulator(Motion(made, path)).run([command])[0]
        middle = len(found.time) // 2
        forces[angle] = found.force[middle]
        overlap = 2 * (0.15 - found.place[middle, :, 2])
        share = stiffness / len(disc.places)
        np.testing.assert_allclose(found.force[middle], share * overlap, rtol=1e-3)
        # All of the load, against what the arm is told to bear.
        assert found.force[middle].sum() == pytest.approx(60.0, rel=0.03)
        assert found.force[middle].sum() == pytest.approx(found.total[middle], rel=1e-3)
    # Along the way the lead lifts one side: x sin(tilt) of a point x ahead.
    lean = forces[tilt] - forces[tilt].mean()
    amplitude = stiffness / len(disc.places) * 0.03 * math.sin(tilt)
    # The arm gives way by some hundredths of a degree under the moment.
    assert lean.max() == pytest.approx(amplitude, rel=0.1)
    assert lean.min() == pytest.approx(-amplitude, rel=0.1)
    assert np.ptp(forces[0.0]) < 0.2 * amplitude


def test_a_tilted_disc_removes_at_its_edge():
    made = cell(TABLE, tool=grinding.Disc(0.03, spin=20.0), imbalance=0.0)
    depths = []
    for tilt in (-math.radians(1), math.radians(1)):
        path = grinding.Path.on_surface(made, grinding.line((-0.06, 0.5), (0.06, 0.5)), tilt=tilt)
        command = steady(path, force=60.0, stiffness=2e4, feed=(0.1, 0.1))
        found = Simulator(Motion(made, path)).run([command])[0]
        beside = np.array([[0.0, 0.5 + 0.026, 0.15], [0.0, 0.5 - 0.026, 0.15]])
        up = np.tile([0.0, 0.0, 1.0], (2, 1))
        left, right = grinding.depth_along(
            found, beside, up, preston=1e-9, footprint=made.tool.footprint
        )
        depths.append(left / right)
    assert depths[1] > 1.15
    assert depths[0] < 1 / 1.15


def curved_field(curvature):
    x, y = np.linspace(-0.12, 0.12, 121), np.linspace(-0.03, 0.03, 31)
    heights = 0.02 - curvature * np.broadcast_to(x**2, (len(y), len(x)))
    return grinding.Work.height_field(heights, (0.24, 0.06), (0.0, 0.5, 0.1))


@pytest.mark.parametrize("curvature", [0.3, -0.3])
def test_force_on_a_height_field_is_that_on_one_spring(curvature):
    """Convex ones have edges that stand out, over which no facet is the nearest alone."""
    made = cell(curved_field(curvature), imbalance=0.0, tool=grinding.BallNose(0.02))
    path = grinding.Path.on_surface(made, grinding.line((-0.07, 0.5007), (0.07, 0.5007)))
    command = steady(path, force=50.0, stiffness=2e4, feed=(0.1, 0.1), ramp=0.03)
    found = Simulator(Motion(made, path)).run([command])[0]
    middle = slice(len(found.time) // 3, 2 * len(found.time) // 3)
    np.testing.assert_allclose(found.total[middle], 50.0, rtol=5e-3)


def test_several_passes_take_prestons_volume_off_a_height_field():
    work = curved_field(0.3)
    tool = grinding.BallNose(0.02, spin=47.0, footprint=0.006)
    made = cell(work, imbalance=0.0, tool=tool, timestep=0.005)
    path = grinding.Path.on_surface(made, grinding.line((-0.03, 0.5007), (0.03, 0.5007)), tilt=TILT)
    plan = grinding.plan(made, path, 60e-6, preston=PRESTON, max_force=90.0, passes=2)
    assert plan.met
    assert len(plan.passes) == 2
    last = plan.passes[-1]
    left, _ = receded(last.cell, last.path, last.found, PRESTON)
    assert work.heights is not None
    assert left.part.heights is not None
    cell_area = 0.002**2
    lost = (work.heights - left.part.heights).sum() * cell_area
    # The law itself, from the forces and speeds of both simulations.
    removed = sum(
        PRESTON * each.found.timestep * (each.found.force * each.found.slide).sum()
        for each in plan.passes
    )
    assert lost == pytest.approx(removed, rel=5e-3)
    # The path follows the surface down, by half of the depth a pass.
    heights = [each.path.points[len(each.path) // 2, 2] for each in plan.passes]
    np.testing.assert_allclose(np.diff(heights), -30e-6, rtol=0.05)
