"""Which geoms collide is kept over steps; the contacts are those that MuJoCo would find anew.

MuJoCo looks for pairs itself where a callback filters them. With one that filters nothing more than
MuJoCo does, every step must come out bit by bit the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
import pytest

import dashpot

FIELDS = (
    *("dist", "pos", "frame", "includemargin", "friction", "solref", "solreffriction", "solimp"),
    *("adhesion", "mu", "H", "dim", "geom1", "geom2", "geom", "flex", "elem", "vert", "exclude"),
    "efc_address",
)

# One body of two geoms, one of a mesh, neighbours on a hinge, and one of every kind beside them.
SHAPES = (
    '<geom type="sphere" size=".05"/>',
    '<geom type="capsule" size=".03 .06"/>',
    '<geom type="ellipsoid" size=".04 .06 .05"/>',
    '<geom type="cylinder" size=".04 .05"/>',
    '<geom type="box" size=".05 .04 .03"/>',
    '<geom type="mesh" mesh="wedge"/>',
    '<geom type="box" size=".03 .03 .06"/><geom type="sphere" size=".04" pos=".06 0 0"/>',
    '<geom type="capsule" size=".03 .05"/><body pos="0 0 .08"><joint axis="1 0 0"/>'
    '<geom type="box" size=".03 .03 .04" margin=".004"/></body>',
)
ASSETS = """
<asset>
<mesh name="wedge" vertex=".05 .04 0 -.05 .04 0 -.05 -.04 0 .05 -.04 0 .03 0 .06 -.03 0 .06"/>
<hfield name="waves" nrow="12" ncol="12" size=".6 .6 .04 .1"
 elevation="{}"/></asset>
""".format(" ".join(f"{(i * 7 % 5) / 5}" for i in range(144)))


@contextmanager
def mujoco_looks_itself() -> Iterator[None]:
    """Set a filter that leaves out what MuJoCo's bits leave out."""

    def leaves_out(m: mujoco.MjModel, d: mujoco.MjData, a: int, b: int) -> int:
        first, second = m.geom(a), m.geom(b)
        meet = (first.contype & second.conaffinity) | (second.contype & first.conaffinity)
        return int(not meet)

    mujoco.set_mjcb_contactfilter(leaves_out)
    try:
        yield
    finally:
        mujoco.set_mjcb_contactfilter(None)


def heap(seed: int, ground: str) -> mujoco.MjModel:
    """Sixteen bodies thrown together; some with bits, exclusions and pairs of their own."""
    rng = np.random.default_rng(seed)
    bodies = []
    for i in range(16):
        x, y, z = rng.uniform((-0.25, -0.25, 0.1), (0.25, 0.25, 0.6))
        bodies.append(
            f'<body name="b{i}" pos="{x} {y} {z}"><freejoint/>{SHAPES[i % len(SHAPES)]}</body>'
        )
    return mujoco.MjModel.from_xml_string(f"""
<mujoco><option timestep=".004" cone="elliptic"/><size memory="8M"/>{ASSETS}
<default><geom friction=".4"/></default>
<worldbody>{ground}
 <body name="sweeper" mocap="true" pos="-.4 0 .1"><geom type="box" size=".02 .4 .1"/></body>
 <body name="fixed" mocap="true" pos="-.4 0 .2"><geom type="box" size=".02 .4 .1"/></body>
 <body name="own" pos="0 .1 .8"><freejoint/>
  <geom name="own" type="sphere" size=".05" contype="0" conaffinity="0"/></body>
 <body name="apart" pos=".1 0 .8"><freejoint/>
  <geom type="sphere" size=".05" contype="2" conaffinity="2"/></body>
 {"".join(bodies)}
</worldbody>
<contact><exclude body1="b0" body2="b4"/>
 <pair geom1="own" geom2="ground" margin=".002" condim="4"/></contact>
</mujoco>""")


