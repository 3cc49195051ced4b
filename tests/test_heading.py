"""Turned about the vertical with all that it does, a hit is the same: friction knows no heading."""

import mujoco
import numpy as np
import pytest

import dashpot

SHAPES = {
    "cuboid": 'type="box" size=".1 .06 .04"',
    "bar": 'type="box" size=".2 .02 .02"',
    "rod": 'type="cylinder" size=".01 .2"',
    "ellipsoid": 'type="ellipsoid" size=".05 .1 .15"',
}
# Orientation (axis-angle, rad), velocity (m/s), angular velocity in the body's frame (rad/s).
THROWS = [
    ((0.35, 0.52, 0.7), (1.0, 0.3, -2.0), (5.0, 3.0, -2.0)),
    ((0.9, 0.2, 0.0), (0.0, 1.0, -2.0), (0.0, 0.0, 0.0)),
]
HEADINGS = np.linspace(0.0, np.pi, 7)


def rebound(engine: dashpot.Engine, throw: tuple, heading: float) -> np.ndarray:
    """Return the velocity after the hit, turned back: linear (m/s) and of the body (rad/s)."""
    axis_angle, velocity, spin = (np.array(part) for part in throw)
    turn, tilt, orientation = np.empty(4), np.empty(4), np.empty(4)
    mujoco.mju_axisAngle2Quat(turn, np.array([0.0, 0.0, 1.0]), heading)
    mujoco.mju_axisAngle2Quat(
        tilt, axis_angle / np.linalg.norm(axis_angle), np.linalg.norm(axis_angle)
    )
    mujoco.mju_mulQuat(orientation, turn, tilt)
    data = engine.make_data()
    data.qpos[3:] = orientation
    mujoco.mju_rotVecQuat(data.qvel[:3], velocity, turn)
    data.qvel[3:] = spin
    timestep = engine.model.opt.timestep
    touched = False
    for _ in range(round(0.5 / timestep)):
        touching = engine.step(data).touching > 0
        if touched and not touching:
            break
        touched = touched or touching
    assert touched
    back = np.empty(3)
    mujoco.mju_rotVecQuat(back, data.qvel[:3], turn * (1, -1, -1, -1))
    return np.concatenate([back, data.qvel[3:]])


# How a contact is given, and by how much of the speed, and of the spin, headings may differ.
# Friction solves tangents one by one, in micro-steps: to first order in these, which are some 10 us
# in the 5 to 10 ms of the hits of a material in SI units, and a tenth of a hit of rigid ones. What
# damps more than these resolve is limited by how the two tangents are coupled; not with restitution
# 0.
CONTACTS = {
    "SI": (dashpot.Material(stiffness=1e5, friction=(1.0, 0.01, 0.01)), "", 2e-3, 2e-3),
    "solref": (None, 'solref=".01 1"', 0.02, 0.1),
    "rigid": (None, "", 0.02, 0.12),
    "inelastic": (dashpot.Material(restitution=0.0), "", 0.01, 0.12),
}


@pytest.mark.parametrize("contact", CONTACTS)
@pytest.mark.parametrize(
    ("throw", "condim"), [*zip(THROWS, (3, 6), strict=True)], ids=["tumbling", "oblique"]
)
@pytest.mark.parametrize("shape", SHAPES)
def test_a_hit_is_the_same_in_every_heading(shape, throw, condim, contact):
    """Dampers that went by the inertia along each tangent left up to 0.4 m/s between headings."""
    material, solref, of_speed, of_spin = CONTACTS[contact]
    timestep = 1e-4 if contact == "SI" else 2e-3
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}" gravity="0 0 0"/>
        <default><geom friction="1 .01 .01" {solref}/></default><worldbody>
        <geom name="floor" type="plane" size="9 9 .1"/><body pos="0 0 .3"><freejoint/>
        <geom name="thrown" {SHAPES[shape]} mass="1" condim="{condim}"/></body>
        </worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    if material:
        engine.set_pair_material("thrown", "floor", material)
    rebounds = np.array([rebound(engine, throw, heading) for heading in HEADINGS])
    spread = np.ptp(rebounds, axis=0)
    assert spread[:3].max() < of_speed * np.linalg.norm(throw[1])
    assert spread[3:].max() < of_spin * (np.abs(rebounds[:, 3:]).max() + 1.0)
