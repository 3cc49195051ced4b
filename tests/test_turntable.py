"""What rolls or lies on flat ends, faces and fields: a turntable, energy, rest in a groove."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine

GRAVITY = 9.81
BALL = 0.05  # m
FLAT = {
    "box": 'type="box" size="1 1 0.05" pos="0 0 -0.05"',
    "cylinder": 'type="cylinder" size="1 0.05" pos="0 0 -0.05"',
    "field": 'type="hfield" hfield="field"',
    "plane": 'type="plane" size="1 1 0.1"',
}
FIELD = '<asset><hfield name="field" nrow="9" ncol="9" size="1 1 .1 .1"/></asset>'


@pytest.mark.parametrize("timestep", [0.002, 0.005])
@pytest.mark.parametrize("rate", [3.0, 20.0])  # rad/s
@pytest.mark.parametrize("table", ["box", "cylinder"])
def test_a_ball_circles_on_a_turntable_at_two_sevenths_of_its_rate(table, rate, timestep):
    """A ball that rolls without slip has the velocity v' = (2/7) Omega x v: a circle."""
    # What the table is so heavy for: it keeps its rate.
    model = mujoco.MjModel.from_xml_string(f"""
<mujoco><option timestep="{timestep}"/><default><geom friction="1"/></default><worldbody>
  <body><joint type="hinge" axis="0 0 1" armature="1e4"/><geom {FLAT[table]} mass="10"/></body>
  <body pos="0.3 0 {BALL}"><freejoint/><geom size="{BALL}" mass="0.1"/></body>
</worldbody></mujoco>""")
    engine = Engine(model)
    data = engine.make_data()
    circling, radius = 2.0 / 7.0 * rate, 0.2
    speed = circling * radius
    slip = rate * 0.3 - speed  # of the table beneath the ball, along y
    data.qvel[:] = [rate, 0.0, speed, 0.0, slip / BALL, 0.0, 0.0]
    errors = []
    while data.time < 2.0:
        engine.step(data)
        angle = circling * data.time
        place = 0.3 + radius * (np.cos(angle) - 1.0), radius * np.sin(angle)
        errors.append(np.hypot(data.qpos[1] - place[0], data.qpos[2] - place[1]))
    # Of second order in the turn in a step: an angle of (Omega H)^2 / 12 over the whole way.
    # And a micrometre for the weight that comes on in the first step.
    assert max(errors) < 1e-6 + speed * 2.0 * (rate * timestep) ** 2 / 12.0


@pytest.mark.parametrize("friction", [0.0, 1.0])
@pytest.mark.parametrize("ground", ["plane", "box", "cylinder", "field"])
def test_a_ball_with_an_eccentric_mass_keeps_its_energy(ground, friction):
    """It gained a third in 3 s where contacts did not follow what went far in a step of 5 ms."""
    model = mujoco.MjModel.from_xml_string(
        f"""
<mujoco><option timestep="0.005"/>{FIELD}
  <default><geom friction="{friction} 0 0"/></default><worldbody>
  <geom {FLAT[ground].replace('"1 1 0.05"', '"9 9 .05"').replace('"1 0.05"', '"9 .05"')}/>
  <body pos="0 0 .03"><freejoint/><geom size=".03" mass=".1"/>
    <geom size=".01" pos=".02 0 0" mass=".1" contype="0" conaffinity="0"/></body>
</worldbody></mujoco>""".replace('size="1 1 .1 .1"', 'size="9 9 .1 .1"')
    )
    engine = Engine(model)
    data = engine.make_data()
    data.qvel[3:] = [30.0, 20.0, 10.0]
    if friction:
        data.qvel[:3] = [0.6, -0.9, 0.0]
    engine.step(data)
    start = engine.energy(data)
    mechanical = []
    for _ in range(600):
        engine.step(data)
        mechanical.append(engine.energy(data).mechanical)
    # Of second order in the turn in a step, 0.19 rad: 0.19^2 / 12. Slip takes some of it.
    assert max(mechanical) - start.mechanical < 0.003 * start.kinetic
    assert mechanical[-1] - start.mechanical > -0.02 * start.kinetic
    assert data.qpos[2] == pytest.approx(0.03, abs=1e-4)


