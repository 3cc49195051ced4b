"""What dampers dissipate where rows act in the same step, and what is left to the rows.

Rows act through M + H D, of which H D is a way to treat dampers implicitly and no inertia: a limit
that stops a damped joint within a step is not to be booked more than the energy of the motion, and
the damper not less than nothing.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import dashpot

SPEED = 20.0  # rad/s
ROUNDING = 1e-12
IMPLICIT = ("Euler", "implicitfast", "implicit")
INTEGRATORS = (*IMPLICIT, "RK4")


def rod(
    timestep: float,
    joint: str,
    *,
    integrator: str = "Euler",
    rest: str = "",
) -> tuple[dashpot.Engine, mujoco.MjData]:
    """Return a rod of 0.2 kg on a hinge along y, turning at SPEED."""
    xml = f"""<mujoco><compiler angle="radian"/>
      <option gravity="0 0 0" timestep="{timestep}" integrator="{integrator}"/>
      <worldbody><body><joint name="j" axis="0 1 0" {joint}/>
        <geom type="capsule" fromto="0 0 0 .2 0 0" size=".01" mass=".2" contype="0"/></body>
      </worldbody>{rest}</mujoco>"""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    data = engine.make_data()
    data.qvel[0] = SPEED
    return engine, data


def rod_inertia(engine: dashpot.Engine) -> float:
    return 2 * engine.energy(turning(engine)).kinetic / SPEED**2


def turning(engine: dashpot.Engine) -> mujoco.MjData:
    data = engine.make_data()
    data.qvel[0] = SPEED
    return data


def world(option: str, bodies: str, rest: str = "") -> str:
    return f"""<mujoco><option {option}/><worldbody><geom type="plane" size="0 0 1"/>{bodies}
      </worldbody>{rest}</mujoco>"""


def chain(joint: str, *, height: float = 1.2, collide: bool = False) -> str:
    switch = "" if collide else 'contype="0" conaffinity="0"'
    bodies = ""
    for i in range(3):
        bodies += f"""<body name="link{i}" pos="{f"0 0 {height}" if i == 0 else "0.2 0 0"}">
          <joint name="j{i}" axis="0 1 0" {joint}/>
          <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.3" {switch}/>"""
    return bodies + "</body>" * 3


def slide(name: str, x: float, z: float) -> str:
    return f"""<body pos="{x} 0 {z}"><joint name="{name}" type="slide" axis="0 0 1"/>
      <geom size=".1" mass="1"/></body>"""


TENDON = """<tendon><fixed name="t" {}><joint joint="j0" coef="1"/><joint joint="j2" coef="-1"/>
  </fixed></tendon>"""

# The dampers of each can only brake.
PASSIVE = {
    "limits": world("", chain('range="-40 40" limited="true" damping="0.05"')),
    "strong dampers at limits": world("", chain('range="-40 40" limited="true" damping="2"')),
    "dampers of higher order": world(
        "", chain('range="-40 40" limited="true" damping="0.02 0.01 0.002"')
    ),
    "floor": world("", chain('damping="0.05"', height=0.3, collide=True)),
    "connect": world(
        "",
        chain('damping="0.05"', height=1.0),
        '<equality><connect body1="link2" anchor="0.2 0 0"/></equality>',
    ),
    "dry friction": world("", chain('frictionloss="0.05" damping="0.05"')),
    "tendon limit": world("", chain(""), TENDON.format('range="-.5 .5" damping=".1"')),
    "fluid": world('density="100" viscosity="0.5"', chain('range="-40 40" limited="true"')),
    # Of the two that a damper couples, the one that it drags along gains energy.
    "tendon between trees": world(
        "",
        slide("j0", 0.0, 0.5) + slide("j2", 0.5, 1.0),
        TENDON.format('damping="2"'),
    ),
    "free body": world(
        "",
        """<body pos="0 0 .4"><joint type="free" damping=".2"/>
        <geom type="box" size=".05 .06 .07" mass=".5"/></body>""",
    ),
}


