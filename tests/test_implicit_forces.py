"""Implicit integrators where forces grow with velocity: fluids, drives of the wrong sign."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import dashpot

CARD = 'type="box" size=".000125 .032 .047" mass=".000184" fluidshape="ellipsoid"'
PLATE = 'type="box" size=".002 .1 .15" density="1100" fluidshape="ellipsoid"'
# Density, viscosity and geom; and how fast it goes and turns, m/s and rad/s.
FLUIDS = {
    "card in air": ("1.225", "1.8e-5", CARD, 5.0, 100.0),
    "plate in water": ("1000", "1e-3", PLATE, 3.0, 20.0),
}


def kinetic_energy(model, data):
    product = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, product, data.qvel)
    return 0.5 * float(data.qvel @ product)


@pytest.mark.parametrize("integrator", ["implicit", "implicitfast"])
@pytest.mark.parametrize("fluid", FLUIDS)
def test_a_fluid_at_rest_takes_energy_from_what_tumbles_in_it(fluid, integrator):
    """At these speeds and 2 ms the derivatives of its lift exceed the inertia, here and there."""
    density, viscosity, geom, speed, spin = FLUIDS[fluid]
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option density="{density}" viscosity="{viscosity}" integrator="{integrator}"
          gravity="0 0 0"/><worldbody><geom type="plane" size="5 5 .1"/>
        <body pos="0 0 .08"><freejoint/><geom {geom}/></body></worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    met = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        data = engine.make_data()
        attitude = rng.normal(size=4)
        data.qpos[3:] = attitude / np.linalg.norm(attitude)
        data.qvel[:] = rng.uniform(-1, 1, 6) * ([speed] * 3 + [spin] * 3)
        mujoco.mj_forward(engine.model, data)
        start = energy = kinetic_energy(engine.model, data)
        for _ in range(100):
            met += engine.step(data).touching
            mujoco.mj_fwdPosition(engine.model, data)
            before, energy = energy, kinetic_energy(engine.model, data)
            # Where it is all but at rest, rounding of the forces is left. MuJoCo gains 8 %.
            assert energy < before + 1e-4 * start
        assert energy < 0.8 * start
    assert met


@pytest.mark.parametrize("integrator", ["implicit", "implicitfast"])
def test_a_card_flutters_as_in_steps_without_derivatives(integrator):
    """Against RK4 of MuJoCo at a fortieth of the step, which takes no derivative of the fluid."""

    def fall(timestep, chosen, engine=None):
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><option density="1.225" viscosity="1.8e-5" timestep="{timestep}"
              integrator="{chosen}"/><worldbody><geom type="plane" size="9 9 .1" pos="0 0 -9"/>
            <body><freejoint/><geom {CARD}/></body></worldbody></mujoco>"""
        )
        made = engine(model) if engine else None
        data = made.make_data() if made else mujoco.MjData(model)
        data.qpos[3:] = [np.cos(0.3), np.sin(0.3), 0.0, 0.0]
        data.qvel[:] = [3.0, 0.5, -4.0, 30.0, 2.0, 20.0]
        for _ in range(round(0.2 / timestep)):
            made.step(data) if made else mujoco.mj_step(model, data)
        return data.qpos[:3].copy()

    exact = fall(2.5e-5, "RK4")
    way = np.linalg.norm(exact)
    assert np.linalg.norm(fall(1e-3, integrator, dashpot.Engine) - exact) < 0.1 * way
    assert np.linalg.norm(fall(2.5e-4, integrator, dashpot.Engine) - exact) < 0.03 * way


