"""Sliding boxes: exact stopping distance, and a normal force that ignores sliding speed."""

import mujoco
import numpy as np
import pytest

import dashpot
from scene import GRAVITY, free_body, mjcf, set_velocity
from scenes import rise, slide
from simulate import DASHPOT, make_engine, measure

TIMESTEPS = (0.001, 0.002, 0.005, 0.010)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_stopping_distance(timestep):
    numbers = measure(slide(), DASHPOT, timestep)
    # 0.05 mm: loading of the contacts and the pull-back of the friction springs are below 2 um.
    assert numbers["distance error"] <= 5e-5
    assert numbers["final speed"] <= 1e-9  # at rest to rounding


@pytest.mark.parametrize("speed", [0.3, 2.0])
@pytest.mark.parametrize("timestep", [0.002, 0.010])
def test_stopping_distance_scales_with_speed_squared(speed, timestep):
    assert measure(slide(speed=speed), DASHPOT, timestep)["distance error"] <= 5e-5


def test_friction_is_isotropic():
    """Thrown in any direction a box stops along it, at the same distance, without turning."""
    scene = slide()
    expected = 1 / (2 * 0.2 * GRAVITY)
    for angle in (0.0, 0.4, 1.1, 2.5):
        engine = make_engine(scene, scene.model(0.005))
        data = engine.make_data()
        direction = np.array([np.cos(angle), np.sin(angle)])
        set_velocity("box", (*direction, 0))(engine.model, data)
        engine.step(data, nstep=220)
        np.testing.assert_allclose(data.qpos[:2], expected * direction, atol=5e-5)
        # It keeps its attitude up to elastic displacements, mu times 7 um of rigid contacts, over
        # its half length of 0.1 m.
        assert np.abs(data.qpos[4:7]).max() <= 1.4e-5


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_fast_cube_does_not_rise(timestep):
    # 1e-3 mm; MuJoCo's cone lifts it by tens of millimetres.
    assert measure(rise(), DASHPOT, timestep)["rise"] <= 1e-6


@pytest.mark.parametrize("timestep", [0.001, 0.010])
def test_normal_force_while_sliding_is_the_weight(timestep):
    scene = slide(speed=3.0)
    engine = make_engine(scene, scene.model(timestep))
    data = engine.make_data()
    set_velocity("box", (3.0, 0, 0))(engine.model, data)
    engine.step(data, nstep=round(0.5 / timestep))
    contacts = engine.contacts(data)
    assert contacts.force[:, 0].sum() == pytest.approx(GRAVITY, rel=1e-6)
    sliding = np.linalg.norm(contacts.force[:, 1:], axis=1)
    # Every sliding contact is on its limit.
    np.testing.assert_allclose(sliding, 0.2 * contacts.force[:, 0], rtol=1e-6)
    assert not contacts.sticking.any()


def test_without_friction_a_condim_3_contact_moves_nothing_sideways():
    """A ball that drops on a plane while it slides: its way along the plane is v t exactly."""
    model = mujoco.MjModel.from_xml_string(
        mjcf(free_body("ball", 'type="sphere" size="0.1" mass="1"', (0, 0, 0.101)))
    )
    model.opt.timestep = 0.002
    engine = dashpot.Engine(model)
    for geom in range(model.ngeom):
        engine.set_material(geom, dashpot.Material(1e5, restitution=0.5, friction=0.0))
    data = engine.make_data()
    data.qvel[:2] = (3.0, -2.0)
    engine.step(data, nstep=500)
    # To rounding of 500 sums of steps of millimetres.
    np.testing.assert_allclose(data.qpos[:2], (3.0, -2.0), rtol=1e-12)
    np.testing.assert_allclose(data.qvel[3:], 0.0, atol=1e-12)
    # The springs of the normal alone store energy: (m g)^2 / (2 k), two of 1e5 N/m in series.
    assert engine.energy(data).elastic == pytest.approx(GRAVITY**2 / 1e5, rel=1e-3)


@pytest.mark.parametrize("stiffness", [None, 1e5])
@pytest.mark.parametrize(
    "normal", [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (-1, 0, 1e-13), (0.6, 0, 0.8)]
)
def test_friction_holds_a_capsule_that_stands_square_on_a_wall(normal, stiffness):
    """A tangent along its axis is none: with the x axis instead, the normal, nothing held it."""
    normal = np.array(normal) / np.linalg.norm(normal)
    ends = np.concatenate([0.1 * normal, 0.3 * normal])
    slides = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep=".002"/><worldbody>
        <geom type="plane" size="0 0 1" zaxis="{" ".join(map(str, normal))}"/>
        <body name="capsule">{slides}
          <geom type="capsule" size=".1" mass="1" fromto="{" ".join(map(str, ends))}"/></body>
        </worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    if stiffness is not None:
        for geom in range(2):
            engine.set_material(geom, dashpot.Material(stiffness, restitution=0.5, friction=1.0))
    data = engine.make_data()
    data.body("capsule").xfrc_applied[:3] = -100.0 * normal
    engine.step(data, nstep=500)
    frame = engine.contacts(data).frame[0]
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-9)
    # Two springs in a row give way by 2 mm under 100 N.
    assert np.abs(data.qpos).max() < 2.1e-3
    assert np.abs(data.qvel).max() < 1e-6
