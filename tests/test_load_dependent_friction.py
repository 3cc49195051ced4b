"""Friction coefficients that fall with the normal force, against closed forms and quadrature."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy import integrate

import dashpot
from dashpot import _core
from dashpot.materials import CombinationRules, Material

GRAVITY = 9.81
STIFFNESS = 1e5
FRICTION, SHARE, LOAD = 0.5, 0.4, 10.0


def factor(force, share=SHARE, load=LOAD):
    return share + (1.0 - share) / (1.0 + force / load)


def puck(mass, *, slope=0.0, damping_ratio=1.0, timestep=1e-3, gravity=GRAVITY, **friction):
    """Return engine and data of a ball that cannot turn, on a table, pressed in by its weight."""
    model = mujoco.MjModel.from_xml_string(
        f"""
        <mujoco>
          <option timestep="{timestep}" cone="elliptic"
                  gravity="{gravity * np.sin(slope)} 0 {-gravity * np.cos(slope)}"/>
          <worldbody>
            <geom name="table" type="plane" size="5 5 1"/>
            <body>
              <joint type="slide" axis="1 0 0"/>
              <joint type="slide" axis="0 0 1"/>
              <geom name="puck" type="sphere" size="0.05" mass="{mass}"/>
            </body>
          </worldbody>
        </mujoco>
        """
    )
    engine = dashpot.Engine(model)
    given = {"friction": FRICTION, "loaded_friction": SHARE, "friction_load": LOAD, **friction}
    engine.set_material("puck", Material(STIFFNESS, damping_ratio=damping_ratio, **given))
    engine.set_material("table", Material(friction=0.0))
    data = engine.make_data()
    data.qpos[1] = 0.05 - mass * gravity * np.cos(slope) / STIFFNESS
    return engine, data


@pytest.mark.parametrize("mass", [0.05, 1.0, 20.0])
@pytest.mark.parametrize("timestep", [1e-3, 1e-2])
def test_sliding_stops_where_the_load_says(mass, timestep):
    engine, data = puck(mass, timestep=timestep)
    data.qvel[0] = 1.0
    engine.step(data, round(1.5 / timestep))
    deceleration = FRICTION * factor(mass * GRAVITY) * GRAVITY
    # The friction spring gives way by mu f / k, 2e-3 m at most, with what it held when sliding
    # ended; it springs back by less.
    sag = FRICTION * mass * GRAVITY / STIFFNESS
    assert data.qpos[0] == pytest.approx(0.5 / deceleration, abs=sag + 1e-9)
    assert abs(data.qvel[0]) < 1e-6


@pytest.mark.parametrize(("mass", "sticks"), [(0.1, True), (10.0, False)])
def test_light_bodies_stick_where_heavy_ones_slide(mass, sticks):
    slope = np.arctan(0.35)  # between the limits of 0.48 and 0.23
    engine, data = puck(mass, slope=slope)
    engine.step(data, 500)  # the friction spring is taken up
    halfway = data.qvel[0]
    engine.step(data, 500)
    if sticks:
        sag = mass * GRAVITY * np.sin(slope) / STIFFNESS
        assert data.qpos[0] == pytest.approx(sag, rel=1e-6)
    else:
        load = mass * GRAVITY * np.cos(slope)
        acceleration = GRAVITY * np.sin(slope) - FRICTION * factor(load) * load / mass
        assert data.qvel[0] - halfway == pytest.approx(0.5 * acceleration, rel=1e-6)


def test_an_impact_takes_the_friction_of_its_force():
    """Undamped: f = v sqrt(k m) sin(w t) for half a period; the friction impulse by quadrature."""
    mass, speed = 0.5, 0.3
    engine, data = puck(mass, gravity=0.0, damping_ratio=0.0, timestep=2e-4)
    data.qpos[1] = 0.051
    data.qvel[:] = [2.0, -speed]
    before = engine.energy(data).total
    engine.step(data, 200)
    frequency = np.sqrt(STIFFNESS / mass)

    def friction(time):
        force = speed * np.sqrt(STIFFNESS * mass) * np.sin(frequency * time)
        return FRICTION * factor(force) * force

    impulse = integrate.quad(friction, 0.0, np.pi / frequency)[0]
    constant = FRICTION * 2.0 * mass * speed
    assert impulse < 0.6 * constant  # the force of 67 N is far beyond the load of 10 N
    # A micro-step of 1/80 of the impact takes the factor of its mean force: (1/80)^2, and the
    # friction spring has to be taken up.
    assert mass * (2.0 - data.qvel[0]) == pytest.approx(impulse, rel=2e-3)
    assert data.qvel[1] == pytest.approx(speed, rel=1e-9)
    assert engine.energy(data).total == pytest.approx(before, rel=1e-9)


def test_no_dependence_is_coulomb_to_the_bit():
    runs = []
    for given in ({"loaded_friction": 1.0, "friction_load": 3.0}, {"loaded_friction": 1.0}):
        engine, data = puck(1.0, **given)
        data.qvel[0] = 1.0
        engine.step(data, 100)
        runs.append(data.qpos.copy())
    np.testing.assert_array_equal(*runs)
    plain = puck(1.0)
    plain[0].set_material("puck", Material(STIFFNESS, damping_ratio=1.0, friction=FRICTION))
    plain[1].qvel[0] = 1.0
    plain[0].step(plain[1], 100)
    np.testing.assert_array_equal(plain[1].qpos, runs[0])


def combine(a, b, rule="max"):
    rules = CombinationRules(friction=rule)._to_core()
    return _core.combine(a._to_core(), b._to_core(), rules)


@pytest.mark.parametrize(
    ("rule", "light", "heavy"),
    [
        ("max", 0.5, 0.3),
        ("min", 0.4, 0.2),
        ("mean", 0.45, 0.25),
        ("geometric_mean", 0.2**0.5, None),
    ],
)
def test_friction_under_load_combines_like_friction(rule, light, heavy):
    a = Material(friction=0.5, loaded_friction=0.4, friction_load=5.0)  # 0.2 under load
    b = Material(friction=0.4, loaded_friction=0.75, friction_load=20.0)  # 0.3 under load
    heavy = (0.2 * 0.3) ** 0.5 if heavy is None else heavy
    pair = combine(a, b, rule)
    assert pair.friction[0] == pytest.approx(light, rel=1e-14)
    assert pair.friction[0] * pair.loaded_friction == pytest.approx(heavy, rel=1e-14)
    # a loses 0.3, b 0.1.
    assert pair.friction_load == pytest.approx(0.75 * 5.0 + 0.25 * 20.0, rel=1e-14)


def test_a_side_without_friction_does_not_count():
    pair = combine(
        Material(friction=0.5, loaded_friction=0.4, friction_load=5.0), Material(friction=0)
    )
    assert pair.loaded_friction == pytest.approx(0.4, rel=1e-14)
    assert pair.friction_load == 5.0


@pytest.mark.parametrize("friction", [None, 0.5])
def test_the_friction_of_the_model_counts_too(friction):
    """Materials without friction of their own take the MJCF's, and the load factor acts on it."""
    engine, data = puck(1.0)
    engine.model.geom_friction[:, 0] = [0.1, 0.5]
    engine.set_material("table", Material())
    given = Material(STIFFNESS, friction=friction, loaded_friction=SHARE, friction_load=LOAD)
    engine.set_material("puck", given)
    data.qvel[0] = 1.0
    engine.step(data, 100)
    # Under load the puck has 0.2, above the table's 0.1.
    deceleration = FRICTION * factor(GRAVITY) * GRAVITY
    assert data.qvel[0] == pytest.approx(1.0 - 0.1 * deceleration, abs=1e-3)


def test_a_side_of_higher_priority_decides_alone():
    engine, data = puck(1.0)
    engine.model.geom_priority[1] = 1
    engine.set_material("table", Material(friction=0.9))
    data.qvel[0] = 1.0
    engine.step(data, 100)
    deceleration = FRICTION * factor(GRAVITY) * GRAVITY
    assert data.qvel[0] == pytest.approx(1.0 - 0.1 * deceleration, abs=1e-3)
