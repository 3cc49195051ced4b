"""Law "comfree": dry friction, limits and equalities, a row each, closed form and explicit."""

import importlib.util
from pathlib import Path

import mujoco
import numpy as np
import pytest

import dashpot

STIFFNESS, DAMPING = 0.2, 0.001  # the published defaults, 1/s and 1
SOLIMP = (0.9, 0.9, 0.001, 0.5, 2)


def make_engine(bodies, below="", *, timestep=0.002, integrator="Euler", gravity=0.0, **options):
    return dashpot.Engine(
        mujoco.MjModel.from_xml_string(
            f"""<mujoco><option timestep="{timestep}" integrator="{integrator}"
            gravity="0 0 {-gravity}"/><worldbody>{bodies}</worldbody>{below}</mujoco>"""
        ),
        law="comfree",
        **options,
    )


SLIDE = """<body><joint name="j" type="slide" {}/><geom size=".1" mass="2"/></body>"""
HINGE = """<body><joint name="j" axis="0 1 0" {}/><geom size=".05" mass="2" pos=".3 0 0"/></body>"""
TENDON = """<tendon><fixed frictionloss="{}"><joint joint="j" coef="1"/></fixed></tendon>"""


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit", "RK4"])
@pytest.mark.parametrize("timestep", [0.0005, 0.002, 0.01])
@pytest.mark.parametrize("body", [SLIDE, HINGE], ids=["slide", "hinge"])
@pytest.mark.parametrize("of", ["joint", "tendon"])
def test_dry_friction_holds_a_load_below_it_and_slides_with_the_rest_above(
    of, body, timestep, integrator
):
    loss = 2.0
    if of == "joint":
        engine = make_engine(
            body.format(f'frictionloss="{loss}"'), timestep=timestep, integrator=integrator
        )
    else:
        engine = make_engine(
            body.format(""), TENDON.format(loss), timestep=timestep, integrator=integrator
        )
    data = engine.make_data()
    mujoco.mj_forward(engine.model, data)
    inertia = np.zeros((1, 1))
    mujoco.mj_fullM(engine.model, data, inertia)
    steps = round(0.5 / timestep)
    for load in (0.5, -1.5, 1.99):
        mujoco.mj_resetData(engine.model, data)
        data.qfrc_applied[0] = load
        engine.step(data, nstep=steps)
        assert abs(data.qpos[0]) < 1e-12
        assert abs(data.qvel[0]) < 1e-12
        assert data.qfrc_constraint[0] == pytest.approx(-load, rel=1e-9)
    for load in (3.0, -5.0):
        mujoco.mj_resetData(engine.model, data)
        data.qfrc_applied[0] = load
        engine.step(data, nstep=steps)
        speed = np.sign(load) * (abs(load) - loss) * data.time / inertia[0, 0]
        assert data.qvel[0] == pytest.approx(speed, rel=1e-9)
        assert data.qfrc_constraint[0] == pytest.approx(-np.sign(load) * loss)
        # Work of friction, over the way that velocities before and after a step have.
        way = 0.5 * abs(speed) * data.time
        assert engine.energy(data).dissipated == pytest.approx(loss * way, rel=1e-9)


@pytest.mark.parametrize("speed", [0.3, -0.8])
def test_dry_friction_stops_what_slides_and_lets_it_rest(speed):
    """At v^2 m / (2 L), within a step; nothing turns back."""
    engine = make_engine(SLIDE.format('frictionloss="1.5"'), timestep=0.001)
    data = engine.make_data()
    data.qvel[0] = speed
    engine.step(data, nstep=2000)
    way = 2.0 * speed * abs(speed) / (2.0 * 1.5)
    assert data.qpos[0] == pytest.approx(way, abs=abs(speed) * 0.001)
    assert data.qvel[0] == 0.0
    assert engine.energy(data).dissipated == pytest.approx(0.5 * 2.0 * speed**2, rel=1e-9)


