"""Energy of bodies that roll without slip on a plane, beside MuJoCo, and the phase of a tumbler.

    python benchmarks/rolling.py

A tumbler (a ball with its centre of mass below its middle) swings by 0.3 rad; exactly, it does so
for ever, whether it is a free body or hangs on joints, on which its inertia depends. Beside it one
on a swing, which it drives and which drives it. A coin and an egg are dropped at a tilt with some
spin and wobble: once they have landed nothing takes energy out of rolling, and nothing may put any
in. Friction 1, no spin or rolling friction, rigid contact.
"""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.integrate import solve_ivp

import dashpot
from no_arguments import takes_no_arguments
from scene import Array

MASS, RADIUS, OFFSET, INERTIA = 1.0, 0.05, 0.01, 1e-3
MOMENTS = f"{INERTIA} {INERTIA} {INERTIA}"
SWING = 0.3
GRAVITY = 9.81
TIMESTEPS = (0.001, 0.002, 0.005)
SLIDES = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
FLYWHEEL = '<inertial pos="0 0 0" mass=".1" diaginertia="1e-5 1e-5 1e-5"/>'
# By which a tumbler is free to move. Off its centre of mass, so that its inertia changes.
JOINTS = {
    "free": "<freejoint/>",
    "hinge": SLIDES + '<joint type="hinge" axis="0 1 0"/>',
    "ball joint": SLIDES + '<joint type="ball"/>',
    "floating base": f"<freejoint/><body><joint axis='1 0 0'/>{FLYWHEEL}</body>",
}
PLANE = '<geom type="plane" size="0 0 1" friction="1 0 0"/>'
GROUNDS = {
    "plane": PLANE,
    "box": '<geom type="box" size="2 2 .1" pos="0 0 -.1" friction="1 0 0"/>',
    "mesh": '<geom type="mesh" mesh="slab" pos="0 0 -.1" friction="1 0 0"/>',
    "height field": '<geom type="hfield" hfield="flat" friction="1 0 0"/>',
}
CORNERS = " ".join(f"{x} {y} {z}" for x in (-2, 2) for y in (-2, 2) for z in (-0.1, 0.1))
ASSETS = f"""<asset><mesh name="slab" vertex="{CORNERS}"/>
  <hfield name="flat" nrow="21" ncol="21" size="2 2 .1 .1"/></asset>"""
SHAPES = {
    "coin": 'type="cylinder" size=".04 .01"',
    "egg": 'type="ellipsoid" size=".04 .032 .02"',
}


def tumbler_xml(joints: str, attributes: str) -> str:
    return f"""<body {attributes}>{JOINTS[joints]}
      <inertial pos="0 0 {-OFFSET}" mass="{MASS}" diaginertia="{MOMENTS}"/>
      <geom type="sphere" size="{RADIUS}" friction="1 0 0"/></body>"""


def tumbler(timestep: float, joints: str = "free", ground: str = "plane") -> mujoco.MjModel:
    """Return the tumbler at the end of its swing."""
    attributes = f'pos=".03 .02 {RADIUS}" euler="0 {np.degrees(SWING)} 0"'
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}"/>{ASSETS}<worldbody>{GROUNDS[ground]}
          {tumbler_xml(joints, attributes)}</worldbody></mujoco>"""
    )


def swing(timestep: float, joints: str = "free", integrator: str = "Euler") -> mujoco.MjModel:
    """Return a tumbler on a board that swings 0.5 m below its hinge."""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}" integrator="{integrator}"/><worldbody>
          {tumbler_xml(joints, f'pos="0 0 {RADIUS + 0.01}"')}
          <body pos="0 0 .5"><joint axis="0 1 0"/>
            <geom type="box" pos="0 0 -.5" size=".2 .1 .01" mass="1" friction="1 0 0"/></body>
        </worldbody></mujoco>"""
    )


def swing_of_tumbler(times: Array) -> Array:
    """Return the angle (rad) at `times` from the equation of motion of rolling without slip.

    T = (I + m (r^2 + e^2 - 2 r e cos a)) a'^2 / 2, V = -m g e cos a.
    """

    def rates(_: float, state: Array) -> tuple[float, float]:
        angle, speed = state
        inertia = INERTIA + MASS * (RADIUS**2 + OFFSET**2 - 2 * RADIUS * OFFSET * np.cos(angle))
        turning = MASS * RADIUS * OFFSET * np.sin(angle) * speed**2
        return speed, -(MASS * GRAVITY * OFFSET * np.sin(angle) + turning) / inertia

    solution = solve_ivp(
        rates, (0.0, times[-1]), (SWING, 0.0), t_eval=times, method="DOP853", rtol=1e-11, atol=1e-13
    )
    return solution.y[0]