def rock(ground, timestep):
    """Return the height and the energies of an eccentric ellipsoid after 1 s without friction."""
    model = mujoco.MjModel.from_xml_string(f"""
<mujoco><option timestep="{timestep}"/><default><geom friction="0"/></default><worldbody>
  <geom {ground}/><body pos="0 0 .05"><freejoint/>
    <geom type="ellipsoid" size=".05 .05 .05" mass=".2"/>
    <geom size=".01" pos=".03 0 0" mass=".1" contype="0" conaffinity="0"/></body>
</worldbody></mujoco>""")
    engine = Engine(model)
    data = engine.make_data()
    data.qvel[4] = 10.0
    start = engine.energy(data)
    engine.step(data, nstep=round(1.0 / timestep))
    mechanical = engine.energy(data).mechanical
    # Of the motion MuJoCo's least friction, 1e-5, takes less than a thousandth.
    assert mechanical == pytest.approx(start.mechanical, abs=2e-3 * start.kinetic)
    assert data.qpos[2] == pytest.approx(0.05, abs=1e-5)
    return data.qpos[2], mechanical


@pytest.mark.parametrize("timestep", [0.0005, 0.002])
@pytest.mark.parametrize("size", [0.2, 9.0])
@pytest.mark.parametrize("shape", ["box", "cylinder"])
def test_an_ellipsoid_rocks_on_what_is_flat_as_on_a_plane(shape, size, timestep):
    """Points that a search left open by its tolerance took a fifth of its energy in 5 s."""
    extent = {"box": f"{size} {size} .1", "cylinder": f"{size} .1"}[shape]
    of_plane = rock('type="plane" size="9 9 .1"', timestep)
    of_shape = rock(f'type="{shape}" size="{extent}" pos="0 0 -.1"', timestep)
    # MuJoCo's gap of an ellipsoid over a plane is rounded at 0.1 m, 1e-17, and 2,000 steps add up.
    assert of_shape == pytest.approx(of_plane, rel=1e-9)


def grooved_field(slope, count=21):
    """Return a model's field (XML asset and geom) whose height is slope |x|, 1 m to all sides."""
    x = np.abs(np.linspace(-1.0, 1.0, count))
    heights = " ".join(map(repr, map(float, np.tile(x, count))))
    return (
        f'<asset><hfield name="groove" nrow="{count}" ncol="{count}" size="1 1 {slope} .1"'
        f' elevation="{heights}"/></asset>'
    ), '<geom type="hfield" hfield="groove"/>'


@pytest.mark.parametrize("timestep", [0.0005, 0.002, 0.005])
@pytest.mark.parametrize("condim", [1, 3])
@pytest.mark.parametrize("shape", ["cylinder", "capsule"])
def test_a_cylinder_rests_in_a_groove_of_a_field_on_both_sides(shape, condim, timestep):
    """It rocked for good: in every step its side touched one of the two."""
    radius = 0.05
    asset, field = grooved_field(slope=1.0)
    model = mujoco.MjModel.from_xml_string(f"""
<mujoco><option timestep="{timestep}" cone="elliptic"/>{asset}<worldbody>{field}
  <body pos="0 0.013 {radius * np.sqrt(2.0) + 1e-3}"><freejoint/>
    <geom type="{shape}" size="{radius} 0.1" euler="90 0 0" mass="1" condim="{condim}"/>
  </body></worldbody></mujoco>""")
    engine = Engine(model)
    data = engine.make_data()
    engine.step(data, nstep=round(2.0 / timestep))
    assert np.abs(data.qvel).max() < 1e-9
    contacts = engine.contacts(data)
    force = np.einsum("nij,ni->nj", contacts.frame, contacts.force)
    for side in (-1, 1):
        on_side = side * contacts.frame[:, 0, 0] > 0.0
        assert force[on_side, 2].sum() == pytest.approx(0.5 * GRAVITY, rel=1e-9)


@pytest.mark.parametrize("half_length", [0.01, 0.02, 0.04])
def test_a_short_capsule_lies_on_a_field_with_both_its_ends(half_length):
    """Its second end was taken for the first one's, within the radius about the capsule."""
    model = mujoco.MjModel.from_xml_string(f"""
<mujoco>{FIELD}<worldbody><geom {FLAT["field"]}/>
  <body pos="0.03 0.01 0.04"><freejoint/>
    <geom type="capsule" size="0.04 {half_length}" euler="90 0 20" mass="1"/></body>
</worldbody></mujoco>""")
    engine = Engine(model)
    data = engine.make_data()
    engine.step(data, nstep=200)
    contacts = engine.contacts(data)
    assert contacts.force[:, 0] == pytest.approx([0.5 * GRAVITY] * 2, rel=1e-9)
    ends = contacts.position[1] - contacts.position[0]
    assert np.linalg.norm(ends) == pytest.approx(2.0 * half_length, rel=1e-6)
