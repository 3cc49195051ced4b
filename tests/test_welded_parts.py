"""Free bodies with bodies welded to them move as if all of it were written as one body."""

import dataclasses
import re

import mujoco
import numpy as np
import pytest

import dashpot
from dashpot import Engine, Material
from scenes import gripper
from simulate import DASHPOT, record

FLOOR = '<geom name="floor" type="plane" size="9 9 1"/>'


def hammer(name, pos, *, welded, euler="0 0 0", mass=0.9):
    """Return MJCF of a free handle with a head and a foot, welded to it or of the same body."""
    handle = f'<geom name="{name}" type="box" size=".03 .04 .12" mass=".4"/>'
    head = f'<geom name="{name} head" type="box" size=".1 .04 .04" pos="{{}}" mass="{mass}"/>'
    foot = f'<geom name="{name} foot" type="capsule" size=".03 .05" pos="{{}}" mass=".2"/>'
    if welded:
        parts = (
            f'{handle}<body name="{name} head" pos=".02 0 .1">{head.format("0 0 .06")}'
            f'<body pos="0 0 .1"><site name="{name} top"/></body></body>'
            f'<body name="{name} foot" pos=".02 0 -.1" euler="0 0 90">'
            f"{foot.format('.02 0 -.05')}</body>"
        )
    else:
        parts = handle + head.format(".02 0 .16") + foot.format(".02 .02 -.15")
    return f'<body name="{name}" pos="{pos}" euler="{euler}"><freejoint/>{parts}</body>'


def make_engine(bodies, timestep=0.002, *, option="", material=None, rest="", **options):
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{timestep}" {option}/><worldbody>{bodies}</worldbody>{rest}'
        "</mujoco>"
    )
    engine = Engine(model, **options)
    for geom in range(model.ngeom):
        if material:
            engine.set_material(geom, material)
    return engine


BOX = 'type="box" size=".05 .1 .15" mass="2"'
BOXES = {
    "massless": f'<geom {BOX}/><body pos=".1 0 0"><site name="tip"/></body>',
    "halves": '<geom type="box" size=".05 .1 .075" pos="0 0 -.075" mass="1"/>'
    '<body pos="0 .1 .2" euler="90 0 0"><geom type="box" size=".05 .075 .1" pos="0 -.125 .1"'
    ' mass="1"/></body>',
    # All of its mass is that of the child.
    "carried": f'<body pos="0 0 .2" euler="0 30 0"><geom {BOX}/></body>',
}


def momentum(engine, data):
    """Return the angular momentum of the first body about its centre of mass, kg m^2/s."""
    mujoco.mj_forward(engine.model, data)
    mujoco.mj_subtreeVel(engine.model, data)
    return data.subtree_angmom[1].copy()


@pytest.mark.parametrize("parts", BOXES)
def test_a_minute_of_tumbling(parts):
    engine = make_engine(
        f"<body><freejoint/>{BOXES[parts]}</body>", 0.001, option='gravity="0 0 0"'
    )
    data = engine.make_data()
    axes = np.zeros(9)  # near the middle axis, about which the motion is unstable
    mujoco.mju_quat2Mat(axes, engine.model.body_quat[2] if parts == "carried" else [1, 0, 0, 0])
    rate = axes.reshape(3, 3) @ [0.5, 9.98, 0.4]
    centre = [0, 0, 0.2] if parts == "carried" else [0, 0, 0]
    data.qvel[3:] = rate
    data.qvel[:3] = -np.cross(rate, centre)  # at rest as a whole
    first, energy = momentum(engine, data), engine.energy(data).kinetic
    for _ in range(60):
        engine.step(data, nstep=1000)
        assert momentum(engine, data) == pytest.approx(first, abs=1e-9 * np.linalg.norm(first))
        assert engine.energy(data).kinetic == pytest.approx(energy, rel=1e-9)
    assert data.subtree_com[1] == pytest.approx(centre, abs=1e-9)


def test_a_thrown_hammer_falls_on_a_parabola():
    engine = make_engine(hammer("a", "0 0 0", welded=True), 0.01)
    data = engine.make_data()
    data.qvel[:] = 1, 2, 3, 5, -4, 2
    mujoco.mj_forward(engine.model, data)
    mujoco.mj_subtreeVel(engine.model, data)
    start, velocity = data.subtree_com[1].copy(), data.subtree_linvel[1].copy()
    engine.step(data, nstep=100)
    mujoco.mj_forward(engine.model, data)
    assert data.subtree_com[1] == pytest.approx(start + velocity + [0, 0, -9.81 / 2], abs=1e-12)


SOFT = Material(1e4, restitution=0.5, friction=0.4)
ELASTIC = Material(1e5, restitution=1.0, friction=0.0)


