"""What hangs on a string, a spatial tendon at its limit or in an equality, keeps its energy."""

import mujoco
import numpy as np
import pytest

import dashpot

GRAVITY, LENGTH, ANGLE = 9.81, 1.0, 0.6  # m/s^2, m, rad
JOINTS = {
    "free": "<freejoint/>",
    "slides": "".join(
        f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1")
    ),
}
HELD = {
    "limit": ('limited="true" range="0 1"', ""),
    "equality": ("", '<equality><tendon tendon1="string"/></equality>'),
}


def string(body: str, held: str, integrator: str, dt: float) -> dashpot.Engine:
    limit, equality = HELD[held]
    return dashpot.Engine(
        mujoco.MjModel.from_xml_string(f"""<mujoco>
          <option timestep="{dt}" integrator="{integrator}"/><worldbody>
          <site name="top" pos="0 0 2"/>
          <body pos="0 0 1">{JOINTS[body]}
            <geom size=".03" mass="1" contype="0" conaffinity="0"/><site name="bob"/></body>
        </worldbody><tendon><spatial name="string" {limit}><site site="top"/><site site="bob"/>
        </spatial></tendon>{equality}</mujoco>""")
    )


@pytest.mark.parametrize("dt", [0.002, 0.01])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("held", HELD)
@pytest.mark.parametrize("body", JOINTS)
def test_a_conical_pendulum_circles_at_its_height(body, held, integrator, dt):
    engine = string(body, held, integrator, dt)
    data = engine.make_data()
    lowest = np.zeros(3) if body == "slides" else np.array([0.0, 0.0, 1.0])
    radius, height = LENGTH * np.sin(ANGLE), LENGTH * (1.0 - np.cos(ANGLE))
    rate = np.sqrt(GRAVITY / (LENGTH * np.cos(ANGLE)))
    data.qpos[:3] = lowest + np.array([radius, 0.0, height])
    data.qvel[1] = radius * rate
    engine.step(data, nstep=round(5.0 / dt))
    x, y, z = data.qpos[:3] - lowest
    # Of second order: some (rate dt)^2 / 24 of a turn of 19 rad, and of the height.
    allowed = 20.0 * (rate * dt) ** 2 / 24.0
    assert z == pytest.approx(height, abs=allowed / 10.0 + 1e-5)
    turned = np.angle((x + 1j * y) * np.exp(-1j * rate * 5.0))
    assert abs(turned) < allowed + 1e-4


@pytest.mark.parametrize("dt", [0.001, 0.002, 0.005, 0.01])
def test_a_string_that_wraps_around_a_peg_keeps_the_energy(dt):
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{dt}"/><worldbody>
          <site name="top" pos="0 0 2"/><site name="right" pos=".2 0 1.5"/>
          <geom name="peg" type="cylinder" size=".05 .1" pos="0 0 1.5" euler="90 0 0"
                contype="0" conaffinity="0"/>
          <body pos="0 0 1"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
            <geom size=".03" mass="1" contype="0" conaffinity="0"/><site name="bob"/></body>
        </worldbody><tendon><spatial name="string" limited="true" range="0 1">
          <site site="top"/><geom geom="peg" sidesite="right"/><site site="bob"/></spatial></tendon>
        </mujoco>""")
    )
    data = engine.make_data()
    angle = 0.7
    data.qpos[:] = np.sin(angle), 1.0 - np.cos(angle)
    mujoco.mj_forward(engine.model, data)
    start = engine.energy(data).mechanical
    for _ in range(round(1.5 / dt)):
        engine.step(data)
        # A step in which the string comes to the peg goes a straight way: (omega dt)^2 L / 8.
        assert data.ten_length[0] <= 1.0 + 3.0 * dt**2
    # Of second order in the turn about the peg, up to 4.4 rad/s: 5e-6 J at 1 ms, 6e-4 J at 10 ms.
    now = engine.energy(data).mechanical
    assert now == pytest.approx(start, abs=1e-3 * (dt / 0.01) ** 2)
