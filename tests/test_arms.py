"""Position-controlled arms press on a table with what their actuators give."""

import mujoco
import numpy as np
import pytest

from pressing import Pressing, above_table, press, raised

# Six hinges like those of a small industrial arm, with its usual gains.
LINKS = (
    ("0 0 0.16", "0 0 1", "0 0 0.1", 4.0, 2000.0),
    ("0 0.1 0", "0 1 0", "0.42 0 0", 8.0, 2000.0),
    ("0.42 0 0", "0 1 0", "0.39 0 0", 2.3, 2000.0),
    ("0.39 0 0", "0 1 0", "0 0.1 0", 1.2, 500.0),
    ("0 0.1 0", "0 0 1", "0 0 -0.1", 1.2, 500.0),
    ("0 0 -0.1", "0 1 0", "0 0 -0.08", 0.3, 500.0),
)
IMPLICIT = ("Euler", "implicitfast", "implicit")
COMMAND = np.array([0.3, -0.9, 1.5, -0.6, 0.2, 0.1])


def arm(integrator: str, dry_friction: float) -> Pressing:
    # What damps the servos is implicit in each integrator that is: of joints in Euler's.
    bodies, servos, implicit = "", "", integrator.startswith("implicit")
    for i, (position, axis, end, mass, gain) in enumerate(LINKS):
        damping, kv = (1.0, gain / 5) if implicit else (gain / 5, 0.0)
        bodies += f"""<body name="link{i}" pos="{position}">
          <joint name="j{i}" axis="{axis}" armature="0.1" damping="{damping}"
            frictionloss="{dry_friction}"/>
          <geom type="capsule" fromto="0 0 0 {end}" size="0.03" mass="{mass}" contype="0"
            conaffinity="0"/>"""
        servos += f'<position joint="j{i}" kp="{gain}" kv="{kv}"/>'
    spec = mujoco.MjSpec.from_string(f"""<mujoco><option integrator="{integrator}"/><worldbody>
      {bodies}{"</body>" * len(LINKS)}</worldbody><actuator>{servos}</actuator></mujoco>""")
    model = above_table(spec, "link5", np.array([0.0, 0.0, -0.1]), COMMAND)
    return Pressing(model, COMMAND, raised(COMMAND), COMMAND)


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("integrator", IMPLICIT)
def test_static_force_is_the_actuators(integrator, timestep):
    found = press(arm(integrator, 0.0), timestep)
    assert found["speed"] < 1e-8
    assert found["force"] > 10.0
    # 1 % is the bound; at rest the balance is exact.
    assert found["error"] < 1e-6


@pytest.mark.parametrize("timestep", [0.001, 0.005])
def test_joints_with_dry_friction_come_to_rest_too(timestep):
    found = press(arm("implicitfast", 0.2), timestep)
    assert found["speed"] < 1e-8
    # Dry friction of 0.2 N m takes part in the balance, over levers of about half a metre: each of
    # six joints bears up to 0.4 N of it.
    assert 0.1 < found["error"] * found["force"] < 6 * 0.4
