"""Edits of the engine's model between steps."""

import operator

import mujoco
import numpy as np
import pytest

from dashpot import Engine, Material, rollout

SCENE = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
  <body pos="0 0 .1"><freejoint/><geom name="ball" size=".1"/></body></worldbody>
<contact><pair name="rolls" geom1="floor" geom2="ball"/></contact></mujoco>"""


def refuses(engine, data, message):
    """Check that neither a step nor an engine takes the edited model, and that data stay."""
    before = data.qpos.copy()
    with pytest.raises(ValueError, match=message):
        engine.step(data)
    assert np.array_equal(data.qpos, before)
    with pytest.raises(ValueError, match=message):
        Engine(engine.model)


@pytest.mark.parametrize(
    ("field", "named"), [("geom_condim", "geom_condim of 'ball'"), ("pair_dim", "pair_dim of 'rol")]
)
@pytest.mark.parametrize("condim", [0, 2, 7, 1000])
def test_a_condim_that_is_none_names_what_has_it(field, named, condim):
    engine = Engine(mujoco.MjModel.from_xml_string(SCENE))
    data = engine.make_data()
    engine.step(data)
    getattr(engine.model, field)[-1] = condim
    refuses(engine, data, f"model.{named}.* is {condim}; it must be 1, 3, 4 or 6")


@pytest.mark.parametrize("flag", ["fwdinv", "diagexact"])
def test_flags_of_mujocos_own_solver_are_listed(flag):
    model = mujoco.MjModel.from_xml_string(SCENE)
    assert flag not in str(Engine(model).report())
    model.opt.enableflags = int(getattr(mujoco.mjtEnableBit, f"mjENBL_{flag.upper()}"))
    engine = Engine(model)
    assert [f.treatment for f in engine.report().features if f.name == f"flag {flag}"] == ["mapped"]
    data = engine.make_data()
    engine.step(data)
    assert data.solver_fwdinv.tolist() == [0.0, 0.0]


CARTS = """<mujoco><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="9 9 1" friction=".5"/>
  <body name="box" pos="0 0 .1"><freejoint/><geom name="box" type="box" size=".1 .1 .1" mass="1"
    friction=".5"/></body>
  <body name="ball" pos="0 1 9"><joint type="free"/><geom name="ball" size=".1" mass="1"/></body>
  <body name="cart" pos="0 2 1"><joint name="cart" type="slide" axis="1 0 0"/>
    <geom type="box" size=".1 .1 .1" mass="1"/></body>
  <body name="wheel" pos="0 3 1"><joint name="wheel" axis="0 0 -1"/>
    <geom type="cylinder" size=".1 .1" mass="1"/></body>
  <body name="globe" pos="0 4 1"><joint name="globe" type="ball"/><geom size=".1" mass="1"/></body>
</worldbody></mujoco>"""


def test_masses_that_are_edited_act_from_the_next_step_on():
    # MuJoCo takes the inertia of these bodies from a constant that mj_setConst computes; by it a
    # box of four times the mass would weigh four times too much, or fall at 4 g.
    engine = Engine(mujoco.MjModel.from_xml_string(CARTS))
    model, data = engine.model, engine.make_data()
    engine.step(data, nstep=50)
    bodies = slice(1, None)
    model.body_mass[bodies] *= 4.0
    model.body_inertia[bodies] *= 4.0
    carts = {name: model.jnt_dofadr[model.joint(name).id] for name in ("cart", "wheel", "globe")}
    model.dof_armature[list(carts.values())] = 0.5
    start = data.qvel.copy()
    for dof in carts.values():
        data.qfrc_applied[dof] = 1.0
    data.xfrc_applied[1, 0] = 0.9 * 0.5 * 4.0 * 9.81
    engine.step(data, nstep=100)
    time = 100 * model.opt.timestep

    weight = 4.0 * 9.81
    pair = engine.contacts(data, pair=("box", "floor"))
    np.testing.assert_allclose(pair.force[:, 0].sum(), weight, rtol=1e-6)
    np.testing.assert_allclose(data.qvel[:6], 0.0, atol=1e-6)
    np.testing.assert_allclose(data.qvel[6:12] - start[6:12], [0, 0, -9.81 * time, 0, 0, 0])
    inertia = {"cart": 4.0, "wheel": 4.0 * 0.1**2 / 2, "globe": 4.0 * 0.4 * 0.1**2}
    for name, dof in carts.items():
        np.testing.assert_allclose(data.qvel[dof], time / (inertia[name] + 0.5), err_msg=name)


CLOSED = """<mujoco><option timestep="0.002"/><worldbody>
  <body><joint axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1" contype="0" conaffinity="0"/>
    <body name="coupler" pos=".3 0 0"><joint axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass="1" contype="0" conaffinity="0"/>
    </body></body>
  <body name="rocker" pos=".5 0 0"><joint axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 -.2 0 -.3" size=".02" mass="1" contype="0" conaffinity="0"/>
  </body></worldbody>