@pytest.mark.parametrize("timestep", [0.004])
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("scene", PASSIVE)
def test_passive_dampers_never_give_energy(scene, integrator, timestep):
    model = mujoco.MjModel.from_xml_string(PASSIVE[scene])
    model.opt.timestep = timestep
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    engine = dashpot.Engine(model)
    data = engine.make_data()
    if scene == "free body":
        data.qvel[:] = 1.0, 0.5, 0.0, 5.0, -3.0, 2.0
    dissipated, least_step, peak = 0.0, 0.0, 0.0
    for _ in range(round(0.6 / timestep)):
        engine.step(data)
        energy = engine.energy(data)
        peak = max(peak, energy.kinetic)
        least_step = min(least_step, energy.dissipated_damping - dissipated)
        dissipated = energy.dissipated_damping
    assert dissipated > 1e-3 * peak
    # Where nothing but smooth forces acts and a velocity passes zero within a step, the damper's
    # force is that of one end of the step, its way that of both: off by D (a H)^2 H / 8. A part
    # of H D is inertia to what is hit.
    hit = {"free body": 2e-4, "tendon limit": 1e-4}.get(scene, 0.0)
    assert least_step >= -max(hit, 1e-3 * timestep) * peak
    rows = energy.dissipated_normal + energy.dissipated_friction + energy.dissipated_constraint
    # Rows of an equality turn within a step, to second order.
    assert rows >= -1e-3 * peak


@pytest.mark.parametrize("integrator", IMPLICIT)
@pytest.mark.parametrize("damping", [1.0, 5.0, 50.0])
def test_a_limit_that_is_hit_at_once_takes_the_energy(damping, integrator):
    """At the limit, H D is 0.7, 3.6 and 36 times the inertia; a part of the energy is the damper's.

    On the way to the limit it takes no more than D x SPEED, and afterwards what speed is left.
    """
    limit = 0.00035
    engine, data = rod(
        0.002,
        f'damping="{damping}" limited="true" range="-{limit} {limit}"',
        integrator=integrator,
    )
    start = engine.energy(data)
    engine.step(data, nstep=100)
    energy = engine.energy(data)
    assert energy.kinetic < ROUNDING
    assert energy.total == pytest.approx(start.total, rel=1e-9)
    assert 0.0 <= energy.dissipated_damping <= 1.5 * damping * limit * SPEED + 0.05 * start.kinetic
    assert 0.0 <= energy.dissipated_constraint <= start.kinetic


@pytest.mark.parametrize("limit", [0.00035, 0.02])
@pytest.mark.parametrize("timestep", [0.002, 0.0001])
def test_a_servo_that_brakes_takes_what_a_damper_would(limit, timestep):
    """The velocity gain of a servo is implicit too, and what it takes is negative work."""
    taken = []
    for joint, rest in (
        ('damping="1"', ""),
        ("", '<actuator><velocity joint="j" kv="1"/></actuator>'),
    ):
        engine, data = rod(
            timestep,
            f'{joint} limited="true" range="-{limit} {limit}"',
            integrator="implicitfast",
            rest=rest,
        )
        start = engine.energy(data)
        engine.step(data, nstep=round(0.2 / timestep))
        energy = engine.energy(data)
        assert energy.total == pytest.approx(start.total, rel=1e-9)
        # In the step with the impact its gain, which acts over all of it, may drive a little.
        given = start.kinetic + max(0.0, energy.work)
        assert 0.0 <= energy.dissipated_constraint <= given * (1.0 + ROUNDING)
        taken.append(energy.dissipated_damping - energy.work)
    # The motions are the same; in the step with the impact, a damper alone is known not to drive.
    assert taken[1] == pytest.approx(taken[0], abs=0.1 * start.kinetic)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("extra", ["", 'frictionloss="0.5"'])