@pytest.mark.parametrize("tendons", [0, 3, 12])
@pytest.mark.parametrize("loss", [0.1, 0.6, 10.0])
def test_coupled_dry_friction_never_gives_energy(loss, tendons):
    """Slides on slides, and tendons that lie on all of them: 12 rows push one motion at once."""
    bodies = "".join(
        f'<body><joint name="j{i}" type="slide" frictionloss="{loss}"/>'
        f'<geom size=".1" mass="{0.2 + 0.3 * i}" contype="0" conaffinity="0"/>'
        for i in range(4)
    )
    joints = "".join(f'<joint joint="j{i}" coef="{1 + 0.2 * i}"/>' for i in range(4))
    fixed = f'<fixed frictionloss="{loss}">{joints}</fixed>' * tendons
    engine = make_engine(bodies + "</body>" * 4, f"<tendon>{fixed}</tendon>", timestep=0.005)
    data = engine.make_data()
    data.qvel[:] = [1.0, -0.7, 0.4, -1.2]
    before = engine.energy(data).kinetic
    for _ in range(3000):
        engine.step(data)
        after = engine.energy(data).kinetic
        assert after <= before * (1.0 + 1e-12) + 1e-30
        before = after
    assert before < 1e-6


def static_displacement(load, inertia, mass, timestep):
    """Return by how far a row of facet mass m gives way under a load, at rest; m or rad."""
    rate = timestep * load / inertia
    return timestep * (load / mass + (DAMPING / timestep + STIFFNESS) * -rate) / STIFFNESS


def facet_mass(inertia):
    return SOLIMP[0] / (1.0 - SOLIMP[0]) * inertia


@pytest.mark.parametrize("timestep", [0.001, 0.004])
@pytest.mark.parametrize("load", [3.0, -7.0])
def test_limit_holds_a_load_at_its_static_depth(load, timestep):
    solimp = " ".join(map(str, SOLIMP))
    engine = make_engine(
        SLIDE.format(f'limited="true" range="-.1 .1" damping="30" solimplimit="{solimp}"'),
        timestep=timestep,
    )
    data = engine.make_data()
    data.qfrc_applied[0] = load
    engine.step(data, nstep=round(8.0 / timestep))
    inertia = 2.0 + 30.0 * timestep  # Euler is implicit in dampers
    depth = static_displacement(abs(load), inertia, facet_mass(2.0), timestep)
    assert data.qpos[0] == pytest.approx(np.sign(load) * (0.1 + depth), rel=1e-6)
    assert abs(data.qvel[0]) < 1e-6


@pytest.mark.parametrize("timestep", [0.001, 0.004])
@pytest.mark.parametrize("load", [3.0, -7.0])
def test_equality_gives_way_to_either_side_by_its_static_error(load, timestep):
    solimp = " ".join(map(str, SOLIMP))
    engine = make_engine(
        SLIDE.format('damping="30"'),
        f'<equality><joint joint1="j" polycoef=".05 0 0 0 0" solimp="{solimp}"/></equality>',
        timestep=timestep,
    )
    data = engine.make_data()
    data.qfrc_applied[0] = load
    engine.step(data, nstep=round(8.0 / timestep))
    inertia = 2.0 + 30.0 * timestep
    error = static_displacement(abs(load), inertia, facet_mass(2.0), timestep)
    assert data.qpos[0] == pytest.approx(0.05 + np.sign(load) * error, rel=1e-6)
    assert data.qfrc_constraint[0] == pytest.approx(-load, rel=1e-6)


BALL = '<freejoint/><geom name="{0}" size=".05" mass=".5"/>'
PAIR = f"""<body name="a" pos="0 0 1"><joint axis="0 1 0" damping=".02"/>
  <geom size=".05" mass="1" pos=".2 0 0"/></body>
  <body name="b" pos=".4 0 1">{BALL.format("b")}</body>"""


