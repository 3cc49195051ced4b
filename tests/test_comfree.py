"""Law "comfree": the published complementarity-free update (ComFree-Sim, arXiv 2603.12185)."""

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq

import dashpot

GRAVITY = 9.81
STIFFNESS, DAMPING = 0.2, 0.001  # the published defaults, 1/s and 1

# Several shapes, every condim, unequal friction, a damped arm with a limit that it is pushed into.
SCENE = """
<mujoco>
  <option timestep="0.002" gravity="0 0 -9.81"/>
  <default><geom friction="0.6 0.02 0.003" solimp="0.85 0.97 0.004 0.3 3"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1" condim="1"/>
    <body pos="0 0 0.099"><freejoint/><geom name="low" type="box" size=".2 .15 .1" mass="2"/></body>
    <body pos="0.03 0.02 0.2985" euler="0 0 20"><freejoint/>
      <geom name="high" type="box" size=".1 .15 .1" mass="1" friction="0.9 0.02 0.003"/></body>
    <body pos="0.6 0 0.098"><freejoint/>
      <geom name="ball" size=".1" mass="0.5" condim="6" friction="0.7 0.03 0.01"/></body>
    <body pos="0 0.7 0.079" euler="90 0 30"><freejoint/>
      <geom name="capsule" type="capsule" size=".08 .1" mass="0.8" condim="4"/></body>
    <body pos="-0.8 0 0.5">
      <joint name="hinge" axis="0 1 0" range="-20 10" limited="true" damping="0.05"
        solimplimit="0.9 0.95 0.01 0.5 2"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size=".03" mass="0.3"/>
      <body pos="0.2 0 0"><joint name="slide" type="slide" axis="1 0 0" limited="true"
        range="-0.01 0.02"/><geom name="tip" size=".04" mass="0.1"/></body>
    </body>
  </worldbody>
</mujoco>
"""


def sigmoid_impedance(solimp, gap):
    """MuJoCo's documented impedance function."""
    start, end, width, midpoint, power = solimp
    x = min(1.0, abs(gap) / width)
    if x <= midpoint:
        y = x**power / midpoint ** (power - 1)
    else:
        y = 1 - (1 - x) ** power / (1 - midpoint) ** (power - 1)
    return start + y * (end - start)


def facets(model, data):
    """Yield (Jacobian row, gap, effective mass) of every facet that overlaps."""

    def mass(solimp, gap, inverse_mass):
        imp = sigmoid_impedance(solimp, gap)
        return imp / ((1 - imp) * inverse_mass)

    for contact in data.contact:
        gap = contact.dist
        if gap >= 0:
            continue
        jacobian = np.zeros((6, model.nv))
        bodies = model.geom_bodyid[contact.geom]
        frame = contact.frame.reshape(3, 3)
        for body, sign in zip(bodies, (-1, 1), strict=True):
            translation, rotation = np.zeros((3, model.nv)), np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, translation, rotation, contact.pos, body)
            jacobian += sign * np.vstack([frame @ translation, frame @ rotation])
        m = mass(contact.solimp, gap, model.body_invweight0[bodies, 0].sum())
        if contact.dim == 1:
            yield jacobian[0], gap, m
        for i in range(1, contact.dim):
            for sign in (1, -1):
                yield jacobian[0] + sign * contact.friction[i - 1] * jacobian[i], gap, m
    for joint in np.flatnonzero(model.jnt_limited):
        dof = model.jnt_dofadr[joint]
        for side, sign in ((0, 1.0), (1, -1.0)):
            gap = sign * (data.qpos[model.jnt_qposadr[joint]] - model.jnt_range[joint, side])
            if gap < 0:
                row = np.zeros(model.nv)
                row[dof] = sign
                yield row, gap, mass(model.jnt_solimp[joint], gap, model.dof_invweight0[dof])


