"""Closed kinematic loops, through and near configurations where the loop is straight."""

import itertools

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import dashpot

LINK, MASS, GRAVITY = 0.2, 0.3, 9.81
TIMESTEPS = (0.00044, 0.001, 0.002, 0.005)


def chain(span: float, *, joint: str, down: bool = False) -> str:
    """Return three links from the origin whose tip is connected `span` (m) along x, or downwards.

    Without `down` the links are hinged about y, so that gravity acts in their plane.
    """
    along = (0, 0, -1) if down else (1, 0, 0)
    step = " ".join(str(LINK * x) for x in along)
    bodies = ""
    for i in range(3):
        bodies += f"""<body name="link{i}" pos="{step if i else "0 0 0"}"><joint {joint}/>
          <geom type="capsule" fromto="0 0 0 {step}" size="0.01" mass="{MASS}" contype="0"
            conaffinity="0"/>"""
    end = " ".join(str(span * x) for x in along)
    return f"""<mujoco><worldbody><site name="end" pos="{end}"/>
      {bodies}<site name="tip" pos="{step}"/>{"</body>" * 3}</worldbody>
      <equality><connect site1="tip" site2="end"/></equality></mujoco>"""


def engine_of(
    xml: str, timestep: float, integrator: str | None = None
) -> tuple[dashpot.Engine, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.timestep = timestep
    if integrator:
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    engine = dashpot.Engine(model)
    return engine, engine.make_data()


@pytest.mark.parametrize(("kick", "down"), [(1e-3, False), (1.0, True)])
@pytest.mark.parametrize("joint", ['axis="0 1 0"', 'type="ball"'])
@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_straight_chain_gains_no_energy(joint, down, kick, timestep):
    """Exactly taut between its ends, a chain can only stretch; any energy gained is numerical."""
    engine, data = engine_of(chain(3 * LINK, joint=joint, down=down), timestep)
    data.qvel[:] = kick * np.random.default_rng(0).normal(size=engine.model.nv)
    start = engine.energy(data)
    # What can move turns over the kick and the weight on the sag of a taut rigid chain, of some
    # centimetres at the coarsest step.
    scale = start.kinetic + MASS * GRAVITY * LINK
    for _ in range(round(1.5 / timestep)):
        engine.step(data)
        energy = engine.energy(data)
        # Velocities at the end of a step lack the second half of the trapezoidal rule.
        assert energy.mechanical - start.mechanical <= 1e-4 * scale
        # Joints integrate to first order.
        assert energy.total == pytest.approx(start.total, abs=scale * timestep)
    # Recovery at 0.1 m/s keeps up with what frozen geometry loses.
    apart = np.linalg.norm(data.site("tip").xpos - data.site("end").xpos)
    assert apart < 0.1 * timestep + 1e-3


@pytest.mark.parametrize("timestep", [0.0005, 0.001])
def test_a_taut_chain_of_free_links_gains_no_energy(timestep):
    """Six links connected in a straight line between two walls, under their weight."""
    length, mass, count = 0.06, 0.008, 6
    bodies = equalities = ""
    for i in range(count):
        bodies += f"""<body name="l{i}" pos="{(i + 0.5) * length} 0 0"><freejoint/>
          <geom type="capsule" size=".005" fromto="-.025 0 0 .025 0 0" mass="{mass}"
            contype="0" conaffinity="0"/></body>"""
        on = f"l{i + 1}" if i < count - 1 else "world"
        equalities += f'<connect body1="l{i}" body2="{on}" anchor=".03 0 0"/>'
    engine, data = engine_of(
        f"""<mujoco><worldbody>{bodies}</worldbody><equality>{equalities}
          <connect body1="l0" body2="world" anchor="-.03 0 0"/></equality></mujoco>""",
        timestep,
    )
    start = engine.energy(data)
    for _ in range(round(1.5 / timestep)):
        engine.step(data)
        energy = engine.energy(data)
        # A hundredth of the weight times a link.
        assert energy.mechanical - start.mechanical <= 0.01 * count * mass * GRAVITY * length
        assert energy.total == pytest.approx(start.total, abs=1e-9)
    # It hangs together still, between the walls: neighbours touch by a hundredth of a link.
    ends = np.array([[1.0], [-1.0]]) * [[0.5 * length, 0.0, 0.0]]
    links = [data.body(f"l{i}") for i in range(count)]
    joints = [link.xpos + ends @ link.xmat.reshape(3, 3).T for link in links]
    np.testing.assert_allclose([j[1] for j in joints[1:]], [j[0] for j in joints[:-1]], atol=6e-4)
    np.testing.assert_allclose(joints[0][1], 0.0, atol=6e-4)
    np.testing.assert_allclose(joints[-1][0], [count * length, 0.0, 0.0], atol=6e-4)


class FourBar:
    """Three equal links between two pins `span` apart: one degree of freedom, solved to 1e-10."""

    def __init__(self, span: float) -> None:
        self.span = span
        # Capsules about their middle, as MuJoCo computes them.
        model = mujoco.MjModel.from_xml_string(chain(span, joint='axis="0 1 0"'))
        self.inertia = model.body_inertia[model.body("link0").id].max()

    def angles(self, first: float) -> np.ndarray:
        """Absolute angles (3,) below the horizontal, elbows down, from the first."""
        elbow = LINK * np.array([np.cos(first), np.sin(first)])
        reach = np.array([self.span, 0.0]) - elbow
        distance = np.hypot(*reach)
        bend = np.arccos(0.5 * distance / LINK)
        direction = np.arctan2(reach[1], reach[0])
        return np.array([first, direction + bend, direction - bend])

    def energies(self, first: float) -> tuple[float, float]:
        """Apparent inertia (kg m^2) and potential energy (J) as functions of the first angle."""
        step = 1e-6
        slopes = (self.angles(first + step) - self.angles(first - step)) / (2 * step)
        angles = self.angles(first)
        along = LINK * np.column_stack([-np.sin(angles), np.cos(angles)]) * slopes[:, None]
        middles = np.cumsum(along, axis=0) - 0.5 * along
        inertia = MASS * (middles**2).sum() + self.inertia * (slopes**2).sum()
        depths = LINK * np.sin(angles)
        return inertia, -MASS * GRAVITY * (np.cumsum(depths) - 0.5 * depths).sum()

    def at(self, first: float, time: float) -> float:
        """First angle at `time` (s), released at rest from `first`."""
        start = self.energies(first)[1]

        def rate(_: float, state: np.ndarray) -> list[float]:
            step = 1e-5
            inertia, _ = self.energies(state[0])
            (i0, v0), (i1, v1) = self.energies(state[0] - step), self.energies(state[0] + step)
            slope = (i1 - i0) / (2 * step)
            force = -(v1 - v0) / (2 * step)
            return [state[1], (force - 0.5 * slope * state[1] ** 2) / inertia]

        solution = solve_ivp(rate, (0, time), [first, 0.0], rtol=1e-9, atol=1e-9)
        angle, speed = solution.y[:, -1]
        inertia, potential = self.energies(angle)
        assert 0.5 * inertia * speed**2 + potential == pytest.approx(start, abs=1e-6)
        return float(angle)


@pytest.mark.parametrize(
    ("span", "timestep", "integrator"),
    [
        (0.4, 0.002, "Euler"),
        (0.55, 0.002, "Euler"),
        (0.59, 0.001, "Euler"),
        (0.59, 0.002, "Euler"),
        (0.59, 0.002, "implicit"),
    ],
)
def test_a_four_bar_swings_as_its_one_degree_of_freedom(span, timestep, integrator):
    """Links of 3 x 0.2 m; at a span of 0.59 m the loop is never far from straight."""
    bar = FourBar(span)
    # At rest the middle link is horizontal; released off that.
    rest = np.arccos(0.5 * (span / LINK - 1))
    first = 0.8 * rest
    engine, data = engine_of(chain(span, joint='axis="0 1 0"'), timestep, integrator)
    angles = bar.angles(first)
    data.qpos[:] = np.diff(angles, prepend=0.0)
    engine.step(data, nstep=round(0.6 / timestep))
    # Second order in the step: some 10 rad of phase with accelerations of 1e3 rad/s^2.
    assert data.qpos[0] == pytest.approx(bar.at(first, 0.6), abs=200.0 * timestep**2)


def swung_rod_error(timestep: float) -> float:
    """Return the error (rad) after 1 s of a free rod connected at one end: a compound pendulum."""
    arm, speed = 0.15, 5.0
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}"/><worldbody>
        <body name="rod" pos="0 0 1"><freejoint/>
          <geom type="capsule" size="0.02 {arm}" mass="1"/></body></worldbody>
        <equality><connect body1="rod" anchor="0 0 {arm}"/></equality></mujoco>"""
    )
    pendulum = -GRAVITY * arm / (model.body_inertia[1].max() + arm**2)
    exact = solve_ivp(
        lambda _, y: [y[1], pendulum * np.sin(y[0])], (0, 1), [0, speed], rtol=1e-10, atol=1e-10
    ).y[0, -1]
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qvel[:] = (-arm * speed, 0.0, 0.0, 0.0, speed, 0.0)
    engine.step(data, nstep=round(1 / timestep))
    w, _, y, _ = data.qpos[3:]
    return float(abs(2 * np.arctan2(y, w) - exact))


def test_a_connected_rod_swings_to_second_order():
    errors = [swung_rod_error(timestep) for timestep in (0.004, 0.002, 0.001)]
    assert errors[-1] < 2e-4
    for coarse, fine in itertools.pairwise(errors):
        assert coarse / fine == pytest.approx(4.0, rel=0.15)


def top_error(timestep: float, time: float = 1.0) -> float:
    """Return by how much (1) the axis of a top in steady precession is off after `time` (s)."""
    arm, tilt, spin = 0.05, 0.5, 40.0
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}"/><worldbody>
        <body name="top" pos="0 0 1"><freejoint/>
          <geom type="cylinder" size="0.1 0.01" pos="0 0 {arm}" mass="1"/></body></worldbody>
        <equality><connect body1="top" anchor="0 0 0"/></equality></mujoco>"""
    )
    inertia = np.sort(model.body_inertia[1])
    across, axial = inertia[0] + arm**2, inertia[2]
    # m g l = Omega (I3 w3 - I1 Omega cos(tilt)), Goldstein, Classical Mechanics, 5.7.
    precession = np.roots([across * np.cos(tilt), -axial * spin, GRAVITY * arm]).min()
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qpos[3:] = (np.cos(tilt / 2), 0.0, np.sin(tilt / 2), 0.0)
    # The vertical in the frame of the top is (-sin, 0, cos) of the tilt.
    data.qvel[3:] = (-precession * np.sin(tilt), 0.0, spin)
    engine.step(data, nstep=round(time / timestep))
    axis = np.empty(9)
    mujoco.mju_quat2Mat(axis, data.qpos[3:])
    turned = precession * time
    exact = (np.sin(tilt) * np.cos(turned), np.sin(tilt) * np.sin(turned), np.cos(tilt))
    return float(np.linalg.norm(axis[2::3] - exact))