GROUNDS = {
    "plane": '<geom name="ground" type="plane" size="1 1 .1"/>',
    "boxes": '<geom name="ground" type="box" size="1 1 .1" pos="0 0 -.1" contype="3"/>'
    '<geom type="box" size=".02 1 .3" pos=".5 0 .3" euler="0 5 0"/>',
    "waves": '<geom name="ground" type="hfield" hfield="waves"/>',
}


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("seed", [0, 3])  # of 2, 6 and 9 such trees spin too fast, see below
def test_contacts_and_motion_are_those_of_mujocos_own_search(ground: str, seed: int) -> None:
    model = heap(seed, GROUNDS[ground])
    rng = np.random.default_rng(seed)
    # No faster: trees in two parts would spin faster than MuJoCo's integration in flight bears, and
    # of boxes it finds some beyond its reach, whose gap along an axis is less than their distance.
    start = rng.normal(scale=(2.0,) * 3 + (5.0,) * 3, size=(model.nv // 6 + 1, 6)).ravel()
    engine, own = dashpot.Engine(model), dashpot.Engine(model)
    kept, anew = engine.make_data(), own.make_data()
    kept.qvel[:] = anew.qvel[:] = start[: model.nv]
    contacts = 0
    for step in range(120):
        kept.mocap_pos[0, 0] = anew.mocap_pos[0, 0] = -0.4 + 0.002 * step
        contacts += engine.step(kept).contacts
        with mujoco_looks_itself():
            own.step(anew)
        for field in FIELDS:
            np.testing.assert_array_equal(
                getattr(kept.contact, field), getattr(anew.contact, field), err_msg=field
            )
        np.testing.assert_array_equal(kept.qpos, anew.qpos)
    assert contacts > 800  # six a step and more; fields have few where they are smooth


def swinging_row(rotation: str) -> mujoco.MjModel:
    """Shapes whose distance MuJoCo searches for swing past and into each other on springs."""
    kinds = (
        'type="ellipsoid" size=".04 .06 .05"',
        'type="mesh" mesh="wedge"',
        'type="cylinder" size=".04 .05"',
        'type="capsule" size=".03 .06"',
    )
    bodies = "".join(
        f'<body pos="{0.15 * i} 0 0" euler="{17 * i} {31 * i} 0"><joint type="slide" axis="1 0 0"'
        f' stiffness="{20 * (1 + i % 3)}" springref=".03"/>'
        f'<joint axis="{rotation}" stiffness=".1"/>'
        f'<geom {kinds[i % 4]} mass="1"/></body>'
        for i in range(8)
    )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep=".004" gravity="0 0 0"/>{ASSETS}'
        f"<worldbody>{bodies}</worldbody></mujoco>"
    )


@pytest.mark.parametrize("rotation", ["1 0 0", "0 1 0", "1 2 3"])
def test_pairs_that_are_known_to_be_apart_are(rotation: str) -> None:
    model = swinging_row(rotation)
    engine, own = dashpot.Engine(model), dashpot.Engine(model)
    kept, anew = engine.make_data(), own.make_data()
    kept.qvel[:] = anew.qvel[:] = np.random.default_rng(0).normal(scale=0.5, size=model.nv)
    touching = 0
    for _ in range(1000):
        engine.step(kept)
        with mujoco_looks_itself():
            own.step(anew)
        np.testing.assert_array_equal(kept.contact.dist, anew.contact.dist)
        np.testing.assert_array_equal(kept.qpos, anew.qpos)
        touching += len(set(map(tuple, kept.contact.geom)))
    assert 400 < touching < 3500  # of 7 pairs beside each other in 1000 steps: they come and go


def grow(model: mujoco.MjModel) -> None:
    model.geom_size[0, :2] = 0.09


def become_a_box(model: mujoco.MjModel) -> None:
    model.geom_type[1] = mujoco.mjtGeom.mjGEOM_BOX


@pytest.mark.parametrize(
    ("edit", "distance"),
    [(grow, 0.125 - 0.09 - 0.06 / np.sqrt(2)), (become_a_box, 0.125 - 0.06 - 0.06 * np.sqrt(2))],
)
def test_geoms_whose_size_or_kind_is_edited_meet(
    edit: Callable[[mujoco.MjModel], None], distance: float
) -> None:
    # An ellipsoid, and along the diagonal a prism whose edges are on the axes. Their bounding boxes
    # and spheres overlap: the distance is asked for, and kept.
    apart = 0.125 / np.sqrt(2)
    edges = " ".join(f"{x} {y} {z}" for x, y in np.vstack([np.eye(2), -np.eye(2)]) for z in (-1, 1))
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string(f"""
<mujoco><option gravity="0 0 0"/>
<asset><mesh name="prism" vertex="{edges}" scale=".06 .06 .1"/></asset><worldbody>
 <body><freejoint/><geom type="ellipsoid" size=".06 .06 .1" mass="1"/></body>
 <body pos="{apart} {apart} 0"><freejoint/><geom type="mesh" mesh="prism" mass="1"/></body>
</worldbody></mujoco>""")
    )
    data = engine.make_data()
    engine.step(data, nstep=3)
    assert data.ncon == 0
    edit(engine.model)
    engine.step(data)
    # To the tolerance of MuJoCo's search.
    assert data.contact.dist.min() == pytest.approx(distance, abs=1e-5)