<equality><connect body1="coupler" body2="rocker" anchor="0 0 -.3"/></equality></mujoco>"""


PRESSED = """<mujoco><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="9 9 1" friction=".5"/>
  <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="{0}"/></body>
  <body pos="0 1 .1"><joint type="slide" axis="0 0 1"/>
    <geom type="box" size=".1 .1 .1" mass="{0}"/></body>
  <body pos="0 2 .1"><joint axis="0 1 0"/><geom type="box" pos=".3 0 0" size=".1 .1 .1" mass="{0}"/>
    <body pos=".5 0 0"><joint name="end" axis="0 1 0" range="-5 5"/>
      <geom type="box" pos=".2 0 0" size=".1 .1 .1" mass="{0}"/></body></body>
  <body pos="0 3 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="{0}" solref="-1e3 -20"/>
  </body></worldbody>
<tendon><fixed name="end"><joint joint="end" coef="1"/></fixed></tendon></mujoco>"""


@pytest.mark.parametrize("factor", [1e-3, 1e3, 1e5])
def test_what_rests_on_a_floor_sags_by_the_masses_that_it_has(factor):
    """The least stiffness of a rigid contact goes by a hundredth of the typical inverse mass."""
    compiled = Engine(mujoco.MjModel.from_xml_string(PRESSED.format(factor)))
    edited = Engine(mujoco.MjModel.from_xml_string(PRESSED.format(1.0)))
    edited.model.body_mass[1:] *= factor
    edited.model.body_inertia[1:] *= factor
    data = [engine.make_data() for engine in (compiled, edited)]
    for engine, one in zip((compiled, edited), data, strict=True):
        engine.step(one, nstep=300)
    for name in ("body_invweight0", "dof_invweight0", "tendon_invweight0", "body_subtreemass"):
        wanted, found = getattr(compiled.model, name), getattr(edited.model, name)
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-300, err_msg=name)
    assert len(compiled.contacts(data[0]).gap) > 10
    sag = [
        engine.contacts(one).compression
        for engine, one in zip((compiled, edited), data, strict=True)
    ]
    np.testing.assert_allclose(sag[1], sag[0], rtol=1e-6)
    np.testing.assert_allclose(data[1].qpos, data[0].qpos, rtol=1e-9, atol=1e-10)


def test_gravity_does_the_work_of_masses_that_are_edited():
    engine = Engine(mujoco.MjModel.from_xml_string(CLOSED))
    model, data = engine.model, engine.make_data()
    body = model.body("coupler").id
    model.body_mass[body] *= 4.0
    model.body_inertia[body] *= 4.0

    def energy():
        now = engine.energy(data)
        return now.kinetic + now.potential

    engine.step(data)
    before = energy()
    engine.step(data, nstep=1000)
    # It swings by several joules. Steps of 2 ms take a hundredth of them in 2 s; the weight of one
    # mass on the motion of the other took half of them.
    assert energy() == pytest.approx(before, abs=0.1)
    assert model.body_subtreemass[[0, 1, body]].tolist() == [6.0, 5.0, 4.0]


def test_rollouts_follow_edited_masses_as_steps_do():
    engine = Engine(mujoco.MjModel.from_xml_string(CARTS))
    data = engine.make_data()
    engine.model.body_mass[1:] *= 4.0
    spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(engine.model, spec))
    mujoco.mj_getState(engine.model, data, state, spec)
    states, _ = rollout(engine, np.tile(state, (3, 1)), nstep=30, nthread=2)
    nq, nv = engine.model.nq, engine.model.nv
    fallen = states[:, -1, 1 + nq : 1 + nq + nv][:, 8]
    np.testing.assert_allclose(fallen, -9.81 * 30 * engine.model.opt.timestep)
    engine.step(data, nstep=30)
    mujoco.mj_getState(engine.model, data, state, spec)
    assert all(np.array_equal(last, state) for last in states[:, -1])


def test_masses_that_stay_are_those_of_mujoco_to_the_bit():
    model = mujoco.MjModel.from_xml_string(CARTS)
    engine = Engine(model)
    engine.step(engine.make_data())
    assert np.array_equal(engine.model.dof_M0, model.dof_M0)


@pytest.mark.parametrize(
    ("field", "entry", "value", "message"),
    [
        ("body_mass", 1, 0.0, "model.body_mass of 'box' holds 0.0.*> 0"),
        ("body_mass", 2, -1.0, "model.body_mass of 'ball' holds -1.0.*> 0"),
        ("body_inertia", (5, 1), np.nan, "model.body_inertia of 'globe' holds nan.*> 0"),
        ("geom_size", (2, 0), -0.1, "model.geom_size of geom 'ball' holds -0.1.*>= 0"),
        ("geom_size", (1, 2), np.inf, "model.geom_size of geom 'box' holds inf.*>= 0"),
    ],
)
def test_masses_and_sizes_that_are_none_name_what_has_them(field, entry, value, message):
    engine = Engine(mujoco.MjModel.from_xml_string(CARTS))
    data = engine.make_data()
    engine.step(data)
    getattr(engine.model, field)[entry] = value
    before = data.qpos.copy()
    with pytest.raises(ValueError, match=message):
        engine.step(data)
    assert np.array_equal(data.qpos, before)


HELD = """<mujoco><worldbody>
  <body name="box"><joint name="slide" type="slide" range="-1 1" limited="true"/>
    <geom name="crate" size=".1"/></body>
  <body name="ball" pos="1 0 0"><freejoint/><geom size=".1"/></body></worldbody>