def test_a_connected_top_precesses_to_second_order():
    errors = [top_error(timestep) for timestep in (0.002, 0.001, 0.0005)]
    assert errors[-1] < 3e-5
    for coarse, fine in itertools.pairwise(errors):
        assert coarse / fine == pytest.approx(4.0, rel=0.2)


LINK_GEOM = 'type="capsule" size="0.02" mass="1"'
BALL_LINK = f"""<body name="p" pos="0 0 1"><joint type="ball"/>
  <geom {LINK_GEOM} fromto="0 0 0 0.2 0 -0.1"/><site name="p" pos="0.2 0 -0.1"/></body>"""
FREE_BOX = """<body name="box" pos="0.35 0 0.9"><freejoint/>
  <geom type="box" size="0.15 0.06 0.03" mass="1"/><site name="box" pos="-0.15 0 0"/></body>"""
FREE_ROD = """<body name="rod{}" pos="0 0 {}"><freejoint/>
  <geom type="capsule" size="0.03 0.15" mass="1"/></body>"""


def hinged_link(name: str, y: float) -> str:
    return f"""<body pos="0 {y} 1"><joint name="{name}" axis="0 1 0"/>
      <geom {LINK_GEOM} fromto="0 0 0 0 0 -0.2"/></body>"""


TWO_LINKS = hinged_link("a", 0.0) + hinged_link("b", 1.0)
MECHANISMS = {
    "gear": (TWO_LINKS, '<joint joint1="a" joint2="b" polycoef="0 2 0 0 0"/>', (4.0, 2.0)),
    "cam": (TWO_LINKS, '<joint joint1="a" joint2="b" polycoef="0 1 .5 .3 .1"/>', (3.0, 3.0)),
    "weld": (BALL_LINK + FREE_BOX, '<weld body1="p" body2="box"/>', (1.0, 2.0, 1.0)),
    "weld at an anchor": (
        BALL_LINK + FREE_BOX,
        '<weld body1="box" body2="p" anchor="0.1 0 0.1" torquescale="2"/>',
        (1.0, 2.0, 1.0),
    ),
    "welded sites": (BALL_LINK + FREE_BOX, '<weld site1="p" site2="box"/>', (1.0, 2.0, 1.0)),
    "connected sites": (BALL_LINK + FREE_BOX, '<connect site1="p" site2="box"/>', (1.0, 2.0, 1.0)),
    "spinning box": (
        """<body name="box" pos="0 0 1"><freejoint/>
        <geom type="box" size="0.03 0.06 0.15" mass="1"/></body>""",
        '<connect body1="box" anchor="0.03 0.05 0.15"/>',
        (-0.45, 0.1, 0.05, 1.0, 3.0, 8.0),
    ),
    "rods in a row": (
        FREE_ROD.format(1, 1.0) + FREE_ROD.format(2, 0.7),
        """<connect body1="rod1" anchor="0 0 0.15"/>
        <connect body1="rod1" body2="rod2" anchor="0 0 -0.15"/>""",
        (-0.45, 0.0, 0.0, 0.0, 3.0, 0.0, -0.9, 0.0, 0.0, 0.0, 0.0, 2.0),
    ),
}


