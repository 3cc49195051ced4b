"""Meshes of a few wide facets that all but lie flat: palms, soles, feet."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine, Material

PUSH, PALM_MASS, PUCK_MASS, GRAVITY = 20.0, 1.0, 0.016, 9.81
PUCKS = {
    "box": "type='box' size='.024 .024 .04'",
    "cylinder": "type='cylinder' size='.024 .04'",
    "mesh": "type='mesh' mesh='puck'",
}
SOFT = "solref='.0105 1' solimp='.949 .974 .001'"


def mesh(name, vertices):
    return f"<mesh name='{name}' vertex='{' '.join(f'{c:.7f}' for v in vertices for c in v)}'/>"


def palm_over_puck(puck, *, bulge):
    """Return a palm, lower by `bulge` (m) in its middle than at its corners, over a light puck."""
    palm = [
        (x, y, 0.5 * bulge * ((x / 0.03) ** 2 + (y / 0.045) ** 2))
        for x in (-0.03, 0.0, 0.03)
        for y in (-0.045, 0.0, 0.045)
    ]
    palm += [(x, y, 0.05) for x in (-0.03, 0.03) for y in (-0.045, 0.045)]
    angles = 2.0 * np.pi * np.arange(24) / 24
    rims = [(0.024 * np.cos(a), 0.024 * np.sin(a), z) for a in angles for z in (-0.04, 0.04)]

    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep='.002' integrator='implicitfast'/>
        <asset>{mesh("palm", palm)}{mesh("puck", rims)}</asset><worldbody>
          <geom name='table' type='box' size='.3 .3 .05' pos='0 0 -.05'/>
          <body pos='.003 .004 .04'><freejoint/>
            <geom name='puck' {PUCKS[puck]} mass='{PUCK_MASS}' {SOFT}/></body>
          <body pos='0 0 .081'><joint name='down' type='slide' axis='0 0 1' damping='40'/>
            <joint type='hinge' axis='1 0 0' stiffness='30' damping='1'/>
            <joint type='hinge' axis='0 1 0' stiffness='30' damping='1'/>
            <geom name='palm' type='mesh' mesh='palm' mass='{PALM_MASS}'/></body>
        </worldbody></mujoco>"""
    )


@pytest.mark.parametrize("bulge", [0.2e-3, 1e-3])
@pytest.mark.parametrize("puck", PUCKS)
def test_a_puck_stands_under_a_palm_that_bears_down_on_it(puck, bulge):
    model = palm_over_puck(puck, bulge=bulge)
    engine = Engine(model)
    data = engine.make_data()
    data.qfrc_applied[model.joint("down").dofadr[0]] = -PUSH
    engine.step(data, nstep=1500)
    load = PUSH + GRAVITY * PALM_MASS
    pressed = engine.contacts(data, pair=("palm", "puck"))
    carried = engine.contacts(data, pair=("puck", "table"))
    # Forces are along normals that the palm's hinges may tilt by 0.01.
    assert pressed.force[:, 0].sum() == pytest.approx(load, rel=1e-4)
    assert carried.force[:, 0].sum() == pytest.approx(load + GRAVITY * PUCK_MASS, rel=1e-4)
    assert np.abs(data.qvel).max() < 1e-5
    # A spring bears all of the overlap, of every point.
    assert np.abs(pressed.compression + pressed.gap).max() < 1e-3 * pressed.compression.max()


def test_a_sole_on_a_wide_face_has_each_of_its_points_once():
    """Leaning, its lowest corner is one of the outline: found twice it would bear twice as much."""
    sole = [(x, y, 5e-4 * (x / 0.05) ** 2) for x in (-0.05, 0.0, 0.05) for y in (-0.03, 0.03)]
    top = [(x, y, 0.04) for x in (-0.05, 0.05) for y in (-0.03, 0.03)]
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><compiler angle='radian'/><asset>{mesh("foot", sole + top)}</asset><worldbody>
          <geom name='floor' type='box' size='1 1 .1' pos='0 0 -.1'/>
          <body name='foot' pos='0 0 .0215' euler='.01 .015 0'><freejoint/>
            <geom name='foot' type='mesh' mesh='foot' mass='1'/></body></worldbody></mujoco>"""
    )
    engine = Engine(model)
    engine.set_pair_material("foot", "floor", Material(stiffness=1e5, restitution=0.0))
    data = engine.make_data()
    seen = 0
    for _ in range(100):
        engine.step(data)
        position = engine.contacts(data).position
        apart = np.linalg.norm(position[:, None] - position, axis=2)
        assert (apart[np.triu_indices(len(apart), 1)] > 0.01).all()
        seen = max(seen, len(position))
    assert seen > 2


def domed(fine, *, sag, ground):
    """Return 1 kg, 10 by 6 cm, whose bottom of fine x fine corners sags by `sag` (m)."""
    at = np.linspace(-1.0, 1.0, fine)
    bottom = [(0.05 * x, 0.03 * y, 0.5 * sag * (x * x + y * y)) for x in at for y in at]
    top = [(0.05 * x, 0.03 * y, 0.04) for x in (-1, 1) for y in (-1, 1)]
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset>{mesh("dish", bottom + top)}</asset><worldbody>
          <geom name='ground' {ground}/>
          <body name='dish' pos='0 0 .0205' euler='.5 .7 20'><freejoint/>
            <geom name='dish' type='mesh' mesh='dish' mass='1'/></body></worldbody></mujoco>"""
    )


