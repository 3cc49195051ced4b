"""What a model's own solref and solimp mean: the sag of MuJoCo's rows, and their restitution."""

import itertools
import math

import mujoco
import numpy as np
import pytest

from dashpot import Engine, law

GRAVITY = 9.81
# Constant, growing, falling and power-law impedances; both forms of solref.
OWN = [
    ((0.02, 1.0), (0.9, 0.9, 0.001, 0.5, 2.0)),
    ((0.05, 1.0), (0.998, 0.998, 0.001, 0.5, 2.0)),
    ((0.02, 0.9), (0.9, 0.95, 0.001, 0.5, 2.0)),
    ((0.02, 1.0), (0.015, 1.0, 0.036, 0.5, 2.0)),
    ((0.02, 1.0), (0.9, 0.8, 0.003, 0.5, 2.0)),
    ((-1000.0, -30.0), (0.8, 0.9, 0.01, 0.3, 3.0)),
    ((-1000.0, -30.0), (0.2, 0.9, 0.0, 0.5, 1.0)),
]


def attributes(solref, solimp, suffix=""):
    """Return solref and solimp as MJCF attributes."""
    values = [" ".join(str(x) for x in numbers) for numbers in (solref, solimp)]
    return f'solref{suffix}="{values[0]}" solimp{suffix}="{values[1]}"'


def at_rest(xml, *, seconds=4.0, applied=0.0):
    """Return the positions of dashpot and MuJoCo at rest under applied generalized forces."""
    engine = Engine(mujoco.MjModel.from_xml_string(xml))
    data, plain = engine.make_data(), mujoco.MjData(engine.model)
    data.qfrc_applied[:] = plain.qfrc_applied[:] = applied
    count = round(seconds / engine.model.opt.timestep)
    engine.step(data, nstep=count)
    mujoco.mj_step(engine.model, plain, count)
    assert abs(plain.qvel).max() < 1e-9
    return data.qpos, plain.qpos


@pytest.mark.parametrize(("solref", "solimp"), OWN)
def test_rest_of_a_ball_is_as_deep_as_in_mujoco(solref, solimp):
    own = attributes(solref, solimp)
    position, plain = at_rest(f"""
        <mujoco><option timestep="0.001"/><worldbody><geom type="plane" size="1 1 1" {own}/>
          <body pos="0 0 0.1"><freejoint/><geom size="0.1" mass="2" {own} condim="1"/></body>
        </worldbody></mujoco>""")
    # What is left of the motion after 4 s, and MuJoCo's solver, leave less than 1e-6.
    assert 0.1 - position[2] == pytest.approx(0.1 - plain[2], rel=1e-6)
    stiffness, _ = law.solref_to_spring_at_rest(solref, solimp=solimp, load=GRAVITY)
    assert 0.1 - position[2] == pytest.approx(GRAVITY / stiffness, rel=1e-6)


