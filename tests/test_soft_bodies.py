"""Elastic flexes under `discrete`: they land, are stacked and gripped, and gain no energy."""

import mujoco
import pytest

import dashpot

IS_4 = mujoco.mj_version() >= 4000000
GRAVITY = 9.81
SCENE = """<mujoco><option timestep="{timestep}" integrator="{integrator}"/><worldbody>
  <geom type="plane" size="2 2 .1"/>{bodies}</worldbody>{rest}</mujoco>"""
BALL = '<body pos="{at}"><freejoint/><geom size=".04" mass=".1"/></body>'
BOX = '<body pos="{at}"><freejoint/><geom type="box" size=".05 .05 .03" mass=".2"/></body>'
SHELL = """<elasticity young="1e5" poisson=".2" thickness=".004" damping=".01"
  elastic2d="{of}"/>"""
NET = '<edge equality="true" damping=".01"/>'


def flex(
    count: str, at: str, inner: str, *, name: str = "soft", spacing: float = 0.04, more: str = ""
) -> str:
    """Return a grid of as many dimensions as it counts more than one."""
    dim = sum(int(number) > 1 for number in count.split())
    radius = 0.002 if dim == 3 else 0.005
    return f"""<flexcomp type="grid" count="{count}" spacing="{spacing} {spacing} {spacing}"
      pos="{at}" radius="{radius}" mass=".3" name="{name}" dim="{dim}" {more}>
      <contact condim="3" selfcollide="none"/>{inner}</flexcomp>"""


def solid(young: float = 5e4) -> str:
    return f'<elasticity young="{young}" poisson=".3" damping=".005"/>'


def rim(last: int) -> str:
    sides = [(0, 0, 0, last), (last, 0, last, last), (0, 0, last, 0), (0, last, last, last)]
    return "".join(f'<pin gridrange="{a} {b} {c} {d}"/>' for a, b, c, d in sides)


def cube(at: str, side: int = 4, name: str = "soft", young: float = 5e4) -> str:
    return flex(f"{side} {side} {side}", at, solid(young), name=name, spacing=0.03)


SCENES = {
    "soft cube falls": cube("0 0 .1"),
    "stiff cube falls": cube("0 0 .1", young=5e6),
    "large cube falls": cube("0 0 .1", side=6),
    "stacked cubes": cube("0 0 .05", 3, "low") + cube("0 0 .14", 3, "high"),
    "box on a pad": flex("5 5 3", "0 0 .05", solid()) + BOX.format(at="0 0 .13"),
    "shell drapes a ball": '<geom size=".1" pos="0 0 .15"/>'
    + flex("7 7 1", "0 0 .27", SHELL.format(of="both")),
    "bent cloth": '<geom size=".1" pos="0 0 .15"/>'
    + flex("6 6 1", "0 0 .27", SHELL.format(of="bend") + '<edge equality="true"/>'),
    "clamped plate": flex("9 5 1", "0 0 .4", SHELL.format(of="both") + '<pin gridrange="0 0 0 4"/>')
    + BALL.format(at="-.12 0 .446"),
    "trampoline": flex("7 7 1", "0 0 .5", SHELL.format(of="both") + rim(6))
    + BALL.format(at="0 0 .6"),
    "large trampoline": flex("15 15 1", "0 0 .5", SHELL.format(of="both") + rim(14))
    + BALL.format(at="0 0 .56"),
    "hammock": flex("7 7 1", "0 0 .5", NET + '<pin id="0 6 42 48"/>', spacing=0.05)
    + BOX.format(at="0 0 .545"),
    "rope": flex("16 1 1", "0 0 .05", NET, spacing=0.03),
    "springy rope": flex("16 1 1", "0 0 .05", '<edge stiffness="500" damping=".05"/>'),
}


def engine_of(
    bodies: str, timestep: float = 0.002, integrator: str = "discrete", rest: str = ""
) -> tuple[dashpot.Engine, mujoco.MjData]:
    xml = SCENE.format(bodies=bodies, timestep=timestep, integrator=integrator, rest=rest)
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(xml))
    return engine, engine.make_data()


def mechanical(engine: dashpot.Engine, data: mujoco.MjData) -> float:
    energy = engine.energy(data)
    return energy.kinetic + energy.potential + energy.elastic