<equality><weld name="glue" body1="box" body2="ball"/></equality></mujoco>"""


@pytest.mark.parametrize(
    ("field", "entry", "message"),
    [
        ("body_pos", (2, 1), "model.body_pos of body 'ball' holds nan; it must be finite"),
        ("body_quat", (1, 0), "model.body_quat of body 'box' holds nan; it must be finite"),
        ("body_ipos", (2, 1), "model.body_ipos of body 'ball' holds nan; it must be finite"),
        ("body_iquat", (1, 0), "model.body_iquat of body 'box' holds nan; it must be finite"),
        ("jnt_pos", (0, 1), "model.jnt_pos of joint 'slide' holds nan; it must be finite"),
        ("jnt_axis", (0, 0), "model.jnt_axis of joint 'slide' holds nan; it must be finite"),
        ("geom_pos", (0, 2), "model.geom_pos of geom 'crate' holds nan; it must be finite"),
        ("geom_quat", (0, 3), "model.geom_quat of geom 'crate' holds nan; it must be finite"),
        ("eq_data", (0, 4), "model.eq_data of equality 'glue' holds nan; it must be finite"),
        ("jnt_range", (0, 1), "model.jnt_range of joint 'slide' holds nan; it must be a number"),
        ("dof_damping", 0, "model.dof_damping of joint 'slide' holds nan; it must be finite"),
        ("dof_armature", 0, "model.dof_armature of joint 'slide' holds nan; it must be finite"),
        ("opt.gravity", 2, "model.opt.gravity holds nan; it must be finite"),
        ("opt.wind", 0, "model.opt.wind holds nan; it must be finite"),
    ],
)
def test_what_is_no_number_is_named(field, entry, message):
    engine = Engine(mujoco.MjModel.from_xml_string(HELD))
    data = engine.make_data()
    engine.step(data)
    operator.attrgetter(field)(engine.model)[entry] = np.nan
    refuses(engine, data, message)


# What steps read of the other objects, each with one of them that has a name.
MACHINE = """<mujoco><worldbody>
  <body name="arm"><joint name="hinge" axis="0 1 0" range="-1 1" limited="true"/>
    <geom name="link" size=".1" pos=".2 0 0"/><site name="tip"/></body>
  <body name="cart" pos="1 0 0"><joint name="rail" type="slide"/><geom name="box" size=".1"/></body>
