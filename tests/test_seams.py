"""Bodies pass the seams between geoms that meet in one plane, and nothing else."""

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot import Engine, Material
from piles import random_quat

TILES = """<mujoco><option timestep="{timestep}"/>
  <asset><mesh name="cube" vertex="-.5 -.5 -.05  .5 -.5 -.05  -.5 .5 -.05  .5 .5 -.05
                                   -.5 -.5 .05  .5 -.5 .05  -.5 .5 .05  .5 .5 .05"/></asset>
  <worldbody>
    <geom {tile} pos="-0.5 0 -0.05" friction="0.1"/>
    <geom {tile} pos="0.5 0 {height}" friction="0.1"/>
    <body pos="-0.3 0 0.05" {attitude}><freejoint/><geom {shape} mass="1" friction="0.1"/></body>
  </worldbody></mujoco>"""
BOX_TILE = 'type="box" size="0.5 0.5 0.05"'
SHAPES = {
    "sphere": 'type="sphere" size="0.05"',
    "box": 'type="box" size="0.05 0.05 0.05"',
    "cylinder": 'type="cylinder" size="0.05 0.05"',
    "capsule": 'type="capsule" size="0.05 0.05"',
    "ellipsoid": 'type="ellipsoid" size="0.05 0.05 0.05"',
}


def slide(
    shape, *, timestep, speed, tile=BOX_TILE, height=-0.05, way=0.6, impact="none", material=None
):
    """Return velocities (steps, 3) and heights above rest of a body thrown along x."""
    xml = TILES.format(
        timestep=timestep,
        tile=tile,
        height=height,
        shape=SHAPES[shape],
        attitude='euler="0 90 0"' if shape == "capsule" else "",
    )
    engine = Engine(mujoco.MjModel.from_xml_string(xml), impact=impact)
    for geom in range(engine.model.ngeom if material else 0):
        engine.set_material(geom, material)
    data = engine.make_data()
    data.qvel[0] = speed
    velocities, rises = [], []
    for _ in range(round(way / speed / timestep)):
        engine.step(data)
        velocities.append(data.qvel[:3].copy())
        rises.append(data.qpos[2] - 0.05)
    return np.array(velocities), np.array(rises), data


@pytest.mark.parametrize("timestep", [0.001, 0.005])
@pytest.mark.parametrize("speed", [3.0])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("impact", ["none", "cut"])
def test_body_slides_over_the_seam_of_two_tiles(shape, speed, timestep, impact):
    velocities, rises, data = slide(shape, timestep=timestep, speed=speed, impact=impact)
    assert data.qpos[0] > 0.1
    # Friction of 0.1 slows it by 0.1 g; rocking and the edge itself by a thousandth of its speed.
    loss = -np.diff(velocities[:, 0]).min()
    assert loss <= 0.1 * 9.81 * timestep + 1e-3 * speed
    # Normals within 0.8 degrees count as one: of its speed, 0.014 for a step.
    assert rises.max() < 0.014 * speed * timestep


@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_mesh_tiles_have_no_seam_either(shape):
    velocities, rises, _ = slide(shape, timestep=0.002, speed=2.0, tile='type="mesh" mesh="cube"')
    assert -np.diff(velocities[:, 0]).min() <= 0.1 * 9.81 * 0.002 + 1e-3 * 2.0
    assert rises.max() < 0.014 * 2.0 * 0.002


FALLING = {
    "ball": 'type="sphere" size="0.03"',
    "box": 'type="box" size="0.05 0.04 0.03"',
    "capsule": 'type="capsule" size="0.03 0.05"',
}


