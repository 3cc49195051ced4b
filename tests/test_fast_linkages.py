"""Linkages that turn far in a step: energy, place and parts of steps."""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import dashpot

CRANK, ROD, BLOCK_MASS = 0.2, 0.4, 2.0
TIMESTEPS = (0.001, 0.002, 0.005, 0.01)


def slider_crank(timestep: float) -> tuple[dashpot.Engine, mujoco.MjData]:
    """Return a crank about y that moves a block along x by a rod, without gravity."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}" gravity="0 0 0"/>
        <default><geom type="box" contype="0" conaffinity="0"/></default><worldbody>
        <body name="crank"><joint name="crank" axis="0 -1 0"/>
          <geom size="{CRANK / 2} .02 .02" pos="{CRANK / 2} 0 0" mass="1"/>
          <body name="rod" pos="{CRANK} 0 0"><joint name="rod" axis="0 -1 0"/>
            <geom size="{ROD / 2} .01 .01" pos="{ROD / 2} 0 0" mass=".5"/></body></body>
        <body name="block" pos="{CRANK + ROD} 0 0"><joint name="block" type="slide" axis="1 0 0"/>
          <geom size=".05 .05 .05" mass="{BLOCK_MASS}"/></body></worldbody>
        <equality><connect body1="block" body2="rod" anchor="0 0 0"/></equality></mujoco>"""
    )
    engine = dashpot.Engine(model)
    return engine, engine.make_data()


def pose(angle: float) -> np.ndarray:
    """Return crank angle, angle of the rod to the crank, way of the block, at a crank angle."""
    rod = -np.arcsin(CRANK / ROD * np.sin(angle))
    way = CRANK * np.cos(angle) + ROD * np.cos(rod) - CRANK - ROD
    return np.array([angle, rod - angle, way])


def slopes(angle: float) -> np.ndarray:
    step = 1e-6
    return (pose(angle + step) - pose(angle - step)) / (2 * step)


def inertia(engine: dashpot.Engine, angle: float) -> float:
    """Return the apparent inertia (kg m^2) of the crank."""
    data = mujoco.MjData(engine.model)
    data.qpos[:] = pose(angle)
    mujoco.mj_forward(engine.model, data)
    along = slopes(angle)
    momentum = np.empty(3)
    mujoco.mj_mulM(engine.model, data, momentum, along)
    return float(along @ momentum)


def start(engine: dashpot.Engine, data: mujoco.MjData, angle: float, speed: float) -> None:
    data.qpos[:] = pose(angle)
    data.qvel[:] = speed * slopes(angle)


@pytest.mark.parametrize("speed", [10.0, 30.0])
@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_crank_keeps_its_energy_through_its_dead_centres(timestep, speed):
    engine, data = slider_crank(timestep)
    start(engine, data, 0.5, speed)
    first = engine.energy(data).kinetic
    engine.step(data, nstep=round(5 / timestep))
    turns = (data.qpos[0] - 0.5) / (2 * np.pi)
    assert turns > 4
    # Near a dead centre the crank goes three times as fast as between: steps are taken in parts in
    # which it turns by 0.1 rad. At each of two a turn energy may be off by half the square of that,
    # and 0.4 of it in the rest of the turn. With rows that stood still it lost 2 to 20 % a turn.
    angle = min(3 * speed * timestep, 0.1)
    assert engine.energy(data).kinetic > (1 - 1.4 * angle**2 * turns) * first
    assert engine.energy(data).kinetic < 1.001 * first


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_crank_turns_as_its_one_degree_of_freedom(timestep):
    engine, data = slider_crank(timestep)
    start(engine, data, 0.5, 10.0)
    first = engine.energy(data).kinetic
    exact = solve_ivp(
        lambda _, y: np.sqrt(2 * first / np.array([inertia(engine, y[0])])),
        (0, 1),
        [0.5],
        rtol=1e-8,
    ).y[0, -1]
    engine.step(data, nstep=round(1 / timestep))
    # To second order in what rows turn by in a part, 0.1 rad at most: a sixth of its square.
    angle = min(3 * 10.0 * timestep, 0.1)
    assert data.qpos[0] - 0.5 == pytest.approx(exact - 0.5, rel=angle**2 / 6)