</worldbody>
<contact><pair name="pair" geom1="link" geom2="box"/></contact>
<equality><joint name="gear" joint1="hinge" joint2="rail"/></equality>
<tendon><fixed name="cord" range="-1 1" limited="true">
  <joint joint="hinge" coef="1"/></fixed></tendon>
<actuator><position name="servo" joint="hinge"/></actuator></mujoco>"""
FIELDS = {
    "geom 'box'": "geom_margin geom_gap geom_solref geom_solimp geom_solmix geom_surfacevel "
    "geom_adhesion",
    "pair 'pair'": "pair_margin pair_gap pair_solref pair_solreffriction pair_solimp pair_adhesion",
    "site 'tip'": "site_pos site_quat",
    "body 'cart'": "body_gravcomp",
    "joint 'rail'": "jnt_solref jnt_solimp jnt_stiffness jnt_stiffnesspoly qpos0 "
    "qpos_spring dof_dampingpoly dof_frictionloss dof_solref dof_solimp",
    "equality 'gear'": "eq_solref eq_solimp",
    "tendon 'cord'": "tendon_stiffness tendon_stiffnesspoly "
    "tendon_damping tendon_dampingpoly tendon_armature tendon_frictionloss tendon_solref_lim "
    "tendon_solimp_lim tendon_solref_fri tendon_solimp_fri",
    "actuator 'servo'": "actuator_dynprm actuator_gainprm actuator_biasprm actuator_damping "
    "actuator_dampingpoly actuator_armature actuator_cranklength actuator_gear",
}
# Infinite ones are none.
RANGES = {
    "joint 'rail'": "jnt_range jnt_actfrcrange jnt_margin",
    "tendon 'cord'": "tendon_range tendon_actfrcrange tendon_lengthspring tendon_margin",
    "actuator 'servo'": "actuator_actrange actuator_forcerange actuator_ctrlrange",
}


@pytest.mark.parametrize(
    ("owner", "field"),
    [(owner, field) for owner, names in FIELDS.items() for field in names.split()],
)
def test_every_number_that_steps_read_is_named_where_it_is_none(owner, field):
    """Margins and dry friction that were no numbers switched limits and friction off in silence."""
    engine = Engine(mujoco.MjModel.from_xml_string(MACHINE))
    data = engine.make_data()
    engine.step(data)
    values = getattr(engine.model, field)
    values.reshape(len(values), -1)[-1, -1] = np.nan
    refuses(engine, data, f"model.{field} of {owner} holds nan; it must be finite")


@pytest.mark.parametrize(
    ("owner", "field"),
    [(owner, field) for owner, names in RANGES.items() for field in names.split()],
)
def test_ranges_may_be_infinite_but_are_numbers(owner, field):
    engine = Engine(mujoco.MjModel.from_xml_string(MACHINE))
    data = engine.make_data()
    values = getattr(engine.model, field)
    values.reshape(len(values), -1)[-1, -1] = np.inf
    engine.step(data)
    values.reshape(len(values), -1)[-1, -1] = np.nan
    refuses(engine, data, f"model.{field} of {owner} holds nan; it must be a number")


CLOTH = """<mujoco><worldbody><flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1"
  radius=".01" mass=".1"/></worldbody></mujoco>"""


@pytest.mark.parametrize(
    "field",
    [
        "flex_friction",
        "flex_margin",
        "flex_gap",
        "flex_solref",
        "flex_solimp",
        "flex_solmix",
        "flex_radius",
        "flex_damping",
        "flex_edgestiffness",
        "flex_edgedamping",
    ],
)
def test_numbers_of_flexes_are_named_where_they_are_none(field):
    engine = Engine(mujoco.MjModel.from_xml_string(CLOTH))
    data = engine.make_data()
    engine.step(data)
    values = getattr(engine.model, field)
    values.reshape(len(values), -1)[0, -1] = np.nan
    refuses(engine, data, f"model.{field} of flex 'cloth' holds nan; it must be finite")


@pytest.mark.parametrize(
    "unused",
    [
        '<geom size=".1" pos="0 0 9" contype="0" conaffinity="0" solref="0.02 0"/>',
        '<body pos="0 0 8"><joint solreflimit="0 1"/><geom size=".1"/></body>',
        '<body pos="0 0 8"><joint solreffriction="0.02 0"/><geom size=".1"/></body>',
    ],
)
def test_a_solref_that_nothing_reads_may_be_of_any_format(unused):
    model = mujoco.MjModel.from_xml_string(SCENE.replace("</worldbody>", f"{unused}</worldbody>"))
    engine = Engine(model)
    engine.step(engine.make_data())


def test_a_tendon_that_comes_to_couple_trees_is_named():
    """Of bodies that a limit of their tendon joins only after the engine was made."""
    bodies = "".join(
        f'<body pos="{i} 0 0"><joint name="j{i}"/><geom size=".1"/></body>' for i in range(3)
    )
    joints = "".join(f'<joint joint="j{i}" coef="1"/>' for i in range(3))
    engine = Engine(
        mujoco.MjModel.from_xml_string(
            f"""<mujoco><worldbody>{bodies}</worldbody><tendon>
            <fixed name="cord" range="-1 1" limited="false">{joints}</fixed></tendon></mujoco>"""
        )
    )
    data = engine.make_data()
    data.qpos[:] = 1.0
    engine.step(data)
    engine.model.tendon_limited[0] = True
    with pytest.raises(ValueError, match=r"^limit of tendon 'cord' couples more than two .* new"):
        engine.step(data)
    again = Engine(engine.model)
    again.step(again.make_data())


def test_a_refused_rollout_leaves_no_half_of_an_edit():
    """Inverse masses followed an edit only in part where another one was refused beside it."""
    model = mujoco.MjModel.from_xml_string(MACHINE)
    model.body_mass[1] *= 3.0
    model.body_inertia[1] *= 3.0
    edited, fresh = Engine(mujoco.MjModel.from_xml_string(MACHINE)), Engine(model)
    edited.model.body_mass[1] *= 3.0
    edited.model.body_inertia[1] *= 3.0
    start = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mass = edited.model.body_mass[2]
    edited.model.body_mass[2] = np.nan
    with pytest.raises(ValueError, match="body_mass of 'cart' holds nan"):
        rollout(edited, start)
    edited.model.body_mass[2] = mass
    rollout(edited, start)
    rollout(fresh, start)
    for name in ("dof_M0", "body_subtreemass", "body_invweight0", "dof_invweight0"):
        assert np.array_equal(getattr(edited.model, name), getattr(fresh.model, name)), name


@pytest.mark.parametrize("field", ["density", "viscosity"])
def test_a_medium_that_is_none_is_named(field):
    engine = Engine(mujoco.MjModel.from_xml_string(HELD))
    data = engine.make_data()
    setattr(engine.model.opt, field, np.inf)
    with pytest.raises(ValueError, match=f"model.opt.{field} holds inf; it must be finite"):
        engine.step(data)


CUBE = " ".join(f"{x} {y} {z}" for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1))
OCTAHEDRON = ".2 0 0 -.2 0 0 0 .2 0 0 -.2 0 0 0 .2 0 0 -.2"
TARGET = f"""<mujoco><option timestep="0.005" gravity="0 0 0"/>
  <asset><mesh name="cube" vertex="{CUBE}"/><mesh name="octahedron" vertex="{OCTAHEDRON}"/></asset>
  <worldbody><body><freejoint/><geom type="mesh" mesh="cube" mass="1e6"/></body>
    <body name="ball"><freejoint/><geom size=".05" mass=".3"/></body></worldbody></mujoco>"""
SPEED, BESIDE = 5.0, np.array([0.04, 0.06])  # m/s along x; m off the target's middle in y and z


def throw_at_target(engine):
    """Return the direction in which an elastic ball without friction flies off."""
    data = engine.make_data()
    data.qpos[7:10] = [-0.5, *BESIDE]
    data.qvel[6] = SPEED
    engine.step(data, nstep=30)
    return data.qvel[6:9] / SPEED


@pytest.mark.parametrize("edited", ["mesh", "type"])
def test_a_geom_of_another_shape_is_hit_as_what_it_is(edited):
    engine = Engine(mujoco.MjModel.from_xml_string(TARGET))
    for geom in range(2):
        engine.set_material(geom, Material(stiffness=1e6, restitution=1.0, friction=0.0))
    model = engine.model
    assert throw_at_target(engine) == pytest.approx([-1, 0, 0], abs=1e-5)  # a millionth of its mass
    if edited == "mesh":
        model.geom_dataid[0] = model.mesh("octahedron").id
        normal = np.array([-1.0, 1.0, 1.0]) / np.sqrt(3)
    else:
        model.geom_type[0] = mujoco.mjtGeom.mjGEOM_SPHERE
        offset = BESIDE / (0.2 + 0.05)  # of the ball's centre, in the sum of the radii
        normal = np.array([-np.sqrt(1 - offset @ offset), *offset])
        # It follows the way along it while the spring, of half the stiffness, is compressed, and
        # acts where it has after half of that time, 1.2 ms.
        along = np.array([1.0, 0, 0]) - normal[0] * normal
        normal += SPEED / (0.2 + 0.05) * 0.5 * np.pi * np.sqrt(0.3 / 0.5e6) * along
        normal /= np.linalg.norm(normal)
    model.geom_size[0], model.geom_aabb[0, 3:], model.geom_rbound[0] = 0.2, 0.2, 0.2
    expected = np.array([1.0, 0, 0]) - 2 * normal[0] * normal
    assert throw_at_target(engine) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("flag", ["constraint", "contact", "equality", "limit", "frictionloss"])
def test_rows_that_a_flag_disables_are_reported(flag):
    """What MJCF turns off does nothing, which the report says."""
    xml = f'<mujoco><option><flag {flag}="disable"/></option></mujoco>'
    reported = {f.name for f in Engine(mujoco.MjModel.from_xml_string(xml)).report().features}
    assert f"flag {flag}=disable" in reported


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (99, "model.geom_type of geom 'box' is 99, which is no type of geoms"),
        (-1, "model.geom_type of geom 'box' is -1, which is no type of geoms"),
        (mujoco.mjtGeom.mjGEOM_MESH, "model.geom_dataid of geom 'box' is -1; a mesh must be one"),
        (mujoco.mjtGeom.mjGEOM_HFIELD, "model.geom_dataid of geom 'box' is -1; a height field"),
        (mujoco.mjtGeom.mjGEOM_SDF, "model.geom_type of geom 'box' is sdf, but it has neither"),
    ],
)
def test_a_shape_that_a_geom_cannot_have_is_refused(shape, message):
    """MuJoCo's collision reads beyond its arrays there."""
    engine = Engine(mujoco.MjModel.from_xml_string(CARTS))
    data = engine.make_data()
    engine.step(data)
    before = data.qpos.copy()
    engine.model.geom_type[1] = shape
    with pytest.raises(ValueError, match=message):
        engine.step(data)
    assert np.array_equal(data.qpos, before)


def test_a_contact_that_was_a_dashpot_alone_gets_a_spring():
    """What it remembered was not a number from there on."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><default><geom solref="0 -100"/></default>
      <worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 .0999"><freejoint/>
      <geom size=".1" mass="1"/></body></worldbody></mujoco>""")
    engine = Engine(model)
    data = engine.make_data()
    engine.step(data, nstep=5)
    assert engine.contacts(data).force[0, 0] > 0.0
    engine.model.geom_solref[:] = 0.02, 1.0
    engine.step(data, nstep=500)
    assert np.isfinite(data.userdata).all()
    assert engine.contacts(data).force[0, 0] == pytest.approx(9.81, rel=1e-6)