@pytest.mark.parametrize("scene", SCENES)
def test_no_energy_comes_from_nothing(scene):
    if IS_4 and scene in ("hammock", "rope", "springy rope"):
        pytest.skip("MuJoCo 4.0 has no stiffness or damping of flex edges under discrete")
    engine, data = engine_of(SCENES[scene])
    start = before = mechanical(engine, data)
    total, touching = engine.energy(data).total, 0
    for _ in range(120):
        touching = max(touching, engine.step(data).touching)
        energy = mechanical(engine, data)
        assert energy <= start * (1.0 + 2e-4)
        if "equality" not in SCENES[scene]:  # rows of edges swing, and give back what they took
            assert energy <= before + 1e-3 * start
        before = energy
    assert touching > 0
    # What falls is half a step late, and loses that of its fall where it lands.
    assert engine.energy(data).total == pytest.approx(total, abs=0.02 * start)


@pytest.mark.parametrize("integrator", ["implicitfast"])
@pytest.mark.parametrize("scene", ["hammock", "rope", "springy rope"])
def test_nor_with_the_integrators_that_flexes_without_elasticity_have(scene, integrator):
    engine, data = engine_of(SCENES[scene], 0.001, integrator)
    start = mechanical(engine, data)
    for _ in range(120):
        engine.step(data)
        assert mechanical(engine, data) <= start * (1.0 + 2e-4)


@pytest.mark.parametrize("young", [2e4, 5e5])
def test_a_soft_cube_gives_way_by_hookes_law(young):
    """A plate of 0.5 kg on 0.3 kg of 9 cm, on the floor and under the plate by its radius.

    Each layer bears what is above it. Friction keeps the ends from widening, and tetrahedra of a
    third of the side bend little: together they are stiffer than rods by a sixth, at any step.
    MuJoCo 4.0 no longer has twice Lame's first parameter. There the cube is between a rod, whose
    sides are free, and one that is confined, whose modulus is E (1 - nu) / ((1 + nu) (1 - 2 nu)).
    """
    confined = 1.3 * 0.4 / 0.7  # Poisson's ratio 0.3
    plate = """<body pos="0 0 .112"><joint type="slide" axis="0 0 1"/>
      <geom type="box" size=".1 .1 .01" mass=".5"/></body>"""
    pressure = (0.5 + 0.5 * 0.3) * GRAVITY / 0.09**2
    for timestep in (0.002, 0.005):
        engine, data = engine_of(cube("0 0 .05", young=young) + plate, timestep)
        engine.step(data, int(0.5 / timestep))
        sunk = 0.09 + 2 * 0.002 + 0.01 - data.xpos[-1][2]
        of_rod = 0.09 * pressure / young
        if IS_4:
            assert confined * of_rod - 4e-5 < sunk < of_rod + 4e-5
        else:
            assert sunk == pytest.approx(0.85 * of_rod, rel=0.06, abs=4e-5)
        contacts = engine.contacts(data)
        weight = contacts.force[contacts.geom[:, 0] == 0, 0].sum()
        assert weight == pytest.approx(0.8 * GRAVITY, rel=0.02)


@pytest.mark.parametrize("young", [2e4, 2e5])
def test_a_gripped_sponge_stays_in_the_hand(young):
    """Two fingers press with 20 N; friction of 1 bears 0.5 N with ease."""
    fingers = "".join(
        f"""<body pos="{side}.062 0 .2"><joint name="{name}" type="slide" axis="{axis} 0 0"/>
        <geom type="box" size=".01 .06 .06" mass=".2"/></body>"""
        for name, side, axis in (("left", "-", 1), ("right", "", -1))
    )
    sponge = flex("4 4 4", "0 0 .2", solid(young), spacing=0.02)
    sponge = sponge.replace('mass=".3"', 'mass=".05"')
    rest = """<actuator><position joint="left" kp="500" kv="10"/>
      <position joint="right" kp="500" kv="10"/></actuator>"""
    engine, data = engine_of(sponge + fingers, rest=rest)
    data.ctrl[:] = 0.05
    vertices = slice(1, 65)
    engine.step(data, 150)
    start = data.xipos[vertices, 2].mean()
    engine.step(data, 100)
    assert start > 0.19
    assert data.xipos[vertices, 2].mean() == pytest.approx(start, abs=5e-4)