@pytest.mark.parametrize(("solref", "solimp"), OWN)
def test_ball_rests_at_its_sag_whatever_overlap_it_starts_from(solref, solimp):
    # Home poses of legged robots have feet as deep in the floor as MuJoCo's springs let them.
    own = attributes(solref, solimp)
    engine = Engine(
        mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="0.002"/><worldbody><geom type="plane" size="1 1 1" {own}/>
          <body pos="0 0 0.1"><freejoint/><geom size="0.1" mass="2" {own} condim="1"/></body>
        </worldbody></mujoco>""")
    )
    sag = GRAVITY / law.solref_to_spring_at_rest(solref, solimp=solimp, load=GRAVITY)[0]
    for overlap in (0.5, 1.0, 4.0):
        data = engine.make_data()
        data.qpos[2] = 0.1 - overlap * sag
        engine.step(data)
        if overlap == 1.0:  # it is at rest from the start; gravity's work on 2 ms rounds
            assert abs(data.qvel[2]) < 1e-12
        engine.step(data, nstep=2000)
        # What is left of the motion after 4 s.
        assert 0.1 - data.qpos[2] == pytest.approx(sag, rel=1e-6)


def test_rest_of_a_box_and_of_a_tower_is_as_deep_as_in_mujoco():
    # At constant impedance the load of a contact does not matter.
    own = attributes((0.02, 1.0), (0.9, 0.9, 0.001, 0.5, 2.0))
    boxes = "".join(
        f"""<body pos="0 0 {0.1 + 0.2 * i}"><freejoint/>
        <geom type="box" size="0.1 0.15 0.1" mass="{2 + i}" {own} condim="1"/></body>"""
        for i in range(3)
    )
    position, plain = at_rest(f"""<mujoco><option timestep="0.001"/><worldbody>
        <geom type="plane" size="1 1 1" {own}/>{boxes}</worldbody></mujoco>""")
    for i in range(3):
        height = 0.1 + 0.2 * i
        assert height - position[7 * i + 2] == pytest.approx(height - plain[7 * i + 2], rel=1e-4)


# Impedances that a load changes by much, and least where it is large.
@pytest.mark.parametrize(("solref", "solimp"), [OWN[0], OWN[2], OWN[4], OWN[5]])
def test_feet_that_share_a_weight_go_in_as_far_as_in_mujoco(solref, solimp):
    own = attributes(solref, solimp)
    position, plain = at_rest(f"""<mujoco><option timestep="0.001"/><worldbody>
        <geom type="plane" size="1 1 1" {own}/><body pos="0 0 0.1"><freejoint/>
          <geom type="box" size="0.1 0.15 0.1" mass="2" {own} condim="1"/></body>
        </worldbody></mujoco>""")
    assert 0.1 - position[2] == pytest.approx(0.1 - plain[2], rel=1e-4)


@pytest.mark.parametrize(("solref", "solimp"), OWN)
def test_what_sticks_does_not_give_way_sideways_as_it_does_downwards(solref, solimp):
    """Friction has no position in MuJoCo: feet that go in by millimetres do not slide back."""
    own = attributes(solref, solimp)
    engine = Engine(
        mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="0.002"/><worldbody><geom type="plane" size="1 1 1" {own}/>
          <body pos="0 0 0.1"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
            <geom type="box" size="0.1 0.15 0.1" mass="2" {own} friction="0.8"/></body>
        </worldbody></mujoco>""")
    )
    data = engine.make_data()
    engine.step(data, nstep=2000)
    sag = -data.qpos[1]
    data.qfrc_applied[0] = 0.6 * 2.0 * GRAVITY
    engine.step(data, nstep=500)
    # kappa = theta^2 / (c - 1) h^2, h = dt / 13, gives way by 0.6 g / kappa: 0.4 um with c = 3 of
    # four contacts in two directions, where the sags are 12 um and more.
    assert 0.0 < data.qpos[0] < min(1e-6, 0.05 * sag)
    data.qfrc_applied[0] = 0.0
    engine.step(data, nstep=500)
    assert abs(data.qpos[0]) < 1e-9


