"""What a drive pushes off its middle jams between guides once friction and corners bar its way."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dashpot import Engine

LENGTH, WIDTH, PLAY, MASS = 0.2, 0.15, 0.0005, 2.0  # half of it, half of it, m; kg
FRICTION, PUSH = 0.5, 20.0


def pushed(timestep: float, off_middle: float) -> tuple[Engine, mujoco.MjData]:
    """Return a drawer after half a second of a push from rest."""
    guide = f'type="box" size="1 .02 .1" friction="{FRICTION}"'
    beside = WIDTH + PLAY + 0.02
    engine = Engine(
        mujoco.MjModel.from_xml_string(
            f"""<mujoco><option timestep="{timestep}"/><worldbody>
            <geom {guide} pos="0 {beside} 0"/><geom {guide} pos="0 {-beside} 0"/>
            <body><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>
              <joint axis="0 0 1"/>
              <geom type="box" size="{LENGTH} {WIDTH} .05" mass="{MASS}" friction="{FRICTION}"/>
            </body>
            </worldbody></mujoco>"""
        )
    )
    data = engine.make_data()
    data.qfrc_applied[:] = PUSH, 0.0, -PUSH * off_middle
    engine.step(data, nstep=round(0.5 / timestep))
    return engine, data


def jammed_after(timestep: float, off_middle: float) -> float:
    """Return how far (m) a drawer goes until it jams."""
    _, data = pushed(timestep, off_middle)
    assert abs(data.qvel[0]) < 1e-6
    return float(data.qpos[0])


def mean_way(timestep: float, off_middle: float) -> float:
    """Return the mean over pushes that differ by a millimetre or two: each goes by its bounces."""
    places = off_middle + np.array([-3e-3, -1e-3, 1e-3, 3e-3])
    return float(np.mean([jammed_after(timestep, place) for place in places]))


@pytest.mark.parametrize(("off_middle", "timestep"), [(0.42, 0.002), (0.6, 0.002), (0.6, 0.005)])
def test_a_drawer_jams_about_as_soon_as_at_short_steps(off_middle, timestep) -> None:
    """It begins at rest beside its guides, which it hits as the push has it turn.

    Hits of a body that a load has just set in motion count as hits, not as presses, in which
    friction that turns round is lost: it went two to three times as far. Bounces are not the same
    at longer steps.
    """
    assert mean_way(timestep, off_middle) < 1.4 * mean_way(0.00025, off_middle)


@pytest.mark.parametrize("timestep", [0.002, 0.005])
def test_a_drawer_that_is_pushed_nearer_to_its_middle_slides(timestep) -> None:
    """Two corners, 2 l apart along the way, are pressed with F e / 2 l each.

    It jams where their friction is more than the push: at e = l / mu, from 0.4 m on.
    """
    off_middle = 0.35
    engine, data = pushed(timestep, off_middle)
    before = data.qvel[0]
    engine.step(data, nstep=round(0.1 / timestep))
    lever = LENGTH - WIDTH * PLAY / LENGTH  # as it tilts by its play
    gained = (PUSH - FRICTION * PUSH * off_middle / lever) / MASS * 0.1
    assert data.qvel[0] - before == pytest.approx(gained, rel=1e-3)