@pytest.mark.parametrize("damping", [0.1, 0.3])
def test_the_split_between_damper_and_limit_converges(damping, extra, integrator):
    """To that of a step of 0.01 ms, by no more than what the damper takes in one step at SPEED.

    The time of the impact within its step is what is not resolved.
    """

    def split(timestep):
        engine, data = rod(
            timestep,
            f'damping="{damping}" limited="true" range="-0.007 0.02" {extra}',
            integrator=integrator,
        )
        engine.step(data, nstep=round(0.04 / timestep))
        energy = engine.energy(data)
        return np.array([energy.dissipated_damping, energy.dissipated_constraint, energy.kinetic])

    converged = split(1e-5)
    for timestep in (1e-3, 5e-4, 1e-4):
        np.testing.assert_allclose(
            split(timestep), converged, rtol=0, atol=0.5 * damping * SPEED**2 * timestep
        )


def test_a_limit_at_the_end_of_a_long_way_leaves_the_damper_its_closed_form():
    """Speed falls by D x / I over a way x; what rebounds ends in the damper too."""
    damping, limit, timestep = 0.1, 0.02, 1e-4
    engine, data = rod(timestep, f'damping="{damping}" limited="true" range="-1 {limit}"')
    inertia = rod_inertia(engine)
    while data.qvel[0] > 0.0:
        engine.step(data)
    rebound = data.qvel[0]
    engine.step(data, nstep=round(1.0 / timestep))
    speed = SPEED - damping * limit / inertia
    expected = 0.5 * inertia * (SPEED**2 - speed**2 + rebound**2)
    dissipated = engine.energy(data).dissipated_damping
    # Half a step at the start, and the step with the impact.
    assert dissipated == pytest.approx(expected, abs=1.5 * damping * SPEED**2 * timestep)
    assert data.qpos[0] > -1.0


@pytest.mark.parametrize(
    ("integrator", "damping"),
    [(name, damping) for name in IMPLICIT for damping in (0.0, 0.1, 1.0)]
    + [("RK4", 0.0), ("RK4", 0.1)],
)
def test_dry_friction_beside_a_damper_takes_force_times_way(damping, integrator):
    """However strong the damper, here up to 0.7 times the inertia within a step."""
    engine, data = rod(0.002, f'frictionloss="0.2" damping="{damping}"', integrator=integrator)
    start = engine.energy(data)
    while data.qvel[0] > 0.05 * SPEED:
        engine.step(data)
    way, energy = data.qpos[0], engine.energy(data)
    assert energy.dissipated_constraint == pytest.approx(0.2 * way, rel=2e-2)
    lost = start.kinetic - energy.kinetic
    assert energy.dissipated_damping == pytest.approx(lost - 0.2 * way, rel=1e-2, abs=1e-3 * lost)


def test_a_damper_alone_takes_the_energy():
    engine, data = rod(0.002, 'damping="1"')
    inertia = rod_inertia(engine)
    start = engine.energy(data)
    engine.step(data, nstep=3)
    energy = engine.energy(data)
    # Implicit: the speed is divided by 1 + H D / I in every step.
    left = start.kinetic * (1 + 0.002 / inertia) ** -6
    assert energy.dissipated_damping == pytest.approx(start.kinetic - left, rel=1e-9)


def test_wind_may_drive():
    """A fluid that carries a body along gives it energy, beside a limit too."""
    xml = world(
        'gravity="0 0 0" density="1.2" wind="5 0 0" timestep="0.002"',
        """<body pos="0 0 1"><joint type="slide" axis="1 0 0" limited="true" range="-.01 1"/>
        <geom type="box" size=".1 .1 .1" mass=".1"/></body>""",
    )
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    data = engine.make_data()
    start = engine.energy(data)
    engine.step(data, nstep=200)
    energy = engine.energy(data)
    assert energy.kinetic > 1e-3
    assert energy.dissipated_damping == pytest.approx(start.total - energy.kinetic, rel=1e-9)