def pressed_ball(solref, solimp, timestep):
    """Return an engine of a ball of 2 kg on the floor."""
    own = attributes(solref, solimp)
    return Engine(
        mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{timestep}"/><worldbody><geom type="plane" size="1 1 1" {own}/>
          <body pos="0 0 0.1"><freejoint/><geom size="0.1" mass="2" {own} condim="1"/></body>
        </worldbody></mujoco>""")
    )


@pytest.mark.parametrize("weights", [30.0])
@pytest.mark.parametrize(("solref", "solimp"), OWN)
def test_what_many_weights_press_goes_in_as_far_as_in_mujoco(solref, solimp, weights):
    engine = pressed_ball(solref, solimp, 0.002)
    data = engine.make_data()
    load = weights * GRAVITY
    data.qfrc_applied[2] = -2.0 * (load - GRAVITY)
    # The soft spring is compressed by a metre at most, which recovers at 0.1 m/s.
    engine.step(data, nstep=10000)
    stiffness, _ = law.solref_to_spring_at_rest(solref, solimp=solimp, load=load)
    # What is left of a motion that ends as exp(-t / 50 ms).
    assert 0.1 - data.qpos[2] == pytest.approx(load / stiffness, rel=1e-6)
    assert abs(data.qvel[2]) < 1e-9


def test_light_box_under_a_heavy_one_goes_in_as_far_as_in_mujoco():
    own = attributes(*OWN[5])
    boxes = "".join(
        f"""<body pos="0 0 {0.1 + 0.2 * i}"><freejoint/>
        <geom type="box" size="0.1 0.15 0.1" mass="{mass}" {own} condim="1"/></body>"""
        for i, mass in enumerate((1, 20))
    )
    position, plain = at_rest(
        f"""<mujoco><option timestep="0.001"/><worldbody>
        <geom type="plane" size="1 1 1" {own}/>{boxes}</worldbody></mujoco>""",
        seconds=8.0,
    )
    for i in range(2):
        height = 0.1 + 0.2 * i
        assert height - position[7 * i + 2] == pytest.approx(height - plain[7 * i + 2], rel=1e-3)


def test_what_was_pressed_gets_no_more_back_than_slow_unloading_gives():
    # The work of the force at rest, on the way out along what is overlap at rest under each force.
    solref, solimp = OWN[5]
    loads = np.linspace(0.0, 30.0 * GRAVITY, 2001)[1:]
    overlaps = [f / law.solref_to_spring_at_rest(solref, solimp=solimp, load=f)[0] for f in loads]
    work = np.trapezoid(loads, overlaps)
    engine = pressed_ball(solref, solimp, 1e-4)
    data = engine.make_data()
    data.qfrc_applied[2] = -2.0 * (loads[-1] - GRAVITY)
    engine.step(data, nstep=30000)
    data.qfrc_applied[2] = 0.0
    risen = 0.0
    for _ in range(5000):
        engine.step(data)
        risen = max(risen, GRAVITY * (data.qpos[2] - (0.1 - overlaps[-1])))
    # The force of the first steps is that of the spring of before.
    assert 0.0 < risen < 1.02 * work


def test_pressing_and_letting_go_closes_the_ledger():
    engine = pressed_ball(*OWN[5], 0.001)
    data = engine.make_data()
    data.qpos[2] = 0.2
    work, totals, turned, stored = 0.0, [], [], 0.0
    for step in range(3000):
        push = -200.0 if 500 <= step % 1500 < 1200 else 0.0
        before = data.qpos[2]
        data.qfrc_applied[2] = push
        engine.step(data)
        work += push * (data.qpos[2] - before)
        energy = engine.energy(data)
        lost = energy.dissipated_normal + energy.dissipated_recovery
        totals.append(energy.kinetic + energy.potential + energy.elastic + lost - work)
        turned.append(abs(work) + energy.kinetic)
        stored = max(stored, energy.elastic)
    # The push of 200 N and the weight of 20 N press it in as far as they do at rest.
    load = 200.0 / 2.0 + GRAVITY
    at_rest = load / law.solref_to_spring_at_rest(*OWN[5][:1], solimp=OWN[5][1], load=load)[0]
    assert stored > 0.4 * 2.0 * load * at_rest
    assert np.ptp(totals) < 1e-3 * max(turned)


@pytest.mark.parametrize(("solref", "solimp"), [OWN[0], OWN[2], OWN[4], OWN[5]])
def test_what_rests_in_mujoco_rests_from_its_first_step(solref, solimp):
    own = attributes(solref, solimp)
    legs = "".join(
        f'<geom type="sphere" pos="{x} {y} -.2" size=".05" mass=".5" {own} condim="1"/>'
        for x in (-0.3, 0.3)
        for y in (-0.2, 0.2)
    )
    engine = Engine(
        mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="0.001"/><worldbody>
        <geom type="plane" size="1 1 1" {own}/><body pos="0 0 .25"><freejoint/>
          <geom type="box" size=".3 .2 .05" mass="10" contype="0" conaffinity="0"/>{legs}
        </body></worldbody></mujoco>""")
    )
    plain, data = mujoco.MjData(engine.model), engine.make_data()
    mujoco.mj_step(engine.model, plain, 5000)
    depth = 0.25 - plain.qpos[2]
    data.qpos[:] = plain.qpos
    fastest = 0.0
    for _ in range(500):
        engine.step(data)
        fastest = max(fastest, abs(data.qvel).max())
    # MuJoCo's solver leaves some 1e-8 of the load.
    assert fastest < 1e-6 * np.sqrt(GRAVITY * depth)
    assert data.qpos[2] == pytest.approx(plain.qpos[2], abs=1e-6 * depth)


