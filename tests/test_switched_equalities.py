"""Equalities that are apart, at the start or where they are switched on, close."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine, law

SCENE = """<mujoco><option timestep="0.002" gravity="0 0 {gravity}" integrator="{integrator}"/>
<worldbody><body name="hand" pos="0 0 1"/>
  <body name="tool" pos="0 0 1"><freejoint/><geom size="0.1" mass="1"/></body>
  <body name="link" pos="0 1 1"><joint name="hinge" axis="0 1 0"/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" mass="1"/></body>
</worldbody><equality>{equality}</equality></mujoco>"""
EQUALITIES = {
    "connect": ('<connect body1="hand" body2="tool" anchor="0 0 0" {more}/>', 0),
    "weld": ('<weld body1="hand" body2="tool" {more}/>', 0),
    "joint": ('<joint joint1="hinge" polycoef="0 0 0 0 0" {more}/>', 7),
}
APART = 0.05  # m or rad
RECOVERY_SPEED = 0.1  # m/s or rad/s, of the engine


def apart(kind, *, switched, gravity=0.0, integrator="Euler", more=""):
    """Return an engine, data with an equality that is apart by APART, and the coordinate."""
    equality, coordinate = EQUALITIES[kind]
    xml = SCENE.format(gravity=gravity, integrator=integrator, equality=equality.format(more=more))
    engine = Engine(mujoco.MjModel.from_xml_string(xml))
    data = engine.make_data()
    if switched:
        data.eq_active[0] = 0
        engine.step(data)
    data.qpos[coordinate] += APART
    data.eq_active[0] = 1
    return engine, data, coordinate


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("kind", EQUALITIES)
def test_a_rigid_equality_that_nothing_loads_closes_at_the_recovery_speed(kind, integrator):
    engine, data, coordinate = apart(kind, switched=True, integrator=integrator)
    engine.step(data, nstep=100)
    # Equalities are followed with a softness of a hundredth, so a little slower.
    assert data.qpos[coordinate] == pytest.approx(APART - 0.2 * RECOVERY_SPEED, abs=3e-4)
    assert abs(data.qvel).max() < 1e-9  # displaced, not thrown
    engine.step(data, nstep=400)
    assert data.qpos[coordinate] == pytest.approx(0.0, abs=1e-5)
    assert engine.energy(data).kinetic < 1e-12


@pytest.mark.parametrize("switched", [False, True])
@pytest.mark.parametrize("kind", EQUALITIES)
def test_an_equality_with_a_solref_of_its_own_is_a_stretched_spring(kind, switched):
    solref, solimp = (-30.0, -4.0), (0.9, 0.9, 0.001, 0.5, 2.0)
    engine, data, coordinate = apart(
        kind, switched=switched, more='solref="-30 -4" solimp="0.9 0.9 0.001"'
    )
    stiffness, damping = law.solref_to_spring_at_rest(solref, solimp=solimp)
    rate, way = 0.5 * damping, []
    frequency = np.sqrt(stiffness - rate**2)  # of unit mass, underdamped
    time = engine.model.opt.timestep * np.arange(1, 201)
    for _ in time:
        engine.step(data)
        way.append(data.qpos[coordinate])
    expected = APART * np.exp(-rate * time)
    expected *= np.cos(frequency * time) + rate / frequency * np.sin(frequency * time)
    # Rows resolve their own springs exactly.
    assert np.asarray(way) == pytest.approx(expected, abs=2e-3 * APART)


def test_what_a_stretched_spring_gives_is_in_the_ledger():
    engine, data, _ = apart("weld", switched=True, more='solref="-30 -4"')
    before = engine.energy(data).total
    engine.step(data, nstep=200)
    after = engine.energy(data)
    assert after.dissipated_constraint > 0.01
    assert after.total == pytest.approx(before, abs=1e-9)


def test_a_stiff_equality_with_a_solref_of_its_own_throws_nothing():
    engine, data, coordinate = apart("weld", switched=True, more='solref="0.004 1"')
    fastest = 0.0
    for _ in range(100):
        engine.step(data)
        fastest = max(fastest, abs(data.qvel[coordinate]))
    stiffness, _ = law.solref_to_spring_at_rest((0.004, 1.0))
    # Of a hundred weights: what a spring that they deform gives without damping.
    assert fastest < 100 * 9.81 / np.sqrt(stiffness)
    assert data.qpos[coordinate] < APART - 0.1 * RECOVERY_SPEED


def test_a_soft_limit_bears_its_load_from_the_first_step_of_a_state_without_memory():
    model = mujoco.MjModel.from_xml_string("""<mujoco><option timestep="0.002"/><worldbody>
      <body pos="0 0 1"><joint type="slide" axis="0 0 1" limited="true" range="-0.1 1"
        solreflimit="0.1 1"/><geom size="0.05" mass="1"/></body></worldbody></mujoco>""")
    engine = Engine(model)
    settled = engine.make_data()
    engine.step(settled, nstep=2000)
    sag = -0.1 - settled.qpos[0]
    assert sag > 1e-3
    anew = engine.make_data()
    anew.qpos[:] = settled.qpos
    for _ in range(100):
        engine.step(anew)
        # It used to fall by a part of the sag, and to be pushed back.
        assert anew.qpos[0] == pytest.approx(settled.qpos[0], abs=1e-6 * sag)