def ball(ground: str) -> dashpot.Engine:
    return dashpot.Engine(
        mujoco.MjModel.from_xml_string(f"""
<mujoco><option timestep=".002" cone="elliptic"/><worldbody>{ground}
 <body pos="0 0 .1"><freejoint/><geom name="ball" type="sphere" size=".1" mass="1"/></body>
</worldbody></mujoco>""")
    )


# Not at the origin of the world: MuJoCo's kinematics would not read an edited position.
BENEATH = pytest.mark.parametrize(
    "ground",
    [
        '<geom name="ground" type="plane" size="1 1 .1" pos=".1 0 0"/>',
        '<geom name="ground" type="box" size="1 1 .1" pos="0 0 -.1"/>',
    ],
    ids=["plane", "box"],
)


@BENEATH
def test_rest_ends_and_begins_with_the_bits_of_the_model(ground: str) -> None:
    engine = ball(ground)
    model, data = engine.model, engine.make_data()
    engine.step(data, nstep=100)
    assert data.ncon == 1
    model.geom("ball").conaffinity = model.geom("ball").contype = 0
    engine.step(data, nstep=10)
    fallen = 0.5 * 9.81 * 0.02**2
    assert data.ncon == 0
    assert data.qpos[2] == pytest.approx(0.1 - fallen, abs=0.01 * fallen + 1e-5)
    model.geom("ball").conaffinity = model.geom("ball").contype = 1
    engine.step(data)
    assert data.ncon == 1


@BENEATH
def test_ground_that_is_edited_to_rise_is_met_where_it_is(ground: str) -> None:
    engine = ball(ground)
    data = engine.make_data()
    data.qpos[2] = 1.0
    engine.step(data)
    assert data.ncon == 0
    engine.model.geom("ground").pos[2] += 0.9  # to just below the ball
    engine.step(data)
    assert data.ncon == 1


@BENEATH
def test_a_margin_that_is_edited_to_grow_reaches_farther(ground: str) -> None:
    engine = ball(ground)
    data = engine.make_data()
    data.qpos[2] = 0.4
    engine.step(data)
    assert data.ncon == 0
    engine.model.geom("ground").margin = 0.35
    engine.step(data)
    assert data.ncon == 1


@BENEATH
def test_teleported_bodies_are_found_where_they_are(ground: str) -> None:
    engine = ball(ground)
    data = engine.make_data()
    engine.step(data, nstep=20)
    rest = data.qpos.copy()
    data.qpos[:3] = (0.9, -0.9, 5.0)
    engine.step(data)
    assert data.ncon == 0
    data.qpos[:], data.qvel[:] = rest, 0.0
    engine.step(data)
    assert data.ncon == 1


