"""What becomes of overlap, and of a deformation when its stiffness has changed since."""

import mujoco
import numpy as np
import pytest

import dashpot

BALL = """<mujoco><option timestep="1e-4" gravity="0 0 {gravity}"/><worldbody>
  <geom name="floor" type="plane" size="1 1 .1"/>
  <body pos="0 0 .05"><freejoint/><geom name="ball" size=".1" mass="1"/></body>
</worldbody></mujoco>"""


def overlapping_ball(gravity: float, stiffness: float) -> tuple[dashpot.Engine, mujoco.MjData]:
    """Return a ball of 1 kg that has been put 5 cm deep into the floor, unstressed."""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(BALL.format(gravity=gravity)))
    set_stiffness(engine, stiffness)
    data = engine.make_data()
    data.qpos[2] = 1.0
    engine.step(data)  # in the first step of all the spring would take a part of the overlap
    data.qpos[2], data.qvel[2] = 0.05, 0.0
    return engine, data


def set_stiffness(engine: dashpot.Engine, stiffness: float, damping: float = 0.0) -> None:
    engine.set_pair_material(
        "ball", "floor", dashpot.Material(stiffness=stiffness, damping=damping)
    )


def test_a_spring_that_softens_when_compressed_gives_back_what_it_took():
    engine, data = overlapping_ball(gravity=0.0, stiffness=1e6)
    data.qvel[2] = -1.0
    while data.qvel[2] < 0.0:
        engine.step(data)
    set_stiffness(engine, 1e4)
    engine.step(data, 2000)
    # All of m v^2 / 2 was in the spring; at the same force a hundred times softer it would hold a
    # hundred times as much, and there are 5 cm of overlap to hold it in. The surface recovers
    # meanwhile, and what hits a wall that comes at 0.1 m/s leaves it 0.2 m/s faster.
    assert 0.9 < data.qvel[2] < 1.2 + 1e-6


@pytest.mark.parametrize("factor", [0.3, 3.0])
def test_a_load_stays_carried_when_the_stiffness_changes(factor):
    engine, data = overlapping_ball(gravity=-9.81, stiffness=1e6)
    set_stiffness(engine, 1e6, damping=2000.0)
    engine.step(data, 2000)  # 0.2 s: rising steadily, with 3 cm of overlap left
    assert data.qvel[2] == pytest.approx(0.1, rel=1e-9)
    set_stiffness(engine, 1e6 * factor, damping=2000.0)
    engine.step(data)
    # The spring stores (m g)^2 / (2 k), at most 0.2 mJ, less than m (0.1 m/s)^2 / 2: so its force
    # goes on, and with it the steady motion.
    assert data.qfrc_constraint[2] == pytest.approx(9.81, rel=1e-6)
    assert data.qvel[2] == pytest.approx(0.1, rel=1e-9)


LIMIT = """<mujoco><option gravity="0 0 0"/><worldbody>
  <body><joint type="slide" axis="1 0 0" limited="true" range="-1 0"/>
    <geom size=".02" mass=".05"/></body>
</worldbody></mujoco>"""
WALL = """<mujoco><option gravity="0 0 0"/><worldbody>
  <geom type="box" pos=".05 0 0" size=".03 .5 .5"/>
  <body><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
    <geom type="{shape}" size=".02 .02 .02" mass=".05"/></body>
</worldbody></mujoco>"""


WELDED = """<mujoco><option gravity="0 0 0"/><worldbody>
  <body name="part"><joint type="slide" axis="1 0 0"/><joint axis="0 0 1"/>
    <geom size=".02" mass=".05"/></body>
</worldbody><equality><weld body1="part"/></equality></mujoco>"""


@pytest.mark.parametrize("load", [100.0, 1000.0])
@pytest.mark.parametrize(
    ("scene", "direction"),
    [
        (LIMIT, (1.0,)),
        # Along the wall half of what friction holds.
        (WALL.format(shape="sphere"), (1.0, 0.5)),
        (WALL.format(shape="box"), (1.0, 0.5)),
        (WELDED, (1.0, 0.01)),
    ],
)
def test_a_light_part_under_a_heavy_load_stays_where_rigid_stiffness_rises_and_falls(
    scene, direction, load
):
    """Rigid rows are as stiff as the step resolves: steps of 1 and 5 ms take turns."""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(scene))
    data = engine.make_data()
    data.qfrc_applied[:] = load * np.array(direction)

    def after(steps: int) -> np.ndarray:
        for _ in range(steps):
            for engine.model.opt.timestep in (1e-3, 5e-3):
                engine.step(data)
        return data.qpos.copy()

    soon, late = after(5), after(500)
    # All that it gives way is under the softer spring; what the stiffer one takes back stays.
    assert np.all(late <= soon + 1e-9)
    np.testing.assert_allclose(data.qfrc_constraint, -data.qfrc_applied, rtol=1e-6)


def test_falling_stiffness_gives_back_what_rising_took_once():
    engine, data = overlapping_ball(gravity=0.0, stiffness=1e5)
    data.qvel[2] = -1.0
    while data.qvel[2] < 0.0:
        engine.step(data)
    for stiffness in (1e6, 1e5, 1e4):
        set_stiffness(engine, stiffness)
        engine.step(data)
    engine.step(data, 2000)
    # A tenth of m v^2 / 2 is left at 1e6 N/m. At 1e5 all of it is there again, and nothing more to
    # be had at 1e4. Recovery adds up to 0.2 m/s, as above.
    assert 0.9 < data.qvel[2] < 1.2 + 1e-6


