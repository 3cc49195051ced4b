"""Rebound of joints off their limits: that of critically damped springs, whatever acts beside."""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import dashpot

TIMESTEPS = (1e-3, 2e-3, 5e-3)


def engine_of(xml: str, timestep: float) -> tuple[dashpot.Engine, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{xml}</mujoco>")
    model.opt.timestep = timestep
    engine = dashpot.Engine(model)
    return engine, engine.make_data()


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_two_limits_hit_at_once_rebound_as_stiff_springs_do(timestep):
    link = '<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass="1" contype="0"/>'
    joint = '<joint axis="0 1 0" range="-90 2"/>'
    engine, data = engine_of(
        f"""<option gravity="0 0 0"/><worldbody><body>{joint}{link}
        <body pos=".3 0 0">{joint}{link}</body></body></worldbody>""",
        timestep,
    )
    data.qpos[:] = np.deg2rad(2.0)
    data.qvel[:] = 5.0
    mujoco.mj_forward(engine.model, data)
    inertia = np.zeros((2, 2))
    mujoco.mj_fullM(engine.model, data, inertia)
    inverse = np.linalg.inv(inertia)
    # In time over 1 / sqrt(kappa): springs kappa / w, each with its critical damper.
    stiffness = np.diag(1.0 / np.diag(inverse))

    def flow(_, state):
        compression, rate = state[:2], state[2:]
        force = np.where(compression > 0.0, stiffness @ (compression + 2.0 * rate), 0.0)
        return np.concatenate([rate, -inverse @ np.maximum(0.0, force)])

    start = np.concatenate([np.full(2, 1e-9), data.qvel])
    rebound = solve_ivp(flow, (0.0, 60.0), start, rtol=1e-8, max_step=0.02).y[2:, -1]
    engine.step(data)
    # Micro-steps resolve 1 / sqrt(kappa) by three; with one the rebound is 1.6 times as fast.
    np.testing.assert_allclose(data.qvel, rebound, rtol=0.05)


@pytest.mark.parametrize("timestep", TIMESTEPS)
@pytest.mark.parametrize("count", [1, 20])
def test_a_limit_rebounds_alike_if_the_other_end_of_the_range_is_near(count, timestep):
    """Both ends lie within reach, but one at most is pressed. A heavy base holds the joints."""
    speed = 5.0
    link = '<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass="1" contype="0"/>'
    joint = f'<joint axis="0 1 0" range="{-np.rad2deg(0.5 * speed * timestep)} 0"/>'
    links = f"<body>{joint}{link}</body>" * count
    engine, data = engine_of(
        f"""<option gravity="0 0 0"/><worldbody><body><joint type="slide" axis="0 0 1"/>
        <geom size="1" mass="1e6" contype="0"/>{links}</body></worldbody>""",
        timestep,
    )
    data.qvel[1:] = speed
    engine.step(data)
    assert data.nefc == 2 * count
    # Released where the force is zero, a critically damped hit leaves exp(-2).
    np.testing.assert_allclose(data.qvel[1:], -speed * np.exp(-2.0), rtol=0.02)


@pytest.mark.parametrize("timestep", [5e-4, 2e-3, 5e-3])
def test_a_trace_of_dry_friction_leaves_the_rebound_off_a_limit_as_it_is(timestep):
    link = """<option gravity="0 0 0"/><worldbody><body>
        <joint axis="0 1 0" range="-90 5" limited="true" {}/>
        <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass="1"/></body></worldbody>"""

    def rebound(joint):
        engine, data = engine_of(link.format(joint), timestep)
        data.qvel[0] = 5.0
        while data.qvel[0] > 0.0:
            engine.step(data)
        engine.step(data, nstep=int(np.ceil(0.02 / timestep)))  # the impact may last some steps
        return -data.qvel[0] / 5.0

    # A rigid limit is critically damped: released where the force is zero it leaves exp(-2).
    assert rebound("") == pytest.approx(np.exp(-2.0), rel=1e-6)
    # Dry friction brakes by 1e-3 N m / 0.03 kg m^2 for some 30 ms: 0.001 rad/s of 5.
    assert rebound('frictionloss="1e-3"') == pytest.approx(np.exp(-2.0), abs=1e-3)