def test_a_ball_whose_size_is_edited_rests_on_its_new_radius() -> None:
    engine = ball('<geom name="ground" type="plane" size="1 1 .1"/>')
    data = engine.make_data()
    engine.step(data)
    geom = engine.model.geom("ball")
    geom.size[0] = engine.model.geom_rbound[geom.id] = 0.2  # not geom_aabb
    data.qpos[2] = 0.3
    engine.step(data, nstep=400)
    assert data.qpos[2] == pytest.approx(0.2, abs=1e-5)


def test_bits_of_bodies_keep_them_apart_as_they_do_in_mujoco() -> None:
    engine = ball('<geom name="ground" type="plane" size="1 1 .1"/>')
    data = engine.make_data()
    engine.step(data)
    assert data.ncon == 1
    engine.model.body_contype[1] = engine.model.body_conaffinity[1] = 0
    engine.step(data)
    assert data.ncon == 0


def test_a_pair_that_is_edited_names_other_geoms() -> None:
    engine = dashpot.Engine(heap(0, GROUNDS["plane"]))
    model, data = engine.model, engine.make_data()
    low = model.geom("own").id + 1  # of the body named apart
    joint = model.body("apart").jntadr[0]
    data.qpos[model.jnt_qposadr[joint] + 2] = 0.05
    engine.step(data)
    assert not np.any(data.contact.geom == low)
    model.pair_geom1[0], model.pair_geom2[0] = model.geom("ground").id, low
    engine.step(data)
    assert np.any(data.contact.geom == low)


@BENEATH
def test_a_geom_at_no_place_is_named(ground: str) -> None:
    engine = ball(ground)
    data = engine.make_data()
    engine.model.geom("ground").pos[0] = np.nan
    with pytest.raises(ValueError, match="geom_pos of geom 'ground' holds nan"):
        engine.step(data)


def test_a_margin_that_is_no_number_is_named() -> None:
    engine = ball('<geom name="ground" type="box" size="1 1 .1" pos="0 0 -.1"/>')
    data = engine.make_data()
    engine.model.geom("ground").margin = np.nan
    with pytest.raises(ValueError, match=r"model\.geom_margin of geom 'ground' holds nan"):
        engine.step(data)


def test_one_engine_steps_several_data_as_engines_of_their_own_do() -> None:
    model = heap(5, GROUNDS["boxes"])
    shared = dashpot.Engine(model)
    engines = [dashpot.Engine(model) for _ in range(3)]
    together = [shared.make_data() for _ in range(3)]
    alone = [engine.make_data() for engine in engines]
    for i, (a, b) in enumerate(zip(together, alone, strict=True)):
        a.qvel[:] = b.qvel[:] = np.random.default_rng(i).normal(size=model.nv)
    for _ in range(40):
        for a, b, engine in zip(together, alone, engines, strict=True):
            shared.step(a)
            engine.step(b)
    for a, b in zip(together, alone, strict=True):
        np.testing.assert_array_equal(a.qpos, b.qpos)


def test_contacts_without_room_are_an_error_that_names_the_memory() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><size memory="20K"/><worldbody><geom type="plane" size="1 1 .1"/>'
        + "".join(
            f'<body pos="{0.1 * i} 0 .05"><freejoint/><geom type="box" size=".04 .04 .05"/></body>'
            for i in range(20)
        )
        + "</worldbody></mujoco>"
    )
    model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    engine = dashpot.Engine(model)
    with pytest.raises(RuntimeError, match="memory"):
        engine.step(engine.make_data())


def test_meshes_that_start_in_one_place_meet_as_in_mujoco() -> None:
    # There MuJoCo's search finds nothing, as if they were apart; from the next step on it does.
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option gravity="0 0 0"/>{ASSETS}<worldbody>
      <body><freejoint/><geom type="mesh" mesh="wedge" mass="1"/></body>
      <body><freejoint/><geom type="mesh" mesh="wedge" mass="1"/></body></worldbody></mujoco>""")
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qvel[6:9] = [0.2, 0.1, 0.05]
    engine.step(data)
    for _ in range(10):
        peer = mujoco.MjData(model)
        peer.qpos[:] = data.qpos
        mujoco.mj_fwdPosition(model, peer)
        assert peer.ncon > 0
        engine.step(data)
        assert data.ncon > 0
