"""Kinetic, potential, elastic and dissipated energy less the work done is constant, scene by scene.

Energy turned over is the largest kinetic energy plus all that was dissipated by then. Free bodies
keep the ledger at any step. Joints are integrated semi-implicitly to first order, as MuJoCo does:
their energy swings by about half a step times the rate of the motion, contact or no contact, so
their scenes take short steps.
"""

from __future__ import annotations

from itertools import product

import mujoco
import numpy as np
import pytest

import dashpot

TENTH_PERCENT = 1e-3
TURNED = 'quat="0.8 0.3 0.4 0.33"'
TUMBLE = (1.0, 0.5, 0.0, 5.0, -3.0, 2.0)


def world(bodies: str, rest: str = "", *, condim: int = 6) -> str:
    points = np.random.default_rng(3).normal(size=(24, 3)) * (0.06, 0.05, 0.08)
    vertices = " ".join(f"{x:.4f}" for x in points.ravel())
    return f"""<mujoco><asset><mesh name="hull" vertex="{vertices}"/></asset><worldbody>
      <geom type="plane" size="0 0 1" friction="0.6 0.01 0.002" condim="{condim}"/>
      {bodies}</worldbody>{rest}</mujoco>"""


def free(geom: str, position: str = "0 0 0.5", turn: str = TURNED, name: str = "") -> str:
    label = f'name="{name}"' if name else ""
    return f'<body {label} pos="{position}" {turn}><freejoint/><geom {geom}/></body>'


def chain(links: int, joint: str = "", *, height: float = 1.2, collide: bool = False) -> str:
    switch = "" if collide else 'contype="0" conaffinity="0"'
    bodies = ""
    for i in range(links):
        position = "0.2 0 0" if i else f"0 0 {height}"
        bodies += f"""<body name="link{i}" pos="{position}">
          <joint name="j{i}" axis="0 1 0" {joint}/>
          <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.3" {switch}/>"""
    return bodies + "</body>" * links


def coupled(coefficients: str) -> str:
    return f"""<tendon><fixed name="t" {coefficients}><joint joint="j0" coef="1"/>
      <joint joint="j2" coef="-1"/></fixed></tendon>"""


SHAPES = (
    'type="sphere" size="0.06"',
    'type="box" size="0.05 0.06 0.04"',
    'type="capsule" size="0.04 0.05"',
    'type="mesh" mesh="hull"',
    'type="cylinder" size="0.05 0.04"',
    'type="ellipsoid" size="0.05 0.06 0.04"',
)

FREE_BODIES = {
    "box": world(free('type="box" size="0.05 0.08 0.03" mass="0.5"')),
    "mesh": world(free('type="mesh" mesh="hull" mass="0.5"')),
    "cylinder": world(free('type="cylinder" size="0.05 0.08" mass="0.5"'), condim=4),
    "ellipsoid": world(free('type="ellipsoid" size="0.05 0.08 0.06" mass="0.5"')),
    "frictionless": world(free('type="capsule" size="0.05 0.08" mass="0.5"'), condim=1),
    "stack": world(
        "".join(
            free('type="box" size="0.05 0.05 0.05" mass="1"', f"{0.01 * i} 0 {0.06 + 0.11 * i}", "")
            for i in range(4)
        )
    ),
    "pile": world(
        "".join(
            free(f'{shape} mass="1"', f"{0.03 * (i % 3)} {0.02 * (i % 2)} {0.2 + 0.13 * i}")
            for i, shape in enumerate(SHAPES)
        )
    ),
    "spinning sphere": world(free('type="sphere" size="0.1" mass="1"', "0 0 0.1"), condim=4),
    "rolling sphere": world(free('type="sphere" size="0.1" mass="1"', "0 0 0.1")),
    "welded boxes": world(
        free('type="box" size="0.05 0.05 0.05" mass="1"', "0 0 0.6", name="a")
        + free('type="box" size="0.05 0.05 0.05" mass="1"', "0.11 0 0.6", "", "b"),
        '<equality><weld body1="a" body2="b"/></equality>',
    ),
}

BALL_AND_SOCKET = """<body pos="0 0 1.2">
  <joint type="ball" range="0 40" limited="true" damping="0.01"/>
  <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.3"/>
  <body pos="0.3 0 0"><joint type="ball"/>
    <geom type="box" size="0.05 0.03 0.02" pos="0.07 0 0" mass="0.2" contype="0"/></body></body>"""

