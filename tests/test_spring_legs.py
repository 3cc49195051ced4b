"""A body on a light foot that the ground holds moves as on a spring whose end is fixed."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import dashpot

GRAVITY = 9.81
BODY, STIFFNESS, AMPLITUDE = 5.0, 5000.0, 0.008  # kg, N/m, m
FREQUENCY = np.sqrt(STIFFNESS / BODY)  # rad/s
INTEGRATORS = ["Euler", "implicitfast", "implicit"]

# The foot is held by the floor, by the limit of its joint, or by friction along the floor, which
# bears at most 51 N of the spring's 40 N.
LEGS = {
    "floor": """<body><joint name="body" type="slide" axis="0 0 1"/><geom size=".1" mass="{body}"/>
      <body pos="0 0 -.5"><joint name="spring" type="slide" axis="0 0 1" stiffness="{stiffness}"/>
        <geom name="foot" size=".03" mass="{foot}" contype="1"/></body></body>
      <geom type="plane" size="1 1 1" pos="0 0 -.53" conaffinity="1"/>""",
    "limit": """<body><joint type="slide" axis="0 0 1" range="0 1" limited="true"/>
      <geom size=".03" mass="{foot}"/>
      <body pos="0 0 .5"><joint name="spring" type="slide" axis="0 0 1" stiffness="{stiffness}"/>
        <geom size=".1" mass="{body}"/></body></body>""",
    "friction": """<body><joint type="slide" axis="0 0 1"/><joint type="slide" axis="1 0 0"/>
      <geom name="foot" size=".03" mass="{foot}" contype="1"/>
      <body pos="0 0 .5"><joint name="spring" type="slide" axis="1 0 0" stiffness="{stiffness}"/>
        <geom size=".1" mass="{body}"/></body></body>
      <geom type="plane" size="1 1 1" pos="0 0 -.03" conaffinity="1"/>""",
}


def leg(
    held_by: str, foot: float, integrator: str, timestep: float
) -> tuple[dashpot.Engine, mujoco.MjData]:
    """Return a leg whose spring is AMPLITUDE longer than where it rests."""
    bodies = LEGS[held_by].format(body=BODY, foot=foot, stiffness=STIFFNESS)
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 {-GRAVITY}" integrator="{integrator}" cone="elliptic"
        timestep="{timestep}"/><default><geom contype="0" conaffinity="0" friction="1"/></default>
        <worldbody>{bodies}</worldbody></mujoco>"""
    )
    engine = dashpot.Engine(model)
    data = engine.make_data()
    sag = BODY * GRAVITY / STIFFNESS
    if held_by == "floor":
        data.joint("body").qpos[0] = AMPLITUDE - sag
        data.joint("spring").qpos[0] = sag - AMPLITUDE
    else:
        data.joint("spring").qpos[0] = AMPLITUDE - (sag if held_by == "limit" else 0.0)
    return engine, data