def dropped(shape: str, timestep: float, *, friction: str = 'friction="1 0 0"') -> mujoco.MjModel:
    """Return a coin or an egg, tilted, 1 to 3 cm above the plane."""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}"/><worldbody>
          {PLANE}
          <body pos="0 0 .05" euler="20 30 0"><freejoint/>
            <geom {SHAPES[shape]} density="1000" {friction}/></body></worldbody></mujoco>"""
    )


def energies(
    model: mujoco.MjModel, velocity: dict[int, float], *, duration: float, peer: bool
) -> Array:
    """Return kinetic and potential energy (J) from the start on every 10 ms, `peer`: of MuJoCo.

    `velocity` at the start, by degree of freedom.
    """
    engine = None if peer else dashpot.Engine(model)
    model = model if engine is None else engine.model
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model) if engine is None else engine.make_data()
    for dof, rate in velocity.items():
        data.qvel[dof] = rate
    steps = round(0.01 / model.opt.timestep)

    def energy() -> float:
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        return float(data.energy.sum())

    rows = [energy()]
    for _ in range(round(duration / 0.01)):
        if engine is None:
            mujoco.mj_step(model, data, steps)
        else:
            engine.step(data, nstep=steps)
        rows.append(energy())
    return np.array(rows)


def change_of_tumbler(model: mujoco.MjModel, *, duration: float, peer: bool) -> Array:
    """Return the change of energy every 10 ms, in parts of that of the swing."""
    energy = energies(model, {}, duration=duration, peer=peer)
    return (energy - energy[0]) / (MASS * GRAVITY * OFFSET * (1 - np.cos(SWING)))


def change_on_swing(model: mujoco.MjModel, *, duration: float, peer: bool) -> Array:
    """Return the change of energy every 10 ms, in parts of the kinetic one at the start.

    Both move at the start, by 0.49 m/s at the surface of the board.
    """
    rest = energies(model, {}, duration=0.0, peer=peer)[0]
    energy = energies(model, {0: -0.49, model.nv - 1: 1.0}, duration=duration, peer=peer)
    return (energy - energy[0]) / (energy[0] - rest)


def phase_error(timestep: float, *, duration: float) -> float:
    """Return the largest error (rad) of the tumbler's angle over `duration` (s)."""
    engine = dashpot.Engine(tumbler(timestep))
    data = engine.make_data()
    angles = []
    for _ in range(round(duration / timestep)):
        engine.step(data)
        angles.append(2 * np.arctan2(data.qpos[5], data.qpos[3]))
    times = timestep * np.arange(1, len(angles) + 1)
    return float(np.abs(np.array(angles) - swing_of_tumbler(times)).max())


def main() -> None:
    """Print one line a body and time step."""
    takes_no_arguments(__doc__)
    for timestep in TIMESTEPS:
        error = phase_error(timestep, duration=5.0)
        print(f"tumbler {1e3 * timestep:g} ms: angle within {error:.1e} rad over 5 s")
    for joints in JOINTS:
        for timestep in TIMESTEPS:
            lines = []
            for peer in (False, True):
                alone = change_of_tumbler(tumbler(timestep, joints), duration=20.0, peer=peer)
                board = change_on_swing(swing(timestep, joints), duration=10.0, peer=peer)
                lines.append(f"{alone[-1]:+.4f}, {board[-1]:+.4f}")
            print(
                f"{joints} {1e3 * timestep:g} ms: change of a tumbler's energy in 20 s, and of one "
                f"on a swing in 10 s: {lines[0]}; MuJoCo {lines[1]}"
            )
    for shape in SHAPES:
        for timestep in TIMESTEPS:
            model = dropped(shape, timestep)
            weight = GRAVITY * model.body_mass[1]
            lines = []
            for peer in (False, True):
                energy = energies(model, {3: 5.0}, duration=10.0, peer=peer) / weight * 1e3
                rise = (energy - np.minimum.accumulate(energy)).max()
                lines.append(f"{energy[100]:.1f}, {energy[500]:.1f}, {energy[-1]:.1f} ({rise:.2f})")
            print(
                f"{shape} {1e3 * timestep:g} ms: energy over weight at 1, 5, 10 s (largest rise), "
                f"mm: {lines[0]}; MuJoCo {lines[1]}"
            )


if __name__ == "__main__":
    main()