def reference_step(model, data, qpos, qvel, stiffness=STIFFNESS, damping=DAMPING):
    """Return qpos and qvel after one published update, facet by facet."""
    dt = model.opt.timestep
    mujoco.mj_resetData(model, data)
    data.qpos, data.qvel = qpos, qvel
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    inertia += dt * np.diag(model.dof_damping)  # Euler is implicit in joint damping
    predicted = qvel + dt * np.linalg.solve(inertia, data.qfrc_smooth)
    force = np.zeros(model.nv)
    count = 0
    for row, gap, mass in facets(model, data):
        rate = row @ predicted
        push = -(damping / dt) * rate - (stiffness / dt) * (gap + dt * rate)
        force += row * max(0.0, mass * push)
        count += 1
    velocity = qvel + dt * np.linalg.solve(inertia, data.qfrc_smooth + force)
    position = qpos.copy()
    mujoco.mj_integratePos(model, position, velocity, dt)
    return position, velocity, count


def test_reference_impedance_is_mujocos():
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    impedances = data.efc_KBIP.reshape(-1, 4)[:, 2]
    for contact in data.contact:
        expected = sigmoid_impedance(contact.solimp, contact.dist)
        assert impedances[contact.efc_address] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("options", [{}, {"comfree_stiffness": 0.1, "comfree_damping": 0.003}])
@pytest.mark.parametrize("timestep", [0.002, 0.005])
def test_every_step_is_the_published_update(timestep, options):
    model = mujoco.MjModel.from_xml_string(SCENE)
    model.opt.timestep = timestep
    scratch = mujoco.MjData(model)
    engine = dashpot.Engine(model, law="comfree", **options)
    data = engine.make_data()
    data.qvel[:] = np.random.default_rng(3).normal(0, 0.5, model.nv)
    most = 0
    for _ in range(150):
        position, velocity, count = reference_step(
            model, scratch, data.qpos.copy(), data.qvel.copy(), *options.values()
        )
        engine.step(data)
        # Rounding: velocities are sums of some hundred terms of order 10.
        np.testing.assert_allclose(data.qvel, velocity, rtol=0, atol=1e-10)
        np.testing.assert_allclose(data.qpos, position, rtol=0, atol=1e-12)
        most = max(most, count)
    assert most >= 40  # facets: boxes lie on each other and on the floor


