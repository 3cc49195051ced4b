"""Springs and servos that are fast for the step, on what contacts, limits and equalities hold."""

import mujoco
import numpy as np
import pytest

import dashpot

STIFFNESS, SPEED, DT = 1000.0, 1.0, 0.002  # N/m, m/s, s
HELD_BY = {
    "limit": ('range="0 1"', "", ""),
    "joint equality": ("", '<equality><joint joint1="up"/></equality>', ""),
    "weld": ("", '<equality><weld body1="carrier"/></equality>', ""),
    "contact": ("", "", '<geom type="plane" size="1 1 .1" pos="0 0 -.02"/>'),
}


def carried(held_by: str, servo: bool, mass: float, integrator: str) -> dashpot.Engine:
    """Make a mass that swings sideways on a carrier that rests; nothing couples the two."""
    limit, equality, floor = HELD_BY[held_by]
    drive = f'<actuator><position joint="along" kp="{STIFFNESS}"/></actuator>' if servo else ""
    spring = "" if servo else f'stiffness="{STIFFNESS}"'
    xml = f"""<mujoco><option timestep="{DT}" integrator="{integrator}"/><worldbody>{floor}
      <body name="carrier"><joint name="up" type="slide" axis="0 0 1" {limit}/>
        <geom type="box" size=".02 .02 .02" mass=".1"/>
        <body pos="0 0 -.1"><joint name="along" type="slide" axis="1 0 0" {spring}/>
          <geom size=".01" mass="{mass}" contype="0" conaffinity="0"/></body></body>
    </worldbody>{equality}{drive}</mujoco>"""
    return dashpot.Engine(mujoco.MjModel.from_xml_string(xml))


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("turn", [0.1, 1.2])
@pytest.mark.parametrize("servo", [False, True], ids=["spring", "servo"])
@pytest.mark.parametrize("held_by", HELD_BY)
def test_an_undamped_oscillation_keeps_its_amplitude(held_by, servo, turn, integrator):
    """Servos are held: velocity Verlet keeps v^2 + omega^2 x^2 (1 - (omega H)^2 / 4).

    Springs act along in micro-steps of H / 13 at most, in which that is 0.1 % of the exact motion.
    """
    omega = turn / DT
    engine = carried(held_by, servo, STIFFNESS / omega**2, integrator)
    data = engine.make_data()
    data.qvel[1] = SPEED
    engine.step(data, nstep=4000)
    most = 0.0
    for _ in range(200):
        engine.step(data)
        most = max(most, abs(data.qpos[1]))
        # What holds the carrier bears the weight; free, the mass would swing as far.
        assert abs(data.qpos[0]) < 1e-5
    assert data.qfrc_constraint[0] == pytest.approx(9.81 * engine.model.body_mass.sum(), rel=1e-6)
    largest = SPEED / omega / np.sqrt(1.0 - turn**2 / 4.0 if servo else 1.0)
    # Samples miss the turning point by at most turn / 2 of the phase. The first step, which nothing
    # is known before, and steps in which a jump of the drive cannot be told from its motion, give
    # or take a little.
    assert np.cos(turn / 2.0) * 0.98 < most / largest < 1.02


@pytest.mark.parametrize("turn", [0.3, 0.6, 0.9, 1.2])
@pytest.mark.parametrize("held_by", ["limit", "weld", "contact"])
def test_a_taut_chain_stays_as_calm_as_it_was(held_by, turn):
    """Light links under a heavy end: a slow swing does not feed their fast vibration."""
    limit, equality, floor = HELD_BY[held_by]
    links = 5
    chain = "".join(
        f"""<body pos="0 0 {-0.02 if i == 0 else -0.1}"><joint axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.1" size=".005" mass=".02"
              contype="0" conaffinity="0"/>"""
        for i in range(links)
    )
    xml = f"""<mujoco><worldbody>{floor}
      <body name="carrier"><joint name="up" type="slide" axis="0 0 1" {limit}/>
        <geom type="box" size=".02 .02 .02" mass=".1"/>{chain}
        <geom pos="0 0 -.1" size=".03" mass="2" contype="0" conaffinity="0"/>
      {"</body>" * links}</body></worldbody>{equality}</mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    stiffness = np.zeros((links, links))
    for i in range(links):
        for sign in (1.0, -1.0):
            data.qpos[:] = 0.0
            data.qpos[1 + i] = sign * 1e-6
            data.qvel[:] = 0.0
            mujoco.mj_forward(model, data)
            stiffness[:, i] += sign * data.qfrc_bias[1:] / 2e-6
    fastest = np.sqrt(np.linalg.eigvals(np.linalg.solve(inertia[1:, 1:], stiffness)).real.max())
    model.opt.timestep = turn / fastest
    engine = dashpot.Engine(model)
    data = engine.make_data()
    data.qvel[1:] = 0.1 * np.array([1.0, -2.0, 2.0, -2.0, 2.0])
    fastest_turn = []
    for _ in range(2):
        speeds = []
        for _ in range(round(1.0 / model.opt.timestep)):
            engine.step(data)
            speeds.append(np.abs(data.qvel[1:]).max())
            assert abs(data.qpos[0]) < 1e-5  # held, so that the chain is taut
        fastest_turn.append(max(speeds))
    # Maxima over a second each, in which five modes come together by chance. What is fed by the
    # slow swing grows without bound.
    assert fastest_turn[1] < 1.3 * fastest_turn[0]
