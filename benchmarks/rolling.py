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
from scene import Array, Run, Scene
from simulate import AS_SHIPPED, DASHPOT, record

MASS, RADIUS, OFFSET, INERTIA = 1.0, 0.05, 0.01, 1e-3
MOMENTS = f"{INERTIA} {INERTIA} {INERTIA}"
SWING = 0.3
GRAVITY = 9.81
SWING_ENERGY = MASS * GRAVITY * OFFSET * (1 - np.cos(SWING))
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


def tumbler_on(ground: str, joints: str) -> str:
    """Return the MJCF of the tumbler at the end of its swing."""
    attributes = f'pos=".03 .02 {RADIUS}" euler="0 {np.degrees(SWING)} 0"'
    return f"""<mujoco>{ASSETS}<worldbody>{GROUNDS[ground]}
      {tumbler_xml(joints, attributes)}</worldbody></mujoco>"""


def tumbler(timestep: float, joints: str = "free", ground: str = "plane") -> mujoco.MjModel:
    """Return the tumbler at the end of its swing."""
    model = mujoco.MjModel.from_xml_string(tumbler_on(ground, joints))
    model.opt.timestep = timestep
    return model


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


def dropped_xml(shape: str, friction: str = 'friction="1 0 0"') -> str:
    """Return the MJCF of a coin or an egg, tilted, 1 to 3 cm above the plane."""
    return f"""<mujoco><worldbody>{PLANE}
      <body pos="0 0 .05" euler="20 30 0"><freejoint/>
        <geom {SHAPES[shape]} density="1000" {friction}/></body></worldbody></mujoco>"""


def dropped(shape: str, timestep: float, *, friction: str = 'friction="1 0 0"') -> mujoco.MjModel:
    """Return a coin or an egg, tilted, 1 to 3 cm above the plane."""
    model = mujoco.MjModel.from_xml_string(dropped_xml(shape, friction))
    model.opt.timestep = timestep
    return model


def energies(
    model: mujoco.MjModel, velocity: dict[int, float], *, duration: float, peer: bool
) -> Array:
    """Return kinetic and potential energy (J) from the start on every 10 ms, `peer`: of MuJoCo.

    `velocity` at the start, by degree of freedom.
    """

    def begin(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        for dof, rate in velocity.items():
            data.qvel[dof] = rate

    scene = Scene(
        name="",
        title="",
        compiled=model,
        duration=duration,
        start=begin,
        measure=lambda run: {},
        sample_interval=0.01,
    )
    return energy_of(record(scene, AS_SHIPPED if peer else DASHPOT, model.opt.timestep))


def energy_of(run: Run) -> Array:
    """Return kinetic and potential energy (J) at every sample, (T,)."""
    data = mujoco.MjData(run.model)
    energies = np.empty(len(run.time))
    for i, (qpos, qvel) in enumerate(zip(run.qpos, run.qvel, strict=True)):
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(run.model, data)
        mujoco.mj_energyPos(run.model, data)
        mujoco.mj_energyVel(run.model, data)
        energies[i] = data.energy.sum()
    return energies


def tumblers(*, duration: float = 20.0) -> list[Scene]:
    """Let tumblers swing; change of their energy in parts of the swing's."""

    def measure(run: Run) -> dict[str, float]:
        energy = energy_of(run)
        return {"energy change": abs(float(energy[-1] - energy[0])) / SWING_ENERGY}

    return [
        Scene(
            name=f"tumbler-{joints.replace(' ', '-')}",
            title=f"tumbler ({joints}) rolling on a plane, change of energy in {duration:g} s",
            xml=tumbler_on("plane", joints),
            duration=duration,
            measure=measure,
            targets={"energy change": 2e-3},
            units={"energy change": ""},
            sample_interval=duration,
            timesteps=TIMESTEPS,
        )
        for joints in JOINTS
    ]


def change_of_tumbler(model: mujoco.MjModel, *, duration: float, peer: bool) -> Array:
    """Return the change of energy every 10 ms, in parts of that of the swing."""
    energy = energies(model, {}, duration=duration, peer=peer)
    return (energy - energy[0]) / SWING_ENERGY


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