GROUNDS = {
    "plane": "type='plane' size='1 1 .1'",
    "box": "type='box' size='1 1 .1' pos='0 0 -.1'",
    "cylinder": "type='cylinder' size='.045 .1' pos='.004 .003 -.1'",
}


@pytest.mark.parametrize(
    ("sag", "load", "fine"),
    [(1e-4, 0.0, 15), (1e-4, 50.0, 3), (1e-4, 300.0, 15), (5e-4, 50.0, 15)],
)
@pytest.mark.parametrize("ground", GROUNDS)
def test_what_has_a_shallow_bottom_comes_to_rest(ground, sag, load, fine):
    """A selection of its corners rattles by 0.1 to 10 rad/s: some come as others go."""
    model = domed(fine, sag=sag, ground=GROUNDS[ground])
    engine = Engine(model)
    data = engine.make_data()
    data.xfrc_applied[model.body("dish").id, 2] = -load
    engine.step(data, nstep=1500)
    assert np.abs(data.qvel).max() < 1e-5
    assert engine.contacts(data).force[:, 0].sum() == pytest.approx(load + GRAVITY, rel=1e-6)


@pytest.mark.parametrize(
    ("ground", "sag", "load"),
    [*((ground, 5e-4, 50.0) for ground in GROUNDS), ("plane", 1e-4, 0.0)],
)
def test_a_finer_bottom_touches_in_no_more_points(ground, sag, load):
    """Of all its corners up to 48 touched: they are deeper than those between them stand out."""
    model = domed(31, sag=sag, ground=GROUNDS[ground])
    engine = Engine(model)
    data = engine.make_data()
    data.xfrc_applied[model.body("dish").id, 2] = -load
    engine.step(data, nstep=1500)
    contacts = engine.contacts(data)
    assert np.abs(data.qvel).max() < 1e-5
    assert len(contacts.force) <= 20
    assert contacts.force[:, 0].sum() == pytest.approx(load + GRAVITY, rel=1e-6)


@pytest.mark.parametrize(("ground", "rings"), [("plane", 96), ("box", 64)])
def test_a_body_of_thousands_of_corners_comes_to_rest(ground, rings):
    """It rocked by 0.2 rad/s for good: of more than 48 that touched some came as others went."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><mesh name='pebble' builtin='supersphere' params='{rings} .3 .4'
            scale='.2 .13 .085'/></asset><worldbody><geom {GROUNDS[ground]}/>
          <body pos='0 0 .09'><freejoint/><geom type='mesh' mesh='pebble' mass='4'/></body>
        </worldbody></mujoco>"""
    )
    engine = Engine(model)
    data = engine.make_data()
    engine.step(data, nstep=5000)
    assert np.abs(data.qvel).max() < 1e-5
    contacts = engine.contacts(data)
    assert 3 <= len(contacts.force) <= 6
    assert contacts.force[:, 0].sum() == pytest.approx(4.0 * GRAVITY, rel=1e-6)


@pytest.mark.parametrize("fine", [3, 15])
def test_what_has_a_shallow_bottom_stands_on_a_bar(fine):
    """Ridges cross both sides of the bar, more than there is room for: it needs points of both."""
    model = domed(fine, sag=1e-4, ground="type='box' size='.2 .004 .1' pos='0 0 -.1'")
    engine = Engine(model)
    engine.set_pair_material("dish", "ground", Material(stiffness=2e4, restitution=0.1))
    data = engine.make_data()
    data.qpos[2:] = 0.0203, 1.0, 0.0, 0.0, 0.0
    data.xfrc_applied[model.body("dish").id, 2] = -50.0
    engine.step(data, nstep=750)
    assert np.abs(data.qvel).max() < 1e-5
    contacts = engine.contacts(data)
    assert contacts.force[:, 0].sum() == pytest.approx(50.0 + GRAVITY, rel=1e-6)
    assert contacts.force[:, 0] @ contacts.position[:, 1] == pytest.approx(
        (50.0 + GRAVITY) * data.body("dish").xipos[1], abs=1e-6
    )
    # Its hull gives way by a twenty-thousandth of its radius, 3 um in 4 mm, to one side.
    assert data.body("dish").xmat[8] > 1.0 - 1e-5


@pytest.mark.parametrize("puck", PUCKS)
@pytest.mark.parametrize("seed", range(2))
def test_where_a_puck_stands_beneath_a_palm_does_not_matter(puck, seed):
    rng = np.random.default_rng(seed)
    model = palm_over_puck(puck, bulge=rng.uniform(1e-4, 1.2e-3))
    engine = Engine(model)
    data = engine.make_data()
    data.qpos[:2] = rng.uniform(-0.008, 0.008, 2)
    yaw = rng.uniform(-1.0, 1.0)
    data.qpos[3:7] = np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)
    data.qfrc_applied[model.joint("down").dofadr[0]] = -PUSH
    engine.step(data, nstep=1500)
    load = PUSH + GRAVITY * PALM_MASS
    assert np.abs(data.qvel).max() < 1e-5
    assert data.body(1).xmat[8] > 0.999
    pressed = engine.contacts(data, pair=("palm", "puck"))
    assert pressed.force[:, 0].sum() == pytest.approx(load, rel=1e-4)