def random_model(seed):
    """Return a chain or a branched tree in a fluid, with drives of either sign and contacts."""
    rng = np.random.default_rng(seed)
    integrator = rng.choice(["implicit", "implicitfast"])
    geoms = ['type="box" size=".01 .05 .08"', 'type="ellipsoid" size=".02 .05 .08"',
             'type="capsule" size=".02 .06"']  # fmt: skip
    density = 10.0 ** rng.uniform(1, 3)

    def body(depth):
        joint = rng.choice(["hinge", "slide", "ball"])
        axis = " ".join(f"{x:.3f}" for x in rng.normal(size=3))
        at = " ".join(f"{x:.3f}" for x in rng.uniform(-0.1, 0.1, 3))
        name = f"j{depth}_{rng.integers(10**9)}"
        names.append((name, joint))
        children = "" if depth == 0 else "".join(body(depth - 1) for _ in range(rng.integers(1, 3)))
        return f"""<body pos="{at}"><joint name="{name}" type="{joint}" axis="{axis}"/>
          <geom {rng.choice(geoms)} density="{density}" fluidshape="ellipsoid"/>{children}</body>"""

    names = []
    bodies = body(int(rng.integers(0, 3)))
    motors = "".join(
        f'<velocity joint="{name}" kv="{10.0 ** rng.uniform(-4, -1) * rng.choice([-1, 1])}"/>'
        for name, joint in names
        if joint != "ball"
    )
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{rng.choice([0.001, 0.002, 0.005])}" integrator="{integrator}"
          density="{rng.choice([1.2, 1000.0])}" viscosity="{rng.choice([0.0, 1e-3])}"/><worldbody>
        <geom type="plane" size="5 5 .1" pos="0 0 -.3"/>{bodies}
        <body pos="0 0 .4"><freejoint/><geom {rng.choice(geoms)} density="{density}"
          fluidshape="ellipsoid"/></body></worldbody><actuator>{motors}</actuator></mujoco>"""
    ), 5.0 * rng.normal(size=200)


def test_what_mujoco_steps_without_a_warning_steps():
    stepped = 0
    for seed in range(40):
        model, velocity = random_model(seed)
        plain = mujoco.MjData(model)
        plain.qvel[:] = velocity[: model.nv]
        for _ in range(150):
            mujoco.mj_step(model, plain)
        if any(warning.number for warning in plain.warning):
            continue
        engine = dashpot.Engine(model)
        data = engine.make_data()
        data.qvel[:] = velocity[: model.nv]
        engine.step(data, nstep=150)
        stepped += 1
    assert stepped > 20


@pytest.mark.parametrize("seed", [1082, 1104, 1182, 1186])
def test_light_body_thrown_into_water_slows_down_as_in_mujoco(seed):
    """Drag takes its speed within a step, and lift couples how it goes with how it turns."""
    model, velocity = random_model(seed)
    plain = mujoco.MjData(model)
    engine = dashpot.Engine(model)
    data = engine.make_data()
    plain.qvel[:] = data.qvel[:] = velocity[: model.nv]
    for _ in range(20):
        mujoco.mj_step(model, plain)
        engine.step(data)
        np.testing.assert_allclose(data.qvel[-6:], plain.qvel[-6:], atol=0.5)
    engine.step(data, nstep=280)
    assert abs(data.qvel[-6:]).max() < abs(velocity[:6]).max() + 9.81 * 300 * model.opt.timestep


@pytest.mark.parametrize("integrator", ["implicit", "implicitfast"])
@pytest.mark.parametrize("gain", [-0.02, 0.01, 0.05])
def test_drive_of_either_sign_on_a_free_body_steps_as_in_mujoco(gain, integrator):
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0" timestep=".005" integrator="{integrator}"/><worldbody>
        <body><freejoint/><site name="s"/><geom type="box" size=".01 .05 .08" mass=".02"/></body>
        </worldbody><actuator><general site="s" gear="1 0 0 0 .3 0" biastype="affine"
          biasprm="0 0 {gain * 200}"/></actuator></mujoco>"""
    )
    plain = mujoco.MjData(model)
    engine = dashpot.Engine(model)
    data = engine.make_data()
    plain.qvel[:] = data.qvel[:] = [0.1, 0.02, -0.03, 0.1, -0.2, 0.05]
    for _ in range(100):
        mujoco.mj_step(model, plain)
        engine.step(data)
    # Beside the drive, how it turns is exact here and of first order there.
    np.testing.assert_allclose(data.qvel, plain.qvel, atol=0.02)


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "RK4"])
def test_an_inertia_that_is_singular_names_the_joint_and_the_remedy(integrator):
    """Two joints of one body about one axis share its inertia, and neither has any of its own."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option integrator="{integrator}"/><worldbody>
        <geom type="plane" size="1 1 .1"/>
        <body pos="0 0 .09"><joint name="lift" axis="0 1 0"/><joint name="again" axis="0 1 0"/>
          <geom size=".1" pos=".5 0 0" mass="1"/></body></worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    before = data.qpos.copy()
    with pytest.raises(
        dashpot.DivergenceError, match=r"joint 'lift' is singular.*give .* mass, or joints armature"
    ):
        engine.step(data)
    assert data.qpos.tolist() == before.tolist()
