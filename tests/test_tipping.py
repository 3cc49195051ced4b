"""Bodies tip over edges under applied torques, and under nothing less than it takes."""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dashpot import Engine, Material

HALF, MASS, GRAVITY = 0.1, 1.0, 9.81
XML = f"""<mujoco><option gravity="0 0 -{GRAVITY}"/><worldbody>
  <geom name="floor" type="plane" size="5 5 1" friction="2"/>
  <body pos="0 0 {HALF}"><freejoint/>
    <geom name="cube" type="box" size="{HALF} {HALF} {HALF}" mass="{MASS}" friction="2"/>
  </body></worldbody></mujoco>"""


def pitch_under(torque, *, timestep, duration, material=None):
    """Return the pitch (rad) of a cube after `duration` (s) of a torque (N m) on it."""
    model = mujoco.MjModel.from_xml_string(XML)
    model.opt.timestep = timestep
    engine = Engine(model)
    if material:
        engine.set_pair_material("floor", "cube", material)
    data = engine.make_data()
    engine.step(data, nstep=round(0.2 / timestep))  # comes to rest
    data.xfrc_applied[1, 4] = torque
    engine.step(data, nstep=round(duration / timestep))
    w, x, y, z = data.qpos[3:7]
    assert max(abs(x), abs(z)) < 1e-6  # about its own edge
    return 2 * np.arctan2(y, w), engine, data


def pitch_about_edge(torque, duration):
    """Return the pitch (rad) of a cube that turns about its edge without slip."""
    inertia = MASS * (2 * HALF) ** 2 / 6 + MASS * 2 * HALF**2

    def motion(_, state):
        arm = HALF * (np.cos(state[0]) - np.sin(state[0]))  # of the weight
        return [state[1], (torque - MASS * GRAVITY * arm) / inertia]

    return solve_ivp(motion, (0.0, duration), [0.0, 0.0], rtol=1e-10, atol=1e-12).y[0, -1]


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("factor", [1.05, 1.2, 1.5])
@pytest.mark.parametrize("material", [None, Material(stiffness=1e6)], ids=["rigid", "SI"])
def test_cube_tips_about_its_edge_under_a_torque(material, factor, timestep):
    torque = factor * MASS * GRAVITY * HALF
    duration = 0.12 / (factor - 1.0) ** 0.5
    pitch, engine, data = pitch_under(
        torque, timestep=timestep, duration=duration, material=material
    )
    expected = pitch_about_edge(torque, duration)
    # The springs that it leaves push it off, by a part of a step's turn, which grows on the way.
    assert pitch == pytest.approx(expected, rel=0.05)
    energy = engine.energy(data)
    assert energy.total == pytest.approx(MASS * GRAVITY * HALF, abs=1e-3 * energy.work)


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_cube_stands_under_less_than_the_torque_of_its_weight(timestep):
    pitch, _, _ = pitch_under(0.98 * MASS * GRAVITY * HALF, timestep=timestep, duration=2.0)
    assert abs(pitch) < 1e-4