@pytest.mark.parametrize(("solref", "solimp"), OWN)
def test_rest_of_a_limit_and_an_equality_is_as_deep_as_in_mujoco(solref, solimp):
    # Under a load that takes the impedance of a hinge's limit and of a slide's equality to its full
    # value.
    stiffness, _ = law.solref_to_spring_at_rest(solref, solimp=solimp)
    load = max(500.0, 1.5 * stiffness * solimp[2])
    position, plain = at_rest(
        f"""<mujoco><option timestep="0.001" gravity="0 0 0"/>
        <compiler autolimits="true" angle="radian"/>
        <default><geom contype="0" conaffinity="0"/></default>
        <worldbody>
          <body><joint type="hinge" range="-1 0" {attributes(solref, solimp, "limit")}/>
            <geom size="0.1" mass="1"/></body>
          <body pos="1 0 0"><joint name="slide" type="slide"/><geom size="0.1" mass="2"/></body>
        </worldbody>
        <equality><joint joint1="slide" {attributes(solref, solimp)}/></equality></mujoco>""",
        applied=[load * 0.4 * 0.1**2, load * 2.0],
    )
    assert position == pytest.approx(plain, rel=1e-6)
    assert position == pytest.approx(load / stiffness, rel=1e-6)


@pytest.mark.parametrize(
    ("form", "ratio"),
    [("direct", 0.0), *itertools.product(["direct", "time constant"], [0.1, 0.5, 1.0])],
)
def test_bounce_has_the_restitution_of_the_damping_ratio(form, ratio):
    omega = 200.0
    solref = (
        (-(omega**2), -2.0 * ratio * omega) if form == "direct" else (1.0 / (omega * ratio), ratio)
    )
    own = attributes(solref, (0.9, 0.95, 0.001, 0.5, 2.0))
    engine = Engine(
        mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody>
          <geom type="plane" size="1 1 1" {own}/>
          <body pos="0 0 0.11"><freejoint/><geom size="0.1" mass="2" {own} condim="1"/></body>
        </worldbody></mujoco>""")
    )
    data = engine.make_data()
    data.qvel[2] = -1.0
    engine.step(data, nstep=100)
    assert data.qpos[2] > 0.1
    # A single contact flows in closed form.
    assert data.qvel[2] == pytest.approx(law.damping_ratio_to_restitution(ratio), rel=1e-9)


def test_solref_stiffer_than_the_steps_resolve_is_rigid_and_counted():
    # A tower couples its contacts, so that not every stiffness is resolved by 16 micro-steps.
    def step(stiffness):
        own = attributes((-stiffness, -0.2 * math.sqrt(stiffness)), (0.99, 0.99, 0.001, 0.5, 2.0))
        boxes = "".join(
            f"""<body pos="0 0 {0.1 + 0.2 * i}"><freejoint/>
            <geom type="box" size="0.1 0.1 0.1" {own}/></body>"""
            for i in range(3)
        )
        engine = Engine(
            mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="0.002"/><worldbody>
            <geom type="plane" size="1 1 1" {own}/>{boxes}</worldbody></mujoco>""")
        )
        data = engine.make_data()
        return engine.step(data, nstep=500), data

    soft, _ = step(1e3)
    stiff, data = step(1e9)
    assert soft.clipped == 0
    assert stiff.clipped > 0
    # A tower's dampers may ask for more of them than its stiffness.
    assert stiff.microsteps <= soft.microsteps
    # Rigid contacts give way by micrometres.
    assert 0.1 - data.qpos[2] == pytest.approx(0.0, abs=1e-5)
    assert abs(data.qvel).max() < 1e-9


