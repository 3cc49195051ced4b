"""Friction of plastic impacts: restitution 0 is not the limit of small restitution."""

import mujoco
import pytest

import dashpot

BALL = """<mujoco><option timestep=".001"/><worldbody>
  <geom name="floor" type="plane" size="5 5 .1" friction=".3"/>
  <body pos="0 0 .15"><freejoint/><geom name="ball" size=".05" mass=".1" friction=".3"/></body>
  </worldbody></mujoco>"""


def speed_left(restitution, geoms=None):
    """Return the speed along the floor, m/s, of a ball after it hits at 1.4 m/s and slides.

    The contact is of 8e3 N/m, by the pair's material or by those of `geoms`.
    """
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL))
    if geoms:
        side = dashpot.Material(8e3 * len(geoms), restitution=restitution, friction=0.3)
        for geom in geoms:
            engine.set_material(geom, side)
    else:
        material = dashpot.Material(8e3, restitution=restitution, friction=0.3)
        engine.set_pair_material("ball", "floor", material)
    data = engine.make_data()
    data.qvel[:3] = 2.0, 0.0, -0.2
    engine.step(data, 140)  # it falls for 124 ms
    return data.qvel[0]


def test_with_0_what_slides_loses_as_much_speed_as_with_2_to_3_hundredths():
    """As `Material` says: with much less than that it loses less."""
    lost = {e: 2.0 - speed_left(e) for e in (0.0, 0.02, 0.03, 1e-3, 1e-6)}
    # Friction takes mu times what the floor gives, which stops the fall of 140 ms from 0.2 m/s.
    assert lost[0.0] == pytest.approx(0.3 * (0.2 + 9.81 * 0.14), rel=1e-3)
    assert lost[0.02] < lost[0.0] < lost[0.03]
    assert lost[1e-3] < 0.6 * lost[0.0]
    assert lost[1e-6] < 0.2 * lost[0.0]


@pytest.mark.parametrize("geoms", [["ball"], ["ball", "floor"]])
def test_materials_of_geoms_do_with_0_what_that_of_the_pair_does(geoms):
    """They combined to a damping ratio, of which friction did not know that it is that of 0."""
    assert speed_left(0.0, geoms) == pytest.approx(speed_left(0.0), abs=1e-12)