def swing(
    engine: dashpot.Engine, data: mujoco.MjData, duration: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return times and deformations of the spring from its mean one, m."""
    times, lengths = [], []
    for _ in range(round(duration / engine.model.opt.timestep)):
        engine.step(data)
        times.append(data.time)
        lengths.append(data.joint("spring").qpos[0])
    return np.array(times), np.array(lengths) - 0.5 * (max(lengths) + min(lengths))


def fit(times: np.ndarray, lengths: np.ndarray) -> tuple[float, float]:
    """Return amplitude (m) and frequency (rad/s) of the swing at its end, over four periods."""
    late = times > times[-1] - 4 * 2 * np.pi / FREQUENCY
    best = (np.inf, 0.0, 0.0)
    for frequency in FREQUENCY * np.linspace(0.97, 1.03, 241):
        phase = frequency * times[late]
        basis = np.stack([np.cos(phase), np.sin(phase), np.ones_like(phase)], axis=1)
        weights, *_ = np.linalg.lstsq(basis, lengths[late], rcond=None)
        misfit = np.linalg.norm(basis @ weights - lengths[late])
        best = min(best, (float(misfit), float(np.hypot(*weights[:2])), float(frequency)))
    return best[1:]


@pytest.mark.parametrize(("timestep", "loss"), [(0.002, 0.005), (0.005, 0.015)])
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("held_by", LEGS)
def test_a_body_bobs_on_its_spring_without_gain_or_loss(held_by, integrator, timestep, loss):
    """The frequency of a chain with one end held is sqrt(k / m), whatever its foot weighs.

    What a rigid contact gives way under each change of load, it dissipates: 1 % of the amplitude in
    these 25 periods at 5 ms. The trapezoidal rule, scaled for its energy, is early by some
    (omega H)^2 / 8, 0.3 % there.
    """
    engine, data = leg(held_by, 0.2, integrator, timestep)
    amplitude, frequency = fit(*swing(engine, data, 5.0))
    assert (1 - loss) * AMPLITUDE < amplitude < 1.002 * AMPLITUDE
    assert frequency == pytest.approx(FREQUENCY, rel=5e-3)


@pytest.mark.parametrize(("timestep", "most"), [(0.001, 5e-4), (0.002, 2e-3), (0.005, 1e-2)])
@pytest.mark.parametrize("held_by", LEGS)
def test_the_ledger_of_a_spring_leg_closes(held_by, timestep, most):
    """In parts of the energy of the swing, to second order in the time step."""
    engine, data = leg(held_by, 0.2, "Euler", timestep)
    start = engine.energy(data).total
    engine.step(data, nstep=round(5.0 / timestep))
    energy = 0.5 * STIFFNESS * AMPLITUDE**2
    assert engine.energy(data).total == pytest.approx(start, abs=most * energy)


@pytest.mark.parametrize(
    ("timestep", "loss"),
    [(0.002, 0.02), (0.005, 0.1), (0.01, 0.2)],
)
def test_a_foot_of_a_few_grams_gives_its_body_no_energy(timestep, loss):
    """By itself it would swing on the spring at 500 rad/s, which no such step resolves.

    The lighter it is, the more its contact gives way, up to 15 % of the amplitude at 10 ms.
    """
    engine, data = leg("floor", 0.02, "Euler", timestep)
    amplitude, _ = fit(*swing(engine, data, 5.0))
    assert (1 - loss) * AMPLITUDE < amplitude < 1.002 * AMPLITUDE


@pytest.mark.parametrize(("foot", "timestep"), [(0.02, 0.001), (0.02, 0.002), (0.2, 0.005)])
@pytest.mark.parametrize("held_by", LEGS)
def test_the_damper_of_a_leg_takes_from_its_swing_what_it_takes_with_one_end_held(
    held_by, foot, timestep
):
    """The swing falls at the rate zeta omega, whatever its foot weighs."""
    engine, data = leg(held_by, foot, "Euler", timestep)
    rate = 0.02 * FREQUENCY
    engine.model.dof_damping[engine.model.joint("spring").dofadr] = 2 * BODY * rate
    period = 2 * np.pi / FREQUENCY
    times, lengths = swing(engine, data, 10 * period)
    late = round(8 * period / timestep)
    first, last = (np.ptp(part) for part in (lengths[: len(lengths) - late], lengths[late:]))
    found = np.log(first / last) / (times[late] - times[0])
    # The contact takes a hundredth of it by giving way, see above.
    assert found == pytest.approx(rate, rel=0.02)


def apex_of_hopper(foot: float, height: float) -> float:
    """Return how high the body rises again, m above where its relaxed leg touches the floor.

    The foot stops where it lands and leaves where the spring pulls it up.
    """
    time, z, y, vz, vy = 2e-5, height, height, 0.0, 0.0
    stands = left = False
    while True:
        force = STIFFNESS * (y - z)
        pull = -force / foot - GRAVITY
        if stands and pull > 0.0:
            stands, left = False, True
        step = time * (force / BODY - GRAVITY)
        if left and vz > 0.0 >= vz + step:
            return z
        vz += step
        vy = 0.0 if stands else vy + time * pull
        z += time * vz
        y += time * vy
        if y < 0.0 and not left:
            y, vy, stands = 0.0, 0.0, True


@pytest.mark.parametrize("height", [0.03, 0.06])
@pytest.mark.parametrize(("timestep", "error"), [(0.002, 0.003), (0.005, 0.02)])
def test_a_hopper_rises_as_high_as_its_foot_lets_it(timestep, error, height):
    """When in a step it lands and leaves is chance, so that its apex is off by some."""
    engine, data = leg("floor", 0.2, "Euler", timestep)
    data.qpos[:] = height, 0.0
    heights = []
    for _ in range(round(0.5 / timestep)):
        engine.step(data)
        heights.append(data.qpos[0])
    lowest = int(np.argmin(heights[: round(0.35 / timestep)]))
    apex, expected = max(heights[lowest:]), apex_of_hopper(0.2, height)
    assert apex < height
    assert apex == pytest.approx(expected, abs=error * height)


SERVO_LEG = """<mujoco><option cone="elliptic" timestep="{timestep}"/><default>
  <geom contype="0" conaffinity="0"/><joint armature=".005"/></default><worldbody>
  <geom type="plane" size="1 1 1" conaffinity="1"/><body pos="0 0 .36">
  <joint type="slide" axis="1 0 0" armature="0"/><joint type="slide" axis="0 0 1" armature="0"/>
  <geom type="box" size=".1 .1 .05" mass="5"/><body><joint name="hip" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".01" mass=".1"/><body pos="0 0 -.2">
  <joint name="knee" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".01" mass=".15"/><body pos="0 0 -.2">
  <joint name="ankle" axis="0 1 0"/>
  <geom type="box" size=".08 .05 .01" mass=".1" friction="1" contype="1"/></body></body></body>
  </body></worldbody><actuator><position joint="hip" kp="300" kv=".2"/>
  <position joint="knee" kp="300" kv=".2"/><position joint="ankle" kp="300" kv=".2"/>
  </actuator></mujoco>"""


def place_servo_leg(data: mujoco.MjData) -> None:
    """Bend the leg so that its sole lies on the floor."""
    pose = np.array([0.5, -1.0, 0.5])
    data.qpos[1] = 0.4 * np.cos(pose[0]) + 0.01 - 0.36
    data.qpos[2:] = data.ctrl[:] = pose


def decay_of_servo_leg(timestep: float) -> float:
    """Return the rate (1/s) at which the bobbing of the hip dies away between 0.2 and 1.2 s."""
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(SERVO_LEG.format(timestep=timestep)))
    data = engine.make_data()
    place_servo_leg(data)
    heights = []
    for _ in range(round(1.4 / timestep)):
        engine.step(data)
        heights.append(data.qpos[1])
    window = round(0.4 / timestep)
    return float(np.log(np.ptp(heights[:window]) / np.ptp(heights[-window:])))


def decay_of_servo_leg_whose_sole_is_fixed() -> float:
    """Return the same rate of MuJoCo's smooth dynamics, with the sole's velocity held at zero."""
    model = mujoco.MjModel.from_xml_string(
        SERVO_LEG.format(timestep=0.001).replace('contype="1"', "")
    )
    data = mujoco.MjData(model)
    place_servo_leg(data)
    sole, size = model.nbody - 1, model.nv
    translation, rotation = np.zeros((3, size)), np.zeros((3, size))
    inertia = np.zeros((size, size))

    def rates(_, state):
        data.qpos[:], data.qvel[:] = np.split(state, 2)
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, inertia)
        held, changes = [], []
        for of, rows in ((mujoco.mj_jac, held), (mujoco.mj_jacDot, changes)):
            of(model, data, translation, rotation, data.xpos[sole], sole)
            rows.extend([translation[[0, 2]].copy(), rotation[[1]].copy()])
        held, changes = np.vstack(held), np.vstack(changes)
        equations = np.block([[inertia, held.T], [held, np.zeros((3, 3))]])
        loads = np.concatenate([data.qfrc_smooth, -changes @ data.qvel])
        return np.concatenate([data.qvel, np.linalg.solve(equations, loads)[:size]])

    start = np.concatenate([data.qpos, np.zeros(size)])
    times = np.linspace(0.0, 1.4, 1401)
    found = solve_ivp(rates, (0.0, 1.4), start, t_eval=times, rtol=1e-7, atol=1e-9)
    heights = found.y[1, 1:]
    return float(np.log(np.ptp(heights[:400]) / np.ptp(heights[-400:])))


def test_rk4_dampens_a_leg_on_servos_as_its_servos_do():
    """Its sole, which four corners hold, weighs a fiftieth of its body."""
    exact = decay_of_servo_leg_whose_sole_is_fixed()
    # The trapezoidal rule, on which the floor holds it, is of second order.
    assert decay_of_servo_leg(0.001) == pytest.approx(exact, rel=0.006)
    assert decay_of_servo_leg(0.002) == pytest.approx(exact, rel=0.024)