def box(solimp="0.9 0.9 0.001 0.5 2", friction=0.5, angle=0.0, height=0.05, timestep=0.002):
    """Return a box of 1 kg, 0.4 m wide, on a slope of `angle` (rad) given by tilting gravity."""
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="{timestep}"
        gravity="{GRAVITY * np.sin(angle)} 0 {-GRAVITY * np.cos(angle)}"/>
      <default><geom friction="{friction} 0 0" solimp="{solimp}"/></default>
      <worldbody>
        <geom name="floor" type="plane" size="9 9 .1"/>
        <body name="box" pos="0 0 {height}"><freejoint/>
          <geom type="box" size=".2 .2 {height}" mass="1"/><site name="box" size="1"/></body>
      </worldbody>
      <sensor><touch site="box"/></sensor>
    </mujoco>""")


FACETS = 4 * 4  # of a box on its face, condim 3


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005, 0.010])
@pytest.mark.parametrize("solimp", ["0.9 0.9 0.001 0.5 2", "0.8 0.95 0.02 0.4 3"])
def test_resting_depth_is_the_static_solution(timestep, solimp):
    model = box(solimp, timestep=timestep)
    engine = dashpot.Engine(model, law="comfree")
    data = engine.make_data()
    engine.step(data, nstep=round(3 / timestep))
    stats = engine.step(data)

    def excess(depth):
        imp = sigmoid_impedance(np.array(solimp.split(), float), depth)
        mass = imp / ((1 - imp) * 1.0)  # MuJoCo's estimate of a free body's inverse mass is 1/m
        load = GRAVITY / (FACETS * mass)
        return depth - timestep * (load - (DAMPING + STIFFNESS * timestep) * GRAVITY) / STIFFNESS

    expected = brentq(excess, 0, 0.1)
    assert 1e-5 < expected < 6e-3  # carried, with a small penetration
    assert 0.05 - data.qpos[2] == pytest.approx(expected, rel=1e-9)
    assert stats.max_penetration == pytest.approx(expected, rel=1e-9)
    assert np.abs(data.qvel).max() < 1e-10
    # Every report sees the weight.
    assert engine.contacts(data).force[:, 0].sum() == pytest.approx(GRAVITY, rel=1e-9)
    assert data.sensordata[0] == pytest.approx(GRAVITY, rel=1e-9)
    assert data.qfrc_constraint[2] == pytest.approx(GRAVITY, rel=1e-9)
    assert not engine.contacts(data).sticking.any()


def test_forces_push_and_stay_in_the_pyramid():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(SCENE), law="comfree")
    data = engine.make_data()
    data.qvel[:] = np.random.default_rng(8).normal(0, 2, engine.model.nv)
    loaded = sliding = 0
    for _ in range(400):
        engine.step(data)
        contacts = engine.contacts(data)
        dims = np.array([c.dim for c in data.contact])
        friction = np.array([c.friction for c in data.contact]).reshape(-1, 5)
        wrench = np.hstack([contacts.force, contacts.torque])
        assert (wrench[:, 0] >= 0).all()
        assert (wrench[contacts.gap >= 0] == 0).all()
        used = np.zeros(len(dims))
        for i in range(1, 6):
            rows = dims > i
            assert (wrench[~rows, i] == 0).all()
            used[rows] += np.abs(wrench[rows, i]) / friction[rows, i - 1]
        assert (used <= wrench[:, 0] * (1 + 1e-12)).all()
        loaded += np.count_nonzero(wrench[:, 0])
        sliding += np.count_nonzero(used > 0.5 * wrench[:, 0])
    assert loaded > 1000
    assert sliding > 100


def test_order_of_bodies_does_not_matter():
    # Spheres, whose contact points do not depend on which of the two comes first.
    places = ((0, 0, 0.099), (0.198, 0, 0.099), (0.1, 0.17, 0.099), (0.1, 0.058, 0.26))
    bodies = [
        f'<body pos="{x} {y} {z}"><freejoint/><geom size=".1" condim="6"/></body>'
        for x, y, z in places
    ]
    results = []
    for order in ([0, 1, 2, 3], [2, 0, 3, 1]):
        xml = "".join(bodies[i] for i in order)
        model = mujoco.MjModel.from_xml_string(
            f'<mujoco><worldbody><geom type="plane" size="3 3 1"/>{xml}</worldbody></mujoco>'
        )
        engine = dashpot.Engine(model, law="comfree")
        data = engine.make_data()
        assert engine.step(data).touching >= 6
        engine.step(data, nstep=20)
        results.append(data.qpos.reshape(4, 7)[np.argsort(order)])
    # Forces do not depend on each other, so that only the order of their sum does.
    np.testing.assert_allclose(*results, rtol=0, atol=1e-12)


def test_box_on_a_slope_creeps():
    """There is no stiction: the creep is steady, at the speed that the equations give."""
    angle, mu, dt, mass = np.radians(4), 0.5, 0.002, 9.0  # 9 = imp / (1 - imp), 1 kg
    engine = dashpot.Engine(box(friction=mu, angle=angle, height=0.01), law="comfree")
    data = engine.make_data()
    engine.step(data, nstep=2000)
    # 4 contacts, each with one row along the slope whose two facets both push.
    gain = 2 * mu**2 * mass * (DAMPING + STIFFNESS * dt) / dt
    predicted = GRAVITY * np.sin(angle) / (4 * gain)
    # A flat box hardly tilts: friction acts 0.01 m below its centre, over 0.4 m.
    assert data.qvel[0] == pytest.approx(predicted - dt * GRAVITY * np.sin(angle), rel=1e-3)


def test_sliding_box_stops():
    mu, speed = 0.3, 1.0
    engine = dashpot.Engine(box(friction=mu, height=0.02), law="comfree")
    data = engine.make_data()
    engine.step(data, nstep=1000)
    data.qvel[0] = speed
    total = engine.energy(data).total
    speeds = []
    for _ in range(100):
        engine.step(data, nstep=50)
        speeds.append(data.qvel[0])
    assert np.all(np.diff(speeds) < 1e-9)
    assert abs(speeds[-1]) < 1e-6
    assert data.qpos[0] > speed**2 / (2 * mu * GRAVITY)  # never brakes harder than Coulomb's law
    energy = engine.energy(data)
    assert energy.elastic == 0.0
    # At rest before and after, so that the ledger closes but for the tilt of the impulses' axes.
    assert energy.total == pytest.approx(total, abs=1e-4 * 0.5 * speed**2)
    assert energy.dissipated_friction == pytest.approx(0.5 * speed**2, rel=0.1)


def test_energy_of_a_drop_is_dissipated():
    engine = dashpot.Engine(box(), law="comfree")
    data = engine.make_data()
    data.qpos[2] += 0.2
    start = engine.energy(data)
    engine.step(data, nstep=3000)
    end = engine.energy(data)
    assert end.kinetic < 1e-15
    lost = start.potential - end.potential
    assert end.dissipated_normal == pytest.approx(lost, rel=1e-6)
    # A resting body's ledger does not drift.
    engine.step(data, nstep=1000)
    assert engine.energy(data).dissipated == pytest.approx(end.dissipated, rel=1e-9)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit"])
def test_without_contact_steps_are_mujocos(integrator):
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco><option integrator="{integrator}"/><worldbody>
      <body pos="0 0 5"><freejoint/><geom type="box" size=".1 .2 .3"/></body>
      <body pos="9 0 5"><joint axis="0 1 0" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/></body>
    </worldbody></mujoco>""")
    engine = dashpot.Engine(model, law="comfree")
    ours, theirs = engine.make_data(), mujoco.MjData(model)
    for data in (ours, theirs):
        data.qvel[:6] = [1, 2, 3, 4, 5, 6]
    engine.step(ours, nstep=100)
    mujoco.mj_step(model, theirs, 100)
    assert ours.qpos.tobytes() == theirs.qpos.tobytes()
    assert ours.qvel.tobytes() == theirs.qvel.tobytes()