JOINTS = {
    "limits": world(chain(3, 'range="-40 40" limited="true"')),
    "dry friction": world(chain(3, 'frictionloss="0.2"')),
    "springs and dampers": world(chain(3, 'damping="0.05" stiffness="1"')),
    "ball joints": world(BALL_AND_SOCKET),
    "chain on the floor": world(chain(3, height=0.3, collide=True)),
    "connect": world(
        chain(3, height=1.0), '<equality><connect body1="link2" anchor="0.2 0 0"/></equality>'
    ),
    "joint equality": world(
        chain(2), '<equality><joint joint1="j0" joint2="j1" polycoef="0 .5 0 0 0"/></equality>'
    ),
    "tendon spring": world(chain(3), coupled('stiffness="3" damping="0.1" springlength="0.2"')),
    "tendon limit": world(chain(3), coupled('range="-0.5 0.5" limited="true" frictionloss="0.05"')),
    "tendon equality": world(
        chain(3),
        """<tendon><fixed name="t"><joint joint="j0" coef="1"/></fixed>
        <fixed name="u"><joint joint="j2" coef="-1"/></fixed></tendon>
        <equality><tendon tendon1="t" tendon2="u"/></equality>""",
    ),
}
WITHOUT_ROWS = ("springs and dampers", "tendon spring")


def ledger_error(
    xml: str,
    timestep: float,
    duration: float,
    *,
    velocity: tuple[float, ...] = (),
    material: dashpot.Material | None = None,
    integrator: mujoco.mjtIntegrator = mujoco.mjtIntegrator.mjINT_EULER,
    rows: bool = True,
) -> float:
    """Return the largest change of the ledger's total over the energy turned over."""
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.timestep = timestep
    model.opt.integrator = integrator
    engine = dashpot.Engine(model)
    if material is not None:
        for geom in range(model.ngeom):
            engine.set_material(geom, material)
    data = engine.make_data()
    data.qvel[: len(velocity)] = velocity
    start = engine.energy(data)
    error, peak, force = 0.0, start.kinetic, 0.0
    for _ in range(round(duration / timestep / 5)):
        engine.step(data, nstep=5)
        force = max(force, np.abs(data.qfrc_constraint).max())
        energy = engine.energy(data)
        peak = max(peak, energy.kinetic)
        error = max(error, abs(energy.total - start.total))
    assert energy.elastic >= 0
    assert energy.work == pytest.approx(0.0, abs=1e-12)
    # Of what does nothing any ledger closes. Hits may be over between two looks at the force.
    taken_by_rows = energy.dissipated - energy.dissipated_damping
    assert (force > 0.1 or taken_by_rows > 0.05) if rows else energy.dissipated_damping > 0.05
    return error / (peak + energy.dissipated)


@pytest.mark.parametrize("timestep", [0.001, 0.005])
@pytest.mark.parametrize("scene", FREE_BODIES)
def test_free_bodies_keep_the_ledger(scene, timestep):
    single = scene not in ("stack", "pile", "welded boxes")
    velocity = TUMBLE if single else ()
    assert ledger_error(FREE_BODIES[scene], timestep, 1.5, velocity=velocity) <= TENTH_PERCENT


@pytest.mark.parametrize("scene", FREE_BODIES)
def test_free_bodies_of_given_stiffness_keep_the_ledger(scene):
    material = dashpot.Material(2e4, damping_ratio=0.3)
    velocity = TUMBLE if scene not in ("stack", "pile", "welded boxes") else ()
    error = ledger_error(FREE_BODIES[scene], 0.002, 1.5, velocity=velocity, material=material)
    assert error <= TENTH_PERCENT


@pytest.mark.parametrize("timestep", [0.002, 0.01])
def test_bodies_that_spin_fast_into_each_other_keep_the_ledger(timestep):
    """They turn by up to 0.5 rad in a step: up to 9 % stayed out of it."""
    ellipsoid = 'type="ellipsoid" size=".05 .1 .15" mass="{}"'
    bodies = free(ellipsoid.format(1), "0 0 .5") + free(ellipsoid.format(2), "0 0 0")
    xml = f'<mujoco><option gravity="0 0 0"/><worldbody>{bodies}</worldbody></mujoco>'
    material = dashpot.Material(restitution=0.8, friction=0.3)
    for seed in range(8):
        spins = np.random.default_rng(seed).normal(size=(2, 3)) * 30.0
        velocity = (0.0, 0.0, -2.0, *spins[0], 0.0, 0.0, 0.0, *spins[1])
        error = ledger_error(xml, timestep, 0.4, velocity=velocity, material=material)
        assert error <= TENTH_PERCENT, seed


@pytest.mark.parametrize(
    ("scene", "integrator"),
    [
        *((scene, "EULER") for scene in JOINTS),
        *product(
            ("springs and dampers", "ball joints", "tendon limit"), ("IMPLICITFAST", "IMPLICIT")
        ),
    ],
)
def test_joints_keep_the_ledger(scene, integrator):
    error = ledger_error(
        JOINTS[scene],
        5e-5,
        0.5,
        integrator=getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}"),
        rows=scene not in WITHOUT_ROWS,
    )
    assert error <= TENTH_PERCENT