@pytest.mark.parametrize(
    "equality",
    [
        '<connect body1="a" body2="b" anchor=".3 0 0"/>',
        '<weld body1="a" body2="b"/>',
        '<weld body1="world" body2="b"/>',
        '<connect body1="b" body2="world" anchor="-.4 0 0"/>',
    ],
)
def test_error_of_an_equality_stays_bounded_under_weight(equality):
    """At most some times what the whole weight bends a row, which swings about it."""
    engine = make_engine(PAIR, f"<equality>{equality}</equality>", gravity=9.81)
    data = engine.make_data()
    most = 0.0
    for _ in range(3000):
        engine.step(data)
        rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        most = max(most, np.abs(data.efc_pos[rows]).max())
    sag = 1.5 * 9.81 * 0.002 / (STIFFNESS * facet_mass(0.5))
    assert 0.1 * sag < most < 8.0 * sag
    assert np.abs(data.qvel).max() < 10.0


def test_mimic_joints_follow_within_the_error_of_their_row():
    """A gripper's fingers, one driven, the other one led by an equality."""
    finger = (
        '<body pos="{0} 0 0"><joint name="{1}" type="slide" damping="5"/>'
        '<geom size=".02" mass=".1"/></body>'
    )
    engine = make_engine(
        finger.format(-0.1, "left") + finger.format(0.1, "right"),
        '<equality><joint joint1="right" joint2="left" polycoef="0 -1 0 0 0"/></equality>'
        '<actuator><position joint="left" kp="50"/></actuator>',
    )
    data = engine.make_data()
    data.ctrl[0] = 0.03
    engine.step(data, nstep=3000)
    assert data.qpos[0] == pytest.approx(0.03, rel=1e-3)
    assert data.qpos[1] == pytest.approx(-0.03, rel=1e-3)


def test_rows_that_edits_of_the_model_bring_act():
    engine = make_engine(SLIDE.format(""))
    data = engine.make_data()
    data.qfrc_applied[0] = 1.0
    engine.model.dof_frictionloss[0] = 1.5
    engine.step(data, nstep=100)
    assert abs(data.qvel[0]) < 1e-12


def test_dry_friction_of_what_cannot_move_is_none():
    engine = make_engine(
        SLIDE.format("") + '<site name="a"/><site name="b" pos="1 0 0"/>',
        '<tendon><spatial frictionloss="1"><site site="a"/><site site="b"/></spatial></tendon>',
    )
    data = engine.make_data()
    data.qvel[0] = 0.5
    engine.step(data, nstep=100)
    assert data.qvel[0] == 0.5
    assert engine.energy(data).dissipated == 0.0


def test_the_report_refuses_none_of_them():
    engine = make_engine(
        SLIDE.format('frictionloss="1" range="-1 1"'),
        '<equality><joint name="lock" joint1="j"/></equality>' + TENDON.format(2.0),
    )
    found = {feature.name: feature.treatment for feature in engine.report().features}
    assert found["joint 'j' frictionloss"] == "mapped"
    assert found["equality 'lock'"] == "honoured"
    assert "refused" not in found.values()


@pytest.mark.parametrize(
    "path",
    [
        "hand/reach.xml",
        "adroit_hand/adroit_door.xml",
        "adroit_hand/adroit_hammer.xml",
        "adroit_hand/adroit_relocate.xml",
    ],
)
def test_hands_step_with_bounded_energy_and_come_to_rest(path):
    """24 or more dry frictions and limits: never faster than twice what MuJoCo's hand is."""
    package = importlib.util.find_spec("gymnasium_robotics")  # not imported: it asks for others
    if package is None:
        pytest.skip("gymnasium-robotics is not installed")
    assets = Path(package.submodule_search_locations[0]) / "envs/assets"
    model = mujoco.MjModel.from_xml_path(str(assets / path))
    assert np.count_nonzero(model.dof_frictionloss) >= 20
    engine = dashpot.Engine(model, law="comfree")
    data, plain = engine.make_data(), mujoco.MjData(engine.model)
    hand = model.dof_frictionloss > 0.0
    most = most_plain = 0.0
    for _ in range(1000):
        engine.step(data)
        mujoco.mj_step(engine.model, plain)
        most = max(most, np.abs(data.qvel[hand]).max())
        most_plain = max(most_plain, np.abs(plain.qvel[hand]).max())
    assert most < 2.0 * most_plain
    assert np.abs(data.qvel[hand]).max() < 0.02 * most
    assert np.abs(data.qpos).max() < 10.0