@pytest.mark.parametrize("timestep", TIMESTEPS)
def test_a_fast_cam_keeps_its_energy(timestep):
    """Two hinges coupled by a polynomial: the row turns with the square of the speed."""
    link = '<geom type="box" size=".1 .02 .02" pos=".1 0 0" mass="1"/>'
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}" gravity="0 0 0"/>
        <default><geom contype="0" conaffinity="0"/></default><worldbody>
        <body><joint name="a" axis="0 1 0"/>{link}</body>
        <body pos="0 1 0"><joint name="b" axis="0 1 0"/>{link}</body></worldbody><equality>
        <joint joint1="b" joint2="a" polycoef="0 .3 .5 .2 -.1"/></equality></mujoco>"""
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qvel[:] = 10.0, 3.0
    first = engine.energy(data).kinetic
    parts = [engine.step(data).parts for _ in range(round(5 / timestep))]
    # With rows that stood still where they turn fast it lost 20 to 38 % at 5 and 10 ms.
    assert engine.energy(data).mechanical == pytest.approx(first, rel=0.015)
    # It turns fast at a few places only.
    assert np.mean(parts) < 1.2
    assert (max(parts) > 1) == (timestep > 0.002)


def test_a_slow_linkage_steps_whole():
    engine, data = slider_crank(0.002)
    start(engine, data, 0.5, 2.0)
    assert all(engine.step(data).parts == 1 for _ in range(1000))


def test_a_linkage_that_turns_far_is_stepped_in_parts_of_one_time():
    engine, data = slider_crank(0.01)
    start(engine, data, 0.2, 30.0)
    assert engine.step(data).parts > 1
    assert data.time == 0.01
    assert engine.model.opt.timestep == 0.01


RAILS = {
    "along": '<joint type="slide" axis="1 0 0"/>',
    "across": '<joint type="slide" axis="0 1 0"/>',
    "askew": '<joint type="slide" axis="1 1 1"/>',
    "gantry": '<joint type="slide" axis="0 0 1"/><joint type="slide" axis="1 0 0"/>',
    "none": "<freejoint/>",
}


def crank_on_carriage(timestep: float, rails: str) -> tuple[dashpot.Engine, mujoco.MjData]:
    """Return the same crank on a carriage of 5 kg, turning at 15 rad/s."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}" gravity="0 0 0"/>
        <default><geom type="box" contype="0" conaffinity="0"/></default><worldbody>
        <body name="carriage">{RAILS[rails]}<geom size=".3 .05 .05" pos=".3 0 0" mass="5"/>
        <body name="crank"><joint name="crank" axis="0 -1 0"/>
          <geom size="{CRANK / 2} .02 .02" pos="{CRANK / 2} 0 0" mass="1"/>
          <body name="rod" pos="{CRANK} 0 0"><joint name="rod" axis="0 -1 0"/>
            <geom size="{ROD / 2} .01 .01" pos="{ROD / 2} 0 0" mass=".5"/></body></body>
        <body name="block" pos="{CRANK + ROD} 0 0"><joint name="block" type="slide" axis="1 0 0"/>
          <geom size=".05 .05 .05" mass="{BLOCK_MASS}"/></body></body></worldbody>
        <equality><connect body1="block" body2="rod" anchor="0 0 0"/></equality></mujoco>"""
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qpos[-3:] = pose(0.5)
    data.qvel[-3:] = 15.0 * slopes(0.5)
    engine.step(data, nstep=2)
    return engine, data


@pytest.mark.parametrize("timestep", [0.001, 0.002])
def test_a_floating_crank_keeps_energy_and_momentum_through_its_dead_centres(timestep):
    """Nothing holds the frame. Where rows stood still at dead centres it lost 2 to 4 % a turn."""
    engine, data = crank_on_carriage(timestep, "none")
    first = engine.energy(data).kinetic
    velocities = []
    for _ in range(round(3 / timestep)):
        engine.step(data)
        mujoco.mj_subtreeVel(engine.model, data)
        velocities.append(data.subtree_linvel[0].copy())
    turns = (data.qpos[7] - 0.5) / (2 * np.pi)
    assert turns > 4
    energies = engine.energy(data).kinetic / first
    # The third order of a step that turns by up to 0.09 rad, at two dead centres a turn.
    assert 1.001 > energies > 1 - 0.003 * turns
    # The momentum of 8.5 kg, beside that of the parts that circle at some m/s.
    assert np.ptp(velocities, axis=0).max() < 0.02


def test_a_linkage_takes_the_same_steps_however_it_lies_in_the_world():
    """Rounding of a row across its plane cut slow steps in up to 20 parts near change points."""
    links = (0.5, 0.2, 0.5, 0.2)
    for euler in ("0 0 0", "0 0 90", "90 90 0"):
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><option timestep="0.002" gravity="0 0 0"/>
            <default><geom contype="0" conaffinity="0" type="capsule" size=".01"/></default>
            <worldbody><body euler="{euler}">
            <body name="a"><joint axis="0 1 0"/><geom fromto="0 0 0 0 0 {links[1]}" mass="1"/>
              <body name="b" pos="0 0 {links[1]}"><joint axis="0 1 0"/>
                <geom fromto="0 0 0 {links[2]} 0 0" mass="1"/>
                <body name="c" pos="{links[2]} 0 0"><joint axis="0 1 0"/>
                  <geom fromto="0 0 0 0 0 -{links[3]}" mass="1"/></body></body></body>
            <site name="end" pos="{links[0]} 0 0"/></body></worldbody>
            <equality><connect site1="end" site2="tip"/></equality></mujoco>""".replace(
                'mass="1"/></body></body></body>',
                f'mass="1"/><site name="tip" pos="0 0 -{links[3]}"/></body></body></body>',
            )
        )
        engine = dashpot.Engine(model)
        data = engine.make_data()
        data.qvel[:] = 1.0, -1.0, 1.0
        assert max(engine.step(data).parts for _ in range(3500)) == 1