def fall_beside_a_seam(engine, rng):
    """Return the change of the speed along x by a fall within 3 cm of the seam of two tiles."""
    data = engine.make_data()
    data.qpos[:3] = rng.uniform(-0.03, 0.03), 0.01, 0.5
    data.qpos[3:7] = random_quat(rng)
    mujoco.mj_kinematics(engine.model, data)
    tiles = (dashpot.distance(engine, data, tile, "falls").distance for tile in ("left", "right"))
    data.qpos[2] += 0.01 - min(tiles)
    along, down = rng.uniform(-1.0, 1.0), rng.uniform(0.5, 3.0)
    data.qvel[0], data.qvel[2] = along, -down
    # To the end of the first hit: what turns then may hit the floor with another corner.
    timestep = engine.model.opt.timestep
    engine.step(data, nstep=int(0.01 / down / timestep) + 5)
    return data.qvel[0] - along


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("shape", FALLING)
def test_what_falls_beside_a_seam_is_not_pushed_aside(shape, timestep):
    # Edges of the other tile, met ahead, took up to all of the speed; in MuJoCo they do in a third.
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{timestep}"/>
  <default><geom friction="0"/></default><worldbody>
    <geom name="left" type="box" size="0.5 0.5 0.1" pos="-0.5 0 -0.1"/>
    <geom name="right" type="box" size="0.5 0.5 0.1" pos="0.5 0 -0.1"/>
    <body><freejoint/><geom name="falls" {FALLING[shape]} mass="1"/></body>
  </worldbody></mujoco>""")
    engine = Engine(model)
    rng = np.random.default_rng(0)
    changes = np.abs([fall_beside_a_seam(engine, rng) for _ in range(60)])
    # Pressed in by 1 mm, as in a hit at 5 ms, a ball touches an edge 8 mm off its lowest point; and
    # of steps of 15 mm some end before what they turn the body into is known.
    assert (changes > 0.03).mean() <= (0.0 if timestep < 0.005 else 0.05)


def test_step_of_a_millimetre_still_stops_a_box():
    velocities, _, _ = slide("box", timestep=0.002, speed=1.5, height=-0.049)
    # Its front face meets the side of the second tile and loses most of its speed at once.
    assert -np.diff(velocities[:, 0]).min() > 0.2 * 1.5
    assert velocities[:, 0].min() < 0.3 * 1.5


@pytest.mark.parametrize("timestep", [0.001, 0.002])
def test_ball_on_a_floor_still_meets_a_low_curb(timestep):
    # A curb of 1 mm is met 10 mm before its edge, where the normal is acos(0.98) from the vertical.
    # Without friction and rebound the ball keeps the rest of its velocity, and flies up.
    speed, cosine = 1.5, 0.98
    velocities, rises, _ = slide(
        "sphere",
        timestep=timestep,
        speed=speed,
        height=-0.049,
        material=Material(restitution=0.0, friction=0.0),
    )
    lost = speed * (1.0 - cosine**2)
    # Rigid contacts without restitution rebound at 0.02 to 0.04.
    assert speed - velocities[-1, 0] == pytest.approx(lost, rel=0.06)
    assert rises.max() == pytest.approx(speed * lost * cosine**2 / (2 * 9.81), rel=0.1)


def test_ball_that_a_sunken_box_runs_into_is_no_tile():
    # The box is 0.7 mm deep in the floor, and the ball stands out of it by 0.35 mm: they overlap
    # along the floor's normal by no more than half as much again as box and floor.
    radius, half, sunk, stands_out = 0.04, 0.05, 7e-4, 3.5e-4
    height = radius - stands_out - sunk  # of the box's edge over the centre of the ball
    sine = np.sqrt(1 - (height / radius) ** 2)  # of the normal's angle from the vertical
    xml = f"""<mujoco><option timestep="0.002" gravity="1 0 -10"/><worldbody>
      <geom type="box" size="0.5 0.5 0.05" pos="0 0 -0.05" condim="1"/>
      <geom name="ball" type="sphere" size="{radius}" condim="1"
            pos="{half + 1e-5 + radius * sine} 0 {stands_out - radius}"/>
      <body pos="0 0 {half - sunk}"><freejoint/>
        <geom name="box" type="box" size="{half} {half} {half}" mass="1" condim="1"/></body>
      </worldbody></mujoco>"""
    engine = Engine(mujoco.MjModel.from_xml_string(xml), recovery_speed=0.0)
    data = engine.make_data()
    engine.step(data, nstep=2000)
    contacts = engine.contacts(data)
    ball = (contacts.geom == engine.model.geom("ball").id).any(axis=1)
    force = contacts.force[:, 0]
    # Without friction the ball alone holds the box, 1 N, and the floor bears the rest of 10 N. The
    # edge rests on the ball a few micrometres lower: by so much relative to `height`.
    assert force[ball].sum() == pytest.approx(1.0 / sine, rel=1e-2)
    assert force.sum() == pytest.approx(10.0 + (1.0 - height / radius) / sine, rel=1e-2)
    assert np.abs(data.qvel).max() < 1e-6


def test_wall_beside_a_tile_still_stops_what_rests_on_it():
    _, _, data = slide("box", timestep=0.005, speed=1.5, height=0.01)
    assert data.qpos[0] < -0.049
    assert data.qvel[0] <= 1e-9


ROUND = {
    "ball": ('type="sphere" size="0.1"', "0 0 0"),
    "egg": ('type="ellipsoid" size="0.1 0.15 0.1"', "0 0 0"),
    "wheel": ('type="cylinder" size="0.1 0.05"', "90 0 0"),
}


def roll(shape, *, tiles, stiffness, timestep, across):
    """Return poses (steps, 7) of a soft body that rolls at 1 m/s over tiles, or over one floor."""
    geom, attitude = ROUND[shape]
    half, at = (0.1, range(-2, 12)) if tiles else (5.0, (0,))
    floor = "".join(
        f'<geom type="box" size="{half} {half} 0.05" pos="{0.2 * i} {0.2 * j} -0.05"/>'
        for i in at
        for j in (at if across else (0,))
    )
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{timestep}"/>
      <default><geom friction="0.8"/></default><worldbody>{floor}
        <body pos="0.03 0.021 0.1"><freejoint/><geom {geom} euler="{attitude}" mass="1"/></body>
      </worldbody></mujoco>""")
    engine = Engine(model)
    for geom_id in range(model.ngeom):
        engine.set_material(geom_id, Material(stiffness=stiffness, damping_ratio=0.5))
    data = engine.make_data()
    direction = np.array([np.cos(0.5), np.sin(0.5), 0.0]) if across else np.array([1.0, 0.0, 0.0])
    data.qvel[:3] = direction
    data.qvel[3:] = np.cross([0.0, 0.0, 10.0], direction)
    poses = []
    for _ in range(round(1.5 / timestep)):
        engine.step(data)
        poses.append(data.qpos.copy())
    return np.array(poses)