def thrown(pos="0 0 .5", **options):
    return lambda welded: make_engine(FLOOR + hammer("a", pos, welded=welded), **options)


def colliding(welded):
    first = hammer("a", "0 0 .5", welded=welded)
    second = hammer("b", "0.05 0 1", euler="20 30 10", welded=welded)
    return make_engine(FLOOR + first + second, material=SOFT)


def stacked(welded):
    return make_engine(
        FLOOR
        + "".join(
            f'<body pos="0 0 {0.1 + 0.2 * i}" euler="0 0 {90 * i}"><freejoint/>'
            '<geom type="box" size=".05 .1 .1" pos="-.05 0 0" mass="1"/>'
            + (
                '<body pos=".05 0 0"><geom type="box" size=".05 .1 .1" mass="1"/></body></body>'
                if welded
                else '<geom type="box" size=".05 .1 .1" pos=".05 0 0" mass="1"/></body>'
            )
            for i in range(4)
        ),
        material=Material(1e5, damping_ratio=0.5, friction=0.5),
    )


def rolling(welded):
    child = '<body pos=".05 0 0"><site/></body>' if welded else ""
    return make_engine(
        f'{FLOOR}<body pos="0 0 .1"><freejoint/><geom size=".1" mass="1"/>{child}</body>',
        material=Material(1e5, restitution=0.2, friction=0.2),
    )


def tiled(welded):
    """Return a ball that rolls over the seam of two tiles of a plate that floats."""
    tile = '<geom type="box" size=".5 .5 .05" pos="{} 0 0" mass="50"/>'
    part = f'<body pos="1 0 0" gravcomp="1">{tile.format(0)}</body>'
    second = part if welded else tile.format(1)
    return make_engine(
        f'<body gravcomp="1"><freejoint/>{tile.format(0)}{second}</body>'
        '<body pos=".3 0 .149"><freejoint/><geom size=".1" mass="1"/></body>',
        material=Material(1e5, damping_ratio=0.7, friction=0.5),
    )


SCENES = {
    "flight": (thrown("0 0 9"), (1, 0.5, 3, 3, 8, 2), 0.5),
    "rigid bounce": (thrown(), (1, 0.5, 0, 3, 8, 2), 0.4),
    "soft bounce": (thrown(material=SOFT), (1, 0.5, 0, 3, 8, 2), 0.4),
    "elastic bounce": (thrown(material=ELASTIC), (1, 0.5, 0, 3, 8, 2), 0.3),
    "bounce in parts": (thrown(material=SOFT, impact="cut"), (1, 0.5, 0, 3, 8, 2), 0.4),
    "landing": (thrown("0 0 .24", material=SOFT), (0, 0, 0, 0, 0, 0), 2.0),
    "damped joint": (
        lambda welded: make_engine(
            hammer("a", "0 0 1", welded=welded).replace(
                "<freejoint/>", '<joint type="free" damping=".2"/>'
            ),
            option='integrator="implicitfast"',
        ),
        (1, 0.5, 0, 3, 8, 2),
        0.4,
    ),
    "collision": (colliding, (0, 0, 0, 3, 1, 2, 0, 0, -2, 1, 1, 1), 0.4),
    "stack": (stacked, (0.3,), 1.0),
    "rolling": (rolling, (1, 0, 0, 0, 0, 4), 1.0),
    "seam": (tiled, (0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 10, 0), 0.5),
}


IN_FLIGHT = ("flight", "damped joint")


@pytest.mark.parametrize("scene", SCENES)
def test_parts_move_as_one_body(scene):
    make, velocity, duration = SCENES[scene]
    states = []
    for welded in (False, True):
        engine = make(welded)
        data = engine.make_data()
        data.qvel[: len(velocity)] = velocity
        stats = engine.step(data, nstep=round(duration / engine.model.opt.timestep))
        energy = engine.energy(data)
        books = [energy.kinetic, energy.potential, energy.elastic, energy.dissipated_normal]
        states.append(np.concatenate([data.qpos, data.qvel, books]))
        assert (stats.max_compression > 0.0) == (scene not in IN_FLIGHT)
    # Rounding, which impacts multiply.
    assert states[1] == pytest.approx(states[0], abs=1e-8)


def test_a_shaken_grasp_holds_parts_as_one_body():
    scene = gripper(duration=1.0)
    plain = record(scene, DASHPOT, 0.002)
    held = scene.xml.index("</body>", scene.xml.index('name="held"'))
    nested = scene.xml[:held] + '<body><site name="tag"/></body>' + scene.xml[held:]
    run = record(dataclasses.replace(scene, xml=nested), DASHPOT, 0.002)
    assert np.ptp(run.position("held")[:, 2]) < 0.1  # it is held
    assert run.position("held") == pytest.approx(plain.position("held"), abs=1e-10)