def energy_beside_translation(engine: dashpot.Engine, data: mujoco.MjData) -> float:
    """Return the kinetic energy (J) without that of the centre of mass along the first joint."""
    mujoco.mj_subtreeVel(engine.model, data)
    velocity, mass = data.subtree_linvel[0], engine.model.body_subtreemass[0]
    if engine.model.jnt_type[0] == mujoco.mjtJoint.mjJNT_SLIDE:
        axes = engine.model.jnt_axis[[j for j in range(2) if engine.model.jnt_bodyid[j] == 1]]
        velocity = axes @ velocity / np.linalg.norm(axes, axis=1)
    return engine.energy(data).kinetic - 0.5 * mass * velocity @ velocity


@pytest.mark.parametrize("rails", RAILS)
@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_a_crank_on_a_carriage_turns_alike_however_fast_that_goes(timestep, rails):
    parts, energies = [], []
    for speed in (0.0, 5.0):
        engine, data = crank_on_carriage(timestep, rails)
        data.qvel[0] += speed
        mujoco.mj_forward(engine.model, data)
        first = energy_beside_translation(engine, data)
        parts.append(sum(engine.step(data).parts for _ in range(round(1 / timestep))))
        energies.append(energy_beside_translation(engine, data) / first)
    # By the energy of all, the crank turned slowly: whole steps were taken, where 14 % were lost.
    # At 45 rad/s near a dead centre, more than 0.1 rad in 5 ms.
    assert timestep < 0.005 or min(parts) > 1.1 / timestep
    assert parts[1] == pytest.approx(parts[0], rel=0.02)
    # The momentum, of 42 kg m/s, is right to second order in a turn of 0.1 rad, and with it what is
    # left to the crank, 5 J of 110.
    assert energies[1] == pytest.approx(energies[0], abs=0.08 if timestep == 0.005 else 0.017)


@pytest.mark.parametrize("timestep", [0.005, 0.01])
def test_what_brakes_a_crank_at_a_dead_centre_leaves_its_carriage_alone(timestep):
    engine, data = crank_on_carriage(timestep, "across")
    data.qvel[0] += 5.0
    mujoco.mj_forward(engine.model, data)
    first, start = energy_beside_translation(engine, data), data.qpos[1]
    velocities = []
    for _ in range(round(3 / timestep)):
        engine.step(data)
        velocities.append(data.qvel[0])
    turns = (data.qpos[1] - start) / (2 * np.pi)
    # Half the square of the 0.1 rad that rows turn by in a part, at two dead centres a turn, and
    # a quarter of it in the rest. Where nothing brakes or pushes, 1.4 and 2.1 % are lost a turn.
    assert 1.005 > energy_beside_translation(engine, data) / first > 1 - 0.0125 * turns
    # Nothing acts along this rail. Braked as a whole, the carriage lost 0.015 m/s in a second.
    assert np.ptp(velocities) < 1e-12