@pytest.mark.parametrize("timestep", [0.002, 0.005])
@pytest.mark.parametrize("stiffness", [2e3, 2e4, 2e6])
@pytest.mark.parametrize(
    ("shape", "across"), [("ball", False), ("ball", True), ("egg", False), ("wheel", False)]
)
def test_soft_round_bodies_roll_over_tiles_as_over_one_floor(shape, across, stiffness, timestep):
    """Each tile began without the compression of the last: balls of 1e3 N/m jumped by 77 mm."""
    tiles, floor = (
        roll(shape, tiles=t, stiffness=stiffness, timestep=timestep, across=across)
        for t in (True, False)
    )
    # Nearest points of an ellipsoid are searched, to within nanometres.
    assert np.abs(tiles[:, 2] - floor[:, 2]).max() < (1e-6 if shape == "egg" else 1e-9)
    assert np.abs(tiles[:, :2] - floor[:, :2]).max() < 1e-4


def test_ball_at_rest_on_a_seam_stays_there():
    """Its one contact is with the first of the two tiles, whose edge bears it."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><option timestep="0.002"/><worldbody>
        <geom type="box" size="0.1 0.1 0.05" pos="-0.1 0 -0.05"/>
        <geom type="box" size="0.1 0.1 0.05" pos="0.1 0 -0.05"/>
        <body pos="0 0 0.1"><freejoint/><geom type="sphere" size="0.1" mass="1"/></body>
      </worldbody></mujoco>""")
    engine = Engine(model)
    data = engine.make_data()
    engine.step(data, nstep=2000)
    assert np.abs(data.qpos[:2]).max() < 1e-9
    assert np.abs(data.qvel).max() < 1e-9
    assert engine.contacts(data).force[:, 0].sum() == pytest.approx(9.81, rel=1e-6)