def test_forces_act_on_the_part_that_they_are_applied_to():
    force = np.array([0.0, 0.0, 0.9 * 9.81])
    ends = []
    for welded in (False, True):
        engine = make_engine(hammer("a", "0 0 0", welded=welded), 0.001)
        model, data = engine.model, engine.make_data()
        data.qvel[3:] = 1, 2, 3
        for _ in range(500):
            mujoco.mj_kinematics(model, data)
            if welded:
                data.xfrc_applied[model.body("a head").id, :3] = force
            else:
                arm = data.geom("a head").xpos - data.xipos[1]
                data.xfrc_applied[1] = [*force, *np.cross(arm, force)]
            engine.step(data)
        ends.append(np.concatenate([data.qpos, data.qvel]))
    assert ends[1] == pytest.approx(ends[0], abs=1e-10)


def test_masses_of_parts_that_are_edited_act_from_the_next_step_on():
    ends = []
    for edited in (False, True):
        mass = 0.9 if edited else 2.7
        engine = make_engine(FLOOR + hammer("a", "0 0 .5", welded=True, mass=mass), material=SOFT)
        model, data = engine.model, engine.make_data()
        data.qvel[:] = 1, 0.5, 0, 3, 8, 2
        if edited:
            engine.step(data)
            data = engine.make_data()
            data.qvel[:] = 1, 0.5, 0, 3, 8, 2
            model.body_mass[model.body("a head").id] *= 3.0
            model.body_inertia[model.body("a head").id] *= 3.0
        engine.step(data, nstep=200)
        ends.append(np.concatenate([data.qpos, data.qvel]))
    assert ends[1] == pytest.approx(ends[0], abs=1e-8)


def test_a_part_that_is_moved_takes_its_mass_along():
    engine = make_engine(hammer("a", "0 0 0", welded=True), option='gravity="0 0 0"')
    data = engine.make_data()
    engine.model.body_pos[engine.model.body("a head").id] = -0.3, 0.1, 0.0
    data.qvel[3:] = 10, 3, 5
    first, energy = momentum(engine, data), engine.energy(data).kinetic
    engine.step(data, nstep=1000)
    assert momentum(engine, data) == pytest.approx(first, abs=1e-9 * np.linalg.norm(first))
    assert engine.energy(data).kinetic == pytest.approx(energy, rel=1e-9)


@pytest.mark.parametrize(
    ("field", "message"),
    [
        ("body_mass", "the mass of 'a', with all that is welded to it, is 0"),
        ("body_inertia", "the least moment of inertia of 'a', with all"),
    ],
)
def test_parts_without_inertia_are_named(field, message):
    engine = make_engine(hammer("a", "0 0 0", welded=True))
    data = engine.make_data()
    data.qvel[0] = 1.0
    getattr(engine.model, field)[1:] = 0.0
    if field == "body_inertia":
        engine.model.body_mass[2:] = 0.0
    before = data.qpos.copy()
    with pytest.raises(ValueError, match=re.escape(message)):
        engine.step(data)
    assert np.array_equal(data.qpos, before)


def test_a_part_is_hit_when_the_body_takes_it_there():
    wall = '<geom name="wall" type="box" size=".1 2 2" pos="1.2 0 0"/>'
    found = []
    for welded in (False, True):
        engine = make_engine(wall + hammer("a", "0 0 0", welded=welded))
        data = engine.make_data()
        data.qvel[:] = 2, 0.5, 0, 3, 8, 2
        mujoco.mj_forward(engine.model, data)
        impact = dashpot.time_of_impact(engine, data, "a head", "wall", horizon=2.0)
        found.append(impact.time)
    assert found[1] == pytest.approx(found[0], abs=1e-7)


@pytest.mark.parametrize("timestep", [0.002, 0.01])
def test_a_spinning_part_passes_where_it_does_not_touch(timestep):
    """The ends of a dumbbell swing past a ball that hangs within their circle's square."""
    end = '<geom size=".05" mass="1"/>'
    engine = make_engine(
        f'<body><freejoint/><body pos=".3 0 0">{end}</body><body pos="-.3 0 0">{end}</body></body>'
        '<body pos=".27 .27 0"><freejoint/><geom size=".03" mass="1"/></body>',
        timestep,
        option='gravity="0 0 0"',
    )
    data = engine.make_data()
    data.qvel[5] = 20.0  # 6 m/s
    engine.step(data, nstep=round(1.0 / timestep))
    assert not data.qvel[6:].any()
    assert data.qvel[5] == pytest.approx(20.0, rel=1e-12)