@pytest.mark.parametrize("scene", JOINTS)
def test_the_ledger_of_joints_is_off_by_no_more_than_the_step(scene):
    """First order: half a step of motion at some 20 rad/s."""
    rows = scene not in WITHOUT_ROWS
    assert ledger_error(JOINTS[scene], 0.001, 0.5, rows=rows) <= 20 * 0.001


@pytest.mark.parametrize("scene", ["connect", "joint equality", "tendon equality"])
def test_equalities_keep_the_ledger_at_a_millisecond(scene):
    """Second order: the trapezoidal rule of trees that equalities hold."""
    assert ledger_error(JOINTS[scene], 0.001, 0.5) <= TENTH_PERCENT


@pytest.mark.parametrize("integrator", ["EULER", "IMPLICIT"])
def test_work_of_actuators_and_applied_forces_is_booked(integrator):
    """A servo swings a chain with dampers, and a force pushes a box along the floor."""
    servo = '<actuator><position joint="j1" kp="30" kv="4"/></actuator>'
    bodies = chain(3, 'damping="0.1"') + free('type="box" size=".1 .1 .1" mass="1"', "2 0 .1", "")
    model = mujoco.MjModel.from_xml_string(world(bodies, servo))
    model.opt.timestep = 5e-5
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    engine = dashpot.Engine(model)
    data = engine.make_data()
    start = engine.energy(data)
    box = model.nbody - 1
    pushed, first = 0.0, data.qpos[-7:-5].copy()
    for _ in range(10000):
        data.ctrl[0] = np.sin(5 * data.time)
        data.xfrc_applied[box, :3] = (20.0, 3.0, 0.0)
        before = data.qpos[-7:-4].copy()
        engine.step(data)
        pushed += data.xfrc_applied[box, :3] @ (data.qpos[-7:-4] - before)
    energy = engine.energy(data)
    assert pushed > 10.0
    assert energy.dissipated_damping > 0.1
    # The box brings the larger coefficient, 1; its friction springs load in the first millimetre.
    way = np.linalg.norm(data.qpos[-7:-5] - first)
    assert energy.dissipated_friction == pytest.approx(9.81 * way, rel=1e-3)
    assert energy.total == pytest.approx(start.total, abs=TENTH_PERCENT * pushed)
    # The push is most of the work; what is left is the servo's.
    assert 0.0 < energy.work - pushed < 0.5 * pushed


def test_work_of_a_motor_is_force_times_way():
    xml = """<mujoco><option gravity="0 0 0" timestep="0.002"/><worldbody><body>
      <joint name="x" type="slide" axis="1 0 0" damping="3"/><geom size=".1" mass="2"/></body>
      </worldbody><actuator><motor joint="x"/></actuator></mujoco>"""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    data = engine.make_data()
    data.ctrl[0] = 5.0
    engine.step(data, nstep=500)
    energy = engine.energy(data)
    # The semi-implicit position is half a step of speed ahead.
    ahead = 5.0 * 0.001 * data.qvel[0]
    assert energy.work == pytest.approx(5.0 * data.qpos[0] - ahead, rel=1e-9)
    assert energy.kinetic + energy.dissipated_damping == pytest.approx(energy.work, rel=1e-12)


@pytest.mark.parametrize("turn", [0, 10, 37])
def test_friction_of_planar_mechanisms_dissipates_no_more_than_is_put_in(turn):
    """Two links that nothing moves across their plane press on each other: nothing slips.

    Across the plane the stiffness of friction is a matter of rounding, and was taken for that of
    both tangents: 1e4 J of friction that recovery had put in.
    """
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option gravity="0 0 0" timestep="0.001"/>
      <default><joint type="slide" damping="5"/></default>
      <worldbody><body pos="0 0 .5" euler="0 0 {turn}"><freejoint/>
        <geom type="box" size=".02 .05 .02" mass="1" pos="0 0 .1"/>
        <body pos="-.02 0 0"><joint name="x1" axis="1 0 0"/><joint name="z1" axis="0 0 1"/>
          <geom type="box" size=".0199 .02 .03" mass=".1"/></body>
        <body pos=".02 0 0"><joint name="x2" axis="1 0 0"/><joint name="z2" axis="0 0 1"/>
          <geom size=".0199" mass=".1"/></body></body></worldbody>
      <actuator><motor joint="x1"/><motor joint="x2"/><motor joint="z1"/><motor joint="z2"/>
      </actuator></mujoco>""")
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.ctrl[:] = [10, -10, -3, 3]
    engine.step(data, nstep=3000)
    energy = engine.energy(data)
    # The motors press both on each other with 10 N, and shear them with 3 N.
    contacts = engine.contacts(data, pair=(1, 2))
    np.testing.assert_allclose(contacts.force[:, 0].sum(), 10.0, rtol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(contacts.force[:, 1:3].sum(axis=0)), 3.0, rtol=1e-2)
    # Forces of 10 N close gaps of 0.2 mm.
    assert 0.0 <= energy.dissipated_friction < 0.004
    assert abs(energy.dissipated_recovery) < 0.004