def test_links_pressed_together_by_motors_do_not_gain_energy():
    """Three links that overlap by half their width from the start, torques in every joint."""
    links, closing = "", ""
    for i in range(6):
        links += f"""<body pos="{0.0 if i == 0 else 0.03} 0 0"><joint name="j{i}" axis="0 1 0"
          damping=".01"/><geom type="capsule" size=".03" fromto="0 0 0 .03 0 0" mass=".1"/>"""
        closing += "</body>"
    motors = "".join(f'<motor joint="j{i}"/>' for i in range(6))
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string(
            f"<mujoco><option gravity='0 0 0'/><worldbody>{links}{closing}</worldbody>"
            f"<actuator>{motors}</actuator></mujoco>"
        )
    )
    data = engine.make_data()
    rng = np.random.default_rng(0)
    touching, work, heat, gained = 0, 0.0, 0.0, 0.0
    for i in range(500):
        if i % 20 == 0:
            data.ctrl[:] = rng.uniform(-1, 1, 6)
        angle = data.qpos.copy()
        stats = engine.step(data)
        touching = max(touching, stats.touching)
        turn = data.qpos - angle
        work += float(data.ctrl @ turn)
        heat += 0.01 * float(turn @ turn) / engine.model.opt.timestep
        now = engine.energy(data)
        gained = max(gained, now.kinetic + now.elastic + heat - work)
    assert touching >= 8  # nearly all pairs of links that are no neighbours
    assert heat > 10.0
    # Recovery of ten overlaps of 3 cm adds some 0.1 J each, against forces of 1 N m / 3 cm; springs
    # that always kept their force while the links change the stiffness would add 100 kJ.
    assert gained < 1.0


@pytest.mark.parametrize("inertia", [0.1, 5.0])
@pytest.mark.parametrize("tilt", [1e-3, 1e-2])
def test_a_link_that_overlaps_the_base_it_turns_on_is_not_thrown(tilt, inertia):
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><compiler angle="radian"/><option timestep="0.002"/><worldbody>
          <geom type="box" size=".1 .1 .05" pos="0 0 -.05" euler="{tilt} {0.5 * tilt} 0"/>
          <body pos="0 0 .0499"><joint axis="0 0 1" armature="{inertia}"/>
            <geom type="box" size=".06 .05 .05" mass="3"/></body>
        </worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    fastest = 0.0
    for _ in range(500):
        engine.step(data)
        fastest = max(fastest, abs(data.qvel[0]))
    # Corners that recovery pushes along what is nearly the axis move sideways, three times as fast
    # as the recovery speed of 0.1 m/s at most.
    assert fastest * np.hypot(0.06, 0.05) < 0.32
    # Corners pushed it about the axis, to where they balance.
    assert abs(data.qpos[0]) > 1e-3
    assert data.qvel[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("timestep", [0.001, 0.005])
@pytest.mark.parametrize("speed", [0.5, 1.0])
@pytest.mark.parametrize("stiffness", [1e4, 1e6])
def test_points_that_move_along_both_geoms_keep_their_compression(stiffness, speed, timestep):
    """Two rods cross at 0.2 rad, in two points, and one is drawn along.

    Beyond half of their spacing in a step each point is nearest to where the other was: one went
    on from there and the other began anew, as a spring that bore nothing (sag times 0.7 to 4.4).
    """
    half_mass = 0.5
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{timestep}"/>
        <default><geom condim="1" type="capsule" size=".02 .5"/></default><worldbody>
        <geom name="below" euler="-90 0 0"/>
        <body pos="-.08 0 .04"><joint type="slide" axis="1 0 0"/>
          <joint type="slide" axis="0 0 1"/>
          <geom name="above" euler="-90 {np.degrees(0.2)} 0" mass="{2 * half_mass}"/></body>
        </worldbody></mujoco>""")
    )
    engine.set_pair_material("below", "above", dashpot.Material(stiffness))
    data = engine.make_data()
    data.qvel[0] = speed
    steps = round(0.12 / speed / timestep)
    engine.step(data, nstep=steps // 2)
    sag = []
    for _ in range(steps - steps // 2):
        engine.step(data)
        sag.append(-data.qpos[1])
    # Points are found anew, to some 1e-3 of their depth where they pass quickly.
    assert np.array(sag) == pytest.approx(half_mass * 9.81 / stiffness, rel=0.02)


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_a_heavy_finger_that_presses_slowly_leaves_its_overlap_behind(timestep):
    """A contact on a model's own solimp takes 60 ms to stop 100 kg, and does not swing.

    What stands apart from its spring waited until it was over, as in an elastic hit: grippers on
    heavy drives held what they had 0.6 mm too deep.
    """
    geom = 'solimp=".95 .99 .01"'
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}" gravity="0 0 0"/><worldbody>
        <geom type="box" size=".1 .1 .1" pos="0 0 -.1" {geom}/>
        <body pos="0 0 .049"><joint type="slide" axis="0 0 1" armature="100"/>
          <geom type="box" size=".02 .02 .05" mass=".2" {geom}/></body></worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qvel[0] = -0.05
    first = engine.step(data)
    unstressed = first.max_penetration - first.max_compression
    assert unstressed > 0.2e-3
    engine.step(data, nstep=round(0.08 / timestep) - 2)
    stats = engine.step(data)
    # It is pushed out within 10 ms once the force is less than two weights; what the finger moves
    # by in the last step, 0.02 m/s, is in the compression alone.
    assert stats.max_penetration - stats.max_compression < 0.1 * unstressed + 0.02 * timestep