@pytest.mark.parametrize("integrator", ["Euler", "implicit"])
@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_mechanisms_that_equalities_hold_keep_their_energy(mechanism, integrator):
    bodies, equalities, velocity = MECHANISMS[mechanism]
    engine, data = engine_of(
        f"""<mujoco><option integrator="{integrator}"><flag contact="disable"/></option>
        <worldbody>{bodies}</worldbody><equality>{equalities}</equality></mujoco>""",
        0.001,
    )
    data.qvel[: len(velocity)] = velocity
    # The first steps end the velocities that the equalities do not allow.
    engine.step(data, nstep=100)
    start = engine.energy(data)
    peak, probe = start.kinetic, mujoco.MjData(engine.model)
    for _ in range(50):
        engine.step(data, nstep=100)
        energy = engine.energy(data)
        peak = max(peak, energy.kinetic)
        probe.qpos[:] = data.qpos
        mujoco.mj_forward(engine.model, probe)
        # m or rad: without its equality a mechanism keeps its energy too, but not its shape.
        assert np.abs(probe.efc_pos[: probe.ne]).max() < 1e-4
    assert probe.ne > 0
    assert peak > 0.1
    # Accelerations from the start of each step would add 1 % to 20 % in these 5 s.
    assert energy.mechanical == pytest.approx(start.mechanical, abs=1e-3 * peak)
    assert energy.total == pytest.approx(start.total, abs=1e-4 * peak)
