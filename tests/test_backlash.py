"""Limits and equalities whose impedance grows with their deformation: MuJoCo's backlash."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dashpot import Engine, law

MODEL = """<mujoco><option timestep="{dt}" gravity="0 0 0"/>
<compiler autolimits="true" angle="radian"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody>{body}</worldbody>
{rows}</mujoco>"""
SLIDE = '<body name="o"><joint name="q" type="slide"/><geom size=".1" mass=".5"/></body>'
HINGE = '<body><joint name="q"/><geom size=".1" mass=".5" pos=".3 0 0"/></body>'
FREE = '<body name="o"><freejoint/><geom size=".1" mass=".5"/></body>'
RANGE = (
    '<body><joint name="q" range="-9 0" {limit}/><geom size=".1" mass=".5" pos=".3 0 0"/></body>'
)
TENDON = '<tendon><fixed name="t" {limit}><joint joint="q" coef="1"/></fixed></tendon>'
KINDS = {
    "joint equality": (HINGE, '<equality><joint joint1="q" {own}/></equality>'),
    "tendon equality": (
        SLIDE,
        TENDON.format(limit="") + '<equality><tendon tendon1="t" {own}/></equality>',
    ),
    "connect": (FREE, '<equality><connect body1="o" anchor="0 0 0" {own}/></equality>'),
    "weld": (FREE, '<equality><weld body1="o" {own}/></equality>'),
    "joint limit": (RANGE, ""),
    "tendon limit": (SLIDE, TENDON.replace("{limit}", 'range="-9 0" {limit}')),
}
# MuJoCo's recipe for backlash; linear, late and sharp impedances, powers 1 to 5.
IMPEDANCES = [
    ((0.1, 1.0), (0.1, 0.99, 0.04, 0.5, 3.0)),
    ((0.02, 0.9), (0.05, 0.95, 0.01, 0.3, 1.0)),
    ((0.1, 1.0), (0.5, 0.9999, 0.02, 0.7, 5.0)),
    ((-300.0, -20.0), (0.0, 0.9, 0.005, 0.5, 2.0)),
]


def model_of(kind, solref, solimp, dt=0.002):
    """Return a model of one body on one constraint."""
    body, rows = KINDS[kind]
    values = [" ".join(str(x) for x in numbers) for numbers in (solref, solimp)]
    own = f'solref="{values[0]}" solimp="{values[1]}"'
    limit = f'solreflimit="{values[0]}" solimplimit="{values[1]}"'
    xml = MODEL.format(dt=dt, body=body, rows=rows)
    return mujoco.MjModel.from_xml_string(xml.format(own=own, limit=limit))


@pytest.mark.parametrize(
    ("kind", "solref", "solimp"),
    [
        (kind, *impedance)
        for kind in KINDS
        for impedance in (IMPEDANCES if kind == "joint equality" else IMPEDANCES[::2])
    ],
)
def test_constraint_gives_way_as_far_as_in_mujoco_over_three_decades_of_load(kind, solref, solimp):
    engine = Engine(model_of(kind, solref, solimp))
    for load in (0.01, 0.3, 10.0):
        data, plain = engine.make_data(), mujoco.MjData(engine.model)
        data.qfrc_applied[0] = plain.qfrc_applied[0] = load
        engine.step(data, nstep=3000)
        mujoco.mj_step(engine.model, plain, 3000)
        assert data.qpos[0] == pytest.approx(plain.qpos[0], rel=2e-3)
        # x = A F / kappa, A being MuJoCo's own inverse mass of the row.
        accelerated = load * plain.efc_diagA[0]
        kappa, _ = law.solref_to_spring_at_rest(solref, solimp=solimp, load=accelerated)
        assert data.qpos[0] == pytest.approx(accelerated / kappa, rel=2e-3)
        assert abs(data.qvel).max() < 1e-5


@pytest.mark.parametrize("kind", ["joint equality", "tendon equality", "connect", "weld"])
def test_undamped_backlash_swings_as_its_force_says(kind):
    solref, solimp = (-100.0, 0.0), (0.1, 0.9, 0.04, 0.5, 2.0)
    engine = Engine(model_of(kind, solref, solimp, dt=0.001))
    data = engine.make_data()
    data.qvel[0] = 0.5
    at_rest = [
        (load / law.solref_to_spring_at_rest(solref, solimp=solimp, load=load)[0], load)
        for load in np.geomspace(1e-3, 1e3, 4000)
    ]
    place, push = np.array([(0.0, 0.0), *at_rest]).T
    moving = solve_ivp(
        lambda _, y: [y[1], -np.sign(y[0]) * np.interp(abs(y[0]), place, push)],
        (0, 0.5),
        [0, 0.5],
        t_eval=0.001 * np.arange(1, 501),
        rtol=1e-8,
        atol=1e-10,
    ).y[0]
    found = []
    for _ in range(500):
        engine.step(data)
        found.append(data.qpos[0])
    assert moving.max() > 0.015  # the stiffness has grown many times
    np.testing.assert_allclose(found, moving, atol=0.05 * moving.max())


@pytest.mark.parametrize(("solref", "solimp"), IMPEDANCES)
@pytest.mark.parametrize("speed", [0.1, 5.0])
@pytest.mark.parametrize("kind", ["joint equality", "weld"])
def test_backlash_gains_no_energy_where_steps_do_not_resolve_it(kind, speed, solref, solimp):
    # Without damping, from slow to more than the whole width in a step.
    stiffness = -solref[0] if solref[0] < 0.0 else 1.0 / (solref[0] * solref[1]) ** 2
    engine = Engine(model_of(kind, (-stiffness, 0.0), solimp))
    data = engine.make_data()
    rng = np.random.default_rng(1)
    data.qvel[:] = speed * rng.normal(size=data.qvel.size)
    engine.step(data)
    start = engine.energy(data)
    most = start.kinetic + start.elastic
    # MuJoCo's force of a weld, by the norm of metres and radians, has no potential.
    at_times = 1.5 if kind == "weld" else 1.02
    for _ in range(1000):
        engine.step(data)
        energy = engine.energy(data)
        lost = energy.dissipated_constraint + energy.dissipated_recovery
        total = energy.kinetic + energy.elastic
        assert total < at_times * most
        assert total + lost == pytest.approx(
            start.kinetic + start.elastic + start.dissipated_constraint + start.dissipated_recovery,
            abs=1e-9 * most,
        )


@pytest.mark.parametrize("part", [0.03, 0.08])
@pytest.mark.parametrize(("solref", "solimp"), IMPEDANCES)
def test_contact_under_a_fraction_of_its_weight_gives_way_as_in_mujoco(solref, solimp, part):
    values = [" ".join(str(x) for x in numbers) for numbers in (solref, solimp)]
    own = f'solref="{values[0]}" solimp="{values[1]}"'
    engine = Engine(
        mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="0.002"/><worldbody><geom type="plane" size="1 1 1" {own}/>
          <body pos="0 0 0.1"><freejoint/><geom size="0.1" mass="2" {own} condim="1"/></body>
        </worldbody></mujoco>""")
    )
    data, plain = engine.make_data(), mujoco.MjData(engine.model)
    data.qfrc_applied[2] = plain.qfrc_applied[2] = 2.0 * 9.81 * (1.0 - part)
    engine.step(data, nstep=5000)
    mujoco.mj_step(engine.model, plain, 5000)
    assert 0.1 - data.qpos[2] == pytest.approx(0.1 - plain.qpos[2], rel=1e-2)


@pytest.mark.parametrize(("solref", "solimp"), IMPEDANCES)
def test_weld_under_force_and_moment_gives_way_as_in_mujoco(solref, solimp):
    engine = Engine(model_of("weld", solref, solimp))
    for load in (0.05, 1.0, 10.0):
        data, plain = engine.make_data(), mujoco.MjData(engine.model)
        data.qfrc_applied[[2, 4]] = plain.qfrc_applied[[2, 4]] = load, 0.1 * load
        engine.step(data, nstep=4000)
        mujoco.mj_step(engine.model, plain, 4000)
        assert data.qpos[[2, 5]] == pytest.approx(plain.qpos[[2, 5]], rel=5e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_spring_that_grows_softer_comes_to_rest(kind):
    engine = Engine(model_of(kind, (0.1, 1.0), (0.95, 0.5, 0.01, 0.5, 2.0)))
    data = engine.make_data()
    data.qvel[0] = 1.0
    engine.step(data, nstep=3000)
    assert abs(data.qvel[0]) < 1e-6 or "limit" in kind
