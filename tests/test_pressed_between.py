"""A light body between heavy ones, on a model's own solref: damped as MuJoCo damps the heavy."""

import mujoco
import numpy as np
import pytest

from dashpot import Engine, law

TIMECONST = 0.01  # s
# A ball of 0.2 kg on a plate, under a press that slides.
PRESS = """<mujoco><option timestep="{timestep}" gravity="0 0 0"/>
<default><geom solref="{timeconst} 1" solimp="{solimp}" condim="1"/></default><worldbody>
  <geom type="plane" size="1 1 1"/>
  <body pos="0 0 0.05"><joint type="slide" axis="0 0 1"/><geom size="0.05" mass="0.2"/></body>
  <body pos="0 0 0.15"><joint type="slide" axis="0 0 1"/>
    <geom type="box" size="0.2 0.2 0.05" mass="{mass}"/></body>
</worldbody></mujoco>"""


def press(*, mass, impedance, timestep=0.001):
    """Return the model of a press."""
    return mujoco.MjModel.from_xml_string(
        PRESS.format(
            timestep=timestep,
            timeconst=TIMECONST,
            solimp=f"{impedance} {impedance} 0.01",
            mass=mass,
        )
    )


def rebound(model, step):
    """Return the part of its speed that the press has after it hit the ball with 0.2 m/s."""
    data = mujoco.MjData(model)
    data.qvel[1] = -0.2
    for _ in range(round(1.0 / model.opt.timestep)):
        step(data)
        if data.qvel[1] > 0.0 and data.ncon == 0:
            break
    return data.qvel[1] / 0.2


@pytest.mark.parametrize("mass", [20.0, 100.0])
def test_heavy_press_rebounds_from_a_light_ball_as_mujocos_damper_lets_it(mass):
    impedance = 0.97
    model = press(mass=mass, impedance=impedance)
    engine = Engine(model)
    # Both rows of the ball have A = 1 / 0.2 kg, but for the press's own, R = (1 - d) A / d, the
    # spring d k / R and the damper b / R; one after the other they are half as stiff.
    k, b = law.solref_to_spring((TIMECONST, 1.0), impedance_width=impedance)
    regularisation = (1.0 - impedance) / impedance / 0.2
    stiffness, damping = 0.5 * impedance * k / regularisation, 0.5 * b / regularisation
    ratio = 0.5 * damping / np.sqrt(stiffness * mass)
    expected = law.damping_ratio_to_restitution(ratio)
    assert 0.2 < expected < 0.7
    # The inertia of 3 kg that the rows add in MuJoCo, and the ball's own, are left out.
    assert rebound(engine.model, engine.step) == pytest.approx(expected, abs=0.05)
    fine = press(mass=mass, impedance=impedance, timestep=1e-4)
    mujocos = rebound(fine, lambda data: mujoco.mj_step(fine, data))
    assert mujocos == pytest.approx(expected, abs=0.05)


# A light hand whose fingers have heavy motors, about balls of 0.2 kg in a row.