@pytest.mark.parametrize("timestep", [1e-4, 5e-4, 2e-3])
def test_solref_of_a_damping_ratio_of_a_thousand_does_not_let_in_what_presses(timestep):
    # flygym's: a spring of 25 / s^2 and a damper of 1e4 / s, by which 20 weights creep in by less
    # than 10 um in 0.5 s. What micro-steps do not resolve of the damper must not be left to the
    # spring alone, on which they rest 8 mm deep.
    own = attributes((2e-4, 1e3), (0.999, 0.9999, 0.001, 0.5, 2.0))
    engine = Engine(
        mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{timestep}"/><worldbody>
        <geom type="plane" size="1 1 1" {own}/>
        <body pos="0 0 0.05"><freejoint/><geom type="box" size="0.05 0.05 0.05" mass="1" {own}/>
        </body></worldbody></mujoco>""")
    )
    data = engine.make_data()
    data.xfrc_applied[1, 2] = -20.0 * GRAVITY
    engine.step(data, nstep=round(0.5 / timestep))
    d = 0.999
    asked = 21.0 * GRAVITY * 0.5 / (d * 1e4 / (1.0 - d))
    # Beside that, rigid contacts give way by 21 weights over at least 1e7 / s^2 at 2 ms.
    assert 0.05 - data.qpos[2] < asked + 21.0 * GRAVITY / 1e7


@pytest.mark.parametrize(("solref", "solimp"), OWN)
@pytest.mark.parametrize("load", [0.1, GRAVITY, 1e4])
def test_spring_at_rest_balances_the_load_as_the_row_does(solref, solimp, load):
    stiffness, damping = law.solref_to_spring_at_rest(solref, solimp=solimp, load=load)
    x = load / stiffness
    d = impedance(solimp, x)
    k, b = law.solref_to_spring(solref, impedance_width=min(solimp[1], 0.9999))
    # d is found to 1e-10 of the width, over which it changes by less than ten times itself, and
    # 1 - d may be as small as 1e-4.
    assert d * d * k * x == pytest.approx((1.0 - d) * load, rel=1e-5)
    assert damping / (2.0 * math.sqrt(stiffness)) == pytest.approx(b / (2.0 * math.sqrt(k)))


def impedance(solimp, x):
    """Return MuJoCo's impedance at a deformation, from its documentation."""
    start, end = np.clip(solimp[:2], 1e-4, 0.9999)
    _, _, width, midpoint, power = solimp
    if width == 0.0:
        return 0.5 * (start + end)
    r = min(x / width, 1.0)
    if r <= midpoint:
        y = r**power / midpoint ** (power - 1.0)
    else:
        y = 1.0 - (1.0 - r) ** power / (1.0 - midpoint) ** (power - 1.0)
    return start + y * (end - start)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"solref": (0.02, -1.0)}, "solref"),
        ({"solref": (0.02,)}, "solref"),
        ({"solref": (0.02, 1.0), "solimp": (0.9, 0.95, 0.001)}, "solimp"),
        ({"solref": (0.02, 1.0), "solimp": (0.9, 0.95, -0.001, 0.5, 2.0)}, "solimp"),
        ({"solref": (0.02, 1.0), "solimp": (0.9, math.nan, 0.001, 0.5, 2.0)}, "solimp"),
        ({"solref": (0.02, 1.0), "load": 0.0}, "load"),
        ({"solref": (0.02, 1.0), "load": math.inf}, "load"),
    ],
)
def test_bad_numbers_are_refused_by_name(arguments, named):
    with pytest.raises(ValueError, match=named):
        law.solref_to_spring_at_rest(arguments.pop("solref"), **arguments)


def test_a_ball_sinks_steadily_into_a_contact_of_damping_alone():
    """Direct solref without stiffness: what the spring remembers is no force."""
    damping, impedance = 50.0, 0.9
    own = attributes((0.0, -damping), (impedance, impedance, 0.001, 0.5, 2.0))
    engine = Engine(
        mujoco.MjModel.from_xml_string(f"""
        <mujoco><worldbody><geom type="plane" size="1 1 1" {own}/>
          <body pos="0 0 0.1"><freejoint/><geom size="0.1" mass="2" {own}/></body>
        </worldbody></mujoco>""")
    )
    data = engine.make_data()
    engine.step(data, nstep=500)
    speed = -data.qvel[2]
    engine.step(data, nstep=500)
    # The damper keeps the ratio to a spring that is 1 / (1 - d) times as stiff as MuJoCo's
    # (solref.hpp). With none beside it the ball sinks faster than in MuJoCo by 1 / sqrt(1 - d).
    assert speed == pytest.approx(GRAVITY * math.sqrt(1.0 - impedance) / damping, rel=1e-9)
    plain = mujoco.MjData(engine.model)
    mujoco.mj_step(engine.model, plain, 500)
    assert -plain.qvel[2] == pytest.approx(speed * math.sqrt(1.0 - impedance), rel=1e-6)
    # Steady after 1 s, 50 times 1 / damping: what is left of the start is below rounding.
    assert -data.qvel[2] == pytest.approx(speed, rel=1e-9)
    np.testing.assert_allclose(engine.contacts(data).force, [[2.0 * GRAVITY, 0, 0]], atol=1e-9)