@pytest.mark.parametrize("shape", ["sphere", "capsule", "cylinder"])
def test_core_bears_what_a_round_body_presses_through_a_skin(shape):
    skin, core, below = 1e4, 1e5, 0.003  # N/m of a contact, and m
    attitude = "" if shape == "sphere" else 'euler="90 0 0"'
    engine = Engine(
        mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody>
          <body pos="0 0 -0.05"><geom name="skin" type="box" size="0.2 0.2 0.05"/>
            <geom name="core" type="box" size="0.2 0.2 0.05" pos="0 0 -{below}"/></body>
          <body pos="0 0 0.05" {attitude}><freejoint/>
            <geom name="body" {SHAPES[shape]} mass="20"/></body>
        </worldbody></mujoco>""")
    )
    for geom, stiffness in (("skin", skin), ("core", core)):
        engine.set_pair_material(
            "body", geom, Material(stiffness=stiffness, damping_ratio=1.0, friction=0.5)
        )
    data = engine.make_data()
    engine.step(data, nstep=2000)
    points = 1 if shape == "sphere" else 2
    depth = (20.0 * 9.81 / points + core * below) / (skin + core)
    # What is left of the motion.
    assert 0.05 - data.qpos[2] == pytest.approx(depth, rel=1e-6)
    assert len(engine.contacts(data)) == 2 * points


def rails(shape: str, timestep: float, *, rise: float = 0.0, tilt: float = 0.0) -> Engine:
    """Return an engine of a steel marble of 8 mm on two rails of 2 cm pieces, laid end to end.

    Gravity is tilted down along the rails. From 10 cm on they are higher by `rise`.
    """
    pieces = "".join(
        f"""<body pos="{0.02 * i} {side} {rise * (i >= 5)}"><geom type="{shape}" size=".002"
          fromto="0 0 0 .02 0 0" friction=".5 0 0"/></body>"""
        for i in range(60)
        for side in (-0.006, 0.006)
    )
    along, down = 9.81 * np.sin(tilt), 9.81 * np.cos(tilt)
    return Engine(
        mujoco.MjModel.from_xml_string(f"""<mujoco>
        <option gravity="{along} 0 {-down}" timestep="{timestep}"/><worldbody>{pieces}
        <body pos=".005 0 .008"><freejoint/>
          <geom size=".008" density="7800" friction=".5 0 0"/></body></worldbody></mujoco>""")
    )


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("shape", ["capsule", "cylinder"])
@pytest.mark.parametrize("tilt", [np.radians(5.0), np.radians(15.0)])
def test_a_marble_rolls_down_rails_of_capsules_laid_end_to_end(shape, timestep, tilt):
    # The end of the next rail was taken for something to roll into: 0.56 of the speed at 5 ms.
    engine = rails(shape, timestep, tilt=tilt)
    data = engine.make_data()
    steps = round(0.9 / timestep)
    engine.step(data, nstep=steps)
    # On points h beneath its centre a ball of R rolls at g sin / (1 + 2/5 (R/h)^2).
    height = 0.008 * np.sqrt(0.01**2 - 0.006**2) / 0.01
    speed = 9.81 * np.sin(tilt) / (1.0 + 0.4 * (0.008 / height) ** 2) * steps * timestep
    # It turns by up to 1.5 rad in a step there.
    assert data.qvel[0] == pytest.approx(speed, rel=1e-3)


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_a_marble_hits_rails_that_are_higher(timestep):
    """By half of its radius: at 0.3 m/s it has not the energy to climb, and comes back."""
    rise = 0.004
    engine = rails("capsule", timestep, rise=rise)
    for geom in range(engine.model.ngeom):  # it sticks, and does not rebound
        engine.set_material(geom, Material(restitution=0.0, friction=(5.0, 0.0, 0.0)))
    data = engine.make_data()
    # It touches rails of 2 mm, 6 mm beside its middle, `height` beneath that, and their higher ends
    # `below` it, as far from its axis.
    height = 0.8 * np.sqrt(0.01**2 - 0.006**2)
    below = height - 0.8 * rise
    data.qvel[0], data.qvel[4] = 0.3, 0.3 / height
    heights, ways = [], []
    for _ in range(round(0.6 / timestep)):
        engine.step(data)
        heights.append(data.qpos[2])
        ways.append(data.qpos[0])
    # Angular momentum about the points hit is that before: on the ends, and back on the rails.
    gyration = 0.4 * 0.008**2
    kept = (height * below + gyration) / (height**2 + gyration)
    spin = kept * 0.3 / height
    climbed = 0.5 * (height**2 + gyration) * spin**2 / 9.81
    assert climbed < rise
    # The geometry of a step is frozen: to first order in what it turns by.
    tolerance = spin * timestep
    assert max(heights) - 0.008 == pytest.approx(climbed, rel=tolerance)
    assert max(ways) < 0.1
    assert data.qvel[0] == pytest.approx(-0.3 * kept**2, rel=tolerance)
    assert data.qvel[4] == pytest.approx(data.qvel[0] / height, rel=1e-3)
