"""A model in millimetres does what it does in metres."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine, law

WALLS = ((0.1, 0), (-0.1, 0), (0, 0.1), (0, -0.1))
SHAPES = (("box", (0.03, 0.02, 0.025)), ("capsule", (0.02, 0.03)), ("sphere", (0.03,)))


def pile(unit: float) -> mujoco.MjModel:
    """Return nine bodies above a corner of walls, in metres times `unit`."""

    def lengths(*values: float) -> str:
        return " ".join(str(float(value * unit)) for value in values)

    rng = np.random.default_rng(3)
    bodies = ""
    for i in range(9):
        kind, size = SHAPES[i % 3]
        x, y = rng.uniform(-0.05, 0.05, 2)
        place = lengths(x, y, 0.05 + 0.07 * i)
        bodies += f"""<body pos="{place}" euler="{10 * i} {20 * i} {7 * i}">
          <freejoint/><geom type="{kind}" size="{lengths(*size)}" mass="{0.2 + 0.1 * i}"/></body>"""
    walls = "".join(
        f'<geom type="plane" pos="{lengths(x, y, 0)}" zaxis="{-x} {-y} 0" size="1 1 1"/>'
        for x, y in WALLS
    )
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option gravity="0 0 {-9.80665 * unit}" ccd_tolerance="{1e-9 * unit}"/>
      <worldbody><geom type="plane" size="1 1 1"/>{walls}{bodies}</worldbody></mujoco>""")


def test_a_pile_falls_alike_in_metres_and_in_millimetres():
    """Hits were those of more than 2 cm/s in either, and what is pressed passed for hit."""
    places = []
    for unit in (1.0, 1000.0):
        # What a user gives in m/s is in the model's own unit.
        engine = Engine(pile(unit), recovery_speed=0.1 * unit)
        data = engine.make_data()
        places.append([])
        for _ in range(15):
            stats = engine.step(data, nstep=10)
            places[-1].append(data.qpos.reshape(-1, 7)[:, :3] / unit)
        assert stats.max_compression > 0.0  # they have met by now
    # Rounding grows in a pile that falls, by ten orders of magnitude in the next 0.3 s.
    np.testing.assert_allclose(places[1], places[0], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("error", [0.005, -0.02])
def test_a_weld_that_is_switched_on_pulls_alike_in_metres_and_in_millimetres(error):
    ways = []
    for unit in (1.0, 1000.0):
        model = mujoco.MjModel.from_xml_string(f"""<mujoco>
          <option gravity="0 0 {-9.80665 * unit}"/><worldbody>
          <body name="load"><joint type="slide" axis="1 0 0"/>
            <geom size="{0.05 * unit}" mass="1"/></body></worldbody>
          <equality><connect name="hold" body1="load" body2="world" anchor="0 0 0" active="false"
            solref="0.05 1"/></equality></mujoco>""")
        engine = Engine(model, recovery_speed=0.1 * unit)
        data = engine.make_data()
        data.qpos[0] = error * unit
        engine.step(data)
        data.eq_active[0] = 1
        ways.append([])
        for _ in range(20):
            engine.step(data, nstep=5)
            ways[-1].append(data.qpos[0] / unit)
    np.testing.assert_allclose(ways[1], ways[0], rtol=0.0, atol=1e-9)
    # A critically damped spring, whose row is followed exactly but for its weight, across.
    _, damping = law.solref_to_spring_at_rest((0.05, 1.0))
    turn = 0.5 * damping * 0.01 * np.arange(1, 21)
    np.testing.assert_allclose(
        ways[0], error * (1.0 + turn) * np.exp(-turn), atol=1e-3 * abs(error)
    )
