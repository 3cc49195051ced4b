"""A hammer drives a nail that dry friction holds: all of its energy goes into friction."""

import mujoco
import pytest

import dashpot

HAMMER, SPEED, FRICTION = 0.57, 2.4, 400.0  # kg, m/s, N
XML = """<mujoco><option timestep="{dt}" gravity="0 0 0" cone="elliptic"/><worldbody>
  <body pos="0 0 .0913"><joint type="slide" axis="0 0 1"/>
    <geom name="hammer" size=".03" mass="{hammer}"/></body>
  <body><joint type="slide" axis="0 0 1" frictionloss="{friction}"/>
    <geom name="nail" type="cylinder" size=".004 .04" mass="{nail}"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize(
    "material", [None, dashpot.Material(restitution=0)], ids=["default", "inelastic"]
)
@pytest.mark.parametrize("nail", [0.02, 0.1, 0.5])
@pytest.mark.parametrize("dt", [0.0005, 0.001, 0.002, 0.005])
def test_a_rigid_hammer_drives_a_light_nail(dt, nail, material):
    xml = XML.format(dt=dt, hammer=HAMMER, nail=nail, friction=FRICTION)
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    if material is not None:
        engine.set_pair_material("hammer", "nail", material)
    data = engine.make_data()
    data.qvel[0] = -SPEED
    engine.step(data, nstep=round(0.06 / dt))
    both = HAMMER + nail
    driven = 0.5 * both * (SPEED * HAMMER / both) ** 2 / FRICTION
    # An inelastic hit, then a constant force. What the contact stores under it, f^2 / 2 k, comes
    # back: 64 micro-steps resolve 7e5 N/m at 5 ms for the lightest nail, that is 0.11 J of 1.6.
    assert -data.qpos[1] == pytest.approx(driven, rel=0.05)
    assert abs(data.qvel[1]) < 1e-12  # m/s: what holds it is a damped spring
    assert 0.0 <= data.qvel[0] < 0.2 * SPEED


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_dry_friction_of_light_fingers_costs_no_microsteps(friction):
    """What accelerates a finger's tip by a few g does not press hard."""
    engine = dashpot.Engine(
        mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep=".002"/><worldbody>
          <geom type="plane" size="1 1 .1"/>
          <body pos="0 0 .02"><freejoint/><geom type="box" size=".02 .02 .02"/></body>
          <body pos="0 0 .049"><joint type="slide" axis="0 0 1" frictionloss="{friction}"/>
            <geom size=".01" mass=".01"/></body>
        </worldbody></mujoco>""")
    )
    stats = engine.step(engine.make_data(), nstep=50)
    assert stats.touching == 5
    assert stats.microsteps == 13 * 3  # those of the hit that it starts with


@pytest.mark.parametrize("dt", [0.001, 0.005])
def test_dry_friction_of_a_joint_and_of_its_tendon_add_up(dt: float) -> None:
    """10 N of the joint and, by a coefficient of 2, 8 N of a tendon hold up to 18 N."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="{dt}" gravity="0 0 0"/><worldbody><body>
      <joint name="held" type="slide" axis="1 0 0" frictionloss="10"/>
      <geom size=".02" mass="2"/></body></worldbody>
      <tendon><fixed frictionloss="4"><joint joint="held" coef="2"/></fixed></tendon>
      <actuator><motor joint="held"/></actuator></mujoco>""")
    engine = dashpot.Engine(model)
    for push, speed in ((17.8, 0.0), (20.0, 0.5)):
        data = engine.make_data()
        data.ctrl[0] = push
        engine.step(data, nstep=round(0.5 / dt))
        # Of 2 kg; it slides once the springs of both are loaded, in a part of a step.
        assert data.qvel[0] == pytest.approx(speed, abs=0.1 * dt if speed else 1e-9)


def pressed_balls(tendon_friction: float | None) -> float:
    """Return the compression (m) of a ball pressed by 150 N against one that friction holds."""
    tendon = ""
    if tendon_friction is not None:
        tendon = f"""<tendon><fixed frictionloss="{tendon_friction}"><joint joint="held" coef="1"/>
          </fixed></tendon>"""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="0.002" gravity="0 0 0"/><worldbody>
      <body><joint name="held" type="slide" axis="1 0 0" frictionloss="200"/>
        <geom size=".02" mass=".05"/></body>
      <body pos=".0401 0 0"><joint name="pushed" type="slide" axis="1 0 0"/>
        <geom size=".02" mass=".05"/></body></worldbody>{tendon}
      <actuator><motor joint="pushed"/></actuator></mujoco>""")
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.ctrl[0] = -150.0
    engine.step(data, nstep=499)
    return engine.step(data).max_compression


def test_a_tendon_beside_it_leaves_the_stiffness_at_a_joint_with_dry_friction() -> None:
    """The friction of a tendon took the place of the joint's: 0.28 mm instead of 0.02."""
    alone = pressed_balls(None)
    for tendon_friction in (1e-3, 1.0):
        assert pressed_balls(tendon_friction) == pytest.approx(alone, rel=0.05)