def test_rollout_and_copy_step_alike():
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(SCENE), law="comfree")
    data = engine.make_data()
    state = np.zeros(mujoco.mj_stateSize(engine.model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(engine.model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    states, _ = dashpot.rollout(engine, state[None], nstep=50)
    engine.step(data, nstep=50)
    mujoco.mj_getState(engine.model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    np.testing.assert_array_equal(states[0, -1], state)


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"comfree_stiffness": 0.0}, ValueError),
        ({"comfree_stiffness": -1.0}, ValueError),
        ({"comfree_stiffness": np.inf}, ValueError),
        ({"comfree_damping": np.nan}, ValueError),
        ({"comfree_damping": -1e-9}, ValueError),
        ({"comfree_stiffness": "stiff"}, TypeError),
        ({"comfree_damping": True}, TypeError),
        ({"microsteps": 4}, ValueError),
        ({"max_microsteps": 8}, ValueError),
        ({"recovery_speed": np.inf}, ValueError),
        ({"rules": dashpot.CombinationRules(stiffness="min")}, ValueError),
    ],
)
def test_bad_options(options, error):
    with pytest.raises(error, match=next(iter(options))):
        dashpot.Engine(box(), law="comfree", **options)


@pytest.mark.parametrize("option", ["comfree_stiffness", "comfree_damping"])
def test_options_of_the_other_law(option):
    with pytest.raises(ValueError, match=f"{option}.*kelvin_voigt"):
        dashpot.Engine(box(), **{option: 0.1})


def test_materials_are_refused():
    engine = dashpot.Engine(box(), law="comfree")
    with pytest.raises(ValueError, match="materials"):
        engine.set_material("floor", dashpot.Material(friction=1.0))
    with pytest.raises(ValueError, match="materials"):
        engine.set_pair_material("floor", 1, dashpot.Material(friction=1.0))
